//! Reports the result of a calibration.

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

/// A fitted number of the model.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Fitted {
    /// The name of the number, as in OPTICS 10.
    pub name: String,
    /// The value in `unit`.
    pub value: f64,
    /// Standard error of the value in `unit`, or none if it was not fitted.
    pub error: Option<f64>,
    /// The unit of value and error.
    pub unit: &'static str,
}

/// Two numbers that the pictures cannot separate.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Confused {
    /// The names of both numbers.
    pub names: [String; 2],
    /// The correlation of both numbers.
    pub correlation: f64,
}

/// The report of a calibration.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The sign of the phase, and the orientation of the camera's picture.
    pub directions: Directions,
    /// True if only drift was fitted.
    pub quick: bool,
    /// Number of pictures that were answered.
    pub captures: usize,
    /// Computing time in seconds, without the camera's time.
    pub seconds: f64,
    /// The numbers of the model that were fitted.
    pub parameters: Vec<Fitted>,
    /// The fitted display as maps, curves and places.
    pub figures: Option<Figures>,
    /// Pairs of `parameters` that the pictures cannot separate.
    pub confused: Vec<Confused>,
    /// Numbers that the pictures do not determine. They keep the values of the display's file.
    #[serde(rename = "untold")]
    pub unobservable: Vec<String>,
    /// The gain on a scene, if it was [measured](crate::Calibration::measure_gain).
    pub gain: Option<Gain>,
    /// Error of the camera's map by the dots, camera pixels, RMS.
    pub camera_rms_px: f64,
    /// The camera's map, a homography row by row, whose ninth number is 1, then k1 and k2 (OPTICS 10).
    pub camera_map: [f64; 10],
    /// Share of the variance that the display file as it was leaves of the pictures that were not fitted.
    pub before: Option<f64>,
    /// Share of the variance that the fitted model leaves of the same pictures, minus the noise. If none was taken
    /// twice, it is of the fitted pictures. It is none if it is not a number.
    pub unexplained: Option<f64>,
    /// Share of the variance that is noise of the camera, or none if no picture was taken twice.
    pub noise: Option<f64>,
    /// The verdict by the share that is left.
    pub verdict: Verdict,
    /// True if the verdict gives the display a model.
    pub calibrated: bool,
    /// The rest of each picture.
    pub pictures: Vec<PictureLeft>,
    /// The rest by place on the camera.
    pub map: ResidualMap,
    /// Warnings, one sentence each.
    pub warnings: Vec<String>,
}

impl Report {
    /// `drift` is the share that the whole calibration left unexplained, if only drift was fitted.
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
        // Without pictures that were taken twice, the fitted pictures are judged, with the noise of an ordinary camera.
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
                "the iris is far from its requested place, so {outside} pictures are not predicted to their edge: \
                 calibrate once more from the written file"
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

    /// Adds pairs from a fit before terms were left out.
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
