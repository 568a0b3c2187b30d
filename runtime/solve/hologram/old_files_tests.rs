//! Tests that files of earlier versions open, keep their content, and are written again in the same way.
//!
//! The files are `tests/old_holograms`, of version 0.1.0.

use super::*;
use crate::solve::Method;
use eyebox_base::error::ErrorData;
use std::{fs, path::PathBuf};

fn old(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/old_holograms").join(name)
}

/// Checks that the group's document is written now as it was then, with the same keys in the same order. Keys that are
/// no longer known come last. Digits are skipped, because numbers are read with an error in their last one.
fn written_alike(hologram: &Hologram, name: &str) {
    let outline = |bytes: &[u8]| {
        let mut document: serde_json::Value = serde_json::from_slice(bytes).expect("a document");
        let attributes = document["attributes"].as_object_mut().expect("attributes");
        attributes.remove("document_crc32c").expect("a seal");
        let settings = attributes["eyebox"]["settings"].as_object_mut().expect("settings");
        if let Some(unknown) = settings.shift_remove("recipe") {
            settings.insert("recipe".into(), unknown);
        }
        document.to_string().replace(|c: char| c.is_ascii_digit(), "")
    };
    let then = fs::read(old(name).join("zarr.json")).unwrap();
    assert_eq!(outline(&document::group(hologram)), outline(&then), "{name}");
}

#[test]
fn a_relay_hologram_opens_and_is_written_again_alike() {
    let hologram = Hologram::load(&old("relay")).unwrap();
    let known = &hologram.metadata;
    assert_eq!((hologram.frames, hologram.height, hologram.width), (2, 16, 24));
    assert_eq!((known.padding().rows, known.padding().columns, known.views), (4, 8, Some([3, 3])));
    let solve = known.solve.as_ref().unwrap();
    assert_eq!((solve.method, solve.steps, solve.pupils), (Method::Slfh, 3, 4));
    assert!((known.view_pitch_mm.unwrap() - 22.0 / 3.0).abs() < 1e-9 && known.other.contains_key("recipe"));
    assert_eq!((&known.passes, &known.refined, known.other.len()), (&None, &None, 1));
    written_alike(&hologram, "relay");
    let here = tempfile::tempdir().unwrap();
    let again = here.path().join("again.zarr");
    hologram.save(&again).unwrap();
    for file in ["phases/zarr.json", "phases/c/0/0/0/0", "phases/c/0/1/0/0"] {
        assert_eq!(fs::read(again.join(file)).unwrap(), fs::read(old("relay").join(file)).unwrap(), "{file}");
    }
}

#[test]
fn a_far_field_and_a_refined_hologram_open() {
    let far = Hologram::load(&old("far-field")).unwrap();
    assert_eq!((far.geometry, far.colors.len(), far.metadata.padding()), (Geometry::FarField, 2, Default::default()));
    written_alike(&far, "far-field");
    let refined = Hologram::load(&old("refined")).unwrap();
    let how = refined.metadata.refined.as_ref().unwrap();
    assert!((how.aim.centre[0] - 2e-3).abs() < 1e-12 && how.steps == 2 && how.steering.pupils > 0);
    written_alike(&refined, "refined");
}

#[test]
fn tiles_and_sequences_open() {
    let PhaseSource::Tiled(tiles) = PhaseSource::open(&old("tiled")).unwrap() else { panic!("not in tiles") };
    let about = tiles.about();
    assert_eq!((about.metadata.passes, about.metadata.views, about.frames), (Some(1), None, 2));
    written_alike(about, "tiled");
    assert!(tiles.read(1, [0, 0], [48, 48]).unwrap().iter().all(|p| p.is_finite()));
    let mut sequence = Sequence::open(&old("sequence")).unwrap();
    assert_eq!((sequence.count(), sequence.about().metadata.warm_start), (2, Some(Start::Warm(0.3))));
    assert_eq!(sequence.load(1).unwrap().height, 16);
    let error = PhaseSource::open(&old("sequence")).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "not-a-hologram/is-a-sequence");
    let second = Opening { at: Some(1), ..Opening::default() }.source(&old("sequence"));
    assert!(matches!(second, Ok(PhaseSource::Whole(_))));
}

/// A setting that eyebox no longer has does not keep a file from opening.
#[test]
fn a_hologram_of_the_contrast_loss_opens() {
    let mut written: serde_json::Value =
        serde_json::from_slice(&fs::read(old("relay").join("zarr.json")).unwrap()).unwrap();
    written["attributes"].as_object_mut().unwrap().remove("document_crc32c");
    let solve = &mut written["attributes"]["eyebox"]["settings"]["solve"];
    solve["loss"] = "contrast".into();
    solve["gaze"] = serde_json::json!([0.1, 0.0]);
    let hologram = document::read_group(&document::sealed(written)).unwrap();
    assert_eq!(hologram.metadata.solve.unwrap().steps, 3);
}
