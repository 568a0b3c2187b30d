//! The settings of a refinement, also as TOML text.

use super::error::{SolveError, require};
use super::step::Update;
use crate::files::overlay::{keys, keys_of, overlay};
use crate::optics::WindowFactor;
use crate::plan::{Purpose, Storage};
use eyebox_base::error::Reason;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

/// The optimizer of a refinement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
#[non_exhaustive]
pub enum Strategy {
    /// The pupil-wise projection (OPTICS 6b).
    Projection {
        /// Gain of the first step after a jump.
        gain: f64,
        /// Gain of steps long after a jump.
        settled: f64,
        /// Number of steps in which the difference between both gains falls to 1/e.
        settling: f64,
        /// Share of the velocity that each step keeps.
        momentum: f64,
        /// Exponent of the overlap by which the change is divided.
        overlap_power: f64,
    },
    /// Adam on the closed-form Wirtinger gradient (OPTICS 4).
    Adam {
        /// Learning rate in radians.
        rate: f64,
    },
}

impl Strategy {
    /// Returns the projection as tuned on several scenes.
    pub const fn projection() -> Self {
        Self::Projection { gain: 3.0, settled: 1.0, settling: 8.0, momentum: 0.5, overlap_power: 1.0 }
    }

    /// Returns Adam at the rate that suits most scenes.
    pub const fn adam() -> Self {
        Self::Adam { rate: 0.05 }
    }

    /// Returns an error for values that make phases which are not finite.
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

    /// Returns the purpose of the engine's buffers.
    pub(super) fn purpose(self) -> Purpose {
        if matches!(self, Self::Adam { .. }) { Purpose::Adam } else { Purpose::Project }
    }

    /// Returns the update of the `step`-th step since new phases or a new aim, from 1.
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
    /// The optimizer. A file may contain its name alone.
    #[serde(deserialize_with = "strategy")]
    pub strategy: Strategy,
    /// Pupils around the eye per step.
    pub pupils: usize,
    /// Average number of pupils over the whole eyebox per step.
    pub elsewhere: f64,
    /// The spectral window of each pupil.
    #[serde(deserialize_with = "super::settings::window")]
    pub window: WindowFactor,
    /// Steps over the same pupils before others are drawn. Their target images are made once. At least 1.
    pub repeats: usize,
    /// Storage of complex fields. `None` uses what the engine [prefers](crate::engine::Engine::preferred_storage). A
    /// refined hologram is 20 to 40 dB from its target, which hides the error of halves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub storage: Option<Storage>,
    /// Seed of the pupils.
    pub seed: u64,
}

impl RefineSettings {
    /// Returns an error for invalid values.
    pub fn check(&self) -> Result<(), SolveError> {
        require((1..=4096).contains(&self.pupils), "the number of pupils per step", self.pupils, "1 to 4096")?;
        require((0.0..=64.0).contains(&self.elsewhere), "the pupils elsewhere per step", self.elsewhere, "0 to 64")?;
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
    /// Reads a TOML text with the names of the fields over the defaults.
    ///
    /// # Errors
    /// [`SolveError::Text`] with an unknown key or a key with a wrong value, and [`SolveError::Setting`].
    pub fn from_toml(text: &str) -> Result<Self, SolveError> {
        let settings = keys(text).and_then(|given| Self::over(&[], &given)).map_err(SolveError::Text)?;
        settings.check()?;
        Ok(settings)
    }

    /// Returns the defaults with the given keys over them, without the keys of `beside`.
    ///
    /// # Errors
    /// The reason names an unknown key or a key with a wrong value.
    pub(crate) fn over(beside: &[&str], given: &Map<String, Value>) -> Result<Self, Reason> {
        let mut whole = keys_of(&Self::default());
        if given.contains_key("storage") {
            whole.insert("storage".into(), Value::Null);
        }
        overlay(whole, beside, given)
    }
}

/// Reads a strategy or its name alone.
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
