//! The 4f display at one wavelength.

use super::OpticsError;

/// A 4f relay in front of a phase-only SLM, at one wavelength. All lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Optics {
    /// Rows of the grid (SLM pixels, padding included).
    pub height: usize,
    /// Columns of the grid.
    pub width: usize,
    /// Pixel pitch, metres.
    pub pitch: f64,
    /// Wavelength, metres.
    pub wavelength: f64,
    /// Focal length of the relay, metres.
    pub focal_length: f64,
}

impl Optics {
    /// Checks every number.
    ///
    /// # Errors
    /// [`OpticsError::Size`], [`OpticsError::NotPositive`], [`OpticsError::OutOfRange`]: from a nanometre to a metre, the
    /// focal length from a micrometre to a kilometre.
    pub fn new(
        height: usize,
        width: usize,
        pitch: f64,
        wavelength: f64,
        focal_length: f64,
    ) -> Result<Self, OpticsError> {
        if !(1..=65536).contains(&height) || !(1..=65536).contains(&width) {
            return Err(OpticsError::Size { height, width });
        }
        let positive = |what, value: f64, unit: f64, hint| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(OpticsError::NotPositive { what, value: value * unit, hint })
            }
        };
        positive("the pitch (um)", pitch, 1e6, "; SLMs have 3 to 20")?;
        positive("the wavelength (nm)", wavelength, 1e9, "; visible light is 380 to 750")?;
        positive("the focal length (mm)", focal_length, 1e3, "")?;
        let range = |what, value: f64, unit: f64, [low, high]: [f64; 2]| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(OpticsError::OutOfRange { what, value: value * unit, low: low * unit, high: high * unit })
            }
        };
        range("the pitch (um)", pitch, 1e6, [1e-9, 1.0])?;
        range("the wavelength (nm)", wavelength, 1e9, [1e-9, 1.0])?;
        range("the focal length (mm)", focal_length, 1e3, [1e-6, 1e3])?;
        Ok(Self { height, width, pitch, wavelength, focal_length })
    }

    /// Side of the square eyebox at this wavelength, metres: `wavelength * focal_length / pitch` (OPTICS 1).
    pub fn eyebox(&self) -> f64 {
        self.wavelength * self.focal_length / self.pitch
    }

    /// Metres of pupil plane per frequency bin, as (y, x).
    pub fn bin_size(&self) -> (f64, f64) {
        let to_pupil = self.wavelength * self.focal_length;
        (to_pupil / (self.height as f64 * self.pitch), to_pupil / (self.width as f64 * self.pitch))
    }

    /// The same optics over another grid.
    pub fn with_size(self, height: usize, width: usize) -> Self {
        Self { height, width, ..self }
    }

    /// Share of the eyebox's area that a pupil of this diameter covers: `(pi/4) (d/w)^2` (OPTICS 2).
    pub fn share(&self, diameter: f64) -> f64 {
        std::f64::consts::FRAC_PI_4 * (diameter / self.eyebox()).powi(2)
    }

    /// Depth at which content moves by `disparity` pixels between views `view_pitch` metres apart (OPTICS 3).
    pub fn depth_of_disparity(&self, disparity: f64, view_pitch: f64) -> f64 {
        disparity * self.focal_length * self.pitch / view_pitch
    }

    /// Disparity, in pixels between views `view_pitch` metres apart, of content at `depth`.
    pub fn disparity_of_depth(&self, depth: f64, view_pitch: f64) -> f64 {
        depth * view_pitch / (self.focal_length * self.pitch)
    }
}

/// The signed DFT bin of index `k` (which may lie outside `0..n`): in `-n/2 ..= (n - 1)/2`, as `fftfreq` orders them.
pub fn frequency_bin(k: i64, n: usize) -> i64 {
    let n = n as i64;
    (k + n / 2).rem_euclid(n) - n / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eyebox_of_the_papers_setup() {
        let w = |nm: f64| Optics::new(8, 8, 8e-6, nm * 1e-9, 0.4).unwrap().eyebox() * 1e3;
        assert!((w(440.0) - 22.0).abs() < 1e-9 && (w(520.0) - 26.0).abs() < 1e-9 && (w(660.0) - 33.0).abs() < 1e-9);
    }

    #[test]
    fn bins_are_those_of_fftfreq() {
        let bins = |n: usize| (0..n as i64).map(|k| frequency_bin(k, n)).collect::<Vec<_>>();
        assert_eq!(bins(4), [0, 1, -2, -1]);
        assert_eq!(bins(5), [0, 1, 2, -2, -1]);
        assert_eq!(bins(1), [0]);
        assert_eq!(frequency_bin(-3, 4), 1);
        assert_eq!(frequency_bin(2, 4), -2);
    }

    #[test]
    fn nonsense_is_refused() {
        assert!(matches!(Optics::new(0, 8, 8e-6, 5e-7, 0.4), Err(OpticsError::Size { .. })));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(Optics::new(8, 8, bad, 5e-7, 0.4), Err(OpticsError::NotPositive { .. })));
            assert!(matches!(Optics::new(8, 8, 8e-6, bad, 0.4), Err(OpticsError::NotPositive { .. })));
            assert!(matches!(Optics::new(8, 8, 8e-6, 5e-7, bad), Err(OpticsError::NotPositive { .. })));
            assert!(matches!(Optics::new(8, 8, 1e-300, 5e-7, 0.4), Err(OpticsError::OutOfRange { .. })));
            assert!(matches!(Optics::new(8, 8, 8e-6, 5e-7, 1e16), Err(OpticsError::OutOfRange { .. })));
        }
    }
}
