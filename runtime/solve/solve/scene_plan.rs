//! What a scene requires of the model, decided before any work; the rest is left out.
//!
//! Each part that can be left out ([`Full`]) is left out only where the result stays the same: colours without light, views
//! that show what their neighbours show or that no pupil reaches, padding where nothing would come in again on the other
//! side, the spectrum that no pupil passes. What is left out, and why, is said ([`Decision`]), and each can be kept.

use super::error::SolveError;
use super::problem::Problem;
use super::settings::{PaddingRule, Settings};
use super::viewpoints::Viewpoints;
use crate::engine::Engine;
use crate::engine::cpu::CpuEngine;
use crate::evaluate;
use crate::optics::{
    Color, Display, Padding, Pupil, SourceSections, Window, WindowFactor, depths_in_words, slow_sides, walk_off,
};
use crate::plan::{Planner, Purpose, Storage, Viewpoint};
use crate::scene::{DARK, DepthSource, LightField, ViewGrid};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Parts of the model that are kept whatever the scene requires.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Full {
    /// Colours without light.
    pub colors: bool,
    /// Views that show nothing new, or that no pupil reaches.
    pub views: bool,
    /// Zeros around the SLM, as wide as light walks off.
    pub padding: bool,
    /// The whole spectrum for every pupil.
    pub window: bool,
    /// All modes of the source for every pupil.
    pub modes: bool,
}

impl Full {
    /// Everything.
    pub const ALL: Self = Self { colors: true, views: true, padding: true, window: true, modes: true };
    /// The names of the parts.
    pub const PARTS: [&'static str; 5] = ["colors", "views", "padding", "window", "modes"];

    /// The part of this name, kept; false where there is none.
    pub fn keep(&mut self, name: &str) -> bool {
        match name {
            "colors" => self.colors = true,
            "views" => self.views = true,
            "padding" => self.padding = true,
            "window" => self.window = true,
            "modes" => self.modes = true,
            "all" => *self = Self::ALL,
            _ => return false,
        }
        true
    }
}

/// What is asked of a plan.
#[derive(Debug, Clone)]
pub struct PlanRequest<'a> {
    /// The settings of the solve; its depths are used where `depth` says none.
    pub settings: &'a Settings,
    /// Depths asked for, metres; none for those that the scene reaches.
    pub depth: Option<[f64; 2]>,
    /// Parts kept whatever the scene requires.
    pub full: Full,
    /// Speckle contrast (standard deviation over mean in an even patch) asked for; none for the settings' sub-frames.
    pub contrast: Option<f64>,
}

/// One decision, for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Decision {
    /// What it is about.
    pub what: &'static str,
    /// What was decided.
    pub value: String,
    /// Why.
    pub why: String,
    /// Whether something of the full model is left out.
    pub saves: bool,
}

/// What is computed of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePlan {
    /// Colours that are solved.
    pub colors: Vec<Color>,
    /// Colours that hold no light.
    pub dark: Vec<Color>,
    /// Rows and columns of views left out on each side, for no pupil reaches them.
    pub outer: [usize; 2],
    /// Views along an axis that became one; 1 for all as they are.
    pub merge: usize,
    /// Depth at which they were laid upon each other, metres.
    pub merge_depth: f64,
    /// Zeros around the SLM.
    pub padding: Padding,
    /// The display's source, with how many modes stand for it: [`lit`](Self::lit).
    pub source: SourceSections,
    /// The settings with what was decided.
    pub settings: Settings,
    /// All decisions, in order.
    pub choices: Vec<Decision>,
}

/// A saving may cost so much, dB.
const TOLERANCE: f64 = 0.05;
/// Photographs of merged views must be this like those of all, dB of the brightest: twenty and more below the speckle of
/// any hologram, so less than [`TOLERANCE`].
const LIKENESS: f64 = 60.0;
/// What light in the margins costs that comes in again on the other side, dB per mean square of the picture, the
/// brightest being 1: measured on still-life, dense-grass and antinous with 2 to 8 % of the picture within reach
/// (docs/measurements.md). Little, for an edge that is wrong replaces one that was noisy.
const WRAP_COST: f64 = 16.0;
/// Pixels by which views of a block may part before merging them is not even tried.
const MAX_MERGED_STEP_PX: f64 = 1.0;

impl ScenePlan {
    /// Decides. Only where views might be merged is anything computed: a few photographs, both ways.
    ///
    /// # Errors
    /// Settings that cannot be; colours that the display does not have.
    pub fn new(field: &LightField, display: &Display, request: &PlanRequest) -> Result<Self, SolveError> {
        let mut plan = Self {
            colors: field.colors.clone(),
            dark: Vec::new(),
            outer: [0, 0],
            merge: 1,
            merge_depth: 0.0,
            padding: Padding::default(),
            source: SourceSections::new(),
            settings: request.settings.clone(),
            choices: Vec::new(),
        };
        plan.choose_colors(field, request);
        plan.choose_depth(field, display, request)?;
        plan.choose_views(field, display, request)?;
        plan.check_eye(field, display)?;
        plan.choose_source(field, display, request)?;
        plan.say_mask(display)?;
        let made = field.made.as_ref().map(|made| made.in_words(field.grid));
        made.into_iter().for_each(|[value, why]| plan.say("photographs", value, why));
        let ([pixels, why], _) = field.aliasing_in_words(display, plan.settings.depth, plan.settings.diameter[1]);
        plan.say("aliasing", pixels, why);
        plan.settings.padding = plan.pad(field, display, request)?;
        plan.choose_window(display, request)?;
        plan.choose_frames(request);
        plan.check_source(display)?;
        plan.say_precision(display);
        plan.settings.check()?;
        Ok(plan)
    }

    /// Where the views stand that the plan leaves.
    pub fn left(&self, field: &LightField, display: &Display) -> ViewGrid {
        let axis = |i: usize| (field.grid[i] - 2 * self.outer[i]) / self.merge;
        ViewGrid { rows: axis(0), columns: axis(1), cell: field.cell(display) * self.merge as f64 }
    }

    /// The scene with what the plan leaves of it.
    pub fn reduce(&self, field: LightField, display: &Display) -> LightField {
        let field = field.with_colors(&self.colors).without_outer(display, self.outer);
        if self.merge > 1 { field.merged(display, self.merge, self.merge_depth) } else { field }
    }

    pub(super) fn say(&mut self, what: &'static str, value: impl Into<String>, why: impl Into<String>) {
        self.choices.push(Decision { what, value: value.into(), why: why.into(), saves: false });
    }

    /// Marks the last choice as a saving.
    fn saves(&mut self) {
        if let Some(last) = self.choices.last_mut() {
            last.saves = true;
        }
    }

    fn choose_colors(&mut self, field: &LightField, request: &PlanRequest) {
        let light = field.light();
        let brightest = light.iter().map(|l| l.brightest).fold(0.0, f64::max);
        let is_dark = |color: &Color| light.iter().any(|l| l.color == *color && l.brightest <= brightest * DARK);
        let (dark, lit): (Vec<_>, Vec<_>) = field.colors.iter().partition(|c| is_dark(c));
        let names = |colors: &[Color]| colors.iter().map(Color::to_string).collect::<Vec<_>>().join(", ");
        let all = names(&field.colors);
        let no_light = format!("{} {} no light", names(&dark), if dark.len() == 1 { "holds" } else { "hold" });
        if dark.is_empty() {
            self.say("colours", all, "each holds light");
        } else if request.full.colors {
            self.say("colours", all, format!("kept as asked, though {no_light}"));
        } else if lit.is_empty() {
            self.colors.truncate(1);
            self.dark = dark[1..].to_vec();
            self.say("colours", names(&self.colors), "the scene is black: one colour shows it");
            self.saves();
        } else {
            self.say("colours", names(&lit), no_light);
            self.saves();
            (self.colors, self.dark) = (lit, dark);
        }
        let black = field.black();
        let rows = (black.top + black.bottom).min(field.height);
        let columns = (black.left + black.right).min(field.width);
        self.say(
            "black margins",
            format!("{rows} rows, {columns} columns"),
            if rows + columns == 0 {
                "light reaches every edge"
            } else {
                "no view has light there; the SLM's pixels still shape the rest, so they are solved"
            },
        );
    }

    fn choose_depth(&mut self, field: &LightField, display: &Display, request: &PlanRequest) -> Result<(), SolveError> {
        let (depth, why) = match request.depth {
            Some([a, b]) => ([a.min(b), a.max(b)], "as asked".to_owned()),
            None => {
                let (depth, source) = field.reach(display);
                let depth = source.sure(depth, display.focal_length)?;
                let why = match source {
                    DepthSource::Stated => "the scene says how deep it reaches",
                    _ => "measured in the central view: the scene does not say",
                };
                (depth, why.to_owned())
            }
        };
        self.settings.depth = depth;
        let flat = depth[0] == depth[1];
        let why = if flat { format!("{why}; one plane: no eye has to focus elsewhere") } else { why };
        self.say("depth", depths_in_words(depth, display.focal_length), why);
        Ok(())
    }

    fn choose_views(&mut self, field: &LightField, display: &Display, request: &PlanRequest) -> Result<(), SolveError> {
        let count = field.grid[0] * field.grid[1];
        if request.full.views {
            self.say("views", format!("{count}"), "all, as asked");
            return Ok(());
        }
        self.outer = field.unseen(display, display.eyebox_min());
        let seen = self.outer.iter().zip(field.grid).map(|(o, n)| n - 2 * o).product::<usize>();
        let mut why = if seen < count {
            format!("{} lie beyond the eyebox", count - seen)
        } else {
            "every one is seen by some pupil".into()
        };
        let [far, near] = self.settings.depth;
        self.merge_depth = 0.5 * (far + near);
        // Within a block, content half the range off its depth moves so far from the middle to the edge.
        let cell = field.cell(display);
        let apart = |k: usize| {
            0.5 * (near - far) * 0.5 * (k - 1) as f64 * cell / (display.focal_length * display.picture_pixel())
        };
        let inner = || field.only(self.brightest(field)).without_outer(display, self.outer);
        let candidates = field.mergeable_without(self.outer);
        let (mut found, mut worse) = (None, None);
        if candidates.iter().any(|k| apart(*k) <= MAX_MERGED_STEP_PX) {
            let inner = inner();
            for k in candidates.into_iter().filter(|k| apart(*k) <= MAX_MERGED_STEP_PX) {
                let likeness = self.likeness(&inner, display, k)?;
                if likeness >= LIKENESS {
                    found = Some((k, likeness));
                    break;
                }
                worse = Some((k, likeness));
            }
        }
        if let Some((k, likeness)) = found {
            self.merge = k;
            let like = if likeness.is_finite() { format!("by {likeness:.0} dB") } else { "exactly".into() };
            why += &format!("; blocks of {k} x {k} show the same: photographs agree {like}");
            self.say("views", format!("{} of {count}", seen / (k * k)), why);
            self.saves();
        } else {
            why += &match worse {
                Some((k, likeness)) => {
                    format!("; blocks of {k} x {k} as one would agree by {likeness:.0} dB only ({LIKENESS:.0} asked)")
                }
                None => "; they differ: the scene is deep".into(),
            };
            self.say("views", format!("{seen} of {count}"), why);
            if seen < count {
                self.saves();
            }
        }
        Ok(())
    }

    /// The colour that holds most light.
    fn brightest(&self, field: &LightField) -> Color {
        let light = field.light();
        light.iter().max_by(|a, b| a.brightest.total_cmp(&b.brightest)).map_or(field.colors[0], |l| l.color)
    }

    /// How like the photographs of blocks of `k` x `k` views are to those of all: dB of the brightest, the worst of
    /// eight pupils as the solve draws them.
    fn likeness(&self, field: &LightField, display: &Display, k: usize) -> Result<f64, SolveError> {
        let few = field.merged(display, k, self.merge_depth);
        let color = field.colors[0];
        let mut engine = CpuEngine::new();
        let mut photographs = |field: &LightField| -> Result<Vec<Vec<f32>>, SolveError> {
            let problem = Problem::new(field, color, display, Padding::default())?;
            let mut viewpoints = Viewpoints::new(&problem, &self.settings, self.settings.seed);
            let viewpoints: Vec<Viewpoint> =
                (0..8).map(|_| viewpoints.draw()).filter(|s| matches!(s, Viewpoint::Pupil(_))).collect();
            let planner: Planner = problem.planner(1, WindowFactor::Full);
            engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
            Ok(evaluate::targets(&mut engine, &planner, &viewpoints)?)
        };
        let (all, few) = (photographs(field)?, photographs(&few)?);
        let peak = all.iter().flatten().copied().fold(0.0f32, f32::max);
        let one = |(a, b): (&Vec<f32>, &Vec<f32>)| {
            let error = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len().max(1) as f64;
            if error > 0.0 { -10.0 * (error / f64::from(peak).powi(2)).log10() } else { f64::INFINITY }
        };
        // A method that looks through no pupil has views of its own: none may go.
        Ok(all.iter().zip(&few).map(one).reduce(f64::min).unwrap_or(f64::NEG_INFINITY))
    }

    /// Whether what walks off is kept out, as a rule that says no more than what was chosen.
    fn pad(&mut self, field: &LightField, display: &Display, request: &PlanRequest) -> Result<PaddingRule, SolveError> {
        let optics = display.optics(self.colors[0])?;
        let [far, near] = self.settings.depth;
        let (depth, reach) = (far.abs().max(near.abs()), display.eyebox_min() / 2.0);
        // Looked at by an eye with a prescription the picture moves as one at another depth does (OPTICS 11).
        let eye = display.prescription.as_ref();
        let eye = eye.map_or(0.0, |eye| eye.walk_off(display.focal_length, reach, self.settings.diameter[1]));
        let pixels = walk_off(&optics, depth + eye, reach) / optics.pitch;
        let required = Padding::required(&optics, depth + eye, reach);
        // Half of it on average over depths and places; only what lies within walks off.
        let power = field.edge_power((0.5 * pixels).ceil().min(1e9) as usize);
        let loss = WRAP_COST * power;
        let walks =
            format!("light walks off by up to {pixels:.1} pixels; what comes in again would cost about {loss:.2} dB");
        let always = request.full.padding || request.settings.padding == PaddingRule::Always;
        let exact = request.settings.padding == PaddingRule::Exact && !always;
        let slow = Padding::smooth(&optics);
        if exact && slow != Padding::default() {
            self.say("padding", "none", format!("as asked, though {}", slow_sides(&optics)));
        } else if required == Padding::default() && slow == required {
            self.say("padding", "none", "light stays where it is");
        } else if required != Padding::default()
            && (always || (request.settings.padding == PaddingRule::Need && loss > TOLERANCE))
        {
            self.padding = required;
            let why = if always { "as asked".to_owned() } else { walks };
            self.say("padding", format!("{} rows, {} columns", required.rows, required.columns), why);
        } else if slow != Padding::default() {
            self.padding = slow;
            self.say("padding", format!("{} rows, {} columns", slow.rows, slow.columns), slow_sides(&optics));
        } else {
            let why = if loss > TOLERANCE { format!("{walks}: `padding` keeps it out") } else { walks };
            self.say("padding", "none", why);
        }
        let padded = self.padding == required && required != Padding::default();
        let rest = if exact { PaddingRule::Exact } else { PaddingRule::Never };
        Ok(if padded { PaddingRule::Always } else { rest })
    }

    fn choose_window(&mut self, display: &Display, request: &PlanRequest) -> Result<(), SolveError> {
        if request.full.window {
            self.settings.window = WindowFactor::Full;
        }
        let optics = self.padding.grid(display.optics(self.colors[0])?);
        let side = |diameter: f64| {
            let pupil = Pupil { x: 0.0, y: 0.0, diameter, depth: 0.0 };
            let window = Window::new(&optics, &pupil, self.settings.window);
            format!("{}x{}", window.rows, window.columns)
        };
        let [small, large] = self.settings.diameter;
        let value = format!("{} to {}", side(small), side(large));
        let why = match self.settings.window {
            WindowFactor::Full => "the whole spectrum, as asked".to_owned(),
            factor => {
                let times = if factor == WindowFactor::One { "once" } else { "twice" };
                format!(
                    "{times} what a pupil of {:.1} to {:.1} mm passes; the samples are exact",
                    small * 1e3,
                    large * 1e3
                )
            }
        };
        self.say("window", value, why);
        Ok(())
    }

    fn choose_frames(&mut self, request: &PlanRequest) {
        let why = match request.contrast {
            Some(contrast) => {
                // Independent frames: sigma / mu = 1 / sqrt(F) (OPTICS 8).
                self.settings.frames = (1.0 / (contrast * contrast) - 1e-9).ceil().clamp(1.0, 4096.0) as usize;
                format!("independent ones have a speckle contrast of at most {contrast:.2}")
            }
            None => {
                let contrast = 1.0 / (self.settings.frames as f64).sqrt();
                format!("as asked: a speckle contrast of {contrast:.2} where they are independent")
            }
        };
        self.say("sub-frames", self.settings.frames.to_string(), why);
    }

    fn say_precision(&mut self, display: &Display) {
        let levels = self.settings.levels.given().map_or(display.levels as usize, <[f64]>::len);
        let shown = Storage::decibels_of_levels(levels);
        let halves_do = Storage::F16.for_levels(levels) == Storage::F16;
        let would_do = if halves_do && self.settings.storage == Storage::F32 { ", which would do" } else { "" };
        let why = format!(
            "{levels} levels of phase show {shown:.0} dB; fields in fp32 keep 130, in fp16 60 or more{would_do}"
        );
        self.say("precision", self.settings.storage.name(), why);
    }
}

#[cfg(test)]
#[path = "scene_plan_tests.rs"]
mod tests;
