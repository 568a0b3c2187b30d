//! What a calibration is worth: a scene solved for the display as its file was, and as it was fitted, both looked at as it was
//! fitted.

use super::error::CalibrateError;
use crate::engine::Engine;
use crate::optics::{Color, Display, Picture};
use crate::quality::{ModelWorth, Reference, Subject};
use crate::scene::{self, LightField, Request};
use crate::solve::{Flow, Levels, PupilRange, Settings};
use serde::Serialize;
use std::collections::BTreeMap;

/// The scene.
const SCENE: &str = "builtin:still-life";
/// Steps of each of the two solves.
const STEPS: usize = 24;

/// What a calibration is worth on the built-in still life, by PSNR over random pupils.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Gain {
    /// Rows and columns of the display that it was measured on: the same with fewer pixels.
    pub size: [usize; 2],
    /// Steps of each solve.
    pub steps: usize,
    /// Solved for the display as its file was: mean and worst pupil, dB,
    pub before_db: [f64; 2],
    /// and for the fitted one.
    pub after_db: [f64; 2],
    /// What each term of the fitted model gains of the mean, dB: a solve with it less one without it.
    pub terms_db: BTreeMap<&'static str, f64>,
}

/// Measures it; of one colour.
pub(super) fn measure(
    [before, after]: [&Display; 2],
    color: Color,
    engine: &mut dyn Engine,
) -> Result<Gain, CalibrateError> {
    // A picture's place is the same for both, and an eye's error.
    let small =
        |display: &Display| Display { picture: Picture::default(), prescription: None, ..ModelWorth::display(display) };
    let [before, after] = [before, after].map(small);
    let field = scene::load(SCENE, &Request::new(&after, &[color]))?;
    let depth = field.depths(&after, None)?;
    let diameter = PupilRange::usual_diameter(after.eyebox_min());
    let base = Settings { depth, diameter, ..Settings::default() };
    let quality = Settings { steps: STEPS, ..Settings::default() };
    fn of<'a>(field: &'a LightField, color: Color, display: &'a Display, base: &Settings) -> Subject<'a> {
        Subject { field, color, display, base: base.clone(), levels: Levels::of(display) }
    }
    let truth = Reference::new(&of(&field, color, &after, &base), !base.seed, engine)?;
    let mut decibels = |subject: &Subject| -> Result<[f64; 2], CalibrateError> {
        let solved = subject.solve(&quality, engine, &mut |_| Flow::Continue)?;
        let score = truth.score(&solved.solution.phases, engine).map_err(CalibrateError::Gain)?;
        Ok([score.mean(), score.worst()])
    };
    let after_db = decibels(&of(&field, color, &after, &base))?;
    let before_db = if before == after { after_db } else { decibels(&of(&field, color, &before, &base))? };
    let mut terms_db = BTreeMap::new();
    for term in after.model(color).terms() {
        let without = after.with_model_of(color, |model| model.keep(&|name| name != term));
        terms_db.insert(term, after_db[0] - decibels(&of(&field, color, &without, &base))?[0]);
    }
    Ok(Gain { size: [after.height, after.width], steps: STEPS, before_db, after_db, terms_db })
}
