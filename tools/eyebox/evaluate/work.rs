//! The work itself: scene by scene, method by method, each result kept as soon as it is there.

use super::figures::{Run, SceneFigures, SpeckleFigures};
use super::keep::{self, Keep};
use super::measure::{self, Wanted};
use super::picture;
use super::pupils::Pupils;
use super::speckle;
use super::subject::{self, Source, Subject};
use crate::Failure;
use crate::args::SceneArgs;
use crate::common;
use crate::progress::{self, JobBar};
use crate::report::{About, MethodAbout, Report};
use eyebox::engine::Engine;
use eyebox::hologram::Hologram;
use eyebox::optics::{Color, Display, Padding};
use eyebox::scene::{self, LightField};
use eyebox::solve::{Flow, Method, Problem, Settings};
use serde_json::json;
use std::path::Path;

/// Everything that is to be done.
pub struct Job {
    /// The scenes.
    pub scenes: Vec<SceneArgs>,
    /// What people call them.
    pub labels: Vec<String>,
    /// What is compared.
    pub subjects: Vec<Subject>,
    /// Sub-frames.
    pub frames: Vec<usize>,
    /// The display.
    pub display: Display,
    /// Its colours.
    pub colors: Vec<Color>,
    /// What all methods have in common; depths are each scene's own.
    pub settings: Settings,
    /// Whether the speckle of an even plane is measured.
    pub speckle: bool,
}

/// One hologram to measure.
struct Task<'a> {
    subject: &'a Subject,
    frames: usize,
    name: String,
    made_by: String,
}

impl Job {
    /// One scene, some methods, everything else as it is by default, without speckle.
    pub fn of_methods(scene: &str, methods: &[Method], display: Display, colors: Vec<Color>) -> Self {
        let diameter = common::diameters(None, &display);
        Self {
            scenes: vec![SceneArgs {
                scene: scene.into(),
                depth_map: None,
                view_pitch: None,
                views: None,
                depth: None,
            }],
            labels: vec![scene.trim_start_matches("builtin:").into()],
            subjects: subject::subjects(methods, Vec::new()),
            frames: vec![8],
            display,
            colors,
            settings: Settings { diameter, ..Settings::default() },
            speckle: false,
        }
    }

    /// Refuses scenes that are not there, by their names and headers.
    pub fn check_scenes(&self) -> Result<(), Failure> {
        for scene in &self.scenes {
            scene::native_size(&scene.scene)?;
        }
        Ok(())
    }

    /// Longest side of the pictures of its report, pixels.
    fn longest(&self) -> usize {
        picture::longest(self.scenes.len() * self.subjects.len())
    }

    /// Relative effort, about a hundredth of a second on two cores for a picture of 256 x 256.
    fn effort(&self) -> Effort {
        let pixels = (self.display.height * self.display.width) as f64 / 65536.0;
        let colors = self.colors.len() as f64;
        let steps = self.settings.steps as f64 * self.settings.pupils as f64 / 960.0;
        Effort {
            scene: 300.0 * pixels * colors,
            solve: 90.0 * pixels * colors * steps,
            measure: 320.0 * pixels * colors,
            speckle: 9.0 * steps,
        }
    }
}

/// See [`Job::effort`].
#[derive(Clone, Copy)]
struct Effort {
    scene: f64,
    /// Of 8 sub-frames.
    solve: f64,
    measure: f64,
    /// Of one solve.
    speckle: f64,
}

impl Effort {
    fn of(&self, source: &Source, frames: usize) -> f64 {
        let share = frames as f64 / 8.0;
        let solve = match source {
            Source::Solved(m) if m.is_iterative() => self.solve * (0.3 + 0.7 * share),
            _ => 0.1 * self.solve,
        };
        solve + self.measure * (0.3 + 0.7 * share)
    }
}

/// Does all of it, or as much as there is time for until ctrl-C.
pub fn evaluate(job: &Job, out: &Path, engine: &mut dyn Engine, quiet: bool) -> Result<Report, Failure> {
    let results = Keep::new(out.join("results"))?;
    let holograms = out.join("holograms");
    std::fs::create_dir_all(&holograms).map_err(|e| eyebox::files::FileError::write(&holograms, e))?;
    let effort = job.effort();
    let per_scene = |scene: usize| {
        let solved = job.subjects.iter().flat_map(|s| runs(s, scene, &job.frames).map(|f| effort.of(&s.source, f)));
        effort.scene + solved.sum::<f64>()
    };
    let grainy: Vec<Method> = job
        .subjects
        .iter()
        .filter_map(|s| match s.source {
            Source::Solved(m) if job.speckle && speckle::has_speckle(m) => Some(m),
            _ => None,
        })
        .collect();
    let speckled = grainy.len() as f64 * speckle::SOLVES as f64 * effort.speckle;
    let speckled_methods = grainy.len();
    let bar = JobBar::new((0..job.scenes.len()).map(per_scene).sum::<f64>() + speckled, quiet);

    let mut report = Report::new(About::new(job, engine), methods_about(&job.subjects));
    let mut views = None;
    for (index, args) in job.scenes.iter().enumerate() {
        let asked = job.subjects.iter().map(|s| runs(s, index, &job.frames).count()).sum::<usize>();
        let before = report.runs.len();
        if !progress::interrupted() {
            bar.say(&format!("{}: loading", job.labels[index]));
            let field = common::scene(args, &job.display, &job.colors)?;
            views = views.or(Some(field.grid));
            let mut of_scene = OfScene::new(job, index, &field, &results, &holograms, &bar);
            of_scene.run(engine, &mut report)?;
        }
        report.missing += asked - (report.runs.len() - before);
    }
    for method in grainy {
        let Some(views) = views.filter(|_| !progress::interrupted()) else { break };
        match speckle_of(job, method, views, &results, engine, &bar, effort.speckle)? {
            Some(figures) => report.speckle.push(figures),
            None => break,
        }
    }
    report.missing += speckled_methods - report.speckle.len();
    bar.finish();
    Ok(report)
}

/// Numbers of sub-frames that a subject has for a scene.
fn runs<'a>(subject: &'a Subject, scene: usize, frames: &'a [usize]) -> Box<dyn Iterator<Item = usize> + 'a> {
    match &subject.source {
        Source::Solved(_) => Box::new(frames.iter().copied()),
        Source::Given(all) => Box::new(all.iter().filter(move |g| g.scene == scene).map(|g| g.hologram.frames)),
    }
}

/// One scene's part of the work.
struct OfScene<'a> {
    job: &'a Job,
    label: &'a str,
    field: &'a LightField,
    depth: [f64; 2],
    pupils: Pupils,
    tasks: Vec<Task<'a>>,
    made_by: String,
    index: usize,
    results: &'a Keep,
    holograms: &'a Path,
    bar: &'a JobBar,
}

impl<'a> OfScene<'a> {
    fn new(
        job: &'a Job,
        index: usize,
        field: &'a LightField,
        results: &'a Keep,
        holograms: &'a Path,
        bar: &'a JobBar,
    ) -> Self {
        let depth = common::depths(&job.scenes[index], field, &job.display);
        let pupils = Pupils::new(job.display.eyebox_min(), job.settings.diameter, depth);
        let display = &job.display;
        let shared = json!({
            "version": env!("CARGO_PKG_VERSION"), "format": keep::FORMAT,
            "scene": [json!(checksum(field)), json!(field.grid), json!(field.cell(display)), json!(depth)],
            "display": [
                json!([display.height, display.width]), json!([display.pitch, display.focal_length]),
                json!(display.wavelengths.iter().map(|w| w.wavelength).collect::<Vec<_>>()),
            ],
            "colors": job.colors, "diameter": job.settings.diameter,
        });
        let mut of = Self {
            job,
            label: &job.labels[index],
            field,
            depth,
            pupils,
            tasks: Vec::new(),
            made_by: shared.to_string(),
            index,
            results,
            holograms,
            bar,
        };
        for subject in &job.subjects {
            for frames in runs(subject, index, &job.frames) {
                let source = match &subject.source {
                    Source::Solved(method) => json!({ "settings": of.settings(*method, frames) }),
                    Source::Given(all) => {
                        let phases = all.iter().filter(|g| g.scene == index && g.hologram.frames == frames);
                        json!({ "phases": phases.flat_map(|g| &g.hologram.colors).map(|c| crc(&c.phases)).collect::<Vec<_>>() })
                    }
                };
                let made_by = json!({ "shared": shared, "source": source }).to_string();
                let kind = if matches!(subject.source, Source::Given(_)) { "given-" } else { "" };
                let name = format!("{}-{kind}{}-{frames}", of.slug(), keep::slug(&subject.name));
                of.tasks.push(Task { subject, frames, name, made_by });
            }
        }
        of
    }

    fn slug(&self) -> String {
        let slugs: Vec<String> = self.job.labels.iter().map(|l| keep::slug(l)).collect();
        let mine = &slugs[self.index];
        let same = slugs[..self.index].iter().filter(|s| *s == mine).count();
        if same == 0 { mine.clone() } else { format!("{mine}-{}", same + 1) }
    }

    fn settings(&self, method: Method, frames: usize) -> Settings {
        Settings { method, frames, depth: self.depth, ..self.job.settings.clone() }
    }

    /// What decides a result: what decides the hologram, and the size of the pictures.
    fn shown(&self, made_by: &str) -> String {
        format!("{made_by}, pictures of {}", self.job.longest())
    }

    /// Everything that is not there yet.
    fn run(&mut self, engine: &mut dyn Engine, report: &mut Report) -> Result<(), Failure> {
        let effort = self.job.effort();
        let mut done: Vec<Option<Run>> =
            self.tasks.iter().map(|t| self.results.load(&t.name, &self.shown(&t.made_by))).collect();
        let scene_name = format!("{}-scene", self.slug());
        let mut figures: Option<SceneFigures> = self.results.load(&scene_name, &self.shown(&self.made_by));
        let mut wanted: Option<Wanted> = None;
        if done.iter().any(Option::is_none) || figures.is_none() {
            self.bar.say(&format!("{}: photographs", self.label));
            let taken =
                measure::wanted(self.field, &self.job.display, &self.pupils, self.depth, self.job.longest(), engine)?;
            let made = measure::scene_figures(self.label, self.field, self.depth, &taken);
            self.results.save(&scene_name, &self.shown(&self.made_by), &made)?;
            figures = Some(made);
            wanted = Some(taken);
        }
        self.bar.pass(effort.scene);
        for (task, done) in self.tasks.iter().zip(&mut done) {
            let all = effort.of(&task.subject.source, task.frames);
            if done.is_some() {
                self.bar.pass(all);
                continue;
            }
            let Some(wanted) = wanted.as_ref().filter(|_| !progress::interrupted()) else { break };
            let Some((hologram, seconds)) = self.hologram(task, effort, engine)? else { break };
            self.bar.say(&format!("{}: looking at {}", self.label, task.subject.name));
            let mut run = measure::measure(&hologram, &self.job.display, &self.pupils, wanted, engine)?;
            self.bar.pass(effort.measure * (0.3 + 0.7 * task.frames as f64 / 8.0));
            (run.scene, run.method, run.seconds) = (self.label.into(), task.subject.name.clone(), seconds);
            self.results.save(&task.name, &self.shown(&task.made_by), &run)?;
            *done = Some(run);
        }
        report.scenes.extend(figures);
        report.runs.extend(done.into_iter().flatten());
        Ok(())
    }

    /// The hologram of a task: given, kept, or solved and kept; none if it was interrupted. And the seconds it took.
    fn hologram(
        &self,
        task: &Task,
        effort: Effort,
        engine: &mut dyn Engine,
    ) -> Result<Option<(Hologram, Option<f64>)>, Failure> {
        let rest =
            effort.of(&task.subject.source, task.frames) - effort.measure * (0.3 + 0.7 * task.frames as f64 / 8.0);
        let method = match &task.subject.source {
            Source::Given(all) => {
                self.bar.pass(rest);
                let mut mine = all.iter().filter(|g| g.scene == self.index && g.hologram.frames == task.frames);
                return Ok(mine.next().map(|g| (g.hologram.clone(), None)));
            }
            Source::Solved(method) => *method,
        };
        let file = self.holograms.join(format!("{}.zarr", task.name));
        if let Ok(kept) = Hologram::load(&file)
            && kept.metadata.made_by.as_ref() == Some(&task.made_by)
        {
            self.bar.pass(rest);
            let seconds = kept.metadata.seconds;
            return Ok(Some((kept, seconds)));
        }
        let settings = self.settings(method, task.frames);
        let mut solved = Vec::new();
        for &color in &self.job.colors {
            self.bar.say(&format!("{}: solving {}, {color}", self.label, task.subject.name));
            let problem = Problem::new(self.field, color, &self.job.display, Padding::default())?;
            let share = rest / self.job.colors.len() as f64;
            let start = self.bar.position();
            let solution = eyebox::solve::solve(&problem, &settings, engine, &mut |p| {
                self.bar.at(start + share * p.step as f64 / p.steps.max(1) as f64);
                if progress::interrupted() { Flow::Stop } else { Flow::Continue }
            })?;
            if progress::interrupted() {
                return Ok(None);
            }
            self.bar.at(start + share);
            solved.push((color, solution));
        }
        let mut hologram =
            Hologram::from_solutions(self.field, &self.job.display, &settings, Padding::default(), &solved)?;
        let seconds: f64 = solved.iter().map(|(_, s)| s.seconds).sum();
        (hologram.metadata.made_by, hologram.metadata.seconds) = (Some(task.made_by.clone()), Some(seconds));
        hologram.save(&file)?;
        Ok(Some((hologram, Some(seconds))))
    }
}

fn speckle_of(
    job: &Job,
    method: Method,
    views: [usize; 2],
    results: &Keep,
    engine: &mut dyn Engine,
    bar: &JobBar,
    effort: f64,
) -> Result<Option<SpeckleFigures>, Failure> {
    let display = &job.display;
    // Depths as built-in scenes have them on such a small display: the plane itself is at 0.
    let span = 0.5e-3;
    let settings = Settings { method, depth: [-span, span], ..job.settings.clone() };
    let made_by = json!({
        "version": env!("CARGO_PKG_VERSION"), "format": keep::FORMAT, "views": views, "settings": settings,
        "side": display.height.min(display.width), "pitch": display.pitch, "focal_length": display.focal_length,
        "wavelengths": display.wavelengths.iter().map(|w| w.wavelength).collect::<Vec<_>>(),
    });
    let (name, made_by) = (format!("speckle-{}", method.name()), made_by.to_string());
    if let Some(kept) = results.load(&name, &made_by) {
        bar.pass(effort * speckle::SOLVES as f64);
        return Ok(Some(kept));
    }
    bar.say(&format!("speckle of {}", method.name()));
    let mut went = || {
        bar.pass(effort);
        !progress::interrupted()
    };
    let found = speckle::speckle(method, &settings, display, views, engine, &mut went)?;
    if let Some(found) = &found {
        results.save(&name, &made_by, found)?;
    }
    Ok(found)
}

fn methods_about(subjects: &[Subject]) -> Vec<MethodAbout> {
    let about = |s: &Subject| match &s.source {
        Source::Solved(m) => MethodAbout {
            name: s.name.clone(),
            title: m.title().into(),
            about: m.about().into(),
            citation: m.citation().into(),
        },
        Source::Given(all) => MethodAbout {
            name: s.name.clone(),
            title: s.name.clone(),
            about: "Holograms that were given.".into(),
            citation: all.iter().map(|g| g.file.display().to_string()).collect::<Vec<_>>().join(", "),
        },
    };
    subjects.iter().map(about).collect()
}

/// Changes with any pixel of any view.
pub fn checksum(field: &LightField) -> u32 {
    field.planes.iter().flatten().fold(0, |sum, view| append(sum, view))
}

fn crc(values: &[f32]) -> u32 {
    append(0, values)
}

fn append(sum: u32, values: &[f32]) -> u32 {
    let mut bytes = Vec::with_capacity(4 * 4096);
    values.chunks(4096).fold(sum, |sum, some| {
        bytes.clear();
        bytes.extend(some.iter().flat_map(|v| v.to_le_bytes()));
        crc32c::crc32c_append(sum, &bytes)
    })
}
