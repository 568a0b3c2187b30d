//! Compares methods on the same scenes, with the same steps and through the same groups of pupils.
//!
//! [`Comparison::run`] measures the candidates of a [`Comparison`] scene by scene. It saves each result immediately, so
//! a stopped run resumes at the same place. The measurements are plain data ([`Results`]).

mod candidate;
mod coherence;
mod etendue;
mod joint;
mod judged;
mod light;
mod light_figures;
mod made_by;
mod measure;
mod picture;
mod pupils;
mod results;
mod shown;
mod sources;
mod speckle;
#[cfg(test)]
mod stop_tests;

pub use candidate::{Candidate, ExistingHologram, Source, candidates};
pub use etendue::MaskKind;
pub(crate) use measure::{DECADES, ERROR_GAIN};
pub(crate) use picture::{light_exact, map};
pub use pupils::{PicturedPupil, SHOWN};
pub use results::{
    About, CoherenceFigures, ColorError, ColorFigures, EtendueFigures, JointFigures, MethodAbout, Published, Results,
    Row, Run, SceneFigures, Series, SourcesFigures, SpeckleFigures, mean,
};
pub use shown::{EnergyMap, Picture, Pictures};

use crate::kept::{ResultCache, append, checksum, identity};
use crate::stoppable::Stoppable;
use crate::watch::{JobObserver, Observe, unless_stopped};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::evaluate::Group;
use eyebox::low_level::files::CreatedDirGuard;
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::{Color, Display, Padding, Pupil};
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{self, Flow, Method, Problem, Settings, Solution};
use joint::{Colors, Lighting};
use made_by::slug;
use measure::Wanted;
use pupils::Pupils;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// The version of the results. It changes when a measure changes its meaning.
const FORMAT: u32 = 4;
/// The approximate duration of the parts, relative to a solve.
const PHOTOGRAPHS: f64 = 3.0;
const SOLVE: f64 = 1.0;
const LOOK: f64 = 3.0;
const SPECKLE: f64 = 7.0;

/// The subjects and the measurements of a comparison.
pub struct Comparison {
    /// The names of the scenes.
    pub scenes: Vec<String>,
    /// The methods and the existing holograms.
    pub candidates: Vec<Candidate>,
    /// The numbers of sub-frames with which methods solve.
    pub frames: Vec<usize>,
    /// The display for all holograms.
    pub display: Display,
    /// The compared colors of the display.
    pub colors: Vec<Color>,
    /// The settings that all methods share. Each scene has its own depths.
    pub settings: Settings,
    /// True if the speckle of an even plane is measured.
    pub speckle: bool,
    /// The brightness factors of simultaneous color over one color after another. Each factor is compared with one
    /// color after another. Empty if simultaneous color is not compared.
    pub joint: Vec<f64>,
    /// The sizes of the compared sources, in millimeters of their image in the eyebox, with 0 for a point. May be
    /// empty.
    pub coherence: Vec<f64>,
    /// The compared masks in front of the SLM. May be empty.
    pub masks: Vec<MaskKind>,
    /// True if the images across the eyebox of the display's switchable sources are measured.
    pub sources: bool,
    /// The number of pupils per group that are judged in JOD, spread evenly over the group. A judgment takes about as
    /// long as the images through some pupils.
    pub judged: usize,
}

/// The default number of pupils per group that are judged in JOD.
pub const JUDGED: usize = 4;

impl Comparison {
    /// Runs the comparison until it is complete or stopped. `load` returns a scene by its number, with its farthest and
    /// nearest depth in meters. `folder` holds results and holograms. A result there with the same inputs is not
    /// computed again.
    ///
    /// # Errors
    /// Returns the errors of `load`, and [`QualityError`] if a part fails.
    pub fn run<E: From<QualityError>>(
        &self,
        folder: &Path,
        load: &mut dyn FnMut(usize) -> Result<(LightField, [f64; 2]), E>,
        engine: &mut dyn Engine,
        observe: &mut Observe,
    ) -> Result<Results, E> {
        let mut results = self.nothing_yet(engine);
        let watch = JobObserver::new(observe);
        let stops = || watch.stops();
        let engine = &mut Stoppable { engine, stops: &stops };
        let mut work = Work::new(self, folder, &watch)?;
        let mut views = None;
        for (index, label) in self.scenes.iter().enumerate() {
            let before = results.runs.len();
            if work.say(&format!("{label}: loading")) {
                let (field, depth) = load(index)?;
                views = views.or(Some(field.grid));
                let scene = OfScene::new(self, index, &field, depth);
                if !self.candidates.is_empty() {
                    scene.run(&mut work, engine, &mut results)?;
                }
                // Each part saves its own results. After a stop, the parts that follow count theirs as missing.
                scene.colors_at_once(&mut work, engine, &mut results)?;
                scene.across_sources(&mut work, engine, &mut results)?;
                scene.sources(&mut work, engine, &mut results)?;
                scene.behind_masks(&mut work, engine, &mut results)?;
            }
            results.missing += self.runs(index).count() - (results.runs.len() - before);
        }
        let methods: Vec<Method> = self.speckled().collect();
        for method in &methods {
            let Some(views) = views.filter(|_| work.say(&format!("speckle of {}", method.name()))) else { break };
            let Some(figures) = self.speckle_of(*method, views, &mut work, engine)? else { break };
            results.speckle.push(figures);
        }
        results.missing += methods.len() - results.speckle.len();
        Ok(results)
    }

    fn nothing_yet(&self, engine: &dyn Engine) -> Results {
        let (display, settings) = (&self.display, &self.settings);
        Results {
            about: About {
                version: env!("CARGO_PKG_VERSION").into(),
                display: display.name.clone(),
                size: [display.height, display.width],
                pitch_um: display.pitch * 1e6,
                eyebox_mm: display.eyebox_min() * 1e3,
                reach: display.reach().to_string(),
                colors: self.colors.clone(),
                frames: self.frames.clone(),
                steps: settings.steps,
                pupils: settings.pupils,
                seed: settings.seed,
                engine: engine.describe(),
                viewing: (self.judged > 0).then(|| self.viewing()),
            },
            methods: self.candidates.iter().map(Candidate::about).collect(),
            scenes: Vec::new(),
            runs: Vec::new(),
            speckle: Vec::new(),
            joint: Vec::new(),
            coherence: Vec::new(),
            etendue: Vec::new(),
            sources: Vec::new(),
            published: Vec::new(),
            missing: 0,
        }
    }

    /// Returns the viewing conditions as luminance of white and of black in cd/m2 and pixels per degree.
    fn viewing(&self) -> [f64; 3] {
        let viewing = self.display.viewing;
        [viewing.luminance_cd_m2, viewing.black_cd_m2, self.display.pixels_per_degree()]
    }

    /// Lists all holograms of a scene by candidate and number of sub-frames.
    fn runs(&self, scene: usize) -> impl Iterator<Item = (&Candidate, usize)> {
        self.candidates.iter().flat_map(move |c| c.frames(scene, &self.frames).into_iter().map(move |f| (c, f)))
    }

    /// Lists the methods whose frames differ from seed to seed.
    fn speckled(&self) -> impl Iterator<Item = Method> {
        let solved = self.candidates.iter().filter_map(|c| match c.source {
            Source::Solved(method) => Some(method),
            Source::Given(_) => None,
        });
        solved.filter(|m| self.speckle && speckle::has_speckle(*m))
    }

    /// Lists the compared ways of lighting sub-frames.
    fn ways(&self) -> Vec<Lighting> {
        let joint = self.joint.iter().map(|times| Lighting::Joint(*times));
        let all = [Lighting::Sequence].into_iter().chain(joint).chain([Lighting::Undimmed]);
        if self.joint.is_empty() { Vec::new() } else { all.collect() }
    }

    /// Lists the numbers of sub-frames for simultaneous color. Each color has at least one.
    fn joint_frames(&self) -> impl Iterator<Item = usize> {
        self.frames.iter().copied().filter(|frames| !self.joint.is_empty() && *frames >= self.colors.len())
    }

    /// Returns the longest side of the stored pictures, in pixels.
    fn longest(&self) -> usize {
        picture::longest(self.scenes.len() * self.candidates.len())
    }

    fn speckle_of(
        &self,
        method: Method,
        views: [usize; 2],
        work: &mut Work,
        engine: &mut dyn Engine,
    ) -> Result<Option<SpeckleFigures>, QualityError> {
        let display = &self.display;
        // Built-in scenes have such depths on so small a display. The plane itself is at 0.
        let span = 0.5e-3;
        let settings = Settings { method, depth: [-span, span], ..self.settings.clone() };
        let made_by = json!({
            "version": env!("CARGO_PKG_VERSION"), "format": FORMAT, "views": views, "settings": settings,
            "display": identity(display),
        });
        let (name, made_by) = (format!("speckle-{}", method.name()), made_by.to_string());
        if let Some(kept) = work.results.load(&name, &made_by) {
            work.pass(SPECKLE);
            return Ok(Some(kept));
        }
        let what = format!("speckle of {}", method.name());
        let mut went = || {
            work.pass(SPECKLE / speckle::SOLVES as f64);
            work.say(&what)
        };
        let found = speckle::speckle(method, &settings, display, views, engine, &mut went);
        let found = unless_stopped(found)?.flatten();
        if let Some(found) = &found {
            work.results.save(&name, &made_by, found)?;
        }
        Ok(found)
    }
}

/// A comparison in progress.
struct Work<'a, 'b> {
    // This guard drops first, so that the folder of both is empty when the guard of `results` drops.
    _made: CreatedDirGuard,
    results: ResultCache,
    holograms: PathBuf,
    watch: &'a JobObserver<'b>,
    done: f64,
    all: f64,
}

impl<'a, 'b> Work<'a, 'b> {
    fn new(job: &Comparison, folder: &Path, watch: &'a JobObserver<'b>) -> Result<Self, QualityError> {
        let results = ResultCache::new(folder.join("results"))?;
        let holograms = folder.join("holograms");
        let _made = CreatedDirGuard::new(&holograms)?;
        let runs: usize = (0..job.scenes.len()).map(|i| job.runs(i).count()).sum();
        let all = PHOTOGRAPHS * job.scenes.len() as f64
            + (SOLVE + LOOK) * runs as f64
            + (SOLVE + LOOK) * (job.ways().len() * job.joint_frames().count() * job.scenes.len()) as f64
            + coherence::EFFORT * (job.coherence.len() * job.frames.len() * job.scenes.len()) as f64
            + (SOLVE + LOOK) * (job.source_solves() * job.scenes.len()) as f64
            + etendue::EFFORT * (job.masks.len() * job.frames.len() * job.scenes.len()) as f64
            + SPECKLE * job.speckled().count() as f64;
        Ok(Self { results, holograms, _made, watch, done: 0.0, all: all.max(1.0) })
    }

    /// Returns the cached result with this name and these inputs. Otherwise it saves and returns the result of
    /// `measure`. Returns `None` after a stop and then increments `missing`.
    fn kept_or<T: Serialize + DeserializeOwned>(
        &mut self,
        name: &str,
        made_by: &Value,
        missing: &mut usize,
        measure: impl FnOnce(&mut Self) -> Result<Option<T>, QualityError>,
    ) -> Result<Option<T>, QualityError> {
        let made_by = made_by.to_string();
        if let Some(kept) = self.results.load(name, &made_by) {
            return Ok(Some(kept));
        }
        let found = unless_stopped(measure(self))?.flatten();
        match &found {
            Some(found) => self.results.save(name, &made_by, found)?,
            None => *missing += 1,
        }
        Ok(found)
    }

    /// Adds completed effort, in units of a solve.
    fn pass(&mut self, effort: f64) {
        self.done += effort;
    }

    /// Reports the current part. Returns false once the job is stopped.
    fn say(&mut self, what: &str) -> bool {
        self.within(what, 0.0)
    }

    /// Reports the current part with this effort of it completed.
    fn within(&mut self, what: &str, effort: f64) -> bool {
        self.watch.say(what, ((self.done + effort) / self.all).min(1.0))
    }
}

/// One hologram to measure.
struct Task<'a> {
    candidate: &'a Candidate,
    frames: usize,
    name: String,
    made_by: String,
}

/// The work on one scene.
struct OfScene<'a> {
    job: &'a Comparison,
    index: usize,
    field: &'a LightField,
    depth: [f64; 2],
    pupils: Pupils,
    name: String,
    made_by: String,
    tasks: Vec<Task<'a>>,
}

impl<'a> OfScene<'a> {
    fn new(job: &'a Comparison, index: usize, field: &'a LightField, depth: [f64; 2]) -> Self {
        let display = &job.display;
        let shared = json!({
            "version": env!("CARGO_PKG_VERSION"), "format": FORMAT,
            "scene": [json!(checksum(field)), json!(field.grid), json!(field.cell(display)), json!(depth)],
            "display": identity(display), "colors": job.colors, "diameter": job.settings.diameter,
        });
        // Scenes with the same name are numbered.
        let slugs: Vec<String> = job.scenes.iter().map(|l| slug(l)).collect();
        let same = slugs[..index].iter().filter(|s| **s == slugs[index]).count();
        let scene = if same == 0 { slugs[index].clone() } else { format!("{}-{}", slugs[index], same + 1) };
        let task = |(candidate, frames): (&'a Candidate, usize)| {
            let (kind, source) = match &candidate.source {
                Source::Solved(method) => {
                    let settings = Settings { method: *method, frames, depth, ..job.settings.clone() };
                    ("", json!({ "settings": settings }))
                }
                Source::Given(_) => {
                    let given = candidate.given(index, frames);
                    let phases = given.map(|h| h.colors.iter().map(|c| append(0, &c.phases)));
                    let phases = phases.into_iter().flatten().collect::<Vec<_>>();
                    // Another model, mask or padding gives other images of the same phases.
                    ("given-", json!({ "phases": phases, "metadata": given.map(|h| h.metadata.without_places()) }))
                }
            };
            let name = format!("{scene}-{kind}{}-{frames}", slug(&candidate.name));
            let made_by = json!({ "shared": shared, "source": source }).to_string();
            Task { candidate, frames, name, made_by }
        };
        let tasks = job.runs(index).map(task).collect();
        let pupils = Pupils::new(display.eyebox_min(), job.settings.diameter, depth, job.judged);
        let (name, made_by) = (format!("{scene}-scene"), shared.to_string());
        Self { job, index, field, depth, pupils, name, made_by, tasks }
    }

    fn label(&self) -> &str {
        &self.job.scenes[self.index]
    }

    /// Returns the inputs of a result, which are the inputs of the hologram, the size of the pictures and the viewing
    /// conditions.
    fn shown(&self, made_by: &str) -> String {
        let (judged, viewing) = (self.job.judged, self.job.viewing());
        let judged = if judged > 0 { format!(", {judged} judged at {viewing:?}") } else { String::new() };
        format!("{made_by}, pictures of {}{judged}", self.job.longest())
    }

    /// Measures all holograms of the scene without a cached result.
    fn run(&self, work: &mut Work, engine: &mut dyn Engine, results: &mut Results) -> Result<(), QualityError> {
        let display = &self.job.display;
        let mut done: Vec<Option<Run>> =
            self.tasks.iter().map(|t| work.results.load(&t.name, &self.shown(&t.made_by))).collect();
        let mut figures: Option<SceneFigures> = work.results.load(&self.name, &self.shown(&self.made_by));
        let mut wanted: Option<Wanted> = None;
        if done.iter().any(Option::is_none) || figures.is_none() {
            work.say(&format!("{}: rendering target images", self.label()));
            let longest = self.job.longest();
            let taken = measure::wanted(self.field, display, &self.pupils, self.depth, longest, engine, work.watch);
            // Without the target images, the cached results are still reported.
            wanted = unless_stopped(taken)?;
            if let Some(taken) = &wanted {
                let made = measure::scene_figures(self.label(), self.field, self.depth, display, taken);
                work.results.save(&self.name, &self.shown(&self.made_by), &made)?;
                figures = Some(made);
            }
        }
        work.pass(PHOTOGRAPHS);
        for (task, done) in self.tasks.iter().zip(&mut done).filter(|(_, done)| done.is_none()) {
            let Some(wanted) = wanted.as_ref().filter(|_| work.say(self.label())) else { break };
            let solved = unless_stopped(self.hologram(task, work, engine))?.flatten();
            let Some((hologram, seconds)) = solved else { break };
            work.pass(SOLVE);
            work.say(&format!("{}: measuring {}", self.label(), task.candidate.name));
            let run = measure::measure(&hologram, display, &self.pupils, wanted, engine, work.watch);
            let Some(mut run) = unless_stopped(run)? else { break };
            work.pass(LOOK);
            (run.scene, run.method, run.seconds) = (self.label().into(), task.candidate.name.clone(), seconds);
            work.results.save(&task.name, &self.shown(&task.made_by), &run)?;
            *done = Some(run);
        }
        results.scenes.extend(figures);
        results.runs.extend(done.into_iter().flatten());
        Ok(())
    }

    /// Compares simultaneous color with one color after another, for each number of sub-frames without a cached result.
    fn colors_at_once(
        &self,
        work: &mut Work,
        engine: &mut dyn Engine,
        results: &mut Results,
    ) -> Result<(), QualityError> {
        let (job, ways) = (self.job, self.job.ways());
        let pupils: Vec<Pupil> =
            self.pupils.members.iter().filter(|m| m.group == Group::Random).map(|m| m.pupil).collect();
        for frames in job.joint_frames() {
            let settings = Settings { frames, depth: self.depth, ..job.settings.clone() };
            let made_by = json!({
                "shown": self.shown(&self.made_by), "settings": settings, "joint": job.joint,
                "slopes": job.display.slopes(&job.colors),
            });
            let (name, label) = (format!("{}-joint-{frames}", self.name), self.label());
            let colors = Colors {
                field: self.field,
                display: &job.display,
                colors: &job.colors,
                settings: &settings,
                pupils: &pupils,
                longest: job.longest(),
            };
            let found: Option<Vec<JointFigures>> = work.kept_or(&name, &made_by, &mut results.missing, |work| {
                let mut went = |way: &str| work.say(&format!("{label}: {frames} sub-frames, {way}"));
                colors.compare(frames, &ways, engine, &mut went)
            })?;
            let Some(found) = found else { break };
            work.pass((SOLVE + LOOK) * ways.len() as f64);
            let named = |figures| JointFigures { scene: self.label().into(), ..figures };
            results.joint.extend(found.into_iter().map(named));
        }
        Ok(())
    }

    /// Returns the hologram of a task and the seconds of its solve. The hologram exists already, is cached, or is
    /// solved and saved. Returns `None` after a stop.
    fn hologram(
        &self,
        task: &Task,
        work: &mut Work,
        engine: &mut dyn Engine,
    ) -> Result<Option<(Hologram, Option<f64>)>, QualityError> {
        let Source::Solved(method) = task.candidate.source else {
            return Ok(task.candidate.given(self.index, task.frames).map(|h| (h.clone(), None)));
        };
        let file = work.holograms.join(format!("{}.zarr", task.name));
        if let Ok(kept) = Hologram::load(&file)
            && kept.metadata.made_by.as_ref() == Some(&task.made_by)
        {
            let seconds = kept.metadata.seconds;
            return Ok(Some((kept, seconds)));
        }
        let (job, label) = (self.job, self.label());
        let settings = Settings { method, frames: task.frames, depth: self.depth, ..job.settings.clone() };
        // `produce::solve_colors` finishes every color after a stop. A comparison drops the hologram instead.
        let mut solved: Vec<(Color, Solution)> = Vec::new();
        for (i, &color) in job.colors.iter().enumerate() {
            let what = format!("{label}: solving {}, {color}", task.candidate.name);
            let problem = Problem::new(self.field, color, &job.display, Padding::default())?;
            let solution = solve::solve(&problem, &settings, engine, &mut |p| {
                let part = (i as f64 + p.step as f64 / p.steps.max(1) as f64) / job.colors.len() as f64;
                if work.within(&what, SOLVE * part) { Flow::Continue } else { Flow::Stop }
            })?;
            if work.watch.is_stopped() {
                return Ok(None);
            }
            solved.push((color, solution));
        }
        let seconds: f64 = solved.iter().map(|(_, s)| s.seconds).sum();
        let mut hologram = Hologram::from_solutions(self.field, &job.display, &settings, Padding::default(), &solved)?;
        (hologram.metadata.made_by, hologram.metadata.seconds) = (Some(task.made_by.clone()), Some(seconds));
        hologram.save(&file)?;
        Ok(Some((hologram, Some(seconds))))
    }
}
