//! Pictures are warped so that they appear straight. Lines are straight and colors coincide through a simulated
//! distortion.

use eyebox::low_level::engine::{Engine, cpu::CpuEngine};
use eyebox::low_level::evaluate::{self, Plane};
use eyebox::low_level::hologram::{ColorHologram, Hologram};
use eyebox::low_level::optics::{Color, Display, Padding, Picture, PictureWarp, Pupil, WindowFactor};
use eyebox::low_level::plan::Purpose;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::Problem;

const SIZE: [usize; 2] = [72, 96];
/// Positions of vertical and horizontal lines.
const LINES: [f64; 3] = [16.0, 40.0, 59.0];

/// Distortion between the display and the camera, one set of numbers per color. It has a turned camera, pincushion and
/// lateral color.
const SEEN: [(Color, [f64; 8], [f64; 2]); 3] = [
    (Color::Red, [0.905, 0.03, 0.021, -0.03, 0.911, -0.05, 0.02, -0.01], [0.145, -0.008]),
    (Color::Green, [0.9, 0.03, 0.02, -0.03, 0.906, -0.05, 0.02, -0.01], [0.15, -0.01]),
    (Color::Blue, [0.892, 0.031, 0.016, -0.03, 0.9, -0.048, 0.02, -0.01], [0.156, -0.01]),
];

fn display() -> Display {
    let mut picture = Picture::default();
    for (color, homography, distortion) in SEEN {
        picture.set(color, PictureWarp { homography, distortion });
    }
    Display { height: SIZE[0], width: SIZE[1], picture, ..Display::preset("small").unwrap() }
}

/// Computes the equations of the map, in the camera's units.
fn camera(color: usize, [x, y]: [f64; 2]) -> [f64; 2] {
    let [wide, high] = [SIZE[1] as f64, SIZE[0] as f64];
    let (x, y) = ((2.0 * x + 1.0 - wide) / wide, (2.0 * y + 1.0 - high) / wide);
    let (_, [a, b, c, d, e, f, g, h], [k1, k2]) = SEEN[color];
    let w = g * x + h * y + 1.0;
    let (u, v) = ((a * x + b * y + c) / w, (d * x + e * y + f) / w);
    let r2 = u * u + v * v;
    let bend = 1.0 + k1 * r2 + k2 * r2 * r2;
    // The unit is a pixel of the picture.
    [u * bend * wide / 2.0, v * bend * wide / 2.0]
}

/// Returns soft lines, vertical or horizontal, which are the same in all colors.
fn lines(vertical: bool) -> LightField {
    let [height, width] = SIZE;
    let at = |i: usize| (if vertical { i % width } else { i / width }) as f64;
    let light = |i: usize| LINES.iter().map(|line| (-0.5 * ((at(i) - line) / 1.5).powi(2)).exp()).sum::<f64>() as f32;
    let view: Vec<f32> = (0..height * width).map(light).collect();
    LightField {
        name: "lines".into(),
        grid: [1, 1],
        height,
        width,
        colors: SEEN.map(|s| s.0).to_vec(),
        planes: vec![vec![view]; 3],
        view_pitch: None,
        disparity: None,
        depth: None,
        made: None,
    }
}

/// Returns the target image of the display for a color of a scene.
fn target(field: &LightField, color: usize, display: &Display) -> Vec<f32> {
    let problem = Problem::new(field, SEEN[color].0, display, Padding::default()).unwrap();
    let planner = problem.planner(1, WindowFactor::Full);
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::View), Some(problem.pyramid.clone())).unwrap();
    evaluate::photographs(&mut engine, &planner, &[Pupil::from_mm([0.0, 0.0, 4.0, 0.0])]).unwrap().remove(0)
}

/// Traces a line on the display. For each row (or column) in the middle of the picture it returns the center of the
/// light around the line.
fn traced(shown: &[f32], vertical: bool, near: f64) -> Vec<[f64; 2]> {
    let [height, width] = SIZE;
    let (count, length) = if vertical { (height, width) } else { (width, height) };
    let value = |across: usize, along: usize| {
        f64::from(if vertical { shown[across * width + along] } else { shown[along * width + across] })
    };
    let mut points = Vec::new();
    let mut centre = near;
    // The trace goes from the middle outwards, so that it follows a bent line.
    for step in (count / 2..count - 8).chain((8..count / 2).rev()) {
        if step == count / 2 - 1 {
            centre = near;
        }
        for _ in 0..3 {
            let (low, high) = ((centre - 5.0).round().max(0.0) as usize, (centre + 5.0).round() as usize);
            let (mut sum, mut first) = (0.0, 0.0);
            for along in low..=high.min(length - 1) {
                sum += value(step, along);
                first += value(step, along) * along as f64;
            }
            centre = first / sum;
        }
        points.push(if vertical { [centre, step as f64] } else { [step as f64, centre] });
    }
    points
}

/// Fits a straight line to points. Returns (place at 0, slope) of `axis` against the other axis, and the largest
/// distance from the line.
fn straight(points: &[[f64; 2]], axis: usize) -> (f64, f64, f64) {
    let n = points.len() as f64;
    let mean = |f: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(&|p| p[1 - axis]), mean(&|p| p[axis]));
    let slope = mean(&|p| (p[1 - axis] - x) * (p[axis] - y)) / mean(&|p| (p[1 - axis] - x).powi(2));
    let at = y - slope * x;
    (at, slope, points.iter().map(|p| (p[axis] - at - slope * p[1 - axis]).abs()).fold(0.0, f64::max))
}

#[test]
fn lines_are_straight_and_colours_coincide() {
    let (real, ideal) = (display(), Display { picture: Picture::default(), ..display() });
    for vertical in [true, false] {
        let (field, axis) = (lines(vertical), usize::from(!vertical));
        let mut bent: f64 = 0.0;
        for line in LINES {
            let mut seen = Vec::new();
            for (color, (name, ..)) in SEEN.iter().enumerate() {
                let trace = |display: &Display, near: f64| {
                    let shown = traced(&target(&field, color, display), vertical, near);
                    straight(&shown.iter().map(|p| camera(color, *p)).collect::<Vec<_>>(), axis)
                };
                bent = bent.max(trace(&ideal, line).2);
                // The warp gives the new place of the line on the display.
                let map = real.picture.map(*name, real.picture_size().into()).unwrap();
                let middle = |n: usize, at: f64| (2.0 * at + 1.0 - n as f64) / SIZE[1] as f64;
                let place = if vertical { [middle(SIZE[1], line), 0.0] } else { [0.0, middle(SIZE[0], line)] };
                let back = map.back(place)[axis] * SIZE[1] as f64 / 2.0;
                let near = back + (SIZE[1 - axis] as f64 - 1.0) / 2.0;
                let (at, slope, off) = trace(&real, near);
                assert!(off < 0.1, "{vertical} {line} color {color}: {off:.3} pixels off a straight line");
                seen.push([at - 20.0 * slope, at, at + 20.0 * slope]);
            }
            for other in &seen[1..] {
                let apart = other.iter().zip(&seen[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(apart < 0.1, "{vertical} {line}: colors are {apart:.3} pixels apart");
            }
        }
        assert!(bent > 0.3, "lines that are not corrected are off by only {bent:.2} pixels");
    }
}

/// The view of the warped display is the scene again, and content from beyond the picture is black.
#[test]
fn what_is_seen_is_the_scene() {
    let display = display();
    let field = lines(true);
    let color = |color: usize| ColorHologram {
        color: Some(SEEN[color].0),
        wavelength: display.optics(SEEN[color].0).unwrap().wavelength,
        exposure: 1.0,
        efficiency: 1.0,
        phases: vec![0.0; SIZE[0] * SIZE[1]],
    };
    let hologram = Hologram::on(&display, 1, (0..3).map(color).collect());
    let shown = (0..3).map(|c| Plane { rows: SIZE[0], columns: SIZE[1], values: target(&field, c, &display) });
    for (i, plane) in hologram.as_seen(shown.collect()).iter().enumerate() {
        let mut worst: f32 = 0.0;
        for (at, (seen, wanted)) in plane.values.iter().zip(&field.planes[i][0]).enumerate() {
            let (row, column) = (at / SIZE[1], at % SIZE[1]);
            if (8..SIZE[0] - 8).contains(&row) && (8..SIZE[1] - 8).contains(&column) {
                worst = worst.max((seen - wanted).abs());
            }
        }
        assert!(worst < 0.06, "color {i}: {worst}");
    }
    // A display without a warp shows the scene unchanged.
    let ideal = Display { picture: Picture::default(), ..display.clone() };
    let (shown, scene) = (target(&field, 1, &ideal), &field.planes[1][0]);
    assert!(shown.iter().zip(scene).all(|(a, b)| (a - b).abs() < 1e-4));
    let plain = Hologram::on(&ideal, 1, vec![color(0)]);
    let plane = Plane { rows: SIZE[0], columns: SIZE[1], values: field.planes[0][0].clone() };
    assert_eq!(plain.as_seen(vec![plane.clone()]), [plane]);
}
