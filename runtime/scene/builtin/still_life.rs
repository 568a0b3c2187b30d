//! Describes the still life, with a wall, a checked cloth, a vase with stalks, fruit and a lettered card.
//!
//! Cherries are in front, and blades at the right edge.

use super::{
    render::Item,
    shape::{Blade, Shape},
    texture::{Paint, fbm, fold, hash, ink, lit, mix, noise, rgb, smoothstep},
};

/// The light and the walls of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mood {
    /// A bright room with a blue-green wall.
    Day,
    /// A lamp near the fruit, with everything else dark.
    Lamp,
    /// A white wall and cloth, with light from everywhere.
    Studio,
}

/// The cloth has z = AT_ZERO + SLOPE y, from the wall to the front edge.
const BACK: f32 = 0.16;
const SLOPE: f32 = 2.26;
const AT_ZERO: f32 = -0.93 - SLOPE * BACK;

/// Returns the height in the picture of an object at depth z that rests on the cloth.
fn ground(z: f32) -> f32 {
    (z - AT_ZERO) / SLOPE
}

/// Direction towards the light, which is left, up and in front.
const LIGHT: [f32; 3] = [-0.52, -0.62, 0.587];

/// The paint of a fruit in the direction of its surface normal.
type Peel = fn([f32; 3]) -> Paint;

struct Fruit {
    center: [f32; 3],
    radii: [f32; 2],
    gloss: f32,
    peel: Peel,
}

impl Mood {
    /// Returns the light on a surface of normal `n` at picture place `(x, y)`, as a factor of its color.
    fn light(self, n: [f32; 3], x: f32, y: f32) -> f32 {
        let key = n[0] * LIGHT[0] + n[1] * LIGHT[1] + n[2] * LIGHT[2];
        // The light bends a little around the limb, as in a room.
        let soft = ((key + 0.25) / 1.25).max(0.0);
        let around = 0.5 - 0.5 * n[1];
        match self {
            Self::Day => 0.11 + 0.08 * around + 0.82 * soft * soft.sqrt(),
            Self::Lamp => {
                let (dx, dy) = ((x + 0.05) / 0.85, (y - 0.2) / 0.62);
                0.006 + (0.02 + 0.85 * soft * soft) * (-1.7 * (dx * dx + dy * dy)).exp()
            }
            Self::Studio => 0.30 + 0.15 * around + 0.46 * soft,
        }
    }
}

/// Returns the scene for a picture whose half sides are `half`. Objects spread out on a wide picture. The fruit is
/// `shift` to the right of its usual place.
pub(super) fn items(half: [f32; 2], mood: Mood, shift: f32) -> Vec<Item> {
    let spread = 1.0 + 0.55 * (half[0] - 1.0).clamp(0.0, 1.5);
    let mut items = vec![wall(half, mood)];
    let mut fruits = fruits(spread);
    fruits.iter_mut().for_each(|fruit| fruit.center[0] += shift);
    let vase_x = -0.44 * spread;
    items.push(cloth(half, mood, &fruits, vase_x, spread));
    items.push(card(0.5 * spread, mood));
    bouquet(vase_x, mood, &mut items);
    items.push(vase(vase_x, mood));
    for fruit in fruits {
        let stalk = (fruit.radii[0] == CHERRY).then(|| stalk(&fruit));
        items.push(ball(fruit, mood));
        items.extend(stalk.map(|stalk| dim(stalk, mood)));
    }
    foreground(half, mood, &mut items);
    items
}

fn wall(half: [f32; 2], mood: Mood) -> Item {
    let texture = move |x: f32, y: f32| {
        // A lattice of diamonds with a blossom in each is printed on rough plaster.
        let (u, v) = ((x + y * 1.25) * 4.2, (x - y * 1.25) * 4.2);
        let line = 1.0 - smoothstep(0.02, 0.045, fold(u).min(fold(v)));
        let (px, py) = ((u - u.floor() - 0.5) + (v - v.floor() - 0.5), ((u - u.floor()) - (v - v.floor())) * 0.8);
        let (r, angle) = ((px * px + py * py).sqrt(), py.atan2(px));
        let petal = 0.17 + 0.09 * (angle * 5.0).cos();
        let flower = 1.0 - smoothstep(petal - 0.03, petal + 0.03, r);
        let heart = 1.0 - smoothstep(0.05, 0.08, r);
        let grain = 0.78 + 0.44 * fbm(x * 26.0, y * 26.0, 4, 3);
        let (base, gold) = match mood {
            Mood::Studio => (rgb(0.66, 0.64, 0.60), rgb(0.45, 0.36, 0.22)),
            _ => (rgb(0.030, 0.115, 0.125), rgb(0.42, 0.28, 0.10)),
        };
        let mut paint = mix(base, gold, 0.75 * line.max(flower));
        paint = mix(paint, rgb(0.55, 0.12, 0.08), heart * 0.9);
        // The light decreases to the right, and the shadow of the vase is on the wall next to it.
        let fall = 1.0 - 0.22 * (x / half[0]) - 0.12 * y;
        lit(paint, grain * fall * mood.light([0.0, 0.0, 1.0], x, y))
    };
    Item::Surface { shape: Shape::Card { z: -1.0 }, area: EVERYWHERE, texture: Box::new(texture) }
}

const EVERYWHERE: [f32; 4] = [-1e3, -1e3, 1e3, 1e3];

fn cloth(half: [f32; 2], mood: Mood, fruits: &[Fruit], vase_x: f32, spread: f32) -> Item {
    // The shadows depend on the place and the width of each object.
    let mut stands: Vec<[f32; 4]> =
        fruits.iter().map(|f| [f.center[0], f.center[1] + 0.93 * f.radii[1], f.radii[0], f.radii[1]]).collect();
    stands.push([vase_x, ground(-0.45), 0.2, 0.42]);
    stands.push([0.5 * spread, ground(-0.72), 0.34, 0.2]);
    let texture = move |x: f32, y: f32| {
        if y < BACK {
            return [0.0; 4];
        }
        // Along the cloth, a unit of y is SLOPE of z, at a low viewing angle.
        let z = (y - BACK) * SLOPE * 1.45;
        let (u, v) = (x * 5.0 + 0.25, z * 5.0 + 0.1);
        let (a, b) = (u.rem_euclid(2.0) < 1.0, v.rem_euclid(2.0) < 1.0);
        // The gingham has woven threads of two colors.
        let weave = 0.86 + 0.14 * ((x * 420.0 / std::f32::consts::TAU).fract() - 0.5).abs() * 2.0;
        let twill = 0.8 + 0.4 * fbm(x * 60.0, z * 60.0, 3, 17);
        let white = if mood == Mood::Studio { rgb(0.86, 0.85, 0.82) } else { rgb(0.62, 0.58, 0.5) };
        let red = if mood == Mood::Studio { rgb(0.62, 0.3, 0.26) } else { rgb(0.42, 0.035, 0.03) };
        let mut paint = match (a, b) {
            (true, true) => red,
            (false, false) => white,
            _ => mix(white, red, 0.48),
        };
        // A blue thread runs through the middle of every white square.
        let (cu, cv) = (u.rem_euclid(1.0) - 0.5, v.rem_euclid(1.0) - 0.5);
        if !a && !b && cu.abs().min(cv.abs()) < 0.035 {
            paint = mix(paint, rgb(0.04, 0.10, 0.34), 0.75);
        }
        let mut shade = 1.0f32;
        for &[sx, sy, rx, ry] in &stands {
            if (x - sx).abs() > 3.5 * (rx + 0.4 * ry) {
                continue;
            }
            // The contact shadow is dark and narrow, and the cast shadow is wide, to the right and behind.
            let contact = ((x - sx) / (1.05 * rx)).powi(2) + ((y - sy) / (0.3 * rx)).powi(2);
            shade *= 1.0 - 0.72 * (-1.6 * contact).exp();
            let (cx, cy) = (sx + 0.75 * rx + 0.25 * ry, sy - 0.05 * ry);
            let cast = ((x - cx) / (1.25 * rx + 0.4 * ry)).powi(2) + ((y - cy) / (0.33 * rx)).powi(2);
            shade *= 1.0 - 0.6 * (1.0 - smoothstep(0.55, 1.35, cast));
        }
        // Little light reaches the corner between the wall and the cloth.
        shade *= 0.55 + 0.45 * smoothstep(BACK, BACK + 0.09, y);
        let fall = 1.0 - 0.18 * (x / half[0]);
        lit(paint, weave * twill * shade * fall * mood.light([0.0, -0.92, 0.39], x, y))
    };
    Item::Surface {
        shape: Shape::Slope { at_zero: AT_ZERO, slope: SLOPE },
        area: [-1e3, BACK, 1e3, 1e3],
        texture: Box::new(texture),
    }
}

/// Makes a cream card with lettering and ruled lines, which leans at the back.
fn card(x0: f32, mood: Mood) -> Item {
    let z = -0.74;
    let (w, bottom) = (0.36, ground(z) + 0.01);
    let top = bottom - 0.52;
    let texture = move |x: f32, y: f32| {
        let (u, v) = ((x - x0) / w, (y - top) / (bottom - top));
        let paper = 0.92 + 0.16 * fbm(x * 45.0, y * 45.0, 3, 5);
        let mut paint =
            if u.abs() > 0.94 || !(0.04..0.96).contains(&v) { rgb(0.30, 0.16, 0.07) } else { rgb(0.68, 0.60, 0.44) };
        let cell = w * 2.0 * 0.8 / 35.0;
        if ink("EYEBOX", (x - x0 + w * 0.8) / cell, (y - top - 0.13 * (bottom - top)) / cell) {
            paint = rgb(0.03, 0.03, 0.06);
        }
        // The card has ruled lines that become finer, and a sun.
        let rule = (v - 0.52) / 0.4;
        if (0.0..1.0).contains(&rule) && u.abs() < 0.8 {
            let count = 3.0 + 5.0 * ((u + 0.8) * 2.5).floor();
            if (rule * count).fract() < 0.5 {
                paint = mix(paint, rgb(0.10, 0.07, 0.20), 0.85);
            }
        }
        lit(paint, paper * mood.light([0.15, -0.2, 0.97], x, y))
    };
    Item::Surface { shape: Shape::Card { z }, area: [x0 - w, top, x0 + w, bottom], texture: Box::new(texture) }
}

const VASE_TOP: f32 = -0.36;
const VASE_BOTTOM: f32 = 0.4;

/// Returns the radius of the vase at height y.
fn vase_radius(y: f32) -> f32 {
    let t = ((y - VASE_TOP) / (VASE_BOTTOM - VASE_TOP)).clamp(0.0, 1.0);
    let belly = (-((t - 0.62) / 0.27).powi(2)).exp();
    let lip = (-(t / 0.05).powi(2)).exp();
    0.095 + 0.155 * belly + 0.045 * lip + 0.02 * t
}

fn vase(x0: f32, mood: Mood) -> Item {
    let texture = move |x: f32, y: f32| {
        let r = vase_radius(y);
        let nx = ((x - x0) / r).clamp(-1.0, 1.0);
        let nz = (1.0 - nx * nx).sqrt();
        // The vase is viewed a little from above, so its foot and lip are ellipses.
        let round = 0.22 * r * nz;
        if y > VASE_BOTTOM - 0.05 + round || y < VASE_TOP + 0.03 - round * 0.9 {
            return [0.0; 4];
        }
        if y < VASE_TOP + 0.03 + round * 0.9 && y < VASE_TOP + 0.08 {
            let rim = smoothstep(0.78, 0.9, (nx * nx + ((y - VASE_TOP - 0.03) / (0.2 * r)).powi(2)).sqrt());
            return lit(mix(rgb(0.012, 0.014, 0.02), rgb(0.55, 0.57, 0.6), rim), mood.light([0.0, -0.5, 0.8], x, y));
        }
        let slope = (vase_radius(y + 0.004) - vase_radius(y - 0.004)) / 0.008;
        let norm = 1.0 / (1.0 + slope * slope).sqrt();
        let n = [nx * norm, -slope * norm, nz * norm];
        // Bands, a zigzag and a garland are painted around the vase.
        let angle = nx.asin() / std::f32::consts::PI;
        let t = (y - VASE_TOP) / (VASE_BOTTOM - VASE_TOP) + 0.05 * nz * 0.5;
        let glaze = rgb(0.66, 0.70, 0.72);
        let blue = rgb(0.015, 0.05, 0.30);
        let mut pattern: f32 = 0.0;
        for (at, width) in [(0.16, 0.012), (0.22, 0.006), (0.40, 0.010), (0.84, 0.010), (0.90, 0.016)] {
            pattern = pattern.max(1.0 - smoothstep(width, width + 0.006, (t - at).abs()));
        }
        let zigzag = 0.31 + 0.05 * (4.0 * fold(angle * 9.0) - 1.0);
        pattern = pattern.max(1.0 - smoothstep(0.011, 0.018, (t - zigzag).abs()));
        let (gu, gv) = (angle * 7.0, (t - 0.62) * 6.0);
        let wave = 0.5 * (gu * std::f32::consts::TAU * 0.5).sin();
        pattern = pattern.max(1.0 - smoothstep(0.05, 0.09, (gv - wave).abs()));
        let (bu, bv) = ((gu - gu.round()) * 1.5, gv - 0.9 * if gu.round().rem_euclid(2.0) == 0.0 { 0.6 } else { -0.6 });
        let (br, ba) = ((bu * bu + bv * bv).sqrt(), bv.atan2(bu));
        let bloom = 0.26 + 0.10 * (ba * 6.0).cos();
        pattern = pattern.max((1.0 - smoothstep(bloom - 0.04, bloom + 0.04, br)) * smoothstep(0.06, 0.1, br));
        let paint = mix(glaze, blue, pattern * (0.8 + 0.2 * noise(x * 60.0, y * 60.0, 8)));
        shine(lit(paint, mood.light(n, x, y)), n, 0.5, mood, x, y)
    };
    let area = [x0 - 0.3, VASE_TOP - 0.02, x0 + 0.3, VASE_BOTTOM + 0.02];
    Item::Surface { shape: Shape::Turned { axis: [x0, -0.45], radius: vase_radius }, area, texture: Box::new(texture) }
}

/// Adds the highlight of a glazed or waxy surface. It is painted, because a light field of matte surfaces has no
/// highlights.
fn shine(paint: Paint, n: [f32; 3], gloss: f32, mood: Mood, x: f32, y: f32) -> Paint {
    // This direction is halfway between the light and the eye.
    let half = [LIGHT[0], LIGHT[1], LIGHT[2] + 1.0];
    let length = (half[0] * half[0] + half[1] * half[1] + half[2] * half[2]).sqrt();
    let cos = ((n[0] * half[0] + n[1] * half[1] + n[2] * half[2]) / length).max(0.0);
    let strength = gloss * (cos.powi(60) + 0.12 * cos.powi(8)) * mood.light(LIGHT, x, y).min(1.0);
    [paint[0] + strength * 0.9, paint[1] + strength * 0.88, paint[2] + strength * 0.82, paint[3]]
}

/// Adds stalks, leaves and berries in the vase.
fn bouquet(x0: f32, mood: Mood, items: &mut Vec<Item>) {
    for k in 0..26i32 {
        let r = |s: u32| hash(k, 7, s);
        let z = -0.62 + 0.34 * r(1);
        let lean = (r(2) - 0.5) * 0.95;
        let height = 0.28 + 0.27 * r(3);
        let root = [x0 + 0.04 * (r(4) - 0.5), VASE_TOP + 0.06, -0.45];
        let tip = [x0 + lean * (0.5 + height), VASE_TOP - height, z];
        let green = [0.05 + 0.06 * r(5), 0.16 + 0.12 * r(6), 0.03];
        let colors = [green.map(|c| c * 0.5), green.map(|c| c * 1.5)];
        let blade = Blade { root, tip, bend: -0.06 * lean, width: 0.007 + 0.014 * r(8) * r(8), colors };
        items.push(dim(blade, mood));
        if k % 2 == 0 {
            let size = 0.028 + 0.02 * r(9);
            let peel: Peel = match k % 6 {
                0 => |n| mix(rgb(0.80, 0.42, 0.05), rgb(0.85, 0.62, 0.1), noise(n[0] * 5.0, n[1] * 5.0, 4)),
                2 => |n| mix(rgb(0.70, 0.10, 0.16), rgb(0.85, 0.3, 0.3), noise(n[0] * 5.0, n[1] * 5.0, 4)),
                _ => |n| mix(rgb(0.34, 0.30, 0.62), rgb(0.55, 0.5, 0.8), noise(n[0] * 5.0, n[1] * 5.0, 4)),
            };
            let fruit = Fruit { center: [tip[0], tip[1], z], radii: [size, size], gloss: 0.2, peel };
            items.push(ball(fruit, mood));
        }
    }
}

const CHERRY: f32 = 0.083;

fn fruits(spread: f32) -> Vec<Fruit> {
    let stand = |x: f32, z: f32, radii: [f32; 2], gloss, peel| {
        let center = [x * spread, ground(z) - 0.9 * radii[1], z];
        Fruit { center, radii, gloss, peel }
    };
    vec![
        stand(0.64, -0.34, [0.2, 0.195], 0.25, orange as Peel),
        stand(0.14, -0.2, [0.225, 0.215], 0.55, apple),
        stand(0.45, 0.2, [0.175, 0.125], 0.3, lemon),
        stand(-0.46, 0.62, [CHERRY, CHERRY], 0.8, cherry),
        stand(-0.2, 0.7, [CHERRY, CHERRY], 0.8, cherry),
        stand(-0.335, 0.84, [CHERRY, CHERRY], 0.8, cherry),
    ]
}

fn orange(n: [f32; 3]) -> Paint {
    let pores = noise(n[0] * 26.0, n[1] * 26.0, 21) * 0.35 + noise(n[0] * 13.0, n[1] * 13.0, 22) * 0.2;
    let (dx, dy) = (n[0] - 0.15, n[1] + 0.55);
    let navel = 1.0 - smoothstep(0.03, 0.08, (dx * dx + dy * dy * 2.0).sqrt());
    mix(lit(rgb(0.88, 0.33, 0.02), 0.72 + 0.5 * pores), rgb(0.16, 0.2, 0.03), navel)
}

fn apple(n: [f32; 3]) -> Paint {
    // Streaks run from the stalk, which leans towards the viewer.
    let (dx, dy) = (n[0] + 0.05, n[1] + 0.8);
    let (angle, r) = (dx.atan2(dy), (dx * dx + dy * dy).sqrt());
    let streak = fbm(angle * 22.0, r * 2.2, 3, 31);
    let blush =
        smoothstep(0.32, 0.62, 0.55 * streak + 0.35 * noise(n[0] * 1.7 + 4.0, n[1] * 1.7, 32) + 0.12 - 0.15 * n[0]);
    let mut paint = mix(rgb(0.68, 0.50, 0.10), rgb(0.52, 0.022, 0.02), blush);
    let spot = noise(n[0] * 34.0, n[1] * 34.0, 33);
    paint = mix(paint, rgb(0.85, 0.62, 0.35), smoothstep(0.86, 0.93, spot) * 0.7);
    let hollow = 1.0 - smoothstep(0.1, 0.26, (dx * dx + dy * dy * 3.0).sqrt());
    mix(paint, rgb(0.08, 0.06, 0.02), hollow * 0.85)
}

fn lemon(n: [f32; 3]) -> Paint {
    let pores = noise(n[0] * 24.0, n[1] * 17.0, 41) * 0.3 + noise(n[0] * 60.0, n[1] * 42.0, 42) * 0.15;
    let tip = smoothstep(0.8, 0.97, n[0].abs());
    mix(lit(rgb(0.86, 0.66, 0.04), 0.8 + 0.5 * pores), rgb(0.45, 0.5, 0.05), tip * 0.8)
}

fn cherry(n: [f32; 3]) -> Paint {
    mix(rgb(0.30, 0.006, 0.015), rgb(0.55, 0.03, 0.02), 0.6 * noise(n[0] * 2.0 + 9.0, n[1] * 2.0, 51))
}

fn ball(fruit: Fruit, mood: Mood) -> Item {
    let Fruit { center, radii: [rx, ry], gloss, peel } = fruit;
    let texture = move |x: f32, y: f32| {
        // The paint continues past the outline, because a tilted view sees slightly further around.
        let (nx, ny) = ((x - center[0]) / rx, (y - center[1]) / ry);
        let out = (nx * nx + ny * ny).sqrt().max(1.0);
        let (nx, ny) = (nx / out, ny / out);
        let n = [nx, ny, (1.0 - nx * nx - ny * ny).max(0.0).sqrt()];
        let paint = lit(peel(n), mood.light(n, x, y));
        // The cloth reflects some warm light from below, but none at the foot.
        let bounce =
            if mood == Mood::Lamp { 0.0 } else { 0.10 * smoothstep(0.1, 0.8, ny) * (1.0 - smoothstep(0.8, 1.0, ny)) };
        let color = peel(n);
        let paint =
            [paint[0] + color[0] * bounce, paint[1] + color[1] * bounce * 0.7, paint[2] + color[2] * bounce * 0.6, 1.0];
        shine(paint, n, gloss, mood, x, y)
    };
    let pad = 0.02;
    let area = [center[0] - rx - pad, center[1] - ry - pad, center[0] + rx + pad, center[1] + ry + pad];
    Item::Surface { shape: Shape::Ball { center, radii: [rx, ry] }, area, texture: Box::new(texture) }
}

fn stalk(fruit: &Fruit) -> Blade {
    let [x, y, z] = fruit.center;
    let lean = 0.5 * (hash((x * 100.0) as i32, 3, 61) - 0.3);
    let (root, tip) = ([x, y - 0.055, z + 0.01], [x + lean * 0.5, y - 0.36, z - 0.02]);
    Blade { root, tip, bend: 0.03, width: 0.008, colors: [[0.10, 0.16, 0.03], [0.16, 0.22, 0.05]] }
}

fn dim(blade: Blade, mood: Mood) -> Item {
    let middle = [0.5 * (blade.root[0] + blade.tip[0]), 0.5 * (blade.root[1] + blade.tip[1])];
    let light = mood.light([-0.2, -0.3, 0.9], middle[0], middle[1]);
    Item::Blade(Blade { colors: blade.colors.map(|c| c.map(|v| v * light * 1.4)), ..blade })
}

/// Adds long blades close to the eye, at the right edge.
fn foreground(half: [f32; 2], mood: Mood, items: &mut Vec<Item>) {
    for k in 0..9i32 {
        let r = |s: u32| hash(k, 11, s);
        let z = 0.86 + 0.14 * (k as f32 / 8.0);
        let x = half[0] * 0.80 + 0.24 * (r(1) - 0.4);
        let green = [0.10 + 0.10 * r(2), 0.26 + 0.16 * r(3), 0.04];
        let blade = Blade {
            root: [x, half[1] + 0.15, z],
            tip: [x - 0.30 * (r(4) - 0.25), half[1] - 0.75 - 0.75 * r(5), z - 0.05],
            bend: 0.08 * (r(6) - 0.3),
            width: 0.012 + 0.012 * r(7),
            colors: [green.map(|c| c * 0.45), green.map(|c| c * 1.3)],
        };
        items.push(dim(blade, mood));
    }
}
