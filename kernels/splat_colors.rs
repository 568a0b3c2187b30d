//! Evaluates the color of a splat in a direction, by real spherical harmonics up to degree 3.

/// The harmonic of degree 0, which is 1 / sqrt(4 pi).
pub const C0: f32 = 0.282_094_79;
pub(crate) const C1: f32 = 0.488_602_5;
pub(crate) const C2: [f32; 5] = [1.092_548_4, -1.092_548_4, 0.315_391_57, -1.092_548_4, 0.546_274_2];
pub(crate) const C3: [f32; 7] =
    [-0.590_043_6, 2.890_611_4, -0.457_045_8, 0.373_176_34, -0.457_045_8, 1.445_305_7, -0.590_043_6];

/// The largest number of harmonics of a degree above 0.
pub const MOST: usize = 15;

/// Returns the number of harmonics of the degrees 1 to `degree`.
pub const fn count(degree: usize) -> usize {
    (degree + 1) * (degree + 1) - 1
}

/// Returns the harmonics of the degrees 1 to 3 in a direction of length 1. 3D Gaussian splatting has the same
/// signs.
#[inline(always)]
pub fn harmonics([x, y, z]: [f32; 3]) -> [f32; MOST] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2.0 * zz - xx - yy),
        C2[3] * x * z,
        C2[4] * (xx - yy),
        C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        C3[4] * x * (4.0 * zz - xx - yy),
        C3[5] * z * (xx - yy),
        C3[6] * x * (xx - 3.0 * yy),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// The harmonics and the constant are orthonormal on the sphere, by a sum over 64 x 128 directions.
    #[test]
    fn harmonics_are_orthonormal() {
        let (rings, around) = (64, 128);
        let mut sums = [[0.0f64; MOST + 1]; MOST + 1];
        for ring in 0..rings {
            let z = (ring as f64 + 0.5) * 2.0 / f64::from(rings) - 1.0;
            for step in 0..around {
                let angle = f64::from(step) * 2.0 * PI / f64::from(around);
                let side = (1.0 - z * z).sqrt();
                let direction = [side * angle.cos(), side * angle.sin(), z].map(|v| v as f32);
                let mut all = vec![f64::from(C0)];
                all.extend(harmonics(direction).map(f64::from));
                let weight = 4.0 * PI / f64::from(rings * around);
                for (i, row) in sums.iter_mut().enumerate() {
                    row.iter_mut().zip(&all).for_each(|(sum, v)| *sum += weight * all[i] * v);
                }
            }
        }
        for (i, row) in sums.iter().enumerate() {
            for (j, sum) in row.iter().enumerate() {
                assert!((sum - f64::from(u8::from(i == j))).abs() < 5e-3, "{i} {j} {sum}");
            }
        }
        assert_eq!([0, 1, 2, 3].map(count), [0, 3, 8, 15]);
    }

    /// The signs along the axes, and of products of them.
    #[test]
    fn signs_are_those_of_the_files() {
        let signs = |direction: [f32; 3]| harmonics(direction).map(|v| if v.abs() < 1e-6 { 0.0 } else { v.signum() });
        assert_eq!(signs([1.0, 0.0, 0.0])[..8], [0.0, 0.0, -1.0, 0.0, 0.0, -1.0, 0.0, 1.0]);
        assert_eq!(signs([0.0, 1.0, 0.0])[..8], [-1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, -1.0]);
        assert_eq!(signs([0.0, 0.0, 1.0])[..8], [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        let third = 1.0 / 3.0f32.sqrt();
        assert_eq!(signs([third; 3])[8..], [-1.0, 1.0, -1.0, -1.0, -1.0, 0.0, 1.0]);
    }
}
