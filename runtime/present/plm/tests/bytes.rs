//! The byte vectors of the guide, of TI's program and of plmctrl.

use crate::plm::report::{read_request, received, reply, reply_report, write_request};
use crate::plm::table::{count, exposure_us, patterns, plane_of_bit, usual_leds};
use crate::plm::values::{Leds, Pattern, Versions, board, text};
use crate::plm::{Command, HardwareFault, HardwareStatus, MainStatus, PLANES, PlmError};
use eyebox_optics::PlaneTrigger;

fn padded(bytes: &[u8]) -> [u8; 64] {
    let mut report = [0; 64];
    report[..bytes.len()].copy_from_slice(bytes);
    report
}

/// The guide's examples read and write the color of the curtain, command 0x1100.
#[test]
fn reports_are_those_of_the_guide() {
    assert_eq!(read_request(0x1100, 0x11), padded(&[0xC0, 0x11, 0x02, 0, 0, 0x11]));
    let color = [0xFF, 0x01, 0xFF, 0x01, 0xFF, 0x01];
    let write = write_request(0x1100, 0x12, false, &color);
    assert_eq!(write, [padded(&[0x00, 0x12, 0x08, 0, 0, 0x11, 0xFF, 0x01, 0xFF, 0x01, 0xFF, 0x01])]);
    assert_eq!(write_request(0x1100, 0x12, true, &color)[0][0], 0x40);
    let bytes = padded(&[0xC0, 0x11, 0x06, 0, 0xFF, 0x01, 0xFF, 0x01, 0xFF, 0x01]);
    let read = reply(&bytes).unwrap();
    assert_eq!((read.sequence, read.is_error, read.length, &read.data[..]), (0x11, false, 6, &color[..]));
    assert!(reply(&padded(&[0xE0, 0x11, 0, 0])).unwrap().is_error);
    // The command for the mode is 1B 1A on the wire.
    assert_eq!(read_request(Command::Mode.code(), 3)[4..6], [0x1B, 0x1A]);
    // The device reads the same bytes, and its reply equals the guide's.
    let command = received(&read_request(0x1100, 0x11)).unwrap();
    assert!(command.reads && command.wants_reply && command.code == 0x1100 && command.data.is_empty());
    assert_eq!(reply_report(&command, false, &color), bytes);
    assert!(received(&[0xFF; 64]).is_none() && received(&[0; 64]).is_none());
}

#[test]
fn long_data_continues_without_a_header() {
    let data: Vec<u8> = (0..130).collect();
    let reports = write_request(0x1A34, 9, true, &data);
    assert_eq!(reports.len(), 3);
    assert_eq!((reports[0][2], reports[0][3]), (132, 0));
    assert_eq!((&reports[0][6..], &reports[1][..]), (&data[..58], &data[58..122]));
    assert_eq!((&reports[2][..8], &reports[2][8..]), (&data[122..], &[0; 56][..]));
}

#[test]
fn replies_shorter_than_their_header_or_length_do_no_harm() {
    for bytes in 0..4 {
        assert_eq!(reply(&[0xC0; 4][..bytes]), None);
    }
    let short = reply(&[0xC0, 1, 200, 0, 7]).unwrap();
    assert_eq!((short.length, short.data), (200, vec![7]));
}

/// Entries 0, 1, 8 and 23 of plmctrl's table for DisplayPort, sequence number 1, without acknowledgement.
#[test]
fn the_table_is_that_of_plmctrl() {
    let exposure = exposure_us(60.0).unwrap();
    assert_eq!((exposure, exposure_us(30.0).unwrap()), (694, 1388));
    let all = patterns(exposure, &usual_leds(), PlaneTrigger::Plane);
    let bytes = |index: usize| write_request(0x1A34, 1, false, &all[index].bytes())[0];
    let head = [0x00, 0x01, 0x0E, 0x00, 0x34, 0x1A];
    let entry = |data: [u8; 12]| padded(&[&head[..], &data].concat());
    assert_eq!(bytes(0), entry([0, 0, 0xB6, 2, 0, 0xA0, 0, 0, 0, 0, 0, 0]));
    assert_eq!(bytes(1), entry([1, 0, 0xB6, 2, 0, 0x20, 0, 0, 0, 0, 0, 0x08]));
    assert_eq!(bytes(8), entry([8, 0, 0xB6, 2, 0, 0x10, 0, 0, 0, 0, 0, 0x40]));
    assert_eq!(bytes(23), entry([23, 0, 0xB6, 2, 0, 0x40, 0, 0, 0, 0, 0, 0xB8]));
    let table = write_request(0x1A31, 1, false, &count(PLANES as u16));
    assert_eq!(table, [padded(&[0, 1, 8, 0, 0x31, 0x1A, 0x18, 0, 0, 0, 0, 0])]);
    assert_eq!(write_request(0x1A24, 1, false, &[2]), [padded(&[0, 1, 3, 0, 0x24, 0x1A, 2])]);
}

/// The guide's example has two patterns. Its text says two bits for the second, and its bytes say one bit and clear.
#[test]
fn the_example_of_the_guide_is_read_and_written() {
    let first = [0, 0, 0xC8, 0, 0, 0x90, 0, 0, 0, 0, 0, 0];
    let second = [1, 0, 0x90, 1, 0, 0x21, 0, 0, 0, 0, 0, 0x08];
    let red = Pattern {
        index: 0,
        exposure_us: 200,
        dark_us: 0,
        clears: false,
        depth: 1,
        leds: Leds::RED,
        waits: true,
        trigger_out_2: true,
        plane: 0,
    };
    let green = Pattern { index: 1, exposure_us: 400, clears: true, leds: Leds::GREEN, waits: false, plane: 1, ..red };
    assert_eq!((red.bytes(), green.bytes()), (first, second));
    assert_eq!((Pattern::of(&first), Pattern::of(&second)), (red, green));
    assert_eq!(count(2), [2, 0, 0, 0, 0, 0]);
    // Bit 0 of byte 9 disables TRIG_OUT_2, and bit 1 adds 8 to the depth.
    let quiet = Pattern { trigger_out_2: false, ..red };
    assert_eq!((quiet.bytes()[9], red.bytes()[9]), (1, 0));
    let deep = Pattern { depth: 16, dark_us: 0x0001_0203, leds: Leds::ALL, ..quiet };
    assert_eq!(deep.bytes()[5..10], [0xFE, 0x03, 0x02, 0x01, 0x03]);
    assert_eq!((Pattern::of(&deep.bytes()), Pattern::of(&quiet.bytes())), (deep, quiet));
}

#[test]
fn exposures_fit_the_frame_of_the_real_rate() {
    // 24 x 694 us fit a video frame up to 60.038 Hz, and 24 x 1388 us up to 30.019 Hz.
    for rate in [1.0, 23.976, 29.97, 30.0, 30.02, 59.94, 60.0, 60.03, 60.039, 60.1, 61.0, 120.0, 1000.0] {
        let exposure = f64::from(exposure_us(rate).unwrap());
        assert!(24.0 * exposure <= 1e6 / rate, "{rate}: {exposure}");
        assert!(24.0 * (exposure + 1.2) > 1e6 / rate * 0.9999, "{rate}: {exposure} is not the longest");
    }
    assert_eq!([60.03, 60.039, 30.02].map(|rate| exposure_us(rate).unwrap()), [694, 693, 1387]);
    for rate in [0.0, -60.0, f64::NAN, f64::INFINITY, 1e9] {
        assert!(matches!(exposure_us(rate), Err(PlmError::Rate { .. })), "{rate}");
    }
}

#[test]
fn planes_are_numbered_green_red_blue() {
    // The first bits of green and red, and the last bit of blue.
    assert_eq!([8, 0, 23].map(plane_of_bit), [0, 8, 23]);
    for number in 0..PLANES {
        assert_eq!(plane_of_bit(plane_of_bit(number)), number);
    }
}

#[test]
fn statuses_versions_and_texts_are_read() {
    assert_eq!(HardwareStatus(0x01).fault(), None);
    // The second controller is ready, and a frame was aborted. Neither is a fault of the hardware.
    assert!(HardwareStatus(0x51).fault().is_none() && HardwareStatus(0x51).has_aborted());
    let faults = [
        (0x00, HardwareFault::NotInitialized),
        (0x03, HardwareFault::WrongHardware),
        (0x05, HardwareFault::ResetController),
        (0x09, HardwareFault::ForcedSwap),
        (0x81, HardwareFault::Sequencer),
    ];
    for (status, fault) in faults {
        assert_eq!(HardwareStatus(status).fault(), Some(fault));
    }
    assert!(MainStatus(0x0A).is_running() && MainStatus(0x0A).is_locked());
    assert!(!MainStatus(0x05).is_running() && !MainStatus(0x05).is_locked());
    let versions = Versions::of(&[3, 1, 2, 6, 0, 0, 1, 4, 5, 0, 0, 0, 6, 0, 7, 8]);
    assert_eq!(versions.application.to_string(), "6.2.259");
    assert_eq!((versions.api.major, versions.api.minor), (4, 1));
    assert_eq!((versions.configuration.patch, versions.sequence.major), (5, 8));
    assert_eq!((board(3), board(5), board(0), board(99)), ("DLP670S", "DLP5500", "unknown", "unknown"));
    assert_eq!(text(b"PLM\xff 1\0junk"), "PLM 1");
}

#[test]
fn the_codes_of_commands_are_those_of_the_guide() {
    let codes: Vec<u16> = Command::ALL.iter().map(|command| command.code()).collect();
    let expected = [
        0x0100, 0x0101, 0x0200, 0x0205, 0x0206, 0x1008, 0x1009, 0x1A00, 0x1A01, 0x1A03, 0x1A0A, 0x1A0C, 0x1A1B, 0x1A24,
        0x1A30, 0x1A31, 0x1A34, 0x1A36, 0x1A37, 0x1A3B, 0x1A42,
    ];
    assert_eq!(codes, expected);
    assert!(Command::ALL.iter().all(|command| Command::of_code(command.code()) == Some(*command)));
    assert_eq!(Command::of_code(0x1A2B), None);
}
