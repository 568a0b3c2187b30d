//! Ctrl-C: what has nothing to save ends within half a second and leaves no file; what saves its best says that it will.

use crate::common::{command, done, folder, text};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The longest that a signal goes unheard.
const HEARD: Duration = Duration::from_millis(500);

fn press(child: &Child) -> Instant {
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    Instant::now()
}

fn start(at: &Path, line: &str) -> Child {
    let args: Vec<&str> = line.split_whitespace().collect();
    command(at, &args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Presses ctrl-C after a while: how long the command takes to end then, and what it said. None if it had ended before.
fn interrupt(at: &Path, line: &str, after: Duration) -> Option<(Duration, String)> {
    let mut child = start(at, line);
    std::thread::sleep(after);
    if child.try_wait().unwrap().is_some() {
        return None;
    }
    let pressed = press(&child);
    let answer = child.wait_with_output().unwrap();
    Some((pressed.elapsed(), text(&answer.stderr)))
}

#[test]
fn what_has_nothing_to_save_ends_within_half_a_second() {
    let temp = folder();
    let at = temp.path();
    done(at, &"solve builtin:still-life --display small --size 64x64 --color green --steps 2 --frames 2 -o h.zarr --engine cpu".split(' ').collect::<Vec<_>>());
    std::fs::create_dir(at.join("out")).unwrap();
    // Each takes many seconds.
    let lines = [
        "solve builtin:still-life --display paper --views 33 -o out/x.zarr --engine cpu",
        "solve builtin:still-life builtin:plane --display paper --views 33 -o out/x.zarr --engine cpu",
        "solve builtin:shapes --display paper --views 33 -o out/x.zarr --engine cpu",
        "photograph builtin:still-life --display paper --views 33 --pupil=0,0,4,0 -o out/x.png --engine cpu",
        "inspect builtin:still-life --display paper --views 33",
        "plan builtin:still-life --display paper --views 33",
        "score h.zarr --pupils 40000 --engine cpu",
        "score h.zarr builtin:still-life --pupils 40000 --json --engine cpu",
        "refine h.zarr builtin:still-life --views 64 --pupil=0,0,4,0 --steps 1 --view-pitch 0.1 -o out/x.zarr --engine cpu",
        "tradeoff builtin:still-life --display paper --views 33 -o out/x --engine cpu",
        "evaluate builtin:still-life --display paper --views 33 -o out/x --engine cpu",
        "show builtin:still-life --display paper --views 33 --output offscreen --engine cpu",
        "study builtin:still-life --display paper --views 33 -o out/x --engine cpu",
    ];
    let mut tried = 0;
    for line in lines {
        let Some((took, said)) = interrupt(at, line, Duration::from_millis(400)) else { continue };
        tried += 1;
        assert!(took < HEARD, "{line}: {took:?}\n{said}");
        let left: Vec<_> = std::fs::read_dir(at.join("out")).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(left.is_empty(), "{line}: {left:?}");
    }
    assert!(tried >= 6, "only {tried} of the lines take long enough");
}

#[test]
fn a_solve_whose_step_takes_long_says_that_it_heard_and_ends_at_once_by_the_second() {
    let temp = folder();
    let mut child = start(
        temp.path(),
        "solve builtin:plane --display paper --color green --frames 24 --pupils 64 --steps 90 -o x.zarr --engine cpu -v",
    );
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    // What the plan says comes before the first step.
    while lines.next().is_some_and(|line| !line.contains("engine")) {}
    std::thread::sleep(Duration::from_millis(500));
    let pressed = press(&child);
    let heard = lines.find(|line| line.contains("ctrl-C again"));
    assert!(heard.is_some() && pressed.elapsed() < HEARD, "{heard:?} after {:?}", pressed.elapsed());
    let again = press(&child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(again.elapsed() < HEARD && !temp.path().join("x.zarr").exists());
}
