//! `eyebox show --camera` follows a bench with a camera while a scene is shown.
//!
//! The camera takes pictures of the hologram on the screen at intervals, the display's model follows the bench, and the
//! scene is solved again for it.

use super::args::{ClockName, StreamArgs};
use super::tracked::LiveOptions;
use crate::groups::CameraSettings;
use crate::subject::{self, SubjectOptions};
use crate::{Failure, common};
use clap::Args;
use eyebox::low_level::calibrate::{CameraCommand, Report};
use eyebox::low_level::files;
use eyebox::low_level::hologram::{NewestHologram, Sequence};
use eyebox::low_level::optics::Display;
use eyebox::low_level::reason;
use eyebox::low_level::session::{BenchFollower, FollowEvent};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

/// The options of the camera.
#[derive(Args)]
pub struct FollowArgs {
    /// Command of a camera that takes pictures of the screen. The display's model follows the bench (docs/calibrate.md)
    #[arg(help_heading = "Camera", long, value_name = "COMMAND")]
    pub camera: Option<String>,
    /// Write the display file with the newest model
    #[arg(help_heading = "Camera", long, value_name = "OUT.toml", requires = "camera")]
    pub camera_model: Option<PathBuf>,
    /// Keep the pictures in this folder
    #[arg(help_heading = "Camera", long, value_name = "OUT_DIR", requires = "camera")]
    pub keep: Option<PathBuf>,
}

/// A scene that is shown, with its options.
#[derive(Clone, Copy)]
pub struct SceneToShow<'a> {
    pub scene: &'a str,
    pub subject: &'a SubjectOptions,
    pub live: &'a LiveOptions,
    pub stream: &'a StreamArgs,
    pub follow: &'a FollowArgs,
    pub frames: usize,
}

/// Shows a scene without a tracker, and follows the bench by the camera's command.
pub fn show(
    args: SceneToShow,
    camera: &str,
    play: impl FnOnce(Sequence, Display) -> Result<(), Failure> + Send,
) -> Result<(), Failure> {
    let SceneToShow { scene, subject, live, stream, follow, frames } = args;
    if stream.clock == Some(ClockName::Simulated) || live.record.is_some() {
        return Err(Failure::Arguments(reason!(
            "camera-and-clock",
            "--camera needs real time. Leave out --clock simulated and --record"
        )));
    }
    let model = follow.camera_model.as_deref();
    if let Some(file) = model {
        common::check_output(file, "toml")?;
    }
    let mut display = common::display(&subject.display)?;
    subject.eye.replace(&mut display.prescription)?;
    let [color] = common::colors(&subject.display, &display)?[..] else {
        return Err(Failure::Arguments(reason!("camera-without-color", "--camera follows one color. Give --color")));
    };
    let mut engine = common::engine(&subject.engine)?;
    let mut solve = |display: &Display| -> Result<_, Failure> {
        Ok(subject::solved_on(scene, subject, display, Some(frames), engine.as_mut())?.0)
    };
    let newest = NewestHologram::new(solve(&display)?);
    let mut say = |line: &str| eprintln!("{line}");
    let of_camera: CameraSettings = subject.experiment.table("camera")?;
    let limit = of_camera.timeout.map(Duration::from_secs_f64);
    let output = live.shown.output.output(false);
    let camera = CameraCommand { command: camera, keep: follow.keep.as_deref(), limit, iris_mm: of_camera.iris };
    let settle = Duration::from_secs_f64(of_camera.settle.min(1e6));
    let every = Duration::from_secs_f64((of_camera.every * 60.0).min(1e9));
    let follower = BenchFollower::open((&display, color), (&output, settle), &camera, every, &mut say)?;
    let sequence = Sequence::newest_of(Path::new(scene), &newest);
    thread::scope(|scope| {
        let shows = scope.spawn(move || play(sequence, display));
        let followed = follower.follow(&newest, &|| shows.is_finished(), &mut solve, &mut |event| print(event, model));
        if let Err(failure) = &followed
            && !shows.is_finished()
        {
            eprintln!("eyebox: {failure}: the model does not follow any more");
        }
        let gone =
            |_| Err(Failure::Arguments(reason!("fault", "the thread that shows failed, which is a fault of eyebox")));
        shows.join().unwrap_or_else(gone).and(followed)
    })
}

/// Prints an event, and writes the newest model.
fn print(event: FollowEvent, model: Option<&Path>) -> Result<(), Failure> {
    let left = |report: &Report| {
        report.unexplained.map_or_else(String::new, |share| format!(": {:.2} % is unexplained", 100.0 * share))
    };
    if let (FollowEvent::Agrees(fitted) | FollowEvent::Followed(fitted), Some(file)) = (&event, model) {
        let text = fitted.display.to_toml();
        files::write_file(file, |to| to.write_all(text.as_bytes()))?;
    }
    match event {
        FollowEvent::Discarded => eprintln!("a picture was discarded because the screen changed during its exposure"),
        FollowEvent::Unexplained(report) => {
            eprintln!("eyebox: the latest pictures are not explained{}; the model stays as it is", left(report));
        }
        FollowEvent::Agrees(fitted) => eprintln!("the bench is as its model{}", left(&fitted.report)),
        FollowEvent::Followed(fitted) => eprintln!("the model followed the bench{}", left(&fitted.report)),
        FollowEvent::Replaced(_) => eprintln!("the scene was solved again for the new model"),
        FollowEvent::Failed(error) => eprintln!("eyebox: {error}: the model stays as it is"),
        FollowEvent::Lost(error) => eprintln!("eyebox: {error}: the model does not follow any more"),
        _ => {}
    }
    Ok(())
}
