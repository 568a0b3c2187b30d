//! Ctrl-C: a command that has nothing to save ends by it and leaves no file.

use crate::common::{command, done, folder, text};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

/// Presses ctrl-C after a while. Returns how the command ended and what it printed, or nothing if it had ended before.
fn interrupt(at: &Path, line: &str, after: Duration) -> Option<(ExitStatus, String)> {
    let args: Vec<&str> = line.split_whitespace().collect();
    let mut child = command(at, &args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(after);
    if child.try_wait().unwrap().is_some() {
        return None;
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let answer = child.wait_with_output().unwrap();
    Some((answer.status, text(&answer.stderr)))
}

#[test]
fn a_command_that_has_nothing_to_save_ends_and_leaves_nothing() {
    let temp = folder();
    let at = temp.path();
    let solve = "solve builtin:still-life --display small --size 64x64 --color green --steps 2 --frames 2 -o h.zarr --engine cpu";
    done(at, &solve.split(' ').collect::<Vec<_>>());
    std::fs::create_dir(at.join("out")).unwrap();
    // Each takes seconds, and most of them before there is anything to save.
    let lines = [
        "solve builtin:still-life --size 384x384 --views 17 -o out/x.zarr --engine cpu",
        "photograph builtin:still-life --size 384x384 --views 17 --pupil=0,0,4,0 -o out/x.png --engine cpu",
        "inspect builtin:still-life --size 384x384 --views 17 -o out/x.png",
        "plan builtin:still-life --size 384x384 --views 17",
        "score h.zarr --pupils random:40000 --engine cpu",
        "score h.zarr builtin:still-life --pupils random:40000 --json --engine cpu",
        "study builtin:still-life --size 384x384 --views 17 -o out/x --engine cpu",
    ];
    let mut tried = 0;
    for line in lines {
        let Some((status, said)) = interrupt(at, line, Duration::from_millis(300)) else { continue };
        tried += 1;
        // Ended by the signal, or as a shell reports it. A command that did not hear it would end with 0.
        assert!(status.signal() == Some(2) || status.code() == Some(130), "{line}: {status}\n{said}");
        let left: Vec<_> = std::fs::read_dir(at.join("out")).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(left.is_empty(), "{line}: {left:?}");
    }
    assert!(tried >= 2, "only {tried} of the lines take long enough");
}
