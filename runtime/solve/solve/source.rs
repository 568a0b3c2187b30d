//! Decides how a solve represents the display's source and mask, and checks the method (OPTICS 12).
//!
//! It chooses the number of modes of the source, refuses methods that cannot use a source or a mask, and describes the
//! cost of a mask.

use super::error::{SolveError, require};
use super::method::Method;
use super::problem::Problem;
use super::scene_plan::{PlanRequest, ScenePlan};
use super::settings::Settings;
use crate::optics::{Color, Display, FewerModes, Padding, SourceMode, SourceSampling, SourcesLit};
use crate::scene::LightField;

/// Returns an error if the method cannot use the source, or if there are fewer sub-frames than sources that alternate.
pub(super) fn check(modes: &[SourceMode], settings: &Settings) -> Result<(), SolveError> {
    let Settings { method, frames, .. } = *settings;
    let turns = modes.iter().map(|mode| mode.turn[1]).max().unwrap_or(0);
    let right = "at least one per alternating source (`frames`), or sources_lit = \"together\" or \"steered\"";
    require(turns <= 1 || frames >= turns, "the number of sub-frames", frames, right)?;
    let solved = settings.solved_frames();
    let take_all_turns = turns <= 1 || solved >= frames || solved.is_multiple_of(turns);
    let right = "a multiple of the number of sources that alternate, if sub-frames repeat";
    require(take_all_turns, "the number of solved sub-frames", solved, right)?;
    let right = "one that simulates pupils (slfh, lf2fs, stft-exact, smooth, pupil-aware, table) for several modes";
    require(modes.is_empty() || method.looks_through_pupils(), "the method", method.name(), right)
}

impl ScenePlan {
    /// Decides, for each color, the number of modes that represent the source, and the wide pupils that need fewer of
    /// them.
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

    /// Returns an error if the method or the sub-frames do not suit the sources.
    pub(super) fn check_source(&self, display: &Display) -> Result<(), SolveError> {
        let lit = self.lit(display);
        self.colors.iter().try_for_each(|color| check(&lit.modes(*color), &self.settings))
    }

    /// Records which of a color's switchable sources are lit.
    fn say_sources(&mut self, display: &Display, color: Color) {
        let (sources, frames) = (&display.sources, self.settings.frames);
        let lit = sources.lit(color, display.focal_length).len();
        let why = match &sources.lit {
            _ if sources.is_empty() => return,
            SourcesLit::InTurn => {
                format!(
                    "in turn, with {:.1} of {frames} sub-frames each, which are all that one pupil sees{}",
                    frames as f64 / lit as f64,
                    switching_in_words(display, color)
                )
            }
            SourcesLit::Together => "together, in every sub-frame".into(),
            _ => "refinement for the tracked pupil chooses others".into(),
        };
        let all = sources.of(color).len();
        let area =
            display.reach().sources.map_or(1.0, |with| with.area_mm2 / (display.source_eyebox_min() * 1e3).powi(2));
        self.say(
            "sources",
            format!("{color}: {lit} of {all} lit"),
            format!("{why}. All have {area:.1} times the eyebox of one"),
        );
    }

    /// Returns the display with the decided number of modes of its source.
    pub fn lit(&self, display: &Display) -> Display {
        Display { source: self.source.clone(), ..display.clone() }
    }
}

/// Describes the remaining light of alternating sources. The text is empty if switching takes no time.
fn switching_in_words(display: &Display, color: Color) -> String {
    let least = display.sources.lit_shares(color, display.focal_length).into_iter().fold(1.0, f64::min);
    let (dark, all) = ((1.0 - least) * display.sub_frame_us(), display.sub_frame_us());
    let left = || format!(", with {:.0} % of their light (switching takes {dark:.0} of {all:.0} us)", least * 100.0);
    if least < 1.0 { left() } else { String::new() }
}

/// Describes which of these pupils are solved with fewer modes.
fn fewer_in_words(fewer: &[FewerModes], [narrow, wide]: [f64; 2]) -> String {
    let taken = fewer.iter().enumerate().filter(|(i, few)| {
        let wider = fewer.get(i + 1).is_some_and(|next| next.from <= narrow);
        few.from <= wide && !wider
    });
    let each = taken.map(|(_, few)| format!("{} from {:.1} mm on", few.modes.len(), few.from * 1e3));
    let all = each.collect::<Vec<_>>().join(", ");
    if all.is_empty() { all } else { format!(". Pupils are solved with fewer modes ({all})") }
}

fn in_words(sampling: &SourceSampling, diameter: f64) -> String {
    let SourceSampling { samples: [samples, lines], contrast, one_more, limit, .. } = *sampling;
    format!(
        "{samples} along an axis of its size and {lines} of its line. The speckle of a sub-frame has a contrast of \
         {contrast:.2} through {:.1} mm ({limit:.2} for the source itself). One more of each makes it {one_more:.2}",
        diameter * 1e3
    )
}

/// Returns an error if the method cannot use a mask.
pub(super) fn check_mask(has_mask: bool, method: Method) -> Result<(), SolveError> {
    let right =
        "one that simulates pupils (slfh, lf2fs, stft-exact, smooth, pupil-aware) for a mask in front of the SLM";
    require(!has_mask || method.looks_through_pupils(), "the method", method.name(), right)
}

impl ScenePlan {
    /// Records the effect of the display's mask on its eyebox and on the work.
    pub(super) fn say_mask(&mut self, display: &Display) -> Result<(), SolveError> {
        let Some(mask) = &display.mask else { return Ok(()) };
        check_mask(true, self.settings.method)?;
        let (k, eyebox) = (mask.factor, display.eyebox_min() * 1e3);
        let plain = eyebox / k as f64;
        let mut why = format!(
            "an eyebox of {eyebox:.1} mm instead of {plain:.1} mm from as many phases. Fields and spectra have {} times \
             the points. Only their columns that pupils pass are transformed along y. Windows keep their size",
            k * k
        );
        if mask.distance_mm > 0.0 {
            why += &format!(
                ". Its distance of {} mm behind the SLM needs two more transforms of the grid each way",
                mask.distance_mm
            );
        }
        self.say("mask", format!("{k} x {k} pixels on each of the SLM's"), why);
        Ok(())
    }
}
