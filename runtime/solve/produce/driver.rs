//! The driver: one hologram, a sequence or tiles, as the job says.

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

/// What came of a job.
#[non_exhaustive]
pub enum SceneSolution {
    /// One hologram.
    Hologram(Box<SolvedHologram>),
    /// A sequence in its file.
    Sequence(SolvedSequence),
    /// A far field in its tiles.
    Tiles(Box<SolvedTiles>),
}

/// A hologram, and how it was solved.
pub struct SolvedHologram {
    /// It.
    pub hologram: Hologram,
    /// Per colour.
    pub solutions: Vec<(Color, Solution)>,
    /// What of the scene was computed.
    pub plan: ScenePlan,
    /// The settings of the solve.
    pub settings: Settings,
    /// The scene as it was solved.
    pub field: LightField,
}

impl SolvedHologram {
    /// The hologram, unless a colour's solve ended at a loss that is no finite number.
    ///
    /// # Errors
    /// [`ProduceError::NotFinite`].
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
    /// The hologram, where it is one in memory.
    pub fn into_hologram(self) -> Option<Hologram> {
        match self {
            Self::Hologram(solved) => Some(solved.hologram),
            _ => None,
        }
    }
}

/// Solves a scene, or several: all colours of one hologram, a sequence, or a far field in tiles. `out` is where it is saved,
/// by its ending; a single hologram may stay in memory. A sequence and tiles that were cut off are resumed by the same job.
///
/// `observe` is told what happens; answering [`Flow::Stop`] ends it with what there is.
///
/// # Errors
/// [`ProduceError`], first of all where the display or the pupils look like a mistake ([`SceneJob::force`]); a file that was there stays as it was, but for what was made of a sequence and of tiles.
pub fn solve_scene(
    job: &SceneJob,
    out: Option<&Path>,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<SceneSolution, ProduceError> {
    let needs = |what: &str| ProduceError::Job(reason!("no-file", "{what} is solved into its file: say where"));
    job.check_usual()?;
    if job.scenes.len() > 1 || job.tiles.is_some() {
        job.check_one_by_one()?;
    }
    // Before the scene is loaded, which takes long where it is large.
    if let Some(brightness) = job.settings.joint.map(|joint| joint.brightness).filter(|b| *b > job.colors.len() as f64)
    {
        let most = job.colors.len();
        return Err(ProduceError::Job(reason!(
            "brightness",
            "the brightness of joint colours is {brightness}: it must be 1 to {most}, the number of colours"
        )));
    }
    match (job.scenes.len(), &job.tiles) {
        (0, _) => Err(ProduceError::Job(reason!("no-scene", "there is no scene to solve"))),
        (1, Some(tiles)) => {
            let out = out.ok_or_else(|| needs("a far field in tiles"))?;
            Ok(SceneSolution::Tiles(Box::new(tiles::solve(job, tiles, out, engine, observe)?)))
        }
        (1, None) => {
            // Before the scene is loaded, which takes long where it is large.
            check_job(job, engine)?;
            let solved = solve_field(job, job.load(0)?, job.record(0)?, engine, observe)?;
            if let Some(out) = out {
                solved.hologram.save(out)?;
            }
            Ok(SceneSolution::Hologram(Box::new(solved)))
        }
        (_, Some(_)) => Err(ProduceError::Job(reason!(
            "sequence-in-tiles",
            "a sequence is not solved in tiles: leave out one or the other"
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

/// Solves a light field that is in memory and has the size of the display's pictures, as [`solve_scene`] solves a single scene; the job's own
/// scenes are not looked at. The hologram stays in memory.
///
/// # Errors
/// [`ProduceError`].
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
            "the light field has {h} x {w} pixels: the display shows {rows} x {columns}"
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
    // What the hologram's file remembers of its scene is the scene as it is, not what the plan leaves of it.
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
