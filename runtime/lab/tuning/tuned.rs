//! Defines the results of a tuning as plain data for its page, its tables and its JSON.

use super::{Measured, Recommended, Trial, front, recommend, short_of};
use eyebox::low_level::optics::Color;
use serde::{Deserialize, Serialize};

/// The largest allowed distance of a setting of another run from the front, in dB.
pub const NEAR_DB: f64 = 0.3;

/// All results of a tuning.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Tuned {
    /// The version of eyebox.
    pub version: String,
    /// The description of the engine.
    pub device: String,
    /// The name of the scene.
    pub scene: String,
    /// The color of the scene that was tuned.
    pub color: Color,
    /// The name of the display.
    pub display: String,
    /// Rows and columns of the SLM.
    pub size: [usize; 2],
    /// The number of shown sub-frames.
    pub frames: usize,
    /// The number of phase levels for the score. `None` if the SLM has so many that they have no effect.
    pub slm_levels: Option<usize>,
    /// The seed of the pupils that score.
    pub seed: u64,
    /// The mean and the worst PSNR, in dB, that any hologram can reach through the pupils of the score. `None` if it is
    /// unknown, or if diffraction takes nothing.
    #[serde(default)]
    pub ceiling: Option<[f64; 2]>,
    /// The allowed seconds over all runs into this folder.
    pub budget_s: f64,
    /// The spent seconds over all runs into this folder.
    pub spent_s: f64,
    /// True if the tuning was stopped before its end.
    pub interrupted: bool,
    /// Fast, balanced and accurate, in this order.
    pub recommended: Vec<Recommended>,
    /// All trials in the order of their measurement.
    pub trials: Vec<Trial>,
    /// Levels of the SLM, by rounding and by optimization.
    pub levels: Vec<LevelRow>,
    /// The recipe whose phases were rounded to levels.
    pub levels_recipe: String,
    /// The settings of another run.
    pub check: Vec<Checked>,
}

/// The results for one number of levels.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LevelRow {
    /// The number of phase levels.
    pub levels: usize,
    /// The mean and the worst PSNR, in dB, of phases without levels on an SLM without levels.
    pub free: [f64; 2],
    /// The scores of the same phases, each rounded to its nearest level.
    pub after: [f64; 2],
    /// The scores of phases that were optimized for the levels.
    pub optimised: [f64; 2],
    /// The milliseconds of the solves without and with levels.
    pub milliseconds: [f64; 2],
}

/// A setting of another run, measured here.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Checked {
    /// The setting with its recommendation there and its measurement here.
    pub setting: Recommended,
    /// The mean PSNR in the other run, in dB.
    pub mean_there: f64,
    /// The difference to the best trial here that costs no more, in dB. `None` if it was not measured.
    pub short_db: Option<f64>,
}

impl Checked {
    /// Makes an unmeasured entry for a setting of another run.
    pub fn new(setting: &Recommended) -> Self {
        Self { setting: setting.clone(), mean_there: setting.trial.mean, short_db: None }
    }

    /// Returns true if the setting is on the front or near it.
    pub fn holds(&self) -> bool {
        self.short_db.is_some_and(|db| db <= NEAR_DB)
    }
}

impl Tuned {
    /// Returns the front of mean PSNR against time.
    pub(crate) fn by_mean(&self) -> Vec<&Trial> {
        front(&self.trials, |t| t.milliseconds, |t| t.mean)
    }

    /// Returns the front of the worst pupil against time.
    pub fn by_worst(&self) -> Vec<&Trial> {
        front(&self.trials, |t| t.milliseconds, |t| t.worst)
    }

    /// Returns the front of mean PSNR against memory.
    pub fn by_memory(&self) -> Vec<&Trial> {
        front(&self.trials, |t| t.bytes as f64, |t| t.mean)
    }

    /// Returns the front of mean JOD against time.
    pub fn by_jod(&self) -> Vec<&Trial> {
        front(&self.trials, |t| t.milliseconds, |t| t.jod.map_or(f64::NAN, |[mean, _]| mean))
    }

    /// Chooses the three recommended trials, and compares the settings of another run with the trials here.
    pub fn settle(&mut self) {
        self.recommended = recommend(&self.trials).map(Vec::from).unwrap_or_default();
        for checked in &mut self.check {
            if let Some(now) = self.trials.iter().find(|t| t.recipe == checked.setting.trial.recipe) {
                checked.setting.trial = now.clone();
                checked.short_db = Some(short_of(&self.trials, now.milliseconds, now.mean));
            }
        }
    }

    /// Returns the recommended trials for this device's file of measured settings. Returns `None` if a trial does not
    /// meet the conditions of its name.
    pub fn measured(&self) -> Option<Measured> {
        let all_met = self.recommended.iter().all(|r| r.met) && !self.recommended.is_empty();
        all_met.then(|| Measured {
            device: self.device.clone(),
            scene: self.scene.clone(),
            color: self.color,
            size: self.size,
            frames: self.frames,
            recommended: self.recommended.clone(),
            front: self.by_mean().into_iter().cloned().collect(),
        })
    }
}
