//! What a calibration says of itself.

use super::classified::Sorted;
use super::directions::{Directions, PhaseSign};
use super::figures::Figures;
use super::fit::Fit;
use super::gain::Gain;
use super::holdout::{holdout, judged};
use super::parameters::{Parameter, Parameters};
use super::residual::{PictureLeft, ResidualMap, left};
use super::verdict::{self, Verdict};
use serde::Serialize;

/// A number of the model.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Fitted {
    /// Its name, by OPTICS 10.
    pub name: String,
    /// Its value,
    pub value: f64,
    /// its standard error; none of what was not fitted,
    pub error: Option<f64>,
    /// and the unit of both.
    pub unit: &'static str,
}

/// Two numbers that the pictures cannot tell apart.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Confused {
    /// Their names.
    pub names: [String; 2],
    /// Their correlation.
    pub correlation: f64,
}

/// What a calibration says of itself.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Which way round the bench is.
    pub directions: Directions,
    /// Whether drift alone was fitted.
    pub quick: bool,
    /// Pictures answered.
    pub captures: usize,
    /// Seconds of computing, without the camera's.
    pub seconds: f64,
    /// The model's numbers that were fitted.
    pub parameters: Vec<Fitted>,
    /// The display as its file has it from now on, in the numbers that an optician reads.
    pub figures: Option<Figures>,
    /// Pairs of them that the pictures cannot tell apart.
    pub confused: Vec<Confused>,
    /// Numbers that the pictures say nothing of: they stay where the display's file has them.
    #[serde(rename = "untold")]
    pub unobservable: Vec<String>,
    /// What it is worth on a scene, where that was [measured](crate::Calibration::measure_gain).
    pub gain: Option<Gain>,
    /// Error of the camera's map by the dots, camera pixels, RMS.
    pub camera_rms_px: f64,
    /// The camera's map: a homography row by row, whose ninth number is 1, then k1 and k2 (OPTICS 10).
    pub camera_map: [f64; 10],
    /// Of pictures that were not fitted, as shares of their variance: what the display file as it was leaves,
    pub before: Option<f64>,
    /// what the fitted model leaves, the noise taken off; of the fitted pictures if none was taken twice; none if it is no number,
    pub unexplained: Option<f64>,
    /// and the camera's noise; none if no picture was taken twice.
    pub noise: Option<f64>,
    /// The answer,
    pub verdict: Verdict,
    /// and whether the display has a model by it.
    pub calibrated: bool,
    /// What is left of each picture,
    pub pictures: Vec<PictureLeft>,
    /// and where.
    pub map: ResidualMap,
    /// What should be known, a sentence each.
    pub warnings: Vec<String>,
}

impl Report {
    /// `drift`: what the whole calibration left unexplained, if drift alone was fitted.
    #[allow(clippy::too_many_arguments, reason = "each is a part of the report")]
    pub(super) fn new(
        sorted: &Sorted,
        start: &Parameters,
        fit: &Fit,
        fitted_views: &[usize],
        captures: usize,
        mut warnings: Vec<String>,
        subpixels: usize,
        drift: Option<f64>,
    ) -> Self {
        let fitted = |p: &Parameter| {
            let (name, unit) = p.name();
            let (value, error) = (fit.at.get(*p), fit.error(*p));
            match p {
                Parameter::Crosstalk(_) => {
                    Fitted { name, value: value.exp(), error: error.map(|e| e * value.exp()), unit }
                }
                _ => Fitted { name, value, error, unit },
            }
        };
        let parameters = fit.free.iter().map(fitted).collect();
        let confused = named(fit.confused());
        let (mut before, mut noise) = (None, None);
        let (pictures, map) = left(sorted, fit, fitted_views, subpixels);
        // Without pictures that were taken twice those that were fitted are judged, by the noise of an ordinary camera.
        let few = sorted.pairs.is_empty();
        let after = judged(sorted, &fit.at, fitted_views, subpixels);
        let left = after.left - after.noise;
        let unexplained = left.is_finite().then_some(left.max(0.0));
        if !few {
            let old = Parameters { model: start.model.clone(), ..fit.at.clone() };
            before = Some(holdout(sorted, &old, subpixels).left);
            noise = Some(after.noise);
        }
        let verdict = Verdict::of(after, few, drift);
        warnings.extend(verdict::said(verdict, after, &pictures, &map));
        tracing::debug!("squares of the fit: {:.3} times the noise's", fit.squares);
        let outside =
            sorted.pictures.views.iter().filter(|v| v.looks.iter().any(|(look, _)| !look.holds(&fit.at))).count();
        if outside > 0 {
            warnings.push(format!(
                "the iris is so far from where it was asked for that {outside} pictures are not predicted to their edge: \
                 calibrate once more from the file that was written"
            ));
        }
        let (camera_rms_px, camera_map) = (sorted.map_rms, fit.at.map.numbers);
        let calibrated = verdict != Verdict::NotCalibrated;
        let phase = if calibrated { PhaseSign::AsRequested } else { PhaseSign::Unknown };
        Self {
            directions: Directions::new(phase, fit.at.map),
            quick: drift.is_some(),
            captures,
            seconds: 0.0,
            parameters,
            figures: None,
            confused,
            unobservable: Vec::new(),
            gain: None,
            camera_rms_px,
            camera_map,
            before,
            unexplained,
            noise,
            verdict,
            calibrated,
            pictures,
            map,
            warnings,
        }
    }

    /// Adds pairs of a fit from which no term had been left out yet.
    pub(super) fn add_confused(&mut self, pairs: Vec<(Parameter, Parameter, f64)>) {
        for pair in named(pairs) {
            if self.confused.iter().all(|known| known.names != pair.names) {
                self.confused.push(pair);
            }
        }
    }
}

fn named(pairs: Vec<(Parameter, Parameter, f64)>) -> Vec<Confused> {
    pairs.into_iter().map(|(a, b, correlation)| Confused { names: [a.name().0, b.name().0], correlation }).collect()
}
