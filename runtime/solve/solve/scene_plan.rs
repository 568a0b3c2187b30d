//! Decides which parts of the full model a scene requires, before any work, and leaves out the rest.
//!
//! Each part ([`Full`]) is left out only if the result stays the same. These parts are colors without light, views that
//! show the same as their neighbors or that no pupil reaches, padding that keeps nothing out, and the spectrum that no
//! pupil passes. Each decision and its reason are recorded ([`Decision`]), and each part can be kept.

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

/// Parts of the model that are kept regardless of the scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Full {
    /// Colors that hold no light.
    pub colors: bool,
    /// Views that show nothing new, or that no pupil reaches.
    pub views: bool,
    /// Zeros around the SLM, as wide as light moves out of the picture.
    pub padding: bool,
    /// The whole spectrum for every pupil.
    pub window: bool,
    /// All modes of the source for every pupil.
    pub modes: bool,
}

impl Full {
    /// All parts are kept.
    pub const ALL: Self = Self { colors: true, views: true, padding: true, window: true, modes: true };
    /// The names of the parts.
    pub const PARTS: [&'static str; 5] = ["colors", "views", "padding", "window", "modes"];

    /// Keeps the part of this name. Returns false if there is no such part.
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

/// The input of a plan.
#[derive(Debug, Clone)]
pub struct PlanRequest<'a> {
    /// The settings of the solve. Their depths are used if `depth` is `None`.
    pub settings: &'a Settings,
    /// Requested depths in meters, or `None` for the depths that the scene reaches.
    pub depth: Option<[f64; 2]>,
    /// Parts kept regardless of the scene.
    pub full: Full,
    /// Requested speckle contrast (standard deviation over mean in an even patch), or `None` for the sub-frames of the
    /// settings.
    pub contrast: Option<f64>,
}

/// One decision of a plan, as text.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Decision {
    /// The subject of the decision.
    pub what: &'static str,
    /// The decision as text.
    pub value: String,
    /// The reason for the decision.
    pub why: String,
    /// True if a part of the full model is left out.
    pub saves: bool,
}

/// The parts of a scene that are computed.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePlan {
    /// Colors that are solved.
    pub colors: Vec<Color>,
    /// Colors that hold no light.
    pub dark: Vec<Color>,
    /// Rows and columns of views left out on each side because no pupil reaches them.
    pub outer: [usize; 2],
    /// Number of views along an axis that are merged into one. 1 keeps all views.
    pub merge: usize,
    /// Depth at which the views were aligned for merging, in meters.
    pub merge_depth: f64,
    /// Zeros around the SLM.
    pub padding: Padding,
    /// The display's source with its chosen number of modes (see [`lit`](Self::lit)).
    pub source: SourceSections,
    /// The settings with the decisions applied.
    pub settings: Settings,
    /// All decisions, in order.
    pub choices: Vec<Decision>,
}

/// Highest allowed loss of a saving, in dB.
const TOLERANCE: f64 = 0.05;
/// Required agreement of the target images of merged views and of all views, in dB of the brightest value.
///
/// This error is 20 dB and more below the speckle of any hologram, so the loss is less than [`TOLERANCE`].
const LIKENESS: f64 = 60.0;
/// Loss by light in the margins that enters again at the opposite side, in dB per mean square of a picture with a
/// brightest value of 1.
///
/// It was measured on still-life, dense-grass and antinous with 2 to 8 % of the picture within reach
/// (docs/results/speed-and-accuracy.json). It is small because a wrong edge replaces a noisy one.
const WRAP_COST: f64 = 16.0;
/// Distance in pixels of content in the views of a block, up to which merging is tested.
const MAX_MERGED_STEP_PX: f64 = 1.0;

impl ScenePlan {
    /// Makes all decisions. Only the test of merged views computes anything, which is a few target images of both
    /// versions.
    ///
    /// # Errors
    /// [`SolveError`] for invalid settings, and for colors that the display does not have.
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

    /// Returns the grid of the views that the plan keeps.
    pub fn left(&self, field: &LightField, display: &Display) -> ViewGrid {
        let axis = |i: usize| (field.grid[i] - 2 * self.outer[i]) / self.merge;
        ViewGrid { rows: axis(0), columns: axis(1), cell: field.cell(display) * self.merge as f64 }
    }

    /// Returns the scene reduced to the parts that the plan keeps.
    pub fn reduce(&self, field: LightField, display: &Display) -> LightField {
        let field = field.with_colors(&self.colors).without_outer(display, self.outer);
        if self.merge > 1 { field.merged(display, self.merge, self.merge_depth) } else { field }
    }

    pub(super) fn say(&mut self, what: &'static str, value: impl Into<String>, why: impl Into<String>) {
        self.choices.push(Decision { what, value: value.into(), why: why.into(), saves: false });
    }

    /// Marks the last decision as a saving.
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
            self.say("colors", all, "each holds light");
        } else if request.full.colors {
            self.say("colors", all, format!("kept as requested, although {no_light}"));
        } else if lit.is_empty() {
            self.colors.truncate(1);
            self.dark = dark[1..].to_vec();
            self.say("colors", names(&self.colors), "the scene is black, and one color shows it");
            self.saves();
        } else {
            self.say("colors", names(&lit), no_light);
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
                "no view has light there. The SLM's pixels still shape the rest, so they are solved"
            },
        );
    }

    fn choose_depth(&mut self, field: &LightField, display: &Display, request: &PlanRequest) -> Result<(), SolveError> {
        let (depth, why) = match request.depth {
            Some([a, b]) => ([a.min(b), a.max(b)], "as requested".to_owned()),
            None => {
                let (depth, source) = field.reach(display);
                let depth = source.sure(depth, display.focal_length)?;
                let why = match source {
                    DepthSource::Stated => "the scene states its depth",
                    _ => "measured in the central view because the scene does not state it",
                };
                (depth, why.to_owned())
            }
        };
        self.settings.depth = depth;
        let flat = depth[0] == depth[1];
        let why = if flat { format!("{why}. There is one plane, so no eye has to focus elsewhere") } else { why };
        self.say("depth", depths_in_words(depth, display.focal_length), why);
        Ok(())
    }

    fn choose_views(&mut self, field: &LightField, display: &Display, request: &PlanRequest) -> Result<(), SolveError> {
        let count = field.grid[0] * field.grid[1];
        if request.full.views {
            self.say("views", format!("{count}"), "all, as requested");
            return Ok(());
        }
        self.outer = field.unseen(display, display.eyebox_min());
        let seen = self.outer.iter().zip(field.grid).map(|(o, n)| n - 2 * o).product::<usize>();
        let mut why = if seen < count {
            format!("{} are outside the eyebox", count - seen)
        } else {
            "a pupil sees each of them".into()
        };
        let [far, near] = self.settings.depth;
        self.merge_depth = 0.5 * (far + near);
        // Within a block, content at half the range from this depth moves this far between the middle and the edge.
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
            why += &format!(". Blocks of {k} x {k} show the same, since their target images agree {like}");
            self.say("views", format!("{} of {count}", seen / (k * k)), why);
            self.saves();
        } else {
            why += &match worse {
                Some((k, likeness)) => {
                    format!(". Merged blocks of {k} x {k} would agree by {likeness:.0} dB ({LIKENESS:.0} dB required)")
                }
                None => ". They differ because the scene is deep".into(),
            };
            self.say("views", format!("{seen} of {count}"), why);
            if seen < count {
                self.saves();
            }
        }
        Ok(())
    }

    /// Returns the color with the most light.
    fn brightest(&self, field: &LightField) -> Color {
        let light = field.light();
        light.iter().max_by(|a, b| a.brightest.total_cmp(&b.brightest)).map_or(field.colors[0], |l| l.color)
    }

    /// Returns the agreement of the target images of merged blocks of `k` x `k` views and of all views.
    ///
    /// It is in dB of the brightest value. The worst of eight pupils counts, drawn as in the solve.
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
        // A method without pupils uses the views themselves, so none may be merged.
        Ok(all.iter().zip(&few).map(one).reduce(f64::min).unwrap_or(f64::NEG_INFINITY))
    }

    /// Decides the padding, and returns the rule that describes the choice.
    fn pad(&mut self, field: &LightField, display: &Display, request: &PlanRequest) -> Result<PaddingRule, SolveError> {
        let optics = display.optics(self.colors[0])?;
        let [far, near] = self.settings.depth;
        let (depth, reach) = (far.abs().max(near.abs()), display.eyebox_min() / 2.0);
        // For an eye with a prescription the picture moves like one at another depth (OPTICS 11).
        let eye = display.prescription.as_ref();
        let eye = eye.map_or(0.0, |eye| eye.walk_off(display.focal_length, reach, self.settings.diameter[1]));
        let pixels = walk_off(&optics, depth + eye, reach) / optics.pitch;
        let required = Padding::required(&optics, depth + eye, reach);
        // On average over depths and places, half of the light within this distance moves out of the picture.
        let power = field.edge_power((0.5 * pixels).ceil().min(1e9) as usize);
        let loss = WRAP_COST * power;
        let walks = format!("light moves out by up to {pixels:.1} pixels. Its return would cost about {loss:.2} dB");
        let always = request.full.padding || request.settings.padding == PaddingRule::Always;
        let exact = request.settings.padding == PaddingRule::Exact && !always;
        let slow = Padding::smooth(&optics);
        if exact && slow != Padding::default() {
            self.say("padding", "none", format!("as requested, although {}", slow_sides(&optics)));
        } else if required == Padding::default() && slow == required {
            self.say("padding", "none", "light stays in the picture");
        } else if required != Padding::default()
            && (always || (request.settings.padding == PaddingRule::Need && loss > TOLERANCE))
        {
            self.padding = required;
            let why = if always { "as requested".to_owned() } else { walks };
            self.say("padding", format!("{} rows, {} columns", required.rows, required.columns), why);
        } else if slow != Padding::default() {
            self.padding = slow;
            self.say("padding", format!("{} rows, {} columns", slow.rows, slow.columns), slow_sides(&optics));
        } else {
            let why = if loss > TOLERANCE { format!("{walks}. `padding` keeps it out") } else { walks };
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
            WindowFactor::Full => "the whole spectrum, as requested".to_owned(),
            factor => {
                let times = if factor == WindowFactor::One { "once" } else { "twice" };
                format!(
                    "{times} the spectrum that a pupil of {:.1} to {:.1} mm passes. The samples are exact",
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
                // Independent sub-frames have sigma / mu = 1 / sqrt(F) (OPTICS 8).
                self.settings.frames = (1.0 / (contrast * contrast) - 1e-9).ceil().clamp(1.0, 4096.0) as usize;
                format!("independent ones have a speckle contrast of at most {contrast:.2}")
            }
            None => {
                let contrast = 1.0 / (self.settings.frames as f64).sqrt();
                format!("as requested. Independent ones have a speckle contrast of {contrast:.2}")
            }
        };
        self.say("sub-frames", self.settings.frames.to_string(), why);
    }

    fn say_precision(&mut self, display: &Display) {
        let levels = self.settings.levels.given().map_or(display.levels as usize, <[f64]>::len);
        let shown = Storage::decibels_of_levels(levels);
        let halves_do = Storage::F16.for_levels(levels) == Storage::F16;
        let would_do = if halves_do && self.settings.storage == Storage::F32 { ", which is enough" } else { "" };
        let why = format!(
            "{levels} levels of phase show {shown:.0} dB. Fields in fp32 keep 130 dB, in fp16 60 dB or more{would_do}"
        );
        self.say("precision", self.settings.storage.name(), why);
    }
}

#[cfg(test)]
#[path = "scene_plan_tests.rs"]
mod tests;
