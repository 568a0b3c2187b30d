//! Tests holograms through their files, whole and damaged.

use super::*;
use crate::files::{FileError, write_npy};
use crate::optics::wrap_phase;
use eyebox_base::error::ErrorData;
use serde_json::json;
use std::{
    fs,
    path::{Path, PathBuf},
};

fn small() -> Hologram {
    let phases = |from: f32| (0..2 * 3 * 5).map(|i| wrap_phase(from + 0.37 * i as f32)).collect();
    let color = |color, wavelength, from| ColorHologram {
        color: Some(color),
        wavelength,
        exposure: 0.35 + f64::from(from) / 7.0,
        efficiency: 0.4,
        phases: phases(from),
    };
    Hologram {
        frames: 2,
        height: 3,
        width: 5,
        pitch: 10.8e-6,
        focal_length: 0.4,
        geometry: crate::optics::Geometry::Relay,
        colors: vec![color(Color::Red, 660e-9, 0.1), color(Color::Blue, 440e-9, 2.0)],
        seed: u64::MAX,
        version: "0.1.0".into(),
        display: "plm".into(),
        display_wavelengths: crate::optics::Display::preset("plm").unwrap().wavelengths,
        scene: "builtin:still-life \"quoted\" \u{fc}".into(),
        metadata: serde_json::from_value(
            json!({"padding": [2, 4], "depth_mm": [-3.0, 3.5], "document_crc32c": "deadbeef"}),
        )
        .unwrap(),
    }
}

fn saved() -> (tempfile::TempDir, PathBuf) {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("x.zarr");
    small().save(&path).unwrap();
    (here, path)
}

fn files_under(folder: &Path) -> Vec<PathBuf> {
    let (mut files, mut folders) = (vec![], vec![folder.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files
}

#[test]
fn a_hologram_comes_back_as_it_was() {
    let (_here, path) = saved();
    assert_eq!(Hologram::load(&path).unwrap(), small());
    assert_eq!(files_under(&path).len(), 2 + 4);
    let mut next = small();
    next.seed = 5;
    next.colors[0].phases[7] += 20.0;
    next.save(&path).unwrap();
    let loaded = Hologram::load(&path).unwrap();
    assert_eq!(loaded.seed, 5);
    assert_eq!(loaded.colors[0].phases[7], wrap_phase(next.colors[0].phases[7]));
    assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "no draft is left");
}

/// Returns true if an error names a file. Windows accepts both separators, and prints them as they were joined.
fn names(error: &str, file: &Path) -> bool {
    error.replace('\\', "/").contains(&file.to_str().unwrap().replace('\\', "/"))
}

#[test]
fn every_flipped_byte_is_noticed_in_its_file() {
    let (_here, path) = saved();
    for file in files_under(&path) {
        let whole = fs::read(&file).unwrap();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << (at % 8);
            fs::write(&file, &bytes).unwrap();
            let error = Hologram::load(&path).expect_err("a flipped byte").to_string();
            assert!(names(&error, &file), "byte {at}: {error}");
        }
        fs::write(&file, whole).unwrap();
    }
    assert_eq!(Hologram::load(&path).unwrap(), small());
}

#[test]
fn every_cut_and_every_missing_file_is_noticed() {
    let (_here, path) = saved();
    for file in files_under(&path) {
        let whole = fs::read(&file).unwrap();
        for length in 0..whole.len() {
            fs::write(&file, &whole[..length]).unwrap();
            let error = Hologram::load(&path).expect_err("a cut").to_string();
            assert!(names(&error, &file), "cut to {length}: {error}");
        }
        fs::remove_file(&file).unwrap();
        let error = Hologram::load(&path).expect_err("a missing file");
        assert!(names(&error.to_string(), &file), "{error}");
        assert_eq!(ErrorData::of(&error).code, "damaged/missing", "{error}");
        fs::write(&file, whole).unwrap();
    }
}

#[test]
fn a_consistent_lie_about_the_size_takes_no_memory() {
    let (_here, path) = saved();
    for shape in [[2, 1 << 40, 3, 5], [2, 2, 65536, 65536], [2, 2, usize::MAX, 5], [3, 2, 3, 5], [0, 2, 3, 5]] {
        fs::write(path.join("phases/zarr.json"), document::array(shape, None)).unwrap();
        assert!(Hologram::load(&path).is_err(), "{shape:?}");
    }
}

#[test]
fn only_holograms_are_replaced_and_only_holograms_are_loaded() {
    let (here, path) = saved();
    fs::write(path.join("notes.txt"), "mine").unwrap();
    let error = small().save(&path).unwrap_err();
    assert!(matches!(error, HologramError::File(FileError::Taken { .. })), "{error}");
    assert_eq!(fs::read_to_string(path.join("notes.txt")).unwrap(), "mine");
    let other = here.path().join("other.zarr");
    fs::create_dir(&other).unwrap();
    assert!(matches!(Hologram::load(&other), Err(HologramError::NotAHologram { .. })));
    fs::write(other.join("zarr.json"), r#"{"zarr_format": 3, "node_type": "group", "attributes": {}}"#).unwrap();
    assert!(small().save(&other).is_err(), "another program's Zarr group");
    assert!(matches!(small().save(&here.path().join("x.tiff")), Err(HologramError::UnknownEnding { .. })));
    assert!(small().save(&here.path().join("none/x.zarr")).is_err());
    assert!(matches!(Hologram::load(&here.path().join("none")), Err(HologramError::File(FileError::Read { .. }))));
}

#[test]
fn a_hologram_that_cannot_be_is_not_written() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("x.zarr");
    let refuses = |change: &dyn Fn(&mut Hologram), code: &str, holds: &[&str]| {
        let mut hologram = small();
        change(&mut hologram);
        let HologramError::Inconsistent(reason) = hologram.save(&path).unwrap_err() else { panic!("{code}") };
        assert_eq!(reason.code(), code, "{reason}");
        assert!(holds.iter().all(|part| reason.text().contains(part)) && !path.exists(), "{reason}");
    };
    refuses(&|h| h.colors[1].phases[24] = f32::NAN, "phase", &["blue", "NaN", "1", "4"]);
    refuses(&|h| _ = h.colors[0].phases.pop(), "phases-count", &["red", "29"]);
    refuses(&|h| h.colors[0].wavelength = 0.0, "optics", &["red"]);
    refuses(&|h| h.display_wavelengths[1].wavelength = f64::INFINITY, "display", &["green"]);
    refuses(&|h| h.colors.clear(), "empty", &["0"]);
    refuses(&|h| h.frames = usize::MAX, "phases-count", &["30"]);
    refuses(&|h| h.colors[0].exposure = f64::INFINITY, "exposure", &["inf"]);
}

#[test]
fn phases_travel_as_npy_and_as_pictures() {
    let here = tempfile::tempdir().unwrap();
    let (npy, pngs) = (here.path().join("x.npy"), here.path().join("pngs"));
    small().save(&npy).unwrap();
    let phases = load_phases(&npy, None).unwrap();
    assert_eq!((phases.frames, phases.height, phases.width), (2, 3, 5));
    assert_eq!(phases.colors, small().colors.iter().map(|c| (None, c.phases.clone())).collect::<Vec<_>>());

    small().save_pngs(&pngs).unwrap();
    small().save_pngs(&pngs).unwrap();
    let seen = load_phases(&pngs, None).unwrap();
    assert_eq!(seen.colors.iter().map(|c| c.0).collect::<Vec<_>>(), [Some(Color::Red), Some(Color::Blue)]);
    for ((_, seen), c) in seen.colors.iter().zip(&small().colors) {
        for (a, b) in seen.iter().zip(&c.phases) {
            assert!(wrap_phase(a - b).abs() <= std::f32::consts::PI / 256.0 + 1e-6, "half a level: {a} {b}");
        }
    }
    fs::remove_file(pngs.join("blue-00.png")).unwrap();
    let missing = load_phases(&pngs, None).unwrap_err();
    assert_eq!(ErrorData::of(&missing).code, "not-a-hologram/missing-sub-frame");
    assert!(missing.to_string().contains("blue-00.png"), "{missing}");
    fs::write(pngs.join("mine.txt"), "").unwrap();
    assert!(small().save_pngs(&pngs).is_err());

    write_npy(&npy, &[2, 2], &[0.5, 7.0, -7.0, 10.0]).unwrap();
    let one = load_phases(&npy, None).unwrap();
    assert_eq!((one.frames, one.height, one.width), (1, 2, 2));
    assert_eq!(one.colors[0].1[1], wrap_phase(7.0));
    write_npy(&npy, &[4], &[0.0; 4]).unwrap();
    let shape = load_phases(&npy, None).unwrap_err();
    assert_eq!(ErrorData::of(&shape).code, "not-a-hologram/shape");
    assert!(shape.to_string().contains("[4]"), "{shape}");
    write_npy(&npy, &[0, 4, 4], &[]).unwrap();
    assert!(load_phases(&npy, None).is_err());
}

/// Loading a randomly changed file gives a hologram or an error, and never panics.
#[test]
fn random_documents_do_not_panic() {
    use proptest::{prelude::*, test_runner::TestRunner};
    let (_here, path) = saved();
    let mut runner = TestRunner::default();
    let texts = (prop::bool::ANY, ".{0,200}", prop::collection::vec((0usize..2000, any::<u8>()), 0..6));
    runner
        .run(&texts, |(group, text, changes)| {
            let mut bytes = if text.is_empty() { document::group(&small()) } else { text.into_bytes() };
            let length = bytes.len();
            changes.iter().for_each(|&(at, to)| bytes[at % length] = to);
            let read = if group {
                document::read_group(&bytes).map(drop)
            } else {
                document::read_array(&bytes, true).map(drop)
            };
            prop_assert!(read.is_err() || bytes == document::group(&small()));
            Ok(())
        })
        .unwrap();
    drop(path);
}

/// Numbers given as radians that cannot be radians are refused. When wrapped, they are accepted.
#[test]
fn numbers_that_are_no_radians_are_refused() {
    let none: [&[f32]; 8] = [
        &[0.0, 1e9],
        &[-1e9, 0.0],
        &[0.0, 2e5],
        &[0.0, 128.0, 255.0],
        &[0.0, 1023.0],
        &[-180.0, 180.0],
        &[0.0, 7.0],
        &[0.0, f32::INFINITY],
    ];
    for phases in none {
        assert!(matches!(check_radians(phases), Err(HologramError::NotRadians { .. })), "{phases:?}");
    }
    let unwrapped: Vec<f32> = (0..1000).map(|i| i as f32 * 0.731).collect();
    let wrapped: Vec<f32> =
        (0..1000).map(|i| (f64::from(i) * 1e6 + 0.25).rem_euclid(std::f64::consts::TAU) as f32).collect();
    for phases in [&unwrapped[..], &wrapped, &[0.0; 4], &[0.0, 3.0], &[0.0, 1.0, 2.0], &[9.0, 9.0], &[-3.1, 3.1]] {
        check_radians(phases).unwrap();
    }
}
