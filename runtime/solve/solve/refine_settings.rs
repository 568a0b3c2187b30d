//! The settings of a refinement, and the same as text.

use super::error::{SolveError, require};
use super::step::Update;
use crate::files::overlay::{keys, keys_of, overlay};
use crate::optics::WindowFactor;
use crate::plan::{Purpose, Storage};
use eyebox_base::error::Reason;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

/// How the phases follow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
#[non_exhaustive]
pub enum Strategy {
    /// Pupil-wise projection (OPTICS 6b).
    Projection {
        /// Gain of the first step after a jump,
        gain: f64,
        /// and of steps long after it:
        settled: f64,
        /// the difference falls to 1/e in so many steps.
        settling: f64,
        /// Share of the velocity that is kept.
        momentum: f64,
        /// The change is divided by the overlap to this power.
        overlap_power: f64,
    },
    /// Adam on the closed-form gradient (OPTICS 4).
    Adam {
        /// Learning rate, radians.
        rate: f64,
    },
}

impl Strategy {
    /// The projection as tuned on several scenes.
    pub const fn projection() -> Self {
        Self::Projection { gain: 3.0, settled: 1.0, settling: 8.0, momentum: 0.5, overlap_power: 1.0 }
    }

    /// Adam at the rate that suits most scenes.
    pub const fn adam() -> Self {
        Self::Adam { rate: 0.05 }
    }

    /// Refuses what only makes phases that are no numbers.
    fn check(self) -> Result<(), SolveError> {
        let gains = 0.0..=1e6;
        match self {
            Self::Projection { gain, settled, settling, momentum, overlap_power } => {
                let gain = if gains.contains(&gain) { settled } else { gain };
                require(gains.contains(&gain), "a gain", gain, "0 to 1e6")?;
                let right = "0 to 1, the share of the velocity that is kept";
                require((0.0..=1.0).contains(&momentum), "the momentum", momentum, right)?;
                require((0.0..=16.0).contains(&overlap_power), "the power of the overlap", overlap_power, "0 to 16")?;
                require(!settling.is_nan(), "the steps to settle in", settling, "a number")
            }
            Self::Adam { rate } => require(gains.contains(&rate), "Adam's rate (rad)", rate, "0 to 1e6"),
        }
    }

    /// What its steps are for.
    pub(super) fn purpose(self) -> Purpose {
        if matches!(self, Self::Adam { .. }) { Purpose::Adam } else { Purpose::Project }
    }

    /// The `step`-th step since phases or aim were set anew, from 1.
    pub(super) fn update(self, step: usize) -> Update {
        match self {
            Self::Projection { gain, settled, settling, momentum, overlap_power } => {
                let fresh = (-((step - 1) as f64) / settling.max(1e-3)).exp();
                Update::Projection { gain: settled + (gain - settled) * fresh, momentum, overlap_power }
            }
            Self::Adam { rate } => Update::Adam { rate, amplitude: false, step },
        }
    }
}

/// Everything that decides a refinement, besides the scene and the aim.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RefineSettings {
    /// How the phases follow. A file may name it alone.
    #[serde(deserialize_with = "strategy")]
    pub strategy: Strategy,
    /// Pupils around the eye a step.
    pub pupils: usize,
    /// Pupils over the whole eyebox a step, on average.
    pub elsewhere: f64,
    /// Window per pupil.
    #[serde(deserialize_with = "super::settings::window")]
    pub window: WindowFactor,
    /// Steps over the same pupils before others are drawn: their photographs are made once. At least 1.
    pub repeats: usize,
    /// How complex fields are stored; none for what the engine [prefers](crate::engine::Engine::preferred_storage): a refined hologram is 20
    /// to 40 dB from its target, which hides what halves cost.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub storage: Option<Storage>,
    /// Decides the pupils.
    pub seed: u64,
}

impl RefineSettings {
    /// Refuses what cannot be.
    pub fn check(&self) -> Result<(), SolveError> {
        require((1..=4096).contains(&self.pupils), "the number of pupils a step", self.pupils, "1 to 4096")?;
        require((0.0..=64.0).contains(&self.elsewhere), "the pupils elsewhere a step", self.elsewhere, "0 to 64")?;
        self.strategy.check()
    }
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self {
            strategy: Strategy::projection(),
            pupils: 2,
            elsewhere: 0.5,
            window: WindowFactor::Two,
            repeats: 1,
            storage: None,
            seed: 0,
        }
    }
}

impl RefineSettings {
    /// The defaults with what a TOML text says by the names of the fields.
    ///
    /// # Errors
    /// [`SolveError::Text`] with the key that is not known or has no such value; [`SolveError::Setting`].
    pub fn from_toml(text: &str) -> Result<Self, SolveError> {
        let settings = keys(text).and_then(|given| Self::over(&[], &given)).map_err(SolveError::Text)?;
        settings.check()?;
        Ok(settings)
    }

    /// Returns the defaults with the given keys over them, but for those of `beside`.
    ///
    /// # Errors
    /// The key that is unknown or has no such value.
    pub(crate) fn over(beside: &[&str], given: &Map<String, Value>) -> Result<Self, Reason> {
        let mut whole = keys_of(&Self::default());
        if given.contains_key("storage") {
            whole.insert("storage".into(), Value::Null);
        }
        overlay(whole, beside, given)
    }
}

/// A strategy, or its name alone.
fn strategy<'de, D: Deserializer<'de>>(from: D) -> Result<Strategy, D::Error> {
    super::settings::whole_or_name(from, Strategy::projection(), Strategy::adam())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_lies_over_what_is_by_default() {
        assert_eq!(RefineSettings::from_toml("").unwrap(), RefineSettings::default());
        let said = RefineSettings::from_toml("pupils = 3\nstorage = \"fp16\"").unwrap();
        assert_eq!(said, RefineSettings { pupils: 3, storage: Some(Storage::F16), ..RefineSettings::default() });
        let unknown = RefineSettings::from_toml("pupil = 3").unwrap_err();
        assert!(matches!(&unknown, SolveError::Text(reason) if reason.code() == "no-such-setting"), "{unknown}");
        let none = RefineSettings::from_toml("pupils = 0").unwrap_err();
        assert!(matches!(&none, SolveError::Setting { value, .. } if value == "0"), "{none}");
    }
}
