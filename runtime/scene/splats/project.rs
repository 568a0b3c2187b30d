//! Projects splats to the picture of a camera that is displaced in the plane of the pupil (Zwicker et al. 2001).

use crate::splats::camera::Camera;
use crate::splats::cloud::Cloud;
use crate::splats::harmonics::{count, harmonics};
use eyebox_kernels::draw_splats::{Args, FAINTEST, Splat};
use half::f16;
use rayon::prelude::*;

/// Variance of a pixel that is added to splats, in square pixels, for usual splats and for splats of antialiased
/// training.
const PIXEL: [f32; 2] = [0.3, 0.1];
/// The smallest compensation of the opacity of splats of antialiased training, squared.
const LEAST: f32 = 2.5e-5;
/// Splats outside of the picture are projected as from this factor of its half side, because the projection is linear
/// around the center of a splat alone.
const BEYOND: f32 = 1.3;
/// The nearest distance that is drawn, in units of the scene, and as a share of the median distance. The first is that
/// of 3D Gaussian splatting.
const NEAREST: [f32; 2] = [0.2, 0.1];
/// Splats that are projected together.
const BLOCK: usize = 4096;

/// The picture of a camera that is displaced to the right and downwards.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Displaced {
    /// Displacement in units of the scene.
    pub by: [f32; 2],
    /// Pixels by which all of the picture is moved to the right and downwards.
    pub moved: [f32; 2],
}

/// Splats in the axes of a camera, with the nearest first. All views have this order, because their cameras are in a
/// plane parallel to the picture.
pub(crate) struct Ordered {
    cloud: Cloud,
    /// Pixels per tangent of the angle from the axis.
    pub focal: f32,
    args: Args,
    /// Largest tangents (x, y) in the picture.
    tangents: [f32; 2],
    /// Axes of the camera in the scene.
    axes: [[f32; 3]; 3],
}

impl Ordered {
    /// Orders the splats in front of a camera whose picture has `height` x `width` pixels.
    pub fn new(mut cloud: Cloud, camera: &Camera, size: [usize; 2]) -> Self {
        let axes = axes_of(camera);
        cloud.places.par_iter_mut().for_each(|place| *place = camera.seen(*place));
        cloud.spreads.par_iter_mut().for_each(|spread| *spread = turned(&axes, spread));
        let order = order(&cloud.places);
        // A value after the other is ordered, so that few of them are in memory twice.
        cloud.places = picked(&cloud.places, &order, 1);
        cloud.spreads = picked(&cloud.spreads, &order, 1);
        cloud.opacities = picked(&cloud.opacities, &order, 1);
        cloud.colors = picked(&cloud.colors, &order, 1);
        cloud.rest = picked(&cloud.rest, &order, 3 * count(cloud.degree));
        Self::framed(cloud, camera, size)
    }

    /// Orders splats like [`new`](Self::new), and leaves them as they are for the next camera.
    pub fn of(all: &Cloud, camera: &Camera, size: [usize; 2]) -> Self {
        let axes = axes_of(camera);
        let places: Vec<[f32; 3]> = all.places.par_iter().map(|place| camera.seen(*place)).collect();
        let order = order(&places);
        let cloud = Cloud {
            places: picked(&places, &order, 1),
            spreads: order.par_iter().map(|i| turned(&axes, &all.spreads[*i as usize])).collect(),
            opacities: picked(&all.opacities, &order, 1),
            colors: picked(&all.colors, &order, 1),
            degree: all.degree,
            rest: picked(&all.rest, &order, 3 * count(all.degree)),
            antialiased: all.antialiased,
        };
        Self::framed(cloud, camera, size)
    }

    fn framed(cloud: Cloud, camera: &Camera, [height, width]: [usize; 2]) -> Self {
        let half = (camera.field / 2.0).tan();
        let focal = (height.min(width) as f64 / 2.0 / half) as f32;
        let tangents = [width, height].map(|n| n as f32 / 2.0 / focal);
        Self { cloud, focal, args: Args::new(height, width), tangents, axes: axes_of(camera) }
    }

    /// Returns the size of the pictures.
    pub fn args(&self) -> &Args {
        &self.args
    }

    /// Returns the bytes in memory, and the most bytes of a view that is drawn.
    pub fn bytes(&self) -> [u64; 2] {
        let count = self.cloud.len() as u64;
        [count * Cloud::bytes_of_one(self.cloud.degree), 3 * count * size_of::<Splat>() as u64]
    }

    /// Returns the splats that are in the picture, in their order.
    pub fn project(&self, view: &Displaced) -> Vec<Splat> {
        let blocks: Vec<Vec<Splat>> = (0..self.cloud.len().div_ceil(BLOCK))
            .into_par_iter()
            .map(|block| {
                let range = block * BLOCK..self.cloud.len().min((block + 1) * BLOCK);
                eyebox_kernels::simd(
                    #[inline(always)]
                    || {
                        let mut rest = [0.0; 3 * crate::splats::harmonics::MOST];
                        range.filter_map(|at| self.splat(at, view, &mut rest)).collect()
                    },
                )
            })
            .collect();
        blocks.concat()
    }

    /// Projects a splat, unless it is outside of the picture. `rest` has room for its harmonics.
    #[inline(always)]
    fn splat(&self, at: usize, view: &Displaced, rest: &mut [f32]) -> Option<Splat> {
        let [x, y, z] = self.cloud.places[at];
        let from = [x - view.by[0], y - view.by[1], z];
        let scale = self.focal / z;
        let middle = [self.args.width, self.args.height].map(|n| (n as f32 - 1.0) / 2.0);
        let center = [0, 1].map(|i| scale * from[i] + middle[i] + view.moved[i]);
        let slope = [0, 1].map(|i| {
            let most = BEYOND * self.tangents[i];
            -scale * (from[i] / z).clamp(-most, most)
        });
        let [sxx, sxy, sxz, syy, syz, szz] = self.cloud.spreads[at];
        let xx = scale * (scale * sxx + 2.0 * slope[0] * sxz) + slope[0] * slope[0] * szz;
        let xy = scale * (scale * sxy + slope[1] * sxz + slope[0] * syz) + slope[0] * slope[1] * szz;
        let yy = scale * (scale * syy + 2.0 * slope[1] * syz) + slope[1] * slope[1] * szz;
        let pixel = PIXEL[usize::from(self.cloud.antialiased)];
        let (wide, high) = (xx + pixel, yy + pixel);
        let area = wide * high - xy * xy;
        let mut opacity = self.cloud.opacities[at];
        if self.cloud.antialiased {
            opacity *= ((xx * yy - xy * xy) / area).max(LEAST).sqrt();
        }
        // A negative area is a rounding error of a splat that is far outside of the picture.
        if !(area > 0.0 && area.is_finite() && opacity >= FAINTEST) {
            return None;
        }
        // The opacity falls below the faintest one at this distance.
        let reach = 2.0 * (opacity / FAINTEST).ln();
        let span = |i: usize, variance: f32, most: u32| {
            let far = (reach * variance).sqrt();
            let [first, end] = [(center[i] - far).floor(), (center[i] + far).floor() + 2.0].map(|v| v.max(0.0) as u32);
            let [first, end] = [first.min(most), end.min(most)];
            (first < end).then_some(first | end << 16)
        };
        let (columns, rows) = (span(0, wide, self.args.width)?, span(1, high, self.args.height)?);
        Some(Splat {
            x: center[0],
            y: center[1],
            conic: [high / area, -xy / area, wide / area],
            opacity,
            color: self.color(at, from, rest),
            inverse: 1.0 / z,
            columns,
            rows,
        })
    }

    /// Returns the color of a splat in the direction in which the camera sees it.
    #[inline(always)]
    fn color(&self, at: usize, from: [f32; 3], room: &mut [f32]) -> [f32; 3] {
        let mut color = self.cloud.colors[at];
        let halves: &[f16] = self.cloud.rest_of(at);
        if !halves.is_empty() {
            let length = (from[0] * from[0] + from[1] * from[1] + from[2] * from[2]).sqrt();
            let direction =
                [0, 1, 2].map(|i| (0..3).map(|k| self.axes[k][i] * from[k]).sum::<f32>() / length.max(1e-30));
            let rest = &mut room[..halves.len()];
            half::slice::HalfFloatSliceExt::convert_to_f32_slice(halves, rest);
            for (values, weight) in rest.chunks_exact(3).zip(harmonics(direction)) {
                color.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        color.map(|v| v.max(0.0))
    }
}

/// Returns a covariance of the scene in the axes of a camera.
fn turned(axes: &[[f32; 3]; 3], &[xx, xy, xz, yy, yz, zz]: &[f32; 6]) -> [f32; 6] {
    let spread = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let entry = |a: usize, b: usize| {
        (0..3).map(|i| (0..3).map(|j| axes[a][i] * spread[i][j] * axes[b][j]).sum::<f32>()).sum::<f32>()
    };
    [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)]
}

fn axes_of(camera: &Camera) -> [[f32; 3]; 3] {
    camera.axes.map(|axis| axis.map(|v| v as f32))
}

/// Returns the indices of the places that are far enough in front of the camera, with the nearest first.
fn order(places: &[[f32; 3]]) -> Vec<u32> {
    let distance = |i: &u32| places[*i as usize][2];
    let mut order: Vec<u32> = (0..places.len() as u32).filter(|i| distance(i) > 0.0).collect();
    order.par_sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    let median = order.get(order.len() / 2).map_or(0.0, distance);
    let nearest = NEAREST[0].min(NEAREST[1] * median);
    order.drain(..order.partition_point(|i| distance(i) < nearest));
    order
}

/// Returns the entries of `order`, which have `each` values.
fn picked<T: Copy + Default + Send + Sync>(values: &[T], order: &[u32], each: usize) -> Vec<T> {
    let mut found = vec![T::default(); order.len() * each];
    if each > 0 {
        let pairs = found.par_chunks_exact_mut(each).zip(order);
        pairs.for_each(|(found, i)| found.copy_from_slice(&values[*i as usize * each..][..each]));
    }
    found
}
