//! `eyebox show` of splats with a tracker draws views for the tracked pupil, while the camera moves.

use super::args::ShowSettings;
use super::content::{Show, display_for, endless_needs_duration, kept_of_applications, refined};
use super::tracked::{self, KeptSession, Stage};
use crate::subject::{Steered, SubjectOptions};
use crate::{Failure, common};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::reason;
use eyebox::low_level::scene::{CameraPath, MovingSplats};
use eyebox::low_level::session::SplatWalk;
use std::path::Path;
use std::time::Duration;

/// The name of the built-in path.
const AROUND: &str = "around";

/// Refuses a path for content without a camera that moves.
pub fn refuse(args: &Show, moves: bool) -> Result<(), Failure> {
    match args.walk.walk.is_some() && !moves {
        true => Err(Failure::Arguments(reason!(
            "walk-without-splats",
            "--walk moves the camera in front of splats that are shown with --tracker or --view"
        ))),
        false => Ok(()),
    }
}

/// Opens splats for the displays of two eyes, with the depths that the eyes may focus at.
pub fn of_two_eyes(
    args: &Show,
    sources: &[String; 2],
    subjects: &[SubjectOptions; 2],
    stage: &Stage,
) -> Result<[(Steered, [f64; 2]); 2], Failure> {
    refuse_quality(args, &sources[0])?;
    let path = stated_path(args)?;
    let engine = stage.engines.open()?;
    let left = Placed::read(args, &subjects[0], &sources[0])?;
    let right = Placed::read(args, &subjects[1], &sources[1])?;
    let path = left.path(args, path);
    let mut of_left = SplatWalk::new(left.splats, &left.display, &left.colors, path);
    let mut of_right = of_left.of_right_eye(right.splats, &right.display, &right.colors);
    drawn_by(&mut of_left, stage)?;
    drawn_by(&mut of_right, stage)?;
    let left_steered = steered(args, &sources[0], (&left.display, left.colors), of_left, engine.as_ref())?;
    let right_steered = steered(args, &sources[1], (&right.display, right.colors), of_right, engine.as_ref())?;
    Ok([(left_steered, left.depths), (right_steered, right.depths)])
}

fn refuse_quality(args: &Show, source: &str) -> Result<(), Failure> {
    if args.subject.quality.quality.is_none() {
        return Ok(());
    }
    let line = "splats with a tracker are not solved first. Leave out --quality";
    Err(Failure::Arguments(reason!("quality-of-splats", "{source}: {line}")))
}

/// Reads the path of `--walk`, unless it is the built-in one.
fn stated_path(args: &Show) -> Result<Option<CameraPath>, Failure> {
    let file = args.walk.walk.as_deref().filter(|path| *path != AROUND);
    Ok(file.map(|file| CameraPath::read(Path::new(file))).transpose()?)
}

/// Splats in front of a display.
struct Placed {
    splats: MovingSplats,
    display: Display,
    colors: Vec<Color>,
    /// The depths that eyes may focus at, meters.
    depths: [f64; 2],
}

impl Placed {
    fn read(args: &Show, subject: &SubjectOptions, source: &str) -> Result<Self, Failure> {
        let display = display_for(subject, None)?;
        let colors = common::colors(&subject.display, &display)?;
        let reading = args.subject.options.reading(display.focal_length);
        let request = reading.request(&display, &colors, None, subject.display.force);
        let splats = MovingSplats::new(source, &request)?;
        tracing::info!("{source}: {}", splats.read_as());
        let depths = args.subject.options.depth_before(&display).unwrap_or(splats.depth());
        Ok(Self { splats, display, colors, depths })
    }

    /// Returns the path of the camera, and the time of one round.
    fn path(&self, args: &Show, stated: Option<CameraPath>) -> Option<(CameraPath, Duration)> {
        let is_around = args.walk.walk.as_deref() == Some(AROUND);
        let path = if is_around { Some(self.splats.around()) } else { stated };
        path.map(|path| (path, Duration::from_secs_f64(args.walk.walk_time.min(1e6))))
    }
}

/// Lets the device of the engines draw, if they have one.
fn drawn_by(walk: &mut SplatWalk, stage: &Stage) -> Result<(), Failure> {
    if let Some(reason) = walk.draw_with(stage.engines.backend())? {
        tracing::info!("the CPU draws views because {reason}");
    }
    Ok(())
}

/// Returns darkness until the first views are drawn.
fn steered(
    args: &Show,
    source: &str,
    (display, colors): (&Display, Vec<Color>),
    walk: SplatWalk,
    engine: &dyn Engine,
) -> Result<Steered, Failure> {
    let seed = args.subject.experiment.refinement()?.seed;
    let mut steered = Steered::dark(source, display, colors, (args.frames()?, seed), engine)?;
    steered.scenes = Some(Box::new(walk));
    Ok(steered)
}

/// Shows splats for the tracked pupil.
pub fn show(args: &Show, settings: ShowSettings, source: &str) -> Result<(), Failure> {
    kept_of_applications(args)?;
    let cost = refined(args, &settings)?;
    endless_needs_duration(args, cost, true)?;
    refuse_quality(args, source)?;
    let path = stated_path(args)?;
    let stage = Stage::open(&args.subject, &args.live)?;
    let engine = stage.engines.open()?;
    let placed = Placed::read(args, &args.subject, source)?;
    let (depths, display) = (placed.depths, placed.display.clone());
    let path = placed.path(args, path);
    let moves_by_itself = path.is_some();
    let mut walk = SplatWalk::new(placed.splats, &placed.display, &placed.colors, path);
    drawn_by(&mut walk, &stage)?;
    let handle = Some(walk.handle()).filter(|_| !moves_by_itself);
    let steered = steered(args, source, (&display, placed.colors), walk, engine.as_ref())?;
    drop(engine);
    common::say_model_age(&display);
    tracked::show(
        steered,
        &args.live,
        tracked::ShowOptions {
            policy: args.subject.experiment.policy()?,
            tracker: args.live.tracker(),
            simulated: cost,
            depths: Some(depths),
            kept: KeptSession::default(),
            settings,
            walk: handle,
        },
        stage,
    )
}
