//! The fit in its order: where the camera looks, even drives, small irises, all single patterns, sets, and the last details.

use super::acquire::{CaptureSet, TAKING};
use super::bench::Event;
use super::calibrated::Calibration;
use super::classified::{CAMERA_PIXEL, Sorted, sort};
use super::directions::PhaseSign;
use super::error::CalibrateError;
use super::fit::{COARSE, Effort, Fit};
use super::holdout::judged;
use super::orders::{self, Random};
use super::parameters::{ORDERS, Parameter, Parameters, of_order};
use super::report::Report;
use super::residual::shown;
use super::views::Pictures;
use super::{aligned, even, terms};
use eyebox_base::reason;
use eyebox_optics::{Color, Display, Spread};

/// Sub-pixels along an axis at the end of a fit that reaches the noise.
const FINE: usize = 5;
/// The display as its file has it.
const PLAIN: Effort = Effort { subpixels: 1, slopes: 1, rounds: 12, enough: 0.01 };
/// Fits of all pictures, and the last ones.
const ALL: Effort = Effort { subpixels: 2, slopes: 1, rounds: 6, enough: 0.02 };
const END: Effort = Effort { subpixels: FINE, slopes: 2, rounds: 6, enough: 1e-4 };
/// A fit that leaves this share of the pictures lacks no term: sub-pixels and the iris's hard edge are worth fitting.
const INSIDE: f64 = 0.04;
/// Terms that do not show are left out unless that leaves this much more of the pictures that were not fitted.
const SETTLED: f64 = 1.02;
/// A display whose own model leaves so many times the noise's squares is as its file says.
const AT_THE_NOISE: f64 = 1.3;
/// Pictures that vary by less than so many times the noise are dark.
const DARK: f64 = 3.0;
/// So too where the fit's are not this much fewer.
const NO_BETTER: f64 = 1.05;
/// A picture that leaves this share of its variance, and so many times what the middle one leaves, is not believed.
const STRANGE: (f64, f64) = (0.3, 8.0);
/// A number whose standard error is this share of how far off it is expected is not told.
const UNOBSERVABLE: f64 = 0.3;
/// The warning of a bench whose phases are the negatives of those that it was asked to show.
const OTHER_SIGN: &str = "the phase has the other sign: the pictures are far closer to the negatives of the phases that were asked for. \
    Have the bench show them with the sign of the display's file (a level that is twice as high delays the light twice as much), \
    or turn the table of the SLM's levels around";
/// Levels of the other sign that are tried, over the display file's: a table may have drifted, too, and no fit changes a level's sign.
const NEGATIVES: [f64; 4] = [-1.0, -1.15, -0.87, -1.3];
/// The second term of the camera's distortion.
const K2: Parameter = Parameter::Map(9);
/// Crosstalk of a real device, where a fit begins (Schroff et al. 2024).
const CROSSTALK: Spread = Spread { q: 1.2, sigma: 2.03 };
/// And a fill of its pixels.
const FILL: f64 = 0.9;

pub(super) fn run(
    display: &Display,
    color: Color,
    taken: CaptureSet,
    quick: bool,
    tell: &dyn Fn(Event),
) -> Result<Calibration, CalibrateError> {
    let at_share = |what: &str, from: f64, to: f64, part: f64| {
        tell(Event::At(what, TAKING + (1.0 - TAKING) * (from + (to - from) * part)));
    };
    at_share("looking for the dots", 0.0, 0.0, 0.0);
    let model = display.model(color);
    let mut sorted = sort(display, color, &taken)?;
    let mut warnings = taken.warnings.clone();
    if sorted.pairs.is_empty() {
        warnings.push("no picture was taken twice: how large the camera's noise is was not measured".into());
    }
    if sorted.pictures.signal(&sorted.fitted) < DARK {
        return Err(reason!(
            "only-noise",
            "the pictures show nothing but the camera's noise: is the light on, and the exposure long enough?"
        )
        .into());
    }
    let drift = quick.then(|| display.model.get(&color.into()).and_then(|terms| terms.unexplained).unwrap_or(0.0));
    // Bins of a piece are coarser than the iris's edge.
    let soft_edge = !sorted.pictures.are_whole();
    let mut start = Parameters { model, map: sorted.map, camera_pixel: CAMERA_PIXEL, soft_edge };
    start.map = aligned::map(&mut sorted, &start)?;
    // The display as its file has it, and nothing but where the camera looks.
    let mut camera: Vec<Parameter> = (0..10).map(Parameter::Map).collect();
    camera.push(Parameter::CameraPixel);
    let mut looking = |part| at_share("fitting where the camera looks", 0.0, 0.05, part);
    let effort = Effort { subpixels: FINE, ..PLAIN };
    let own = sorted.pictures.fit(&start, &start, &camera, &sorted.fitted, effort, &mut looking)?;
    let captures = taken.shots.len();
    if own.squares < AT_THE_NOISE {
        let report = Report::new(&sorted, &start, &own, &sorted.fitted, captures, warnings, FINE, drift);
        return Calibration::new(terms::confirmed(display, color), color, report, shown(&sorted, &own, FINE)?);
    }
    let known = known(&start);
    let mut observe = |what: &str, part: f64| at_share(what, 0.05, 0.7, part);
    let fit = match quick {
        true => drifted(&sorted, &start, &mut observe)?,
        false => {
            observe("fitting even drives", 0.0);
            let even = even::fit(&sorted, &start)?;
            if let Some((view, left)) = even.strange {
                warnings.push(strange(&sorted, view, left));
                sorted.leave_out(view);
            }
            from_small_to_large(&sorted, [&known, &even.at], &mut observe)?
        }
    };
    let fitted = inliers(&sorted, &fit, &mut warnings);
    let (fit, effort) = finest(&sorted, &fitted, &known, fit, &mut |part| {
        at_share("fitting all pictures finely", 0.7, 0.9, part);
    })?;
    let unobservable = unobservable(&fit);
    let pairs = if taken.hello.iris.is_none() { fit.confused() } else { Vec::new() };
    if taken.hello.iris.is_none() {
        warnings.push(through_one_iris(&unobservable, &pairs));
    }
    at_share("leaving out what does not show", 0.9, 0.9, 0.0);
    let settled = terms::settle(&sorted.pictures, &fitted, [&start, &known], fit.clone(), effort)?;
    let judge = |fit: &Fit| judged(&sorted, &fit.at, &fitted, effort.subpixels).left;
    let fit = if judge(&settled) < SETTLED * judge(&fit) { settled } else { fit };
    let fit = if own.squares < NO_BETTER * fit.squares { own } else { fit };
    at_share("looking at pictures that were not fitted", 0.95, 0.95, 0.0);
    let mut report = Report::new(&sorted, &start, &fit, &fitted, captures, warnings, effort.subpixels, drift);
    report.unobservable = unobservable;
    report.add_confused(pairs);
    if !report.calibrated && has_other_sign(&mut sorted, &start, &camera, &fitted, fit.squares)? {
        report.directions.phase = PhaseSign::Opposite;
        report.warnings.push(OTHER_SIGN.into());
    }
    // A fit that is no calibration is not written as if it were one.
    let display = match report.calibrated {
        true => terms::written(display, color, &start, &fit, &report),
        false => display.clone(),
    };
    Calibration::new(display, color, report, shown(&sorted, &fit, effort.subpixels)?)
}

/// What changes from day to day, fitted to all pictures.
fn drifted(sorted: &Sorted, start: &Parameters, observe: &mut dyn FnMut(&str, f64)) -> Result<Fit, CalibrateError> {
    let mut free: Vec<Parameter> = Parameter::all(0).into_iter().filter(|p| p.drifts()).collect();
    free.extend(of_order(2));
    free.retain(|p| *p != K2);
    let effort = Effort { rounds: 10, ..ALL };
    let start = Parameters { soft_edge: true, ..start.clone() };
    sorted.pictures.fit(&start, &start, &free, &sorted.fitted, effort, &mut |part| observe("fitting what drifts", part))
}

/// A whole model: each step starts within the reach of the one before.
fn from_small_to_large(
    sorted: &Sorted,
    [known, start]: [&Parameters; 2],
    observe: &mut dyn FnMut(&str, f64),
) -> Result<Fit, CalibrateError> {
    let pictures = &sorted.pictures;
    let mut at = Parameters { soft_edge: true, ..start.clone() };
    at.model.crosstalk = at.model.crosstalk.or(known.model.crosstalk);
    if at.model.fill == 0.0 {
        at.model.fill = known.model.fill;
    }
    // The light that is not modulated is known from here on; what is expected of any display says nothing of its tilt.
    let mut known = known.clone();
    known.model.undiffracted.clone_from(&at.model.undiffracted);
    let random = Random::new(sorted);
    at =
        orders::slopes(sorted, &random, [&known, &at], &mut |part| observe("fitting small irises", 0.05 + 0.2 * part))?;
    // Near the end k2 shows; before, it leads astray.
    let all = Parameter::all(at.model.undiffracted.len());
    let mut free: Vec<Parameter> = all.into_iter().filter(|p| ![Parameter::Lag, K2].contains(p)).collect();
    free.extend((*ORDERS.start()..=5).flat_map(of_order));
    let single: Vec<usize> = sorted.even.iter().chain(&random.all).copied().collect();
    let mut fit = pictures.fit(&known, &at, &free, &single, COARSE, &mut |part| {
        observe("fitting single patterns", 0.25 + 0.25 * part);
    })?;
    observe("adding orders of the wavefront", 0.5);
    fit = orders::more(sorted, &single, &known, fit, COARSE)?;
    let has_sets = sorted.fitted.iter().any(|v| pictures.sets[pictures.views[*v].set].pattern.frames > 1);
    let mut free = fit.free.clone();
    free.extend(has_sets.then_some(Parameter::Lag));
    free.push(K2);
    pictures.fit(&known, &fit.at, &free, &sorted.fitted, ALL, &mut |part| {
        observe("fitting all pictures", 0.7 + 0.3 * part);
    })
}

/// The last details of a fit that leaves next to nothing: sub-pixels, and the hard edge of the iris. They stay if the pictures that
/// were not fitted gain by them.
fn finest(
    sorted: &Sorted,
    which: &[usize],
    known: &Parameters,
    fit: Fit,
    observe: &mut dyn FnMut(f64),
) -> Result<(Fit, Effort), CalibrateError> {
    let pictures = &sorted.pictures;
    let left = judged(sorted, &fit.at, which, ALL.subpixels).left;
    tracing::debug!("all pictures: {left:.5} is left");
    let (whole, hard) = (pictures.are_whole(), Parameters { soft_edge: false, ..fit.at.clone() });
    if left > INSIDE {
        if !whole {
            return Ok((fit, ALL));
        }
        // The fewer bins an iris has, the more a soft edge leaves: whether a hard one explains more is cheap to ask.
        let moves = fit.free.contains(&Parameter::Iris(0));
        let rim = if moves { pictures.rim(&hard, ALL.subpixels, which).at } else { hard.clone() };
        let now = judged(sorted, &rim, which, ALL.subpixels).left;
        tracing::debug!("with a hard edge: {now:.5} is left");
        if now > left {
            return Ok((fit, ALL));
        }
    }
    let finer = match whole {
        true => fine(pictures, which, [known, &hard], &fit.free, observe)?,
        false => pictures.fit(known, &fit.at, &fit.free, which, END, observe)?,
    };
    let now = judged(sorted, &finer.at, which, FINE).left;
    tracing::debug!("with sub-pixels{}: {now:.5} is left", if whole { " and a hard edge" } else { "" });
    Ok(if now < left { (finer, END) } else { (fit, ALL) })
}

/// Whether phases of the other sign predict the pictures of a bench far better than what was fitted.
fn has_other_sign(
    sorted: &mut Sorted,
    start: &Parameters,
    camera: &[Parameter],
    which: &[usize],
    squares: f64,
) -> Result<bool, CalibrateError> {
    for times in NEGATIVES {
        let mut other = start.clone();
        other.model.level.iter_mut().flatten().for_each(|level| *level *= times);
        other.map = aligned::map(sorted, &other)?;
        let fit = sorted.pictures.fit(&other, &other, camera, which, PLAIN, &mut |_| {})?;
        if 2.0 * fit.squares < squares {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Where the numbers are that no picture tells: where the display's file has them, and crosstalk and pixels of which it says
/// nothing are a real device's.
fn known(start: &Parameters) -> Parameters {
    let mut known = start.clone();
    known.model.crosstalk = known.model.crosstalk.or(Some([CROSSTALK; 4]));
    if known.model.fill == 0.0 {
        known.model.fill = FILL;
    }
    known
}

/// The fit's end: the iris by its edge and the other numbers by slopes, by turns, held near what is `known`.
fn fine(
    pictures: &Pictures,
    which: &[usize],
    [known, start]: [&Parameters; 2],
    free: &[Parameter],
    observe: &mut dyn FnMut(f64),
) -> Result<Fit, CalibrateError> {
    let moves = free.contains(&Parameter::Iris(0));
    let others: Vec<Parameter> = free.iter().copied().filter(|p| !matches!(p, Parameter::Iris(_))).collect();
    let rim = |at: &Parameters| pictures.rim(at, FINE, which);
    let first = if moves { rim(start).at } else { start.clone() };
    let mut fit = |at: &Parameters, effort| pictures.fit(known, at, &others, which, effort, observe);
    let near = fit(&first, Effort { rounds: 6, enough: 0.01, ..END })?;
    if !moves {
        return fit(&near.at, END);
    }
    let end = fit(&rim(&near.at).at, END)?;
    let rim = rim(&end.at);
    let fit = if rim.at == end.at { end } else { fit(&rim.at, END)? };
    Ok(fit.with_iris(rim.errors))
}

/// What should be known of a fit through an iris that stands still.
fn through_one_iris(unobservable: &[String], pairs: &[(Parameter, Parameter, f64)]) -> String {
    let mut said = "the iris stands still: the pictures tell of the light that it passes alone".to_string();
    if !unobservable.is_empty() {
        said += &format!(", and they say nothing of {}", unobservable.join(", "));
    }
    let waves = |p: &Parameter| matches!(p, Parameter::Wavefront(_));
    let pairs: Vec<String> = pairs
        .iter()
        .filter(|(a, b, _)| waves(a) && waves(b))
        .map(|(a, b, _)| format!("{} from {}", a.name().0, b.name().0))
        .collect();
    if !pairs.is_empty() {
        said += &format!("; they do not tell {}, which hold within the iris alone", pairs.join(", "));
    }
    said + "; what is not told stays as the display's file has it, and the errors of the rest count it"
}

/// Numbers of a fit that are hardly surer than what is expected of any display.
fn unobservable(fit: &Fit) -> Vec<String> {
    let blurs = fit.at.model.crosstalk.is_some_and(|sides| sides.iter().all(|side| side.sigma < 10.0));
    let counts = |p: &Parameter| match p {
        // Phases of what may not be there.
        Parameter::Undiffracted(_, i) => *i < 2,
        Parameter::Crosstalk(_) => blurs,
        _ => true,
    };
    let unsure = |p: &Parameter| fit.error(*p).is_some_and(|error| error > UNOBSERVABLE * p.usual());
    fit.free.iter().filter(|p| counts(p) && unsure(p)).map(|p| p.name().0).collect()
}

/// Pictures that the model predicts about as well as the others: one that was taken through another iris, or of another pattern,
/// is not. Even drives have so little contrast that their shares do not compare.
fn inliers(sorted: &Sorted, fit: &Fit, warnings: &mut Vec<String>) -> Vec<usize> {
    let (pictures, which) = (&sorted.pictures, &sorted.fitted);
    let left = pictures.left(which, &pictures.see(&fit.at, ALL.subpixels, which, &[]));
    let mut shares: Vec<f64> = left.iter().map(|l| l[0]).collect();
    shares.sort_by(f64::total_cmp);
    let most = STRANGE.0.max(STRANGE.1 * shares.get(shares.len() / 2).copied().unwrap_or(0.0));
    let mut inliers = Vec::new();
    for (v, [left, squares]) in which.iter().zip(&left) {
        let view = &pictures.views[*v];
        tracing::debug!("{}: {left:.5} of its variance is left, {squares:.2} of the noise", view.file.display());
        if *left < most || sorted.even.contains(v) {
            inliers.push(*v);
        } else {
            warnings.push(strange(sorted, *v, *left));
        }
    }
    // Where most are strange none is.
    if 2 * inliers.len() < which.len() { which.clone() } else { inliers }
}

/// The warning of a picture that contradicts the others.
fn strange(sorted: &Sorted, view: usize, left: f64) -> String {
    format!(
        "{}: {:.0} % of its variance is not explained by the model fitted to the other pictures: excluded; was the iris where it \
         should be?",
        sorted.pictures.views[view].file.display(),
        100.0 * left
    )
}

impl Parameter {
    /// Whether it changes from day to day.
    fn drifts(self) -> bool {
        matches!(self, Self::Map(_) | Self::Iris(_) | Self::Source(0 | 1) | Self::Level(_) | Self::Wavefront(3..=5))
    }
}

#[cfg(test)]
mod tests {
    use super::super::map::CameraMap;
    use super::*;
    use eyebox_optics::DisplayModel;

    #[test]
    fn what_the_pictures_say_nothing_of_is_named() {
        let map = CameraMap { numbers: [0.0; 10], slm: [8, 8], camera: [8, 8] };
        let at = Parameters { model: DisplayModel::default(), map, camera_pixel: CAMERA_PIXEL, soft_edge: false };
        let free =
            vec![Parameter::Fill, Parameter::Wavefront(12), Parameter::Undiffracted(0, 3), Parameter::Crosstalk(1)];
        // Errors in shares of what is expected of any display.
        let error = |p: &Parameter| p.usual() * if *p == Parameter::Fill { 0.1 } else { 0.9 };
        let row = |i: usize| (0..free.len()).map(|j| if i == j { error(&free[i]).powi(2) } else { 0.0 }).collect();
        let covariance = (0..free.len()).map(row).collect();
        let fit = Fit { at, free: free.clone(), squares: 1.0, covariance };
        assert_eq!(unobservable(&fit), ["wavefront 12"]);
        let pairs =
            [(Parameter::Wavefront(3), Parameter::Wavefront(11), 0.998), (Parameter::Map(8), Parameter::Map(9), -0.96)];
        let said = through_one_iris(&unobservable(&fit), &pairs);
        let numbers: Vec<_> = said.split(|c: char| !c.is_ascii_digit()).filter(|n| !n.is_empty()).collect();
        assert_eq!(numbers, ["12", "3", "11"], "{said}");
        assert!(!said.contains("camera"), "{said}");
    }
}
