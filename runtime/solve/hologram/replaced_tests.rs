//! Tests holograms that are replaced while they are read. Every way of reading gives all of the old or all of the new.
//!
//! Only Linux exchanges two names at once.

use super::*;
use crate::files::FolderDraft;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Returns a hologram whose phases all equal `value`.
fn even(value: f32) -> Hologram {
    let display = Display { height: 8, width: 8, ..Display::preset("far-field").unwrap() };
    let color = |c: &crate::optics::Wavelength| ColorHologram {
        color: Some(c.color),
        wavelength: c.wavelength,
        exposure: 0.5,
        efficiency: 0.5,
        phases: vec![value; 3 * 64],
    };
    Hologram::on(&display, 3, display.wavelengths.iter().map(color).collect())
}

fn whole(path: &Path, value: f32) {
    even(value).save(path).unwrap();
}

fn tiles(path: &Path, value: f32) {
    let about = even(value);
    let mut tiles = Tiles::create(path, &about, 4, Value::Null, 4).unwrap();
    for (color, of) in about.colors.iter().enumerate() {
        tiles.commit(color as u64 + 1, color, [0, 0], [8, 8], &of.phases).unwrap();
    }
    tiles.finish().unwrap();
}

fn sequence(path: &Path, value: f32) {
    let mut writer = SequenceWriter::create(path, &even(value), [30, 1], Some(4)).unwrap();
    (0..4).for_each(|_| writer.append(&even(value)).unwrap());
    writer.finish().unwrap();
}

fn pictures(path: &Path, value: f32) {
    even(value).save_pngs(path).unwrap();
}

/// Returns the single value of all phases.
fn only(phases: impl IntoIterator<Item = f32>) -> f32 {
    let mut phases = phases.into_iter();
    let first = phases.next().unwrap();
    assert!(phases.all(|p| p == first), "a mixture");
    first
}

fn of_all(hologram: &Hologram) -> f32 {
    assert_eq!((hologram.colors.len(), hologram.colors[0].phases.len()), (3, 3 * 64));
    only(hologram.colors.iter().flat_map(|c| c.phases.iter().copied()))
}

/// Reads a path repeatedly while its content is exchanged between two versions. Both must be read at least once.
fn replaced(make: fn(&Path, f32), read: impl Fn(&Path) -> Result<f32, HologramError>) {
    let here = tempfile::tempdir().unwrap();
    let place = here.path().join("h.zarr");
    let kept = [1.0, -1.0].map(|value| {
        let path = here.path().join(format!("{value}.zarr"));
        make(&path, value);
        path
    });
    put(&kept[0], &place);
    let (stop, seen) = (AtomicBool::new(false), [1.0, -1.0].map(|_| AtomicBool::new(false)));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // The writer waits until even a slow reader has read both.
            for i in 0.. {
                let both = i >= 12 && seen.iter().all(|s| s.load(Relaxed));
                if both || stop.load(Relaxed) {
                    break;
                }
                put(&kept[i % 2], &place);
            }
            stop.store(true, Relaxed);
        });
        let ends = Ended(&stop);
        while !stop.load(Relaxed) {
            match read(&place) {
                Ok(value) => seen[usize::from(value < 0.0)].store(true, Relaxed),
                // A folder that stays open over several reads may be gone. The read must report it and do nothing else.
                Err(HologramError::Replaced { .. }) => {}
                Err(other) => panic!("{other}"),
            }
        }
        drop(ends);
    });
    assert_eq!(fs::read_dir(here.path()).unwrap().count(), 3, "no draft is left");
}

/// Stops the writer if the reader panics.
struct Ended<'a>(&'a AtomicBool);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

fn put(from: &Path, place: &Path) {
    let draft = FolderDraft::new(place, |_| true).unwrap();
    let mut left = vec![PathBuf::new()];
    while let Some(at) = left.pop() {
        for entry in fs::read_dir(from.join(&at)).unwrap() {
            let entry = entry.unwrap();
            let name = at.join(entry.file_name());
            if entry.file_type().unwrap().is_dir() {
                left.push(name);
            } else {
                draft.write(name.to_str().unwrap(), |out| out.write_all(&fs::read(entry.path())?)).unwrap();
            }
        }
    }
    draft.put().unwrap();
}

#[test]
fn a_whole_hologram_is_the_old_or_the_new() {
    replaced(whole, |place| Ok(of_all(&Hologram::load(place)?)));
    replaced(whole, |place| {
        let mut phases = vec![0.0; 3 * 3 * 64];
        Sequence::open(place)?.read_into(0, &mut phases)?;
        Ok(only(phases))
    });
}

#[test]
fn tiles_are_the_old_or_the_new() {
    replaced(tiles, |place| Ok(of_all(&Hologram::load(place)?)));
    replaced(tiles, |place| {
        assert!(Tiles::is_tiled(place), "tiles were replaced by tiles");
        let PhaseSource::Tiled(tiles) = PhaseSource::open(place)? else { panic!("not in tiles") };
        let read = |color, at| tiles.read(color, at, [4, 8]);
        let parts = [read(0, [0, 0])?, read(1, [0, 0])?, read(2, [4, 0])?, read(0, [4, 0])?];
        Ok(only(parts.into_iter().flatten()))
    });
}

#[test]
fn a_sequence_is_the_old_or_the_new() {
    replaced(sequence, |place| Ok(of_all(&Hologram::load_at(place, Some(3))?)));
    replaced(sequence, |place| {
        assert!(Sequence::is_at(place), "a sequence was replaced by a sequence");
        let mut sequence = Sequence::open(place)?;
        assert_eq!((sequence.count(), sequence.notes().len()), (4, 0));
        Ok(only([of_all(&sequence.load(0)?), of_all(&sequence.load(3)?)]))
    });
}

#[test]
fn a_folder_of_pictures_is_the_old_or_the_new() {
    replaced(pictures, |place| {
        let phases = load_phases(place, None)?;
        assert_eq!((phases.frames, phases.colors.len()), (3, 3));
        // The file stores levels, not phases.
        Ok(only(phases.colors.into_iter().flat_map(|(_, phases)| phases)))
    });
}

/// Phases of an unfinished hologram are not made up after it was removed as a whole.
#[test]
fn tiles_that_are_gone_are_not_taken_for_such_that_were_never_solved() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("h.zarr");
    drop(Tiles::create(&path, &even(0.0), 4, Value::Null, 4).unwrap());
    let looked = Tiles::open(&path).unwrap();
    assert!(looked.read(0, [0, 0], [8, 8]).is_ok());
    whole(&path, 1.0);
    assert!(matches!(looked.read(0, [0, 0], [8, 8]), Err(HologramError::Replaced { .. })));
}
