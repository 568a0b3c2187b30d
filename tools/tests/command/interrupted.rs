//! Ctrl-C ends a command that has nothing to save, and no file stays. A solve keeps its hologram, and a second ctrl-C
//! ends it at once.

use crate::common::{self, Printed, command, done, folder, text};
use std::io::{BufRead, BufReader};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};

/// Waits until the command handles signals, which a thread of that name does.
fn wait_until_it_hears(child: &mut Child) {
    let tasks = format!("/proc/{}/task", child.id());
    let hears = || {
        let names = std::fs::read_dir(&tasks).into_iter().flatten().flatten();
        names.filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok()).any(|name| name == "signals\n")
    };
    while !hears() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it handled signals");
        std::thread::yield_now();
    }
}

/// Sends ctrl-C when the command handles it. Returns the exit status and the printed text.
fn interrupt(at: &Path, line: &str) -> (ExitStatus, String) {
    let args: Vec<&str> = line.split_whitespace().collect();
    let mut child = command(at, &args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    // The command must not compute faster than this test sends the signal, whatever else runs.
    rustix::process::setpriority_process(Some(rustix::process::Pid::from_child(&child)), 19).unwrap();
    wait_until_it_hears(&mut child);
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let answer = child.wait_with_output().unwrap();
    (answer.status, text(&answer.stderr))
}

#[test]
fn a_command_that_has_nothing_to_save_ends_and_leaves_nothing() {
    let temp = folder();
    let at = temp.path();
    let solve = "solve builtin:still-life --display small --size 64x64 --color green --steps 2 --frames 2 -o h.zarr --engine cpu";
    done(at, &solve.split(' ').collect::<Vec<_>>());
    std::fs::create_dir(at.join("out")).unwrap();
    // Each command takes seconds before it has anything to save. The signal comes as soon as the command handles it.
    let lines = [
        "solve builtin:still-life --size 384x384 --views 17 -o out/x.zarr --engine cpu",
        "render builtin:still-life --size 384x384 --views 17 --pupil=0,0,4,0 -o out/x.png --engine cpu",
        "info builtin:still-life --size 384x384 --views 17 -o out/x.png",
        "solve builtin:still-life --size 384x384 --views 17 --dry-run",
        "eval score h.zarr --test-pupils random:40000 --engine cpu",
        "eval score h.zarr builtin:still-life --test-pupils random:40000 --json --engine cpu",
        "eval gaze builtin:still-life --size 384x384 --views 17 -o out/x --engine cpu",
    ];
    for line in lines {
        let (status, said) = interrupt(at, line);
        // The signal ends the command, or the code is the one that a shell reports. A command that ignores the signal
        // ends with 0.
        assert!(status.signal() == Some(2) || status.code() == Some(130), "{line}: {status}\n{said}");
        let left: Vec<_> = std::fs::read_dir(at.join("out")).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(left.is_empty(), "{line}: {left:?}");
    }
}

#[test]
fn an_interrupted_solve_leaves_a_whole_hologram() {
    let temp = folder();
    let at = temp.path();
    // The solve has all colors. The colors that are left at ctrl-C must not take long.
    let args =
        ["solve", "builtin:still-life", "-o", "h.zarr", "--size", "40x48", "--steps", "1000000", "--engine", "cpu"];
    let mut child = command(at, &args).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.by_ref().any(|line| line.unwrap().has("CPU")), "it ended");
    std::thread::sleep(std::time::Duration::from_secs(2));
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    assert!(child.wait().unwrap().success(), "{:?}", lines.map(Result::unwrap).collect::<Vec<_>>());
    done(at, &["render", "h.zarr", "--pupil=0,0,5,0", "-o", "v.png"]);
}

/// A step of this solve takes far longer than the wait for the second ctrl-C. The solve ends inside a step and writes
/// nothing.
#[test]
fn a_second_interruption_ends_a_solve_at_once() {
    let temp = folder();
    let at = temp.path();
    let large = ["--size", "512x512", "--views", "3", "--pupils", "64", "--steps", "1000000", "--color", "green"];
    let mut solve = command(at, &[&["solve", "builtin:plane", "-o", "h.zarr", "--engine", "cpu"][..], &large].concat());
    let mut child = solve.stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.by_ref().any(|line| line.unwrap().has("CPU")), "it ended");
    std::thread::sleep(std::time::Duration::from_secs(1));
    common::interrupt_twice(child.id());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(lines.map(Result::unwrap).collect::<Vec<_>>(), Vec::<String>::new());
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 0);
}
