//! Compares sources and masks on a scene, for each number of sub-frames, without repeating cached measurements.

use super::coherence::{self, Sources};
use super::etendue::{self, Masks};
use super::measure::leading;
use super::results::{CoherenceFigures, EtendueFigures, Results};
use super::{OfScene, Work};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::evaluate::Group;
use eyebox::low_level::optics::Pupil;
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::solve::Settings;
use serde_json::json;

impl OfScene<'_> {
    /// Measures the sources of all sizes, for each number of sub-frames without a cached result.
    pub(super) fn sources(
        &self,
        work: &mut Work,
        engine: &mut dyn Engine,
        results: &mut Results,
    ) -> Result<(), QualityError> {
        let (job, color) = (self.job, leading(&self.job.colors));
        let random = self.pupils.members.iter().filter(|member| member.group == Group::Random);
        let pupils: Vec<Pupil> = random.map(|member| member.pupil).collect();
        for (frames, image_mm) in job.frames.iter().flat_map(|f| job.coherence.iter().map(move |mm| (*f, *mm))) {
            let settings = Settings { frames, depth: self.depth, ..job.settings.clone() };
            let made_by = json!({ "shown": self.shown(&self.made_by), "settings": settings, "source_mm": image_mm });
            let name = format!("{}-source-{frames}-{image_mm}", self.name);
            let label = format!("{}: {frames} sub-frames, source of {image_mm} mm", self.label());
            let (field, display, longest) = (self.field, &job.display, job.longest());
            let sources = Sources { field, display, color, settings: &settings, pupils: &pupils, longest };
            let found: Option<CoherenceFigures> = work.kept_or(&name, &made_by, &mut results.missing, |work| {
                sources.measure(image_mm, engine, &mut || work.say(&label))
            })?;
            let Some(found) = found else { break };
            work.pass(coherence::EFFORT);
            results.coherence.push(CoherenceFigures { scene: self.label().into(), ..found });
        }
        Ok(())
    }

    /// Measures all masks, for each number of sub-frames without a cached result.
    pub(super) fn behind_masks(
        &self,
        work: &mut Work,
        engine: &mut dyn Engine,
        results: &mut Results,
    ) -> Result<(), QualityError> {
        let (job, color) = (self.job, leading(&self.job.colors));
        for (frames, kind) in job.frames.iter().flat_map(|f| job.masks.iter().map(move |kind| (*f, *kind))) {
            let settings = Settings { frames, depth: self.depth, ..job.settings.clone() };
            let made_by =
                json!({ "shown": self.shown(&self.made_by), "settings": settings, "masked": kind.to_string() });
            let designed = if kind.designed { "d" } else { "" };
            let name = format!("{}-mask-{frames}-{}{designed}", self.name, kind.factor);
            let label = format!("{}: {frames} sub-frames, {kind}", self.label());
            let (field, display, longest) = (self.field, &job.display, job.longest());
            let masks = Masks { field, display, color, settings: &settings, longest };
            let found: Option<EtendueFigures> = work.kept_or(&name, &made_by, &mut results.missing, |work| {
                masks.measure(kind, engine, &mut || work.say(&label))
            })?;
            let Some(found) = found else { break };
            work.pass(etendue::EFFORT);
            results.etendue.push(EtendueFigures { scene: self.label().into(), ..found });
        }
        Ok(())
    }
}
