//! `eyebox show` of splats with a tracker draws views for the tracked pupil, while the camera moves.

use super::args::ShowSettings;
use super::content::{Show, display, endless_needs_duration, kept_of_applications, refined};
use super::tracked::{self, KeptSession, Stage};
use crate::{Failure, common, subject::Steered};
use eyebox::low_level::reason;
use eyebox::low_level::scene::{CameraPath, MovingSplats, Request};
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

/// Shows splats for the tracked pupil.
pub fn show(args: &Show, settings: ShowSettings, source: &str) -> Result<(), Failure> {
    kept_of_applications(args)?;
    let cost = refined(args, &settings)?;
    endless_needs_duration(args, cost, true)?;
    if args.subject.quality.quality.is_some() {
        let line = "splats with a tracker are not solved first. Leave out --quality";
        return Err(Failure::Arguments(reason!("quality-of-splats", "{source}: {line}")));
    }
    let read = match args.walk.walk.as_deref().filter(|path| *path != AROUND) {
        Some(file) => Some(CameraPath::read(Path::new(file))?),
        None => None,
    };
    let stage = Stage::open(&args.subject, &args.live)?;
    let display = display(args, None)?;
    let colors = common::colors(&args.subject.display, &display)?;
    let reading = args.subject.options.reading(display.focal_length);
    let drawer = stage.engines.open()?.splat_drawer()?;
    let request = reading.request(&display, &colors, None, args.subject.display.force);
    let splats = MovingSplats::new(source, &Request { drawer: drawer.as_ref(), ..request })?;
    tracing::info!("{source}: {}", splats.read_as());
    let path = if args.walk.walk.as_deref() == Some(AROUND) { Some(splats.around()) } else { read };
    let path = path.map(|path| (path, Duration::from_secs_f64(args.walk.walk_time.min(1e6))));
    let depths = args.subject.options.depth_before(&display).or(Some(splats.depth()));
    let seed = args.subject.experiment.refinement()?.seed;
    let moves_by_itself = path.is_some();
    let walk = SplatWalk::new(splats, &display, &colors, path);
    let handle = Some(walk.handle()).filter(|_| !moves_by_itself);
    let mut steered = Steered::dark(source, &display, colors, (args.frames()?, seed), &stage.engines)?;
    steered.scenes = Some(Box::new(walk));
    common::say_model_age(&display);
    tracked::show(
        steered,
        &args.live,
        tracked::ShowOptions {
            policy: args.subject.experiment.policy()?,
            tracker: args.live.tracker(),
            simulated: cost,
            depths,
            kept: KeptSession::default(),
            settings,
            walk: handle,
        },
        stage,
    )
}
