//! Measures the gain of a calibration by solving a scene for the display before and after it.
//!
//! One solve is for the display as its file was, the other for the fitted display. Both are rendered on the fitted
//! display.

use super::error::CalibrateError;
use super::mend::{self, Mend};
use eyebox_compute::engine::Engine;
use eyebox_optics::{Color, Display, Picture};
use eyebox_scene::{LightField, Request};
use eyebox_solve::quality::{ColorJob, ModelWorth, Reference};
use eyebox_solve::solve::{Flow, Levels, PupilRange, Settings};
use serde::Serialize;
use std::collections::BTreeMap;

const SCENE: &str = "builtin:still-life";
/// Number of steps of each of the two solves.
const STEPS: usize = 24;

/// The gain of a calibration on the built-in still life, by PSNR over random pupils.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gain {
    /// Rows and columns of the display of the measurement. It is the same display with fewer pixels.
    pub size: [usize; 2],
    /// Steps of each solve.
    pub steps: usize,
    /// PSNR of the solve for the display as its file was, mean and worst pupil, dB.
    pub before_db: [f64; 2],
    /// PSNR of the solve for the fitted display, mean and worst pupil, dB.
    pub after_db: [f64; 2],
    /// Gain of each term of the fitted model, dB of the mean, from a solve with the term minus one without it.
    pub terms_db: BTreeMap<&'static str, f64>,
    /// Faults that cost at least 0.2 dB although the model has them and that can be fixed on the bench, the most
    /// expensive first.
    pub mend: Vec<Mend>,
}

/// Measures the gain for one color. Faults to fix are listed only if the display was calibrated.
pub(super) fn measure(
    [before, after]: [&Display; 2],
    color: Color,
    calibrated: bool,
    engine: &mut dyn Engine,
) -> Result<Gain, CalibrateError> {
    // The place of the picture and the error of an eye are the same for both.
    let small =
        |display: &Display| Display { picture: Picture::default(), prescription: None, ..ModelWorth::display(display) };
    let [before, after] = [before, after].map(small);
    let field = eyebox_scene::load(SCENE, &Request::new(&after, &[color]))?;
    let depth = field.depths(&after, None)?;
    let diameter = PupilRange::usual_diameter(after.eyebox_min());
    let base = Settings { depth, diameter, ..Settings::default() };
    let quality = Settings { steps: STEPS, ..Settings::default() };
    fn of<'a>(field: &'a LightField, color: Color, display: &'a Display, base: &Settings) -> ColorJob<'a> {
        ColorJob { field, color, display, base: base.clone(), levels: Levels::of(display) }
    }
    let truth = |display: &Display, engine: &mut dyn Engine| {
        Reference::new(&of(&field, color, display, &base), !base.seed, engine).map_err(CalibrateError::from)
    };
    let reached = |display: &Display, truth: &Reference, engine: &mut dyn Engine| -> Result<_, CalibrateError> {
        let job = of(&field, color, display, &base);
        let solved = job.solve(&quality, engine, &mut |_| Flow::Continue)?;
        let score = truth.score(&solved.solution.phases, engine).map_err(CalibrateError::Gain)?;
        Ok([score.mean(), score.worst()])
    };
    let seen = truth(&after, engine)?;
    let after_db = reached(&after, &seen, engine)?;
    let before_db = if before == after { after_db } else { reached(&before, &seen, engine)? };
    let mut terms_db = BTreeMap::new();
    for term in after.model(color).terms() {
        let without = after.with_model_of(color, |model| model.keep(&|name| name != term));
        terms_db.insert(term, after_db[0] - reached(&without, &seen, engine)?[0]);
    }
    let mut mended_db = |mended: &Display| {
        let seen = truth(mended, engine)?;
        Ok(reached(mended, &seen, engine)?[0])
    };
    let mend = if calibrated { mend::measure(&after, color, after_db[0], &mut mended_db)? } else { Vec::new() };
    Ok(Gain { size: [after.height, after.width], steps: STEPS, before_db, after_db, terms_db, mend })
}
