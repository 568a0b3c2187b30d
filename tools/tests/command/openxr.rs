//! `eyebox show openxr` as a user runs it, with the application and the runtime of the layer's own tests.

use crate::common::{self, document, folder, text};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const SHOW: [&str; 8] = ["show", "openxr", "--display", "planes8", "--size", "64x96", "--color", "green"];

/// Returns true if cargo built the layer with the command. `cargo test --workspace` does.
pub fn has_layer() -> bool {
    let program = Path::new(env!("CARGO_BIN_EXE_eyebox"));
    let found = ["", "deps"]
        .iter()
        .any(|place| program.parent().is_some_and(|folder| folder.join(place).join("libeyebox_openxr.so").is_file()));
    assert!(found || std::env::var_os("CI").is_none(), "no layer: cargo build -p eyebox-openxr");
    if !found {
        eprintln!("no layer of OpenXR, so it is not shown (cargo build -p eyebox-openxr)");
    }
    found
}

/// Builds the application and the runtime, or returns false if this machine has no loader of OpenXR.
pub fn build(at: &Path) -> bool {
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("openxr/tests");
    let cc = |words: &[&str], output: &str| {
        let mut cc = Command::new("cc");
        cc.args(["-std=gnu11", "-O1", "-w", "-o"]).arg(at.join(output)).args(words).current_dir(&sources);
        cc.stderr(Stdio::null()).status().is_ok_and(|status| status.success())
    };
    let libraries = ["-lopenxr_loader", "-lvulkan", "-lm", "-lpthread"];
    let built = cc(&[&["client.c"][..], &libraries].concat(), "client")
        && cc(&["-fPIC", "-shared", "runtime.c", "-lvulkan", "-lm"], "libnull.so");
    let runtime = serde_json::json!({
        "file_format_version": "1.0.0",
        "runtime": { "library_path": at.join("libnull.so") },
    });
    std::fs::write(at.join("runtime.json"), runtime.to_string()).unwrap();
    assert!(built || std::env::var_os("CI").is_none(), "no loader of OpenXR: run tools/setup.sh");
    if !built {
        eprintln!("no loader of OpenXR or of Vulkan, so no application is shown (tools/setup.sh installs them)");
    }
    built
}

/// Gives a command the runtime that was built.
pub fn with_runtime<'a>(command: &'a mut Command, at: &Path) -> &'a mut Command {
    command.env("XDG_RUNTIME_DIR", at).env("XR_RUNTIME_JSON", at.join("runtime.json"));
    command.env_remove("XR_API_LAYER_PATH").env_remove("XR_ENABLE_API_LAYERS").env_remove("EYEBOX_OPENXR_FOV")
}

fn show(at: &Path, words: &[&str]) -> Command {
    show_by("cpu", at, words)
}

/// Shows an application by an engine.
fn show_by(engine: &str, at: &Path, words: &[&str]) -> Command {
    let mut command = common::command(at, &[&SHOW[..], &["--engine", engine], words].concat());
    with_runtime(&mut command, at);
    command
}

/// The application starts when the display listens, its frames are lit, and its last picture stays after its end. With
/// engines on a device, its frames stay there.
#[test]
fn an_openxr_application_is_started_and_shown() {
    if !has_layer() {
        return;
    }
    let temp = folder();
    let at = temp.path();
    if !build(at) {
        return;
    }
    let client = at.join("client").display().to_string();
    let words = ["--duration", "6", "--stats", "s.json", "--", &client, "frames=150", "depth=d16", "size=128x96"];
    for (engine, where_they_are) in [("cpu", "takes frames of 64 x 96 pixels\n"), ("vulkan", " pixels on the device\n")]
    {
        let shown = show_by(engine, at, &words).env("NULL_RUNTIME_PERIOD_US", "20000").output().expect("it starts");
        let errors = text(&shown.stderr);
        assert!(shown.status.success(), "{errors}");
        let stats = document(&at.join("s.json"));
        let content = &stats["content"];
        assert_eq!(content["source"], "live:openxr");
        assert!(content["scenes"].as_u64().unwrap() >= 2 && content["refused"] == 0, "{content}: {errors}");
        assert!(content["sets"]["new"].as_u64().unwrap() >= 2, "{content}");
        // The field of view is the display's, so that the submitted view fills the picture.
        assert!(errors.contains("ended (exit status: 0)"), "{errors}");
        assert!(errors.contains(where_they_are), "{errors}");
    }
}

/// The application receives the environment of the layer, and ends with the display.
#[test]
fn the_application_has_the_environment_and_ends_with_the_display() {
    if !has_layer() {
        return;
    }
    let temp = folder();
    let at = temp.path();
    let script = "env > seen.tmp; cp ${XR_API_LAYER_PATH%%:*}/eyebox.json layer.json; mv seen.tmp seen; echo $$ > id; exec sleep 600";
    let begun = Instant::now();
    let shown = show(at, &["--duration", "2", "--", "sh", "-c", script]).output().expect("it starts");
    assert!(shown.status.success(), "{}", text(&shown.stderr));
    assert!(begun.elapsed() < Duration::from_secs(120), "the application did not end");
    let seen = std::fs::read_to_string(at.join("seen")).unwrap();
    let has = |line: &str| seen.lines().any(|seen| seen.starts_with(line));
    assert!(has("XR_ENABLE_API_LAYERS=XR_APILAYER_EYEBOX_live"), "{seen}");
    assert!(has("EYEBOX_OPENXR_NAME=openxr") && has("EYEBOX_OPENXR_FOV=display"), "{seen}");
    let library = document(&at.join("layer.json"))["api_layer"]["library_path"].as_str().unwrap().to_owned();
    assert!(Path::new(&library).is_absolute() && Path::new(&library).is_file(), "{library}");
    let id = std::fs::read_to_string(at.join("id")).unwrap();
    let command = std::fs::read(format!("/proc/{}/cmdline", id.trim())).unwrap_or_default();
    assert!(!command.starts_with(b"sleep\x00600"), "it runs after the display");
    // A folder of the user stays on the path, behind the layer's own.
    let mut other = show(
        at,
        &["--duration", "1", "--", "sh", "-c", "echo $XR_API_LAYER_PATH > path; echo $XR_ENABLE_API_LAYERS >> path"],
    );
    let shown =
        other.env("XR_API_LAYER_PATH", "/own").env("XR_ENABLE_API_LAYERS", "XR_OWN").output().expect("it starts");
    let path = std::fs::read_to_string(at.join("path")).unwrap();
    let [folders, layers] = path.lines().collect::<Vec<_>>().try_into().unwrap();
    assert!(
        shown.status.success() && folders.ends_with(":/own") && layers == "XR_OWN:XR_APILAYER_EYEBOX_live",
        "{path}"
    );
}

#[test]
fn an_application_that_does_not_start_is_an_error() {
    if !has_layer() {
        return;
    }
    let temp = folder();
    let at = temp.path();
    let mut command = show(at, &["--duration", "1", "--", "./nothing"]);
    common::refusal_of(&mut command).is("arguments/openxr-start");
}
