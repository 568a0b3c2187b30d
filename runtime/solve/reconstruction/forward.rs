//! Computes the images of phases through pupils, and the gradients of any function of these images.

use super::ReconstructionError;
use crate::engine::{Buffer, Engine, Kernel, Purpose};
use crate::evaluate;
use crate::hologram::{ColorHologram, Hologram, HologramError};
use crate::optics::{Color, Display, Pupil, wrap_phase};
use crate::plan::{Comparison, Planner, PupilPass};
use crate::scene::Bend;
use eyebox_base::reason;
use eyebox_kernels::{compare, trig};
use rayon::prelude::*;

/// The images of the phases of one color as a function that can be differentiated, for optimizers outside of this
/// library.
///
/// The phases have the axes (sub-frame, row, column), in radians. They may have any turns. The images have the axes
/// (pupil, row, column). An image is what [`PhaseSource::look`](crate::hologram::PhaseSource::look) returns and
/// [`Hologram::as_seen`] bends. It is the mean intensity over the sub-frames, divided by the pupil's share of the
/// eyebox, through the display's model, its source and the eye's prescription. It has the pixels of the picture
/// ([`image_size`](Self::image_size)). No exposure is applied.
///
/// The SLM shows any phase. Its levels have no derivative and are not included.
///
/// ```
/// use eyebox_compute::engine::cpu::CpuEngine;
/// use eyebox_optics::{Color, Display, Pupil};
/// use eyebox_solve::reconstruction::ForwardModel;
///
/// let display = Display { height: 24, width: 32, ..Display::load("small")? };
/// let (model, mut engine) = (ForwardModel::new(&display, Color::Green, 2)?, CpuEngine::new());
/// let pupils = [Pupil { x: 2e-3, y: 0.0, diameter: 4e-3, depth: 1e-3 }];
/// let phases: Vec<f32> = (0..2 * 24 * 32).map(|i| (i * i % 628) as f32 / 100.0).collect();
/// let images = model.images(&phases, &pupils, &mut engine)?;
/// // The loss is the sum of the squares of the image, and the gradient is with respect to each phase.
/// let gradients: Vec<f32> = images.iter().map(|value| 2.0 * value).collect();
/// let gradient = model.adjoint(&phases, &pupils, &gradients, &mut engine)?;
/// assert_eq!(gradient.len(), phases.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct ForwardModel {
    /// The optics of the hologram, without phases.
    about: Hologram,
    planner: Planner,
    /// The distortion of the display's picture, if it has one.
    bend: Option<Bend>,
}

impl ForwardModel {
    /// Makes the model of a color of a display for this number of sub-frames.
    ///
    /// # Errors
    /// Returns [`ReconstructionError::Hologram`] for a display without that color or with impossible optics, and for no
    /// sub-frames.
    pub fn new(display: &Display, color: Color, frames: usize) -> Result<Self, ReconstructionError> {
        let wavelength = display.optics(color)?.wavelength;
        if frames == 0 {
            let reason = reason!("empty", "it needs at least one sub-frame");
            return Err(HologramError::Inconsistent(reason).into());
        }
        let only = ColorHologram { color: Some(color), wavelength, exposure: 1.0, efficiency: 1.0, phases: Vec::new() };
        let about = Hologram::on(display, frames, vec![only]);
        let (planner, (rows, columns)) = (about.planner(0)?, about.picture_size());
        let map = about.metadata.picture.map(color, [rows, columns]);
        let bend = map.map(|map| Bend::to_viewer(&map, [rows, columns]));
        Ok(Self { about, planner, bend })
    }

    /// Returns the numbers of sub-frames, rows and columns of the phases.
    pub fn shape(&self) -> [usize; 3] {
        [self.about.frames, self.about.height, self.about.width]
    }

    /// Returns the numbers of rows and columns of an image. They are the SLM's, or equal in the far field.
    pub fn image_size(&self) -> [usize; 2] {
        self.about.picture_size().into()
    }

    /// Computes the images of phases through pupils (pupil, row, column).
    ///
    /// # Errors
    /// Returns [`ReconstructionError::Count`] and [`ReconstructionError::NotFinite`] for phases that do not fit, the
    /// errors of [`Hologram::check_pupil`], and the errors of the engine.
    pub fn images(
        &self,
        phases: &[f32],
        pupils: &[Pupil],
        engine: &mut dyn Engine,
    ) -> Result<Vec<f32>, ReconstructionError> {
        let phases = self.checked(phases, pupils)?;
        engine.load(&self.planner.shape(Purpose::View), None)?;
        engine.write(Buffer::Phases, &phases)?;
        let images = evaluate::views(engine, &self.planner, pupils)?;
        let bent = images.into_iter().map(|image| match &self.bend {
            Some(bend) => bend.apply(&image),
            None => image,
        });
        Ok(bent.flatten().collect())
    }

    /// Computes the derivatives of a function of the images with respect to each phase (sub-frame, row, column), from
    /// its derivatives with respect to each pixel of the images (pupil, row, column). A derivative that is not finite
    /// makes the result not finite.
    ///
    /// # Errors
    /// Returns the errors of [`images`](Self::images), and [`ReconstructionError::Count`] for another number of
    /// derivatives.
    pub fn adjoint(
        &self,
        phases: &[f32],
        pupils: &[Pupil],
        gradients: &[f32],
        engine: &mut dyn Engine,
    ) -> Result<Vec<f32>, ReconstructionError> {
        let phases = self.checked(phases, pupils)?;
        let [rows, columns] = self.image_size();
        check_count("gradients", gradients.len(), pupils.len() * rows * columns)?;
        if pupils.is_empty() {
            return Ok(vec![0.0; phases.len()]);
        }
        let comparison = Comparison { mode: compare::INTENSITY, ..Comparison::default() };
        let passes: Vec<PupilPass> = pupils.iter().map(|pupil| self.planner.pupil_pass(pupil, &comparison)).collect();
        let step = self.planner.adjoint_step(passes);
        engine.load(&self.planner.shape(Purpose::Project), None)?;
        engine.write(Buffer::Phases, &phases)?;
        let mut done = 0;
        let turns = step.list.iter().enumerate().filter(|(_, d)| d.kernel == Kernel::ApplyFactor).map(|(at, _)| at);
        for ((at, pass), gradient) in turns.zip(&step.pupil_passes).zip(gradients.chunks_exact(rows * columns)) {
            engine.run_part(&step, done..at)?;
            let image = engine.read(Buffer::Image(0))?;
            let mut factor = self.through_crop(image, gradient);
            factor.iter_mut().for_each(|value| *value *= pass.intensity.gain);
            engine.write(Buffer::Image(0), &factor)?;
            done = at;
        }
        engine.run_part(&step, done..step.list.len())?;
        Ok(self.turned(&engine.read(Buffer::Change)?, &phases))
    }

    /// Returns the derivatives with respect to an image on the grid from the derivatives with respect to the image that
    /// an eye sees.
    fn through_crop(&self, image: Vec<f32>, gradient: &[f32]) -> Vec<f32> {
        let cropped = evaluate::crop(&self.planner, image);
        match &self.bend {
            Some(bend) => {
                let gradient = bend.adjoint(gradient, &bend.apply(&cropped));
                evaluate::crop_adjoint(&self.planner, &gradient, &cropped)
            }
            None => evaluate::crop_adjoint(&self.planner, gradient, &cropped),
        }
    }

    /// Returns `2 Im(conj(u) change)` for the fields `u` of the phases, from the change on the grid.
    fn turned(&self, change: &[f32], phases: &[f32]) -> Vec<f32> {
        let (place, [_, height, width]) = (self.planner.place(), self.shape());
        let (grid_height, grid_width) = (place.grid_height as usize, place.grid_width as usize);
        let mut gradient = phases.to_vec();
        gradient.par_chunks_exact_mut(width).enumerate().for_each(|(row, gradient)| {
            let (frame, y) = (row / height, row % height + place.top as usize);
            let change = &change[2 * ((frame * grid_height + y) * grid_width + place.left as usize)..];
            for (value, change) in gradient.iter_mut().zip(change.chunks_exact(2)) {
                let (c, s) = trig::cos_sin(*value);
                *value = 2.0 * (c * change[1] - s * change[0]);
            }
        });
        gradient
    }

    /// Returns phases within a turn, and refuses phases and pupils that do not fit.
    fn checked(&self, phases: &[f32], pupils: &[Pupil]) -> Result<Vec<f32>, ReconstructionError> {
        let [frames, height, width] = self.shape();
        check_count("phases", phases.len(), frames * height * width)?;
        if let Some(at) = phases.iter().position(|phase| !phase.is_finite()) {
            let [frame, row, column] = [at / (height * width), at / width % height, at % width];
            return Err(ReconstructionError::NotFinite { frame, row, column, phase: phases[at] });
        }
        pupils.iter().try_for_each(|pupil| self.about.check_pupil(*pupil).map(drop))?;
        Ok(phases.iter().map(|phase| wrap_phase(*phase)).collect())
    }
}

fn check_count(what: &'static str, given: usize, expected: usize) -> Result<(), ReconstructionError> {
    if given == expected { Ok(()) } else { Err(ReconstructionError::Count { what, given, expected }) }
}
