//! Describes test targets, which are points, a plane and a resolution chart.

use super::{
    render::Item,
    shape::Shape,
    texture::{fbm, fold, ink, lit, mix, noise, rgb},
};

/// Makes single points, two pixels wide, on black. There are five rows of seven, whose depths cover the span.
pub(super) fn points(half: [f32; 2], pixel: f32) -> Vec<Item> {
    let mut items: Vec<Item> = (0..35)
        .map(|k| {
            let (row, column) = (k / 7, k % 7);
            let z = -1.0 + (k * 16 % 35) as f32 / 17.0;
            let at = [(column as f32 - 3.0) / 3.6 * half[0], (row as f32 - 2.0) / 2.5 * half[1]];
            let texture = move |x: f32, y: f32| {
                let inside = (x - at[0]).powi(2) + (y - at[1]).powi(2) <= pixel * pixel;
                if inside { rgb(1.0, 1.0, 1.0) } else { [0.0; 4] }
            };
            let area = [at[0] - pixel, at[1] - pixel, at[0] + pixel, at[1] + pixel];
            Item::Surface { shape: Shape::Card { z }, area, texture: Box::new(texture) }
        })
        .collect();
    items.sort_by(|a, b| a.depths(1.0)[0].total_cmp(&b.depths(1.0)[0]));
    items
}

/// Makes one plane at depth `z` with texture down to the pixel, its pattern `shift` to the right.
pub(super) fn plane(z: f32, shift: f32) -> Vec<Item> {
    let texture = move |x: f32, y: f32| {
        let x = x - shift;
        let stone = fbm(x * 7.0, y * 7.0, 6, 71);
        let speck = noise(x * 110.0, y * 110.0, 72);
        let tile = (x * 4.0).floor() as i32 + (y * 4.0).floor() as i32;
        let base = if tile.rem_euclid(2) == 0 { rgb(0.50, 0.42, 0.30) } else { rgb(0.16, 0.24, 0.34) };
        let joint = fold(x * 4.0).min(fold(y * 4.0)) < 0.02;
        let paint = if joint { rgb(0.04, 0.04, 0.04) } else { base };
        lit(paint, (0.2 + 1.4 * stone) * (0.5 + speck))
    };
    vec![Item::Surface { shape: Shape::Card { z }, area: [-1e3, -1e3, 1e3, 1e3], texture: Box::new(texture) }]
}

/// Makes bars of 2 to 32 pixels (a dark and a bright one together) in both directions, and a star. They are on three
/// cards, far, middle and near from left to right, in front of gray. The number next to the bars is their period.
pub(super) fn chart(half: [f32; 2], pixel: f32) -> Vec<Item> {
    let grey = |x: f32, y: f32| lit(rgb(0.18, 0.18, 0.18), 0.7 + 0.6 * fbm(x * 20.0, y * 20.0, 4, 81));
    let mut items =
        vec![Item::Surface { shape: Shape::Card { z: -1.0 }, area: [-1e3, -1e3, 1e3, 1e3], texture: Box::new(grey) }];
    for (k, z) in [-1.0f32, 0.0, 1.0].into_iter().enumerate() {
        let (w, h) = (0.30 * half[0], 0.86 * half[1]);
        let x0 = (k as f32 - 1.0) * 0.65 * half[0];
        let texture = move |x: f32, y: f32| {
            let (u, v) = (x - x0, y);
            let (white, black) = (rgb(0.8, 0.8, 0.8), rgb(0.01, 0.01, 0.01));
            let radius = w * 0.9;
            // The star is above.
            let (sx, sy) = (u, v + h - w);
            let r = (sx * sx + sy * sy).sqrt();
            if r < radius {
                let spoke = (sy.atan2(sx) / std::f32::consts::TAU * 36.0).rem_euclid(1.0) < 0.5;
                return if spoke { black } else { white };
            }
            // The bars are below, with one line for each period, vertical ones left and horizontal ones right.
            let top = -h + 2.0 * w;
            let periods = [32u32, 16, 12, 8, 6, 4, 3, 2];
            let line = (h * 0.97 - top) / periods.len() as f32;
            let index = ((v - top) / line).floor();
            if !(0.0..periods.len() as f32).contains(&index) {
                return white;
            }
            let period = periods[index as usize];
            let inside = (v - top) / line - index;
            if !(0.1..0.9).contains(&inside) {
                return white;
            }
            let along = u / w;
            let phase = |t: f32| (t / (period as f32 * pixel)).rem_euclid(1.0) < 0.5;
            if (-0.95..-0.2).contains(&along) {
                if phase(u + 0.95 * w) { black } else { white }
            } else if (-0.15..0.6).contains(&along) {
                if phase(v - top - (index + 0.1) * line) { black } else { white }
            } else {
                let cell = (line * 0.8 / 7.0).min(w * 0.3 / 11.0);
                let from_middle = (v - top - (index + 0.5) * line) / cell + 3.5;
                let on = ink(&period.to_string(), (u - 0.65 * w) / cell, from_middle);
                mix(white, black, if on { 1.0 } else { 0.0 })
            }
        };
        let area = [x0 - w, -h, x0 + w, h];
        items.push(Item::Surface { shape: Shape::Card { z }, area, texture: Box::new(texture) });
    }
    items
}
