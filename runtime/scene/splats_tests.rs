//! Tests views of splats against float64, with every splat at every pixel, and the three formats against each other.

use super::*;
use flate2::write::GzEncoder;
use std::io::Write;
use std::path::Path;

/// One splat in float64, with x to the right, y downwards and z forward.
#[derive(Debug, Clone)]
struct Raw {
    place: [f64; 3],
    /// Logarithms of the deviations.
    scale: [f64; 3],
    /// Quaternion (w, x, y, z).
    turn: [f64; 4],
    /// Logit of the opacity.
    opacity: f64,
    /// Harmonics, as (harmonic, color).
    harmonics: Vec<[f64; 3]>,
}

/// Returns random splats of degree 3 in a box of 2 x 2 x 2 around (0, 0, 3), with a wall behind them.
fn random(count: usize, seed: u64) -> Vec<Raw> {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut one = |i: usize| {
        let mut signed = |size: f64| size * (2.0 * random.f64() - 1.0);
        let is_wall = i.is_multiple_of(4);
        let place = [signed(1.2), signed(1.2), if is_wall { 4.0 } else { 3.0 + signed(0.8) }];
        let size = if is_wall { -1.6 } else { -3.0 };
        let scale = [size + signed(0.7), size + signed(0.7), size + signed(0.7)];
        let turn = [signed(1.0), signed(1.0), signed(1.0), signed(1.0)];
        let harmonics = (0..16).map(|k| [0; 3].map(|_| if k == 0 { signed(1.5) } else { signed(0.2) })).collect();
        Raw { place, scale, turn, opacity: signed(4.0), harmonics }
    };
    (0..count).map(&mut one).collect()
}

/// Writes the format of 3D Gaussian splatting with harmonics up to a degree.
fn ply(splats: &[Raw], degree: usize) -> Vec<u8> {
    let rest = (degree + 1) * (degree + 1) - 1;
    let mut names: Vec<String> =
        ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(String::from).to_vec();
    names.extend((0..3 * rest).map(|i| format!("f_rest_{i}")));
    names.extend(["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"].map(String::from));
    let properties: String = names.iter().map(|name| format!("property float {name}\n")).collect();
    let count = splats.len();
    let mut out =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n").into_bytes();
    for splat in splats {
        let mut values = splat.place.to_vec();
        values.extend([0.0; 3]);
        values.extend(splat.harmonics[0]);
        (0..3).for_each(|color| values.extend((0..rest).map(|k| splat.harmonics[k + 1][color])));
        values.push(splat.opacity);
        values.extend(splat.scale);
        values.extend(splat.turn);
        out.extend(values.iter().flat_map(|v| (*v as f32).to_le_bytes()));
    }
    out
}

const CONSTANT: f64 = 0.282_094_791_773_878_14;

/// Returns the color of a splat in a direction, with the harmonics of 3D Gaussian splatting.
fn color(splat: &Raw, degree: usize, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let pi = std::f64::consts::PI;
    let (c1, c2) = ((3.0 / (4.0 * pi)).sqrt(), (15.0 / (4.0 * pi)).sqrt());
    let (c3a, c3b, c3c) = ((35.0 / (32.0 * pi)).sqrt(), (105.0 / (4.0 * pi)).sqrt(), (21.0 / (32.0 * pi)).sqrt());
    let basis = [
        CONSTANT,
        -c1 * y,
        c1 * z,
        -c1 * x,
        c2 * x * y,
        -c2 * y * z,
        (5.0 / (16.0 * pi)).sqrt() * (2.0 * zz - xx - yy),
        -c2 * x * z,
        c2 / 2.0 * (xx - yy),
        -c3a * y * (3.0 * xx - yy),
        c3b * x * y * z,
        -c3c * y * (4.0 * zz - xx - yy),
        (7.0 / (16.0 * pi)).sqrt() * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -c3c * x * (4.0 * zz - xx - yy),
        c3b / 2.0 * z * (xx - yy),
        -c3a * x * (xx - 3.0 * yy),
    ];
    let used = (degree + 1) * (degree + 1);
    [0, 1, 2].map(|k| (0.5 + (0..used).map(|i| basis[i] * splat.harmonics[i][k]).sum::<f64>()).max(0.0))
}

/// Returns (red, green, blue, inverse distance, coverage) of every pixel. The camera is at `by` on the plane z = 0, and
/// its picture is moved by `moved` pixels. Every splat is tried at every pixel, in the order of this view.
fn exact(
    splats: &[Raw],
    degree: usize,
    focal: f64,
    [height, width]: [usize; 2],
    by: [f64; 2],
    moved: [f64; 2],
) -> Vec<[f64; 5]> {
    let mut order: Vec<usize> = (0..splats.len()).collect();
    order.sort_by(|a, b| splats[*a].place[2].total_cmp(&splats[*b].place[2]));
    let flat: Vec<_> = order
        .iter()
        .map(|i| {
            let splat = &splats[*i];
            let [x, y, z] = [splat.place[0] - by[0], splat.place[1] - by[1], splat.place[2]];
            let norm = splat.turn.iter().map(|v| v * v).sum::<f64>().sqrt();
            let [w, a, b, c] = splat.turn.map(|v| v / norm);
            // The columns are the axes of the splat, by turning each unit vector.
            let turn = |v: [f64; 3]| {
                let cross = |p: [f64; 3], q: [f64; 3]| {
                    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
                };
                let t = cross([a, b, c], v).map(|v| 2.0 * v);
                let u = cross([a, b, c], t);
                [0, 1, 2].map(|k| v[k] + w * t[k] + u[k])
            };
            // Each axis of the splat moves the pixel by its derivative. It is constant beyond 1.3 half pictures.
            let [u, v] = [(x, width), (y, height)].map(|(x, n)| {
                let most = 1.3 * n as f64 / 2.0 / focal;
                (x / z).clamp(-most, most)
            });
            let (mut xx, mut xy, mut yy) = (0.3, 0.0, 0.3);
            for k in 0..3 {
                let mut unit = [0.0; 3];
                unit[k] = splat.scale[k].exp();
                let [p, q, r] = turn(unit);
                let [right, down] = [focal / z * (p - u * r), focal / z * (q - v * r)];
                (xx, xy, yy) = (xx + right * right, xy + right * down, yy + down * down);
            }
            let length = (x * x + y * y + z * z).sqrt();
            let color = color(splat, degree, [x / length, y / length, z / length]);
            let center = [
                focal * x / z + (width as f64 - 1.0) / 2.0 + moved[0],
                focal * y / z + (height as f64 - 1.0) / 2.0 + moved[1],
            ];
            (center, [xx, xy, yy], 1.0 / (1.0 + (-splat.opacity).exp()), color, 1.0 / z)
        })
        .collect();
    let pixel = |i: usize| {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        let (mut sum, mut clear) = ([0.0; 5], 1.0);
        for ([cx, cy], [xx, xy, yy], opacity, color, inverse) in &flat {
            let (dx, dy) = (x - cx, y - cy);
            let distance = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy);
            let alpha = (opacity * (-0.5 * distance).exp()).min(0.99);
            if alpha < 1.0 / 255.0 {
                continue;
            }
            if clear * (1.0 - alpha) < 1e-4 {
                break;
            }
            (0..3).for_each(|k| sum[k] += alpha * clear * color[k]);
            sum[3] += alpha * clear * inverse;
            sum[4] += alpha * clear;
            clear *= 1.0 - alpha;
        }
        sum
    };
    (0..height * width).map(pixel).collect()
}

/// Returns the PSNR of light from 0 to 1 in dB.
fn psnr(found: &[f32], exact: impl Iterator<Item = f64>) -> f64 {
    let error = found.iter().zip(exact).map(|(a, b)| (f64::from(*a) - b).powi(2)).sum::<f64>() / found.len() as f64;
    -10.0 * error.log10()
}

/// Returns the smallest and largest inverse distance of the pixels, without one in 200 on each side.
fn distances(pixels: &[[f64; 5]]) -> [f64; 2] {
    let mut seen: Vec<f64> = pixels.iter().filter(|p| p[4] > 0.5).map(|p| p[3] / p[4]).collect();
    seen.sort_by(f64::total_cmp);
    let outside = seen.len() / 200;
    [seen[outside], seen[seen.len() - 1 - outside]]
}

/// Each view of all degrees agrees with float64 to 45 dB, on a display that is not square.
#[test]
fn views_are_those_of_float64() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.ply");
    let splats = random(1500, 7);
    let display = display(40, 56);
    let depth = [-2e-3, 3e-3];
    let request = Request { views: 3, depth: Some(depth), force: true, ..Request::new(&display, &ALL) };
    for degree in 0..=3 {
        fs::write(&file, ply(&splats, degree)).unwrap();
        let source = format!("{}?eye=0,0,0&fov=40", file.display());
        let field = get(&source, &request);
        assert_eq!((field.grid, field.depth, field.height, field.width), ([3, 3], Some(depth), 40, 56));
        let focal = 20.0 / 20f64.to_radians().tan();
        let middle = exact(&splats, degree, focal, [40, 56], [0.0; 2], [0.0; 2]);
        let [far, near] = distances(&middle);
        let cell = field.cell(&display);
        let per_metre = 1.0 / (display.focal_length * display.pitch);
        let mut worst = f64::INFINITY;
        for view in 0..9 {
            // Content at depth z moves by -z s / (f p), and z is in proportion to the inverse distance.
            let s = [view % 3, view / 3].map(|i| (i as f64 - 1.0) * cell);
            let gain = (depth[1] - depth[0]) * per_metre / (near - far);
            let by = s.map(|s| s * gain / focal);
            let moved = s.map(|s| -s * (depth[0] * per_metre - gain * far));
            let pixels = exact(&splats, degree, focal, [40, 56], by, moved);
            for color in 0..3 {
                let light = pixels.iter().map(|p| srgb_to_linear(p[color].min(1.0)));
                worst = worst.min(psnr(&field.planes[color][view], light));
            }
        }
        println!("degree {degree}: {worst:.1} dB");
        assert!(worst > 45.0, "degree {degree}: {worst:.1} dB");
    }
}

/// The value of a pixel by hand. A splat of opacity 0.6 is in front of one of opacity 0.9, both on the axis.
#[test]
fn a_pixel_is_that_by_hand() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("two.ply");
    let logit = |p: f64| (p / (1.0 - p)).ln();
    let one = |z: f64, opacity: f64, color: [f64; 3], along: [f64; 3]| {
        let mut harmonics = vec![[0.0; 3]; 16];
        harmonics[0] = color.map(|v| (v - 0.5) / CONSTANT);
        // The second harmonic of degree 1 is C1 along +z.
        harmonics[2] = along;
        Raw { place: [0.0, 0.0, z], scale: [-2.0; 3], turn: [1.0, 0.0, 0.0, 0.0], opacity: logit(opacity), harmonics }
    };
    let splats = [one(4.0, 0.9, [0.0, 0.8, 0.2], [0.0; 3]), one(2.0, 0.6, [0.5, 0.1, 0.0], [0.2, 0.0, 0.0])];
    fs::write(&file, ply(&splats, 1)).unwrap();
    let display = display(33, 33);
    let request = Request { views: 1, ..Request::new(&display, &ALL) };
    let field = get(&format!("{}?eye=0,0,0", file.display()), &request);
    let (red, green, blue) =
        (0.6 * (0.5 + 0.488_602_511_902_919_9 * 0.2), 0.6 * 0.1 + 0.4 * 0.9 * 0.8, 0.4 * 0.9 * 0.2);
    for (plane, value) in field.planes.iter().zip([red, green, blue]) {
        let at = f64::from(plane[0][16 * 33 + 16]);
        assert!((at - srgb_to_linear(value)).abs() < 1e-5, "{at} {value}");
    }
}

/// A splat near the eye moves to the left in a view from the right, and up in a view from below. One far away moves in
/// the opposite directions (OPTICS 3).
#[test]
fn near_content_moves_against_the_view() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("two.ply");
    let one = |x: f64, z: f64| Raw {
        place: [x * z, 0.0, z],
        scale: [z.ln() - 4.0; 3],
        turn: [1.0, 0.0, 0.0, 0.0],
        opacity: 8.0,
        harmonics: vec![[2.0; 3]; 1],
    };
    fs::write(&file, ply(&[one(-0.2, 2.0), one(0.2, 5.0)], 0)).unwrap();
    let display = display(64, 64);
    let depth = [-1.5e-3, 2.5e-3];
    let request = Request { views: 3, depth: Some(depth), ..Request::new(&display, &GREEN) };
    let field = get(&format!("{}?eye=0,0,0", file.display()), &request);
    let middle = |view: usize, half: usize| {
        let (mut sum, mut at) = (0.0, [0.0; 2]);
        for i in (0..64 * 64).filter(|i| i % 64 / 32 == half) {
            let v = f64::from(field.planes[0][view][i]);
            sum += v;
            at[0] += v * (i % 64) as f64;
            at[1] += v * (i / 64) as f64;
        }
        at.map(|v| v / sum)
    };
    let pixels = |z: f64| z * field.cell(&display) / (display.focal_length * display.pitch);
    for (half, z) in [(0, depth[1]), (1, depth[0])] {
        let [x, y] = middle(4, half);
        let [right, below] = [middle(5, half), middle(7, half)];
        assert!((right[0] - x + pixels(z)).abs() < 0.1 && (right[1] - y).abs() < 0.05, "{right:?} {x} {}", pixels(z));
        assert!((below[1] - y + pixels(z)).abs() < 0.1 && (below[0] - x).abs() < 0.05, "{below:?} {y} {}", pixels(z));
    }
}

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

/// Names, sizes and depth maps of other sources.
#[test]
fn splats_are_a_source_like_others() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.ply");
    fs::write(&file, ply(&random(300, 9), 0)).unwrap();
    let source = file.to_str().unwrap();
    assert_eq!((native_size(source).unwrap(), is_single(source).unwrap()), (None, false));
    let display = display(32, 24);
    let request = Request { views: 3, ..Request::new(&display, &ALL) };
    let (found, field) = inspect(source, &request).unwrap();
    assert_eq!((found.grid, found.own_size, found.depth_is_stated, found.doubt), ([3, 3], None, true, None));
    assert!(found.found_by.contains("300") && field.depth.is_some_and(|[far, near]| far == -near && near > 0.0));
    assert!(load(source, &Request { depth_map: Some(&file), ..request }).is_err());
    let own = digest(source).unwrap();
    assert!(own.is_some() && digest(&format!("{source}?fov=20")).unwrap() != own);
    fs::write(folder.path().join("cameras.json"), "[]").unwrap();
    assert_ne!(digest(source).unwrap(), own);
    let stated = format!("{source}?eye=0,0,0");
    let before = digest(&stated).unwrap();
    fs::remove_file(folder.path().join("cameras.json")).unwrap();
    assert_eq!(digest(&stated).unwrap(), before);
    // Views from any place equal the light field at its places.
    let source = format!("{source}?eye=0,0,0");
    let field = get(&source, &request);
    let anywhere = SplatViews::new(&source, &request).unwrap();
    let cell = field.cell(&display);
    let views = anywhere.views(Color::Green, &[(-cell, cell), (0.0, 0.0)]);
    assert_eq!((&views[0], &views[1]), (&field.planes[1][6], &field.planes[1][4]));
    assert!((anywhere.parallax(cell) - field.disparity.unwrap()[1]).abs() < 1e-9);
}
