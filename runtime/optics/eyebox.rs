//! Computes the eyebox of a display, once for each of its switchable sources (OPTICS 12).

use super::{Color, Display, Geometry, OpticsError, Pupil};

/// A rectangle of the pupil plane in meters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EyeboxRegion {
    /// The middle of the rectangle, (x, y).
    pub center: [f64; 2],
    /// The sides along x and y.
    pub size: [f64; 2],
}

impl EyeboxRegion {
    fn square(center: [f64; 2], side: f64) -> Self {
        Self { center, size: [side; 2] }
    }

    /// The largest distance along each axis between the centers of a disc of this diameter and of the rectangle, with
    /// the disc inside. It is 0 if the disc does not fit.
    pub fn room(&self, diameter: f64) -> [f64; 2] {
        self.size.map(|side| ((side - diameter) / 2.0).max(0.0))
    }

    fn holds(&self, place: [f64; 2]) -> bool {
        (0..2).all(|i| (place[i] - self.center[i]).abs() <= self.size[i] / 2.0 + SAME)
    }
}

/// Edges closer than this count as one edge, meters.
const SAME: f64 = 1e-9;

/// The rectangle around the regions, and the area that they cover in square meters.
fn around(regions: &[EyeboxRegion]) -> (EyeboxRegion, f64) {
    let edges = |i: usize| {
        let ends = |r: &EyeboxRegion| [r.center[i] - r.size[i] / 2.0, r.center[i] + r.size[i] / 2.0];
        let mut edges: Vec<f64> = regions.iter().flat_map(ends).collect();
        edges.sort_by(f64::total_cmp);
        edges.dedup_by(|a, b| *a - *b < SAME);
        edges
    };
    let [x, y] = [edges(0), edges(1)];
    let mut area = 0.0;
    for across in x.windows(2) {
        for down in y.windows(2) {
            let middle = [across, down].map(|ends| (ends[0] + ends[1]) / 2.0);
            if regions.iter().any(|r| r.holds(middle)) {
                area += (across[1] - across[0]) * (down[1] - down[0]);
            }
        }
    }
    let span = |edges: &[f64]| (edges.first().copied().unwrap_or(0.0), edges.last().copied().unwrap_or(0.0));
    let ((left, right), (top, bottom)) = (span(&x), span(&y));
    let center = [(left + right) / 2.0, (top + bottom) / 2.0];
    (EyeboxRegion { center, size: [right - left, bottom - top] }, area)
}

impl Display {
    /// Side in meters of the eyebox that all colors serve with one source. It is the eyebox of the shortest wavelength
    /// (OPTICS 1), or the side of the SLM (OPTICS 9).
    pub fn source_eyebox_min(&self) -> f64 {
        match self.geometry {
            Geometry::Relay => self.shortest() * self.focal_length / (self.pitch / self.mask_factor() as f64),
            Geometry::FarField => self.height.min(self.width) as f64 * self.pitch,
        }
    }

    /// Side in meters of the square about the axis that holds the eyeboxes of all sources. Without switchable sources
    /// it is [the side for one source](Self::source_eyebox_min). Views and pupils are spread over this square.
    pub fn eyebox_min(&self) -> f64 {
        let farthest = |source: &super::SwitchedSource| {
            let [x, y] = source.eyebox(self.focal_length).map(f64::abs);
            x.max(y)
        };
        let off = self.sources.each.iter().map(farthest).fold(0.0, f64::max);
        2.0 * off + self.source_eyebox_min()
    }

    /// The eyeboxes of the sources at these places in the list. Their side is the one that all colors serve.
    fn eyeboxes(&self, sources: &[usize]) -> Vec<EyeboxRegion> {
        let side = self.source_eyebox_min();
        let middle = |at: &usize| self.sources.each[*at].eyebox(self.focal_length);
        sources.iter().map(|at| EyeboxRegion::square(middle(at), side)).collect()
    }

    /// Rectangles in which the lit sources serve a whole pupil of a color. They are one rectangle if the eyeboxes leave
    /// no gap. The list is empty if that rectangle is the square about the axis, as without switchable sources.
    pub fn regions(&self, color: Color) -> Vec<EyeboxRegion> {
        let each = self.eyeboxes(&self.sources.lit(color, self.focal_length));
        if each.is_empty() {
            return each;
        }
        let (whole, area) = around(&each);
        let is_covered = area >= (1.0 - 1e-6) * whole.size[0] * whole.size[1];
        let side = self.eyebox_min();
        let plain = whole.center.iter().all(|c| c.abs() < SAME) && whole.size.iter().all(|s| (s - side).abs() < SAME);
        match (is_covered, plain) {
            (true, true) => Vec::new(),
            (true, false) => vec![whole],
            (false, _) => each,
        }
    }

    /// The rectangle around the eyeboxes of all sources of the shortest wavelength, in meters, and the area that they
    /// cover in square meters.
    pub(super) fn whole_eyebox(&self) -> (EyeboxRegion, f64) {
        let shortest = self.wavelengths.iter().min_by(|a, b| a.wavelength.total_cmp(&b.wavelength));
        let each = shortest.map_or_else(Vec::new, |w| self.eyeboxes(&self.sources.of(w.color)));
        let side = self.source_eyebox_min();
        if each.is_empty() { (EyeboxRegion::square([0.0; 2], side), side * side) } else { around(&each) }
    }

    /// Does [`Pupil::check_usual`] for one color. The pupil's center must be in the eyebox of one of that color's
    /// sources.
    ///
    /// # Errors
    /// The errors of [`Pupil::check_usual`] and [`optics`](Self::optics).
    pub fn check_pupil(&self, color: Color, pupil: Pupil) -> Result<Pupil, OpticsError> {
        let optics = self.optics(color)?;
        let seen_by = |at: usize| {
            let [x, y] = self.sources.each[at].eyebox(self.focal_length);
            Pupil { x: pupil.x - x, y: pupil.y - y, ..pupil }.check_usual(&optics).is_ok()
        };
        if self.sources.of(color).into_iter().any(seen_by) {
            return Ok(pupil);
        }
        let ([x_mm, y_mm, diameter_mm, _], color) = (pupil.to_mm(), color.to_string());
        let (eyebox_mm, reach_mm) = (self.eyebox_min() * 1e3, self.eyebox_min() * 0.5e3);
        let outside = OpticsError::OutsideEyebox { x_mm, y_mm, diameter_mm, eyebox_mm, reach_mm, color };
        match pupil.check_usual(&optics) {
            // The axis may be in no eyebox of a source.
            Ok(_) | Err(OpticsError::OutsideEyebox { .. }) if !self.sources.is_empty() => Err(outside),
            checked => checked,
        }
    }
}

#[cfg(test)]
#[path = "switched_tests.rs"]
mod tests;
