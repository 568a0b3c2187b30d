//! Holds the splats of a scene, which are Gaussians in space with a color for each direction.

use crate::light_field::drawer::StoredSplats;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use eyebox_kernels::project_splats::{Gaussian, stored_words};
use eyebox_kernels::splat_colors as harmonics;
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::ops::{Deref, Range};
use std::sync::atomic::{AtomicU64, Ordering};

/// The largest share of splats with values that are not finite. Training leaves a few of them.
const DAMAGED: f64 = 0.01;
/// The largest coordinate of a splat, and its largest extent, in units of the scene.
const FARTHEST: f32 = 1e9;

/// The splats of a scene, with x to the right, y downwards and z forward.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Cloud {
    /// Centers in units of the scene.
    pub places: Vec<[f32; 3]>,
    /// Covariances (xx, xy, xz, yy, yz, zz) in square units.
    pub spreads: Vec<[f32; 6]>,
    /// Opacities from 0 to 1.
    pub opacities: Vec<f32>,
    /// Color that is the same in all directions.
    pub colors: Vec<[f32; 3]>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub degree: usize,
    /// Harmonics of a degree above 0, as (splat, harmonic, color).
    pub rest: Vec<f16>,
    /// True if the splats were trained with antialiasing (Yu et al. 2024).
    pub antialiased: bool,
}

/// Splats with a number that no others of this process have. They do not change.
pub(crate) struct NumberedCloud {
    cloud: Cloud,
    id: u64,
}

impl NumberedCloud {
    /// Gives splats the next number.
    pub fn new(cloud: Cloud) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        Self { cloud, id: NEXT.fetch_add(1, Ordering::Relaxed) }
    }
}

impl Deref for NumberedCloud {
    type Target = Cloud;

    fn deref(&self) -> &Cloud {
        &self.cloud
    }
}

impl StoredSplats for NumberedCloud {
    fn id(&self) -> u64 {
        self.id
    }

    fn count(&self) -> usize {
        self.len()
    }

    /// Returns the words that the kernel `project_splats` reads.
    fn words(&self, range: Range<usize>) -> Vec<u32> {
        let mut words = Vec::with_capacity(range.len() * stored_words(self.degree));
        range.for_each(|at| self.gaussian(at).store(self.rest_of(at).reinterpret_cast(), &mut words));
        words
    }
}

impl Cloud {
    /// Returns a cloud with room for this number of splats.
    pub fn with_room(count: usize, degree: usize) -> Self {
        let values = 3 * harmonics::count(degree);
        Self {
            places: Vec::with_capacity(count),
            spreads: Vec::with_capacity(count),
            opacities: Vec::with_capacity(count),
            colors: Vec::with_capacity(count),
            degree,
            rest: Vec::with_capacity(count * values),
            antialiased: false,
        }
    }

    /// Returns the bytes of one splat in memory.
    pub fn bytes_of_one(degree: usize) -> u64 {
        (size_of::<f32>() * (3 + 6 + 1 + 3) + size_of::<f16>() * 3 * harmonics::count(degree)) as u64
    }

    /// Returns the number of splats.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Returns a splat without its harmonics.
    #[inline(always)]
    pub fn gaussian(&self, at: usize) -> Gaussian {
        Gaussian {
            place: self.places[at],
            spread: self.spreads[at],
            opacity: self.opacities[at],
            color: self.colors[at],
        }
    }

    /// Returns the harmonics of a degree above 0 of one splat.
    pub fn rest_of(&self, at: usize) -> &[f16] {
        let values = 3 * harmonics::count(self.degree);
        &self.rest[at * values..(at + 1) * values]
    }

    /// Removes the splats whose values are not finite or too large. Returns their number.
    ///
    /// # Errors
    /// The reason in words if there are no splats, or more than a few are damaged.
    pub fn clean(&mut self) -> Result<usize, Reason> {
        let count = self.len();
        if count == 0 {
            return Err(reason!("no-splats", "it has no splats"));
        }
        let values = 3 * harmonics::count(self.degree);
        let mut kept = 0;
        let mut first = None;
        for at in 0..count {
            if !self.is_sound(at) {
                first = first.or(Some(at));
                continue;
            }
            self.places[kept] = self.places[at];
            self.spreads[kept] = self.spreads[at];
            self.opacities[kept] = self.opacities[at];
            self.colors[kept] = self.colors[at];
            self.rest.copy_within(at * values..(at + 1) * values, kept * values);
            kept += 1;
        }
        self.places.truncate(kept);
        self.spreads.truncate(kept);
        self.opacities.truncate(kept);
        self.colors.truncate(kept);
        self.rest.truncate(kept * values);
        let damaged = count - kept;
        match first {
            Some(first) if damaged as f64 > DAMAGED * count as f64 => Err(reason!(
                "damaged-splats",
                "{damaged} of {count} splats have values that are not finite or out of range, the first is splat {first}"
            )),
            _ => Ok(damaged),
        }
    }

    fn is_sound(&self, at: usize) -> bool {
        let fits = |v: &f32| v.abs() <= FARTHEST;
        let values = [&self.places[at][..], &self.colors[at]].concat();
        values.iter().all(fits)
            && self.spreads[at].iter().all(|v| v.abs() <= FARTHEST * FARTHEST)
            && (0.0..=1.0).contains(&self.opacities[at])
            && self.rest_of(at).iter().all(|v| v.is_finite())
    }
}

/// Returns the covariance of a Gaussian with these standard deviations along its axes, turned by a quaternion (w, x, y,
/// z) of any length. It is not finite if an argument is not, or if the quaternion is 0.
pub(crate) fn spread(deviations: [f32; 3], [w, x, y, z]: [f32; 4]) -> [f32; 6] {
    let scale = 1.0 / (w * w + x * x + y * y + z * z);
    let turned = [
        [1.0 - 2.0 * scale * (y * y + z * z), 2.0 * scale * (x * y - w * z), 2.0 * scale * (x * z + w * y)],
        [2.0 * scale * (x * y + w * z), 1.0 - 2.0 * scale * (x * x + z * z), 2.0 * scale * (y * z - w * x)],
        [2.0 * scale * (x * z - w * y), 2.0 * scale * (y * z + w * x), 1.0 - 2.0 * scale * (x * x + y * y)],
    ];
    let entry = |i: usize, j: usize| (0..3).map(|k| turned[i][k] * turned[j][k] * deviations[k] * deviations[k]).sum();
    [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quaternion_turns_the_axes() {
        let close = |found: [f32; 6], exact: [f32; 6]| {
            assert!(found.iter().zip(exact).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?} {exact:?}");
        };
        close(spread([1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0]), [1.0, 0.0, 0.0, 4.0, 0.0, 9.0]);
        // A quarter turn about z, of any length, exchanges x and y. About x, it exchanges y and z.
        close(spread([1.0, 2.0, 3.0], [0.3, 0.0, 0.0, 0.3]), [4.0, 0.0, 0.0, 1.0, 0.0, 9.0]);
        close(spread([1.0, 2.0, 3.0], [-2.0, 2.0, 0.0, 0.0]), [1.0, 0.0, 0.0, 9.0, 0.0, 4.0]);
        // An eighth turn about z takes the long axis x to the direction (1, 1), which is down to the right.
        let (c, s) = ((0.125 * std::f32::consts::PI).cos(), (0.125 * std::f32::consts::PI).sin());
        let turned = spread([2.0, 0.0, 0.0], [c, 0.0, 0.0, s]);
        close(turned, [2.0, 2.0, 0.0, 2.0, 0.0, 0.0]);
        assert!(spread([1.0; 3], [0.0; 4]).iter().any(|v| !v.is_finite()));
    }

    #[test]
    fn a_few_damaged_splats_are_left_out_and_many_are_refused() {
        let mut cloud = Cloud::with_room(200, 1);
        for i in 0..200 {
            cloud.places.push([i as f32, 0.0, 1.0]);
            cloud.spreads.push([1.0, 0.0, 0.0, 1.0, 0.0, 1.0]);
            cloud.opacities.push(0.5);
            cloud.colors.push([i as f32 / 200.0; 3]);
            cloud.rest.extend([f16::from_f32(i as f32); 9]);
        }
        let (mut few, mut many, mut none) = (cloud.clone(), cloud.clone(), Cloud::default());
        few.places[3][1] = f32::NAN;
        few.rest[9 * 7 + 2] = f16::INFINITY;
        assert_eq!((few.clean().unwrap(), few.len()), (2, 198));
        assert_eq!((few.places[3][0], few.rest_of(3)[0].to_f32(), few.rest_of(197)[8].to_f32()), (4.0, 4.0, 199.0));
        [1, 2, 4].iter().for_each(|i| many.opacities[*i] = 1.5);
        assert_eq!(many.clean().unwrap_err().code(), "damaged-splats");
        assert_eq!(none.clean().unwrap_err().code(), "no-splats");
    }
}
