//! Arguments that the commands which steer share.

use crate::values::{RAD, not_negative, positive, positive_in, power, share, storage, window};
use clap::{Args, ValueEnum};
use eyebox::low_level::optics::WindowFactor;
use eyebox::low_level::plan::Storage;
use eyebox::low_level::session::Policy;
use eyebox::low_level::solve::{RefineSettings, Strategy};

/// How the phases follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum StrategyName {
    /// Pupil-wise projection
    Projection,
    /// Gradient descent with Adam
    Adam,
}

/// How a hologram follows the eye.
#[derive(Args, Clone)]
pub struct SteeringArgs {
    /// Pupils around the eye a step
    #[arg(help_heading = "Pupils", long, default_value_t = RefineSettings::default().pupils, value_name = "B")]
    pub pupils: usize,
    /// Pupils anywhere in the eyebox a step, on average
    #[arg(help_heading = "Pupils", long, default_value_t = RefineSettings::default().elsewhere, value_name = "N", value_parser = not_negative)]
    pub elsewhere: f64,
    /// Steps over the same pupils, whose photographs are made once
    #[arg(help_heading = "Pupils", long, default_value_t = RefineSettings::default().repeats, value_name = "N")]
    pub repeats: usize,
    /// Spectrum per pupil: 1 or 2 times the pupil, or all of it
    #[arg(help_heading = "Quality", long, value_parser = window, default_value = "2", value_name = "1|2|full")]
    pub window: WindowFactor,
    /// How the phases follow
    #[arg(help_heading = "Steps", long, value_enum, default_value = "projection")]
    pub strategy: StrategyName,
    /// Gain of the projection's first step
    #[arg(help_heading = "Steps", long, default_value_t = 3.0, value_name = "G", value_parser = positive)]
    pub gain: f64,
    /// Its gain many steps later
    #[arg(help_heading = "Steps", long, default_value_t = 1.0, value_name = "G", value_parser = positive)]
    pub settled_gain: f64,
    /// Steps in which the difference of the two falls to 1/e
    #[arg(help_heading = "Steps", long, default_value_t = 8.0, value_name = "N", value_parser = positive)]
    pub settling: f64,
    /// Share of the projection's velocity that is kept
    #[arg(help_heading = "Steps", long, default_value_t = 0.5, value_name = "SHARE", value_parser = share)]
    pub momentum: f64,
    /// The projection's change is divided by the overlap to this power
    #[arg(help_heading = "Steps", long, default_value_t = 1.0, value_name = "P", value_parser = power)]
    pub overlap_power: f64,
    /// Adam's rate, radians
    #[arg(help_heading = "Steps", long, default_value_t = 0.05, value_name = "R", value_parser = positive_in(RAD))]
    pub adam_rate: f64,
    /// How complex fields are stored; fp16 is for comparison only on the CPU [default: fp16 on a GPU, else fp32]
    #[arg(help_heading = "Quality", long, value_parser = storage, value_name = "fp32|fp16")]
    pub storage: Option<Storage>,
    /// Decides the pupils
    #[arg(help_heading = "Steps", long, default_value_t = 0, value_name = "S")]
    pub seed: u64,
}

impl SteeringArgs {
    /// What they mean.
    pub fn steering(&self) -> RefineSettings {
        let Self { gain, settled_gain: settled, settling, momentum, overlap_power, .. } = *self;
        let strategy = match self.strategy {
            StrategyName::Projection => Strategy::Projection { gain, settled, settling, momentum, overlap_power },
            StrategyName::Adam => Strategy::Adam { rate: self.adam_rate },
        };
        let Self { pupils, elsewhere, window, repeats, storage, seed, .. } = *self;
        RefineSettings { strategy, pupils, elsewhere, window, repeats, storage, seed }
    }
}

/// When it begins again, besides.
#[derive(Args, Clone)]
pub struct PolicyArgs {
    /// Steering
    #[command(flatten)]
    pub steering: SteeringArgs,
    /// Begin again with the hologram for the whole eyebox after a jump of so many pupil diameters; inf for never
    #[arg(help_heading = "Steps", long, default_value_t = Policy::default().restart, value_name = "DIAMETERS", value_parser = restart)]
    pub restart: f64,
}

impl PolicyArgs {
    /// What they mean.
    pub fn policy(&self) -> Policy {
        Policy { restart: self.restart, steering: self.steering.steering() }
    }
}

fn restart(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value >= 0.0 => Ok(value),
        _ => Err("a number of diameters, 0 or more, or inf".into()),
    }
}
