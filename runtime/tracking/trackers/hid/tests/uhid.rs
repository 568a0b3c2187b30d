//! Tests a virtual device of the kernel through real hidraw, if the machine has them.

use super::super::{HidSource, list, system_bus};
use super::{report, tracker};
use crate::trackers::{Event, Source};
use std::fs::File;
use std::io::{Read, Write};
use std::time::{Duration, Instant};

const CREATE2: u32 = 11;
const INPUT2: u32 = 12;
const DESTROY: u32 = 1;
const GET_REPORT: u32 = 9;
const GET_REPORT_REPLY: u32 = 10;
const SET_REPORT: u32 = 13;
const SET_REPORT_REPLY: u32 = 14;
/// `struct uhid_event` (linux/uhid.h), with its type and its largest payload, which is the one of CREATE2.
const EVENT: usize = 4 + 4372;
const NAME: &[u8] = b"eyebox virtual tracker";

fn event(kind: u32, payload: &[u8]) -> Vec<u8> {
    let mut out = kind.to_le_bytes().to_vec();
    out.extend_from_slice(payload);
    out.resize(EVENT, 0);
    out
}

/// The fields are name 128, phys 64, uniq 64, rd_size u16, bus u16, vendor, product, version, country u32, rd_data.
fn create() -> Vec<u8> {
    let mut payload = NAME.to_vec();
    payload.resize(256, 0);
    payload.extend((tracker().len() as u16).to_le_bytes());
    payload.extend(3u16.to_le_bytes());
    for value in [0xe4eb_u32, 0x0001, 1, 0] {
        payload.extend(value.to_le_bytes());
    }
    payload.extend(tracker());
    event(CREATE2, &payload)
}

fn input(bytes: &[u8]) -> Vec<u8> {
    event(INPUT2, &[&(bytes.len() as u16).to_le_bytes(), bytes].concat())
}

#[test]
fn a_virtual_device_is_found_started_and_read() {
    let opened = File::options().read(true).write(true).open("/dev/uhid");
    let Ok(mut device) = opened else {
        println!("not run: no virtual HID device on this machine (/dev/uhid: {})", opened.unwrap_err());
        return;
    };
    device.write_all(&create()).expect("the kernel takes the device");
    let mut kernel = device.try_clone().unwrap();
    // The device's side answers status and mode, then sends.
    let side = std::thread::spawn(move || {
        let mut asked = false;
        let mut bytes = vec![0; EVENT];
        while let Ok(4..) = kernel.read(&mut bytes) {
            let kind = u32::from_le_bytes(bytes[..4].try_into().unwrap());
            let id = bytes[4..8].to_vec();
            match kind {
                GET_REPORT => {
                    let answer = [&id[..], &[0, 0, 4, 0], &[0x13, 1, 120, 0]].concat();
                    kernel.write_all(&event(GET_REPORT_REPLY, &answer)).unwrap();
                }
                SET_REPORT => {
                    asked |= bytes[8] == 0x14;
                    kernel.write_all(&event(SET_REPORT_REPLY, &[&id[..], &[0, 0]].concat())).unwrap();
                    for i in 0..20 {
                        kernel
                            .write_all(&input(&report(i * 1000, [7, 0, -32_000, 0, 600_000, 32_000, 0, 600_000])))
                            .unwrap();
                    }
                }
                _ => {}
            }
            if asked {
                break;
            }
        }
        asked
    });
    let until = Instant::now() + Duration::from_secs(20);
    let mut source = HidSource::new(system_bus().unwrap(), None, 0);
    let mut seen = None;
    while seen.is_none() && Instant::now() < until {
        if let Event::Sample(sample, _) = source.next(Duration::from_millis(100)).unwrap() {
            seen = Some(sample);
        }
    }
    let seen = seen.expect("a sample through hidraw");
    assert!((seen.combined.unwrap().position[0] - 7e-6).abs() < 1e-12 && seen.left.unwrap().valid);
    assert!(side.join().unwrap(), "the mode was set");
    let listed = list(system_bus().unwrap().as_mut(), None).unwrap();
    assert!(listed.iter().any(|d| d.info.vendor == 0xe4eb && d.tracker.is_ok()));
    device.write_all(&event(DESTROY, &[])).unwrap();
    let mut lost = false;
    while !lost && Instant::now() < until {
        lost = matches!(source.next(Duration::from_millis(100)).unwrap(), Event::Note(_))
            && source.recording_head().is_none();
    }
    assert!(lost, "pulled out");
}
