//! `--quality` chooses settings for a quality or a time, measured on this device or built in.

use crate::Failure;
use crate::values::{MS, Wrong, positive_in};
use clap::Args;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::files::cache_folder;
use eyebox::low_level::produce::GivenSettings;
use eyebox::low_level::quality::Quality;
use eyebox::low_level::reason;
use eyebox::low_level::solve::Settings;
use eyebox_lab::tuning::{Measured, within};

/// The quality or the time of a solve, in every command that solves.
#[derive(Args, Clone, Copy)]
pub struct QualityArgs {
    /// Quality (fast, balanced, accurate) or time of a solve, such as 20ms. Settings that `eyebox eval tune` measured
    /// on this device apply, otherwise built-in settings. Single settings win. The time is for all colors and grows
    /// with pixels x log2(pixels) and sub-frames
    #[arg(help_heading = "Quality", long, value_parser = asked, value_name = "NAME|MS")]
    pub quality: Option<AskedQuality>,
}

/// A quality by its name, or by the time of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AskedQuality {
    Named(Quality),
    /// The time of a solve of all colors, ms.
    Within(f64),
}

/// Reads a quality or a time.
fn asked(text: &str) -> Result<AskedQuality, Wrong> {
    match QUALITIES.into_iter().find(|quality| quality.name() == text) {
        Some(quality) => Ok(AskedQuality::Named(quality)),
        None if text.starts_with(|c: char| c.is_alphabetic()) => {
            Err("expected fast, balanced, accurate, or a time such as 20ms".into())
        }
        None => Ok(AskedQuality::Within(positive_in(MS)(text)?)),
    }
}

/// The names of qualities.
const QUALITIES: [Quality; 3] = [Quality::Fast, Quality::Balanced, Quality::Accurate];

/// Settings of a requested quality, with their description.
pub struct Chosen {
    pub settings: Settings,
    /// The settings and their origin in words.
    pub about: String,
}

impl QualityArgs {
    /// Returns these, or the quality of the settings if the option is not given.
    pub fn with(self, given: &GivenSettings) -> Result<Self, Failure> {
        let named = given.get("quality")?.map(AskedQuality::Named);
        Ok(Self { quality: self.quality.or(named) })
    }

    /// Returns the settings of the requested quality, if one is requested. `size` and `frames` belong to the solve, and
    /// `colors` is the number of colors that share its time.
    pub fn choose(
        &self,
        engine: &dyn Engine,
        size: [usize; 2],
        frames: usize,
        colors: usize,
    ) -> Result<Option<Chosen>, Failure> {
        let Some(quality) = self.quality else { return Ok(None) };
        let device = engine.describe();
        // Without a cache folder nothing was measured.
        let measured = cache_folder().map_or(Ok(None), |folder| Measured::load(&folder, &device));
        let measured = measured.unwrap_or_else(|error| {
            eprintln!("eyebox: measured settings are ignored: {error}");
            None
        });
        let expected = |m: &Measured, ms: f64| {
            format!("measured with {} on this device, about {:.0} ms per color", m.scene, ms * m.scale(size, frames))
        };
        let limit = match quality {
            AskedQuality::Within(limit) => limit,
            AskedQuality::Named(quality) => {
                let (settings, from) = match &measured {
                    Some(m) => (m.of(quality).recipe.clone(), expected(m, m.of(quality).milliseconds)),
                    None => (
                        Settings::of(quality),
                        "built in, while `eyebox eval tune SCENE -o DIR` measures this device".into(),
                    ),
                };
                let about = format!("{}: {settings} ({from})", quality.name());
                return Ok(Some(Chosen { settings, about }));
            }
        };
        let Some(measured) = measured else {
            return Err(Failure::Arguments(reason!(
                "nothing-measured",
                "--quality {limit}ms: nothing was measured on {device}. Run `eyebox eval tune SCENE -o DIR` first, or limit the time with --duration"
            )));
        };
        let scale = measured.scale(size, frames);
        let share = limit / colors.max(1) as f64;
        let Some(trial) = within(&measured.front, share, scale) else {
            let least = measured.front.iter().map(|t| t.milliseconds).fold(f64::INFINITY, f64::min);
            let least = (least * scale * colors.max(1) as f64).ceil();
            return Err(Failure::Arguments(reason!(
                "deadline",
                "--quality {limit}ms: the fastest measured settings take {least} ms for {colors} of {} x {} pixels with {frames} sub-frames on {device}",
                size[0],
                size[1]
            )));
        };
        let from = expected(&measured, trial.milliseconds);
        let about = format!("within {limit} ms: {} ({from})", trial.recipe);
        Ok(Some(Chosen { settings: trial.recipe.clone(), about }))
    }
}
