//! Orders splats for a camera, and projects them to its pictures from the plane of the pupil.

use crate::light_field::drawer::StoredSplats;
use crate::splats::camera::Camera;
use crate::splats::cloud::{Cloud, NumberedCloud};
use eyebox_kernels::draw_splats::{Args, FAINTEST, Splat};
use eyebox_kernels::project_splats::{self as kernel, ANTIALIASED, ORDERED, turned};
use eyebox_kernels::splat_colors::{MOST, count};
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

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
    cloud: NumberedCloud,
    /// The camera that is not displaced.
    camera: kernel::Args,
}

/// Returns the arguments of the kernel for a camera that is not displaced, whose picture has `height` x `width` pixels.
pub(crate) fn args_of(cloud: &Cloud, camera: &Camera, [height, width]: [usize; 2]) -> kernel::Args {
    let half = (camera.field / 2.0).tan();
    let place = camera.place.map(|v| v as f32);
    kernel::Args {
        axes: axes_of(camera),
        place,
        place_rest: [0, 1, 2].map(|i| (camera.place[i] - f64::from(place[i])) as f32),
        focal: (height.min(width) as f64 / 2.0 / half) as f32,
        height: height as u32,
        width: width as u32,
        kind: cloud.degree as u32 | if cloud.antialiased { ANTIALIASED } else { 0 },
        ..kernel::Args::default()
    }
}

impl Ordered {
    /// Orders the splats in front of a camera whose picture has `height` x `width` pixels.
    pub fn new(mut cloud: Cloud, camera: &Camera, size: [usize; 2]) -> Self {
        let axes = axes_of(camera);
        cloud.places.par_iter_mut().for_each(|place| *place = camera.seen(*place));
        cloud.spreads.par_iter_mut().for_each(|spread| *spread = turned(&axes, spread));
        let order = order(&cloud.places, |_| true);
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
        let order = order(&places, |_| true);
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

    fn framed(cloud: Cloud, camera: &Camera, size: [usize; 2]) -> Self {
        let args = args_of(&cloud, camera, size);
        let camera = kernel::Args { count: cloud.len() as u32, kind: args.kind | ORDERED, ..args };
        Self { cloud: NumberedCloud::new(cloud), camera }
    }

    /// Returns the splats for a device.
    pub fn stored(&self) -> &dyn StoredSplats {
        &self.cloud
    }

    /// Returns the size of the pictures.
    pub fn args(&self) -> Args {
        Args::new(self.camera.height as usize, self.camera.width as usize)
    }

    /// Returns the pixels per tangent of the angle from the axis.
    pub fn focal(&self) -> f32 {
        self.camera.focal
    }

    /// Returns the arguments of the kernel for a displaced camera.
    pub fn camera(&self, view: &Displaced) -> kernel::Args {
        kernel::Args { by: view.by, moved: view.moved, ..self.camera }
    }

    /// Returns the bytes in memory, and the most bytes of a view that is drawn.
    pub fn bytes(&self) -> [u64; 2] {
        let count = self.cloud.len() as u64;
        [count * Cloud::bytes_of_one(self.cloud.degree), 3 * count * size_of::<Splat>() as u64]
    }

    /// Returns the splats that are in the picture, in their order.
    pub fn project(&self, view: &Displaced) -> Vec<Splat> {
        let camera = self.camera(view);
        let blocks: Vec<Vec<Splat>> = (0..self.cloud.len().div_ceil(BLOCK))
            .into_par_iter()
            .map(|block| {
                let range = block * BLOCK..self.cloud.len().min((block + 1) * BLOCK);
                eyebox_kernels::simd(
                    #[inline(always)]
                    || {
                        let mut room = [0.0; 3 * MOST];
                        range.filter_map(|at| self.splat(at, &camera, &mut room)).collect()
                    },
                )
            })
            .collect();
        blocks.concat()
    }

    /// Projects a splat, unless it is outside of the picture. `room` is for its harmonics.
    #[inline(always)]
    fn splat(&self, at: usize, camera: &kernel::Args, room: &mut [f32]) -> Option<Splat> {
        kernel::project(camera, &self.cloud.gaussian(at), move || {
            let halves = self.cloud.rest_of(at);
            let rest = &mut room[..halves.len()];
            if !halves.is_empty() {
                halves.convert_to_f32_slice(rest);
            }
            rest
        })
    }
}

fn axes_of(camera: &Camera) -> [[f32; 3]; 3] {
    camera.axes.map(|axis| axis.map(|v| v as f32))
}

/// Returns the indices of the places that are far enough in front of the camera and that `wanted` selects, with the
/// nearest first.
pub(crate) fn order(places: &[[f32; 3]], wanted: impl Fn(usize) -> bool + Sync) -> Vec<u32> {
    let distance = |i: &u32| places[*i as usize][2];
    let mut in_front: Vec<f32> = places.par_iter().map(|place| place[2]).filter(|z| *z > 0.0).collect();
    let middle = in_front.len() / 2;
    let median = if in_front.is_empty() { 0.0 } else { *in_front.select_nth_unstable_by(middle, f32::total_cmp).1 };
    let nearest = NEAREST[0].min(NEAREST[1] * median);
    let seen = |i: &u32| distance(i) > 0.0 && distance(i) >= nearest && wanted(*i as usize);
    let mut order: Vec<u32> = (0..places.len() as u32).into_par_iter().filter(seen).collect();
    order.par_sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    order
}

/// Returns true if a splat may be in a picture of a camera. The camera is displaced by at most `by` units and `moved`
/// pixels to each side. `place` is the center in the axes of the camera, and `spread` the covariance in any axes.
pub(crate) fn may_be_seen(
    camera: &kernel::Args,
    [by, moved]: [[f32; 2]; 2],
    place: [f32; 3],
    spread: &[f32; 6],
) -> bool {
    // The trace is at least the variance along any direction.
    let (scale, trace) = (camera.focal / place[2], spread[0] + spread[3] + spread[5]);
    [camera.width, camera.height].into_iter().enumerate().all(|(i, n)| {
        let half = n as f32 / 2.0;
        let slope = kernel::BEYOND * half / camera.focal;
        let variance = scale * scale * trace * (1.0 + slope * slope) + kernel::PIXEL[0];
        let far = (2.0 * (1.0 / FAINTEST).ln() * variance).sqrt() + scale.abs() * by[i] + moved[i] + 2.0;
        let (off, most) = ((scale * place[i]).abs(), half + far * 1.001);
        // A number that is not finite may be seen.
        off <= most || off.is_nan() || most.is_nan()
    })
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

#[cfg(test)]
mod tests {
    use super::*;

    /// No splat that the kernel projects is left out, and most of those outside are.
    #[test]
    fn splats_that_may_be_seen_hold_those_that_are() {
        let mut noise = fastrand::Rng::with_seed(4);
        let mut signed = || 2.0 * noise.f32() - 1.0;
        let (by, moved) = ([0.2, 0.1], [9.0, 4.0]);
        let (mut seen, mut left_out) = (0, 0);
        for i in 0..40_000 {
            let kind = ORDERED | if i % 2 == 0 { ANTIALIASED } else { 0 };
            let camera = kernel::Args { focal: 90.0, height: 80, width: 120, kind, ..kernel::Args::default() };
            let place = [4.0 * signed(), 4.0 * signed(), 2.6 + 2.5 * signed()];
            let size = 0.3 * signed().powi(4);
            let rows = [0; 3].map(|_| [0; 3].map(|_| size * signed()));
            let dot = |a: usize, b: usize| (0..3).map(|k| rows[a][k] * rows[b][k]).sum::<f32>();
            let spread = [dot(0, 0), dot(0, 1), dot(0, 2), dot(1, 1), dot(1, 2), dot(2, 2)];
            let gaussian = kernel::Gaussian { place, spread, opacity: 1.0, color: [0.5; 3] };
            let may = may_be_seen(&camera, [by, moved], place, &spread);
            left_out += usize::from(!may);
            for (x, y) in [(0.0, 0.0), (1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
                let view = kernel::Args { by: [x * by[0], y * by[1]], moved: [x * moved[0], y * moved[1]], ..camera };
                let is = kernel::project(&view, &gaussian, || &[]).is_some();
                assert!(may || !is, "{i}: {gaussian:?}");
                seen += usize::from(is);
            }
        }
        assert!(seen > 20_000 && left_out > 12_000, "{seen} {left_out}");
    }
}
