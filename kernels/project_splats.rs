//! Projects the splats of a scene to the picture of a camera that is displaced in the plane of the pupil (Zwicker et al.
//! 2001).
//!
//! The kernel reads splats in the axes of the scene, in an order that the host gives, or splats that are already in the
//! axes of the camera and in order. Its result has a place for every splat of the order. A splat that is not in the
//! picture has no rows and columns.

use crate::draw_splats::{FAINTEST, Splat};
use crate::splat_colors::{MOST, count, harmonics};
use bytemuck::{Pod, Zeroable};

/// Variance of a pixel that is added to splats, in square pixels, for usual splats and for splats of antialiased
/// training.
pub const PIXEL: [f32; 2] = [0.3, 0.1];
/// The smallest compensation of the opacity of splats of antialiased training, squared.
pub const LEAST: f32 = 2.5e-5;
/// Splats outside of the picture are projected as from this factor of its half side, because the projection is linear
/// around the center of a splat alone.
pub const BEYOND: f32 = 1.3;
/// Words of 4 bytes of a stored splat without harmonics.
pub const PLAIN: usize = 13;
/// Bits of [`Args::kind`] with the degree of the harmonics.
pub const DEGREE: u32 = 3;
/// Set in [`Args::kind`] for splats of antialiased training (Yu et al. 2024).
pub const ANTIALIASED: u32 = 4;
/// Set in [`Args::kind`] for splats that are in the axes of the camera and in order.
pub const ORDERED: u32 = 8;

/// The camera, and what the splats are.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Args {
    /// Directions of the camera to the right, downwards and forward in the scene, each of length 1.
    pub axes: [[f32; 3]; 3],
    /// Position of the camera in the scene, rounded. It is not used for splats in the axes of the camera.
    pub place: [f32; 3],
    /// The rest of the position, so that cameras far from the origin are as precise as others.
    pub place_rest: [f32; 3],
    /// Displacement of the camera to the right and downwards, in units of the scene.
    pub by: [f32; 2],
    /// Pixels by which all of the picture is moved to the right and downwards.
    pub moved: [f32; 2],
    /// Pixels per tangent of the angle from the axis.
    pub focal: f32,
    /// Number of pixel rows.
    pub height: u32,
    /// Number of pixel columns.
    pub width: u32,
    /// Number of splats in the order.
    pub count: u32,
    /// The degree of the harmonics, [`ANTIALIASED`] and [`ORDERED`].
    pub kind: u32,
}

/// A splat in space.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gaussian {
    /// Center in units of the scene.
    pub place: [f32; 3],
    /// Covariance (xx, xy, xz, yy, yz, zz) in square units.
    pub spread: [f32; 6],
    /// Opacity from 0 to 1.
    pub opacity: f32,
    /// Color that is the same in all directions.
    pub color: [f32; 3],
}

impl Gaussian {
    /// Adds the words that the shader reads. `rest` has the halves of its harmonics, as (harmonic, color).
    pub fn store(&self, rest: &[u16], words: &mut Vec<u32>) {
        let plain = [&self.place[..], &self.spread, &[self.opacity], &self.color];
        words.extend(plain.into_iter().flatten().map(|v| v.to_bits()));
        let pair = |pair: &[u16]| u32::from(pair[0]) | u32::from(pair.get(1).copied().unwrap_or(0)) << 16;
        words.extend(rest.chunks(2).map(pair));
    }
}

/// Returns the words of 4 bytes of a stored splat.
pub const fn stored_words(degree: usize) -> usize {
    PLAIN + (3 * count(degree)).div_ceil(2)
}

/// Returns a covariance of the scene in the axes of a camera.
#[inline(always)]
pub fn turned(axes: &[[f32; 3]; 3], &[xx, xy, xz, yy, yz, zz]: &[f32; 6]) -> [f32; 6] {
    let spread = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let entry = |a: usize, b: usize| {
        (0..3).map(|i| (0..3).map(|j| axes[a][i] * spread[i][j] * axes[b][j]).sum::<f32>()).sum::<f32>()
    };
    [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)]
}

/// Projects a splat, unless it is outside of the picture. `rest` returns its harmonics as (harmonic, color), and is
/// called for splats in the picture.
#[inline(always)]
pub fn project<'a>(args: &Args, gaussian: &Gaussian, rest: impl FnOnce() -> &'a [f32]) -> Option<Splat> {
    let (mut place, mut spread) = (gaussian.place, gaussian.spread);
    if args.kind & ORDERED == 0 {
        let from = [0, 1, 2].map(|i| (place[i] - args.place[i]) - args.place_rest[i]);
        place = args.axes.map(|axis| axis[0] * from[0] + axis[1] * from[1] + axis[2] * from[2]);
        spread = turned(&args.axes, &spread);
    }
    let [x, y, z] = place;
    let from = [x - args.by[0], y - args.by[1], z];
    let (scale, size) = (args.focal / z, [args.width, args.height]);
    let middle = size.map(|n| (n as f32 - 1.0) / 2.0);
    let center = [0, 1].map(|i| scale * from[i] + middle[i] + args.moved[i]);
    let slope = [0, 1].map(|i| {
        let most = BEYOND * (size[i] as f32 / 2.0 / args.focal);
        -scale * (from[i] / z).clamp(-most, most)
    });
    let [sxx, sxy, sxz, syy, syz, szz] = spread;
    let xx = scale * (scale * sxx + 2.0 * slope[0] * sxz) + slope[0] * slope[0] * szz;
    let xy = scale * (scale * sxy + slope[1] * sxz + slope[0] * syz) + slope[0] * slope[1] * szz;
    let yy = scale * (scale * syy + 2.0 * slope[1] * syz) + slope[1] * slope[1] * szz;
    let antialiased = args.kind & ANTIALIASED != 0;
    let pixel = PIXEL[usize::from(antialiased)];
    let (wide, high) = (xx + pixel, yy + pixel);
    let area = wide * high - xy * xy;
    let mut opacity = gaussian.opacity;
    if antialiased {
        opacity *= ((xx * yy - xy * xy) / area).max(LEAST).sqrt();
    }
    // A negative area is a rounding error of a splat that is far outside of the picture.
    if !(area > 0.0 && area.is_finite() && opacity >= FAINTEST) {
        return None;
    }
    // The opacity falls below the faintest one at this distance.
    let reach = 2.0 * (opacity / FAINTEST).ln();
    let span = |i: usize, variance: f32| {
        let far = (reach * variance).sqrt();
        let [first, end] = [(center[i] - far).floor(), (center[i] + far).floor() + 2.0].map(|v| v.max(0.0) as u32);
        let [first, end] = [first.min(size[i]), end.min(size[i])];
        (first < end).then_some(first | end << 16)
    };
    let (columns, rows) = (span(0, wide)?, span(1, high)?);
    Some(Splat {
        x: center[0],
        y: center[1],
        conic: [high / area, -xy / area, wide / area],
        opacity,
        color: color(args, from, gaussian.color, rest()),
        inverse: 1.0 / z,
        columns,
        rows,
    })
}

/// Returns the color of a splat in the direction in which the camera sees it.
#[inline(always)]
fn color(args: &Args, from: [f32; 3], mut color: [f32; 3], rest: &[f32]) -> [f32; 3] {
    if !rest.is_empty() {
        let length = (from[0] * from[0] + from[1] * from[1] + from[2] * from[2]).sqrt();
        let direction = [0, 1, 2].map(|i| (0..3).map(|k| args.axes[k][i] * from[k]).sum::<f32>() / length.max(1e-30));
        let weights: [f32; MOST] = harmonics(direction);
        for (values, weight) in rest.chunks_exact(3).zip(weights) {
            color.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
        }
    }
    color.map(|v| v.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURN: [[f32; 3]; 3] = [[0.6, 0.0, -0.8], [0.0, 1.0, 0.0], [0.8, 0.0, 0.6]];

    fn args() -> Args {
        Args {
            axes: TURN,
            place: [1.0, -2.0, 0.5],
            by: [0.01, -0.02],
            focal: 100.0,
            height: 80,
            width: 120,
            ..Args::default()
        }
    }

    /// A splat in the axes of the scene gives the same as one that was turned before.
    #[test]
    fn the_axes_of_the_scene_and_of_the_camera_give_the_same() {
        let gaussian = Gaussian {
            place: [4.0, -1.9, 4.2],
            spread: [0.02, 0.005, -0.003, 0.03, 0.004, 0.01],
            opacity: 0.8,
            color: [0.3, 0.6, 0.9],
        };
        let rest: Vec<f32> = (0..45).map(|i| 0.02 * i as f32 - 0.3).collect();
        let scene = Args { kind: 3 | ANTIALIASED, count: 1, ..args() };
        let from: Vec<f32> = (0..3).map(|i| gaussian.place[i] - scene.place[i]).collect();
        let place = TURN.map(|axis| (0..3).map(|i| axis[i] * from[i]).sum());
        let seen = Gaussian { place, spread: turned(&TURN, &gaussian.spread), ..gaussian };
        let one = project(&scene, &gaussian, || &rest).expect("it is in the picture");
        let other =
            project(&Args { kind: scene.kind | ORDERED, ..scene }, &seen, || &rest).expect("it is in the picture");
        let near = |a: f32, b: f32| (a - b).abs() < 1e-4 * a.abs().max(1.0);
        assert!(near(one.x, other.x) && near(one.y, other.y) && near(one.inverse, other.inverse), "{one:?} {other:?}");
        assert!(one.conic.iter().zip(other.conic).all(|(a, b)| near(*a, b)), "{one:?} {other:?}");
        assert!(one.color.iter().zip(other.color).all(|(a, b)| near(*a, b)), "{one:?} {other:?}");
        assert_eq!((one.columns, one.rows), (other.columns, other.rows));
    }

    /// A ball whose projection is computed by hand.
    #[test]
    fn a_ball_on_the_axis_is_a_disc() {
        let ball = Gaussian {
            place: [0.0, 0.0, 2.0],
            spread: [0.01, 0.0, 0.0, 0.01, 0.0, 0.01],
            opacity: 1.0,
            color: [-1.0, 0.5, 2.0],
        };
        let straight =
            Args { axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], place: [0.0; 3], by: [0.0; 2], ..args() };
        let splat = project(&straight, &ball, || &[]).expect("it is in the picture");
        // 0.1 units at a distance of 2 are 5 pixels, and a pixel's variance is added.
        let variance = 25.3f32;
        assert!((splat.conic[0] - 1.0 / variance).abs() < 1e-6 && splat.conic[1] == 0.0, "{splat:?}");
        assert_eq!((splat.x, splat.y, splat.inverse, splat.color), (59.5, 39.5, 0.5, [0.0, 0.5, 2.0]));
        let far = (2.0 * 255f32.ln() * variance).sqrt();
        let first = (59.5 - far).floor() as u32;
        assert_eq!(splat.columns, first | ((59.5 + far).floor() as u32 + 2) << 16);
        assert!(project(&straight, &Gaussian { opacity: 0.003, ..ball }, || &[]).is_none());
        assert!(project(&straight, &Gaussian { place: [9.0, 0.0, 2.0], ..ball }, || &[]).is_none());
    }

    #[test]
    fn stored_splats_have_the_words_that_the_shader_reads() {
        let gaussian = Gaussian { color: [1.0, 2.0, 3.0], ..Gaussian::default() };
        for degree in 0..4 {
            let rest: Vec<u16> = (0..3 * count(degree) as u16).collect();
            let mut words = Vec::new();
            gaussian.store(&rest, &mut words);
            assert_eq!((words.len(), words[12]), (stored_words(degree), 3f32.to_bits()));
            assert!(degree == 0 || words[13] == 1 << 16);
        }
    }
}
