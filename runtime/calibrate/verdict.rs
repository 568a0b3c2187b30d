//! Decides if a display is calibrated, calibrated with faults that the model lacks, or not calibrated.

use super::holdout::Holdout;
use super::residual::{LEFT_OUT, PictureLeft, ResidualMap};
use serde::Serialize;

/// The result of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Verdict {
    /// The model explains the pictures to the camera's noise.
    Calibrated,
    /// The model explains most of the pictures, and solving for it regains most of the loss. No term describes the
    /// rest.
    WithFaults,
    /// The model does not explain the pictures, so the display keeps its earlier model.
    NotCalibrated,
}

/// Unexplained light of up to this many times the noise counts as noise.
const NOISE: f64 = 2.0;
/// The noise of fitted pictures is not measured but assumed for an ordinary camera. One percent of the variance is
/// usual for an ordinary bench.
const LEAST_FITTED: f64 = 5e-3;
/// Noise below this share of the variance counts as this share, because it is below the error of the prediction.
const LEAST: f64 = 1e-5;
/// Share of the variance that faults without a term may leave. On three simulated benches with fifteen such faults,
/// fits that left 5 to 14 % regained 77 to 80 % of the mean's loss. Fits in a wrong minimum left 25 % and more.
const FAULTS: f64 = 0.2;
/// A fit of drift has few numbers and is judged by pictures that it was fitted to. It has to leave less than
/// `FAULTS_QUICK`, or at most `DRIFTED` times the share that the whole calibration left. Faults without a term do not
/// go away.
const FAULTS_QUICK: f64 = 0.03;
const DRIFTED: f64 = 1.5;

impl Verdict {
    /// The verdict by the share of the pictures that is left. `few` is true if none was taken twice. `drift` is the
    /// share that the whole calibration left, if only drift was fitted.
    pub(super) fn of(left: Holdout, few: bool, drift: Option<f64>) -> Self {
        let unexplained = left.left - left.noise;
        let noise = NOISE * left.noise.max(if few { LEAST_FITTED } else { LEAST });
        let faults = drift.map_or(FAULTS, |before| (DRIFTED * before).clamp(FAULTS_QUICK, FAULTS));
        // A share that is not a number is no calibration.
        if unexplained <= noise {
            Self::Calibrated
        } else if unexplained <= faults {
            Self::WithFaults
        } else {
            Self::NotCalibrated
        }
    }
}

/// The warning for a verdict other than calibrated, with the size and the place of the rest.
pub(super) fn said(verdict: Verdict, left: Holdout, pictures: &[PictureLeft], map: &ResidualMap) -> Option<String> {
    let shares = format!(
        "{:.2} % of the pictures' variance is unexplained, and the camera's noise is {:.2} %",
        100.0 * (left.left - left.noise),
        100.0 * left.noise
    );
    let place = place(pictures, map);
    match verdict {
        Verdict::Calibrated => None,
        Verdict::WithFaults => {
            Some(format!("calibrated, but the bench has faults that the model lacks: {shares}{place}"))
        }
        Verdict::NotCalibrated => Some(format!(
            "not calibrated: {shares}{place}. Check that the iris moves as requested, that the SLM shows each \
             pattern before the exposure begins, and that the camera is linear and does not move. The display \
             file keeps its earlier model"
        )),
    }
}

/// Describes where most is left, by the kind of the pictures, one picture, and a place of the camera.
fn place(pictures: &[PictureLeft], map: &ResidualMap) -> String {
    let counted = || pictures.iter().filter(|p| p.role != LEFT_OUT);
    let kinds: Vec<String> = ["even", "smooth", "random", "set"]
        .iter()
        .filter_map(|kind| {
            let shares: Vec<f64> = counted().filter(|p| p.kind == *kind).map(|p| p.left).collect();
            let mean = shares.iter().sum::<f64>() / shares.len() as f64;
            (!shares.is_empty()).then(|| format!("{:.1} % of {kind} patterns", 100.0 * mean))
        })
        .collect();
    let whole = counted().max_by(|a, b| a.squares.total_cmp(&b.squares));
    whole.zip(map.most()).map_or_else(String::new, |(whole, ([x, y], squares))| {
        format!(
            " ({}). Most is left of {} ({:.1} times the noise) and near camera pixel x {x}, y {y} ({squares:.1} times)",
            kinds.join(", "),
            whole.file,
            whole.squares
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_three_answers_and_a_quick_fit_is_judged_more_strictly() {
        let of =
            |left: f64, few: bool, quick: bool| Verdict::of(Holdout { left, noise: 1e-3 }, few, quick.then_some(0.0));
        assert_eq!(of(0.0029, false, false), Verdict::Calibrated);
        assert_eq!(of(0.0032, false, false), Verdict::WithFaults);
        // For fitted pictures, up to one percent counts as noise.
        assert_eq!(of(0.0032, true, false), Verdict::Calibrated);
        assert_eq!(of(0.12, false, false), Verdict::WithFaults);
        assert_eq!(of(0.12, true, true), Verdict::NotCalibrated);
        assert_eq!(of(0.4, false, false), Verdict::NotCalibrated);
        assert_eq!(of(f64::NAN, false, false), Verdict::NotCalibrated);
        // Faults that the whole calibration left are still there, and no further ones.
        let after = |left: f64, before: f64| Verdict::of(Holdout { left, noise: 1e-3 }, true, Some(before));
        assert_eq!(after(0.12, 0.1), Verdict::WithFaults);
        assert_eq!(after(0.16, 0.1), Verdict::NotCalibrated);
        assert_eq!(after(0.25, 0.19), Verdict::NotCalibrated);
    }

    #[test]
    fn an_answer_names_what_is_left_and_where() {
        let picture = |kind, role, left| PictureLeft {
            file: format!("{kind}.png"),
            kind,
            iris_mm: [0.0; 3],
            role,
            left,
            squares: 100.0 * left,
        };
        let pictures =
            [picture("even", "fitted", 0.02), picture("set", "fitted", 0.1), picture("random", LEFT_OUT, 0.9)];
        let map = ResidualMap { tile_px: 10, rows: 1, columns: 2, squares: vec![Some(2.0), Some(7.0)] };
        let left = Holdout { left: 0.06, noise: 0.001 };
        assert_eq!(said(Verdict::Calibrated, left, &pictures, &map), None);
        let faults = said(Verdict::WithFaults, left, &pictures, &map).expect("a warning");
        for part in ["5.90 %", "0.10 %", "2.0 % of even", "10.0 % of set", "set.png", "x 15, y 5"] {
            assert!(faults.contains(part), "{part}: {faults}");
        }
        assert!(!faults.contains("random"), "{faults}");
        let not = said(Verdict::NotCalibrated, left, &pictures, &map).expect("a warning");
        assert!(not.contains("5.90 %") && not != faults, "{not}");
    }
}
