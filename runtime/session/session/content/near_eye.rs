//! Chooses views around the tracked pupil for content that is made while it is shown, and its exposures.

use crate::optics::{Color, Display, Padding, mean_light};
use crate::scene::LightField;
use crate::session::content::scenes::Due;
use crate::session::frame_log::error::SessionError;
use crate::session::refinement::field::LiveColor;
use crate::solve::{BrightEnd, Problem, random_phases};
use eyebox_base::error::Reason;
use rayon::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// The number of requested views along an axis if a tracker gives the position of the eye.
pub(crate) const TRACKED_VIEWS: u32 = 3;
/// The exposure before the first frame. The next constant is the lowest one (OPTICS 6c).
pub(crate) const USUAL_EXPOSURE: f64 = 0.35;
const LEAST_EXPOSURE: f64 = 0.05;

/// The views that are made for a pupil.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NearViews {
    /// The number along each axis.
    pub views: u32,
    /// The distance of neighbors (m).
    pub pitch: f64,
    /// The middle in the pupil plane (m).
    pub center: [f64; 2],
}

impl NearViews {
    /// Selects a few close views around the pupil if there is a tracker, otherwise `most` over the whole eyebox (m).
    pub fn of(due: &Due, eyebox: f64, most: u32) -> Self {
        let (views, side, center) = match due.tracked {
            true => {
                let side = (due.pupil.diameter[1] + 4.0 * due.pupil.spread).min(eyebox);
                let reach = (eyebox - side) / 2.0;
                (most.min(TRACKED_VIEWS), side, due.pupil.centre.map(|v| v.clamp(-reach, reach)))
            }
            false => (most, eyebox, [0.0; 2]),
        };
        Self { views, pitch: side / f64::from(views), center }
    }

    /// Returns the places (x, y) of the views in the pupil plane, row by row (m).
    pub fn places(&self) -> Vec<[f64; 2]> {
        let at = |index: u32, axis: usize| {
            (f64::from(index) - f64::from(self.views - 1) / 2.0) * self.pitch + self.center[axis]
        };
        (0..self.views * self.views).map(|i| [at(i % self.views, 0), at(i / self.views, 1)]).collect()
    }

    /// Returns the places as pairs.
    pub fn pairs(&self) -> Vec<(f64, f64)> {
        self.places().into_iter().map(|[x, y]| (x, y)).collect()
    }
}

/// One exposure for each color, set by the first frame. It only rises, and only if the light would not suffice. Clones
/// are the same exposures, so that both eyes see the same brightness.
#[derive(Debug, Clone, Default)]
pub(crate) struct Exposures(Arc<Mutex<Option<Vec<f64>>>>);

impl Exposures {
    /// Returns the exposures for another frame.
    ///
    /// The slice `ends` holds the estimate from the bright end of the middle view of each color, and the mean of that
    /// view. An exposure is per unit of light of the sources.
    pub fn of(&self, display: &Display, colors: &[Color], ends: &[[f64; 2]]) -> Vec<f64> {
        let lights = colors.iter().map(|color| mean_light(&display.modes(*color)));
        let ends: Vec<[f64; 2]> = ends.iter().zip(lights).map(|(end, light)| end.map(|v| v / light)).collect();
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let exposures = kept.get_or_insert_with(|| ends.iter().map(|[guess, _]| guess.max(LEAST_EXPOSURE)).collect());
        exposures.iter_mut().zip(&ends).for_each(|(exposure, [_, mean])| *exposure = exposure.max(*mean));
        exposures.clone()
    }

    /// Returns the colors of a light field around `center` (m), with their exposures.
    ///
    /// # Errors
    /// Returns [`SessionError::Setting`] if the display does not have a color.
    pub fn colors(
        &self,
        field: &LightField,
        display: &Display,
        center: [f64; 2],
    ) -> Result<Vec<LiveColor>, SessionError> {
        let middle = |views: &Vec<Vec<f32>>| {
            let end = BrightEnd::of(views.get(views.len() / 2).map(Vec::as_slice));
            [end.contrast.max(end.mean), end.mean]
        };
        let ends: Vec<[f64; 2]> = field.planes.par_iter().map(middle).collect();
        let exposures = self.of(display, &field.colors, &ends);
        let one = |(color, exposure): (&Color, f64)| {
            let problem = Problem::new(field, *color, display, Padding::default());
            let problem = problem.map_err(|e| SessionError::Setting(Reason::of(&e)))?;
            Ok(LiveColor { problem: Problem { center, ..problem }, phases: Vec::new(), exposure, laser: None })
        };
        field.colors.iter().zip(exposures).map(one).collect()
    }
}

/// Builds a light field of views (color, view, pixel) of the size of a display, on a grid of (rows, columns) with a
/// pitch in m.
pub(crate) fn light_field(
    name: String,
    display: &Display,
    colors: &[Color],
    (grid, pitch): ([usize; 2], f64),
    planes: Vec<Vec<Vec<f32>>>,
) -> LightField {
    let (height, width) = display.picture_size();
    let (view_pitch, disparity, depth, made) = (Some(pitch), None, None, None);
    LightField { name, grid, height, width, colors: colors.to_vec(), planes, view_pitch, disparity, depth, made }
}

/// Returns the start of refinement before the first scene arrives, with random phases of `frames` sub-frames and dark
/// views.
///
/// # Errors
/// Returns [`SessionError::Setting`] if the display does not have a color.
pub fn darkness(display: &Display, colors: &[Color], frames: usize, seed: u64) -> Result<Vec<LiveColor>, SessionError> {
    let (height, width) = display.picture_size();
    let dark = vec![vec![vec![0.0; height * width]]; colors.len()];
    let field = light_field(String::new(), display, colors, ([1, 1], display.eyebox_min()), dark);
    let one = |(i, color): (usize, &Color)| {
        let problem = Problem::new(&field, *color, display, Padding::default());
        let problem = problem.map_err(|e| SessionError::Setting(Reason::of(&e)))?;
        let pixels = problem.optics.height * problem.optics.width;
        let phases = random_phases(frames * pixels, seed.wrapping_add(i as u64));
        Ok(LiveColor { problem, phases, exposure: USUAL_EXPOSURE, laser: None })
    };
    colors.iter().enumerate().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::SwitchedSource;

    /// Half the light of the sources requires twice the exposure.
    #[test]
    fn exposures_are_per_unit_of_the_sources_light() {
        let exposures_at = |power: f64| {
            let mut display = Display { height: 32, width: 48, ..Display::preset("small").unwrap() };
            let source = |x| SwitchedSource { eyebox_mm: Some([x, 0.0]), power, ..SwitchedSource::default() };
            display.sources.each = [-30.0, 30.0].map(source).to_vec();
            let exposures = Exposures::default();
            [[0.3, 0.1], [0.2, 0.6]].map(|end| exposures.of(&display, &[Color::Green], &[end])[0])
        };
        for (exposure, wanted) in exposures_at(0.5).into_iter().zip([0.6, 1.2]) {
            assert!((exposure - wanted).abs() < 1e-12, "{exposure}, and {wanted} was expected");
        }
        assert_eq!(exposures_at(1.0), [0.3, 0.6]);
    }
}
