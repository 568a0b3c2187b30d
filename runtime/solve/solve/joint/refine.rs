//! Refines a hologram of all colors at once for the position of the eye.

use super::shared::SharedDrives;
use crate::engine::{Engine, EngineError, Storage};
use crate::evaluate::Sums;
use crate::optics::{Laser, Pupil, PupilDistribution};
use crate::solve::best::Refinable;
use crate::solve::error::{SolveError, require};
use crate::solve::motion::Motion;
use crate::solve::problem::Problem;
use crate::solve::refine_settings::RefineSettings;
use crate::solve::steer::Refiner;

/// One color of a hologram that shows all of them at once.
#[derive(Debug, Clone)]
pub struct JointPart {
    /// The scene for this wavelength.
    pub problem: Problem,
    /// The exposure for which it was solved.
    pub exposure: f64,
    /// The slope of its light per drive value, and its powers.
    pub laser: Laser,
}

/// A hologram of all colors at once under refinement, with one engine per color.
///
/// A step is a step of every color through the same pupils. The changes that they request of the shared drive values
/// are added up (OPTICS 13). The powers of the lasers stay the same.
pub struct JointRefiner {
    pub(super) colors: Vec<Refiner>,
    pub(super) shared: SharedDrives,
}

impl JointRefiner {
    /// Starts with these drive values as phases of one turn (frames, height, width), radians, and aims at the whole
    /// eyebox. `engine` makes an engine for each color.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for values that are invalid for simultaneous color, and [`SolveError::Engine`] if an
    /// engine fails.
    pub fn new(
        parts: Vec<JointPart>,
        drives: &[f32],
        steering: RefineSettings,
        mut engine: impl FnMut() -> Result<Box<dyn Engine>, EngineError>,
    ) -> Result<Self, SolveError> {
        let steering = for_joint_colors(steering)?;
        SharedDrives::check(parts.iter().map(|part| (&part.problem, &part.laser)))?;
        let lasers: Vec<Laser> = parts.iter().map(|part| part.laser.clone()).collect();
        let one = |JointPart { problem, exposure, laser }: JointPart| {
            let phases = laser.phases(drives);
            Refiner::lit_by(problem, &phases, exposure, &laser.powers, steering, engine()?)
        };
        let mut colors = parts.into_iter().map(one).collect::<Result<Vec<_>, _>>()?;
        let shared = SharedDrives::new(drives, lasers, &mut colors)?;
        Ok(Self { colors, shared })
    }

    /// Sets the movement while the sub-frames are lit, from now on, in pixels of each color.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for invalid values.
    pub fn moves(&mut self, motion: Motion) -> Result<(), SolveError> {
        self.colors.iter_mut().try_for_each(|color| color.moves(motion))
    }

    /// Returns the mean loss of the current drive values over the colors, through the pupils of the next step.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn loss(&mut self) -> Result<f64, EngineError> {
        let losses = self.colors.iter_mut().map(Refiner::loss).collect::<Result<Vec<_>, _>>()?;
        Ok(losses.iter().sum::<f64>() / losses.len().max(1) as f64)
    }

    /// Restarts with the original drive values.
    ///
    /// # Errors
    /// [`EngineError`] if an engine fails.
    pub fn begin_again(&mut self) -> Result<(), EngineError> {
        self.shared.begin_again(&mut self.colors)
    }

    /// Returns the phases of each color for the current drive values (frames, height, width), radians in -pi .. pi.
    pub fn phases(&self) -> &[Vec<f32>] {
        self.shared.phases()
    }

    /// Returns the sums of image and target image for each of these pupils, of the color with this index.
    ///
    /// # Errors
    /// [`EngineError`] if the engine fails, and [`EngineError::Mismatch`] for a color that it does not have.
    pub fn look(&mut self, color: usize, pupils: &[Pupil]) -> Result<Vec<Sums>, EngineError> {
        let count = self.colors.len();
        let missing = || EngineError::Mismatch { reason: format!("color {color} of {count}: the first is 0") };
        self.colors.get_mut(color).ok_or_else(missing)?.look(pupils)
    }
}

impl Refinable for JointRefiner {
    fn aim(&mut self, aim: PupilDistribution) -> Result<(), EngineError> {
        self.colors.iter_mut().try_for_each(|color| color.aim(aim))?;
        self.shared.aimed(&self.colors);
        Ok(())
    }

    fn step(&mut self) -> Result<f64, EngineError> {
        self.shared.step(&mut self.colors)
    }

    fn look_at_colors(&mut self, pupils: &[Pupil]) -> Result<Vec<Vec<Sums>>, EngineError> {
        (0..self.colors.len()).map(|color| self.look(color, pupils)).collect()
    }

    fn aimed_at(&self) -> PupilDistribution {
        self.colors[0].aim
    }

    fn state(&mut self) -> Result<Vec<Vec<f32>>, EngineError> {
        Ok(self.phases().to_vec())
    }
}

/// Returns the settings for simultaneous color, which adds up the changes of the colors in float32.
///
/// # Errors
/// [`SolveError::Setting`] if they request halves.
pub fn for_joint_colors(steering: RefineSettings) -> Result<RefineSettings, SolveError> {
    let right = "fp32 for simultaneous color, which adds up changes";
    require(steering.storage != Some(Storage::F16), "how fields are stored", Storage::F16.name(), right)?;
    Ok(RefineSettings { storage: Some(Storage::F32), ..steering })
}
