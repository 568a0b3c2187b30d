//! `eyebox show openxr` starts an OpenXR application with the layer that sends its frames (docs/openxr.md).

use super::application;
use super::args::{Ask, ShowSettings};
use super::content::Show;
use crate::Failure;
use eyebox::low_level::reason;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The name of the content, and of the display for the layer.
pub const NAME: &str = "openxr";
/// The manifest of the layer, whose path to the library is replaced.
const MANIFEST: &str = include_str!("../../openxr/eyebox.json");
/// The file name of the layer.
const LIBRARY: &str = "libeyebox_openxr.so";
/// The folders of other layers, which the variable of the path hides.
const USUAL_FOLDERS: [&str; 3] = [
    "/etc/openxr/1/api_layers/explicit.d",
    "/usr/local/share/openxr/1/api_layers/explicit.d",
    "/usr/share/openxr/1/api_layers/explicit.d",
];
const LAYERS: &str = "XR_ENABLE_API_LAYERS";
const LAYER_PATH: &str = "XR_API_LAYER_PATH";
const FIELD_OF_VIEW: &str = "EYEBOX_OPENXR_FOV";
/// The time between two checks whether the application ended.
const POLL: Duration = Duration::from_millis(100);
/// The time in which the application may end by itself when the display ends.
const PATIENCE: Duration = Duration::from_secs(3);

/// Shows the frames of an OpenXR application.
pub fn show(args: &Show, settings: ShowSettings, command: &[String]) -> Result<(), Failure> {
    let mut program = Program::new(command)?;
    application::show(args, settings_of(settings), NAME, || program.start())
}

/// Returns the settings for frames of an OpenXR application, which have depths.
pub fn settings_of(settings: ShowSettings) -> ShowSettings {
    ShowSettings { ask: Ask::Depth, ..settings }
}

/// An OpenXR application, which ends when this is dropped.
pub struct Program {
    command: Vec<String>,
    layer: Layer,
    running: Option<Running>,
}

impl Program {
    /// Prepares an application with its arguments.
    pub fn new(command: &[String]) -> Result<Self, Failure> {
        Ok(Self { command: command.to_vec(), layer: Layer::new()?, running: None })
    }

    /// Starts the application. If there is none, its environment is printed.
    pub fn start(&mut self) -> Result<(), Failure> {
        match self.command.split_first() {
            Some((program, arguments)) => self.running = Some(Running::start(program, arguments, &self.layer)?),
            None => {
                eprintln!("start the OpenXR application with these variables:");
                self.layer.variables().iter().for_each(|(name, value)| eprintln!("{name}={}", value.display()));
            }
        }
        Ok(())
    }
}

/// The layer with its manifest in a folder of its own.
struct Layer {
    folder: tempfile::TempDir,
    /// The name that enables the layer.
    name: String,
}

impl Layer {
    fn new() -> Result<Self, Failure> {
        let library = library()?;
        let failed = |error: &dyn std::fmt::Display| {
            Failure::Arguments(reason!(
                "openxr-manifest",
                "the manifest of the OpenXR layer cannot be written ({error})"
            ))
        };
        let mut manifest: serde_json::Value = serde_json::from_str(MANIFEST).map_err(|e| failed(&e))?;
        let about = &mut manifest["api_layer"];
        let name = about["name"].as_str().unwrap_or_default().to_owned();
        about["library_path"] = library.display().to_string().into();
        let folder = tempfile::tempdir().map_err(|e| failed(&e))?;
        std::fs::write(folder.path().join("eyebox.json"), manifest.to_string()).map_err(|e| failed(&e))?;
        Ok(Self { folder, name })
    }

    /// Returns the variables of the application. Layers that the user enabled stay.
    fn variables(&self) -> Vec<(&'static str, OsString)> {
        let joined = |first: OsString, second: Option<OsString>| match second.filter(|text| !text.is_empty()) {
            Some(second) => [first, second].join(std::ffi::OsStr::new(":")),
            None => first,
        };
        let usual = || {
            let there = USUAL_FOLDERS.iter().filter(|folder| Path::new(folder).is_dir());
            OsString::from(there.copied().collect::<Vec<_>>().join(":"))
        };
        let path = std::env::var_os(LAYER_PATH).unwrap_or_else(usual);
        // The layers of the user come first, so that this one receives their submissions.
        let own = OsString::from(self.name.clone());
        let layers = match std::env::var_os(LAYERS).filter(|layers| !layers.is_empty()) {
            Some(before) => joined(before, Some(own)),
            None => own,
        };
        let mut all = vec![
            (LAYERS, layers),
            (LAYER_PATH, joined(self.folder.path().into(), Some(path))),
            ("EYEBOX_OPENXR_NAME", NAME.into()),
        ];
        if std::env::var_os(FIELD_OF_VIEW).is_none() {
            all.push((FIELD_OF_VIEW, "display".into()));
        }
        all
    }
}

/// Finds the library next to the program, or where packages place libraries.
fn library() -> Result<PathBuf, Failure> {
    let program = std::env::current_exe().and_then(|path| path.canonicalize()).unwrap_or_default();
    let folder = program.parent().unwrap_or(Path::new("/"));
    let places = ["", "deps", "../lib/eyebox", "../lib"];
    let found = places.iter().map(|place| folder.join(place).join(LIBRARY)).find(|path| path.is_file());
    found.ok_or_else(|| {
        let folder = folder.display();
        Failure::Arguments(reason!(
            "openxr-layer",
            "the OpenXR layer {LIBRARY} is not in {folder}. Build it with cargo build -p eyebox-openxr, or copy it there"
        ))
    })
}

/// A running application, which ends with the display.
struct Running {
    child: Arc<Mutex<Option<Child>>>,
}

impl Running {
    fn start(program: &str, arguments: &[String], layer: &Layer) -> Result<Self, Failure> {
        let child = Command::new(program).args(arguments).envs(layer.variables()).spawn();
        let child = child.map_err(|e| Failure::Arguments(reason!("openxr-start", "{program} does not start ({e})")))?;
        let child = Arc::new(Mutex::new(Some(child)));
        let (watched, program) = (child.clone(), program.to_owned());
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(POLL);
                let mut child = watched.lock().unwrap_or_else(PoisonError::into_inner);
                let Some(running) = child.as_mut() else { return };
                if let Ok(Some(status)) = running.try_wait() {
                    eprintln!("{program} ended ({status}). The last picture stays");
                    *child = None;
                    return;
                }
            }
        });
        Ok(Self { child })
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let Some(mut child) = self.child.lock().unwrap_or_else(PoisonError::into_inner).take() else { return };
        let id = i32::try_from(child.id()).ok().and_then(rustix::process::Pid::from_raw);
        if let Some(id) = id {
            let _ = rustix::process::kill_process(id, rustix::process::Signal::TERM);
        }
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            if !matches!(child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let _ = child.kill();
        let _ = child.wait();
    }
}
