//! Pictures and arrays with headers that state much more data than the file contains, or with data that expands to much
//! more than the size of the file.

use crate::case::{Case, Put};
use crate::ground::Ground;

const SIDES: [u32; 10] = [0, 1, 17, 4096, 8191, 16000, 20000, 65535, 1 << 20, u32::MAX];

/// Returns a run that reads a hostile picture, depth map, array or picture for an SLM.
pub fn case(ground: &Ground, rng: &mut fastrand::Rng) -> Case {
    let (h, w) = (SIDES[rng.usize(..SIDES.len())], SIDES[rng.usize(..SIDES.len())]);
    let of = |name: &str| ground.files[&format!("base/{name}")].clone();
    let (name, bytes) = match rng.u8(..10) {
        0 => ("a.png", png(&of("photo.png"), h, w, 2)),
        1 => ("a.jpg", jpeg(of("photo.jpg"), h, w, false)),
        2 => ("a.jpg", scans(of("photo.jpg"), h, w, rng.usize(1..5000))),
        3 => ("a.exr", exr(of("photo.exr"), h, w)),
        4 => ("a.bmp", bmp(of("photo.bmp"), h, w)),
        5 => ("a.pfm", format!("PF\n{w} {h}\n-1.0\n").into_bytes()),
        6 => ("a.npy", npy(h, w)),
        7 => ("a.tif", tiff(&of("photo.tif"), h, w)),
        8 => ("a.ppm", format!("P6\n{w} {h}\n65535\n").into_bytes()),
        _ => ("a.png", deflated(h.min(12000), w.min(12000))),
    };
    let file = format!("in/{name}");
    let runs = [
        format!(
            "solve {file} --depth-map base/depth.png --views 2 --size 16x16 --steps 1 --frames 1 --color green --engine cpu -o out/x.zarr"
        ),
        format!(
            "solve base/photo.png --depth-map {file} --near large --views 2 --size 16x16 --steps 1 --frames 1 --engine cpu -o out/x.zarr"
        ),
        "info in --size 16x16 -o out/views.png".into(),
        format!("info {file}?lenslets --size 16x16 -o out/views.png"),
        format!("info {file}?grid=2x3 --size 16x16 -o out/views.png"),
        format!(
            "render {file} --display small --size 16x16 --color green --phase-unit 256 --pupil=0,0,1,0 --engine cpu -o out/seen.png"
        ),
        format!(
            "render --encoded {file} --display grey8 --size 16x16 --color green --pupil=0,0,1,0 --engine cpu -o out/seen.png"
        ),
        format!(
            "show {file} --display grey8 --size 16x16 --color green --output offscreen --duration 0.05 --engine cpu"
        ),
        "encode base/h.zarr --display in/x.toml --engine cpu -o out/frames".into(),
    ];
    let run = &runs[rng.usize(..runs.len())];
    let display = crate::ground::BENCH
        .replace("flat.png", name)
        .replace("green.csv", "../base/bench/green.csv")
        .replace("flat.npy", name);
    let mut case = Case::of(&run.split(' ').collect::<Vec<_>>()).put("in/x.toml", Put::Bytes(display.into_bytes()));
    if run.starts_with("info ") {
        // The subject of `info` is a folder of nine views.
        let ending = name.split_once('.').map_or("", |(_, ending)| ending);
        for i in 0..9 {
            case = case.put(&format!("in/view_{i:02}.{ending}"), Put::Bytes(bytes.clone()));
        }
        return case;
    }
    case.put(&file, Put::Bytes(bytes))
}

/// Returns a TIFF whose table states other sides. Its first two entries are columns and rows.
fn tiff(of: &[u8], h: u32, w: u32) -> Vec<u8> {
    let mut bytes = of.to_vec();
    let at = u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]) as usize + 2;
    for (entry, side) in [(0, w), (1, h)] {
        bytes[at + 12 * entry + 8..at + 12 * entry + 12].copy_from_slice(&side.to_le_bytes());
    }
    bytes
}

/// Returns a chunk of a PNG with its length and its checksum.
fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let body = [kind, data].concat();
    let sum = body.iter().fold(u32::MAX, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |s, _| (s >> 1) ^ (0xedb8_8320 & 0u32.wrapping_sub(s & 1)))
    });
    [&(data.len() as u32).to_be_bytes()[..], &body, &(!sum).to_be_bytes()].concat()
}

/// Returns the PNG with another size in its header.
fn png(of: &[u8], h: u32, w: u32, color: u8) -> Vec<u8> {
    let header = [&w.to_be_bytes()[..], &h.to_be_bytes(), &[8, color, 0, 0, 0]].concat();
    // A PNG begins with a signature of 8 bytes and a header of 25 bytes.
    [&of[..8], &chunk(b"IHDR", &header), &of[33..]].concat()
}

/// Returns a PNG of black pixels, which stores 258 bytes of pixels in 13 bits.
fn deflated(h: u32, w: u32) -> Vec<u8> {
    // The stream uses fixed codes. After one zero, each code of 13 bits copies 258 bytes (code 285, distance 1).
    let total = u64::from(h) * (u64::from(w) + 1);
    let (mut out, mut word, mut count) = (vec![0x78, 0x01], 0u64, 0u32);
    let mut bits = |value: u64, n: u32, out: &mut Vec<u8>| {
        word |= value << count;
        count += n;
        while count >= 8 {
            out.push(word as u8);
            word >>= 8;
            count -= 8;
        }
    };
    bits(0b011, 3, &mut out);
    // Codes begin with their highest bit. 0x30 is a zero, 0xc5 is 258 bytes, and five zeros are the distance 1.
    bits(u64::from(0x30u8.reverse_bits()), 8, &mut out);
    for _ in 0..total.saturating_sub(1) / 258 {
        bits(u64::from(0xc5u8.reverse_bits()), 8, &mut out);
        bits(0, 5, &mut out);
    }
    for _ in 0..total.saturating_sub(1) % 258 {
        bits(u64::from(0x30u8.reverse_bits()), 8, &mut out);
    }
    bits(0, 7, &mut out);
    bits(0, 8, &mut out);
    // These bytes are the Adler-32 checksum of the zeros.
    out.extend((((total % 65521) as u32) << 16 | 1).to_be_bytes());
    let header = [&w.to_be_bytes()[..], &h.to_be_bytes(), &[8, 0, 0, 0, 0]].concat();
    [b"\x89PNG\r\n\x1a\n".to_vec(), chunk(b"IHDR", &header), chunk(b"IDAT", &out), chunk(b"IEND", &[])].concat()
}

/// Finds the frame header of a JPEG, which has a marker, a length, a precision, rows and columns.
fn frame(of: &[u8]) -> usize {
    of.windows(2).position(|w| w[0] == 0xff && (w[1] == 0xc0 || w[1] == 0xc2)).expect("a frame")
}

fn jpeg(mut of: Vec<u8>, h: u32, w: u32, progressive: bool) -> Vec<u8> {
    let at = frame(&of);
    of[at + 1] = if progressive { 0xc2 } else { 0xc0 };
    of[at + 5..at + 7].copy_from_slice(&(h as u16).to_be_bytes());
    of[at + 7..at + 9].copy_from_slice(&(w as u16).to_be_bytes());
    of
}

/// Returns a progressive JPEG with `count` scans, each of which passes over all pixels.
fn scans(of: Vec<u8>, h: u32, w: u32, count: usize) -> Vec<u8> {
    let of = jpeg(of, h.min(8191), w.min(8191), true);
    let at = of.windows(2).position(|w| w == [0xff, 0xda]).expect("a scan");
    // A scan codes only the lowest coefficient of one component.
    let scan = [0xff, 0xda, 0, 8, 1, 1, 0, 0, 0, 0, 0x55, 0x55];
    [&of[..at], &scan.repeat(count), &[0xff, 0xd9]].concat()
}

fn bmp(mut of: Vec<u8>, h: u32, w: u32) -> Vec<u8> {
    of[18..22].copy_from_slice(&w.to_le_bytes());
    of[22..26].copy_from_slice(&h.to_le_bytes());
    of
}

/// Changes both windows of an EXR, which are its attributes of the type `box2i`.
fn exr(mut of: Vec<u8>, h: u32, w: u32) -> Vec<u8> {
    let mark = b"box2i\0\x10\0\0\0";
    let places: Vec<usize> =
        of.windows(mark.len()).enumerate().filter(|(_, w)| w == mark).map(|(i, _)| i + mark.len()).collect();
    for at in places {
        of[at + 8..at + 12].copy_from_slice(&w.wrapping_sub(1).to_le_bytes());
        of[at + 12..at + 16].copy_from_slice(&h.wrapping_sub(1).to_le_bytes());
    }
    of
}

fn npy(h: u32, w: u32) -> Vec<u8> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({h}, {w}), }}\n");
    [b"\x93NUMPY\x01\0", &(header.len() as u16).to_le_bytes()[..], header.as_bytes()].concat()
}
