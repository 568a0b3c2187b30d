//! Video frames for an SLM, which `render` and `eval score` read in the same way as a hologram.

use crate::common::{document, done, folder, refused};
use std::path::Path;

const SIZE: [usize; 2] = [40, 48];
const BENCH: &str = "resolution = [40, 48]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { red = 660, green = 520, blue = 440 }\n\
                     [encoding]\ntwo_pi_level = 218\n";

fn seen(folder: &Path, args: &[&str]) -> Vec<f32> {
    done(folder, &[&["render"][..], args, &["--pupil=0,0,4,0", "--engine", "cpu", "-o", "seen.npy"]].concat());
    ::eyebox::low_level::files::read_npy(&folder.join("seen.npy")).unwrap().values
}

/// Returns the mean difference of two pictures, divided by the mean of the first.
fn differ(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.iter().sum::<f32>()
}

#[test]
fn what_was_encoded_is_seen_as_the_hologram_is_or_as_the_slm_shows_it() {
    let temp = folder();
    let at = temp.path();
    let small = ["--size", "40x48", "--steps", "3", "--frames", "2", "--color", "green", "--engine", "cpu"];
    done(at, &[&["solve", "builtin:still-life", "-o", "h.zarr"][..], &small].concat());
    let bench = format!("{BENCH}flip = \"horizontal\"\n[[encoding.grating]]\nperiod_px = 5\ndirection_deg = 30\n");
    std::fs::write(at.join("bench.toml"), bench).unwrap();
    done(at, &["encode", "h.zarr", "--display", "bench.toml", "-o", "frames"]);
    let hologram = seen(at, &["h.zarr"]);
    // The folder names its display. The only loss is the rounding to 218 levels.
    let frames = seen(at, &["frames"]);
    assert!(differ(&hologram, &frames) < 0.05, "{}", differ(&hologram, &frames));
    assert_eq!(frames, seen(at, &["--encoded", "frames", "--display", "bench.toml"]));
    // Without the display's own flip, the image is the mirror image.
    let mirrored =
        |image: &[f32]| -> Vec<f32> { image.chunks(SIZE[1]).flat_map(|row| row.iter().rev().copied()).collect() };
    let turned = mirrored(&seen(at, &["frames", "--as-shown=turns"]));
    assert!(
        differ(&frames, &turned) < 0.2 && differ(&frames, &mirrored(&turned)) > 0.3,
        "{}",
        differ(&frames, &turned)
    );
    assert!(differ(&frames, &seen(at, &["frames", "--as-shown=gratings"])) > 0.3, "a grating moves the image away");
    assert!(differ(&frames, &seen(at, &["frames", "--as-shown"])) > 0.3);
    // Frames of any origin need a display, and give the same view.
    std::fs::create_dir(at.join("mine")).unwrap();
    for i in 0..2 {
        std::fs::copy(at.join(format!("frames/frame-{i:05}.png")), at.join(format!("mine/slm {i}.png"))).unwrap();
    }
    assert_eq!(frames, seen(at, &["mine", "--encoded", "--display", "bench.toml", "--color", "green"]));
    let score = |what: &str| -> f64 {
        let args =
            ["eval", "score", what, "builtin:still-life", "--test-pupils", "random:2", "--engine", "cpu", "--json"];
        let found: serde_json::Value = serde_json::from_str(&done(at, &args)).expect("JSON");
        found["psnr_db"]["mean"].as_f64().expect("a PSNR")
    };
    let (whole, encoded) = (score("h.zarr"), score("frames"));
    assert!((whole - encoded).abs() < 0.5, "{whole} dB, encoded {encoded} dB");
    // A picture of the frames is as bright as one of the hologram, because the frames have its exposure.
    done(at, &["render", "frames", "--pupil=0,0,4,0", "--engine", "cpu", "-o", "seen.png"]);
    done(at, &["render", "h.zarr", "--pupil=0,0,4,0", "--engine", "cpu", "-o", "hologram.png"]);
    let mean = |name: &str| {
        let picture = image::open(at.join(name)).unwrap().into_luma8();
        picture.iter().map(|p| f64::from(*p)).sum::<f64>() / picture.len() as f64
    };
    assert!((mean("seen.png") - mean("hologram.png")).abs() < 2.0);
}

#[test]
fn frames_that_do_not_fit_are_one_line() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("bench.toml"), BENCH).unwrap();
    ::eyebox::low_level::files::write_npy(&at.join("p.npy"), &[1, 40, 48], &[1.0; 1920]).unwrap();
    done(at, &["encode", "p.npy", "--display", "bench.toml", "--color", "green", "-o", "frames"]);
    std::fs::create_dir(at.join("mine")).unwrap();
    std::fs::copy(at.join("frames/frame-00000.png"), at.join("mine/0.png")).unwrap();
    let render = |more: &[&'static str]| [&["render"][..], more, &["--pupil=0,0,4,0", "-o", "x.png"]].concat();
    for (args, what) in [
        (&["mine", "--encoded"][..], "encode/frame/no-display --display"),
        (&["mine", "--encoded", "--display", "paper", "--color", "green"], "file/content/frame-size --size 40x48"),
        (&["mine", "--encoded", "--display", "fields", "--size", "40x48", "--color", "green"], "encode/frame/lit-bit"),
        (&["mine", "--encoded", "--display", "paper", "--size", "40x48"], "encode/frame/video-frames"),
        (&["p.npy", "--encoded", "--display", "bench.toml"], "encode/frame/no-png"),
        (&["p.npy", "--as-shown", "--display", "bench.toml"], "arguments/as-shown-of-phases --encoded"),
        (&["frames", "--as-shown=flips"], "usage/value-validation"),
        (&["frames", "--pitch", "8"], "arguments/options-of-phases --display --size --color"),
        (&["frames", "--color", "red"], "encode/frame/other-color"),
    ] {
        refused(at, &render(args), "x.png", what);
    }
    std::fs::remove_file(at.join("frames/frame-00000.png")).unwrap();
    refused(at, &render(&["frames"]), "x.png", "file/read frame-00000.png");
    std::fs::write(at.join("frames/frames.json"), "{\"format\": 1}").unwrap();
    refused(at, &render(&["frames"]), "x.png", "file/content/damaged frames.json");
    // Damaged files are replaced.
    done(at, &["encode", "p.npy", "--display", "bench.toml", "--color", "green", "-o", "frames"]);
    assert!(
        at.join("frames/frame-00000.png").exists() && document(&at.join("frames/frames.json"))["frames"].is_array()
    );
}
