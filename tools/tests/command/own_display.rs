//! A hologram is sent to the display for which it was solved, with the same crop, and no option has to repeat this.

use crate::common::{done, folder, refused};
use eyebox::low_level::optics::PRESETS;
use serde_json::Value;
use std::fs;
use std::path::Path;

const BENCH: &str = "name = \"bench\"\nresolution = [64, 96]\npitch_um = 8.0\nfocal_length_mm = 400.0\n\
                     wavelengths_nm = { green = 520 }\n[encoding]\ntwo_pi_level = { green = 200 }\n";

fn solve(at: &Path, more: &[&str]) {
    let words = "solve builtin:plane --steps 1 --pupils 2 --color green --views 2 --engine cpu";
    done(at, &[&words.split_whitespace().collect::<Vec<_>>()[..], more].concat());
}

/// Returns the report of `encode`.
fn encoded(at: &Path, words: &[&str]) -> Value {
    let _ = fs::remove_dir_all(at.join("frames"));
    let all = [&["encode"][..], words, &["--engine", "cpu", "--json", "-o", "frames"]].concat();
    serde_json::from_str(&done(at, &all)).expect("JSON")
}

#[test]
fn the_display_that_it_was_solved_for_is_found() {
    let temp = folder();
    let at = temp.path();
    fs::write(at.join("bench.toml"), BENCH).unwrap();
    solve(at, &["--display", "plm", "--size", "36x44", "--frames", "24", "-o", "plm.zarr"]);
    solve(at, &["--display", "paper", "--size", "64x64", "-o", "paper.zarr"]);
    solve(at, &["--display", "planes8", "--size", "32x32", "-o", "planes.zarr"]);
    solve(at, &["--display", "bench.toml", "-o", "bench.zarr"]);
    solve(at, &["--display", "bench.toml", "--size", "32x48", "-o", "cut.zarr"]);
    for (hologram, more, display, size) in [
        ("plm.zarr", &[][..], "plm", None),
        ("paper.zarr", &[], "paper", Some([64, 64])),
        ("paper.zarr", &["--display", "paper"], "paper", Some([64, 64])),
        ("planes.zarr", &[], "planes8", Some([32, 32])),
        ("planes.zarr", &["--display", "planes8"], "planes8", Some([32, 32])),
        ("bench.zarr", &[], "bench", Some([64, 96])),
        ("cut.zarr", &[], "bench", Some([32, 48])),
        ("cut.zarr", &["--display", "bench.toml"], "bench", Some([32, 48])),
        ("paper.zarr", &["--display", "small", "--size", "64x64"], "small", Some([64, 64])),
    ] {
        let said = encoded(at, &[&[hologram][..], more].concat());
        assert_eq!(said["display"], display, "{hologram} {more:?}");
        if let Some([height, width]) = size {
            assert_eq!(
                [&said["height"], &said["width"]],
                [&Value::from(height), &Value::from(width)],
                "{hologram} {more:?}"
            );
        }
    }
    // The size of another display is not derived.
    refused(
        at,
        &["encode", "paper.zarr", "--display", "small", "--engine", "cpu", "-o", "x"],
        "x",
        "arguments/size --size 64x64",
    );
    let show = ["--record", "shown", "--clock", "simulated", "--duration", "0.05"];
    for words in [&["show", "paper.zarr", "--display", "paper"][..], &["show", "plm.zarr"], &["show", "cut.zarr"]] {
        let _ = fs::remove_dir_all(at.join("shown"));
        done(at, &[words, &show].concat());
    }
}

/// After a solve for any preset, no command needs a display, a size or a scene.
#[test]
fn every_preset_is_encoded_scored_and_shown_without_options() {
    for preset in PRESETS {
        let temp = folder();
        let at = temp.path();
        let frames = if preset.starts_with("pl") || preset.contains("plm") { "24" } else { "1" };
        solve(at, &["--display", preset, "--size", "32x48", "--frames", frames, "-o", "h.zarr"]);
        assert_eq!(encoded(at, &["h.zarr"])["display"], preset);
        let score = ["eval", "score", "h.zarr", "--test-pupils", "random:1", "--jod", "none", "--json"];
        assert!(done(at, &score).contains("psnr_db"), "{preset}");
        done(at, &["show", "h.zarr", "--clock", "simulated", "--duration", "0.05"]);
        done(at, &["render", "h.zarr", "--pupil=0,0,1,0", "--force", "--what", "both", "-o", "both.png"]);
    }
}

#[test]
fn a_display_file_is_found_where_it_is_and_refused_if_it_is_another() {
    let temp = folder();
    let [a, b] = ["a", "b"].map(|name| temp.path().join(name));
    fs::create_dir_all(&a).unwrap();
    fs::write(a.join("bench.toml"), BENCH).unwrap();
    solve(&a, &["--display", "bench.toml", "-o", "h.zarr"]);
    // The file is found from elsewhere, and it is found when it has moved with the hologram.
    assert_eq!(encoded(temp.path(), &["a/h.zarr"])["display"], "bench");
    fs::rename(&a, &b).unwrap();
    assert_eq!(encoded(&b, &["h.zarr"])["display"], "bench");
    // The current calibration in the file is used.
    let frame = |at: &Path| {
        encoded(at, &["h.zarr"]);
        let mut files: Vec<_> = fs::read_dir(at.join("frames")).unwrap().map(|e| e.unwrap().path()).collect();
        files.sort();
        fs::read(files.iter().find(|f| f.extension().is_some_and(|e| e == "png")).unwrap()).unwrap()
    };
    let before = frame(&b);
    fs::write(b.join("bench.toml"), BENCH.replace("200", "150")).unwrap();
    assert_ne!(frame(&b), before);
    // Another SLM under the same name is refused.
    fs::write(b.join("bench.toml"), BENCH.replace("pitch_um = 8.0", "pitch_um = 6.4")).unwrap();
    refused(&b, &["encode", "h.zarr", "--engine", "cpu", "-o", "x"], "x", "hologram/display-not-found");
    fs::remove_file(b.join("bench.toml")).unwrap();
    refused(&b, &["encode", "h.zarr", "--engine", "cpu", "-o", "x"], "x", "hologram/display-not-found");
    fs::write(b.join("kept.toml"), BENCH).unwrap();
    assert_eq!(encoded(&b, &["h.zarr", "--display", "kept.toml"])["display"], "bench");
}
