//! Tests that no data of a device causes a panic or a read beyond the data.

use super::super::descriptor::LONGEST_REPORT;
use super::super::{Decoder, Description, Descriptor, Layout};
use super::{report, tracker};
use crate::trackers::Sample;
use crate::trackers::recording::{Recording, RecordingSource};
use proptest::prelude::*;
use std::io::Write;
use std::time::{Duration, Instant};

/// Checks the invariants of every descriptor and of every report after it.
fn check(descriptor: &[u8], reports: &[Vec<u8>]) -> bool {
    let Ok(parsed) = Descriptor::parse(descriptor) else { return false };
    for field in &parsed.fields {
        assert!(field.offset + field.total_bits() <= LONGEST_REPORT * 8);
        assert!(field.collection.is_none_or(|c| c < parsed.collections.len()));
        let _ = (field.usage(0), field.usage(u32::MAX));
    }
    assert!(parsed.notes.len() < 64);
    if let Ok(description) = Description::of(descriptor) {
        assert!(description.to_string().len() < 4 << 20);
    }
    let Ok(layout) = Layout::find(&parsed) else { return false };
    let all = layout.inputs.iter().flat_map(|i| {
        let payload = (i.bytes - usize::from(layout.numbered)) * 8;
        let axes = i.places.iter().flat_map(|p| p.axes.into_iter().flatten());
        axes.chain(i.time.iter().flat_map(|t| t.parts.iter().copied())).map(move |slot| (slot, payload))
    });
    for (slot, payload) in all {
        assert!(slot.bit + slot.bits as usize <= payload, "{slot:?} beyond {payload} bits");
    }
    for setting in [layout.mode, layout.status, layout.frequency, layout.status_sent].into_iter().flatten() {
        let _ = (setting.report(i64::MAX), setting.report(i64::MIN), setting.value(&[]));
    }
    let mut decoder = Decoder::new(layout, 1000);
    for (i, report) in reports.iter().enumerate() {
        if let Some(sample) = decoder.sample(report, i as u64 * 1_000_000) {
            sound(&sample);
        }
    }
    true
}

fn sound(sample: &Sample) {
    assert!(sample.time_ns <= sample.received_ns);
    for (_, r) in sample.readings() {
        assert!(r.position.iter().chain(&r.distance).all(|v| v.is_finite()));
        assert!((0.0..=1.0).contains(&r.confidence));
    }
}

fn item() -> impl Strategy<Value = Vec<u8>> {
    // Valid items, with relevant values more often than not.
    let prefixes = prop::sample::select(vec![
        0x04u8, 0x08, 0x14, 0x24, 0x34, 0x44, 0x54, 0x64, 0x74, 0x84, 0x94, 0xa4, 0xb4, 0x18, 0x28, 0xa8, 0x80, 0x90,
        0xb0, 0xa0, 0xc0, 0xfc,
    ]);
    let values = prop_oneof![
        prop::sample::select(vec![
            0u32, 1, 2, 3, 8, 0x10, 0x12, 0x20, 0x21, 0x22, 0x23, 0x24, 0x25, 0x26, 32, 64, 65, 0xff
        ]),
        any::<u32>(),
    ];
    (prefixes, 0u8..4, values).prop_map(|(prefix, size, value)| {
        let bytes = value.to_le_bytes();
        [&[prefix | size], &bytes[..[0, 1, 2, 4][usize::from(size)]]].concat()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    #[test]
    fn bytes(descriptor in prop::collection::vec(any::<u8>(), 0..600), report in prop::collection::vec(any::<u8>(), 0..80)) {
        check(&descriptor, &[report]);
    }

    #[test]
    fn items(items in prop::collection::vec(item(), 0..80), report in prop::collection::vec(any::<u8>(), 0..80)) {
        let descriptor = [&[0x05, 0x12, 0x09, 0x01, 0xa1, 0x01][..], &items.concat()].concat();
        check(&descriptor, &[report]);
    }

    #[test]
    fn changed_trackers(
        at in prop::collection::vec((0usize..400, any::<u8>()), 0..6),
        cut in 0usize..400,
        reports in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..80), 0..4),
    ) {
        let mut descriptor = tracker();
        for (at, byte) in at {
            if let Some(place) = descriptor.get_mut(at) {
                *place = byte;
            }
        }
        if cut > 50 {
            descriptor.truncate(cut);
        }
        let reports = reports.into_iter().map(|mut r| { if let Some(id) = r.first_mut() { *id = 0x10; } r });
        check(&descriptor, &reports.collect::<Vec<_>>());
    }

    #[test]
    fn recordings(text in "[RNPIED#: 0-9a-f.\n]{0,200}", cut in 0usize..4000) {
        let _ = Recording::read(text.as_bytes());
        let mut whole = Vec::new();
        let hex: String = tracker().iter().map(|b| format!(" {b:02x}")).collect();
        writeln!(whole, "R: {}{hex}\nE: 0.5 2 10 00\n{text}", tracker().len()).unwrap();
        whole.truncate(cut.max(20));
        if let Ok(recording) = Recording::read(&whole[..]) {
            let _ = RecordingSource::new(recording, None, false, 0);
        }
    }
}

/// Fuzzes for `EYEBOX_FUZZ_SECONDS` (60) seconds from the seed `EYEBOX_FUZZ_SEED` (1).
///
/// `cargo test --release -p eyebox --lib fuzz_for_long -- --ignored --nocapture`
#[test]
#[ignore = "runs for EYEBOX_FUZZ_SECONDS"]
fn fuzz_for_long() {
    let number = |name: &str, default: u64| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default);
    let (seconds, seed) = (number("EYEBOX_FUZZ_SECONDS", 60), number("EYEBOX_FUZZ_SEED", 1));
    let mut rng = fastrand::Rng::with_seed(seed);
    let (start, mut cases, mut understood) = (Instant::now(), 0u64, 0u64);
    // Descriptors that were understood as eye trackers are changed further.
    let mut kept = vec![tracker()];
    while start.elapsed() < Duration::from_secs(seconds) {
        for _ in 0..1000 {
            let mut descriptor = kept[rng.usize(..kept.len())].clone();
            for _ in 0..rng.usize(0..8) {
                let at = rng.usize(..descriptor.len());
                match rng.u8(0..6) {
                    0 => descriptor[at] = rng.u8(..),
                    1 => descriptor[at] ^= 1 << rng.u8(0..8),
                    2 => descriptor.insert(at, rng.u8(..)),
                    3 if descriptor.len() > 8 => drop(descriptor.remove(at)),
                    4 => {
                        let other = &kept[rng.usize(..kept.len())];
                        let from = rng.usize(..other.len());
                        let piece = other[from..(from + rng.usize(0..40)).min(other.len())].to_vec();
                        descriptor.splice(at..at, piece);
                    }
                    _ if descriptor.len() > 60 => descriptor.truncate(at.max(30)),
                    _ => {}
                }
            }
            let random = |rng: &mut fastrand::Rng| (0..rng.usize(0..120)).map(|_| rng.u8(..)).collect::<Vec<u8>>();
            let mut reports = vec![random(&mut rng), report(rng.u64(..), std::array::from_fn(|_| rng.i32(..)))];
            let mut numbered = random(&mut rng);
            if let Some(id) = numbered.first_mut() {
                *id = rng.u8(0x0e..0x16);
            }
            reports.push(numbered);
            cases += 1;
            if check(&descriptor, &reports) {
                understood += 1;
                if descriptor.len() < 2000 && rng.u8(..) < 8 {
                    if kept.len() < 500 {
                        kept.push(descriptor);
                    } else {
                        let at = rng.usize(1..kept.len());
                        kept[at] = descriptor;
                    }
                }
            }
        }
    }
    println!(
        "{cases} descriptors with three reports each, {understood} of them eye trackers, in {seconds} s from seed {seed}"
    );
}
