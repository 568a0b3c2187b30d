//! Tests sequences through their folder, while they grow, are cut off or damaged, and on a full disk.

use super::*;
use crate::encode::tests::numbers;
use crate::files::FileError;
use crate::optics::wrap_phase;
use crate::solve::SplitMix;
use eyebox_base::error::ErrorData;
use std::fs;
use std::path::{Path, PathBuf};

const RATE: [u32; 2] = [30, 1];

fn small(index: u64) -> Hologram {
    let mut random = SplitMix(index);
    let mut phases = |n: usize| (0..n).map(|_| wrap_phase((6.3 * random.unit()) as f32)).collect::<Vec<f32>>();
    let color = |color, wavelength, phases| ColorHologram {
        color: Some(color),
        wavelength,
        exposure: 0.35,
        efficiency: 0.4,
        phases,
    };
    Hologram {
        frames: 2,
        height: 3,
        width: 5,
        pitch: 8e-6,
        focal_length: 0.4,
        geometry: crate::optics::Geometry::Relay,
        colors: vec![color(Color::Red, 660e-9, phases(30)), color(Color::Blue, 440e-9, phases(30))],
        seed: 7,
        version: "0.1.0".into(),
        display: "small".into(),
        display_wavelengths: crate::optics::Display::preset("small").unwrap().wavelengths,
        scene: "some scenes".into(),
        metadata: Metadata { seconds: Some(60.0), ..Metadata::default() },
    }
}

fn written(count: u64, finish: bool) -> (tempfile::TempDir, PathBuf) {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("x.zarr");
    let mut writer = SequenceWriter::create(&path, &small(0), RATE, Some(5)).unwrap();
    (0..count).for_each(|i| writer.append(&small(i)).unwrap());
    if finish {
        writer.finish().unwrap();
    }
    (here, path)
}

/// Returns the files in the order of their use, documents first, then holograms.
fn files_of(path: &Path, count: u64) -> Vec<PathBuf> {
    let chunks = (0..count).map(|i| path.join(format!("phases/c/{i}/0/0/0/0")));
    [path.join("zarr.json"), path.join("phases/zarr.json")].into_iter().chain(chunks).collect()
}

#[test]
fn a_hologram_in_memory_is_replaced_while_it_is_played() {
    let newest = NewestHologram::new(small(1));
    let mut sequence = Sequence::newest_of(Path::new("one.zarr"), &newest);
    let mut phases = vec![0.0; sequence.values()];
    let mut read = || (sequence.read_into(0, &mut phases).unwrap(), phases.clone());
    let of = |hologram: &Hologram| hologram.colors.iter().flat_map(|c| c.phases.clone()).collect::<Vec<f32>>();
    assert_eq!(read(), (0, of(&small(1))));
    assert_eq!(newest.replace(small(2)).expect("the same shape"), 1);
    assert_eq!(read(), (1, of(&small(2))));
    // A hologram of another shape is refused.
    let mut other = small(3);
    other.colors.pop();
    assert!(newest.replace(other).is_err());
    assert_eq!(read(), (1, of(&small(2))));
    assert_eq!(of(&sequence.load(0).unwrap()), of(&small(2)));
    // The newest version is compared only when it is on the screen.
    assert!(newest.shown().is_none());
    newest.put_on_screen(Some(OnScreen { version: 0, since: 3 }));
    assert!(newest.shown().is_none());
    let shown = OnScreen { version: 1, since: 9 };
    newest.put_on_screen(Some(shown));
    let (on_screen, hologram) = newest.shown().expect("it is on the screen");
    assert_eq!((on_screen, of(&hologram)), (shown, of(&small(2))));
    // A hologram that is never replaced has no other version.
    let mut single = Sequence::single(Path::new("one.zarr"), small(4));
    assert!(single.newest().is_none() && single.read_into(0, &mut phases).unwrap() == 0);
    assert_eq!(phases, of(&small(4)));
}

#[test]
fn a_sequence_comes_back_and_grows_while_it_is_read() {
    let (_here, path) = written(2, false);
    let mut sequence = Sequence::open(&path).unwrap();
    assert_eq!(
        (sequence.count(), sequence.planned(), sequence.rate(), sequence.shape()),
        (2, Some(5), RATE, [2, 2, 3, 5])
    );
    assert!(!sequence.is_complete() && sequence.notes().is_empty() && Sequence::is_at(&path));
    assert_eq!(sequence.load(1).unwrap(), small(1));
    let mut writer = SequenceWriter::resume(&path, &small(0), RATE, Some(5)).unwrap().unwrap();
    assert_eq!(writer.count(), 2);
    for i in 2..5 {
        assert!(sequence.load(i).is_err());
        writer.append(&small(i)).unwrap();
        assert_eq!(sequence.refresh(), i + 1);
        assert_eq!(sequence.load(i).unwrap(), small(i));
    }
    assert!(!sequence.is_complete());
    // Only one program at a time writes it.
    let busy = SequenceWriter::resume(&path, &small(0), RATE, Some(5)).unwrap_err();
    assert!(matches!(busy, HologramError::Busy { .. }), "{busy}");
    assert!(matches!(small(0).save(&path), Err(HologramError::Busy { .. })));
    writer.finish().unwrap();
    assert!(sequence.is_complete() && !path.join("progress.lock").exists());
    // The state after a program was killed between the two writes of the end.
    std::fs::write(path.join("progress.lock"), "").unwrap();
    assert!(SequenceWriter::resume(&path, &small(0), RATE, Some(5)).unwrap().is_none());
    assert!(!path.join("progress.lock").exists(), "the lock of the dead is removed");
    assert_eq!(ErrorData::of(&Hologram::load(&path).unwrap_err()).code, "not-a-hologram/is-a-sequence");
}

#[test]
fn a_single_hologram_is_a_sequence_of_one() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("x.zarr");
    small(3).save(&path).unwrap();
    let mut sequence = Sequence::open(&path).unwrap();
    assert!(sequence.is_single() && sequence.is_complete() && !Sequence::is_at(&path));
    assert_eq!((sequence.count(), sequence.load(0).unwrap()), (1, small(3)));
    let mut phases = vec![0.0; sequence.values()];
    sequence.read_into(0, &mut phases).unwrap();
    assert_eq!(phases, [small(3).colors[0].phases.clone(), small(3).colors[1].phases.clone()].concat());
    let error = SequenceWriter::resume(&path, &small(3), RATE, None).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "other-sequence/single-hologram");
}

#[test]
fn only_the_same_sequence_is_gone_on_with() {
    let (_here, path) = written(2, false);
    let refused = |change: &dyn Fn(&mut Hologram), code: &str, what: &str| {
        let mut like = small(0);
        change(&mut like);
        let error = SequenceWriter::resume(&path, &like, RATE, Some(5)).unwrap_err();
        let HologramError::OtherSequence { path: at, reason } = &error else { panic!("{error}") };
        assert_eq!((&at[..], reason.code()), (path.to_str().unwrap(), code), "{error}");
        assert!(reason.text().contains(what), "{error}");
    };
    refused(&|h| h.metadata.seconds = Some(61.0), "other-setting", "'seconds'");
    refused(&|h| h.scene = "others".into(), "other-scene", "others");
    refused(&|h| h.display = "paper".into(), "other-display", "'paper'");
    refused(&|h| h.seed = 8, "made-otherwise", "");
    refused(&|h| h.height = 4, "shape-or-rate", "[2, 2, 4, 5]");
    assert!(SequenceWriter::resume(&path, &small(0), [60, 1], Some(5)).is_err());
    assert!(matches!(
        SequenceWriter::create(&path, &small(0), RATE, None),
        Err(HologramError::File(FileError::Taken { .. }))
    ));
    let mut writer = SequenceWriter::resume(&path, &small(0), RATE, Some(5)).unwrap().unwrap();
    let mut other = small(2);
    other.colors[1].exposure = 0.5;
    assert_eq!(ErrorData::of(&writer.append(&other).unwrap_err()).code, "inconsistent/exposure-differs");
    other.colors.pop();
    assert!(writer.append(&other).is_err());
    assert_eq!(Sequence::open(&path).unwrap().count(), 2);
}

/// Everything after a byte is missing, as in an interrupted copy.
#[test]
fn cut_off_at_any_byte_it_has_all_that_is_whole_and_says_so() {
    let (_here, path) = written(3, true);
    let files = files_of(&path, 3);
    let whole: Vec<Vec<u8>> = files.iter().map(|f| fs::read(f).unwrap()).collect();
    for cut_in in 2..files.len() {
        for length in 0..whole[cut_in].len() {
            fs::write(&files[cut_in], &whole[cut_in][..length]).unwrap();
            files[cut_in + 1..].iter().for_each(|f| drop(fs::remove_file(f)));
            let mut cut = Sequence::open(&path).unwrap();
            let left = cut_in as u64 - 2;
            assert_eq!(cut.count(), left);
            let told = numbers(&cut.notes()[0]);
            assert_eq!(told[told.len() - 2..], [&left.to_string()[..], "3"], "{:?}", cut.notes());
            assert!(!cut.is_complete());
            (0..left).for_each(|i| assert_eq!(cut.load(i).unwrap(), small(i)));
        }
        files.iter().zip(&whole).for_each(|(f, bytes)| fs::write(f, bytes).unwrap());
    }
    // If the array's document is cut off, the holograms are counted by their files.
    for length in 0..whole[1].len() {
        fs::write(&files[1], &whole[1][..length]).unwrap();
        let mut cut = Sequence::open(&path).unwrap();
        assert_eq!((cut.count(), cut.load(2).unwrap()), (3, small(2)));
        assert!(cut.notes()[0].contains("phases/zarr.json"), "{:?}", cut.notes());
    }
    fs::write(&files[1], &whole[1]).unwrap();
    for length in 0..whole[0].len() {
        fs::write(&files[0], &whole[0][..length]).unwrap();
        let error = Sequence::open(&path).unwrap_err().to_string();
        assert!(error.contains(files[0].to_str().unwrap()), "{error}");
    }
}

#[test]
fn a_flipped_byte_costs_its_hologram_and_no_other() {
    let (_here, path) = written(3, true);
    let mut phases = vec![0.0; 60];
    for (i, file) in files_of(&path, 3).iter().enumerate() {
        let whole = fs::read(file).unwrap();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << (at % 8);
            fs::write(file, &bytes).unwrap();
            match (i, Sequence::open(&path)) {
                (0, Err(error)) => assert!(error.to_string().contains("zarr.json"), "{error}"),
                (1, Ok(sequence)) => assert_eq!((sequence.count(), sequence.notes().len()), (3, 1)),
                (_, Ok(mut sequence)) if i > 1 => {
                    for index in 0..3 {
                        let read = sequence.read_into(index, &mut phases);
                        assert_eq!(read.is_err(), index + 2 == i as u64, "byte {at}");
                        let error = read.err().map_or(String::new(), |e| e.to_string());
                        // Windows accepts both separators, and prints them as they were joined.
                        let [error, name] = [&error, file.to_str().unwrap()].map(|s| s.replace('\\', "/"));
                        assert!(error.is_empty() || error.contains(&name), "{error}");
                    }
                }
                (_, other) => panic!("byte {at} of {}: {other:?}", file.display()),
            }
        }
        fs::write(file, whole).unwrap();
    }
}

#[test]
fn going_on_writes_what_was_damaged_again() {
    let (_here, path) = written(3, false);
    let broken = path.join("phases/c/1/0/0/0/0");
    let mut bytes = fs::read(&broken).unwrap();
    bytes[17] ^= 4;
    fs::write(&broken, bytes).unwrap();
    let mut writer = SequenceWriter::resume(&path, &small(0), RATE, Some(5)).unwrap().unwrap();
    assert_eq!(writer.count(), 1);
    (1..5).for_each(|i| writer.append(&small(i)).unwrap());
    writer.finish().unwrap();
    let mut sequence = Sequence::open(&path).unwrap();
    (0..5).for_each(|i| assert_eq!(sequence.load(i).unwrap(), small(i)));
}

#[test]
fn a_consistent_lie_about_the_size_takes_no_memory_and_no_time() {
    let (_here, path) = written(1, false);
    for count in [u64::MAX, 1 << 40, 7] {
        fs::write(path.join("phases/zarr.json"), document::sequence_array(count, [2, 2, 3, 5], true)).unwrap();
        let sequence = Sequence::open(&path).unwrap();
        assert_eq!((sequence.count(), sequence.notes().len()), (1, 1));
    }
    for shape in [[2, 1 << 40, 3, 5], [2, usize::MAX, 65536, 65536], [2, 2, usize::MAX, 5], [0, 2, 3, 5], [3, 2, 3, 5]]
    {
        let attributes = document::SequenceAttributes { rate: RATE, shape, planned: None };
        fs::write(path.join("zarr.json"), document::group_with(&small(0), small(0).metadata, Some(attributes)))
            .unwrap();
        if let Ok(mut sequence) = Sequence::open(&path) {
            assert!(sequence.count() == 0 && sequence.load(0).is_err(), "{shape:?}");
        }
    }
}

/// `EYEBOX_MUTATIONS=10000` sets the number of mutations.
#[test]
fn mutated_files_are_an_answer_or_an_error() {
    let count = std::env::var("EYEBOX_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(400u64);
    let (_here, path) = written(3, true);
    let files = files_of(&path, 3);
    let whole: Vec<Vec<u8>> = files.iter().map(|f| fs::read(f).unwrap()).collect();
    let mut random = SplitMix(11);
    let mut below = |n: usize| ((random.unit() * n as f64) as usize).min(n - 1);
    let mut phases = vec![0.0; 60];
    let mut right = 0;
    for _ in 0..count {
        let file = below(files.len());
        let mut bytes = whole[file].clone();
        for _ in 0..=below(4) {
            let n = bytes.len().max(1);
            let at = below(n);
            match below(5) {
                0 => bytes.truncate(at),
                1 if !bytes.is_empty() => bytes[at] = below(256) as u8,
                2 => bytes.splice(at.min(bytes.len())..at.min(bytes.len()), [b'9'; 7]).for_each(drop),
                3 => drop(bytes.drain(at.min(bytes.len())..(at + 5).min(bytes.len()))),
                _ => bytes.extend_from_within(at.min(bytes.len())..),
            }
        }
        // Half of the documents are sealed again, so that their content is used.
        if file < 2 && below(2) == 0 {
            bytes = document::tests::resealed(bytes);
        }
        fs::write(&files[file], &bytes).unwrap();
        if let Ok(mut sequence) = Sequence::open(&path) {
            let values = sequence.values();
            if values == phases.len() {
                for index in 0..sequence.count().min(4) {
                    right += u64::from(sequence.read_into(index, &mut phases).is_ok());
                }
            }
            let _ = (sequence.is_complete(), sequence.load(0), sequence.load(u64::MAX));
        }
        let _ = SequenceWriter::resume(&path, &small(0), RATE, Some(5));
        files.iter().zip(&whole).for_each(|(f, bytes)| fs::write(f, bytes).unwrap());
    }
    assert!(right > count / 2, "most of the other holograms are read: {right}");
    println!("{count} mutated sequences, {right} sound holograms read in them");
}
