//! `eyebox display calibrate` with camera commands that fail and with wrong arguments.

use crate::common::{self, Printed, Refusal, text};
use std::fs;
use std::path::Path;

const DISPLAY: &str =
    "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
const HELLO: &str = r#"{"id": 0, "protocol": 1, "colors": {"green": 520.0}, "slm": {"resolution": [64, 64]}, "iris": {"x_mm": [-12, 12], "y_mm": [-12, 12], "diameter_mm": [1, 20]}, "camera": {"resolution": [80, 80], "bits": 12}}"#;

/// Makes a folder with the display's file and the script of a camera. The script answers hello and then runs `then` for
/// each further line.
fn bench(hello: &str, then: &str) -> tempfile::TempDir {
    let here = common::folder();
    fs::write(here.path().join("bench.toml"), DISPLAY).expect("a display");
    fs::write(here.path().join("hello"), format!("{hello}\n")).expect("an answer");
    let script = format!(
        "echo Camera SDK 3.1\nread line; sed \"s/\\\"id\\\": 0/\\\"id\\\": $(echo \"$line\" | sed 's/[^0-9]*\\([0-9]*\\).*/\\1/')/\" hello\n\
         while read line; do id=$(echo \"$line\" | sed 's/[^0-9]*\\([0-9]*\\).*/\\1/'); {then}\ndone\n"
    );
    fs::write(here.path().join("camera.sh"), script).expect("a script");
    here
}

/// Runs a calibration that must fail. Returns its exit code, its error and standard error.
fn failed(at: &Path, more: &[&str]) -> (Option<i32>, Refusal, String) {
    let args = ["display", "calibrate", "bench.toml", "--camera", "sh camera.sh", "--keep", "kept", "-o", "out.toml"];
    let mut command = common::command(at, &[&args[..], more].concat());
    let answer = command.env("EYEBOX_JSON_ERRORS", "1").output().expect("it starts");
    assert!(!at.join("out.toml").exists(), "something was written");
    (answer.status.code(), Refusal::of(&answer), text(&answer.stderr))
}

#[test]
fn a_command_that_is_lost_three_times_ends_the_calibration_with_what_it_did() {
    for (then, what) in [
        ("echo the laser is on fire >&2; exit 4", "calibrate/lost 3 4 fire"),
        ("echo nothing; exec 1>&-; sleep 0.1; exit", "calibrate/lost 3"),
        ("echo '{no JSON'", "calibrate/lost/not-json 3"),
        ("echo '{\"id\": 99}'", "calibrate/lost/other-question 3"),
        (
            "echo \"{\\\"id\\\": $id, \\\"file\\\": \\\"none.png\\\", \\\"full_scale\\\": 4095}\"",
            "calibrate/lost/no-picture 3 none.png",
        ),
        ("echo \"{\\\"id\\\": $id, \\\"file\\\": 7}\"", "calibrate/lost/capture 3"),
    ] {
        let here = bench(HELLO, then);
        let (code, refusal, said) = failed(here.path(), &[]);
        assert_eq!(code, Some(3), "{then}: {said}");
        refusal.is(what);
        assert!(said.contains("Camera SDK 3.1"), "{said}");
    }
}

#[test]
fn one_that_hangs_is_ended_and_one_that_asks_for_time_gets_it() {
    let here = bench(HELLO, "sleep 100");
    let (code, refusal, _) = failed(here.path(), &["--set", "camera.timeout=0.2"]);
    assert_eq!(code, Some(3));
    refusal.is("calibrate/lost/no-answer");
    let wait = "echo \"{\\\"id\\\": $id, \\\"wait_s\\\": 20}\"; sleep 0.5; echo \"{\\\"id\\\": $id, \\\"error\\\": \\\"the shutter is stuck\\\"}\"";
    let here = bench(HELLO, wait);
    let (code, refusal, _) = failed(here.path(), &["--set", "camera.timeout=0.3"]);
    assert_eq!((code, &refusal.fields["text"]), (Some(3), &"the shutter is stuck".into()));
    refusal.is("calibrate/refused");
}

#[test]
fn a_picture_of_another_size_is_refused_and_errors_are_asked_again() {
    let npy = "python() { :; }; printf '\\223NUMPY\\001\\000\\166\\000' > p.npy; printf '%-117s\\n' \"{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3), }\" >> p.npy; printf 'abcdef' >> p.npy; \
               echo \"{\\\"id\\\": $id, \\\"file\\\": \\\"$PWD/p.npy\\\", \\\"full_scale\\\": 255}\"";
    let here = bench(HELLO, npy);
    let (code, refusal, _) = failed(here.path(), &[]);
    assert_eq!(code, Some(3));
    refusal.is("calibrate/lost/picture-size 2x3 80x80");
    let here = bench(HELLO, "echo \"{\\\"id\\\": $id, \\\"error\\\": \\\"busy\\\", \\\"again\\\": true}\"");
    let (code, _, said) = failed(here.path(), &[]);
    // The command requests it twice more. The third answer is the error.
    assert!(
        code == Some(3) && said.lines().filter(|l| !l.starts_with('{')).filter(|l| l.has("busy")).count() == 2,
        "{said}"
    );
}

#[test]
fn a_bench_that_is_not_the_displays_is_refused_with_both() {
    for (from, to, what) in [
        ("[64, 64]", "[64, 65]", "calibrate/bench/bench-slm 64x65 64x64"),
        ("520.0", "532.0", "calibrate/bench/bench-wavelength 532 520.0"),
        ("green", "red", "calibrate/bench/bench-color green red"),
        (
            "\"resolution\": [64, 64]",
            "\"resolution\": [64, 64], \"pitch_um\": 6.4",
            "calibrate/bench/bench-pitch 6.4 8",
        ),
    ] {
        let here = bench(&HELLO.replacen(from, to, 1), "exit");
        let (code, refusal, _) = failed(here.path(), &[]);
        assert_eq!(code, Some(2));
        refusal.is(what);
    }
}

#[test]
fn what_cannot_be_asked_for_is_one_line() {
    let here = bench(HELLO, "exit");
    let at = here.path();
    let base = ["display", "calibrate", "bench.toml", "-o", "out.toml"];
    for (more, what) in [
        (&["--camera", "'unclosed"][..], "calibrate/words"),
        (&["--camera", "no-such-program-here"], "calibrate/start"),
        (&["--camera", "sh camera.sh", "--set", "camera.pictures=3"], "arguments/captures-max"),
        (&["--captures", "nowhere"], "file/read captures.json"),
        (&[], "usage/missing-required-argument --camera"),
        (&["--captures", "x", "--camera", "y"], "usage/argument-conflict"),
    ] {
        common::refused(at, &[&base[..], more].concat(), "out.toml", what);
    }
    fs::create_dir(at.join("kept")).expect("a folder");
    fs::write(at.join("kept/captures.json"), "{\"protocol\": 1}").expect("a document");
    common::refused(at, &[&base[..], &["--captures", "kept"]].concat(), "out.toml", "calibrate/captures captures.json");
}
