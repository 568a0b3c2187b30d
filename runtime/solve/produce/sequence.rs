//! Solves several scenes into a sequence of holograms, each from the one before.

use super::job::warn_of_aliasing;
use super::{ProduceError, SceneEvent, SceneJob};
use crate::engine::Engine;
use crate::hologram::{
    ColorHologram, Hologram, HologramError, SceneRecord, Sequence, SequenceParts, SequenceWriter, Start,
};
use crate::optics::{Color, Display, Padding};
use crate::reconstruction::SceneReading;
use crate::scene::LightField;
use crate::solve::{Flow, Levels, Problem, Progress, Settings, Solution, Warm, solve_from};
use eyebox_base::{Reason, reason};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

/// The progress of a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SolvedSequence {
    /// Number of its holograms.
    pub done: usize,
    /// Total number of holograms. Fewer exist if the observer stopped the solve.
    pub count: usize,
    /// Number of holograms that this call solved.
    pub solved: usize,
}

/// The values that the first scene decides for all holograms of a sequence.
struct Common {
    settings: Settings,
    padding: Padding,
    /// The display with the chosen number of modes of its source.
    display: Display,
    /// The properties of every hologram. The first solve adds the exposures.
    like: Hologram,
}

/// Solves one scene after the other into a sequence, or resumes a sequence of the same job.
pub(super) fn solve(
    job: &SceneJob,
    out: &Path,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<SolvedSequence, ProduceError> {
    let job = &job.with_maps()?;
    let count = job.scenes.len();
    let (planned, rate) = (Some(count as u64), job.sequence.rate);
    let first = job.load_on(0, engine)?;
    let common = Common::new(job, &first)?;
    let mut writer = match out.exists() {
        false => None,
        true => {
            let resumed = SequenceWriter::resume(out, &common.like, rate, planned)?;
            let about = Sequence::open(out)?.about().clone();
            (0..count).try_for_each(|index| check_scene(job, out, &about, index))?;
            match resumed {
                Some(writer) => Some(writer),
                None => return Ok(SolvedSequence { done: count, count, solved: 0 }),
            }
        }
    };
    let done = writer.as_ref().map_or(0, |w| w.count() as usize);
    observe(&SceneEvent::Sequence { done, count });
    let mut before = match done {
        0 => None,
        _ => Some(Sequence::open(out)?.load(done as u64 - 1)?),
    };
    let mut first = Some(first).filter(|_| done == 0);
    for index in done..count {
        let field = first.take().map_or_else(|| job.load_on(index, engine), Ok)?;
        let Some((hologram, solutions)) = common.hologram(job, index, field, before.as_ref(), engine, observe)? else {
            return Ok(SolvedSequence { done: index, count, solved: index - done });
        };
        let to = match &mut writer {
            Some(writer) => writer,
            None => writer.insert(common.begin(job, out, &hologram)?),
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

/// A sequence whose holograms several machines solve, each into its place in one file.
///
/// One process would write the same bytes. The holograms begin cold. They depend only on the exposures of hologram 0,
/// which is solved before the others.
pub struct SequencePieces {
    common: Common,
    out: PathBuf,
    /// The file, once it exists.
    parts: OnceLock<SequenceParts>,
    /// The loaded first scene, for hologram 0.
    first: Mutex<Option<LightField>>,
    /// The depth map of each scene.
    depth_maps: Vec<PathBuf>,
}

impl SequencePieces {
    /// Prepares a sequence at `out`, which may exist. It loads the first scene, which decides which parts of all scenes
    /// are computed. The scene stays in memory until the first piece. The `engine` draws its views if the scene is splats.
    ///
    /// # Errors
    /// [`ProduceError::Job`] for a sequence whose holograms begin at the end of the one before, and the errors of
    /// [`solve_scene`](super::solve_scene).
    pub fn new(job: &SceneJob, out: &Path, engine: &dyn Engine) -> Result<Self, ProduceError> {
        job.check_usual()?;
        job.check_one_by_one()?;
        if job.sequence.start != Start::Cold || job.scenes.is_empty() {
            let reason = "pieces need a sequence of one or more scenes whose holograms begin cold";
            return Err(ProduceError::Job(Reason::new("pieces-begin-cold", reason)));
        }
        let job = job.with_maps()?;
        let first = job.load_on(0, engine)?;
        let common = Common::new(&job, &first)?;
        let (parts, first, depth_maps) = (OnceLock::new(), Mutex::new(Some(first)), job.reading.depth_maps);
        Ok(Self { common, out: out.to_path_buf(), parts, first, depth_maps })
    }

    /// Solves hologram `index` of the `job` into its place, unless it exists, and returns true if it was solved now.
    /// The result is `None` if `observe` stopped it. The `job` must be the one that this was made for.
    ///
    /// # Errors
    /// [`ProduceError::Job`] for an index that does not exist, and for one above 0 while hologram 0 is missing.
    /// [`HologramError::OtherSequence`] if the path holds another sequence. Also the errors of
    /// [`solve_scene`](super::solve_scene).
    pub fn solve(
        &self,
        job: &SceneJob,
        index: usize,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&SceneEvent) -> Flow,
    ) -> Result<Option<bool>, ProduceError> {
        if index >= job.scenes.len() || (index > 0 && !self.out.exists()) {
            let reason = reason!("piece", "piece {index} of {}: out of range, or piece 0 is missing", job.scenes.len());
            return Err(ProduceError::Job(reason));
        }
        let reading = SceneReading { depth_maps: self.depth_maps.clone(), ..job.reading.clone() };
        let job = &SceneJob { reading, ..job.clone() };
        let first = self.first.lock().unwrap_or_else(PoisonError::into_inner).take().filter(|_| index == 0);
        let load = |engine: &dyn Engine| first.map_or_else(|| job.load_on(index, engine), Ok);
        if !self.out.exists() {
            let made = self.common.hologram(job, 0, load(engine)?, None, engine, observe)?;
            let Some((hologram, _)) = made else { return Ok(None) };
            self.common.begin(job, &self.out, &hologram)?.append(&hologram)?;
            return Ok(Some(true));
        }
        let parts = match self.parts.get() {
            Some(parts) => parts,
            None => {
                let parts =
                    SequenceParts::open_same(&self.out, &self.common.like, job.sequence.rate, job.scenes.len() as u64)?;
                self.parts.get_or_init(|| parts)
            }
        };
        if parts.has(index as u64) {
            return Ok(Some(false));
        }
        check_scene(job, &self.out, parts.about(), index)?;
        // The file already has its exposures if hologram 0 is missing, and hologram 0 uses them.
        let before = Some(parts.about()).filter(|_| index > 0);
        let made = self.common.hologram(job, index, load(engine)?, before, engine, observe)?;
        let Some((hologram, _)) = made else { return Ok(None) };
        parts.write(index as u64, &hologram)?;
        Ok(Some(true))
    }
}

/// Returns an error if a scene changed since the sequence was begun. `about` holds the properties of the sequence.
fn check_scene(job: &SceneJob, out: &Path, about: &Hologram, index: usize) -> Result<(), ProduceError> {
    let Some(known) = about.metadata.scenes.get(index) else { return Ok(()) };
    let now = job.record(index)?;
    if (&known.file, &known.depth_map) == (&now.file, &now.depth_map) {
        return Ok(());
    }
    let reason = reason!(
        "scene-changed",
        "its scene {index}, {}, changed since the sequence was begun. Choose another output name, or remove it",
        job.scenes[index]
    );
    Err(HologramError::OtherSequence { path: out.display().to_string(), reason }.into())
}

/// A hologram and its solutions, or `None` if it was stopped.
type Made = Option<(Hologram, Vec<(Color, Solution)>)>;

impl Common {
    /// Decides the values by the first frame.
    fn new(job: &SceneJob, first: &LightField) -> Result<Self, ProduceError> {
        // Each frame of a sequence has all views and all pixels, so only the solve's own settings of a quality apply.
        let whole =
            SceneJob { settings: Settings { repeats: 1, views: 1, pixel: 1, ..job.settings.clone() }, ..job.clone() };
        let plan = whole.plan(first)?;
        let display = plan.lit(job.display);
        let mut settings = plan.settings;
        settings.seconds = job.settings.seconds.map(|s| s / job.colors.len() as f64);
        if settings.levels == Levels::Display {
            settings.levels = Levels::of(job.display);
        }
        let padding = plan.padding;
        let color = |&color: &Color| {
            let wavelength = job.display.optics(color)?.wavelength;
            Ok(ColorHologram::bare(Some(color), wavelength, Vec::new()))
        };
        let mut like = Hologram::from_solutions(first, &display, &settings, padding, &[])?;
        like.colors = job.colors.iter().map(color).collect::<Result<_, ProduceError>>()?;
        like.scene = job.scenes.join(", ");
        job.describe_reading(&mut like.metadata);
        like.metadata.warm_start = Some(job.sequence.start);
        Ok(Self { settings, padding, display, like })
    }

    /// Begins the file with the values of the first hologram, which is appended next.
    fn begin(&self, job: &SceneJob, out: &Path, first: &Hologram) -> Result<SequenceWriter, ProduceError> {
        let mut like = Hologram { colors: first.colors.clone(), ..self.like.clone() };
        let records = (0..job.scenes.len()).map(|index| job.record(index)).collect::<Result<Vec<_>, _>>()?;
        if !records.iter().all(SceneRecord::is_only_named) {
            like.metadata.scenes = records;
        }
        // The path was free at the start, so another process that started at the same time was faster.
        let busy = || HologramError::Busy { path: out.display().to_string() };
        let begun = SequenceWriter::create(out, &like, job.sequence.rate, Some(job.scenes.len() as u64));
        Ok(begun.map_err(|e| if Sequence::is_at(out) { busy() } else { e })?)
    }

    /// Solves one hologram, or returns `None` if the observer stopped it.
    fn hologram(
        &self,
        job: &SceneJob,
        index: usize,
        field: LightField,
        before: Option<&Hologram>,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&SceneEvent) -> Flow,
    ) -> Result<Made, ProduceError> {
        let depth = field.depths(job.display, job.reading.depth)?;
        let mut solutions = Vec::with_capacity(job.colors.len());
        if index == 0 {
            warn_of_aliasing(&field, job.display, &Settings { depth, ..self.settings.clone() });
        }
        for (i, &color) in job.colors.iter().enumerate() {
            let problem = Problem::new(&field, color, &self.display, self.padding)?;
            let of_before = before.map(|b| &b.colors[i]);
            // All frames have the exposure of the first one, because lasers do not change between frames.
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
        let mut hologram = Hologram::from_solutions(&field, &self.display, &self.settings, self.padding, &solutions)?;
        for (c, b) in hologram.colors.iter_mut().zip(before.iter().flat_map(|b| &b.colors)) {
            (c.exposure, c.efficiency) = (b.exposure, b.efficiency);
        }
        Ok(Some((hologram, solutions)))
    }
}

#[cfg(test)]
pub mod tests {
    use crate::engine::{self, Choice};
    use crate::files::FileError;
    use crate::hologram::{HologramError, Sequence, SequenceParts, Start};
    use crate::optics::Display;
    use crate::produce::{
        ProduceError, SceneEvent, SceneJob, SceneSolution, SequencePieces, SolvedSequence, solve_scene,
    };
    use crate::solve::{Flow, Settings};
    use std::collections::BTreeMap;
    use std::path::{Path, PathBuf};

    fn solved(out: &Path, observe: &mut dyn FnMut(&SceneEvent) -> Flow) -> Result<(), ProduceError> {
        let display = Display { height: 24, width: 24, ..Display::load("paper").unwrap() };
        let mut job = SceneJob::new("builtin:plane?depth=0", &display);
        job.scenes.push("builtin:plane?depth=1".into());
        job.colors.truncate(1);
        job.settings = Settings { frames: 1, steps: 1, efficiency: Some(0.3), ..Settings::default() };
        solve_scene(&job, Some(out), engine::open(Choice::Cpu).unwrap().as_mut(), observe).map(drop)
    }

    /// Returns every file below a folder by its name.
    pub(in super::super) fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut found = BTreeMap::new();
        let mut left = vec![folder.to_path_buf()];
        while let Some(at) = left.pop() {
            for entry in std::fs::read_dir(&at).unwrap() {
                let path = entry.unwrap().path();
                match path.is_dir() {
                    true => left.push(path),
                    false => {
                        let name = path.strip_prefix(folder).unwrap().to_path_buf();
                        found.insert(name, std::fs::read(&path).unwrap());
                    }
                }
            }
        }
        found
    }

    /// Several processes that solve in any order, one of which dies on the way, write the bytes of one process.
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

        let out = here.path().join("pieces.zarr");
        let [one, other] = [0, 1].map(|_| SequencePieces::new(&job, &out, engine.as_ref()).unwrap());
        let mut solve = |who: &SequencePieces, job: &SceneJob, index| {
            who.solve(job, index, engine.as_mut(), &mut |_| Flow::Continue)
        };
        let early = solve(&one, &job, 1).unwrap_err();
        assert!(matches!(&early, ProduceError::Job(reason) if reason.code() == "piece"), "{early}");
        assert_eq!(solve(&one, &job, 0).unwrap(), Some(true));
        assert_eq!(solve(&other, &job, 2).unwrap(), Some(true));
        assert_eq!(solve(&one, &job, 2).unwrap(), Some(false), "it is there");
        assert!(solve(&one, &job, 3).is_err());
        // A reader sees the holograms up to the first missing one. The call that finishes the sequence returns its
        // number.
        assert_eq!(Sequence::open(&out).unwrap().count(), 1);
        let HologramError::Inconsistent(early) = SequenceParts::open(&out).unwrap().finish().unwrap_err() else {
            panic!("another error")
        };
        assert!(early.code() == "not-there-yet" && early.text().contains("1 of 3"), "{early}");
        // This file is left by a process that died while it wrote.
        std::fs::write(out.join(".eyebox-00112233aabbccdd.part"), "half").unwrap();
        let asked = one.solve(&job, 1, engine::open(Choice::Cpu).unwrap().as_mut(), &mut |_| Flow::Stop).unwrap();
        assert!(asked.is_none() && !SequenceParts::open(&out).unwrap().has(1));
        // A sequence of another job is neither used nor changed.
        let longer = SceneJob { settings: Settings { steps: 3, ..job.settings.clone() }, ..job.clone() };
        let of_longer = SequencePieces::new(&longer, &out, engine::open(Choice::Cpu).unwrap().as_ref()).unwrap();
        let refused = solve(&of_longer, &longer, 1);
        assert!(matches!(refused, Err(ProduceError::Hologram(HologramError::OtherSequence { .. }))), "{refused:?}");
        assert_eq!(solve(&other, &job, 1).unwrap(), Some(true));
        SequenceParts::open(&out).unwrap().finish().unwrap();
        assert_eq!(contents(&out), contents(&whole));
        // The command has no work left.
        let more = solve_scene(&job, Some(&out), engine::open(Choice::Cpu).unwrap().as_mut(), &mut |_| Flow::Continue);
        assert!(matches!(more, Ok(SceneSolution::Sequence(SolvedSequence { done: 3, solved: 0, .. }))));
        job.sequence.start = Start::Warm(0.0);
        assert!(SequencePieces::new(&job, &out, engine.as_ref()).is_err());
    }

    /// One process writes the whole sequence before another one finishes its first hologram.
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
