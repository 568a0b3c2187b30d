//! Runs the fit in its order, which is camera, even drives, small irises, single patterns, sets, last details.

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
/// Effort of a fit of the display as its file has it.
const PLAIN: Effort = Effort { subpixels: 1, slopes: 1, rounds: 12, enough: 0.01 };
/// Effort of the fits of all pictures, and of the last ones.
const ALL: Effort = Effort { subpixels: 2, slopes: 1, rounds: 6, enough: 0.02 };
const END: Effort = Effort { subpixels: FINE, slopes: 2, rounds: 6, enough: 1e-4 };
/// A fit that leaves less than this share of the pictures lacks no term. Sub-pixels and the hard edge of the iris are
/// worth fitting then.
const INSIDE: f64 = 0.04;
/// Terms that do not show are left out, unless that multiplies what is left of the pictures that were not fitted by
/// more than this.
const SETTLED: f64 = 1.02;
/// A display matches its file if its own model leaves less than this many times the squares of the noise.
const AT_THE_NOISE: f64 = 1.3;
/// Pictures that vary by less than this many times the noise are dark.
const DARK: f64 = 3.0;
/// The file's own model is also kept if the fit does not reduce the squares by this factor.
const NO_BETTER: f64 = 1.05;
/// A picture is excluded if it leaves this share of its variance and this many times the share of the median picture.
const STRANGE: (f64, f64) = (0.3, 8.0);
/// A number is unobservable if its standard error exceeds this share of its expected spread.
const UNOBSERVABLE: f64 = 0.3;
/// The warning for a bench whose phases are the negatives of the requested ones.
const OTHER_SIGN: &str = "the phase has the other sign: the pictures match the negatives of the requested phases far \
    better. Use the sign of the display file on the bench (a level of double height delays the light by double \
    the amount), or reverse the table of the SLM's levels";
/// Levels of the other sign that are tried, relative to the display file's. A table may have drifted, too, and no fit
/// changes the sign of a level.
const NEGATIVES: [f64; 4] = [-1.0, -1.15, -0.87, -1.3];
/// The second term of the camera's distortion.
const K2: Parameter = Parameter::Map(9);
/// Crosstalk of a real device, at which a fit starts (Schroff et al. 2024).
const CROSSTALK: Spread = Spread { q: 1.2, sigma: 2.03 };
/// Amplitude fill factor of its pixels, at which a fit starts.
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
    at_share("searching for the dots", 0.0, 0.0, 0.0);
    let model = display.model(color);
    let mut sorted = sort(display, color, &taken)?;
    let mut warnings = taken.warnings.clone();
    if sorted.pairs.is_empty() {
        warnings.push("no picture was taken twice, so the camera's noise was not measured".into());
    }
    if sorted.pictures.signal(&sorted.fitted) < DARK {
        return Err(reason!(
            "only-noise",
            "the pictures contain only the camera's noise: check that the light is on and the exposure is long enough"
        )
        .into());
    }
    let drift = quick.then(|| display.model.get(&color.into()).and_then(|terms| terms.unexplained).unwrap_or(0.0));
    // Bins of a piece are coarser than the edge of the iris.
    let soft_edge = !sorted.pictures.are_whole();
    let mut start = Parameters { model, map: sorted.map, camera_pixel: CAMERA_PIXEL, soft_edge };
    start.map = aligned::map(&mut sorted, &start)?;
    // The display stays as its file has it, and only the numbers of the camera are fitted.
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
    at_share("removing terms that do not show", 0.9, 0.9, 0.0);
    let settled = terms::settle(&sorted.pictures, &fitted, [&start, &known], fit.clone(), effort)?;
    let judge = |fit: &Fit| judged(&sorted, &fit.at, &fitted, effort.subpixels).left;
    let fit = if judge(&settled) < SETTLED * judge(&fit) { settled } else { fit };
    let fit = if own.squares < NO_BETTER * fit.squares { own } else { fit };
    at_share("comparing pictures that were not fitted", 0.95, 0.95, 0.0);
    let mut report = Report::new(&sorted, &start, &fit, &fitted, captures, warnings, effort.subpixels, drift);
    report.unobservable = unobservable;
    report.add_confused(pairs);
    if !report.calibrated && has_other_sign(&mut sorted, &start, &camera, &fitted, fit.squares)? {
        report.directions.phase = PhaseSign::Opposite;
        report.warnings.push(OTHER_SIGN.into());
    }
    // A fit that is not a calibration must not replace the model of the display file.
    let display = match report.calibrated {
        true => terms::written(display, color, &start, &fit, &report),
        false => display.clone(),
    };
    Calibration::new(display, color, report, shown(&sorted, &fit, effort.subpixels)?)
}

/// Fits the numbers that change from day to day to all pictures.
fn drifted(sorted: &Sorted, start: &Parameters, observe: &mut dyn FnMut(&str, f64)) -> Result<Fit, CalibrateError> {
    let mut free: Vec<Parameter> = Parameter::all(0).into_iter().filter(|p| p.drifts()).collect();
    free.extend(of_order(2));
    free.retain(|p| *p != K2);
    let effort = Effort { rounds: 10, ..ALL };
    let start = Parameters { soft_edge: true, ..start.clone() };
    sorted.pictures.fit(&start, &start, &free, &sorted.fitted, effort, &mut |part| observe("fitting what drifts", part))
}

/// Fits a whole model. Each step starts within the reach of the step before.
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
    // From here on the fit has the zero order. The expectation for any display contains nothing about its tilt.
    let mut known = known.clone();
    known.model.undiffracted.clone_from(&at.model.undiffracted);
    let random = Random::new(sorted);
    at =
        orders::slopes(sorted, &random, [&known, &at], &mut |part| observe("fitting small irises", 0.05 + 0.2 * part))?;
    // k2 shows near the end of the fit. Earlier, it misleads the fit.
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

/// Adds the last details to a fit that leaves next to nothing. These are sub-pixels and the hard edge of the iris. They
/// stay if they reduce what is left of the pictures that were not fitted.
fn finest(
    sorted: &Sorted,
    which: &[usize],
    known: &Parameters,
    fit: Fit,
    observe: &mut dyn FnMut(f64),
) -> Result<(Fit, Effort), CalibrateError> {
    let pictures = &sorted.pictures;
    let left = judged(sorted, &fit.at, which, ALL.subpixels).left;
    tracing::debug!("{left:.5} is left of all pictures");
    let (whole, hard) = (pictures.are_whole(), Parameters { soft_edge: false, ..fit.at.clone() });
    if left > INSIDE {
        if !whole {
            return Ok((fit, ALL));
        }
        // With fewer bins in an iris, a soft edge leaves more. A test of the hard edge is cheap.
        let moves = fit.free.contains(&Parameter::Iris(0));
        let rim = if moves { pictures.rim(&hard, ALL.subpixels, which).at } else { hard.clone() };
        let now = judged(sorted, &rim, which, ALL.subpixels).left;
        tracing::debug!("{now:.5} is left with a hard edge");
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

/// True if phases of the other sign predict the pictures of a bench far better than the fit does.
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

/// The values of numbers that no picture determines. They come from the display's file. Crosstalk and fill factor
/// come from a real device if the file has none.
fn known(start: &Parameters) -> Parameters {
    let mut known = start.clone();
    known.model.crosstalk = known.model.crosstalk.or(Some([CROSSTALK; 4]));
    if known.model.fill == 0.0 {
        known.model.fill = FILL;
    }
    known
}

/// The end of the fit. It alternates between the iris, by its edge, and the other numbers, by slopes, held near
/// `known`.
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

/// The warning for a fit through an iris that does not move.
fn through_one_iris(unobservable: &[String], pairs: &[(Parameter, Parameter, f64)]) -> String {
    let mut said = "the iris does not move, so the pictures determine only the light that it passes".to_string();
    if !unobservable.is_empty() {
        said += &format!(", and they do not determine {}", unobservable.join(", "));
    }
    let waves = |p: &Parameter| matches!(p, Parameter::Wavefront(_));
    let pairs: Vec<String> = pairs
        .iter()
        .filter(|(a, b, _)| waves(a) && waves(b))
        .map(|(a, b, _)| format!("{} from {}", a.name().0, b.name().0))
        .collect();
    if !pairs.is_empty() {
        said += &format!(". They do not separate {}, which hold within the iris only", pairs.join(", "));
    }
    said + ". Other numbers keep the values of the display file, and the standard errors of the rest include them"
}

/// Numbers of a fit whose errors are hardly smaller than the expected spread for any display.
fn unobservable(fit: &Fit) -> Vec<String> {
    let blurs = fit.at.model.crosstalk.is_some_and(|sides| sides.iter().all(|side| side.sigma < 10.0));
    let counts = |p: &Parameter| match p {
        // Tilts and curvature of a wave that may not exist do not count.
        Parameter::Undiffracted(_, i) => *i < 2,
        Parameter::Crosstalk(_) => blurs,
        _ => true,
    };
    let unsure = |p: &Parameter| fit.error(*p).is_some_and(|error| error > UNOBSERVABLE * p.usual());
    fit.free.iter().filter(|p| counts(p) && unsure(p)).map(|p| p.name().0).collect()
}

/// The pictures that the model predicts about as well as the others. A picture that was taken through another iris, or
/// of another pattern, is not among them. Even drives have so little contrast that their shares do not compare.
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
    // If most pictures are strange, none is excluded.
    if 2 * inliers.len() < which.len() { which.clone() } else { inliers }
}

/// The warning for a picture that contradicts the others.
fn strange(sorted: &Sorted, view: usize, left: f64) -> String {
    format!(
        "{}: {:.0} % of its variance is not explained by the model fitted to the other pictures, so it is excluded. \
         Check the place of the iris",
        sorted.pictures.views[view].file.display(),
        100.0 * left
    )
}

impl Parameter {
    /// True if the number changes from day to day.
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
        // Errors as shares of the expected spread for any display.
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
