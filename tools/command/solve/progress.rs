//! Shows the progress of a solve while it runs.

use crate::eval::score::decibels;
use crate::failure::in_options;
use crate::progress::{self, Bar};
use eyebox::low_level::optics::{Color, Padding, depths_in_words};
use eyebox::low_level::produce::{SceneEvent, SceneJob, TilesPlan};
use eyebox::low_level::solve::{Flow, Solution};
use serde_json::{Value, json};

/// Prints the choices of a solve, shows bars, and requests a stop on ctrl-C.
pub struct SolveProgress<'a> {
    /// The job, if there is one. Without a job only bars are shown.
    about: Option<About<'a>>,
    quiet: bool,
    bar: Option<Bar>,
    /// The hologram and the color of the bar.
    shown: Option<(usize, Color)>,
    tiles: Option<TilesPlan>,
    frames: Vec<Value>,
}

/// A job with its engine and a note on its settings.
struct About<'a> {
    job: &'a SceneJob<'a>,
    engine: String,
    /// The origin of the settings, in words.
    chosen: Option<String>,
}

impl<'a> SolveProgress<'a> {
    /// Shows colors that are solved one after the other. Nothing is printed if `quiet` is set.
    pub fn new(quiet: bool) -> Self {
        Self { about: None, quiet, bar: None, shown: None, tiles: None, frames: Vec::new() }
    }

    /// Shows a job on an engine, with a note on its settings.
    pub fn of_job(job: &'a SceneJob<'a>, engine: String, chosen: Option<String>, quiet: bool) -> Self {
        Self { about: Some(About { job, engine, chosen }), ..Self::new(quiet) }
    }

    /// Returns the reports of a sequence's holograms.
    pub fn frames(&self) -> &[Value] {
        &self.frames
    }

    /// Shows an event of the solve.
    pub fn see(&mut self, event: &SceneEvent) -> Flow {
        match event {
            SceneEvent::Planned { .. } | SceneEvent::Sequence { .. } | SceneEvent::Tiles(_) => {
                // From here on the output shows that the solve has begun, so ctrl-C stops it cleanly.
                progress::catch_interrupt();
                self.begin(event);
            }
            SceneEvent::Step { hologram, color, progress } => {
                let label = match self.about.as_ref().map_or(1, |a| a.job.scenes.len()) {
                    1 => color.to_string(),
                    count => format!("{}/{count} {color}", hologram + 1),
                };
                return self.bar((*hologram, *color), || (label, progress.steps, 0, "steps")).show(progress);
            }
            SceneEvent::Visit { color, visit } => {
                let done = self.tiles.as_ref().zip(self.about.as_ref());
                let done = done.map_or(0, |(tiles, about)| tiles.done_of(&about.job.colors, *color));
                let bar = self.bar((0, *color), || (color.to_string(), visit.visits, done, "visits"));
                bar.at(visit.visit, -10.0 * visit.loss.log10());
            }
            SceneEvent::Solved { solution, .. } => {
                if let Some(bar) = self.bar.take() {
                    bar.finish(match solution.validation.quality() {
                        Some([mean, _]) => format!("{mean:.1} dB"),
                        None => "black".into(),
                    });
                }
                self.shown = None;
            }
            SceneEvent::Appended { hologram, scene, solutions } => self.append(*hologram, scene, solutions),
            _ => {}
        }
        if progress::interrupted() { Flow::Stop } else { Flow::Continue }
    }

    /// Returns the bar of this color. The bar of another color stays on the terminal.
    fn bar(&mut self, whose: (usize, Color), about: impl FnOnce() -> (String, usize, u64, &'static str)) -> &Bar {
        if self.shown != Some(whose) {
            self.shown = Some(whose);
            if let Some(bar) = self.bar.take() {
                bar.leave();
            }
        }
        let quiet = self.quiet;
        self.bar.get_or_insert_with(|| {
            let (label, count, done, unit) = about();
            Bar::new(label, count, done, unit, quiet)
        })
    }

    fn begin(&mut self, event: &SceneEvent) {
        if let SceneEvent::Tiles(plan) = event {
            self.tiles = Some((*plan).clone());
        }
        let Some(About { job, engine, chosen }) = self.about.as_ref().filter(|_| !self.quiet) else { return };
        let display = job.display;
        let [height, width] = [display.height, display.width];
        match event {
            SceneEvent::Planned { field, views: [rows, columns], plan, settings } => {
                let depth = depths_in_words(settings.depth, display.focal_length);
                eprintln!("{}: {rows} x {columns} views, depth {depth}", field.name);
                let padded = plan.padding != Padding::default();
                for choice in plan.choices.iter().filter(|c| c.saves || (c.what == "padding" && padded)) {
                    eprintln!("{}: {} ({})", choice.what, choice.value, in_options(&choice.why));
                }
            }
            SceneEvent::Sequence { done, count } => {
                let resumed = if *done > 0 { format!(", resumed after {done}") } else { String::new() };
                eprintln!("a sequence of {count} holograms{resumed}");
            }
            SceneEvent::Tiles(plan) => begin_tiles(job, plan),
            _ => {}
        }
        eprintln!("{}, {height}x{width}, on {engine}", display.name);
        let reach = format!("{} shows {}", display.name, display.reach());
        tracing::debug!("{reach}");
        chosen.iter().for_each(|about| eprintln!("{about}"));
    }

    fn append(&mut self, hologram: usize, scene: &str, solutions: &[(Color, Solution)]) {
        let color = |(color, s): &(Color, Solution)| {
            let quality = s.validation.quality();
            json!({
                "color": color, "psnr_mean_db": quality.map(|q| q[0]), "psnr_worst_db": quality.map(|q| q[1]),
                "exposure": s.exposure, "steps": s.steps, "seconds": s.seconds,
            })
        };
        let colors: Vec<Value> = solutions.iter().map(color).collect();
        self.frames.push(json!({ "frame": hologram, "scene": scene, "colors": colors }));
        if !self.quiet {
            let one = |(color, s): &(Color, Solution)| {
                format!("{color} {} dB", decibels(s.validation.quality().map(|q| q[0])))
            };
            let mean: Vec<String> = solutions.iter().map(one).collect();
            println!("{hologram:4} {scene}: {}", mean.join(", "));
        }
    }
}

fn begin_tiles(job: &SceneJob, plan: &TilesPlan) {
    let (display, settings) = (job.display, &plan.settings);
    let [small, large] = settings.diameter.map(|d| d * 1e3);
    let depth = depths_in_words(settings.depth, display.focal_length);
    eprintln!(
        "{} on {}: {}x{}, {} sub-frames, pupils of {small:.2} to {large:.2} mm, depth {depth}",
        job.scenes[0], display.name, display.height, display.width, settings.frames
    );
    let [memory, _] = plan.memory;
    eprintln!(
        "out of core, {} visits per color to regions of {}x{}, {} steps each; about {} MiB of {} MiB",
        plan.visits,
        plan.region.rows,
        plan.region.columns,
        settings.steps,
        plan.bytes() >> 20,
        memory >> 20
    );
    eprintln!("views: {}", plan.views);
    if plan.done > 0 {
        eprintln!("resumed after {} visits", plan.done);
    }
}
