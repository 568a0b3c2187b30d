//! What was compared, on what.

use crate::evaluate::Job;
use eyebox::engine::Engine;
use eyebox::optics::{Color, Display};
use eyebox::solve::Settings;
use serde::Serialize;

/// What all results of a report have in common.
#[derive(Debug, Clone, Serialize)]
pub struct About {
    /// Version of eyebox.
    pub version: String,
    /// Name of the display.
    pub display: String,
    /// Rows and columns.
    pub size: [usize; 2],
    /// Pixel pitch, um.
    pub pitch_um: f64,
    /// Side of the eyebox that all colours serve, mm.
    pub eyebox_mm: f64,
    /// Colours.
    pub colors: Vec<Color>,
    /// Sub-frames that were compared.
    pub frames: Vec<usize>,
    /// Steps of every iterative method.
    pub steps: usize,
    /// Pupils a step.
    pub pupils: usize,
    /// Seed.
    pub seed: u64,
    /// What computed it.
    pub engine: String,
}

impl About {
    /// Of a job.
    pub fn new(job: &Job, engine: &dyn Engine) -> Self {
        Self::of(&job.display, &job.colors, &job.frames, &job.settings, engine)
    }

    /// Of its parts.
    pub fn of(display: &Display, colors: &[Color], frames: &[usize], settings: &Settings, engine: &dyn Engine) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            display: display.name.clone(),
            size: [display.height, display.width],
            pitch_um: display.pitch * 1e6,
            eyebox_mm: display.eyebox_min() * 1e3,
            colors: colors.to_vec(),
            frames: frames.to_vec(),
            steps: settings.steps,
            pupils: settings.pupils,
            seed: settings.seed,
            engine: engine.describe(),
        }
    }
}

/// A method, for people.
#[derive(Debug, Clone, Serialize)]
pub struct MethodAbout {
    /// The name by which results refer to it.
    pub name: String,
    /// What people call it.
    pub title: String,
    /// One sentence.
    pub about: String,
    /// Its paper, or where it was read from.
    pub citation: String,
}
