//! A hologram of all colours at once under refinement for where the eye is.

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

/// One colour of a hologram that shows all of them at once.
#[derive(Debug, Clone)]
pub struct JointPart {
    /// The scene before its wavelength.
    pub problem: Problem,
    /// What it was solved for.
    pub exposure: f64,
    /// What its light makes of the drives, and its powers.
    pub laser: Laser,
}

/// A hologram of all colours at once under refinement, each colour on an engine of its own: a step is a step of every colour's own,
/// through the same pupils, and what they ask of the drives that they share is added up (OPTICS 13). The powers of the lasers stay.
pub struct JointRefiner {
    pub(super) colors: Vec<Refiner>,
    pub(super) shared: SharedDrives,
}

impl JointRefiner {
    /// Begins with these drives, as phases of one turn, (frames, height, width), radians, and the whole eyebox as aim; `engine` makes an
    /// engine for each colour.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for what cannot be, or cannot be of all colours at once; those of the engines.
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

    /// What moves while the sub-frames are lit, from now on, in pixels of each colour.
    ///
    /// # Errors
    /// [`SolveError::Setting`] for what cannot be.
    pub fn moves(&mut self, motion: Motion) -> Result<(), SolveError> {
        self.colors.iter_mut().try_for_each(|color| color.moves(motion))
    }

    /// The mean over the colours of the losses of the drives as they are, through the pupils that the next step looks through.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn loss(&mut self) -> Result<f64, EngineError> {
        let losses = self.colors.iter_mut().map(Refiner::loss).collect::<Result<Vec<_>, _>>()?;
        Ok(losses.iter().sum::<f64>() / losses.len().max(1) as f64)
    }

    /// Begins again with the drives that it was made with.
    ///
    /// # Errors
    /// Those of the engines.
    pub fn begin_again(&mut self) -> Result<(), EngineError> {
        self.shared.begin_again(&mut self.colors)
    }

    /// What each colour has of the drives now: (frames, height, width), radians in -pi .. pi.
    pub fn phases(&self) -> &[Vec<f32>] {
        self.shared.phases()
    }

    /// What each of these pupils sees now of one colour, by its place, and should see.
    ///
    /// # Errors
    /// Those of the engine; [`EngineError::Mismatch`] for a colour that it does not have.
    pub fn look(&mut self, color: usize, pupils: &[Pupil]) -> Result<Vec<Sums>, EngineError> {
        let count = self.colors.len();
        let missing = || EngineError::Mismatch { reason: format!("colour {color} of {count}: the first is 0") };
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

/// A steering as it is of all colours at once: what they ask of the drives is added up in float32.
///
/// # Errors
/// [`SolveError::Setting`] where it asks for halves.
pub fn for_joint_colors(steering: RefineSettings) -> Result<RefineSettings, SolveError> {
    let right = "fp32 for all colours at once, whose changes are added up";
    require(steering.storage != Some(Storage::F16), "how fields are stored", Storage::F16.name(), right)?;
    Ok(RefineSettings { storage: Some(Storage::F32), ..steering })
}
