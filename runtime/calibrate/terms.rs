//! Finds the terms of the model that show, and writes them into the display file.

use super::age::today;
use super::error::CalibrateError;
use super::fit::{Effort, Fit};
use super::parameters::{ORDERS, Parameter, Parameters, of_order};
use super::report::Report;
use super::verdict::Verdict;
use super::views::Pictures;
use eyebox_optics::linear::solve;
use eyebox_optics::{Color, Display, DisplayModel, Level, ModelTerms, Spread, WAVES};

/// A term less than this many standard errors from its start stays there.
const SHOWS: f64 = 3.0;

/// The groups of parameters, each of which is on or off as a whole.
fn terms() -> Vec<Vec<Parameter>> {
    let counted = |make: fn(usize) -> Parameter, count: usize| (0..count).map(make).collect::<Vec<_>>();
    let mut terms = vec![
        counted(Parameter::Crosstalk, 8),
        counted(Parameter::Level, 9),
        counted(Parameter::Bend, 2),
        vec![Parameter::Lag],
        counted(Parameter::Source, 5),
        vec![Parameter::Fill],
        counted(Parameter::Iris, 3),
    ];
    terms.extend((0..WAVES).map(|wave| Parameter::of_wave(wave).collect()));
    terms.extend(ORDERS.flat_map(of_order).map(|p| vec![p]));
    terms
}

/// True if a term shows. Its gain in squares must exceed the gain of its numbers by chance, by `SHOWS` standard errors.
fn shows(fit: &Fit, start: &Parameters, term: &[Parameter]) -> bool {
    let places: Vec<usize> = term.iter().filter_map(|p| fit.free.iter().position(|f| f == p)).collect();
    if places.is_empty() {
        return false;
    }
    if let Parameter::Crosstalk(_) = term[0] {
        return crosstalk_shows(fit);
    }
    let off = |p: &usize| match fit.free[*p] {
        // At 0 the light depends on the square of the fill factor.
        Parameter::Fill => (fit.at.model.fill - start.model.fill) / 2.0,
        p => fit.at.get(p) - start.get(p),
    };
    // Amplitudes only, because phases mean nothing without them.
    let places: Vec<usize> =
        places.into_iter().filter(|p| !matches!(fit.free[*p], Parameter::Undiffracted(_, 2..))).collect();
    let away: Vec<f64> = places.iter().map(off).collect();
    let among: Vec<Vec<f64>> = places.iter().map(|i| places.iter().map(|j| fit.covariance[*i][*j]).collect()).collect();
    let Some(solved) = solve(&among, &away) else { return true };
    let squares: f64 = away.iter().zip(solved).map(|(a, s)| a * s).sum();
    let n = away.len() as f64;
    squares > n - 1.0 + SHOWS * SHOWS * (1.0 + (2.0 * (n - 1.0)).sqrt() / SHOWS)
}

/// True if the transfer of any side at half a cycle per pixel is less than 1 by more than `SHOWS` standard errors.
fn crosstalk_shows(fit: &Fit) -> bool {
    let Some(sides) = fit.at.model.crosstalk else { return false };
    sides.iter().enumerate().any(|(side, Spread { q, sigma })| {
        let loss = (0.5 / sigma).powf(*q);
        // The slopes are by ln q and ln sigma.
        let slopes = [loss * q * (0.5 / sigma).ln(), -loss * q];
        let places = [0, 1].map(|i| fit.free.iter().position(|p| *p == Parameter::Crosstalk(2 * side + i)));
        let [Some(a), Some(b)] = places else { return false };
        let c = &fit.covariance;
        let variance =
            slopes[0] * slopes[0] * c[a][a] + 2.0 * slopes[0] * slopes[1] * c[a][b] + slopes[1] * slopes[1] * c[b][b];
        loss > SHOWS * variance.sqrt()
    })
}

/// The terms that do not show. Orders of the wavefront are tested from the highest down, each after the orders above it
/// that do not show are removed. Through one iris high orders look much like low ones, and the low ones should stay.
fn hidden(fit: &Fit, start: &Parameters) -> Vec<Parameter> {
    let (mut fit, mut hidden) = (fit.clone(), Vec::new());
    for term in terms().into_iter().rev() {
        if !fit.free.contains(&term[0]) || shows(&fit, start, &term) {
            continue;
        }
        if let [order @ Parameter::Wavefront(_)] = term[..] {
            fit = without(&fit, start, order);
        }
        hidden.extend(term);
    }
    hidden.retain(|p| fit.free.contains(p));
    hidden
}

/// Estimates, by the slopes of a fit, the fit in which a number stays at its start.
fn without(fit: &Fit, start: &Parameters, number: Parameter) -> Fit {
    let Some(at) = fit.free.iter().position(|p| *p == number) else { return fit.clone() };
    let mut fit = fit.clone();
    let (row, off) = (fit.covariance[at].clone(), start.get(number) - fit.at.get(number));
    let moves: Vec<f64> = row.iter().map(|c| c / row[at] * off).collect();
    fit.at = fit.at.stepped(&fit.free, &moves);
    for (i, of) in fit.covariance.iter_mut().enumerate() {
        of.iter_mut().zip(&row).for_each(|(c, r)| *c -= row[i] * r / row[at]);
    }
    fit
}

/// Resets terms that do not show, and fits the others once more, near `known`. Their errors include the terms that were
/// left out.
pub(super) fn settle(
    pictures: &Pictures,
    which: &[usize],
    [start, known]: [&Parameters; 2],
    mut fit: Fit,
    effort: Effort,
) -> Result<Fit, CalibrateError> {
    let mut omitted = Vec::new();
    for _ in 0..2 {
        let hidden = hidden(&fit, start);
        if hidden.is_empty() {
            break;
        }
        tracing::debug!("left out: {hidden:?}");
        let mut at = fit.at.clone();
        at.model = with_terms_of(&at.model, &start.model, &hidden);
        let shown = |p: &Parameter| !hidden.contains(p) && !matches!(p, Parameter::Iris(_));
        let free: Vec<Parameter> = fit.free.iter().copied().filter(shown).collect();
        let iris = [0, 1, 2].map(|i| fit.error(Parameter::Iris(i)));
        let iris = if hidden.contains(&Parameter::Iris(0)) { [None; 3] } else { iris };
        fit = pictures.fit(known, &at, &free, which, effort, &mut |_| ())?;
        if let [Some(x), Some(y), Some(scale)] = iris {
            fit = fit.with_iris([x, y, scale]);
        }
        omitted.extend(hidden);
    }
    Ok(pictures.with_omitted(fit, &omitted, which, effort))
}

fn with_terms_of(model: &DisplayModel, other: &DisplayModel, hidden: &[Parameter]) -> DisplayModel {
    let mut model = model.clone();
    for p in hidden {
        match p {
            Parameter::Crosstalk(_) => model.crosstalk = other.crosstalk,
            Parameter::Level(_) => model.level = other.level,
            Parameter::Bend(_) => model.bend = other.bend,
            Parameter::Lag => model.lag = other.lag,
            Parameter::Source(_) => model.source = other.source,
            // Waves with higher indices keep their indices.
            Parameter::Undiffracted(wave, _) => {
                if let Some(here) = model.undiffracted.get_mut(*wave) {
                    *here = other.undiffracted.get(*wave).copied().unwrap_or_default();
                }
            }
            Parameter::Fill => model.fill = other.fill,
            Parameter::Iris(_) => model.iris = other.iris,
            Parameter::Wavefront(j) => match other.wavefront.get(j) {
                Some(waves) => drop(model.wavefront.insert(*j, *waves)),
                None => drop(model.wavefront.remove(j)),
            },
            Parameter::Map(_) | Parameter::CameraPixel => {}
        }
    }
    let lit = model.undiffracted.iter().rposition(|wave| wave[..2] != [0.0; 2]);
    model.undiffracted.truncate(lit.map_or(0, |last| last + 1));
    model
}

/// The display with the fitted terms and their standard errors.
pub(super) fn written(display: &Display, color: Color, start: &Parameters, fit: &Fit, report: &Report) -> Display {
    let mut display = display.clone();
    if fit.at.model == start.model {
        return display;
    }
    let (at, mut errors, mut terms) = (&fit.at, ModelTerms::default(), ModelTerms::default());
    let error = |p: Parameter| fit.error(p).unwrap_or(0.0);
    let rounded = |value: f64, error: f64| {
        // Two digits of the error are enough. Numbers that were not fitted keep all digits.
        if error <= 0.0 || !error.is_finite() {
            return value;
        }
        let unit = 10f64.powi(error.log10().floor() as i32 - 2);
        let text = format!("{:e}", (value / unit).round() * unit);
        format!("{:.12e}", text.parse::<f64>().unwrap_or(value)).parse().unwrap_or(value)
    };
    let number = |p: Parameter| rounded(at.get(p), error(p));
    let about = |p: Parameter| rounded(error(p), error(p));
    let fitted = |p: Parameter| fit.free.contains(&p);
    let (model, old) = (&at.model, &start.model);
    if fitted(Parameter::Level(0)) || model.level != old.level {
        let nodes =
            |value: &dyn Fn(Parameter) -> f64| [0, 1, 2].map(|y| [0, 1, 2].map(|x| value(Parameter::Level(3 * y + x))));
        terms.level = Some(Level::Nodes(nodes(&number)));
        errors.level = Some(Level::Nodes(nodes(&about)));
    }
    if fitted(Parameter::Bend(0)) {
        terms.bend = Some([0, 1].map(|i| number(Parameter::Bend(i))));
        errors.bend = Some([0, 1].map(|i| about(Parameter::Bend(i))));
    }
    if fitted(Parameter::Lag) {
        (terms.lag, errors.lag) = (Some(number(Parameter::Lag).max(0.0)), Some(about(Parameter::Lag)));
    }
    if fitted(Parameter::Crosstalk(0)) {
        let side = |i: usize| {
            let error = |i: usize| error(Parameter::Crosstalk(i));
            let value = |i: usize| at.get(Parameter::Crosstalk(i)).exp();
            let number = |i: usize| rounded(value(i), error(i) * value(i));
            let about = |i: usize| rounded(error(i) * value(i), error(i) * value(i));
            [[number(2 * i), number(2 * i + 1)], [about(2 * i), about(2 * i + 1)]].map(Spread::from)
        };
        let sides = [0, 1, 2, 3].map(side);
        terms.crosstalk = Some(sides.map(|[number, _]| number));
        errors.crosstalk = Some(sides.map(|[_, about]| about));
    }
    if fitted(Parameter::Fill) {
        (terms.fill, errors.fill) = (Some(number(Parameter::Fill)), Some(about(Parameter::Fill)));
    }
    let five =
        |make: &dyn Fn(usize) -> Parameter, value: &dyn Fn(Parameter) -> f64| [0, 1, 2, 3, 4].map(|i| value(make(i)));
    if fitted(Parameter::Source(0)) {
        terms.source = Some(five(&Parameter::Source, &number));
        errors.source = Some(five(&Parameter::Source, &about));
    }
    if (0..WAVES).any(|wave| fitted(Parameter::Undiffracted(wave, 0))) {
        let lit = |wave: &usize| model.undiffracted[*wave][..2] != [0.0; 2];
        let waves: Vec<usize> = (0..model.undiffracted.len()).filter(lit).collect();
        let all = |value: &dyn Fn(Parameter) -> f64| {
            let of_wave = |wave: &usize| five(&|i| Parameter::Undiffracted(*wave, i), value);
            Some(waves.iter().map(of_wave).collect())
        };
        (terms.undiffracted, errors.undiffracted) = (all(&number), all(&about));
    }
    if fitted(Parameter::Iris(0)) {
        terms.iris = Some([0, 1, 2].map(|i| number(Parameter::Iris(i))));
        errors.iris = Some([0, 1, 2].map(|i| about(Parameter::Iris(i))));
    }
    terms.wavefront = model.wavefront.keys().map(|j| (*j, number(Parameter::Wavefront(*j)))).collect();
    let named = terms.wavefront.keys().filter(|j| fitted(Parameter::Wavefront(**j)));
    errors.wavefront = named.map(|j| (*j, about(Parameter::Wavefront(*j)))).collect();
    match report.quick {
        // The other terms stay as the whole calibration fitted them.
        true => terms.updated = today(),
        false => {
            terms.from = format!("eyebox display calibrate, {} pictures", report.captures);
            terms.date = today();
            terms.unexplained = report.unexplained.filter(|_| report.verdict == Verdict::WithFaults);
        }
    }
    let section = display.model.entry(color.into()).or_default();
    let before = std::mem::take(section);
    *section = merged(before, terms, errors);
    display
}

/// Merges the fitted terms into the earlier ones, with the errors of both.
fn merged(mut before: ModelTerms, fitted: ModelTerms, errors: ModelTerms) -> ModelTerms {
    let known = before.errors.take().map_or_else(ModelTerms::default, |errors| *errors);
    let mut waves = known.wavefront.clone();
    waves.extend(errors.wavefront.clone());
    waves.retain(|j, _| fitted.wavefront.contains_key(j));
    let errors = ModelTerms { wavefront: waves, ..over(known, errors) };
    let fitted = match fitted.date.is_empty() {
        // Only drift was fitted.
        true => ModelTerms {
            from: before.from.clone(),
            date: before.date.clone(),
            unexplained: before.unexplained,
            ..fitted
        },
        false => fitted,
    };
    ModelTerms { errors: Some(Box::new(errors)), ..over(before, fitted) }
}

/// The display with a model that the pictures confirm, with today's date of the check.
pub(super) fn confirmed(display: &Display, color: Color) -> Display {
    let mut display = display.clone();
    if let Some(terms) = display.model.get_mut(&color.into()).filter(|terms| !terms.date.is_empty()) {
        terms.updated = today();
    }
    display
}

/// The fitted terms, with the earlier ones for terms that were not fitted.
fn over(before: ModelTerms, fitted: ModelTerms) -> ModelTerms {
    let wavefront = if fitted.wavefront.is_empty() { before.wavefront } else { fitted.wavefront };
    ModelTerms {
        level: fitted.level.or(before.level),
        bend: fitted.bend.or(before.bend),
        lag: fitted.lag.or(before.lag),
        crosstalk: fitted.crosstalk.or(before.crosstalk),
        subpixels: fitted.subpixels.or(before.subpixels),
        fill: fitted.fill.or(before.fill),
        source: fitted.source.or(before.source),
        undiffracted: fitted.undiffracted.or(before.undiffracted),
        iris: fitted.iris.or(before.iris),
        wavefront,
        ..fitted
    }
}
