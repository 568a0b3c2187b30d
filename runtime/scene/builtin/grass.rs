//! Describes dense grass with blades at every depth, in front of a painted ball and a brick wall.

use super::{
    render::Item,
    shape::{Blade, Shape},
    texture::{fbm, fold, hash, lit, mix, noise, rgb, smoothstep},
};

/// Returns the scene for a picture whose half sides are `half`. A wide picture has more blades.
pub(super) fn items(half: [f32; 2]) -> Vec<Item> {
    let wall = |x: f32, y: f32| {
        let row = (y * 7.0).floor();
        let u = x * 3.2 + 0.5 * row.rem_euclid(2.0);
        let mortar = smoothstep(0.025, 0.05, fold(u - 0.5 + 0.5)).min(smoothstep(0.05, 0.1, fold(y * 7.0)));
        let brick = hash(u.round() as i32, row as i32, 3);
        let grain = 0.6 + 0.8 * fbm(x * 24.0, y * 24.0, 4, 5);
        let paint = mix(rgb(0.34, 0.31, 0.27), mix(rgb(0.28, 0.07, 0.04), rgb(0.42, 0.17, 0.09), brick), mortar);
        lit(paint, grain * (0.75 - 0.25 * y))
    };
    let mut items =
        vec![Item::Surface { shape: Shape::Card { z: -1.0 }, area: [-1e3, -1e3, 1e3, 1e3], texture: Box::new(wall) }];
    let (center, r) = ([0.0f32, 0.12f32, -0.62f32], 0.56f32);
    let ball = move |x: f32, y: f32| {
        let (nx, ny) = ((x - center[0]) / r, (y - center[1]) / r);
        let out = (nx * nx + ny * ny).sqrt().max(1.0);
        let (nx, ny) = (nx / out, ny / out);
        let nz = (1.0 - nx * nx - ny * ny).max(0.0).sqrt();
        // These are longitude and latitude around a leaning axis.
        let (ax, ay) = (0.94 * nx + 0.34 * ny, 0.94 * ny - 0.34 * nx);
        let (u, v) = (ax.atan2(nz) / std::f32::consts::PI, ay.clamp(-1.0, 1.0).asin() / std::f32::consts::PI);
        let check = ((u * 10.0).floor() + (v * 10.0).floor()).rem_euclid(2.0) < 1.0;
        let paint = if check { rgb(0.80, 0.74, 0.60) } else { rgb(0.05, 0.16, 0.42) };
        let paint = mix(paint, rgb(0.75, 0.12, 0.05), 1.0 - smoothstep(0.012, 0.02, v.abs()));
        let key = (-0.52 * nx - 0.62 * ny + 0.587 * nz).max(0.0);
        lit(paint, (0.12 + 0.95 * key) * (0.85 + 0.3 * noise(nx * 40.0, ny * 40.0, 9)))
    };
    let area = [center[0] - r - 0.02, center[1] - r - 0.02, center[0] + r + 0.02, center[1] + r + 0.02];
    items.push(Item::Surface { shape: Shape::Ball { center, radii: [r, r] }, area, texture: Box::new(ball) });

    // The blades go from behind the ball to the front, each a little nearer than the previous one, so no two have one
    // depth.
    let count = (340.0 * half[0] * half[1]).min(4000.0) as i32;
    for k in 0..count {
        let random = |s: u32| hash(k, 23, s);
        let t = k as f32 / count as f32;
        let z = -0.8 + 1.8 * t;
        // Farther blades are higher in the picture, like a lawn from above.
        let foot = half[1] * (0.62 + 0.5 * t);
        let height = (0.55 + 0.75 * random(1) * random(2)) * (0.75 + 0.45 * t);
        let x = (random(3) * 2.0 - 1.0) * (half[0] + 0.1);
        let lean = (random(4) - 0.5) * 0.5;
        let warm = random(5);
        let bright = (0.5 + 0.5 * t) * (0.5 + 0.9 * random(6));
        let color = [0.10 + 0.34 * warm * warm, 0.34 + 0.06 * warm, 0.035].map(|c| c * bright);
        items.push(Item::Blade(Blade {
            root: [x, foot + 0.12, z],
            tip: [x + lean, foot - height, (z + 0.12 * (random(7) - 0.5)).clamp(-0.9, 1.0)],
            bend: 0.25 * lean,
            width: 0.010 + 0.013 * random(8),
            colors: [color.map(|c| c * 0.3), color.map(|c| c * 1.25)],
        }));
    }
    items
}
