//! Tests the parsing of descriptors.

use super::super::descriptor::{LONGEST_DESCRIPTOR, ReportKind, Usage};
use super::super::{Description, Descriptor, Layout};
use super::{Build, tracker};
use crate::trackers::hid::HidError;

fn parse(build: Build) -> Descriptor {
    Descriptor::parse(&build.0).unwrap()
}

#[test]
fn an_eye_tracker_has_its_fields_units_and_sizes() {
    let descriptor = Descriptor::parse(&tracker()).unwrap();
    use ReportKind::{Feature, Input};
    assert_eq!(descriptor.reports(), [(Input, 0x10, 65), (Input, 0x13, 2), (Feature, 0x13, 4), (Feature, 0x14, 2)]);
    assert!(descriptor.notes.is_empty(), "{:?}", descriptor.notes);
    let description = Description::of(&tracker()).unwrap();
    assert!(description.eye_tracker && description.reason.is_none() && description.notes.is_empty());
    let fields = &description.reports[0].fields;
    let of = |i: usize| {
        let f = &fields[i];
        (f.byte, f.bits, f.count, f.unit.as_str(), f.signed, f.constant, f.usages.join("/"), f.path.join("/"))
    };
    let data = |name: &str| format!("Eye Tracker/Tracking Data{name}");
    assert_eq!(of(0), (1, 8, 8, "us", false, false, "Sensor Timestamp".into(), data("")));
    assert_eq!(of(1), (9, 32, 2, "um", true, true, "Position X/Position Y".into(), data("/Gaze Point")));
    let xyz = "Position X/Position Y/Position Z";
    assert_eq!(of(2), (17, 32, 3, "um", true, true, xyz.into(), data("/Left Eye Position")));
    assert_eq!(of(3), (29, 32, 3, "um", true, true, xyz.into(), data("/Right Eye Position")));
    assert_eq!(of(4), (41, 32, 6, "um", true, true, String::new(), data("")));
    assert_eq!(fields[1].logical, [-2_000_000, 2_000_000]);
    assert_eq!(description.reports[2].fields[1].unit, "Hz");
    let text = description.to_string();
    assert!(text.contains("0x10") && text.contains("65 bytes"), "{text}");
}

#[test]
fn what_is_no_eye_tracker_is_told_so() {
    let touch = Build::default().page(0x0d).usage(0x04).open(1).usage(0x22).open(2).usage(0x42).logical(0, 1);
    let touch = touch.size(1, 1).input(2).size(7, 1).input(3).close().close().0;
    let description = Description::of(&touch).unwrap();
    assert!(!description.eye_tracker);
    assert!(description.to_string().contains("Touch Screen"));
    // The first is a head tracker alone, the second an eye tracker without positions.
    let head = Build::default().page(0x12).usage(0x02).open(1).position(0x27, 3).close().0;
    assert!(!Description::of(&head).unwrap().eye_tracker);
    let mute = Build::default().page(0x12).usage(0x01).open(1).usage(0x400).size(8, 1).feature(2).close().0;
    assert!(Description::of(&mute).unwrap().reason.is_some());
}

#[test]
fn globals_stay_locals_go_and_pushes_are_popped() {
    let build = Build::default().page(1).size(8, 2).logical(-5, 5).usage(0x30).usage(0x31).input(2).push();
    let build = build
        .page(9)
        .size(1, 3)
        .logical(0, 1)
        .item(0x18, 1)
        .item(0x28, 3)
        .input(2)
        .size(5, 1)
        .input(3)
        .pop()
        .usage(0x32)
        .input(2);
    let descriptor = parse(build);
    let f = &descriptor.fields;
    assert_eq!((f[0].usage(0), f[0].usage(1), f[0].usage(7)), (usage(1, 0x30), usage(1, 0x31), usage(1, 0x31)));
    assert_eq!((f[1].usage(0), f[1].usage(2), f[1].offset), (usage(9, 1), usage(9, 3), 16));
    assert_eq!((f[2].usage(0), f[2].offset), (None, 19));
    assert_eq!((f[3].usage(0), f[3].offset, f[3].count, f[3].logical), (usage(1, 0x32), 24, 2, [-5, 5]));
    assert!(!descriptor.numbered);
    assert_eq!(descriptor.reports(), [(ReportKind::Input, 0, 5)]);
}

fn usage(page: u16, id: u16) -> Option<Usage> {
    Some(Usage { page, id })
}

#[test]
fn the_page_that_holds_at_the_main_item_counts_and_four_bytes_bring_their_own() {
    // The item 0x0b is a usage of four bytes.
    let mut build = Build::default().page(1).usage(0x21);
    build.0.extend([0x0b, 0x22, 0, 0x0c, 0]);
    let descriptor = parse(build.page(0x12).size(8, 2).input(2));
    assert_eq!((descriptor.fields[0].usage(0), descriptor.fields[0].usage(1)), (usage(0x12, 0x21), usage(0x0c, 0x22)));
    // The first one of alternatives counts.
    let build =
        Build::default().page(1).item(0xa8, 1).usage(0x30).usage(0x31).item(0xa8, 0).usage(0x32).size(8, 2).input(2);
    let descriptor = parse(build);
    assert_eq!((descriptor.fields[0].usage(0), descriptor.fields[0].usage(1)), (usage(1, 0x30), usage(1, 0x32)));
}

#[test]
fn ranges_and_exponents_are_read_as_devices_write_them() {
    // The bytes 25 ff after 15 00 mean 255, and after 15 80 they mean -1.
    let mut build = Build::default().size(8, 1);
    build.0.extend([0x15, 0x00, 0x25, 0xff]);
    let mut build = build.page(1).usage(0x30).input(2);
    build.0.extend([0x15, 0x80, 0x25, 0xff, 0x55, 0xfa]);
    let descriptor = parse(build.usage(0x30).input(2).unit(0x11, -4).input(2));
    assert_eq!((descriptor.fields[0].logical, descriptor.fields[1].logical), ([0, 255], [-128, -1]));
    assert_eq!((descriptor.fields[1].exponent, descriptor.fields[2].exponent), (-6, -4));
}

#[test]
fn a_physical_range_scales() {
    // The range 0 to 1000 means -50 to 50 mm.
    let build = Build::default().page(0x12).usage(1).open(1).logical(0, 1000).physical(-50, 50).unit(0x11, -1);
    let layout = Layout::find(&parse(build.position(0x24, 2).close())).unwrap();
    let slot = layout.inputs[0].places[0].axes[0].unwrap();
    let at = |raw: u32| slot.value(&raw.to_le_bytes()).map(|v| (v * 1e9).round() / 1e9);
    assert_eq!((at(0), at(500), at(1000), at(1001)), (Some(-0.05), Some(0.0), Some(0.05), None));
}

#[test]
fn odd_items_become_notes() {
    let mut bytes = tracker();
    bytes.push(0x00); // a stray byte, as in descriptors of recorded devices
    let with_stray = Descriptor::parse(&bytes).unwrap();
    assert_eq!(with_stray.fields, Descriptor::parse(&tracker()).unwrap().fields);
    assert_eq!(with_stray.notes.len(), 1);
    bytes.pop();
    bytes.extend([0xfe, 2, 0x10, 0xaa, 0xbb, 0xc0, 0xb4, 0xfc, 0x27, 1, 2]); // long, end, pop, reserved, cut short
    let odd = Descriptor::parse(&bytes).unwrap();
    assert_eq!((odd.fields.len(), odd.notes.len()), (with_stray.fields.len(), 5), "{:?}", odd.notes);
    assert!(Layout::find(&odd).is_ok());
    // The collections are never closed.
    assert!(Descriptor::parse(&tracker()[..100]).unwrap().notes.len() == 1);
}

#[test]
fn what_would_need_too_much_is_refused() {
    let refused = |bytes: &[u8], what: &str| {
        let Err(HidError::Descriptor { reason, .. }) = Descriptor::parse(bytes) else { panic!("{what}") };
        assert_eq!(reason.code(), what, "{reason}");
    };
    refused(&[], "empty");
    refused(&vec![0; LONGEST_DESCRIPTOR + 1], "length");
    refused(&Build::default().size(0x7fff_ffff, 0x7fff_ffff).input(2).0, "report-size");
    refused(&Build::default().size(32, 4096).input(2).input(2).0, "report-size");
    refused(&[0xa1, 0x01].repeat(65), "collections");
    refused(&[0xa4].repeat(65), "pushes");
}
