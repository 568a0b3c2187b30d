//! Tests the decoding of reports into samples.

use super::super::report::{extract, insert};
use super::super::{Decoder, Descriptor, DeviceFile, Layout};
use super::{Build, MICROMETRES, report, tracker};
use crate::trackers::{Quantity, Sample, Unit};

fn decoder(bytes: &[u8]) -> Decoder {
    Decoder::new(Layout::find(&Descriptor::parse(bytes).unwrap()).unwrap(), 0)
}

const POSITIONS: [i32; 8] = [100_000, -50_000, -32_000, 1_000, 600_000, 31_000, -2_000, 605_000];

fn mm(sample: &Sample) -> Vec<f64> {
    let all = [&sample.combined, &sample.left, &sample.right];
    all.iter()
        .flat_map(|r| r.iter().flat_map(|r| r.position.into_iter().chain(r.distance)))
        .map(|v| (v * 1e9).round() / 1e6)
        .collect()
}

#[test]
fn a_report_is_what_it_says() {
    let mut decoder = decoder(&tracker());
    let bytes = report(0x1_0000_0005, POSITIONS);
    assert_eq!(bytes.len(), 65);
    let sample = decoder.sample(&bytes, 9_000_000_000).unwrap();
    assert_eq!(mm(&sample), [100.0, -50.0, -32.0, 1.0, 600.0, 31.0, -2.0, 605.0]);
    // The time is over 2^32 microseconds.
    assert_eq!(sample.tracker_ns, Some(4_294_967_301_000));
    let (gaze, left) = (sample.combined.unwrap(), sample.left.unwrap());
    assert_eq!((gaze.quantity, gaze.unit, gaze.distance), (Quantity::Gaze, Unit::Metres, None));
    assert_eq!((left.quantity, left.valid, left.confidence), (Quantity::Pupil, true, 1.0));
    let sample = decoder.sample(&report(u64::MAX, POSITIONS), 10_000_000_000).unwrap();
    assert!(sample.time_ns <= sample.received_ns);
}

#[test]
fn what_is_out_of_range_is_invalid_and_alone_so() {
    let mut decoder = decoder(&tracker());
    let mut wrong = POSITIONS;
    wrong[1] = 2_000_001;
    wrong[5] = i32::MIN;
    let sample = decoder.sample(&report(1, wrong), 1).unwrap();
    assert!(!sample.combined.unwrap().valid && sample.left.unwrap().valid && !sample.right.unwrap().valid);
    let edge = [-2_000_000, 2_000_000, -2_000_000, 2_000_000, 2_000_000, 0, 0, 0];
    let sample = decoder.sample(&report(2, edge), 2).unwrap();
    assert!(sample.combined.unwrap().valid && sample.left.unwrap().valid);
    assert!(!sample.right.unwrap().valid, "a field that nobody filled");
}

#[test]
fn short_and_foreign_reports_are_passed_over_and_long_ones_taken() {
    let mut decoder = decoder(&tracker());
    let bytes = report(1, POSITIONS);
    for length in 0..bytes.len() {
        assert_eq!(decoder.sample(&bytes[..length], 1), None, "{length}");
    }
    assert_eq!(decoder.sample(&[&[0x11], &bytes[1..]].concat(), 1), None);
    assert!(decoder.sample(&[&bytes[..], &[0; 8]].concat(), 1).is_some());
}

#[test]
fn other_sizes_orders_and_padding_decode_too() {
    // Reports are unnumbered, with right before left, 24 bits, 3 bits of padding in front, and a time of 4 bytes in
    // milliseconds.
    let axes =
        |b: Build, usage| b.usage(usage).open(0).size(24, 3).usage(0x21).usage(0x22).usage(0x23).input(3).close();
    let build = Build::default().page(0x12).usage(1).open(1).usage(0x10).open(2).size(3, 1).input(3);
    let build = build.usage(0x20).unit(0x1001, -3).logical(0, 0x7fff_ffff).size(32, 1).input(2);
    let build = build.unit(0x11, -3).logical(-100_000, 100_000);
    let build = axes(axes(build, 0x26), 0x25).size(5, 1).input(3).close().close();
    let mut decoder = decoder(&build.0);
    let mut bytes = vec![0; 23];
    insert(&mut bytes, 3, 32, 12_345);
    for (i, v) in [-5, 6, 7, 1, -2, 60_000].into_iter().enumerate() {
        insert(&mut bytes, 35 + 24 * i, 24, v);
    }
    let sample = decoder.sample(&bytes, 1 << 40).unwrap();
    assert_eq!(sample.tracker_ns, Some(12_345_000_000));
    let close = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12;
    assert!(close(sample.right.unwrap().position, [-50e-6, 60e-6]), "ten micrometres a count: {sample}");
    assert!(
        close(sample.left.unwrap().position, [10e-6, -20e-6])
            && (sample.left.unwrap().distance.unwrap() - 0.6).abs() < 1e-12
    );
}

#[test]
fn missing_usages_are_made_up_for() {
    let start = |name: bool| {
        let b = Build::default().page(0x12);
        let b = if name { b.usage(1) } else { b };
        let b = b.open(1);
        let b = if name { b.usage(0x10) } else { b };
        let b = b.open(2).id(0x10).logical(0, 255).usage(0x20).unit(0x1001, -6).size(8, 8).input(2);
        b.unit(MICROMETRES.0, MICROMETRES.1).logical(-2_000_000, 2_000_000)
    };
    let unnamed =
        |b: Build, axes: i64| (0..axes).fold(b.open(0).size(32, axes), |b, i| b.usage(0x21 + i)).input(3).close();
    let tail = |b: Build| b.size(32, 6).input(3).close().close().0;
    let variants = [
        // The outer collections have no names.
        tail(start(false).position(0x24, 2).position(0x25, 3).position(0x26, 3)),
        // The positions have no names and are identified by their places, then all collections have none.
        tail(unnamed(unnamed(unnamed(start(true), 2), 3), 3)),
        tail(unnamed(unnamed(unnamed(start(false), 2), 3), 3)),
        // One position has no name.
        tail(unnamed(start(true).position(0x24, 2), 3).position(0x26, 3)),
        // The axes have no usages, or only the first usage.
        tail(
            start(true)
                .usage(0x24)
                .open(0)
                .size(32, 2)
                .input(3)
                .close()
                .usage(0x25)
                .open(0)
                .size(32, 3)
                .usage(0x21)
                .input(3)
                .close()
                .position(0x26, 3),
        ),
        // Without a unit the positions are micrometers, and without a range they are signed.
        tail(start(true).unit(0, 0).logical(0, 0).position(0x24, 2).position(0x25, 3).position(0x26, 3)),
        // The usages are a range.
        tail(
            start(true)
                .position(0x24, 2)
                .usage(0x25)
                .open(0)
                .size(32, 3)
                .item(0x18, 0x21)
                .item(0x28, 0x23)
                .input(3)
                .close()
                .position(0x26, 3),
        ),
    ];
    for (i, bytes) in variants.iter().enumerate() {
        let mut decoder = decoder(bytes);
        let sample = decoder.sample(&report(7, POSITIONS), 1).unwrap();
        assert_eq!(mm(&sample), [100.0, -50.0, -32.0, 1.0, 600.0, 31.0, -2.0, 605.0], "variant {i}");
        assert_eq!(sample.tracker_ns, Some(7000), "variant {i}");
        assert_eq!(decoder.layout.notes.is_empty(), i == 6, "variant {i}: {:?}", decoder.layout.notes);
    }
}

#[test]
fn settings_are_read_and_written_in_their_reports() {
    let layout = Layout::find(&Descriptor::parse(&tracker()).unwrap()).unwrap();
    assert_eq!(layout.mode.unwrap().report(3), [0x14, 3]);
    assert_eq!(layout.mode.unwrap().report(999), [0x14, 7], "no more than it takes");
    let answer = [0x13, 4, 0xf4, 0x01];
    assert_eq!(
        (layout.status.unwrap().value(&answer), layout.frequency.unwrap().value(&answer)),
        (Some(4.0), Some(500.0))
    );
    assert_eq!(layout.frequency.unwrap().value(&answer[..3]), None);
    assert_eq!(layout.status.unwrap().value(&[0x13, 9, 0, 0]), None, "out of range");
    assert_eq!(layout.status_sent.unwrap().value(&[0x13, 1]), Some(1.0));
}

#[test]
fn bits_are_bits() {
    let bytes = [0b1010_0101, 0xff, 0x00, 0x80];
    assert_eq!(extract(&bytes, 0, 4, false), Some(5));
    assert_eq!(extract(&bytes, 4, 4, true), Some(-6));
    assert_eq!(extract(&bytes, 6, 12, false), Some(0b0011_1111_1110));
    assert_eq!(extract(&bytes, 31, 1, true), Some(-1));
    assert_eq!(extract(&bytes, 31, 2, false), None);
    assert_eq!(extract(&bytes, usize::MAX, 8, false), None);
    assert_eq!(extract(&bytes, 0, 0, false), None);
    assert_eq!(extract(&[0xff; 9], 7, 64, false), Some(-1), "all 64 bits");
}

const FILE: &str = r#"
vendor = 0x1234
product = 0x5678
report_id = 1
bytes = 14
time = { offset = 1, size = 4, scale = 1e-6 }

[left]
unit = "mm"
x = { offset = 5, size = 2, signed = true, scale = 0.001 }
y = { offset = 7, size = 2, signed = true, scale = -0.001, range = [-5000, 5000] }
diameter = { offset = 9, size = 2, scale = 0.001 }
confidence = { offset = 11, size = 1, scale = 0.01 }
valid = { offset = 12, size = 1 }
"#;

#[test]
fn a_file_describes_a_device() {
    let file = DeviceFile::from_toml(FILE).unwrap();
    assert_eq!((file.id, file.name.as_str()), ([0x1234, 0x5678], "1234:5678"));
    let mut decoder = Decoder::new(file.layout, 2_000_000);
    let mut bytes = [1, 0x40, 0x42, 0x0f, 0, 0x18, 0xfc, 0xf4, 0x01, 0xa0, 0x0f, 80, 1, 0];
    let sample = decoder.sample(&bytes, 5_000_000_000).unwrap();
    let left = sample.left.unwrap();
    assert!((left.position[0] + 1e-3).abs() < 1e-12 && (left.position[1] + 0.5e-3).abs() < 1e-12, "{left}");
    assert!((left.diameter.unwrap() - 4e-3).abs() < 1e-12 && (left.confidence - 0.8).abs() < 1e-12 && left.valid);
    assert_eq!((sample.tracker_ns, sample.time_ns), (Some(1_000_000_000), 4_998_000_000));
    bytes[12] = 0;
    assert!(!decoder.sample(&bytes, 5_000_000_001).unwrap().left.unwrap().valid);
    (bytes[12], bytes[8]) = (1, 0x7f);
    assert!(!decoder.sample(&bytes, 5_000_000_002).unwrap().left.unwrap().valid, "out of its range");
    // Four bytes of microseconds wrap around after 72 minutes.
    let turned = decoder.sample(&[1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 80, 1, 0], 6_000_000_000).unwrap();
    assert_eq!(turned.tracker_ns, Some(0), "a step back by less than half the range is no turn");
}

#[test]
fn a_wrong_file_says_where() {
    for (from, to, what) in [
        ("bytes = 14", "bytes = 12", "slot-place"),
        ("size = 4", "size = 9", "slot-size"),
        ("offset = 1,", "offset = 0,", "slot-place"),
        ("unit = \"mm\"", "unit = \"inch\"", "toml"),
        ("scale = 0.01 ", "scale = 0 ", "slot-scale"),
        ("[-5000, 5000]", "[5000, -5000]", "slot-range"),
        ("[left]", "[middle]", "toml"),
        ("offset = 5", "offset = 18446744073709551615", ""),
        ("offset = 5", "offset = 9223372036854775807", "slot-place"),
        ("bytes = 14", "bytes = 999999", "report-bytes"),
    ] {
        let error = DeviceFile::from_toml(&FILE.replace(from, to)).unwrap_err();
        assert_eq!(error.code(), what, "{error}");
    }
    assert!(DeviceFile::from_toml("vendor = 1\nproduct = 2\nbytes = 3\n").unwrap_err().code() == "no-position");
}
