//! What a display's source and a static mask in front of its SLM ask of a solve: how many modes stand for the source, which methods know
//! of either, and what a mask costs (OPTICS 12).

use super::error::{SolveError, require};
use super::method::Method;
use super::problem::Problem;
use super::scene_plan::{PlanRequest, ScenePlan};
use super::settings::Settings;
use crate::optics::{Color, Display, FewerModes, Padding, SourceMode, SourceSampling, SourcesLit};
use crate::scene::LightField;

/// Refuses a source that the method knows nothing of, and fewer sub-frames than sources that take turns.
pub(super) fn check(modes: &[SourceMode], settings: &Settings) -> Result<(), SolveError> {
    let Settings { method, frames, .. } = *settings;
    let turns = modes.iter().map(|mode| mode.turn[1]).max().unwrap_or(0);
    let right = "as many as sources that take turns at least (`frames`), or sources_lit = \"together\" or \"steered\"";
    require(turns <= 1 || frames >= turns, "the number of sub-frames", frames, right)?;
    let solved = settings.solved_frames();
    let take_all_turns = turns <= 1 || solved >= frames || solved.is_multiple_of(turns);
    let right = "a number that sources which take turns divide, where sub-frames repeat";
    require(take_all_turns, "the number of solved sub-frames", solved, right)?;
    let right = "one that looks through pupils (slfh, lf2fs, stft-exact, smooth, pupil-aware, table) for a source of several modes";
    require(modes.is_empty() || method.looks_through_pupils(), "the method", method.name(), right)
}

impl ScenePlan {
    /// Decides, colour by colour, how few modes stand for the display's source, and for how wide pupils how few of them do.
    pub(super) fn choose_source(
        &mut self,
        field: &LightField,
        display: &Display,
        request: &PlanRequest,
    ) -> Result<(), SolveError> {
        self.settings.all_modes |= request.full.modes;
        let mut lit = display.clone();
        let (diameter, [far, near]) = (self.settings.diameter[0], self.settings.depth);
        for color in self.colors.clone() {
            let sampling = display.source_sampling(color, diameter, near - far);
            if let Some(sampling) = &sampling {
                lit = lit.with_source_samples(color, sampling.samples);
            }
            let modes = lit.modes(color).len();
            self.say_sources(display, color);
            let why = match sampling {
                Some(sampling) => in_words(&sampling, diameter),
                None if modes > 0 && !display.source.is_empty() => "as the display's file lists them".into(),
                None => continue,
            };
            let problem = Problem::outline(&lit, color, Padding::default(), self.left(field, display))?;
            let why = why + &fewer_in_words(&problem.planner_of(&self.settings).fewer, self.settings.diameter);
            self.say("source", format!("{color}: {} modes", modes.max(1)), why);
        }
        self.source = lit.source;
        Ok(())
    }

    /// Refuses sources that method or sub-frames do not fit.
    pub(super) fn check_source(&self, display: &Display) -> Result<(), SolveError> {
        let lit = self.lit(display);
        self.colors.iter().try_for_each(|color| check(&lit.modes(*color), &self.settings))
    }

    /// Says of a colour's switchable sources which are lit.
    fn say_sources(&mut self, display: &Display, color: Color) {
        let (sources, frames) = (&display.sources, self.settings.frames);
        let lit = sources.lit(color, display.focal_length).len();
        let why = match &sources.lit {
            _ if sources.is_empty() => return,
            SourcesLit::InTurn => {
                format!(
                    "in turn: {:.1} of {frames} sub-frames each, which is all that one pupil sees{}",
                    frames as f64 / lit as f64,
                    switching_in_words(display, color)
                )
            }
            SourcesLit::Together => "together, in every sub-frame".into(),
            _ => "steered: whoever follows the eye lights others".into(),
        };
        let all = sources.of(color).len();
        let area =
            display.reach().sources.map_or(1.0, |with| with.area_mm2 / (display.source_eyebox_min() * 1e3).powi(2));
        self.say(
            "sources",
            format!("{color}: {lit} of {all} lit"),
            format!("{why}; all have {area:.1} times the eyebox of one"),
        );
    }

    /// The display with as many modes of its source as were decided.
    pub fn lit(&self, display: &Display) -> Display {
        Display { source: self.source.clone(), ..display.clone() }
    }
}

/// What is left of the light of sources that take turns; nothing to say where they are switched at once.
fn switching_in_words(display: &Display, color: Color) -> String {
    let least = display.sources.lit_shares(color, display.focal_length).into_iter().fold(1.0, f64::min);
    let (dark, all) = ((1.0 - least) * display.sub_frame_us(), display.sub_frame_us());
    let left = || format!(", {:.0} % of their light: switching takes {dark:.0} of {all:.0} us", least * 100.0);
    if least < 1.0 { left() } else { String::new() }
}

/// Which of these pupils are solved for with fewer modes.
fn fewer_in_words(fewer: &[FewerModes], [narrow, wide]: [f64; 2]) -> String {
    let taken = fewer.iter().enumerate().filter(|(i, few)| {
        let wider = fewer.get(i + 1).is_some_and(|next| next.from <= narrow);
        few.from <= wide && !wider
    });
    let each = taken.map(|(_, few)| format!("{} from {:.1} mm on", few.modes.len(), few.from * 1e3));
    let all = each.collect::<Vec<_>>().join(", ");
    if all.is_empty() { all } else { format!("; pupils are solved for with {all}") }
}

fn in_words(sampling: &SourceSampling, diameter: f64) -> String {
    let SourceSampling { samples: [samples, lines], contrast, one_more, limit, .. } = *sampling;
    format!(
        "{samples} along an axis of its size, {lines} of its line: a sub-frame's speckle has a contrast of {contrast:.2} \
         through {:.1} mm ({limit:.2} of the source itself); one more of each makes it {one_more:.2}",
        diameter * 1e3
    )
}

/// Refuses a mask that the method knows nothing of.
pub(super) fn check_mask(has_mask: bool, method: Method) -> Result<(), SolveError> {
    let right =
        "one that looks through pupils (slfh, lf2fs, stft-exact, smooth, pupil-aware) for a mask in front of the SLM";
    require(!has_mask || method.looks_through_pupils(), "the method", method.name(), right)
}

impl ScenePlan {
    /// Says what the display's mask makes of its eyebox, and of the work.
    pub(super) fn say_mask(&mut self, display: &Display) -> Result<(), SolveError> {
        let Some(mask) = &display.mask else { return Ok(()) };
        check_mask(true, self.settings.method)?;
        let (k, eyebox) = (mask.factor, display.eyebox_min() * 1e3);
        let plain = eyebox / k as f64;
        let mut why = format!(
            "an eyebox of {eyebox:.1} mm instead of {plain:.1} from as many phases: fields and spectra have {} times the points, of \
             which only columns that pupils pass are transformed along y; windows stay as they are",
            k * k
        );
        if mask.distance_mm > 0.0 {
            why += &format!("; {} mm behind the SLM: two more transforms of the grid each way", mask.distance_mm);
        }
        self.say("mask", format!("{k} x {k} pixels on each of the SLM's"), why);
        Ok(())
    }
}
