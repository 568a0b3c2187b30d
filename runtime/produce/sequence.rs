//! Several scenes into a sequence of holograms, each from the one before.

use super::job::warn_of_aliasing;
use super::{ProduceError, SceneEvent, SceneJob};
use crate::engine::Engine;
use crate::hologram::{ColorHologram, Hologram, HologramError, Sequence, SequenceWriter, Start};
use crate::optics::{Color, Display, Padding};
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
    /// With as many modes of its source as were decided.
    display: Display,
}

/// Solves one scene after the other into a sequence; resumes one of the same job.
pub(super) fn solve(
    job: &SceneJob,
    out: &Path,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<SolvedSequence, ProduceError> {
    write(job, out, observe, &mut |common, index, load, before, observe| {
        common.hologram(index, load()?, before, engine, observe)
    })
}

/// One hologram of a sequence by itself, which another machine may solve: its holograms begin cold, and the others need nothing of
/// each other but the exposures of the `first`, hologram 0, which is solved without. [`join_pieces`] makes the sequence of them: the
/// bytes that [`solve_scene`](super::solve_scene) writes. None where `observe` asked to stop.
///
/// # Errors
/// [`ProduceError::Job`] for a sequence whose holograms begin where the one before ended, an index that it has not and a `first` that
/// is missing; those of [`solve_scene`](super::solve_scene).
pub fn solve_piece(
    job: &SceneJob,
    index: usize,
    first: Option<&Hologram>,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<Option<Hologram>, ProduceError> {
    check_pieces(job)?;
    if index >= job.scenes.len() || (index > 0 && first.is_none()) {
        let reason = format!("piece {index} of {}: pieces but 0 are solved after it, and with it", job.scenes.len());
        return Err(ProduceError::Job(reason));
    }
    let common = Common::new(job, &job.load(0)?)?;
    Ok(common.hologram(index, job.load(index)?, first.filter(|_| index > 0), engine, observe)?.map(|made| made.0))
}

/// Writes a sequence of [pieces](solve_piece), which `piece` gives by their index, in their order; goes on where it was cut off.
///
/// # Errors
/// Those of [`solve_scene`](super::solve_scene) and of `piece`.
pub fn join_pieces(
    job: &SceneJob,
    out: &Path,
    piece: &mut dyn FnMut(usize) -> Result<Hologram, ProduceError>,
) -> Result<SolvedSequence, ProduceError> {
    check_pieces(job)?;
    write(job, out, &mut |_| Flow::Continue, &mut |_, index, _, _, _| Ok(Some((piece(index)?, Vec::new()))))
}

fn check_pieces(job: &SceneJob) -> Result<(), ProduceError> {
    job.check_usual()?;
    if job.sequence.start != Start::Cold || job.scenes.is_empty() {
        let reason =
            "pieces are of a sequence of one scene or more whose holograms begin cold, none where another ended";
        return Err(ProduceError::Job(reason.into()));
    }
    Ok(())
}

/// What comes of a hologram: it, and its solutions.
type Made = Option<(Hologram, Vec<(Color, Solution)>)>;

/// Loads its scene, where that is needed: what is only joined needs none.
type Load<'a> = dyn FnMut() -> Result<LightField, ProduceError> + 'a;

/// Makes one hologram, of its index, its scene, the hologram before it, and who is told.
type Make<'a> = dyn FnMut(
        &Common,
        usize,
        &mut Load<'_>,
        Option<&Hologram>,
        &mut dyn FnMut(&SceneEvent) -> Flow,
    ) -> Result<Made, ProduceError>
    + 'a;

fn write(
    job: &SceneJob,
    out: &Path,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
    make: &mut Make,
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
        let mut load = || first.take().map_or_else(|| job.load(index), Ok);
        let Some((hologram, solutions)) = make(&common, index, &mut load, before.as_ref(), observe)? else {
            return Ok(SolvedSequence { done: index, count, solved: index - done });
        };
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
        let display = plan.lit(job.display);
        let mut settings = plan.settings;
        settings.seconds = job.settings.seconds.map(|s| s / job.colors.len() as f64);
        if settings.levels == Levels::Display {
            settings.levels = Levels::of(job.display);
        }
        Ok(Self { job, settings, padding: plan.padding, display })
    }

    /// What is true of every hologram; its exposures are found in the first.
    fn like(&self, first: &LightField) -> Result<Hologram, ProduceError> {
        let job = self.job;
        let color = |&color: &Color| {
            let wavelength = job.display.optics(color)?.wavelength;
            Ok(ColorHologram { color: Some(color), wavelength, exposure: 1.0, efficiency: 1.0, phases: Vec::new() })
        };
        let mut like = Hologram::from_solutions(first, &self.display, &self.settings, self.padding, &[])?;
        like.colors = job.colors.iter().map(color).collect::<Result<_, ProduceError>>()?;
        like.scene = job.scenes.join(", ");
        like.metadata.near = job.near;
        like.metadata.warm_start = Some(job.sequence.start);
        Ok(like)
    }

    /// One hologram; none where it was asked to stop.
    fn hologram(
        &self,
        index: usize,
        field: LightField,
        before: Option<&Hologram>,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&SceneEvent) -> Flow,
    ) -> Result<Made, ProduceError> {
        let Some(solutions) = self.frame(index, &field, before, engine, observe)? else { return Ok(None) };
        let mut hologram = Hologram::from_solutions(&field, &self.display, &self.settings, self.padding, &solutions)?;
        for (c, b) in hologram.colors.iter_mut().zip(before.iter().flat_map(|b| &b.colors)) {
            (c.exposure, c.efficiency) = (b.exposure, b.efficiency);
        }
        Ok(Some((hologram, solutions)))
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
            let problem = Problem::new(field, color, &self.display, self.padding)?;
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
    use crate::hologram::{Hologram, HologramError, Sequence, Start};
    use crate::optics::{Color, Display};
    use crate::produce::{ProduceError, SceneEvent, SceneJob, SolvedSequence, join_pieces, solve_piece, solve_scene};
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

    /// The bytes of one process, whatever order they are solved in, and of a join that was cut off.
    #[test]
    fn pieces_are_the_sequence() {
        let here = tempfile::tempdir().unwrap();
        let display = Display { height: 24, width: 24, ..Display::load("paper").unwrap() };
        let mut job = SceneJob::new("builtin:plane?depth=0", &display);
        job.scenes.extend(["builtin:plane?depth=1".into(), "builtin:plane?depth=2".into()]);
        job.colors.truncate(1);
        job.settings = Settings { frames: 1, steps: 2, seed: 3, ..Settings::default() };
        job.sequence.start = Start::Cold;
        let mut engine = engine::open(Choice::Cpu).unwrap();
        let whole = here.path().join("whole.zarr");
        solve_scene(&job, Some(&whole), engine.as_mut(), &mut |_| Flow::Continue).unwrap();
        let mut piece = |index, first: Option<&_>| {
            solve_piece(&job, index, first, engine.as_mut(), &mut |_| Flow::Continue).map(Option::unwrap)
        };
        let first = piece(0, None).unwrap();
        let last = piece(2, Some(&first)).unwrap();
        let pieces = [first.clone(), piece(1, Some(&first)).unwrap(), last];
        assert!(piece(1, None).unwrap_err().to_string().contains("piece 1 of 3"));
        let joined = here.path().join("joined.zarr");
        let lost = |_| ProduceError::Job("lost".into());
        let cut = join_pieces(&job, &joined, &mut |i| pieces.get(i).filter(|_| i < 2).cloned().ok_or(()).map_err(lost));
        assert!(cut.unwrap_err().to_string() == "lost");
        let done = join_pieces(&job, &joined, &mut |i| Ok(pieces[i].clone())).unwrap();
        assert_eq!((done.done, done.solved), (3, 1));
        for file in ["zarr.json", "phases/zarr.json", "phases/c/0/0/0/0/0", "phases/c/2/0/0/0/0"] {
            let [one, other] = [&whole, &joined].map(|folder| std::fs::read(folder.join(file)));
            assert_eq!(one.unwrap(), other.unwrap(), "{file}");
        }
        job.sequence.start = Start::Warm(0.0);
        assert!(join_pieces(&job, &joined, &mut |_| unreachable!()).is_err());
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

    #[test]
    fn pieces_are_joined_without_their_scenes() {
        let display = Display { height: 24, width: 32, ..Display::load("small").unwrap() };
        let settings = Settings { steps: 1, frames: 1, pupils: 1, ..Settings::default() };
        let mut job = SceneJob { colors: vec![Color::Green], settings, ..SceneJob::new("builtin:plane", &display) };
        job.scenes.push("builtin:plane?depth=0.5".into());
        job.sequence.start = Start::Cold;
        let mut engine = engine::open(Choice::Cpu).unwrap();
        let mut piece = |index: usize, first: Option<&Hologram>| {
            solve_piece(&job, index, first, engine.as_mut(), &mut |_| Flow::Continue).unwrap().unwrap()
        };
        let first = piece(0, None);
        let pieces = [first.clone(), piece(1, Some(&first))];
        // Only the first is looked at: it decides what is computed of all.
        let job = SceneJob { scenes: vec![job.scenes[0].clone(), "nowhere".into()], ..job.clone() };
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("joined.zarr");
        let joined = join_pieces(&job, &out, &mut |index| Ok(pieces[index].clone())).unwrap();
        assert_eq!(joined, SolvedSequence { done: 2, count: 2, solved: 2 });
        assert_eq!(Sequence::open(&out).unwrap().load(1).unwrap().colors[0].phases, pieces[1].colors[0].phases);
    }
}
