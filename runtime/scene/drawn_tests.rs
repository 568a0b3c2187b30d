//! Tests drawings that people make to try eyebox. A flat square is in front of a plain, smooth, checkered or random
//! background, in a few views. Its depths are measured correctly, or the views are refused.

use crate::*;
use eyebox_optics::{Color, Display};

#[derive(Debug, Clone, Copy)]
enum Background {
    Plain,
    Smooth,
    Checkered(i32),
    Random,
    Clouds,
}
use Background::{Checkered, Clouds, Plain, Random, Smooth};

/// Draws views of a square that moves by whole pixels from view to view, as they are drawn with arrays.
fn drawn(background: Background, size: [usize; 2], grid: [usize; 2], [far, near]: [i32; 2]) -> LightField {
    let [height, width] = size;
    let hash = |x: i32, y: i32| {
        let mixed = (x.wrapping_mul(374_761_393) ^ y.wrapping_mul(668_265_263)).wrapping_mul(1_274_126_177);
        f64::from((mixed >> 9) & 0xff)
    };
    let wall = |x: i32, y: i32| match background {
        Plain => 90.0,
        Smooth => (60.0 + 100.0 * f64::from(x + y + 40) / (height + width + 80) as f64).round(),
        Checkered(side) => 40.0 + 150.0 * f64::from((x.div_euclid(side) + y.div_euclid(side)).rem_euclid(2)),
        Random => hash(x, y),
        Clouds => {
            let near = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j)));
            (near.map(|(i, j)| hash(x + i, y + j)).sum::<f64>() / 25.0).round()
        }
    };
    let side = height.min(width) as i32 / 3;
    let [top, left] = [height as i32 * 2 / 5, width as i32 * 2 / 5].map(|at| at - 4);
    let view = |v: usize| {
        let [down, right] = [v / grid[1], v % grid[1]].map(|i| i as i32);
        let [down, right] = [down - grid[0] as i32 / 2, right - grid[1] as i32 / 2];
        let pixel = |i: usize| {
            let (x, y) = ((i % width) as i32, (i / width) as i32);
            let (u, w) = (x + near * right - left, y + near * down - top);
            let inside = (0..side).contains(&u) && (0..side).contains(&w);
            let value = if inside { 220.0 } else { wall(x + far * right, y + far * down) };
            srgb_to_linear(value / 255.0) as f32
        };
        (0..height * width).map(pixel).collect()
    };
    LightField {
        name: "drawn".into(),
        grid,
        height,
        width,
        colors: vec![Color::Green],
        planes: vec![(0..grid[0] * grid[1]).map(view).collect()],
        view_pitch: None,
        disparity: None,
        depth: None,
        made: None,
    }
}

/// Returns the measured disparities if they are trusted.
fn measured(field: &LightField) -> Result<[f64; 2], SceneError> {
    let display = Display { height: field.height, width: field.width, ..Display::preset("small").unwrap() };
    let per_pixel = display.focal_length * display.picture_pixel() / field.cell(&display);
    Ok(field.depths(&display, None)?.map(|z| z / per_pixel))
}

#[test]
fn what_is_drawn_has_the_depths_that_it_was_drawn_with() {
    let mut wrong = Vec::new();
    for (background, size, grid, disparity) in [
        (Plain, [96, 96], [5, 5], [0, 2]),
        (Plain, [64, 64], [5, 5], [0, 1]),
        (Plain, [64, 80], [5, 5], [0, -2]),
        (Smooth, [96, 96], [5, 5], [0, 2]),
        (Smooth, [64, 64], [5, 5], [0, 3]),
        (Checkered(8), [96, 96], [5, 5], [0, 2]),
        (Checkered(16), [96, 96], [3, 3], [-1, 1]),
        (Random, [64, 64], [5, 5], [0, 2]),
        (Random, [96, 96], [5, 5], [-1, 1]),
        (Random, [64, 80], [3, 3], [-1, 3]),
        (Clouds, [96, 96], [5, 5], [0, 2]),
        (Clouds, [64, 64], [5, 5], [-1, 2]),
        (Clouds, [64, 64], [7, 7], [-1, 1]),
        (Clouds, [80, 80], [1, 7], [-1, 2]),
        (Checkered(8), [96, 96], [5, 5], [-1, 2]),
        (Checkered(8), [64, 80], [3, 3], [-1, 2]),
        (Checkered(8), [80, 80], [1, 7], [-1, 2]),
        (Checkered(8), [64, 64], [7, 7], [0, -2]),
        (Random, [80, 80], [1, 7], [-1, 2]),
        (Random, [80, 80], [1, 7], [-1, 1]),
        (Random, [64, 64], [7, 7], [-1, 2]),
    ] {
        let field = drawn(background, size, grid, disparity);
        assert_eq!(read::standing::contradicted(&field), None, "{background:?}");
        // A plain wall has no depth of its own.
        let has_wall = !matches!(background, Plain | Smooth);
        let [far, near] = disparity.map(f64::from);
        match measured(&field) {
            Ok([low, high]) if (high - far.max(near)).abs() < 0.25 || (!has_wall && (high - near).abs() < 0.25) => {
                let low_is_right = (low - far.min(near)).abs() < 0.25 || (!has_wall && (low - near).abs() < 0.25);
                if !low_is_right {
                    wrong.push(format!("{background:?} {size:?} {disparity:?}: {low:.2} to {high:.2}"));
                }
            }
            other => wrong.push(format!("{background:?} {size:?} {disparity:?}: {other:?}")),
        }
        let order = Parallax::of(&field).map(|parallax| read::order_found::judge(&parallax));
        if let Some(OrderFound::Other { reason, .. }) = order {
            wrong.push(format!("{background:?} {disparity:?}: {reason}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn views_that_are_all_the_same_have_no_depth() {
    for background in [Plain, Smooth, Checkered(8), Checkered(3), Random, Clouds] {
        for (size, grid) in [([64, 64], [5, 5]), ([48, 64], [3, 3])] {
            let found = measured(&drawn(background, size, grid, [0, 0]));
            let [low, high] = found.unwrap_or_else(|e| panic!("{background:?} {size:?}: {e}"));
            assert!(low.abs() < 0.05 && high.abs() < 0.05, "{background:?} {size:?}: {low} to {high}");
        }
    }
}

/// Pictures from one place with different focus are not views.
#[test]
fn a_focal_stack_is_not_taken_for_views() {
    for grid in [[1, 5]] {
        let sharp = drawn(Clouds, [96, 128], [1, 1], [0, 0]);
        let mut near = sharp.planes[0][0].clone();
        let mut views = vec![near.clone()];
        while views.len() < grid[0] * grid[1] {
            for _ in 0..4 {
                near = depth::subpixel::soften(&near, 96, 128);
            }
            views.push(near.clone());
        }
        let field = LightField { grid, planes: vec![views], ..sharp };
        assert_eq!(read::standing::contradicted(&field), Some(CamerasFound::OnePlace), "{grid:?}");
    }
}

/// The drawing is the notebook's. Stripes are still behind a hole that moves by a pixel and a half, and other stripes
/// move with it. At their ends they seem to move along themselves.
#[test]
fn a_disc_that_moves_over_stripes_is_a_grid_of_views() {
    for (grid, moves, across) in [
        ([5, 5], false, [1, -1]),
        ([5, 5], true, [1, -1]),
        ([1, 5], false, [1, -1]),
        ([7, 7], false, [1, -1]),
        ([5, 5], false, [1, 2]),
    ] {
        let view = |v: usize| {
            let [down, right] = [0, 1].map(|i| [v / grid[1], v % grid[1]][i] as f64 - (grid[i] / 2) as f64);
            let pixel = |i: usize| {
                let [x, y] = [i % 128, i / 128].map(|at| at as f64);
                let (u, w) = (x + 1.5 * right, y + 1.5 * down);
                let [a, b] = if moves { [u, w] } else { [x, y] };
                let stripe = ((across[0] as f64 * a + across[1] as f64 * b) / 6.0).floor().rem_euclid(2.0);
                let floor = 0.1 + 0.3 * ((x / 16.0).floor() + (y / 16.0).floor()).rem_euclid(2.0);
                (if (u - 64.0).hypot(w - 64.0) < 24.0 { 0.5 + 0.5 * stripe } else { floor }) as f32
            };
            (0..128 * 128).map(pixel).collect()
        };
        let planes = vec![(0..grid[0] * grid[1]).map(view).collect()];
        let field = LightField { grid, height: 128, width: 128, planes, ..drawn(Plain, [8, 8], [1, 1], [0, 0]) };
        assert_eq!(read::standing::contradicted(&field), None, "{grid:?} {moves} {across:?}");
        let [low, high] = measured(&field).unwrap();
        // Edges are drawn in whole pixels.
        assert!(low.abs() < 0.25 && (high - 1.5).abs() < 0.55, "{grid:?} {moves} {across:?}: {low} to {high}");
    }
}
