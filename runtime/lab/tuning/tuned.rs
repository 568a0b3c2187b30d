//! What a tuning found, as plain data: what its page, its tables and its JSON are made from.

use super::{Measured, Recommended, Trial, front, recommend, short_of};
use eyebox::low_level::optics::Color;
use serde::{Deserialize, Serialize};

/// How much worse than the front a setting of another run may be, dB.
pub const NEAR_DB: f64 = 0.3;

/// Everything that a tuning found.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Tuned {
    /// Version of eyebox.
    pub version: String,
    /// The engine, as it describes itself.
    pub device: String,
    /// The scene's name.
    pub scene: String,
    /// Which of its colours.
    pub color: Color,
    /// The display's name.
    pub display: String,
    /// Rows and columns.
    pub size: [usize; 2],
    /// Sub-frames shown.
    pub frames: usize,
    /// Phase levels that the SLM is judged with; none where they are so many that they do not matter.
    pub slm_levels: Option<usize>,
    /// The seed.
    pub seed: u64,
    /// Mean and worst dB that any hologram could have through the pupils of the score; none where it is not known, or
    /// diffraction takes nothing.
    #[serde(default)]
    pub ceiling: Option<[f64; 2]>,
    /// Seconds that it might take, and took, over all runs into this folder.
    pub budget_s: f64,
    /// See `budget_s`.
    pub spent_s: f64,
    /// Whether it was stopped before its end.
    pub interrupted: bool,
    /// Fast, balanced, accurate.
    pub recommended: Vec<Recommended>,
    /// Every trial, in the order in which they were made.
    pub trials: Vec<Trial>,
    /// Levels of the SLM, after the fact and optimised for.
    pub levels: Vec<LevelRow>,
    /// The recipe whose phases were put on levels.
    pub levels_recipe: String,
    /// Settings of another run.
    pub check: Vec<Checked>,
}

/// One number of levels.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LevelRow {
    /// How many.
    pub levels: usize,
    /// Mean and worst dB of phases that know nothing of levels, as an SLM without levels would show them.
    pub free: [f64; 2],
    /// The same phases, each on its nearest level.
    pub after: [f64; 2],
    /// Phases that were optimised for the levels.
    pub optimised: [f64; 2],
    /// Milliseconds of the solves: free, optimised.
    pub milliseconds: [f64; 2],
}

/// A setting of another run, measured here.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Checked {
    /// What it was recommended as there, and measured here.
    pub setting: Recommended,
    /// Mean dB that it had there.
    pub mean_there: f64,
    /// Decibels below the best that costs no more here; none where it was not measured.
    pub short_db: Option<f64>,
}

impl Checked {
    /// Of another run.
    pub fn new(setting: &Recommended) -> Self {
        Self { setting: setting.clone(), mean_there: setting.trial.mean, short_db: None }
    }

    /// Whether it is on the front, or near it.
    pub fn holds(&self) -> bool {
        self.short_db.is_some_and(|db| db <= NEAR_DB)
    }
}

impl Tuned {
    /// Mean PSNR against time: what none beats.
    pub(crate) fn by_mean(&self) -> Vec<&Trial> {
        front(&self.trials, |t| t.milliseconds, |t| t.mean)
    }

    /// The worst pupil against time.
    pub fn by_worst(&self) -> Vec<&Trial> {
        front(&self.trials, |t| t.milliseconds, |t| t.worst)
    }

    /// Mean PSNR against memory.
    pub fn by_memory(&self) -> Vec<&Trial> {
        front(&self.trials, |t| t.bytes as f64, |t| t.mean)
    }

    /// Mean JOD against time.
    pub fn by_jod(&self) -> Vec<&Trial> {
        front(&self.trials, |t| t.milliseconds, |t| t.jod.map_or(f64::NAN, |[mean, _]| mean))
    }

    /// Chooses the three, and says how the settings of another run stand here.
    pub fn settle(&mut self) {
        self.recommended = recommend(&self.trials).map(Vec::from).unwrap_or_default();
        for checked in &mut self.check {
            if let Some(now) = self.trials.iter().find(|t| t.recipe == checked.setting.trial.recipe) {
                checked.setting.trial = now.clone();
                checked.short_db = Some(short_of(&self.trials, now.milliseconds, now.mean));
            }
        }
    }

    /// What is recommended, for this device's file of measured settings; nothing where a trial is not what it promises.
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
