//! Tests views between views against the scene's own views.

use crate::{Interpolator, LightField, Stage, ViewGrid};
use eyebox_optics::{Color, Display};
use proptest::prelude::*;

const SIZE: usize = 320;
/// Views along each axis. Content moves by about three pixels from one to the next.
const N: usize = 4;

fn display() -> Display {
    Display { height: SIZE, width: SIZE, ..Display::preset("far-field").unwrap() }
}

/// Returns a built-in scene as few views over the eyebox, and the scene itself.
fn sparse(name: &str) -> (Stage, LightField, ViewGrid) {
    let display = display();
    let stage = Stage::new(name, &display, Color::Green, SIZE).unwrap();
    let grid = ViewGrid { rows: N, columns: N, cell: display.eyebox_min() / N as f64 };
    let views = stage.views(&(0..N * N).map(|i| grid.position(i)).collect::<Vec<_>>());
    let field = LightField {
        name: name.into(),
        grid: [N, N],
        height: SIZE,
        width: SIZE,
        colors: vec![Color::Green],
        planes: vec![views],
        view_pitch: None,
        disparity: None,
        depth: Some(stage.depth()),
        made: None,
    };
    (stage, field, grid)
}

fn psnr(a: &[f32], b: &[f32]) -> f64 {
    let error: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (error / a.len() as f64).log10()
}

/// Mixes the views around a place without disparities.
fn mixed(field: &LightField, [u, v]: [f64; 2]) -> Vec<f32> {
    let split = |at: f64| (at.floor() as usize, at.fract() as f32);
    let ((c, fu), (r, fv)) = (split(u), split(v));
    let view = |r: usize, c: usize| &field.planes[0][r * N + c];
    let [a, b, c, d] = [view(r, c), view(r, c + 1), view(r + 1, c), view(r + 1, c + 1)];
    let between = |a: f32, b: f32, t: f32| a + t * (b - a);
    (0..a.len()).map(|p| between(between(a[p], b[p], fu), between(c[p], d[p], fu), fv)).collect()
}

/// The accuracy is at least 34 dB, and at least 6 dB above the views mixed without their disparities, 7 dB on average.
#[test]
fn between_the_views_it_is_what_the_scene_shows_there() {
    let (stage, field, grid) = sparse("still-life");
    let between = Interpolator::new(field.clone(), &display());
    let parallax = between.parallax(grid.cell);
    assert!(parallax > 2.5, "{parallax} pixels: views far enough apart to matter");
    let mut gained = 0.0;
    let places = [[1.5, 1.5], [0.5, 2.0], [2.3, 0.6], [0.25, 0.75]];
    for [u, v] in places {
        let metres = |at: f64| (at - (N - 1) as f64 / 2.0) * grid.cell;
        let place = [(metres(u), metres(v))];
        let (made, exact) = (between.views(0, &place).remove(0), stage.views(&place).remove(0));
        let (made, plain) = (psnr(&made, &exact), psnr(&mixed(&field, [u, v]), &exact));
        assert!(made > 34.0 && made > plain + 6.0, "({u}, {v}): {made:.2} dB, {plain:.2} without disparities");
        gained += (made - plain) / places.len() as f64;
    }
    assert!(gained > 7.0, "{gained:.2} dB gained");
}

/// Bars that repeat within the searched disparities are not taken for their neighbors.
#[test]
fn what_repeats_is_found_where_it_is() {
    let (stage, field, grid) = sparse("chart");
    let between = Interpolator::new(field, &display());
    let place = [(0.25 * grid.cell, -0.25 * grid.cell)];
    let (made, exact) = (between.views(0, &place).remove(0), stage.views(&place).remove(0));
    let made = psnr(&made, &exact);
    assert!(made > 27.0, "{made:.2} dB");
}

/// A little beyond the outermost views the picture continues like the scene, and better than their nearest view.
#[test]
fn beyond_the_views_the_parallax_goes_on() {
    let (stage, field, grid) = sparse("still-life");
    let between = Interpolator::new(field.clone(), &display());
    let place = [(-1.95 * grid.cell, 1.9 * grid.cell)];
    let (made, exact) = (between.views(0, &place).remove(0), stage.views(&place).remove(0));
    let (made, nearest) = (psnr(&made, &exact), psnr(&field.planes[0][(N - 1) * N], &exact));
    assert!(made > nearest + 4.0, "{made:.2} dB, {nearest:.2} of the nearest view");
}

#[test]
fn at_a_views_own_place_it_is_that_view() {
    let (_, field, grid) = sparse("dense-grass");
    let between = Interpolator::new(field.clone(), &display());
    let brightest = field.planes[0].iter().flatten().copied().fold(0.0, f32::max);
    for index in [0, 5, N * N - 1] {
        let view = between.views(0, &[grid.position(index)]).remove(0);
        let apart = view.iter().zip(&field.planes[0][index]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart <= 0.51 / 65535.0 * brightest, "{index}: {apart}");
    }
}

/// A square is in front of a wall. The hidden part is filled from the views that see it, and the outline is at its
/// place.
#[test]
fn what_one_view_cannot_see_another_shows() {
    let (size, near) = (64usize, 6.0f64);
    let noise = |x: i64, y: i64| {
        let mixed = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (mixed.wrapping_mul(0x94d0_49bb_1331_11eb) >> 48) as f32 / 65536.0
    };
    let wall = |x: i64, y: i64| 0.1 + 0.3 * noise(x, y);
    // The square is at (24, 24), 16 wide, in the middle of the grid, and moves by 6 pixels per view. The wall does not
    // move.
    let shot = |u: f64, v: f64| -> Vec<f32> {
        let (left, top) = ((24.0 - near * u).round() as i64, (24.0 - near * v).round() as i64);
        let square = |x: i64, y: i64| 0.6 + 0.4 * noise(x + 1000, y);
        let one = |i: usize| {
            let (x, y) = ((i % size) as i64 - left, (i / size) as i64 - top);
            let inside = (0..16).contains(&x) && (0..16).contains(&y);
            if inside { square(x, y) } else { wall((i % size) as i64, (i / size) as i64) }
        };
        (0..size * size).map(one).collect()
    };
    let field = LightField {
        name: "square".into(),
        grid: [3, 3],
        height: size,
        width: size,
        colors: vec![Color::Green],
        planes: vec![(0..9).map(|i| shot((i % 3) as f64 - 1.0, (i / 3) as f64 - 1.0)).collect()],
        view_pitch: Some(1e-3),
        disparity: Some([0.0, near]),
        depth: None,
        made: None,
    };
    let display = Display { height: size, width: size, ..Display::preset("far-field").unwrap() };
    let between = Interpolator::new(field.clone(), &display);
    let made = between.views(0, &[(0.5e-3, -0.5e-3)]).remove(0);
    let exact = shot(0.5, -0.5);
    let wrong = made.iter().zip(&exact).filter(|(a, b)| (*a - *b).abs() > 0.05).count();
    // Half of the content that moves by three pixels on both sides would be wrong without knowledge of hidden content.
    assert!(wrong < 90, "{wrong} pixels of 4096 are not what is there");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Any grid, size and place give light that is finite and not negative in every pixel.
    #[test]
    fn anything_is_seen_from_anywhere(rows in 1usize..4, columns in 1usize..4, height in 1usize..12, width in 1usize..12, range in (-9.0..9.0f64, 0.0..9.0f64), wild in prop::sample::select(vec![1.0, 1.0, 1e12, 1e300]), x in -4.0..4.0f64, y in -4.0..4.0f64, salt in 0u32..99) {
        let noise = |i: usize| ((i as u32).wrapping_mul(2_654_435_761).wrapping_add(salt * 977) >> 16) as f32 / 65536.0;
        let pixels = height * width;
        let view = |v: usize| (0..pixels).map(|p| noise(v * pixels + p)).collect::<Vec<f32>>();
        let field = LightField {
            name: "noise".into(), grid: [rows, columns], height, width, colors: vec![Color::Green],
            planes: vec![(0..rows * columns).map(view).collect()],
            view_pitch: Some(1e-3), disparity: Some([wild * range.0, wild * (range.0 + range.1)]), depth: None, made: None,
        };
        let between = Interpolator::new(field, &display());
        let seen = between.views(0, &[(wild.min(1e9) * x * 1e-3, y * 1e-3)]).remove(0);
        prop_assert_eq!(seen.len(), pixels);
        prop_assert!(seen.iter().all(|v| v.is_finite() && *v >= 0.0));
    }
}
