//! Converts light from the color primaries that a file states to the primaries of sRGB.

use crate::error::Reason;
use crate::reason;

type Matrix = [[f64; 3]; 3];

/// Chromaticities x and y of red, green, blue and white (CIE 1931).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Primaries(pub [[f64; 2]; 4]);

/// White of daylight at 6500 K.
const D65: [f64; 2] = [0.3127, 0.3290];
/// Responses of the cones to X, Y and Z by which a picture is adapted to another white (Bradford).
const CONES: Matrix = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
/// Difference of light up to which primaries count as the primaries of sRGB, because files round them.
const SAME: f64 = 0.006;

impl Primaries {
    /// Primaries of sRGB and of ITU-R BT.709.
    pub const SRGB: Self = Self([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], D65]);

    /// Returns the primaries of a code of ITU-T H.273, and `None` for an unknown or unspecified one.
    pub fn of_code(code: u8) -> Option<Self> {
        Some(match code {
            1 => Self::SRGB,
            5 => Self([[0.64, 0.33], [0.29, 0.60], [0.15, 0.06], D65]),
            6 | 7 => Self([[0.630, 0.340], [0.310, 0.595], [0.155, 0.070], D65]),
            9 => Self([[0.708, 0.292], [0.170, 0.797], [0.131, 0.046], D65]),
            11 => Self([[0.680, 0.320], [0.265, 0.690], [0.150, 0.060], [0.314, 0.351]]),
            12 => Self([[0.680, 0.320], [0.265, 0.690], [0.150, 0.060], D65]),
            22 => Self([[0.630, 0.340], [0.295, 0.605], [0.155, 0.077], D65]),
            _ => return None,
        })
    }

    /// Returns the matrix from linear light of these primaries to linear light of sRGB, and `None` if they are the
    /// primaries of sRGB.
    ///
    /// # Errors
    /// Returns a reason that states the fault of the chromaticities.
    pub fn to_srgb(self) -> Result<Option<Matrix>, Reason> {
        let impossible = || reason!("primaries", "color primaries that span no colors ({})", self.in_words());
        let from = self.to_xyz().ok_or_else(impossible)?;
        let srgb = Self::SRGB.to_xyz().and_then(inverse).ok_or_else(impossible)?;
        let adapted = adaptation(self.0[3]).ok_or_else(impossible)?;
        let matrix = product(&srgb, &product(&adapted, &from));
        let off = |(i, row): (usize, &[f64; 3])| {
            row.iter().enumerate().map(|(j, v)| (v - f64::from(i == j)).abs()).fold(0.0, f64::max)
        };
        let most = matrix.iter().enumerate().map(off).fold(0.0, f64::max);
        Ok((most > SAME).then_some(matrix))
    }

    /// Returns the chromaticities in words.
    pub fn in_words(self) -> String {
        let names = ["red", "green", "blue", "white"];
        let all = names.iter().zip(self.0).map(|(name, [x, y])| format!("{name} {x:.4}, {y:.4}"));
        all.collect::<Vec<_>>().join("; ")
    }

    /// Returns the matrix from light to X, Y and Z. White has the luminance 1.
    fn to_xyz(self) -> Option<Matrix> {
        let white = white(self.0[3])?;
        // A primary may be outside of the visible colors. The blue of ACES is, and its y is below 0.
        let [r, g, b] = [0, 1, 2].map(|i| [self.0[i][0], self.0[i][1], 1.0 - self.0[i][0] - self.0[i][1]]);
        let columns = [0, 1, 2].map(|i| [r[i], g[i], b[i]]);
        let shares = apply(&inverse(columns)?, white);
        Some(columns.map(|row| [0, 1, 2].map(|j| row[j] * shares[j])))
    }
}

/// Returns X, Y and Z of a white at the luminance 1.
fn white([x, y]: [f64; 2]) -> Option<[f64; 3]> {
    (x.is_finite() && y.is_finite() && y > 1e-6).then(|| [x / y, 1.0, (1.0 - x - y) / y])
}

/// Returns the matrix on X, Y and Z that adapts this white to the white of sRGB.
fn adaptation(of: [f64; 2]) -> Option<Matrix> {
    let [from, to] = [apply(&CONES, white(of)?), apply(&CONES, white(D65)?)];
    let scaled = [0, 1, 2].map(|i| CONES[i].map(|v| v * to[i] / from[i]));
    let matrix = product(&inverse(CONES)?, &scaled);
    matrix.iter().flatten().all(|v| v.is_finite()).then_some(matrix)
}

fn apply(matrix: &Matrix, v: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a.map(|row| [0, 1, 2].map(|j| (0..3).map(|k| row[k] * b[k][j]).sum()))
}

fn inverse(m: Matrix) -> Option<Matrix> {
    let minor = |i: usize, j: usize| {
        let [r, s, c, d] = [(i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3];
        m[r][c] * m[s][d] - m[r][d] * m[s][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    let adjugate = [0, 1, 2].map(|i| [0, 1, 2].map(|j| minor(j, i) / determinant));
    (determinant.is_finite() && determinant.abs() > 1e-6).then_some(adjugate)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_near(found: Primaries, expected: Matrix) -> bool {
        let found = found.to_srgb().unwrap().expect("other primaries");
        found.iter().flatten().zip(expected.iter().flatten()).all(|(a, b)| (a - b).abs() < 6e-4)
    }

    /// The matrices of ITU-R BT.2087, of Display P3 and of ACES2065-1, as published.
    #[test]
    fn primaries_become_those_of_srgb() {
        let of = |code| Primaries::of_code(code).unwrap();
        assert!(is_near(of(9), [[1.6605, -0.5877, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]));
        assert!(is_near(of(12), [[1.2249, -0.2247, 0.0], [-0.0420, 1.0419, 0.0], [-0.0197, -0.0786, 1.0979]]));
        let aces = Primaries([[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.32168, 0.33767]]);
        assert!(is_near(aces, [[2.5217, -1.1341, -0.3876], [-0.2765, 1.3727, -0.0962], [-0.0154, -0.1530, 1.1684]]));
        assert!(Primaries::SRGB.to_srgb().unwrap().is_none());
        let rounded = Primaries([[0.6400, 0.3300], [0.3000, 0.6000], [0.1500, 0.0600], [0.3127, 0.3291]]);
        assert!(rounded.to_srgb().unwrap().is_none());
        assert_eq!((Primaries::of_code(2), Primaries::of_code(99)), (None, None));
    }

    #[test]
    fn primaries_on_a_line_or_without_numbers_are_refused() {
        for wrong in [
            Primaries([[0.2, 0.2], [0.3, 0.3], [0.4, 0.4], D65]),
            Primaries([[0.64, f64::NAN], [0.3, 0.6], [0.15, 0.06], D65]),
            Primaries([[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3, 0.0]]),
        ] {
            assert!(wrong.to_srgb().is_err(), "{}", wrong.in_words());
        }
    }
}
