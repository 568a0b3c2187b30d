//! Makes procedural textures from hashed value noise, patterns and lettering.
//!
//! They are deterministic on every machine, because they use no sines of large numbers and no random state.

/// Linear red, green, blue and coverage.
pub(super) type Paint = [f32; 4];

/// Returns opaque paint of these colors.
pub(super) fn rgb(r: f32, g: f32, b: f32) -> Paint {
    [r, g, b, 1.0]
}

/// Interpolates from `a` to `b`.
pub(super) fn mix(a: Paint, b: Paint, t: f32) -> Paint {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t)
}

/// Returns the same paint under `light`.
pub(super) fn lit(p: Paint, light: f32) -> Paint {
    [p[0] * light, p[1] * light, p[2] * light, p[3]]
}

/// Returns 0 below `a`, 1 above `b`, and a smooth transition between.
pub(super) fn smoothstep(a: f32, b: f32, x: f32) -> f32 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Returns a number in 0..1 for each lattice point. The constants belong to this function, because others would change
/// the built-in scenes.
pub(super) fn hash(x: i32, y: i32, seed: u32) -> f32 {
    let mut h =
        (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^= h >> 15;
    (h >> 8) as f32 / (1 << 24) as f32
}

/// Returns smooth noise in 0..1 with a period of 1 lattice cell.
pub(super) fn noise(x: f32, y: f32, seed: u32) -> f32 {
    let (fx, fy) = (x.floor(), y.floor());
    let (ix, iy) = (fx as i32, fy as i32);
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let (tx, ty) = (ease(x - fx), ease(y - fy));
    let row = |j: i32| {
        let a = hash(ix, iy.wrapping_add(j), seed);
        a + (hash(ix.wrapping_add(1), iy.wrapping_add(j), seed) - a) * tx
    };
    let top = row(0);
    top + (row(1) - top) * ty
}

/// Returns `octaves` of noise in 0..1, each twice as fine and half as strong as the previous one.
pub(super) fn fbm(x: f32, y: f32, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total, mut scale) = (0.0, 1.0, 0.0, 1.0);
    for k in 0..octaves {
        sum += weight * noise(x * scale, y * scale, seed.wrapping_add(k));
        total += weight;
        weight *= 0.5;
        scale *= 2.03;
    }
    sum / total
}

/// Returns the distance to the nearest whole number, 0..0.5.
pub(super) fn fold(x: f32) -> f32 {
    (x - x.round()).abs()
}

/// Returns glyphs of 5 x 7 cells with a row per number and the leftmost cell in bit 4.
fn glyph(letter: char) -> [u8; 7] {
    match letter {
        'B' => [30, 17, 17, 30, 17, 17, 30],
        'E' => [31, 16, 16, 30, 16, 16, 31],
        'O' => [14, 17, 17, 17, 17, 17, 14],
        'X' => [17, 17, 10, 4, 10, 17, 17],
        'Y' => [17, 17, 10, 4, 4, 4, 4],
        '0' => [14, 17, 19, 21, 25, 17, 14],
        '1' => [4, 12, 4, 4, 4, 4, 14],
        '2' => [14, 17, 1, 2, 4, 8, 31],
        '3' => [31, 2, 4, 2, 1, 17, 14],
        '4' => [2, 6, 10, 18, 31, 2, 2],
        '5' => [31, 16, 30, 1, 1, 17, 14],
        '6' => [6, 8, 16, 30, 17, 17, 14],
        '7' => [31, 1, 2, 4, 8, 8, 8],
        '8' => [14, 17, 17, 14, 17, 17, 14],
        '9' => [14, 17, 17, 15, 1, 2, 12],
        _ => [0; 7],
    }
}

/// Returns true if `(x, y)` is on the ink of `text`. Its cells are squares of side 1, with 6 columns per letter and 7
/// rows, from (0, 0).
pub(super) fn ink(text: &str, x: f32, y: f32) -> bool {
    if !(0.0..7.0).contains(&y) || x < 0.0 {
        return false;
    }
    let (letter, column) = ((x / 6.0) as usize, (x % 6.0) as u32);
    let Some(letter) = text.chars().nth(letter).filter(|_| column < 5) else { return false };
    glyph(letter)[y as usize] >> (4 - column) & 1 == 1
}
