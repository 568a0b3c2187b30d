//! What a display's source asks of a solve: how many modes stand for it, and which methods know of it (OPTICS 12).

use super::error::SolveError;
use super::method::Method;
use super::problem::Problem;
use super::scene_plan::{PlanRequest, ScenePlan};
use crate::optics::{Display, FewerModes, Padding, SourceSampling};
use crate::scene::LightField;

/// Refuses a source that the method knows nothing of.
pub(super) fn check(has_modes: bool, method: Method) -> Result<(), SolveError> {
    if has_modes && (method.is_stft() || !method.is_iterative()) {
        let right = "one that looks through pupils (slfh, lf2fs, stft-exact, smooth, pupil-aware) for a source of several modes";
        return Err(SolveError::Setting { what: "the method", value: method.name().into(), right });
    }
    Ok(())
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
            check(modes > 0, self.settings.method)?;
            let why = match sampling {
                Some(sampling) => in_words(&sampling, diameter),
                None if modes > 0 => "as the display's file lists them".into(),
                None => continue,
            };
            let problem = Problem::outline(&lit, color, Padding::default(), self.left(field, display))?;
            let why = why + &fewer_in_words(&problem.planner_of(&self.settings).fewer, self.settings.diameter);
            self.say("source", format!("{color}: {} modes", modes.max(1)), why);
        }
        self.source = lit.source;
        Ok(())
    }

    /// The display with as many modes of its source as were decided.
    pub fn lit(&self, display: &Display) -> Display {
        Display { source: self.source.clone(), ..display.clone() }
    }
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
