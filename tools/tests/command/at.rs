//! The option `--at`, which selects one hologram of a sequence, in every command that has it.

use crate::common::{done, folder};
use serde_json::Value;
use std::path::Path;

const SMALL: &str = "--size 48x64 --color green --frames 1 --steps 1 --views 3 --engine cpu";

fn run(at: &Path, line: &str) -> String {
    done(at, &line.split_whitespace().collect::<Vec<_>>())
}

/// Solves a sequence of two scenes and exports the phases of each.
fn sequence(at: &Path) {
    run(at, &format!("solve builtin:plane builtin:still-life {SMALL} -o s.zarr"));
    for i in 0..2 {
        run(at, &format!("convert s.zarr {i}.npy --at {i}"));
    }
}

#[test]
fn every_command_takes_the_hologram_that_is_named() {
    let temp = folder();
    let at = temp.path();
    sequence(at);
    let read = |name: &str| std::fs::read(at.join(name)).expect("a file");
    assert_ne!(read("0.npy"), read("1.npy"));
    for (i, scene) in ["builtin:plane", "builtin:still-life"].into_iter().enumerate() {
        // The bare phases of a hologram give the same video frames and views as the sequence.
        let how = "--display paper --size 48x64 --color green --engine cpu";
        run(at, &format!("encode {i}.npy {how} -o bare{i}"));
        run(at, &format!("encode s.zarr --at {i} --engine cpu -o frames{i}"));
        let frame =
            |folder: &str| image::open(at.join(folder).join("frame-00000.png")).expect("a video frame").to_luma8();
        assert_eq!(frame(&format!("frames{i}")), frame(&format!("bare{i}")), "{i}");
        run(
            at,
            &format!(
                "render {i}.npy --display paper --size 48x64 --color green --pupil=1,2,4,0 --engine cpu -o bare{i}.npy"
            ),
        );
        run(at, &format!("render s.zarr --at {i} --pupil=1,2,4,0 --engine cpu -o view{i}.npy"));
        let light = |name: &str| eyebox::low_level::files::read_npy(&at.join(name)).expect("a view").values;
        let [bare, own] = [light(&format!("bare{i}.npy")), light(&format!("view{i}.npy"))];
        // Bare phases have no exposure, so that the views differ by a factor.
        let sums = [&bare, &own].map(|v| v.iter().sum::<f32>());
        let off = bare.iter().zip(&own).map(|(a, b)| (a / sums[0] - b / sums[1]).abs()).fold(0.0, f32::max);
        assert!(off < 1e-6, "{i}: {off}");
        // Each hologram is refined and scored for its own scene.
        run(at, &format!("refine s.zarr --at {i} --pupil=0,0,4,0 --steps 1 --engine cpu -o refined{i}.zarr"));
        let group: Value = serde_json::from_slice(&read(&format!("refined{i}.zarr/zarr.json"))).expect("JSON");
        assert_eq!(group["attributes"]["eyebox"]["scene"], scene);
        let how = "--duration 0.1 --set gaze.set_rate=20 --set gaze.step_time=10 --set gaze.encode_time=1 --jod none --engine cpu";
        run(at, &format!("eval gaze s.zarr --at {i} {how} -o study{i}"));
        let study: Value = serde_json::from_slice(&read(&format!("study{i}/study.json"))).expect("JSON");
        assert_eq!(study["scene"], scene);
    }
    let psnr = |words: &str| {
        let said = run(at, &format!("eval score {words} --test-pupils random:4 --jod none --engine cpu --json"));
        serde_json::from_str::<Value>(&said).expect("JSON")["psnr_db"]["mean"].as_f64().expect("a number")
    };
    let own = [0, 1].map(|i| psnr(&format!("s.zarr --at {i}")));
    let named = [("0", "builtin:plane"), ("1", "builtin:still-life")]
        .map(|(i, scene)| psnr(&format!("s.zarr {scene} --at {i}")));
    assert!(own == named && own[0] != own[1], "{own:?} {named:?}");
}
