//! Solves one hologram, a sequence or tiles, as the job requires.

use super::ProduceError;
use super::colors::{solve_colors, solve_joint_colors};
use super::job::{SceneEvent, SceneJob, warn_of_aliasing};
use super::sequence::{self, SolvedSequence};
use super::tiles::{self, SolvedTiles};
use crate::engine::{Engine, Memory};
use crate::hologram::{Hologram, SceneRecord};
use crate::memory;
use crate::optics::Color;
use crate::quality::ColorJob;
use crate::scene::{LightField, SceneError};
use crate::solve::{Flow, Levels, ScenePlan, Settings, Solution, Stop};
use eyebox_base::reason;
use std::path::Path;

/// The result of a job.
#[non_exhaustive]
pub enum SceneSolution {
    /// One hologram in memory.
    Hologram(Box<SolvedHologram>),
    /// A sequence in its file.
    Sequence(SolvedSequence),
    /// A far field in its tiles.
    Tiles(Box<SolvedTiles>),
}

/// A hologram and the details of its solve.
pub struct SolvedHologram {
    /// The hologram with all solved colors.
    pub hologram: Hologram,
    /// The solution of each color.
    pub solutions: Vec<(Color, Solution)>,
    /// The parts of the scene that were computed.
    pub plan: ScenePlan,
    /// The settings of the solve.
    pub settings: Settings,
    /// The scene as it was solved.
    pub field: LightField,
}

impl SolvedHologram {
    /// Returns the hologram, unless the solve of a color ended at a loss that is not finite.
    ///
    /// # Errors
    /// [`ProduceError::NotFinite`] with the color and the step.
    pub fn into_finite(self) -> Result<Hologram, ProduceError> {
        for (color, solution) in &self.solutions {
            if let Stop::NotFinite { step, .. } = solution.stop {
                return Err(ProduceError::NotFinite { color: *color, step });
            }
        }
        Ok(self.hologram)
    }
}

impl SceneSolution {
    /// Returns the hologram if it is in memory.
    pub fn into_hologram(self) -> Option<Hologram> {
        match self {
            Self::Hologram(solved) => Some(solved.hologram),
            _ => None,
        }
    }
}

/// Solves one or several scenes as all colors of one hologram, a sequence, or a far field in tiles.
///
/// `out` is the file, whose extension decides the format. A single hologram may stay in memory. The same job resumes an
/// interrupted sequence or tiles. `observe` receives all events. If it returns [`Flow::Stop`], the solve ends with its
/// present result.
///
/// # Errors
/// [`ProduceError`], also if the display or the pupils look like a mistake ([`SceneJob::force`]). An existing file is
/// not changed, except for finished parts of a sequence and of tiles.
pub fn solve_scene(
    job: &SceneJob,
    out: Option<&Path>,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<SceneSolution, ProduceError> {
    let needs = |what: &str| ProduceError::Job(reason!("no-file", "{what}: no output file. Name one"));
    job.check_usual()?;
    if job.scenes.len() > 1 || job.tiles.is_some() {
        job.check_one_by_one()?;
    }
    // This check precedes the load of the scene, which can take long.
    if let Some(brightness) = job.settings.joint.map(|joint| joint.brightness).filter(|b| *b > job.colors.len() as f64)
    {
        let most = job.colors.len();
        return Err(ProduceError::Job(reason!(
            "brightness",
            "the brightness of joint colors is {brightness}: it must be 1 to {most}, the number of colors"
        )));
    }
    match (job.scenes.len(), &job.tiles) {
        (0, _) => Err(ProduceError::Job(reason!("no-scene", "the scenes: none given"))),
        (1, Some(tiles)) => {
            let out = out.ok_or_else(|| needs("a far field in tiles"))?;
            Ok(SceneSolution::Tiles(Box::new(tiles::solve(job, tiles, out, engine, observe)?)))
        }
        (1, None) => {
            // This check precedes the load of the scene, which can take long.
            check_job(job, engine)?;
            let solved = solve_field(job, job.load_on(0, engine)?, job.record(0)?, engine, observe)?;
            if let Some(out) = out {
                solved.hologram.save(out)?;
            }
            Ok(SceneSolution::Hologram(Box::new(solved)))
        }
        (_, Some(_)) => Err(ProduceError::Job(reason!(
            "sequence-in-tiles",
            "a sequence cannot be solved in tiles. Omit one of them"
        ))),
        (_, None) => {
            let out = out.ok_or_else(|| needs("a sequence"))?;
            Ok(SceneSolution::Sequence(sequence::solve(job, out, engine, observe)?))
        }
    }
}

fn check_job(job: &SceneJob, engine: &dyn Engine) -> Result<(), ProduceError> {
    let display = job.display;
    if engine.memory() != Memory::Device {
        let bytes = memory::bytes_of(&[job.settings.frames, display.height, display.width, 6], 4);
        let what = || format!("{} sub-frames of {} x {}", job.settings.frames, display.height, display.width);
        memory::check_available(what, bytes, "take fewer `frames` or a smaller `size`").map_err(SceneError::from)?;
    }
    Ok(())
}

/// Solves a light field in memory as [`solve_scene`] solves a single scene.
///
/// It must have the size of the display's pictures. The scenes of the job are not used. The hologram stays in memory.
///
/// # Errors
/// [`ProduceError`] for a light field of another size, and as [`solve_scene`].
pub fn solve_light_field(
    job: &SceneJob,
    field: LightField,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<SolvedHologram, ProduceError> {
    job.check_usual()?;
    field.check()?;
    let (size, wanted) = ((field.height, field.width), job.display.picture_size());
    if size != wanted {
        let ((h, w), (rows, columns)) = (size, wanted);
        return Err(ProduceError::Job(reason!(
            "light-field-size",
            "the light field: {h} x {w} pixels, but the display shows {rows} x {columns}"
        )));
    }
    check_job(job, engine)?;
    let record = job.record.clone().unwrap_or_else(|| SceneRecord::of_views(&field.name, &field));
    solve_field(job, field, record, engine, observe)
}

fn solve_field(
    job: &SceneJob,
    field: LightField,
    record: SceneRecord,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<SolvedHologram, ProduceError> {
    let plan = job.plan(&field)?;
    let display = &plan.lit(job.display);
    warn_of_aliasing(&field, display, &plan.settings);
    // The hologram's file describes the whole scene, not the part that the plan keeps.
    let (views, cell) = field.own_views(display);
    let field = plan.reduce(field, display);
    let (base, levels) = (plan.settings.clone(), Levels::of(display));
    let color_job = ColorJob { field: &field, color: plan.colors[0], display, base, levels };
    let settings = color_job.settings(&plan.settings);
    settings.check()?;
    observe(&SceneEvent::Planned { field: &field, views, plan: &plan, settings: &settings });
    let (solutions, joint_color) = if settings.joint.is_some() {
        let (solutions, joint) = solve_joint_colors(&color_job, &plan.colors, &settings, engine, observe)?;
        (solutions, Some(joint))
    } else {
        (solve_colors(&color_job, &plan.colors, &settings, engine, observe)?, None)
    };
    let mut hologram = Hologram::from_solutions(&field, display, &settings, plan.padding, &solutions)?;
    hologram.metadata.joint_color = joint_color;
    let name = hologram.scene.clone();
    hologram.set_scene(&name, record);
    hologram.metadata.views = Some(views);
    hologram.metadata.view_pitch_mm = Some(cell * 1e3);
    job.describe_reading(&mut hologram.metadata);
    Ok(SolvedHologram { hologram, solutions, plan, settings, field })
}
