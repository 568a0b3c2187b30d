//! The command as tests run it.

#![allow(dead_code, reason = "each test file uses what it needs")]

#[cfg(target_os = "linux")]
pub mod desk;
pub mod made;
#[cfg(target_os = "linux")]
pub mod power;
#[cfg(target_os = "linux")]
pub mod screen;
#[cfg(target_os = "linux")]
pub mod xvfb;

use std::path::Path;
use std::process::{Command, Output};

/// The command, in `folder`, with a cache of the tests' own.
pub fn command(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_eyebox"));
    command.args(args).current_dir(folder).env("XDG_CACHE_HOME", std::env::temp_dir().join("eyebox-tests"));
    command
}

/// What came of it.
pub fn eyebox(folder: &Path, args: &[&str]) -> Output {
    command(folder, args).output().expect("the command starts")
}

/// What was printed.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Success; what was printed on standard output.
pub fn done(folder: &Path, args: &[&str]) -> String {
    let answer = eyebox(folder, args);
    assert!(answer.status.success(), "{args:?}: {}", text(&answer.stderr));
    text(&answer.stdout)
}

/// Exit code 2, one line that says `what`, nothing at `out` and nothing half-written beside it.
pub fn refused(folder: &Path, args: &[&str], out: &str, what: &str) {
    let answer = eyebox(folder, args);
    let said = text(&answer.stderr);
    assert_eq!(answer.status.code(), Some(2), "{args:?}: {said}");
    assert_eq!(said.trim().lines().count(), 1, "{args:?}: {said}");
    assert!(said.contains(what) && !said.contains("panicked"), "{args:?}: {said}");
    assert!(!folder.join(out).exists(), "{args:?} left {out}");
    let part = |e: std::io::Result<std::fs::DirEntry>| e.unwrap().file_name().to_string_lossy().ends_with(".part");
    assert!(!std::fs::read_dir(folder).unwrap().any(part), "{args:?} left something half-written");
}

/// Every plot of a report's page is in `figures/` too, whole, as an SVG that needs no style sheet and as a PDF.
pub fn figures_of(report: &Path, page: &str) {
    let page = std::fs::read_to_string(report.join(page)).expect("a page");
    let files = std::fs::read_dir(report.join("figures")).expect("figures").map(|e| e.expect("an entry").path());
    let (svg, pdf): (Vec<_>, Vec<_>) = files.partition(|f| f.extension().is_some_and(|e| e == "svg"));
    assert_eq!([svg.len(), pdf.len()], [page.matches("<svg").count(); 2], "{svg:?}");
    for file in svg {
        let text = std::fs::read_to_string(&file).expect("text");
        let complete = text.starts_with("<svg") && text.contains("fill=\"#ffffff\"") && text.ends_with("</svg>");
        assert!(complete && !text.contains("class=") && !text.contains("var("), "{file:?}: {text}");
    }
    for file in pdf {
        let bytes = std::fs::read(&file).expect("bytes");
        assert!(bytes.starts_with(b"%PDF-1.") && bytes.trim_ascii_end().ends_with(b"%%EOF"), "{file:?}");
    }
}

/// A folder of the test's own.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Asks a process twice to stop, as two ctrl-Cs do. Of two kinds, for two of one kind that come at once are one.
#[cfg(unix)]
pub fn interrupt_twice(id: u32) {
    let both = format!("kill -INT {id}; kill -TERM {id}");
    assert!(Command::new("sh").args(["-c", &both]).status().expect("sh").success(), "{id} has ended");
}
