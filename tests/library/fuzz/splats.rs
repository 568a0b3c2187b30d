//! Damages files of splats in every format and version, also before their compression.

use super::{damage, display, edit, fuzz, sound, sound_or_refused};
use eyebox::low_level::optics::Color;
use eyebox::low_level::scene::{self, Request};
use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;
use std::fs;
use std::io::Write;

/// Number of splats of a file.
const COUNT: usize = 40;

/// Returns the value of a splat, from -1 to 1.
fn value(splat: usize, which: usize) -> f32 {
    ((splat * 37 + which * 91) % 101) as f32 / 50.0 - 1.0
}

fn ply() -> Vec<u8> {
    let names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"];
    let turn = ["rot_0", "rot_1", "rot_2", "rot_3"];
    let rest: Vec<String> = (0..9).map(|i| format!("f_rest_{i}")).collect();
    let all: Vec<&str> = names.into_iter().chain(turn).chain(rest.iter().map(String::as_str)).collect();
    let properties: String = all.iter().map(|name| format!("property float {name}\n")).collect();
    let mut out = format!("ply\nformat binary_little_endian 1.0\nelement vertex {COUNT}\n{properties}end_header\n");
    let mut bytes = std::mem::take(&mut out).into_bytes();
    for splat in 0..COUNT {
        bytes.extend((0..all.len()).flat_map(|which| {
            let value = value(splat, which);
            if (7..10).contains(&which) { value - 2.0 } else { value }.to_le_bytes()
        }));
    }
    bytes
}

pub(super) fn plain() -> Vec<u8> {
    let one = |splat: usize| {
        let floats = (0..6).map(move |which| value(splat, which));
        let mut out: Vec<u8> = floats.flat_map(|v| (v.abs() * 0.3).to_le_bytes()).collect();
        out.extend((6..14).map(|which| (value(splat, which) * 127.0 + 128.0) as u8));
        out
    };
    (0..COUNT).flat_map(one).collect()
}

/// Returns the header of `.spz`, and the attributes of all splats with harmonics of degree 1.
fn spz(version: u8) -> (Vec<u8>, Vec<Vec<u8>>) {
    let header = [&b"NGSP"[..], &[version, 0, 0, 0, COUNT as u8, 0, 0, 0, 1, 6, 0, 6]].concat();
    let sizes = [if version == 1 { 6 } else { 9 }, 1, 3, 3, if version < 3 { 3 } else { 4 }, 9];
    let attribute = |(which, size): (usize, usize)| {
        let byte = |i: usize| match which {
            // Half floats have a small exponent, and fixed point numbers are small.
            0 if version == 1 && i % 2 == 1 => (i * 53) as u8 & 0x3f,
            0 if version > 1 && i % 3 == 2 => 0,
            _ => (i * 53 + which * 29) as u8,
        };
        (0..COUNT * size).map(|i| if which == 3 { 120 + byte(i) % 16 } else { byte(i) }).collect()
    };
    (header, sizes.into_iter().enumerate().map(attribute).collect())
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = GzEncoder::new(Vec::new(), Compression::fast());
    out.write_all(bytes).expect("memory");
    out.finish().expect("memory")
}

/// Returns a file of version 4, whose streams are single blocks that are not compressed.
fn streams() -> Vec<u8> {
    let (header, attributes) = spz(4);
    let frame = |bytes: &Vec<u8>| {
        let head = ((bytes.len() as u32) << 3 | 1).to_le_bytes();
        [&[0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x38][..], &head[..3], bytes].concat()
    };
    let frames: Vec<Vec<u8>> = attributes.iter().map(frame).collect();
    let mut out = [&header[..], &[32], &[0; 15]].concat();
    for (frame, bytes) in frames.iter().zip(&attributes) {
        out.extend([(frame.len() as u64).to_le_bytes(), (bytes.len() as u64).to_le_bytes()].concat());
    }
    out.extend(frames.concat());
    out
}

#[test]
fn files_of_splats() {
    let temp = tempfile::tempdir().expect("a folder");
    let whole = |version: u8| {
        let (header, attributes) = spz(version);
        [header, attributes.concat()].concat()
    };
    // The true is for files that are damaged before their compression.
    let kinds = [
        ("a.ply", false, ply()),
        ("b.splat", false, plain()),
        ("c.spz", false, gzip(&whole(3))),
        ("d.spz", true, whole(1)),
        ("e.spz", true, whole(2)),
        ("f.spz", true, whole(3)),
        ("g.spz", false, streams()),
    ];
    let display = display();
    let request = Request { views: 2, ..Request::new(&display, &[Color::Green]) };
    let written = |name: &str, packed: bool, bytes: Vec<u8>| {
        let file = temp.path().join(name);
        fs::write(&file, if packed { gzip(&bytes) } else { bytes }).expect("written");
        file.display().to_string()
    };
    for (name, packed, bytes) in &kinds {
        let field = scene::load(&written(name, *packed, bytes.clone()), &request);
        sound(&field.unwrap_or_else(|e| panic!("{name}: {e}"))).expect("sound");
    }
    let query = "eye=0,0,-4&at=0,0,0&fov=40";
    let cases = (0..kinds.len(), any::<bool>(), prop::collection::vec(edit(), 1..6));
    fuzz("files of splats", cases, |(which, options, edits)| {
        let (name, packed, bytes) = &kinds[which];
        let (bytes, query) = if options {
            (bytes.clone(), damage(query.as_bytes().to_vec(), &edits))
        } else {
            (damage(bytes.clone(), &edits), Vec::new())
        };
        let source = written(name, *packed, bytes);
        // A name may have any character, but a message has one line if the name has one.
        let query = String::from_utf8_lossy(&query).replace(char::is_control, " ");
        sound_or_refused(scene::load(&format!("{source}?{query}"), &request))
    });
}
