//! Tests views of splats against float64, with every splat at every pixel.

use super::*;

/// One splat in float64, with x to the right, y downwards and z forward.
#[derive(Debug, Clone)]
pub(super) struct Raw {
    pub(super) place: [f64; 3],
    /// Logarithms of the deviations.
    pub(super) scale: [f64; 3],
    /// Quaternion (w, x, y, z).
    pub(super) turn: [f64; 4],
    /// Logit of the opacity.
    pub(super) opacity: f64,
    /// Harmonics, as (harmonic, color).
    pub(super) harmonics: Vec<[f64; 3]>,
}

/// Returns random splats of degree 3 in a box of 2 x 2 x 2 around (0, 0, 3), with a wall behind them.
pub(super) fn random(count: usize, seed: u64) -> Vec<Raw> {
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
pub(super) fn ply(splats: &[Raw], degree: usize) -> Vec<u8> {
    ply_with(splats, degree, 0.0)
}

/// Writes the format with a value in the property `nx`.
pub(super) fn ply_with(splats: &[Raw], degree: usize, nx: f64) -> Vec<u8> {
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
        values.extend([nx, 0.0, 0.0]);
        values.extend(splat.harmonics[0]);
        (0..3).for_each(|color| values.extend((0..rest).map(|k| splat.harmonics[k + 1][color])));
        values.push(splat.opacity);
        values.extend(splat.scale);
        values.extend(splat.turn);
        out.extend(values.iter().flat_map(|v| (*v as f32).to_le_bytes()));
    }
    out
}

pub(super) const CONSTANT: f64 = 0.282_094_791_773_878_14;

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
pub(super) fn psnr(found: &[f32], exact: impl Iterator<Item = f64>) -> f64 {
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
