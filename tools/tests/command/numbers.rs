//! Numbers without a stated meaning in files of other people. They are read right, or refused with a remedy that works.

use crate::common::{self, Printed, done, folder};
use eyebox::low_level::files::read_npy;
use image::{ImageBuffer, Luma, Rgb};
use serde_json::Value;
use std::path::Path;

const SIZE: [u32; 2] = [40, 48];
const SMALL: [&str; 10] = ["--size", "40x48", "--views", "3", "--steps", "2", "--frames", "1", "--color", "green"];

fn photo(at: &Path) {
    let pixel =
        |x: u32, y: u32| Rgb([(x * 5) as u8, ((x * x / 3 + y * 9) % 256) as u8, ((x * 7 + y * 11) % 200) as u8]);
    ImageBuffer::from_fn(SIZE[1], SIZE[0], pixel).save(at.join("photo.png")).unwrap();
}

/// Runs a command that must be refused, and returns its message.
fn refusal(at: &Path, args: &[&str]) -> String {
    common::refusal(at, args).message
}

fn solve<'a>(source: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["solve", source, "--engine", "cpu", "--json", "-o", "h.zarr"][..], &SMALL, more].concat()
}

fn json(at: &Path, args: &[&str]) -> Value {
    serde_json::from_str(&done(at, args)).expect("one JSON object")
}

/// A depth camera writes 16-bit distances. They are refused, and after the remedy the hologram is the same as from
/// 8-bit depths.
#[test]
fn a_depth_camera_s_map_is_refused_until_near_is_stated() {
    let temp = folder();
    let at = temp.path();
    photo(at);
    let distance = |x: u32| 3500 + x * 700;
    ImageBuffer::from_fn(SIZE[1], SIZE[0], |x, _| Luma([distance(x) as u16])).save(at.join("tum.png")).unwrap();
    let closeness = |x: u32| (255.0 * f64::from(SIZE[1] - 1 - x) / f64::from(SIZE[1] - 1)).round() as u8;
    ImageBuffer::from_fn(SIZE[1], SIZE[0], |x, _| Luma([closeness(x)])).save(at.join("near.png")).unwrap();
    let said = refusal(at, &solve("photo.png", &["--depth-map", "tum.png"]));
    assert!(said.contains("--near") && !at.join("h.zarr").exists(), "{said}");
    done(at, &solve("photo.png", &["--depth-map", "tum.png", "--near", "small"]));
    // A side view separates near and far content.
    let seen = |map: &str, near: &str| {
        let words = ["render", "photo.png", "--size", "40x48", "--views", "5", "--color", "green", "--depth=-1..1"];
        done(at, &[&words[..], &["--depth-map", map, "--near", near, "--pupil=6,0,2,0", "-o", "seen.npy"]].concat());
        read_npy(&at.join("seen.npy")).unwrap().values
    };
    let own = seen("tum.png", "small");
    let apart = |other: Vec<f32>| own.iter().zip(other).map(|(a, b)| (a - b).abs()).sum::<f32>();
    let (same, inside_out) = (apart(seen("near.png", "bright")), apart(seen("tum.png", "large")));
    assert!(same < 0.1 * inside_out, "{same} from the same depths in 8 bits, {inside_out} from those inside out");
    let found =
        json(at, &["info", "photo.png", "--size", "40x48", "--depth-map", "tum.png", "--near", "small", "--json"]);
    // The text states the meaning of the map's values.
    let other =
        json(at, &["info", "photo.png", "--size", "40x48", "--depth-map", "tum.png", "--near", "large", "--json"]);
    assert!(found["depth_map"].is_string() && found["depth_map"] != other["depth_map"], "{found}");
}

/// A black scene has no PSNR. The report has null, and the text has a word.
#[test]
fn a_black_scene_has_no_psnr() {
    let temp = folder();
    let at = temp.path();
    std::fs::create_dir(at.join("black")).unwrap();
    for (name, level) in [("red", [200u8, 0, 0]), ("black", [0; 3])] {
        std::fs::create_dir_all(at.join(name)).unwrap();
        for view in 0..3 {
            let pixel = |x: u32, y: u32| Rgb(if (x / 4 + y / 4).is_multiple_of(2) { level } else { [0; 3] });
            ImageBuffer::from_fn(SIZE[1], SIZE[0], pixel).save(at.join(format!("{name}/v_0_{view}.png"))).unwrap();
        }
    }
    let more = ["--depth=-0.1..0.1", "--order", "as-named"];
    for scene in ["black", "red"] {
        let solved = json(at, &solve(scene, &more));
        assert!(solved["colors"][0]["psnr_mean_db"].is_null(), "{solved}");
        assert!(solved["colors"][0]["psnr_worst_db"].is_null(), "{solved}");
    }
    let words = ["solve", "black", "--engine", "cpu", "-o", "h.zarr"];
    let said = done(at, &[&words[..], &SMALL, &more].concat());
    let no_number = |said: &str| ["dB", "inf", "NaN", "nan"].iter().all(|word| !said.has(word));
    assert!(said.has("h.zarr green") && no_number(&said), "{said}");
    let score = ["eval", "score", "h.zarr", "black", "--test-pupils", "random:3"];
    let scores = json(at, &[&score[..], &["--json"]].concat());
    assert!(scores["psnr_db"].is_null() && scores["pupils"][0]["psnr_db"].is_null(), "{scores}");
    let said = done(at, &score);
    // The header of the table has the unit.
    assert!(said.lines().skip(1).any(no_number) && !said.has("inf") && !said.has("NaN"), "{said}");
}

/// View pitches and depths in meters or micrometers are refused, because the options expect millimeters.
#[test]
fn lengths_in_another_unit_are_refused_with_what_was_probably_meant() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve("builtin:plane", &[]));
    let cases: [(Vec<&str>, &str); 6] = [
        (solve("builtin:plane", &["--view-pitch", "0.0022"]), "2.2 mm"),
        (solve("builtin:plane", &["--view-pitch", "2200"]), "2.2 mm"),
        (solve("builtin:plane", &["--depth=-3000..3000"]), "-3 mm"),
        (vec!["render", "h.zarr", "--pupil=0,0,4,1000", "-o", "seen.png"], "1 mm"),
        (vec!["render", "builtin:plane", "--size", "40x48", "--pupil=0,0,4,1000", "-o", "seen.png"], "1 mm"),
        (
            vec![
                "render",
                "builtin:plane",
                "--size",
                "40x48",
                "--pupil=0,0,4,0",
                "--view-pitch",
                "0.002",
                "-o",
                "seen.png",
            ],
            "2 mm",
        ),
    ];
    for (args, meant) in cases {
        let said = refusal(at, &args);
        assert!(said.contains(meant), "{said}");
        assert!(!at.join("seen.png").exists());
    }
    // The intended value is accepted, and so is a confirmed value.
    done(at, &solve("builtin:plane", &["--view-pitch", "2.2"]));
    done(at, &["render", "h.zarr", "--pupil=0,0,4,1", "-o", "seen.png"]);
    done(at, &["render", "h.zarr", "--pupil=0,0,4,1000", "--force", "-o", "seen.png"]);
}
