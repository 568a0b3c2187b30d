//! `--quality` and `--deadline`: from what a user asks to settings, by what was measured on this device or as built in.

use crate::Failure;
use crate::values::{MS, Names, one_of, positive_in};
use clap::Args;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::files::cache_folder;
use eyebox::low_level::produce::GivenSettings;
use eyebox::low_level::quality::Quality;
use eyebox::low_level::reason;
use eyebox::low_level::solve::Settings;
use eyebox_lab::tuning::{Measured, within};

/// How much time quality may take, in every command that solves.
#[derive(Args, Clone, Copy)]
pub struct QualityArgs {
    /// Settings of this quality: as `eyebox tradeoff` measured them on this device, else built in; settings that are given
    /// themselves win
    #[arg(help_heading = "Quality", long, value_parser = one_of(&QUALITIES), value_name = "NAME")]
    pub quality: Option<Quality>,
    /// The best settings that `eyebox tradeoff` measured on this device whose solve takes at most so many ms, shared by the
    /// colours; time is taken to follow pixels x log2(pixels) and sub-frames
    #[arg(help_heading = "Quality", long, value_name = "MS", value_parser = positive_in(MS), conflicts_with = "quality")]
    pub deadline: Option<f64>,
}

/// How much time quality may take.
const QUALITIES: Names<Quality, 3> = [
    ("fast", "At least twenty times faster than accurate", Quality::Fast),
    ("balanced", "Within half a decibel of accurate, in a fifth of its time", Quality::Balanced),
    ("accurate", "The best", Quality::Accurate),
];

/// Settings that were asked for by quality or deadline, and what is to be said of them.
pub struct Chosen {
    /// The settings.
    pub settings: Settings,
    /// Where they are from.
    pub about: String,
}

impl QualityArgs {
    /// Returns these, or the quality of the settings if neither option is given.
    pub fn with(self, given: &GivenSettings) -> Result<Self, Failure> {
        let quality = if self.deadline.is_some() { None } else { given.get("quality")? };
        Ok(Self { quality: self.quality.or(quality), ..self })
    }

    /// What was asked for; nothing where nothing was. `size` and `frames` are those of the solve, `colors` how many share
    /// the deadline.
    pub fn choose(
        &self,
        engine: &dyn Engine,
        size: [usize; 2],
        frames: usize,
        colors: usize,
    ) -> Result<Option<Chosen>, Failure> {
        if self.quality.is_none() && self.deadline.is_none() {
            return Ok(None);
        }
        let device = engine.describe();
        // Without a cache of theirs, users have measured nothing.
        let measured = cache_folder().map_or(Ok(None), |folder| Measured::load(&folder, &device));
        let measured = measured.unwrap_or_else(|error| {
            eprintln!("eyebox: measured settings are ignored: {error}");
            None
        });
        let expected = |m: &Measured, ms: f64| {
            format!("measured with {} on this device, about {:.0} ms a colour", m.scene, ms * m.scale(size, frames))
        };
        if let Some(quality) = self.quality {
            let (settings, from) = match &measured {
                Some(m) => (m.of(quality).recipe.clone(), expected(m, m.of(quality).milliseconds)),
                None => (Settings::of(quality), "built in; `eyebox tradeoff SCENE -o DIR` measures this device".into()),
            };
            let about = format!("{}: {settings} ({from})", quality.name());
            return Ok(Some(Chosen { settings, about }));
        }
        let Some(deadline) = self.deadline else { return Ok(None) };
        let Some(measured) = measured else {
            return Err(Failure::Arguments(reason!(
                "nothing-measured",
                "--deadline {deadline}: nothing was measured on {device}: run `eyebox tradeoff SCENE -o DIR` first, or stop by the clock with --seconds"
            )));
        };
        let scale = measured.scale(size, frames);
        let share = deadline / colors.max(1) as f64;
        let Some(trial) = within(&measured.front, share, scale) else {
            let least = measured.front.iter().map(|t| t.milliseconds).fold(f64::INFINITY, f64::min);
            let least = (least * scale * colors.max(1) as f64).ceil();
            return Err(Failure::Arguments(reason!(
                "deadline",
                "--deadline {deadline}: the fastest that was measured takes {least} ms for {colors} of {} x {} pixels with {frames} sub-frames on {device}",
                size[0],
                size[1]
            )));
        };
        let from = expected(&measured, trial.milliseconds);
        let about = format!("deadline {deadline} ms: {} ({from})", trial.recipe);
        Ok(Some(Chosen { settings: trial.recipe.clone(), about }))
    }
}
