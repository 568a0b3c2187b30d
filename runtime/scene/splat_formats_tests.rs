//! Tests that the formats of splats show the same, and that files that are not valid are refused with their fault.

use super::splats::{CONSTANT, Raw, ply, ply_with, psnr, random};
use super::*;
use flate2::write::GzEncoder;
use std::io::Write;
use std::path::Path;

/// Writes `.splat`, which has no harmonics.
fn plain(splats: &[Raw]) -> Vec<u8> {
    let byte = |v: f64| (v * 255.0).round().clamp(0.0, 255.0) as u8;
    let one = |splat: &Raw| {
        let norm = splat.turn.iter().map(|v| v * v).sum::<f64>().sqrt();
        let floats = splat.place.iter().copied().chain(splat.scale.iter().map(|v| v.exp()));
        let mut out: Vec<u8> = floats.flat_map(|v| (v as f32).to_le_bytes()).collect();
        out.extend(splat.harmonics[0].map(|v| byte(0.5 + CONSTANT * v)));
        out.push(byte(1.0 / (1.0 + (-splat.opacity).exp())));
        out.extend(splat.turn.map(|v| (v / norm * 128.0 + 128.0).round().clamp(0.0, 255.0) as u8));
        out
    };
    splats.iter().flat_map(one).collect()
}

/// The harmonics whose sign changes if y and z do, by their polynomials.
const ODD: [usize; 8] = [1, 2, 4, 7, 9, 11, 12, 14];

/// Writes the attributes of `.spz` one after the other, and their header. Its axes are x right, y up and z back.
fn spz(splats: &[Raw], version: u32, degree: usize) -> ([u8; 16], Vec<Vec<u8>>) {
    let byte = |v: f64| v.round().clamp(0.0, 255.0) as u8;
    let mut out = vec![Vec::new(); 6];
    for splat in splats {
        for v in [splat.place[0], -splat.place[1], -splat.place[2]] {
            if version == 1 {
                out[0].extend(half::f16::from_f64(v).to_le_bytes());
            } else {
                out[0].extend(&((v * 4096.0).round() as i32).to_le_bytes()[..3]);
            }
        }
        out[1].push(byte(255.0 / (1.0 + (-splat.opacity).exp())));
        out[2].extend(splat.harmonics[0].map(|v| byte((v * 0.15 + 0.5) * 255.0)));
        out[3].extend(splat.scale.map(|v| byte((v + 10.0) * 16.0)));
        let norm = splat.turn.iter().map(|v| v * v).sum::<f64>().sqrt();
        let [w, x, y, z] = splat.turn.map(|v| v / norm);
        let mut turn = [x, -y, -z, w];
        if version < 3 {
            let sign = w.signum();
            out[4].extend([0, 1, 2].map(|i| byte((turn[i] * sign + 1.0) * 127.5)));
        } else {
            let largest = (0..4).max_by(|a, b| turn[*a].abs().total_cmp(&turn[*b].abs())).unwrap();
            let sign = turn[largest].signum();
            turn = turn.map(|v| v * sign);
            let mut word = largest as u32;
            for v in (0..4).filter(|i| *i != largest).map(|i| turn[i]) {
                let size = (511.0 * v.abs() / std::f64::consts::FRAC_1_SQRT_2 + 0.5) as u32;
                word = word << 10 | u32::from(v < 0.0) << 9 | size;
            }
            out[4].extend(word.to_le_bytes());
        }
        for k in 1..(degree + 1) * (degree + 1) {
            let sign = if ODD.contains(&k) { -1.0 } else { 1.0 };
            out[5].extend(splat.harmonics[k].map(|v| byte(sign * v * 128.0 + 128.0)));
        }
    }
    let mut header = [0; 16];
    header[..4].copy_from_slice(b"NGSP");
    header[4..8].copy_from_slice(&version.to_le_bytes());
    header[8..12].copy_from_slice(&(splats.len() as u32).to_le_bytes());
    (header[12], header[13]) = (degree as u8, 12);
    (header, out)
}

/// Packs the attributes by gzip, in the versions 1 to 3.
fn packed(splats: &[Raw], version: u32, degree: usize) -> Vec<u8> {
    let (header, attributes) = spz(splats, version, degree);
    let mut out = GzEncoder::new(Vec::new(), flate2::Compression::default());
    out.write_all(&header).unwrap();
    attributes.iter().for_each(|bytes| out.write_all(bytes).unwrap());
    out.finish().unwrap()
}

/// Packs each attribute into blocks of Zstandard without compression, in version 4.
fn in_streams(splats: &[Raw], degree: usize) -> Vec<u8> {
    let (header, attributes) = spz(splats, 4, degree);
    let frame = |bytes: &Vec<u8>| {
        // A frame without checksum, with a window of 128 KiB, and raw blocks.
        let mut out = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x38];
        let blocks: Vec<&[u8]> = bytes.chunks(1 << 16).collect();
        for (i, block) in blocks.iter().enumerate() {
            let word = (block.len() as u32) << 3 | u32::from(i + 1 == blocks.len());
            out.extend(&word.to_le_bytes()[..3]);
            out.extend(*block);
        }
        out
    };
    let used = if degree == 0 { 5 } else { 6 };
    let frames: Vec<Vec<u8>> = attributes[..used].iter().map(frame).collect();
    let mut out = header.to_vec();
    out[15] = used as u8;
    out.extend(32u32.to_le_bytes());
    out.extend([0; 12]);
    for (frame, bytes) in frames.iter().zip(&attributes) {
        out.extend((frame.len() as u64).to_le_bytes());
        out.extend((bytes.len() as u64).to_le_bytes());
    }
    frames.iter().for_each(|frame| out.extend(frame));
    out
}

/// All formats and versions show the same scene, up to the few bits of their values.
#[test]
fn formats_show_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let mut splats = random(600, 3);
    // Harmonics of 8 bits are at most 1, and constant ones at most 1.77.
    splats.iter_mut().for_each(|s| s.scale.iter_mut().for_each(|v| *v = (*v * 16.0).round() / 16.0));
    let display = display(48, 48);
    let request = Request { views: 2, ..Request::new(&display, &ALL) };
    let view = |name: &str, bytes: Vec<u8>| {
        let file = folder.path().join(name);
        fs::write(&file, bytes).unwrap();
        get(&format!("{}?eye=0,0,0", file.display()), &request)
    };
    for degree in [0, 3] {
        let known = view("a.ply", ply(&splats, degree));
        let mut others = vec![
            ("b.spz", packed(&splats, 1, degree), 33.0),
            ("c.spz", packed(&splats, 2, degree), 33.0),
            ("d.spz", packed(&splats, 3, degree), 36.0),
        ];
        if cfg!(feature = "zstd") {
            others.push(("e.spz", in_streams(&splats, degree), 36.0));
        }
        if degree == 0 {
            others.push(("f.splat", plain(&splats), 36.0));
        }
        for (name, bytes, least) in others {
            let field = view(name, bytes);
            for (planes, own) in known.planes.iter().zip(&field.planes) {
                for (a, b) in planes.iter().zip(own) {
                    let found = psnr(b, a.iter().map(|v| f64::from(*v)));
                    assert!(found > least, "{name}, degree {degree}: {found:.1} dB");
                }
            }
        }
    }
}

/// Flat splats, and splats with a filter, are shown like the same splats with all deviations.
#[test]
fn other_methods_with_the_format_show_what_they_trained() {
    let folder = tempfile::tempdir().unwrap();
    let display = display(48, 48);
    let request = Request { views: 2, ..Request::new(&display, &ALL) };
    let view = |name: &str, bytes: Vec<u8>| {
        let file = folder.path().join(name);
        fs::write(&file, bytes).unwrap();
        get(&format!("{}?eye=0,0,0", file.display()), &request).planes.concat()
    };
    let alike = |name: &str, a: &[Vec<f32>], b: &[Vec<f32>]| {
        let found =
            a.iter().zip(b).map(|(a, b)| psnr(b, a.iter().map(|v| f64::from(*v)))).fold(f64::INFINITY, f64::min);
        println!("{name}: {found:.1} dB");
        found
    };
    // Gives a property another name.
    let renamed = |bytes: &[u8], from: &str, to: &str| {
        let end = bytes.windows(10).position(|w| w == b"end_header").unwrap();
        let head = std::str::from_utf8(&bytes[..end]).unwrap().replace(from, to);
        [head.as_bytes(), &bytes[end..]].concat()
    };
    let mut splats = random(400, 4);
    splats.iter_mut().for_each(|splat| splat.scale[2] = -40.0);
    let solid = view("solid.ply", ply(&splats, 1));
    let flat = view("flat.ply", renamed(&ply(&splats, 1), "float scale_2", "float unused"));
    assert!(alike("flat", &solid, &flat) > 90.0);

    let splats = random(400, 4);
    let filter = 0.04;
    let fused: Vec<Raw> = (splats.iter().cloned())
        .map(|splat| {
            let scale = splat.scale.map(|v| (v.exp().powi(2) + filter * filter).sqrt().ln());
            let share = (0..3).map(|k| splat.scale[k] - scale[k]).sum::<f64>().exp();
            let opacity = share / (1.0 + (-splat.opacity).exp());
            Raw { scale, opacity: (opacity / (1.0 - opacity)).ln(), ..splat }
        })
        .collect();
    let stated = renamed(&ply_with(&splats, 1, filter), "float nx", "float filter_3D");
    let (filtered, fused) = (view("filtered.ply", stated), view("fused.ply", ply(&fused, 1)));
    assert!(alike("filter", &fused, &filtered) > 80.0);
    assert!(alike("no filter", &view("bare.ply", ply(&splats, 1)), &filtered) < 40.0);
}

fn code_of(path: &Path, bytes: &[u8]) -> String {
    fs::write(path, bytes).unwrap();
    let display = display(16, 16);
    let error = load(path.to_str().unwrap(), &Request { views: 1, ..Request::new(&display, &GREEN) });
    ErrorData::of(&error.map(drop).unwrap_err()).code
}

#[test]
fn files_that_are_not_valid_are_refused_with_their_fault() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let splats = random(50, 5);
    let whole = ply(&splats, 1);
    let text = |from: &str, to: &str| {
        let end = whole.windows(10).position(|w| w == b"end_header").unwrap();
        let head = String::from_utf8(whole[..end].to_vec()).unwrap().replace(from, to);
        [head.as_bytes(), &whole[end..]].concat()
    };
    let mut damaged = splats.clone();
    damaged[48..].iter_mut().for_each(|splat| splat.opacity = f64::NAN);
    let cases = [
        ("a.ply", whole[..whole.len() - 1].to_vec(), "cut"),
        ("b.ply", text("vertex 50", "vertex 51"), "cut"),
        ("c.ply", text("vertex 50", "vertex 18446744073709551615"), "count"),
        ("d.ply", text("vertex 50", "vertex 0"), "no-splats"),
        ("e.ply", text("vertex 50", "vertex x"), "header"),
        ("f.ply", text("binary_little_endian", "ascii"), "encoding"),
        ("g.ply", text("element vertex 50", "element chunk 5\nelement vertex 50"), "compressed"),
        ("h.ply", text("rot_3", "other"), "no-property"),
        ("i.ply", text("f_rest_8", "other"), "harmonics"),
        ("j.ply", text("property float nx", "property list uchar int nx"), "header"),
        ("k.ply", whole[..60].to_vec(), "header"),
        ("l.splat", plain(&splats)[..33].to_vec(), "record"),
        ("m.splat", Vec::new(), "no-splats"),
        ("n.spz", packed(&splats, 3, 1)[..200].to_vec(), "cut"),
        ("o.spz", in_streams(&splats, 1)[..600].to_vec(), "streams"),
        ("p.spz", [&in_streams(&splats, 1)[..4], &[9; 60]].concat(), "version"),
        ("q.ply", ply(&damaged, 1), "damaged-splats"),
    ];
    for (name, bytes, code) in cases {
        assert_eq!(code_of(&at(name), &bytes), format!("corrupt/{code}"), "{name}");
    }
    let behind = ply(&random(20, 2).into_iter().map(|s| Raw { place: [0.0, 0.0, -5.0], ..s }).collect::<Vec<_>>(), 0);
    fs::write(at("r.ply"), behind).unwrap();
    let display = display(16, 16);
    let sees_nothing = load(&format!("{}?eye=0,0,0", at("r.ply").display()), &Request::new(&display, &GREEN));
    assert_eq!(ErrorData::of(&sees_nothing.unwrap_err()).code, "options/nothing-seen");
}
