//! Several scenes into a sequence of holograms, each from the one before.

use super::job::warn_of_aliasing;
use super::{ProduceError, SceneEvent, SceneJob};
use crate::engine::Engine;
use crate::hologram::{ColorHologram, Hologram, HologramError, Sequence, SequenceWriter, Start};
use crate::optics::{Color, Padding};
use crate::scene::LightField;
use crate::solve::{Flow, Levels, Problem, Progress, Settings, Solution, Warm, solve_from};
use std::path::Path;

/// How far a sequence is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SolvedSequence {
    /// Holograms that it has.
    pub done: usize,
    /// How many there are to be: fewer are there where it was asked to stop.
    pub count: usize,
    /// How many of them were solved now.
    pub solved: usize,
}

/// What all frames have in common.
struct Common<'a> {
    job: &'a SceneJob<'a>,
    settings: Settings,
    padding: Padding,
}

/// Solves one scene after the other into a sequence; resumes one of the same job.
pub(super) fn solve(
    job: &SceneJob,
    out: &Path,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<SolvedSequence, ProduceError> {
    let count = job.scenes.len();
    let (planned, rate) = (Some(count as u64), job.sequence.rate);
    let first = job.load(0)?;
    let common = Common::new(job, &first)?;
    let mut like = common.like(&first)?;
    let mut writer = match out.exists() {
        false => None,
        true => match SequenceWriter::resume(out, &like, rate, planned)? {
            Some(writer) => Some(writer),
            None => return Ok(SolvedSequence { done: count, count, solved: 0 }),
        },
    };
    let done = writer.as_ref().map_or(0, |w| w.count() as usize);
    observe(&SceneEvent::Sequence { done, count });
    let mut before = match done {
        0 => None,
        _ => Some(Sequence::open(out)?.load(done as u64 - 1)?),
    };
    let mut first = Some(first).filter(|_| done == 0);
    for index in done..count {
        let field = first.take().map_or_else(|| job.load(index), Ok)?;
        let Some(solutions) = common.frame(index, &field, before.as_ref(), engine, observe)? else {
            return Ok(SolvedSequence { done: index, count, solved: index - done });
        };
        let mut hologram = Hologram::from_solutions(&field, job.display, &common.settings, common.padding, &solutions)?;
        for (c, b) in hologram.colors.iter_mut().zip(before.iter().flat_map(|b| &b.colors)) {
            (c.exposure, c.efficiency) = (b.exposure, b.efficiency);
        }
        let to = match &mut writer {
            Some(writer) => writer,
            None => {
                like.colors.clone_from(&hologram.colors);
                // Nothing stood there when this began: who began at the same time was quicker.
                let busy = || HologramError::Busy { path: out.display().to_string() };
                let begun = SequenceWriter::create(out, &like, rate, planned);
                writer.insert(begun.map_err(|e| if Sequence::is_at(out) { busy() } else { e })?)
            }
        };
        to.append(&hologram)?;
        observe(&SceneEvent::Appended { hologram: index, scene: &job.scenes[index], solutions: &solutions });
        before = Some(hologram);
    }
    if let Some(writer) = writer {
        writer.finish()?;
    }
    Ok(SolvedSequence { done: count, count, solved: count - done })
}

impl<'a> Common<'a> {
    /// Decided by the first frame.
    fn new(job: &'a SceneJob, first: &LightField) -> Result<Self, ProduceError> {
        // Of a quality a sequence takes what a solve itself is told: each frame is all views and all pixels.
        let whole =
            SceneJob { settings: Settings { repeats: 1, views: 1, pixel: 1, ..job.settings.clone() }, ..job.clone() };
        let plan = whole.plan(first)?;
        let mut settings = plan.settings;
        settings.seconds = job.settings.seconds.map(|s| s / job.colors.len() as f64);
        if settings.levels == Levels::Display {
            settings.levels = Levels::of(job.display);
        }
        Ok(Self { job, settings, padding: plan.padding })
    }

    /// What is true of every hologram; its exposures are found in the first.
    fn like(&self, first: &LightField) -> Result<Hologram, ProduceError> {
        let job = self.job;
        let color = |&color: &Color| {
            let wavelength = job.display.optics(color)?.wavelength;
            Ok(ColorHologram { color: Some(color), wavelength, exposure: 1.0, efficiency: 1.0, phases: Vec::new() })
        };
        let mut like = Hologram::from_solutions(first, job.display, &self.settings, self.padding, &[])?;
        like.colors = job.colors.iter().map(color).collect::<Result<_, ProduceError>>()?;
        like.scene = job.scenes.join(", ");
        like.metadata.near = job.near;
        like.metadata.warm_start = Some(job.sequence.start);
        Ok(like)
    }

    /// All colours of one frame; none where it was asked to stop.
    fn frame(
        &self,
        index: usize,
        field: &LightField,
        before: Option<&Hologram>,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&SceneEvent) -> Flow,
    ) -> Result<Option<Vec<(Color, Solution)>>, ProduceError> {
        let job = self.job;
        let depth = field.depths(job.display, job.depth)?;
        let mut solutions = Vec::with_capacity(job.colors.len());
        if index == 0 {
            warn_of_aliasing(field, job.display, &Settings { depth, ..self.settings.clone() });
        }
        for (i, &color) in job.colors.iter().enumerate() {
            let problem = Problem::new(field, color, job.display, self.padding)?;
            let of_before = before.map(|b| &b.colors[i]);
            // One exposure for all frames, that of the first: lasers do not change from frame to frame.
            let efficiency = of_before.map(|b| (problem.mean / b.exposure).min(1.0)).filter(|e| *e > 0.0);
            let settings =
                Settings { depth, efficiency: efficiency.or(self.settings.efficiency), ..self.settings.clone() };
            let warm = match (job.sequence.start, of_before) {
                (Start::Warm(progress), Some(b)) => Some(Warm { phases: &b.phases, progress }),
                _ => None,
            };
            let mut asked = false;
            let mut stepped = |progress: &Progress| {
                let flow = observe(&SceneEvent::Step { hologram: index, color, progress });
                asked |= flow == Flow::Stop;
                flow
            };
            let solution = solve_from(&problem, &settings, warm, engine, &mut stepped)?;
            let flow = observe(&SceneEvent::Solved { hologram: index, color, solution: &solution });
            if asked || flow == Flow::Stop {
                return Ok(None);
            }
            solutions.push((color, solution));
        }
        Ok(Some(solutions))
    }
}

#[cfg(test)]
mod tests {
    use crate::engine::{self, Choice};
    use crate::files::FileError;
    use crate::hologram::{HologramError, Sequence};
    use crate::optics::Display;
    use crate::produce::{ProduceError, SceneEvent, SceneJob, solve_scene};
    use crate::solve::{Flow, Settings};
    use std::path::Path;

    fn solved(out: &Path, observe: &mut dyn FnMut(&SceneEvent) -> Flow) -> Result<(), ProduceError> {
        let display = Display { height: 24, width: 24, ..Display::load("paper").unwrap() };
        let mut job = SceneJob::new("builtin:plane?depth=0", &display);
        job.scenes.push("builtin:plane?depth=1".into());
        job.colors.truncate(1);
        job.settings = Settings { frames: 1, steps: 1, efficiency: Some(0.3), ..Settings::default() };
        solve_scene(&job, Some(out), engine::open(Choice::Cpu).unwrap().as_mut(), observe).map(drop)
    }

    /// One program has written the whole sequence by the time that another is done with the first hologram of it.
    #[test]
    fn who_was_slower_is_told_of_the_other() {
        let here = tempfile::tempdir().unwrap();
        let out = here.path().join("s.zarr");
        let slower = solved(&out, &mut |event| {
            if matches!(event, SceneEvent::Step { .. }) && !out.exists() {
                solved(&out, &mut |_| Flow::Continue).unwrap();
            }
            Flow::Continue
        });
        assert!(matches!(slower, Err(ProduceError::Hologram(HologramError::Busy { .. }))), "{slower:?}");
        assert!(Sequence::open(&out).unwrap().is_complete());
        let other = here.path().join("t.zarr");
        let taken = solved(&other, &mut |_| {
            std::fs::write(&other, "mine").unwrap();
            Flow::Continue
        });
        assert!(
            matches!(taken, Err(ProduceError::Hologram(HologramError::File(FileError::Taken { .. })))),
            "{taken:?}"
        );
    }
}
