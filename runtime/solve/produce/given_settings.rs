//! Reads settings from a file, a call or options, over a quality or the defaults.

use super::{ProduceError, SceneJob};
use crate::engine::Engine;
use crate::files::overlay::{keys, keys_of, merge, overlay, toml};
use crate::files::read;
use crate::quality::Quality;
use crate::solve::{FirstPhases, Full, Joint, Optimizer, PaddingRule, RefineSettings, Settings};
use eyebox_base::error::Reason;
use eyebox_base::quantity::{M, Quantity, S};
use eyebox_base::reason;
use eyebox_optics::Depth;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::path::Path;

/// Keys that may have a unit.
const QUANTITIES: [&str; 3] = ["seconds", "diameter", "depth"];
/// Keys of a job and of a refinement that are not fields of [`Settings`].
const BESIDE: [&str; 5] = ["quality", "contrast", "force", "full", "refine"];
/// Tables of commands. The library stores them and does not read them, so that one file serves all.
const TABLES: [&str; 6] = ["camera", "compare", "gaze", "show", "tiles", "viewing"];
/// Keys of the table `refine` that belong to a live session and are not fields of [`RefineSettings`].
const OF_SESSIONS: [&str; 1] = ["restart"];

/// Settings by their names.
///
/// They include the fields of [`Settings`], with lengths in meters or with a unit as in `"2mm"`. Others are `quality`
/// (a [`Quality`]), `contrast` (of the speckle), `force`, and `full` (parts of the model, or `"all"`). The table
/// `refine` has the fields of [`RefineSettings`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GivenSettings(Map<String, Value>);

impl GivenSettings {
    /// Reads a TOML text.
    ///
    /// # Errors
    /// [`ProduceError::Job`] with the key that is unknown or has a wrong value.
    pub fn from_toml(text: &str) -> Result<Self, ProduceError> {
        keys(text).and_then(Self::checked).map_err(refused)
    }

    /// Reads a TOML file.
    ///
    /// # Errors
    /// [`ProduceError::Job`] with the file and its fault.
    pub fn load(file: &Path) -> Result<Self, ProduceError> {
        let within = |reason: Reason| ProduceError::Job(reason.within(file.display()));
        let text = read::text(file, read::TEXT).map_err(|e| within(reason!("unreadable", "{e}")))?;
        keys(&text).and_then(Self::checked).map_err(within)
    }

    /// Returns an error for unknown keys and for values of another type.
    fn checked(given: Map<String, Value>) -> Result<Self, Reason> {
        let given = Self(given);
        // The focal length does not affect the check.
        solve_settings(&Settings::default(), &given.in_numbers(0.1)?.0)?;
        refine_settings(&given.0)?;
        value::<Quality>(&given.0, "quality")?;
        if value::<f64>(&given.0, "contrast")?.is_some_and(|contrast| !(1.0 / 64.0..=1.0).contains(&contrast)) {
            return Err(reason!("value", "contrast: expected 0.016 (4096 sub-frames) to 1 (one)"));
        }
        value::<bool>(&given.0, "force")?;
        full(&given.0)?;
        match TABLES.iter().find(|table| given.0.get(**table).is_some_and(|value| !value.is_object())) {
            Some(table) => Err(reason!("value", "{table}: not a table, such as {table}.key = value")),
            None => Ok(given),
        }
    }

    /// Takes one setting as `KEY=VALUE`, such as `optimizer=adam` or `refine.strategy.momentum=0.7`. It replaces the
    /// earlier value. The value is TOML, or a word.
    ///
    /// # Errors
    /// [`ProduceError::Job`] with the key that is unknown or has a wrong value.
    pub fn set(&mut self, assignment: &str) -> Result<(), ProduceError> {
        let read = || {
            let (key, value) = assignment
                .split_once('=')
                .ok_or_else(|| reason!("assignment", "'{assignment}': no value. Write it as in optimizer=adam"))?;
            keys(&format!("{key} = {value}")).or_else(|wrong| match value.trim() {
                word if matches!(wrong.code(), "toml" | "decimal-comma") && is_word(word) => {
                    keys(&format!("{key} = '{word}'"))
                }
                _ => Err(wrong),
            })
        };
        let Self(new) = read().and_then(Self::checked).map_err(refused)?;
        for (key, value) in new {
            merge(self.0.entry(key).or_insert(Value::Null), &value);
        }
        Ok(())
    }

    /// Replaces the value of `key` if there is a new one.
    pub fn insert<T: Serialize>(&mut self, key: &str, value: Option<T>) {
        if let Some(value) = value.and_then(|value| serde_json::to_value(value).ok()) {
            self.0.insert(key.to_owned(), value);
        }
    }

    /// Returns the same settings for a display of this focal length (meters), with numbers instead of texts with units.
    ///
    /// # Errors
    /// [`ProduceError::Job`] with the key of a text that is not a quantity of its dimension.
    pub fn before(&self, focal_length: f64) -> Result<Self, ProduceError> {
        self.in_numbers(focal_length).map_err(refused)
    }

    fn in_numbers(&self, focal_length: f64) -> Result<Self, Reason> {
        let number = |(key, value): (&String, &Value)| {
            let value =
                if QUANTITIES.contains(&&key[..]) { in_number(key, value, focal_length) } else { Ok(value.clone()) };
            value.map(|value| (key.clone(), value)).map_err(|reason| reason.within(key))
        };
        self.0.iter().map(number).collect::<Result<_, _>>().map(Self)
    }

    /// Returns whether `key` is given.
    pub fn has(&self, key: &str) -> bool {
        self.0.contains_key(key)
    }

    /// Returns the value of a key, if it is given.
    ///
    /// # Errors
    /// [`ProduceError::Job`] if the value has another type.
    pub fn get<T: DeserializeOwned>(&self, key: &str) -> Result<Option<T>, ProduceError> {
        value(&self.0, key).map_err(refused)
    }

    /// Returns a table of a command, if it is given.
    pub fn table(&self, name: &str) -> Option<&Map<String, Value>> {
        self.0.get(name).filter(|_| TABLES.contains(&name)).and_then(Value::as_object)
    }

    /// Returns keys and tables as a TOML text.
    ///
    /// # Errors
    /// [`ProduceError::Job`] if a value cannot be written.
    pub fn to_toml(keys: &Map<String, Value>) -> Result<String, ProduceError> {
        toml(keys).map_err(refused)
    }

    /// Returns the parts of the model that are kept regardless of the scene.
    ///
    /// # Errors
    /// [`ProduceError::Job`] with the part that does not exist.
    pub fn full(&self) -> Result<Full, ProduceError> {
        full(&self.0).map_err(refused)
    }

    /// Returns `base` with the quality of `chosen`, or otherwise of an optimizer that is given by its name, or
    /// otherwise of the defaults.
    pub fn with_quality(&self, base: &Settings, chosen: Option<&Settings>) -> Settings {
        let is_adam = |settings: &Settings| matches!(settings.optimizer, Optimizer::Adam { .. });
        let named = self.named_optimizer().map(|name| match name {
            "adam" => Settings::adam(200, 8),
            _ => Settings::default(),
        });
        let quality = chosen.cloned().or_else(|| named.clone()).unwrap_or_default();
        let mut settings = base.with_quality_of(&quality);
        if let Some(named) = named.filter(|named| is_adam(named) != is_adam(&settings)) {
            (settings.optimizer, settings.diameters) = (named.optimizer, named.diameters);
        }
        settings
    }

    /// Returns `base` with all given keys over it.
    ///
    /// # Errors
    /// [`ProduceError::Job`] with the key that has a wrong value.
    pub fn over(&self, base: &Settings) -> Result<Settings, ProduceError> {
        let mut given = self.0.clone();
        let is_adam = matches!(base.optimizer, Optimizer::Adam { .. });
        if self.named_optimizer().is_some_and(|name| (name == "adam") == is_adam) {
            // The base has this optimizer with rates of its own.
            given.remove("optimizer");
        }
        solve_settings(base, &given).map_err(refused)
    }

    /// Returns the settings of refinements.
    ///
    /// # Errors
    /// [`ProduceError::Solve`] if they contradict themselves, and [`ProduceError::Job`] with the key that has a wrong
    /// value.
    pub fn refinement(&self) -> Result<RefineSettings, ProduceError> {
        let settings = refine_settings(&self.0).map_err(refused)?;
        settings.check()?;
        Ok(settings)
    }

    /// Returns a key of the table `refine` that belongs to live sessions. An example is `restart`, the jump in pupil
    /// diameters after which a refinement restarts.
    ///
    /// # Errors
    /// [`ProduceError::Job`] if the value has another type.
    pub fn of_sessions<T: DeserializeOwned>(&self, key: &str) -> Result<Option<T>, ProduceError> {
        let table = self.0.get("refine").and_then(Value::as_object);
        table.map_or(Ok(None), |table| value(table, key)).map_err(refused)
    }

    /// Returns all settings of a call as a TOML text that [`from_toml`](Self::from_toml) reads. The settings of the
    /// solve are omitted if there is none. The depths are omitted unless they are given, because the scene decides
    /// them.
    ///
    /// # Errors
    /// [`ProduceError::Job`] if a value cannot be written.
    pub fn effective(&self, solve: Option<&Settings>) -> Result<String, ProduceError> {
        let mut all = solve.map(keys_of).unwrap_or_default();
        if !self.has("depth") {
            all.remove("depth");
        }
        for key in ["contrast", "force", "full"] {
            all.extend(self.0.get(key).map(|value| (key.to_owned(), value.clone())));
        }
        let mut refine = keys_of(&self.refinement()?);
        refine.extend(self.of_sessions::<Value>("restart")?.map(|value| ("restart".to_owned(), value)));
        all.insert("refine".into(), Value::Object(refine));
        without_null(&mut all);
        toml(&all).map_err(refused)
    }

    fn named_optimizer(&self) -> Option<&str> {
        self.0.get("optimizer").and_then(Value::as_str)
    }
}

/// Returns true if a value is text without quotes, such as `adam`, `20ms` or `0,0,6`.
fn is_word(value: &str) -> bool {
    let begins = value.starts_with(|c: char| c.is_alphanumeric() || "-./".contains(c));
    begins && !value.contains(['\'', '"', '\n'])
}

/// Removes values that are not set, because TOML has no null.
fn without_null(keys: &mut Map<String, Value>) {
    keys.retain(|_, value| !value.is_null());
    keys.values_mut().filter_map(Value::as_object_mut).for_each(without_null);
}

/// Converts a text with a unit to a number, also in a list.
fn in_number(key: &str, value: &Value, focal_length: f64) -> Result<Value, Reason> {
    let number = |text: &str| match key {
        "seconds" => Quantity::read_with_unit(text, S, &[]).map(|time| time.value_in(S)),
        "diameter" => Quantity::read_with_unit(text, M, &[]).map(|length| length.value_in(M)),
        _ => Depth::read_with_unit(text).map(|depth| depth.metres(focal_length)),
    };
    match value {
        Value::String(text) => number(text).map(Value::from).map_err(|error| Reason::of(&error)),
        Value::Array(each) => {
            let each = each.iter().map(|one| in_number(key, one, focal_length));
            each.collect::<Result<_, _>>().map(Value::Array)
        }
        value => Ok(value.clone()),
    }
}

fn refused(reason: Reason) -> ProduceError {
    ProduceError::Job(reason.within("the settings"))
}

fn value<T: DeserializeOwned>(given: &Map<String, Value>, key: &str) -> Result<Option<T>, Reason> {
    given.get(key).map(|v| T::deserialize(v).map_err(|e| reason!("value", "{key}: {e}"))).transpose()
}

fn full(given: &Map<String, Value>) -> Result<Full, Reason> {
    let names = match given.get("full") {
        Some(Value::String(names)) => names.split(',').map(|name| name.trim().to_owned()).collect(),
        _ => value::<Vec<String>>(given, "full")?.unwrap_or_default(),
    };
    let mut full = Full::default();
    match names.iter().find(|name| !full.keep(name)) {
        Some(wrong) => Err(reason!("value", "full: no part {wrong}. The parts are all, {}", Full::PARTS.join(", "))),
        None => Ok(full),
    }
}

/// Puts the keys of a solve over its settings.
fn solve_settings(base: &Settings, given: &Map<String, Value>) -> Result<Settings, Reason> {
    let mut whole = keys_of(base);
    // Files omit these at their defaults.
    let left_out = Settings {
        repeats: 2,
        views: 2,
        pixel: 2,
        padding: PaddingRule::Need,
        first_phases: FirstPhases::Random,
        joint: Some(Joint::default()),
        all_modes: true,
        ..Settings::default()
    };
    let left_out = keys_of(&left_out);
    let known = || left_out.keys().map(String::as_str).chain(BESIDE).chain(TABLES);
    if let Some(key) = given.keys().find(|key| known().all(|known| known != &key[..])) {
        let known: Vec<&str> = known().collect();
        return Err(reason!("no-such-setting", "{key}: no such setting. The settings are {}", known.join(", ")));
    }
    for (key, value) in left_out {
        if given.contains_key(&key) {
            whole.entry(key).or_insert(value);
        }
    }
    overlay(whole, &[&BESIDE[..], &TABLES[..]].concat(), given)
}

fn refine_settings(given: &Map<String, Value>) -> Result<RefineSettings, Reason> {
    match given.get("refine") {
        None => Ok(RefineSettings::default()),
        Some(Value::Object(table)) => {
            RefineSettings::over(&OF_SESSIONS, table).map_err(|reason| reason.within("refine"))
        }
        Some(_) => Err(reason!("value", "refine: not a table, such as refine.pupils = 4")),
    }
}

impl SceneJob<'_> {
    /// Takes the settings of a TOML text ([`GivenSettings`]). They replace the built-in settings of its `quality`, or
    /// otherwise the defaults. Complex fields are stored as `engine` prefers.
    ///
    /// # Errors
    /// [`ProduceError::Job`] with the key that is unknown or has a wrong value.
    pub fn take_settings(&mut self, text: &str, engine: &dyn Engine) -> Result<(), ProduceError> {
        let given = GivenSettings::from_toml(text)?.before(self.display.focal_length)?;
        let chosen = given.get::<Quality>("quality")?.map(Settings::of);
        let mut base = given.with_quality(&Settings::default(), chosen.as_ref());
        if chosen.is_none() {
            base.storage = engine.preferred_storage().for_levels(self.display.levels as usize);
        }
        self.settings = given.over(&base)?;
        self.settings.check()?;
        (self.reading.depth, self.diameter, self.force) = (None, None, false);
        self.take_own(&given)
    }

    /// Takes the keys that are fields of the job itself, such as depths and diameters.
    ///
    /// # Errors
    /// [`ProduceError::Job`] with the key that has a wrong value.
    pub fn take_own(&mut self, given: &GivenSettings) -> Result<(), ProduceError> {
        self.reading.depth = self.reading.depth.or(given.get("depth")?);
        self.diameter = self.diameter.or(given.get("diameter")?);
        self.contrast = given.get("contrast")?;
        self.force |= given.get("force")?.unwrap_or(false);
        self.full = given.full()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::optics::{Display, WindowFactor};
    use crate::solve::{Diameters, Sequence, Strategy};
    use eyebox_base::error::ErrorData;

    #[test]
    fn what_is_said_lies_over_what_is_by_default() {
        let display = Display::preset("small").unwrap();
        let mut job = SceneJob::new("builtin:plane", &display);
        let mut take = |text: &str| job.take_settings(text, &CpuEngine::new()).map(|()| job.clone());
        assert_eq!(take("").unwrap().settings, Settings::default());
        let said = take("steps = 7\nseconds = 2\nviews = 2\ndepth = [-1e-3, 2e-3]\nforce = true").unwrap();
        let Settings { steps, seconds, views, pupils, .. } = said.settings;
        assert_eq!((steps, seconds, views, pupils), (7, Some(2.0), 2, 16));
        assert_eq!((said.reading.depth, said.diameter, said.force), (Some([-1e-3, 2e-3]), None, true));
        let fast = take("quality = \"fast\"\npupils = 3").unwrap();
        assert_eq!((fast.settings.steps, fast.settings.pupils, fast.reading.depth), (40, 3, None));
        assert_eq!(fast.settings.optimizer, Optimizer::momentum());
        let units = "seconds = '2s'\ndiameter = ['2mm', 4e-3]\ndepth = ['-1mm', '0.5D']";
        let same =
            format!("seconds = 2\ndiameter = [2e-3, 4e-3]\ndepth = [-1e-3, {}]", 0.5 * display.focal_length.powi(2));
        assert_eq!(take(units).unwrap().settings, take(&same).unwrap().settings);
        for (text, code) in [("seconds = '2mm'", "other-dimension"), ("diameter = ['2', 3]", "no-unit")] {
            assert_eq!(ErrorData::of(&take(text).unwrap_err()).code, format!("job/{code}"));
        }
        let adam = take("optimizer = \"adam\"").unwrap().settings;
        assert_eq!((adam.optimizer, adam.steps, adam.pupils), (Optimizer::adam(), 200, 8));
        let part = take("optimizer.momentum = 0.25\nwindow = 2\nlevels = 2\nfull = [\"views\"]").unwrap();
        let Settings { optimizer, window, levels, .. } = &part.settings;
        assert!(matches!(optimizer, Optimizer::Projection { momentum: 0.25, gain: [2.5, 0.3], .. }), "{optimizer:?}");
        assert_eq!((*window, levels.count(), part.full.views), (WindowFactor::Two, 2, true));
        assert_eq!(take("first_phases = \"random\"").unwrap().settings.first_phases, FirstPhases::Random);
        for (text, code, names) in [
            ("stpes = 3", "job/no-such-setting", "stpes"),
            ("steps = \"many\"", "job/value", "steps"),
            ("depth = [1, 2, 3]", "job/value", "depth"),
            ("psnr = nan", "job/not-finite", "psnr"),
            ("quality = \"good\"", "job/value", "quality"),
            ("frames = 0", "solve/setting", "0"),
            ("steps = ", "job/toml", "1"),
            ("full = \"most\"", "job/value", "most"),
            ("refine.gain = 3", "job/no-such-setting", "gain"),
        ] {
            let error = take(text).unwrap_err();
            assert_eq!(ErrorData::of(&error).code, code, "{text}: {error}");
            assert!(error.to_string().contains(names), "{text}: {error}");
        }
    }

    #[test]
    fn one_setting_replaces_what_was_given_before() {
        let mut given = GivenSettings::from_toml("steps = 4\nrefine.pupils = 3").unwrap();
        for one in [
            "steps=9",
            "sequence = random",
            "refine.strategy=adam",
            "refine.restart=2",
            "diameters=log",
            "efficiency=0.5",
        ] {
            given.set(one).unwrap();
        }
        let settings = given.over(&Settings::default()).unwrap();
        assert_eq!((settings.steps, settings.sequence, settings.efficiency), (9, Sequence::Random, Some(0.5)));
        assert_eq!(settings.diameters, Diameters::LogUniform);
        let refinement = given.refinement().unwrap();
        assert_eq!((refinement.pupils, refinement.strategy), (3, Strategy::Adam { rate: 0.05 }));
        assert_eq!(given.of_sessions::<f64>("restart").unwrap(), Some(2.0));
        for wrong in ["steps", "steps=", "=3", "stpes=3", "steps=few", "refine=3", "refine.gian=1", "psnr=nan"] {
            assert!(matches!(given.set(wrong), Err(ProduceError::Job(_))), "{wrong}");
        }
        assert_eq!(given.over(&Settings::default()).unwrap(), settings);
    }
}
