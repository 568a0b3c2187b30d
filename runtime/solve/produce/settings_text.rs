//! The settings of a job as text.

use super::{ProduceError, SceneJob};
use crate::engine::Engine;
use crate::files::overlay;
use crate::quality::Quality;
use crate::solve::{FirstPhases, PaddingRule, Settings};
use eyebox_base::quantity::{M, Quantity, S};
use eyebox_base::{Reason, reason};
use eyebox_optics::Depth;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

/// Keys beside those of [`Settings`].
const BESIDE: [&str; 3] = ["quality", "contrast", "force"];

impl SceneJob<'_> {
    /// Takes over what a TOML text says: the fields of [`Settings`] by their names, lengths in metres or with a unit, and `quality` (one of
    /// [`Quality`], the built-in settings of which lie under what is said itself), `contrast` and `force`. What is left out is
    /// as the command has it; complex fields are stored as `engine` prefers.
    ///
    /// # Errors
    /// [`ProduceError::Job`] with the key that is not known or has no such value.
    pub fn take_settings(&mut self, text: &str, engine: &dyn Engine) -> Result<(), ProduceError> {
        let wrong = |reason: Reason| ProduceError::Job(reason.within("the settings"));
        let focal_length = self.display.focal_length;
        // All keys are there: those that files leave out where they are as by default, too.
        let shown = Settings {
            repeats: 2,
            views: 2,
            pixel: 2,
            padding: PaddingRule::Need,
            first_phases: FirstPhases::Random,
            ..Settings::default()
        };
        let (_, given) =
            overlay(&shown, &BESIDE, &|key, value| plain(key, value, focal_length), text).map_err(wrong)?;
        let mut base = Settings::default();
        match value::<Quality>(&given, "quality").map_err(wrong)? {
            Some(quality) => base = base.with_quality_of(&Settings::of(quality)),
            None => base.storage = engine.preferred_storage().for_levels(self.display.levels as usize),
        }
        let mut whole = serde_json::to_value(base).map_err(|e| wrong(e.to_string().into()))?;
        for (key, value) in given.iter().filter(|(key, _)| !BESIDE.contains(&&key[..])) {
            whole[key] = value.clone();
        }
        self.settings = Settings::deserialize(whole).map_err(|e| wrong(e.to_string().into()))?;
        self.settings.check()?;
        // These two are the job's own, and come before those of the settings.
        self.reading.depth = given.contains_key("depth").then_some(self.settings.depth);
        self.diameter = given.contains_key("diameter").then_some(self.settings.diameter);
        self.contrast = value(&given, "contrast").map_err(wrong)?;
        self.force = value(&given, "force").map_err(wrong)?.unwrap_or(false);
        Ok(())
    }
}

/// Makes numbers of texts with units if a setting has a unit.
fn plain(key: &str, value: Value, focal_length: f64) -> Result<Value, Reason> {
    let number = |text: &str| match key {
        "seconds" => Quantity::read_with_unit(text, S, &[]).map(|time| time.value_in(S)),
        "diameter" => Quantity::read_with_unit(text, M, &[]).map(|length| length.value_in(M)),
        _ => Depth::read_with_unit(text).map(|depth| depth.metres(focal_length)),
    };
    match value {
        Value::String(text) if ["seconds", "diameter", "depth"].contains(&key) => {
            number(&text).map(Value::from).map_err(|error| Reason::of(&error))
        }
        Value::Array(each) => {
            each.into_iter().map(|one| plain(key, one, focal_length)).collect::<Result<_, _>>().map(Value::Array)
        }
        value => Ok(value),
    }
}

fn value<T: DeserializeOwned>(given: &Map<String, Value>, key: &str) -> Result<Option<T>, Reason> {
    given.get(key).map(|v| T::deserialize(v).map_err(|e| reason!("value", "{key}: {e}"))).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::optics::Display;
    use crate::solve::Optimizer;
    use eyebox_base::error::ErrorData;

    #[test]
    fn what_is_said_lies_over_what_is_by_default() {
        let display = Display::preset("small").unwrap();
        let mut job = SceneJob::new("builtin:plane", &display);
        let mut take = |text: &str| job.take_settings(text, &CpuEngine::new()).map(|()| job.clone());
        assert_eq!(take("").unwrap().settings, Settings::default());
        let units = "seconds = '2s'\ndiameter = ['2mm', 4e-3]\ndepth = ['-1mm', '0.5D']";
        let same =
            format!("seconds = 2\ndiameter = [2e-3, 4e-3]\ndepth = [-1e-3, {}]", 0.5 * display.focal_length.powi(2));
        assert_eq!(take(units).unwrap().settings, take(&same).unwrap().settings);
        for (text, code) in [("seconds = '2mm'", "other-dimension"), ("diameter = ['2', 3]", "no-unit")] {
            assert_eq!(ErrorData::of(&take(text).unwrap_err()).code, format!("job/{code}"));
        }
        let said = take("steps = 7\nseconds = 2\nviews = 2\ndepth = [-1e-3, 2e-3]\nforce = true").unwrap();
        let Settings { steps, seconds, views, pupils, .. } = said.settings;
        assert_eq!((steps, seconds, views, pupils), (7, Some(2.0), 2, 16));
        assert_eq!((said.reading.depth, said.diameter, said.force), (Some([-1e-3, 2e-3]), None, true));
        let fast = take("quality = \"fast\"\npupils = 3").unwrap();
        assert_eq!((fast.settings.steps, fast.settings.pupils, fast.reading.depth), (40, 3, None));
        assert_eq!(fast.settings.optimizer, Optimizer::momentum());
        assert_eq!(take("first_phases = \"random\"").unwrap().settings.first_phases, FirstPhases::Random);
        for (text, code, names) in [
            ("stpes = 3", "job/no-such-setting", "stpes"),
            ("steps = \"many\"", "job/value", "steps"),
            ("depth = [1, 2, 3]", "job/value", "depth"),
            ("psnr = nan", "job/not-finite", "psnr"),
            ("quality = \"good\"", "job/value", "quality"),
            ("frames = 0", "solve/setting", "0"),
            ("steps = ", "job/toml", "1"),
        ] {
            let error = take(text).unwrap_err();
            assert_eq!(ErrorData::of(&error).code, code, "{text}: {error}");
            assert!(error.to_string().contains(names), "{text}: {error}");
        }
    }
}
