//! `eyebox show` shows holograms, sequences, scenes and live content on a display.

#[cfg(target_os = "linux")]
mod application;
#[cfg(not(target_os = "linux"))]
#[path = "no_application.rs"]
mod application;
pub mod args;
mod bench_follower;
mod content;
#[cfg(target_os = "linux")]
mod openxr;
mod playback;
mod session;
pub mod tracked;
mod tracking;
mod two_eyes;
mod viewing;
mod walk;
mod walking;

pub use content::Show;
pub use session::controller_line;
pub use tracked::Stage;

use crate::Failure;
use crate::experiment::{Table, TableOf};
use crate::groups::CameraSettings;
use crate::subject;
use args::ShowSettings;
use content::{display, follow, is_phases, nothing_is_solved, play, solve};
use eyebox::low_level::hologram::{Opening, Sequence};
use eyebox::low_level::reason;
use eyebox::low_level::scene;
use std::path::{Path, PathBuf};

/// The kind of content.
enum What {
    /// Phases that were solved before.
    Phases(PathBuf),
    Scene(String),
    /// Scenes that follow each other.
    Scenes(Vec<String>),
    /// Frames of an application, by its name.
    Application(String),
    /// Frames of an OpenXR application that is started with these words.
    #[cfg(target_os = "linux")]
    OpenXr(Vec<String>),
}

/// Shows the content and prints the statistics.
pub fn run(args: &Show) -> Result<(), Failure> {
    let tables: [TableOf; 2] = [("show", ShowSettings::table), ("camera", CameraSettings::table)];
    if args.subject.experiment.printed(&tables)? {
        return Ok(());
    }
    let settings: ShowSettings = args.subject.experiment.table("show")?;
    let tracked = args.live.tracker().is_some();
    if let Some(sink) = args.live.shown.output.sink() {
        sink.check()?;
    }
    if let Some(two) = two_eyes::display(&args.subject)? {
        return two_eyes::show(args, &settings, &two);
    }
    let what = what(args)?;
    walk::refuse(args, tracked && matches!(&what, What::Scene(scene) if scene::is_splats(scene)))?;
    if let Some(camera) = &args.follow.camera {
        return match what {
            What::Scene(scene) if !tracked => {
                let (Show { subject, live, stream, follow, .. }, frames) = (args, args.frames()?);
                let shown = bench_follower::SceneToShow { scene: &scene, subject, live, stream, follow, frames };
                bench_follower::show(shown, camera, |sequence, display| play(args, &settings, sequence, display))
            }
            _ => Err(Failure::Arguments(reason!(
                "camera-and-tracker",
                "--camera follows one scene that is shown without a tracker"
            ))),
        };
    }
    match what {
        What::Application(name) => application::show(args, settings, &name, || Ok(())),
        #[cfg(target_os = "linux")]
        What::OpenXr(command) => openxr::show(args, settings, &command),
        What::Phases(path) if tracked => follow(args, settings, &path.display().to_string()),
        What::Phases(path) => {
            nothing_is_solved(args, &path)?;
            let display = display(args, Some(&path))?;
            let unfinished = args.unfinished.unfinished || args.stream.follow;
            let color = args.subject.display.color.one();
            let opening = Opening { unfinished, ..args.subject.unit.opening(Some(&display), color) };
            let sequence = opening.sequence(&path).map_err(|e| args.unfinished.failure(e))?;
            play(args, &settings, sequence, display)
        }
        What::Scene(scene) if tracked && scene::is_splats(&scene) => walk::show(args, settings, &scene),
        What::Scene(scene) if tracked => follow(args, settings, &scene),
        What::Scene(scene) => {
            let stage = Stage::open(&args.subject, &args.live)?;
            let (hologram, _, display) = subject::solved(&scene, &args.subject, &stage.engines)?;
            play(args, &settings, Sequence::single(Path::new(&scene), hologram), display)
        }
        What::Scenes(scenes) => {
            let folder = tempfile::tempdir()
                .map_err(|e| Failure::Arguments(reason!("folder", "a folder for its holograms: {e}")))?;
            let file = folder.path().join("scenes.zarr");
            let display = solve(args, scenes, &file)?;
            if tracked {
                return follow(args, settings, &file.display().to_string());
            }
            play(args, &settings, Sequence::open(&file)?, display)
        }
    }
}

/// Finds the kind of content by its name.
fn what(args: &Show) -> Result<What, Failure> {
    #[cfg(target_os = "linux")]
    if let Some(("openxr", command)) = args.what.split_first().map(|(first, rest)| (first.as_str(), rest)) {
        return Ok(What::OpenXr(command.to_vec()));
    }
    let one = args.what.first().filter(|_| args.what.len() == 1);
    let Some(one) = one else {
        return match args.what.iter().find(|what| what.starts_with("live:") || is_phases(what)) {
            Some(what) => {
                Err(Failure::Arguments(reason!("shown-alone", "{what} is shown alone. Only scenes follow each other")))
            }
            None => Ok(What::Scenes(args.what.clone())),
        };
    };
    let path = Path::new(one);
    if let Some(name) = one.strip_prefix("live:") {
        return Ok(What::Application(name.into()));
    }
    if is_phases(one) {
        return Ok(What::Phases(path.into()));
    }
    let frames = scene::sequence(one, &args.subject.options.depth_map)?;
    Ok(frames.map_or_else(|| What::Scene(one.clone()), What::Scenes))
}
