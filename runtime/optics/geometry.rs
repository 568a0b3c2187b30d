//! Describes the display at one wavelength, behind a 4f relay or in the pupil plane itself.

use super::OpticsError;
use super::units::guess;
use serde::{Deserialize, Serialize};

/// The place of the SLM.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Geometry {
    /// The SLM is in an image plane. A 4f relay puts its Fourier plane at the pupil (OPTICS 1).
    #[default]
    Relay,
    /// The SLM is in the pupil plane. A pixel at r is the pupil-plane position r (OPTICS 9).
    FarField,
}

impl Geometry {
    /// The name in display files.
    pub fn name(self) -> &'static str {
        ["relay", "far-field"][self as usize]
    }

    /// Rows and columns of the picture that an SLM of `height` x `width` pixels shows. Behind a relay the picture has
    /// the size of the SLM. In the far field it is a square that holds the SLM, because the field of view has the same
    /// angle along both axes.
    pub fn picture_size(self, height: usize, width: usize) -> (usize, usize) {
        match self {
            Self::Relay => (height, width),
            Self::FarField => [height.max(width); 2].into(),
        }
    }

    /// For `skip_serializing_if`, because files hold only values that differ from the default.
    pub fn is_relay(&self) -> bool {
        *self == Self::Relay
    }
}

/// A phase-only SLM and the optics in front of it, at one wavelength. All lengths are in meters.
///
/// A *bin* is a place of the pupil plane. It is a DFT bin of the relay's spectrum, or a pixel of a far-field SLM. Bins
/// are signed, and bin 0 is on the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Optics {
    /// Rows of the grid, which are SLM pixels including padding.
    pub height: usize,
    /// Columns of the grid, including padding.
    pub width: usize,
    /// Pixel pitch in meters.
    pub pitch: f64,
    /// Wavelength of the light in meters.
    pub wavelength: f64,
    /// Focal length of the relay in meters. In the far field it converts angles and diopters (OPTICS 9).
    pub focal_length: f64,
    /// The place of the SLM.
    pub geometry: Geometry,
    /// Offset of the middle of the grid from the axis, in bins (rows, columns). It is not zero for a piece of a
    /// far-field SLM.
    pub offset: [i64; 2],
    /// Pixels of a static mask per pixel of this grid along an axis (OPTICS 12), or 1 without a mask. The grid of the
    /// light is finer by this factor ([`Padding::grid`](super::Padding::grid)), and the eyebox is wider by it.
    pub mask_factor: usize,
}

impl Optics {
    /// Makes optics after a check of every number.
    ///
    /// # Errors
    /// [`OpticsError::Size`], [`OpticsError::NotPositive`] or [`OpticsError::OutOfRange`]. Pitch and wavelength must be
    /// from a nanometer to a meter, and the focal length from a micrometer to a kilometer.
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
        let lengths = [
            ("the pitch (um)", pitch, 1e6, [1e-9, 1.0], "; SLMs have 3 to 20"),
            ("the wavelength (nm)", wavelength, 1e9, [1e-9, 1.0], "; visible light is 380 to 750"),
            ("the focal length (mm)", focal_length, 1e3, [1e-6, 1e3], ""),
        ];
        if let Some((what, value, unit, _, hint)) = lengths.into_iter().find(|(_, v, ..)| !(v.is_finite() && *v > 0.0))
        {
            return Err(OpticsError::NotPositive { what, value: value * unit, hint });
        }
        for (what, value, unit, [low, high], _) in lengths {
            if !(low..=high).contains(&value) {
                let (value, hint) = (value * unit, guess(what, value * unit));
                return Err(OpticsError::OutOfRange { what, value, low: low * unit, high: high * unit, hint });
            }
        }
        let (geometry, offset) = (Geometry::Relay, [0, 0]);
        Ok(Self { height, width, pitch, wavelength, focal_length, geometry, offset, mask_factor: 1 })
    }

    /// The same SLM behind a mask with `factor` mask pixels per SLM pixel along an axis.
    pub fn behind_mask(self, factor: usize) -> Self {
        Self { mask_factor: factor.max(1), ..self }
    }

    /// The grid of the light after the mask. Without a mask it is these optics.
    pub fn at_mask(self) -> Self {
        let Self { height, width, pitch, mask_factor, .. } = self;
        let (height, width) = (height * mask_factor, width * mask_factor);
        Self { height, width, pitch: pitch / mask_factor as f64, mask_factor: 1, ..self }
    }

    /// The same SLM at another place.
    pub fn in_geometry(self, geometry: Geometry) -> Self {
        Self { geometry, ..self }
    }

    /// Side of the square eyebox at this wavelength in meters. Behind a relay it is `wavelength * focal_length / pitch`
    /// (OPTICS 1), with the pitch of the mask if there is one. In the far field it is the shorter side of the SLM
    /// (OPTICS 9).
    pub fn eyebox(&self) -> f64 {
        match self.geometry {
            Geometry::Relay => self.wavelength * self.focal_length / (self.pitch / self.mask_factor as f64),
            Geometry::FarField => self.height.min(self.width) as f64 * self.pitch,
        }
    }

    /// Meters of the pupil plane per bin, as (y, x).
    pub fn bin_size(&self) -> (f64, f64) {
        let to_pupil = self.wavelength * self.focal_length;
        match self.geometry {
            Geometry::Relay => {
                (to_pupil / (self.height as f64 * self.pitch), to_pupil / (self.width as f64 * self.pitch))
            }
            Geometry::FarField => (self.pitch, self.pitch),
        }
    }

    /// Extent of the retinal image in the focal plane in meters, as (y, x). Behind a relay it is the extent of the grid. In
    /// the far field it is `wavelength f / pitch`.
    pub fn field_of_view(&self) -> (f64, f64) {
        match self.geometry {
            Geometry::Relay => (self.height as f64 * self.pitch, self.width as f64 * self.pitch),
            Geometry::FarField => [self.wavelength * self.focal_length / self.pitch; 2].into(),
        }
    }

    /// Rows and columns of the retinal image of the whole grid ([`Geometry::picture_size`]).
    pub fn image_size(&self) -> (usize, usize) {
        self.geometry.picture_size(self.height, self.width)
    }

    /// Direction cosine per bin, as (y, x), which is `wavelength q` of light at the pupil-plane position `wavelength f
    /// q`.
    pub fn cosine_per_bin(&self) -> (f64, f64) {
        match self.geometry {
            Geometry::Relay => (
                self.wavelength / (self.height as f64 * self.pitch),
                self.wavelength / (self.width as f64 * self.pitch),
            ),
            Geometry::FarField => [self.pitch / self.focal_length; 2].into(),
        }
    }

    /// `(wavelength q)^2` per squared bin, as (y, x). The kernel `transfer` takes it.
    pub fn slopes(&self) -> (f64, f64) {
        let (y, x) = self.cosine_per_bin();
        (y * y, x * x)
    }

    /// The first existing bin, as (y, x). There are `height` x `width` bins.
    pub fn first_bin(&self) -> (i64, i64) {
        (self.offset[0] - self.height as i64 / 2, self.offset[1] - self.width as i64 / 2)
    }

    /// True if the grid has this bin.
    pub fn has_bin(&self, ky: i64, kx: i64) -> bool {
        let (y, x) = self.first_bin();
        (y..y + self.height as i64).contains(&ky) && (x..x + self.width as i64).contains(&kx)
    }

    /// The index (row, column) of a bin in the grid. A relay has the order of the DFT, and the far field has the order
    /// of the SLM's pixels. Bins outside the grid wrap around.
    pub fn index_of(&self, ky: i64, kx: i64) -> (usize, usize) {
        let first = match self.geometry {
            Geometry::Relay => (0, 0),
            Geometry::FarField => self.first_bin(),
        };
        ((ky - first.0).rem_euclid(self.height as i64) as usize, (kx - first.1).rem_euclid(self.width as i64) as usize)
    }

    /// The piece of a far-field SLM that begins at this pixel, which may lie before the first one. The piece is a
    /// far-field problem of its own on the same axis.
    pub fn piece(self, [top, left]: [i64; 2], [height, width]: [usize; 2]) -> Self {
        let (y, x) = self.first_bin();
        let offset = [y + top + (height / 2) as i64, x + left + (width / 2) as i64];
        Self { height, width, offset, ..self }
    }

    /// The middle of a piece of a far-field SLM in the pupil plane, (x, y), in meters. It is zero for a relay, whose
    /// eyebox is around the axis.
    pub fn center(&self) -> [f64; 2] {
        match self.geometry {
            Geometry::Relay => [0.0, 0.0],
            Geometry::FarField => [self.offset[1], self.offset[0]].map(|pixels| pixels as f64 * self.pitch),
        }
    }

    /// The same optics over another grid.
    pub fn with_size(self, height: usize, width: usize) -> Self {
        Self { height, width, ..self }
    }

    /// Share of the eyebox's area that a pupil of this diameter covers, `(pi/4) (d/w)^2` (OPTICS 2).
    pub fn share(&self, diameter: f64) -> f64 {
        let area = match self.geometry {
            Geometry::Relay => self.eyebox().powi(2),
            Geometry::FarField => (self.height * self.width) as f64 * self.pitch.powi(2),
        };
        std::f64::consts::FRAC_PI_4 * diameter.powi(2) / area
    }

    /// Size of a pixel of the whole image in the focal plane in meters. It is the SLM's pitch, or `wavelength f /
    /// (pitch N)` in the far field.
    pub fn image_pixel(&self) -> f64 {
        match self.geometry {
            Geometry::Relay => self.pitch,
            Geometry::FarField => self.field_of_view().0 / self.image_size().0 as f64,
        }
    }

    /// The finest detail of an intensity through a pupil of this diameter (meters), in cycles per degree. The limit is
    /// `d / wavelength` cycles per radian, or the limit of the pixels if that is lower.
    pub fn finest_cycles_per_degree(&self, diameter: f64) -> f64 {
        let pixels = self.focal_length / (2.0 * self.image_pixel());
        (diameter.min(self.eyebox()) / self.wavelength).min(pixels).to_radians()
    }

    /// Depth in meters at which content moves by `disparity` pixels between views that are `view_pitch` meters apart
    /// (OPTICS 3).
    pub fn depth_of_disparity(&self, disparity: f64, view_pitch: f64) -> f64 {
        disparity * self.focal_length * self.image_pixel() / view_pitch
    }
}

/// The signed DFT bin of index `k`, which may lie outside `0..n`. The result is in `-n/2 ..= (n - 1)/2`, in the order
/// of `fftfreq`.
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
    fn details_are_as_fine_as_the_pupil_is_wide() {
        let optics = Optics::new(8, 8, 8e-6, 520e-9, 0.4).unwrap();
        // 4 mm of green light give 134 cycles per degree, 6.5 pixels of 8 um each. A wide pupil is limited by two
        // pixels per cycle.
        assert!((optics.finest_cycles_per_degree(4e-3) - 134.26).abs() < 0.01);
        assert!((optics.finest_cycles_per_degree(20e-3) - 436.33).abs() < 0.01);
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
