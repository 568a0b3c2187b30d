//! Describes the errors of the viewer's eye, from a prescription or an aberrometer (OPTICS 11).

use super::units::within;
use super::{Optics, OpticsError, Pupil};
use eyebox_base::error::Reason;
use eyebox_base::files::read;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The errors of an eye, which move with its pupil. The path at the distance X - s from the pupil's center s is P(X -
/// s), with `P(X) = (S |X|^2 + C (n . X)^2) / 2` and `n = (-sin axis, cos axis)`. The coefficients of an aberrometer
/// add to P.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct Prescription {
    /// Sphere in diopters. It is negative for short-sighted eyes.
    pub sphere: f64,
    /// Cylinder of the prescription in diopters.
    #[serde(skip_serializing_if = "super::is_default")]
    pub cylinder: f64,
    /// Axis as written on a prescription, in degrees.
    #[serde(skip_serializing_if = "super::is_default")]
    pub axis_deg: f64,
    /// Distance of the spectacles from the eye in millimeters, if the prescription is for spectacles.
    #[serde(skip_serializing_if = "super::is_default")]
    pub vertex_mm: f64,
    /// Coefficients of an aberrometer by their ANSI index, in micrometers RMS (ANSI Z80.28). 3, 4 and 5 add to the
    /// prescription.
    #[serde(skip_serializing_if = "BTreeMap::is_empty", with = "super::model::indices")]
    pub zernikes_um: BTreeMap<u32, f64>,
    /// Diameter of the measured pupil in millimeters. The polynomials continue beyond it.
    #[serde(skip_serializing_if = "super::is_default")]
    pub measured_mm: f64,
}

/// A polynomial in two variables, as coefficients of x^i y^j, by i and then j.
type Polynomial = Vec<Vec<f64>>;

/// The largest supported ANSI index, at the end of the sixth order.
const LARGEST_INDEX: u32 = 27;

impl Prescription {
    /// A prescription at the eye, with sphere and cylinder in diopters and the axis in degrees.
    pub fn new(sphere: f64, cylinder: f64, axis_deg: f64) -> Self {
        Self { sphere, cylinder, axis_deg, ..Self::default() }
    }

    /// Reads a TOML file with the keys of [`Prescription`].
    ///
    /// # Errors
    /// [`OpticsError::Prescription`] for a file that is wrong.
    pub fn load(path: &Path) -> Result<Self, OpticsError> {
        let wrong = |reason: Reason| OpticsError::Prescription { reason: reason.within(format!("{}", path.display())) };
        let text = read::text(path, read::TEXT).map_err(|e| wrong(e.to_string().into()))?;
        let given: Self = read::toml(&text).map_err(wrong)?;
        given.check().map_err(wrong)?;
        Ok(given)
    }

    /// Checks the range of every number.
    ///
    /// # Errors
    /// A reason in words.
    pub fn check(&self) -> Result<(), Reason> {
        within("the sphere in diopters", self.sphere, -40.0, 40.0)?;
        within("the cylinder in diopters", self.cylinder, -20.0, 20.0)?;
        within("the axis in degrees", self.axis_deg, 0.0, 180.0)?;
        within("vertex_mm, the distance of the spectacles,", self.vertex_mm, 0.0, 30.0)?;
        for (j, um) in &self.zernikes_um {
            if !(3..=LARGEST_INDEX).contains(j) {
                return Err(reason!(
                    "polynomial",
                    "zernikes_um names polynomial {j}: the ANSI index must be 3 to {LARGEST_INDEX} (piston and tilt are \
                     no errors of sight, and the sixth order is the last that is supported)"
                ));
            }
            within("zernikes_um in micrometers", *um, -100.0, 100.0)?;
        }
        match (self.zernikes_um.is_empty(), self.measured_mm == 0.0) {
            (false, true) => Err(reason!(
                "zernikes-without-diameter",
                "zernikes_um needs measured_mm, the diameter of the pupil that was measured"
            )),
            (true, false) => Err(reason!("diameter-without-zernikes", "measured_mm needs zernikes_um")),
            (true, true) => Ok(()),
            (false, false) => within("measured_mm", self.measured_mm, 1.0, 12.0),
        }
    }

    /// True if the eye has no error at all.
    pub fn is_perfect(&self) -> bool {
        self.power() == [[0.0; 2]; 2] && !self.has_higher_orders()
    }

    /// True if the eye has errors that can be corrected only at a known place of the pupil.
    pub fn has_higher_orders(&self) -> bool {
        self.higher().next().is_some()
    }

    fn higher(&self) -> impl Iterator<Item = (u32, f64)> {
        self.zernikes_um.iter().filter(|(j, um)| **j > 5 && **um != 0.0).map(|(j, um)| (*j, um * 1e-6))
    }

    /// Sphere and cylinder at the eye, including coefficients 3, 4 and 5, as a symmetric matrix Q over (x, y) in
    /// diopters, with `P(X) = X . Q X / 2`.
    pub fn power(&self) -> [[f64; 2]; 2] {
        // Each of the two principal powers of spectacles at the distance v is F / (1 - v F) at the eye.
        let at_eye = |power: f64| power / (1.0 - self.vertex_mm * 1e-3 * power);
        let sphere = at_eye(self.sphere);
        let cylinder = at_eye(self.sphere + self.cylinder) - sphere;
        let (sin, cos) = self.axis_deg.to_radians().sin_cos();
        let mut power = [
            [sphere + cylinder * sin * sin, -cylinder * sin * cos],
            [-cylinder * sin * cos, sphere + cylinder * cos * cos],
        ];
        let a = |j: u32| self.zernikes_um.get(&j).copied().unwrap_or(0.0) * 1e-6;
        if self.measured_mm > 0.0 {
            // These are the second derivatives of -a_j Z_j(X / r). The polynomials are Z_3 = 2 sqrt 6 x y, Z_4 = sqrt 3
            // (2 x^2 + 2 y^2 - 1) and Z_5 = sqrt 6 (x^2 - y^2).
            let per = -(self.measured_mm * 0.5e-3).powi(-2);
            let (mean, across, oblique) =
                (4.0 * 3f64.sqrt() * a(4), 2.0 * 6f64.sqrt() * a(5), 2.0 * 6f64.sqrt() * a(3));
            power[0][0] += per * (mean + across);
            power[1][1] += per * (mean - across);
            power[0][1] += per * oblique;
            power[1][0] += per * oblique;
        }
        power
    }

    /// The strongest power at the eye in diopters, without a sign.
    pub fn strongest(&self) -> f64 {
        let [[a, b], [_, c]] = self.power();
        let (mean, spread) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
        (mean - spread).abs().max((mean + spread).abs())
    }

    /// The displacement `f Q s` of the picture for a pupil at `s`, (x, y), in meters (Prentice's rule). Higher orders
    /// displace nothing.
    pub fn displacement(&self, s: [f64; 2], focal_length: f64) -> [f64; 2] {
        self.power().map(|row| focal_length * (row[0] * s[0] + row[1] * s[1]))
    }

    /// The path P in meters as a polynomial in X - s, in meters, as coefficients of x^i y^j.
    pub fn path(&self) -> Polynomial {
        let [[xx, xy], [_, yy]] = self.power();
        let mut path = vec![vec![0.0, 0.0, 0.5 * yy], vec![0.0, xy, 0.0], vec![0.5 * xx, 0.0, 0.0]];
        let scale = -2.0 / (self.measured_mm * 1e-3);
        for (j, metres) in self.higher() {
            let zernike = super::zernike::coefficients(j);
            let size = path.len().max(zernike.len());
            path.resize(size, Vec::new());
            path.iter_mut().for_each(|row| row.resize(size, 0.0));
            for (i, row) in zernike.iter().enumerate() {
                for (k, c) in row.iter().enumerate() {
                    path[i][k] -= metres * c * scale.powi((i + k) as i32);
                }
            }
        }
        path[0][0] = 0.0;
        path
    }

    /// The depth in meters at which content moves sideways as far as the error of this eye moves it. The error moves
    /// both light and picture, and the larger movement counts. `reach` is the largest |s| + d/2 in meters. `diameter`
    /// belongs to the widest pupil, in meters.
    pub fn walk_off(&self, focal_length: f64, reach: f64, diameter: f64) -> f64 {
        let moved = focal_length * focal_length * self.strongest();
        moved.max(0.5 * self.blur(focal_length, diameter) * focal_length / reach)
    }

    /// Diameter of a blurred point through a pupil of this diameter, in meters of the focal plane. It is `f |S| d` for
    /// a sphere. Higher orders count as an even disc with the same RMS distance of rays from the middle.
    pub fn blur(&self, focal_length: f64, diameter: f64) -> f64 {
        let path = self.path();
        let slope = |x: f64, y: f64| {
            let (mut along, mut down) = (0.0, 0.0);
            for (i, row) in path.iter().enumerate() {
                for (k, c) in row.iter().enumerate().filter(|(_, c)| **c != 0.0) {
                    let power = |x: f64, n: usize| x.powi(n as i32);
                    if i > 0 {
                        along += c * i as f64 * power(x, i - 1) * power(y, k);
                    }
                    if k > 0 {
                        down += c * k as f64 * power(x, i) * power(y, k - 1);
                    }
                }
            }
            [along, down]
        };
        // The samples are evenly spread over the pupil. The mean slope displaces the picture and does not blur it.
        let (mut sum, mut squares, mut count) = ([0.0; 2], 0.0, 0.0);
        for (ring, step) in (0..16).flat_map(|ring| (0..64).map(move |step| (ring, step))) {
            let (sin, cos) = (f64::from(step) * std::f64::consts::TAU / 64.0).sin_cos();
            let r = 0.5 * diameter * ((f64::from(ring) + 0.5) / 16.0).sqrt();
            let [along, down] = slope(r * cos, r * sin);
            sum = [sum[0] + along, sum[1] + down];
            (squares, count) = (squares + along * along + down * down, count + 1.0);
        }
        let variance = squares / count - (sum[0] * sum[0] + sum[1] * sum[1]) / (count * count);
        let even_disc = 8f64.sqrt() * variance.max(0.0).sqrt();
        focal_length * even_disc.max(self.strongest() * diameter)
    }

    /// Rejects a blur over more than half of a picture, whose shorter side is `side`, through a pupil of this diameter.
    /// Lengths are in meters.
    ///
    /// # Errors
    /// [`OpticsError::Blur`] for a larger blur.
    pub fn check_blur(&self, side: f64, focal_length: f64, diameter: f64) -> Result<(), OpticsError> {
        let (blur, most) = (self.blur(focal_length, diameter), 0.5 * side);
        if blur <= most {
            return Ok(());
        }
        Err(OpticsError::Blur {
            eye: self.to_string(),
            diameter_mm: diameter * 1e3,
            blur_mm: blur * 1e3,
            most_mm: most * 1e3,
            fits_mm: self.widest(focal_length, diameter, most) * 1e3,
        })
    }

    /// The widest pupil, of at most `diameter`, whose blur is at most `most`.
    fn widest(&self, focal_length: f64, diameter: f64, most: f64) -> f64 {
        let (mut low, mut high) = (0.0, diameter);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            *(if self.blur(focal_length, middle) <= most { &mut low } else { &mut high }) = middle;
        }
        low
    }

    /// E in turns of this wavelength at `(x, y)` meters of the pupil plane. It is the reference for the kernel.
    pub fn turns(&self, optics: &Optics, pupil: &Pupil, x: f64, y: f64) -> f64 {
        let (x, y) = (x - pupil.x, y - pupil.y);
        let [[xx, xy], [_, yy]] = self.power();
        let r = self.measured_mm * 0.5e-3;
        let higher: f64 = self.higher().map(|(j, a)| -a * super::zernike(j, -x / r, -y / r)).sum();
        (0.5 * (xx * x * x + 2.0 * xy * x * y + yy * y * y) + higher) / optics.wavelength
    }
}

impl std::fmt::Display for Prescription {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} D", self.sphere)?;
        if self.cylinder != 0.0 {
            write!(f, ", cylinder {} D at {} degrees", self.cylinder, self.axis_deg)?;
        }
        if self.vertex_mm != 0.0 {
            write!(f, ", spectacles at {} mm", self.vertex_mm)?;
        }
        if !self.zernikes_um.is_empty() {
            write!(f, ", {} Zernike coefficients over {} mm", self.zernikes_um.len(), self.measured_mm)?;
        }
        Ok(())
    }
}
