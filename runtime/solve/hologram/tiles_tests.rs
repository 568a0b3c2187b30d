//! Tests commits, interruptions and locks of tiles on the disk.

use super::super::chunks::is_hologram;
use super::*;
use crate::files::FileError;
use crate::hologram::ColorHologram;
use crate::optics::{Color, Geometry};
use std::fs;

fn about(frames: usize, height: usize, width: usize) -> Hologram {
    let color =
        ColorHologram { color: Some(Color::Green), wavelength: 520e-9, exposure: 0.4, efficiency: 0.5, phases: vec![] };
    Hologram {
        frames,
        height,
        width,
        pitch: 1e-6,
        focal_length: 0.4,
        geometry: Geometry::FarField,
        colors: vec![color],
        seed: 5,
        version: "0".into(),
        display: "x".into(),
        display_wavelengths: Vec::new(),
        scene: "y".into(),
        metadata: Metadata::default(),
    }
}

#[test]
fn first_phases_are_even_and_of_their_place() {
    let many: Vec<f32> = (0..40_000).map(|i| first_phase(3, 0, 0, i / 200, i % 200)).collect();
    let moment = |k: f32| {
        let (s, c) = many.iter().fold((0.0, 0.0), |(s, c), p| (s + (k * p).sin(), c + (k * p).cos()));
        (s.hypot(c)) / many.len() as f32
    };
    assert!(moment(1.0) < 0.02 && moment(2.0) < 0.02 && moment(7.0) < 0.02);
    // Neighbors, sub-frames and colors are uncorrelated.
    for other in [1usize, 200, 201] {
        let alike: f32 = many.iter().zip(&many[other..]).map(|(a, b)| (a - b).cos()).sum::<f32>() / many.len() as f32;
        assert!(alike.abs() < 0.02, "{other}: {alike}");
    }
    assert_ne!(first_phase(3, 0, 1, 4, 4), first_phase(3, 1, 0, 4, 4));
    assert_ne!(first_phase(3, 0, 0, 4, 5), first_phase(3, 0, 0, 5, 4));
}

#[test]
fn what_is_committed_is_read_and_the_rest_is_as_it_was() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("h.zarr");
    let (height, width) = (70, 90);
    let mut tiles = Tiles::create(&path, &about(2, height, width), 32, Value::Null, 4).unwrap();
    let first = tiles.read(0, [0, 0], [height, width]).unwrap();
    assert_eq!(first[height * width + 5 * width + 7], first_phase(5, 0, 1, 5, 7));
    // A rectangle that ends at the edge, over tiles that are not full.
    let (at, size) = ([32, 64], [38, 26]);
    let phases: Vec<f32> = (0..2 * 38 * 26).map(|i| (i % 100) as f32 / 50.0 - 1.0).collect();
    tiles.commit(1, 0, at, size, &phases).unwrap();
    drop(tiles);
    let mut tiles = Tiles::resume(&path).unwrap();
    assert_eq!(tiles.made().unwrap().done, 1);
    assert_eq!(tiles.read(0, at, size).unwrap(), phases);
    let part = tiles.read(0, [30, 60], [40, 30]).unwrap();
    assert_eq!(part[..30], first[30 * width + 60..][..30]);
    assert_eq!(part[1200 + 2 * 30 + 4], phases[38 * 26]);
    tiles.finish().unwrap();
    // When finished, it is an ordinary hologram with all tiles.
    let whole = Hologram::load(&path).unwrap();
    assert_eq!(whole.frame(0, 1)[32 * width + 64], phases[38 * 26]);
    assert_eq!(whole.frame(0, 0)[..width], first[..width]);
    assert!(Tiles::open(&path).unwrap().made().is_none());
    let names: Vec<_> = fs::read_dir(&path).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names.len(), 2, "{names:?}");
    fs::remove_file(path.join("phases/c/0/0/1/1")).unwrap();
    assert!(matches!(Hologram::load(&path), Err(HologramError::Damaged { .. })));
}

#[test]
fn a_copy_differs_where_it_was_patched_alone() {
    let here = tempfile::tempdir().unwrap();
    let [path, other] = ["h.zarr", "other.zarr"].map(|name| here.path().join(name));
    let (height, width) = (70, 90);
    let mut tiles = Tiles::create(&path, &about(2, height, width), 32, Value::Null, 4).unwrap();
    let (at, size) = ([32, 64], [38, 26]);
    let phases: Vec<f32> = (0..2 * 38 * 26).map(|i| (i % 100) as f32 / 50.0 - 1.0).collect();
    let patch = [Patch { color: 0, at, size, phases: phases.clone() }];
    assert!(matches!(tiles.copy(&other, &Metadata::default(), &patch), Err(HologramError::Inconsistent(_))));
    tiles.finish().unwrap();
    let before = Hologram::load(&path).unwrap();
    tiles.copy(&other, &Metadata { seconds: Some(1.0), ..Metadata::default() }, &patch).unwrap();
    assert_eq!(Hologram::load(&path).unwrap(), before);
    let copy = Hologram::load(&other).unwrap();
    assert_eq!((copy.metadata.seconds, copy.seed), (Some(1.0), before.seed));
    for (i, (now, then)) in copy.colors[0].phases.iter().zip(&before.colors[0].phases).enumerate() {
        let (frame, y, x) = (i / (height * width), i / width % height, i % width);
        let patched = y >= 32 && x >= 64;
        let want = if patched { phases[(frame * 38 + y - 32) * 26 + x - 64] } else { *then };
        assert_eq!(*now, want, "{frame} {y} {x}");
    }
    // The copy replaces the original.
    tiles.copy(&path, &Metadata::default(), &patch).unwrap();
    assert_eq!(Hologram::load(&path).unwrap().colors, copy.colors);
}

/// A commit is interrupted before and after its middle. A writer that resumes, and a reader, get the old or the new
/// state, and reading changes nothing.
#[test]
fn a_commit_is_whole_or_not_at_all() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("h.zarr");
    drop(Tiles::create(&path, &about(1, 64, 64), 32, Value::Null, 4).unwrap());
    let state = |tiles: &Tiles| (tiles.made().unwrap().done, tiles.read(0, [0, 0], [64, 32]).unwrap());
    let staged = || fs::read_dir(path.join(STAGED)).unwrap().count();
    let both = |expected: &(u64, Vec<f32>)| {
        let before = staged();
        assert_eq!(state(&Tiles::open(&path).unwrap()), *expected);
        assert_eq!(staged(), before);
        assert_eq!(state(&Tiles::resume(&path).unwrap()), *expected);
        assert_eq!(staged(), 0);
    };
    let looked = Tiles::open(&path).unwrap();
    let (old, new) = (looked.read(0, [0, 0], [64, 32]).unwrap(), vec![0.25f32; 64 * 32]);
    let stage = || {
        fs::create_dir_all(path.join(STAGED)).unwrap();
        (0..2).for_each(|row| looked.stage(1, [0, row, 0], &new[..1024]).unwrap());
    };
    stage();
    both(&(0, old));
    stage();
    let made = Made { done: 1, job: Value::Null, total: None, pending: vec![[0, 0, 0], [0, 1, 0]] };
    fs::write(path.join(PROGRESS), to_json(&made)).unwrap();
    // One of the two was moved already.
    fs::create_dir_all(path.join("phases/c/0/0/0")).unwrap();
    fs::rename(path.join(STAGED).join("1.0.0.0"), path.join("phases/c/0/0/0/0")).unwrap();
    both(&(1, new.clone()));
    // The next commit had staged one of the same tiles before the interruption.
    looked.stage(2, [0, 1, 0], &[0.5; 1024]).unwrap();
    both(&(1, new));
}

#[test]
fn one_program_makes_it_and_others_may_look() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("h.zarr");
    let mut tiles = Tiles::create(&path, &about(1, 64, 64), 32, Value::Null, 4).unwrap();
    let busy = Tiles::resume(&path).unwrap_err();
    assert!(matches!(&busy, HologramError::Busy { path } if path.ends_with("h.zarr")), "{busy}");
    let mut looked = Tiles::open(&path).unwrap();
    let phases = vec![0.5; 32 * 32];
    let refused = looked.commit(1, 0, [0, 0], [32, 32], &phases);
    assert!(matches!(refused, Err(HologramError::Inconsistent(_))));
    assert!(looked.finish().is_err());
    tiles.commit(1, 0, [0, 0], [32, 32], &phases).unwrap();
    // A reader that opened it before also gets it.
    assert_eq!(looked.read(0, [0, 0], [32, 32]).unwrap(), phases);
    drop(tiles);
    Tiles::resume(&path).unwrap().finish().unwrap();
    assert_eq!(Hologram::load(&path).unwrap().colors[0].phases[..32], phases[..32]);
}

/// If a program is killed while it writes the progress, its temporary file is removed, and the hologram may be
/// replaced.
#[test]
fn a_draft_of_the_progress_does_not_stay() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("h.zarr");
    let mut tiles = Tiles::create(&path, &about(1, 64, 64), 32, Value::Null, 4).unwrap();
    let names = || -> Vec<String> {
        let all = fs::read_dir(&path).unwrap();
        all.map(|e| e.unwrap().file_name().into_string().unwrap()).filter(|n| n != STAGED).collect()
    };
    fs::create_dir_all(path.join(STAGED)).unwrap();
    let before = names();
    // The file of `count`, cut off in the middle.
    let cut = tiles.folder.replace(DRAFT, PROGRESS, |out| {
        out.write_all(b"{")?;
        assert_eq!(names(), before, "the draft is not beside the rest");
        assert_eq!(fs::read_dir(path.join(STAGED))?.count(), 1);
        Err(std::io::ErrorKind::Interrupted.into())
    });
    assert!(cut.is_err());
    fs::write(path.join(STAGED).join(".eyebox-ABCDEF.part"), "{").unwrap();
    tiles.commit(1, 0, [0, 0], [32, 32], &[0.5; 1024]).unwrap();
    drop(tiles);
    fs::write(path.join(STAGED).join(".eyebox-ABCDEF.part"), "{").unwrap();
    Tiles::resume(&path).unwrap().finish().unwrap();
    assert!(is_hologram(&path) && fs::read_dir(&path).unwrap().count() == 2);
}

/// A sealed shape that does not fit into memory gives an error, and nothing is allocated for it.
#[test]
fn a_shape_that_lies_costs_nothing() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("h.zarr");
    drop(Tiles::create(&path, &about(1, 64, 64), 32, Value::Null, 4).unwrap());
    for (frames, side) in [(1 << 40, 32), (1 << 61, 32), (usize::MAX, 1 << 14)] {
        fs::write(path.join(ARRAY), document::array([1, frames, 64, 64], Some(side))).unwrap();
        for error in [Tiles::open(&path).map(drop), Hologram::load(&path).map(drop)].map(Result::unwrap_err) {
            assert!(matches!(error, HologramError::Memory(_)), "{error}");
        }
    }
}

#[test]
fn progress_is_sealed_and_older_progress_is_read() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("h.zarr");
    let mut tiles = Tiles::create(&path, &about(1, 64, 64), 32, Value::Null, 4).unwrap();
    tiles.commit(2, 0, [0, 0], [32, 32], &[0.5; 1024]).unwrap();
    drop(tiles);
    let whole = fs::read_to_string(path.join(PROGRESS)).unwrap();
    fs::write(path.join(PROGRESS), whole.replace("\"done\": 2", "\"done\": 9")).unwrap();
    let error = Tiles::resume(&path).unwrap_err();
    let HologramError::Damaged { file, reason } = &error else { panic!("{error}") };
    assert!(file.ends_with("progress.json") && reason.code() == "checksum", "{error}");
    fs::write(path.join(PROGRESS), r#"{"done":2,"job":null,"pending":[]}"#).unwrap();
    assert_eq!(Tiles::resume(&path).unwrap().made().unwrap().done, 2);
}

/// A link instead of a folder of the hologram is never followed to empty or write a folder. A hologram's folder that
/// holds something else is not replaced.
#[cfg(unix)]
#[test]
fn nothing_of_others_is_removed_or_written() {
    use std::os::unix::fs::symlink;
    let here = tempfile::tempdir().unwrap();
    let (path, data) = (here.path().join("h.zarr"), here.path().join("data"));
    fs::create_dir(&data).unwrap();
    fs::write(data.join("1.0.0.0"), "mine").unwrap();
    let mut tiles = Tiles::create(&path, &about(1, 64, 64), 32, Value::Null, 4).unwrap();
    symlink(&data, path.join(STAGED)).unwrap();
    let phases = vec![0.5; 32 * 32];
    assert!(matches!(tiles.commit(1, 0, [0, 0], [32, 32], &phases), Err(HologramError::Damaged { .. })));
    drop(tiles);
    drop(Tiles::resume(&path).unwrap());
    fs::remove_file(path.join(STAGED)).unwrap();
    fs::create_dir_all(path.join("phases/c")).unwrap();
    symlink(&data, path.join("phases/c/0")).unwrap();
    let mut tiles = Tiles::resume(&path).unwrap();
    assert!(matches!(tiles.commit(1, 0, [0, 0], [32, 32], &phases), Err(HologramError::Damaged { .. })));
    drop(tiles);
    assert_eq!((fs::read(data.join("1.0.0.0")).unwrap(), fs::read_dir(&data).unwrap().count()), (b"mine".to_vec(), 1));
    fs::remove_file(path.join("phases/c/0")).unwrap();
    fs::write(path.join("phases/notes.txt"), "mine").unwrap();
    let error = Tiles::create(&path, &about(1, 64, 64), 32, Value::Null, 4).unwrap_err();
    assert!(matches!(error, HologramError::File(FileError::Taken { .. })), "{error}");
    assert!(path.join("phases/notes.txt").exists());
}
