//! The fit in its order (OPTICS 10): where the camera looks, what smooth patterns tell, what random ones tell, all of it.

use super::acquire::{TAKING, Taken};
use super::bench::Event;
use super::error::CalibrateError;
use super::fit::{Effort, Fit, Pictures};
use super::left::{Shown, shown};
use super::parameters::{Parameter, Parameters};
use super::report::Report;
use super::smooth::{PLAIN, smooth};
use super::sorted::{CAMERA_PIXEL, sort};
use super::terms;
use crate::optics::{Color, Display, Spread};

/// Sub-pixels along an axis at the end of the fit.
const FINE: usize = 5;
/// What fits that search cost, and the last ones.
const SEARCH: Effort = Effort { subpixels: 2, slopes: 1, rounds: 10, enough: 0.02 };
const END: Effort = Effort { subpixels: FINE, slopes: 2, rounds: 6, enough: 1e-4 };
/// A display whose own model leaves so many times the noise's squares is as its file says.
const AT_THE_NOISE: f64 = 1.3;
/// Pictures that vary by less than so many times the noise are dark.
const DARK: f64 = 3.0;
/// So too where the fit's are not this much fewer.
const NO_BETTER: f64 = 1.05;
/// A picture that leaves this share of its variance, and so many times what the middle one leaves, is not believed.
const STRANGE: (f64, f64) = (0.3, 8.0);
/// A number whose standard error is this share of how far off it is expected is not told.
const UNTOLD: f64 = 0.3;
/// The warning of a bench whose phases are the negatives of those that it was asked to show.
const OTHER_SIGN: &str = "the phase has the other sign: the pictures are far closer to the negatives of the phases that were asked for. \
    Have the bench show them with the sign of the display's file (a level that is twice as high delays the light twice as much), \
    or turn the table of the SLM's levels around";
/// The second term of the camera's distortion.
const K2: Parameter = Parameter::Map(9);
/// Crosstalk of a real device, where a fit begins (Schroff et al. 2024).
const CROSSTALK: Spread = Spread { q: 1.2, sigma: 2.03 };
/// And a fill of its pixels.
const FILL: f64 = 0.9;

/// Fits, and says what came of it.
pub(super) fn run(
    display: &Display,
    color: Color,
    taken: Taken,
    quick: bool,
    tell: &dyn Fn(Event),
) -> Result<(Display, Report, Vec<Shown>), CalibrateError> {
    let share = |from: f64, to: f64, part: f64| TAKING + (1.0 - TAKING) * (from + (to - from) * part);
    tell(Event::At("looking for the dots", TAKING));
    let model = display.model(color);
    let sorted = sort(display, color, &taken)?;
    let mut warnings = taken.warnings.clone();
    if sorted.pairs.is_empty() {
        warnings.push("no picture was taken twice: how large the camera's noise is was not measured".into());
    }
    let pictures = &sorted.pictures;
    if pictures.signal(&sorted.fitted) < DARK {
        return Err(CalibrateError::Pictures(
            "the pictures show nothing but the camera's noise: is the light on, and the exposure long enough?".into(),
        ));
    }
    let start = Parameters { model: model.clone(), map: sorted.map, camera_pixel: CAMERA_PIXEL };
    let map: Vec<Parameter> = (0..10).map(Parameter::Map).collect();
    // The display as its file has it, and nothing but where the camera looks.
    let mut camera = map.clone();
    camera.push(Parameter::CameraPixel);
    let mut looking = |part| tell(Event::At("fitting where the camera looks", share(0.0, 0.05, part)));
    let own = pictures.fit(&start, &camera, &sorted.fitted, Effort { subpixels: FINE, ..PLAIN }, &mut looking)?;
    let captures = taken.shots.len();
    if own.squares < AT_THE_NOISE {
        let report = Report::new(&sorted, &start, &own, &sorted.fitted, captures, warnings, FINE);
        return Ok((display.clone(), report, shown(&sorted, &own, FINE)?));
    }
    let mut at = start.clone();
    if !quick && !sorted.smooth.is_empty() {
        at = smooth(&sorted, &at, &map[..9], &mut |part| {
            tell(Event::At("fitting smooth patterns", share(0.05, 0.25, part)))
        })?;
    }
    let has_sets = sorted.fitted.iter().any(|v| pictures.sets[pictures.views[*v].set].pattern.frames > 1);
    let mut free = Parameter::all();
    // Near the end k2 is told; before, it leads astray.
    free.retain(|p| *p != K2);
    if quick {
        free.retain(|p| p.drifts());
    }
    free.retain(|p| has_sets || *p != Parameter::Lag);
    let plain: Vec<Parameter> = free.iter().copied().filter(|p| !matches!(p, Parameter::Crosstalk(_))).collect();
    // A part of the pictures is enough to come near.
    let some: Vec<usize> =
        sorted.fitted.iter().copied().enumerate().filter(|(i, _)| i % 2 == 0).map(|(_, v)| v).collect();
    let some = if quick { &sorted.fitted } else { &some };
    let mut fitting = |part| tell(Event::At("fitting some pictures", share(0.25, 0.6, part)));
    let mut fit = if quick || at.model.crosstalk.is_some() {
        pictures.fit(&at, &free, some, SEARCH, &mut fitting)?
    } else {
        // Where there is none, crosstalk is slow to go.
        if at.model.fill == 0.0 {
            at.model.fill = FILL;
        }
        let without = pictures.fit(&at, &plain, some, Effort { subpixels: 1, ..SEARCH }, &mut fitting)?;
        at.model.crosstalk = Some([CROSSTALK; 4]);
        let with = pictures.fit(&at, &free, some, SEARCH, &mut fitting)?;
        if with.squares < 0.95 * without.squares { with } else { without }
    };
    if fit.at.model.crosstalk.is_none() {
        free = plain;
    }
    free.push(K2);
    let fitted = believed(pictures, &sorted.fitted, &fit, &mut warnings);
    let mut fitting = |part| tell(Event::At("fitting all pictures finely", share(0.6, 0.9, part)));
    let known = known(&start);
    fit = fine(pictures, &fitted, [&known, &fit.at], &free, &mut fitting)?;
    let untold = untold(&fit);
    let pairs = if taken.hello.iris.is_none() { fit.confused() } else { Vec::new() };
    if taken.hello.iris.is_none() {
        warnings.push(through_one_iris(&untold, &pairs));
    }
    tell(Event::At("leaving out what does not show", share(0.0, 1.0, 0.9)));
    let fit = terms::settle(pictures, &fitted, [&start, &known], fit, END)?;
    let fit = if own.squares < NO_BETTER * fit.squares { own } else { fit };
    tell(Event::At("looking at pictures that were not fitted", share(0.0, 1.0, 0.95)));
    let mut report = Report::new(&sorted, &start, &fit, &fitted, captures, warnings, FINE);
    report.untold = untold;
    report.add_confused(pairs);
    if !report.calibrated && has_other_sign(pictures, &start, &camera, &fitted, fit.squares)? {
        report.warnings.push(OTHER_SIGN.into());
    }
    let display = terms::written(display, color, &start, &fit, &report);
    Ok((display, report, shown(&sorted, &fit, FINE)?))
}

/// Whether phases of the other sign predict the pictures of a bench far better than what was fitted.
fn has_other_sign(
    pictures: &Pictures,
    start: &Parameters,
    camera: &[Parameter],
    which: &[usize],
    squares: f64,
) -> Result<bool, CalibrateError> {
    let mut other = start.clone();
    other.model.level.iter_mut().flatten().for_each(|level| *level = -*level);
    let fit = pictures.fit(&other, camera, which, PLAIN, &mut |_| {})?;
    Ok(2.0 * fit.squares < squares)
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
    let mut fit = |at: &Parameters, effort| pictures.fit_near(known, at, &others, which, effort, observe);
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
fn through_one_iris(untold: &[String], pairs: &[(Parameter, Parameter, f64)]) -> String {
    let mut said = "the iris stands still: the pictures tell of the light that it passes alone".to_string();
    if !untold.is_empty() {
        said += &format!(", and they say nothing of {}", untold.join(", "));
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
fn untold(fit: &Fit) -> Vec<String> {
    let blurs = fit.at.model.crosstalk.is_some_and(|sides| sides.iter().all(|side| side.sigma < 10.0));
    let counts = |p: &Parameter| match p {
        // Phases of what may not be there.
        Parameter::Undiffracted(i) => *i < 2,
        Parameter::Crosstalk(_) => blurs,
        _ => true,
    };
    let unsure = |p: &Parameter| fit.error(*p).is_some_and(|error| error > UNTOLD * p.usual());
    fit.free.iter().filter(|p| counts(p) && unsure(p)).map(|p| p.name().0).collect()
}

/// Pictures that the model predicts about as well as the others: one that was taken through another iris, or of another pattern,
/// is not.
fn believed(pictures: &Pictures, which: &[usize], fit: &Fit, warnings: &mut Vec<String>) -> Vec<usize> {
    let left = pictures.left(which, &pictures.see(&fit.at, SEARCH.subpixels, which, &[]), fit.exposure);
    let mut sorted: Vec<f64> = left.iter().map(|l| l[0]).collect();
    sorted.sort_by(f64::total_cmp);
    let most = STRANGE.0.max(STRANGE.1 * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0));
    let mut believed = Vec::new();
    for (v, [left, squares]) in which.iter().zip(&left) {
        let view = &pictures.views[*v];
        tracing::debug!("{}: {left:.5} of its variance is left, {squares:.2} of the noise", view.file.display());
        if *left < most {
            believed.push(*v);
        } else {
            warnings.push(format!(
                "{}: {:.0} % of its variance is not what the others tell: it is left out; was the iris where it should be?",
                view.file.display(),
                100.0 * left
            ));
        }
    }
    // Where most are strange none is.
    if 2 * believed.len() < which.len() { which.to_vec() } else { believed }
}

impl Parameter {
    /// Whether it changes from day to day.
    fn drifts(self) -> bool {
        matches!(self, Self::Map(_) | Self::Iris(_) | Self::Source(0 | 1) | Self::Level(_) | Self::Wavefront(3..=5))
    }
}

#[cfg(test)]
mod tests {
    use super::super::fit::Exposure;
    use super::super::map::CameraMap;
    use super::*;
    use crate::optics::DisplayModel;

    #[test]
    fn what_the_pictures_say_nothing_of_is_named() {
        let map = CameraMap { numbers: [0.0; 10], slm: [8, 8], camera: [8, 8] };
        let at = Parameters { model: DisplayModel::default(), map, camera_pixel: CAMERA_PIXEL };
        let free = vec![Parameter::Fill, Parameter::Wavefront(12), Parameter::Undiffracted(3), Parameter::Crosstalk(1)];
        // Errors in shares of what is expected of any display.
        let error = |p: &Parameter| p.usual() * if *p == Parameter::Fill { 0.1 } else { 0.9 };
        let row = |i: usize| (0..free.len()).map(|j| if i == j { error(&free[i]).powi(2) } else { 0.0 }).collect();
        let covariance = (0..free.len()).map(row).collect();
        let fit = Fit { at, free: free.clone(), exposure: Exposure { gain: 1.0, dark: 0.0 }, squares: 1.0, covariance };
        assert_eq!(untold(&fit), ["wavefront 12"]);
        let pairs =
            [(Parameter::Wavefront(3), Parameter::Wavefront(11), 0.998), (Parameter::Map(8), Parameter::Map(9), -0.96)];
        let said = through_one_iris(&untold(&fit), &pairs);
        assert!(
            said.contains("nothing of wavefront 12; they do not tell wavefront 3 from wavefront 11, which"),
            "{said}"
        );
        assert!(!said.contains("camera"), "{said}");
    }
}
