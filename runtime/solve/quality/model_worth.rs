//! Measures the gain of each term of a display model on a scene.
//!
//! The scene is solved with all terms, and with all but one, and each result is simulated through the whole model.

use super::{ColorJob, QualityError, Reference};
use crate::engine::Engine;
use crate::files::asked_to_end;
use crate::optics::{Color, Display, ModelTerms};
use crate::solve::{Flow, Settings};
use serde::Serialize;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Steps of each of these solves.
const STEPS: usize = 24;
/// Largest number of rows and columns of the display for the measurement.
const MOST: usize = 96;
/// Least gain of a term that is kept, in dB.
const SHOWS_DB: f64 = 0.05;
/// Least gain of further sub-pixels, in dB.
const SUBPIXELS_DB: f64 = 0.2;
/// Sub-pixels of the reference with which one and two of them are compared.
const TRUTH: usize = 3;

/// The gains of the terms of one color's model on a scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ModelWorth {
    /// The color of the model.
    pub color: Color,
    /// Rows and columns of the display on which it was measured.
    pub size: [usize; 2],
    /// Steps of each solve.
    pub steps: usize,
    /// Mean PSNR of the solve with every term, in dB.
    pub db: f64,
    /// Each term and the loss without it, in dB. NaN if there was no time to measure it.
    pub lost_db: Vec<(&'static str, f64)>,
    /// Gain of 2 x 2 sub-pixels over one, in dB. `None` if crosstalk has no effect, or if there was no time.
    pub subpixels_db: Option<f64>,
}

impl ModelWorth {
    /// Returns the SLM with fewer pixels for the measurement, by a whole number of times.
    pub fn display(display: &Display) -> Display {
        let fewer = display.height.max(display.width).div_ceil(MOST);
        let side = |n: usize| (n / fewer).max(1).next_multiple_of(2).min(n);
        Display { height: side(display.height), width: side(display.width), ..display.clone() }
    }

    /// Measures the gains for a `job` with a display from [`display`](Self::display).
    ///
    /// Values that are not measured within `limit`, or of a black scene, are NaN. The result is `None` if the display
    /// is ideal in this color.
    ///
    /// # Errors
    /// [`QualityError`] if a solve or a score fails.
    pub fn measure(job: &ColorJob, limit: Duration, engine: &mut dyn Engine) -> Result<Option<Self>, QualityError> {
        let (color, display) = (job.color, job.display);
        let terms = display.model(color).terms();
        if terms.is_empty() {
            return Ok(None);
        }
        let trials = Trials { job, end: Instant::now() + limit };
        let truth = trials.truth(display, engine)?;
        let db = trials.decibels(display, &truth, engine)?;
        let mut lost_db = Vec::with_capacity(terms.len());
        for term in terms {
            let without = display.with_model_of(color, |model| model.keep(&|name| name != term));
            lost_db.push((term, db - trials.decibels(&without, &truth, engine)?));
        }
        let shows = |(name, lost): &(&str, f64)| *name == "crosstalk" && *lost >= SHOWS_DB;
        let mut subpixels_db = None;
        if lost_db.iter().any(shows) {
            let on = |count| display.with_model_of(color, |model| model.subpixels = Some(count));
            let truth = trials.truth(&on(TRUTH), engine)?;
            let one = trials.decibels(&on(1), &truth, engine)?;
            subpixels_db = Some(trials.decibels(&on(2), &truth, engine)? - one).filter(|gain| gain.is_finite());
        }
        Ok(Some(Self { color, size: [display.height, display.width], steps: STEPS, db, lost_db, subpixels_db }))
    }

    /// Returns the terms with an effect and the terms that were not measured.
    pub fn kept(&self) -> Vec<&'static str> {
        self.lost_db.iter().filter(|(_, lost)| lost.is_nan() || *lost >= SHOWS_DB).map(|(term, _)| *term).collect()
    }

    /// Returns the number of sub-pixels that are worth their time, or `None` if it was not measured.
    pub fn subpixels(&self) -> Option<usize> {
        self.subpixels_db.map(|gain| if gain > SUBPIXELS_DB { 2 } else { 1 })
    }

    /// Keeps only the terms of the model that are worth their time.
    pub fn apply(&self, model: &mut ModelTerms) {
        let kept = self.kept();
        model.keep(&|name| kept.contains(&name));
        model.subpixels = self.subpixels().or(model.subpixels);
    }
}

/// Short solves for displays of different models, and their scores.
struct Trials<'a> {
    job: &'a ColorJob<'a>,
    end: Instant,
}

impl Trials<'_> {
    fn job<'b>(&'b self, display: &'b Display) -> ColorJob<'b> {
        let base = Settings { psnr: None, seconds: None, ..self.job.base.clone() };
        ColorJob { display, base, ..self.job.clone() }
    }

    /// Returns the reference for the case that the real display is this one.
    fn truth(&self, display: &Display, engine: &mut dyn Engine) -> Result<Reference, QualityError> {
        Reference::new(&self.job(display), !self.job.base.seed, engine)
    }

    /// Returns the mean PSNR of a solve for one display, simulated on another. NaN if no time is left or if the scene
    /// is black.
    fn decibels(&self, display: &Display, truth: &Reference, engine: &mut dyn Engine) -> Result<f64, QualityError> {
        if asked_to_end().load(Ordering::SeqCst) || Instant::now() > self.end {
            return Ok(f64::NAN);
        }
        let quality = Settings { steps: STEPS, ..Settings::default() };
        let solved = self.job(display).solve(&quality, engine, &mut |_| Flow::Continue)?;
        Ok(truth.score(&solved.solution.phases, engine)?.quality().map_or(f64::NAN, |[mean, _]| mean))
    }
}
