//! Fits the relay's wavefront from small orders to large ones.
//!
//! Each order is added when the order before it has come near enough.

use super::classified::Sorted;
use super::error::CalibrateError;
use super::fit::{COARSE, Effort, Fit};
use super::holdout::holdout;
use super::parameters::{ORDERS, Parameter, Parameters, indices_of_order, of_order};
use super::slopes::from_shifts;

/// Irises up to this share of the eyebox are small. They see a slope of the wavefront as a shift of the picture.
const SMALL: f64 = 0.24;
/// The highest order that the slopes start and that is fitted at once.
const NEXT: u32 = 5;
/// A small iris of which more than this share is left is in a wrong minimum. `RESCUES` is the number of searches for
/// such irises.
const LOST: f64 = 0.3;
const RESCUES: usize = 3;
/// The slopes are right if no more than this share of the small irises is left.
const RIGHT: f64 = 0.15;
/// Widths of crosstalk that are tried, as multiples of the usual one.
const SIGMAS: [f64; 4] = [1.0, 1.7, 3.0, 6.0];
/// An order is kept if it reduces what is left of the pictures that were not fitted by this share.
const GAINS: f64 = 0.02;
/// An order is also kept if a term of it is this many standard errors from zero.
const SURE: f64 = 5.0;

/// The pictures of single random patterns, through small irises and through all irises.
pub(super) struct Random {
    pub(super) small: Vec<usize>,
    pub(super) all: Vec<usize>,
}

impl Random {
    pub(super) fn new(sorted: &Sorted) -> Self {
        let pictures = &sorted.pictures;
        let pattern = |v: &usize| &pictures.sets[pictures.views[*v].set].pattern;
        let single = |v: &usize| pattern(v).frames == 1 && pattern(v).even_drive().is_none();
        let all: Vec<usize> = sorted.fitted.iter().copied().filter(single).collect();
        let narrow = |v: &usize| pictures.views[*v].pupil().diameter <= SMALL * pictures.optics.eyebox();
        let small: Vec<usize> = all.iter().copied().filter(|v| narrow(v) && !pattern(v).is_smooth()).collect();
        // A bench whose irises are all wide has nothing better.
        let small = if small.len() < 3 { all.clone() } else { small };
        Self { small, all }
    }
}

/// The wavefront's terms of these orders.
fn terms(orders: std::ops::RangeInclusive<u32>) -> Vec<Parameter> {
    orders.flat_map(of_order).collect()
}

/// The numbers that the small irises determine. They are the wavefront to the fifth order, crosstalk and source, held
/// near `known`.
pub(super) fn slopes(
    sorted: &Sorted,
    random: &Random,
    [known, start]: [&Parameters; 2],
    observe: &mut dyn FnMut(f64),
) -> Result<Parameters, CalibrateError> {
    let pictures = &sorted.pictures;
    let share = |at: &Parameters| sorted.mean_left(at, &random.small);
    let shifted = |at: Parameters, highest: u32| {
        let named: Vec<u32> = (*ORDERS.start()..=highest).flat_map(indices_of_order).collect();
        let trial = from_shifts(pictures, &at, &random.small, &named);
        let [before, after] = [share(&at), share(&trial)];
        tracing::debug!("small irises: {before:.4} is left, {after:.4} with the slopes of their shifts");
        if after < before { (trial, true) } else { (at, false) }
    };
    let best = shifted(start.clone(), NEXT).0;
    // Too much crosstalk disappears slowly, and too little appears slowly. The fit therefore starts with the width that
    // explains most.
    let wider = |factor: f64| {
        let mut at = best.clone();
        at.model.crosstalk.iter_mut().flatten().for_each(|side| side.sigma *= factor);
        at
    };
    let widths = SIGMAS.map(wider).map(|at| (share(&at), at));
    let Some((least, best)) = widths.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(start.clone()) };
    tracing::debug!("small irises: {least:.4} is left with the best width of crosstalk");
    // Pictures far from the middle show no shift before crosstalk is about right.
    let best = if least > RIGHT { shifted(best, NEXT).0 } else { best };
    let mut free = terms(*ORDERS.start()..=NEXT);
    free.extend(Parameter::all(best.model.undiffracted.len()).into_iter().filter(|p| {
        matches!(p, Parameter::Crosstalk(_) | Parameter::Source(_) | Parameter::Map(_) | Parameter::Undiffracted(..))
            || matches!(p, Parameter::Level(_) | Parameter::Bend(_))
    }));
    let which: Vec<usize> = sorted.even.iter().chain(&random.small).copied().collect();
    let mut at = pictures.fit(known, &best, &free, &which, COARSE, &mut |p| observe(p))?.at;
    tracing::debug!("small irises, fifth order: {:.4} is left", share(&at));
    // A picture in a wrong minimum pulls at the others and is excluded in the end. No other picture would determine its
    // part of the wavefront.
    free.extend(terms(NEXT + 1..=*ORDERS.end()));
    for _ in 0..RESCUES {
        let left = pictures.left(&random.small, &pictures.see(&at, COARSE.subpixels, &random.small, &[]));
        if left.iter().all(|[left, _]| *left < LOST) {
            break;
        }
        let (trial, better) = shifted(at.clone(), *ORDERS.end());
        if !better {
            break;
        }
        let trial = pictures.fit(known, &trial, &free, &which, COARSE, &mut |p| observe(p))?.at;
        tracing::debug!("small irises, lost ones found: {:.4} is left", share(&trial));
        if share(&trial) > share(&at) {
            break;
        }
        at = trial;
    }
    Ok(at)
}

/// Adds orders of the wavefront to a fit while they gain. Returns the last fit, with its orders among the free numbers.
pub(super) fn more(
    sorted: &Sorted,
    which: &[usize],
    known: &Parameters,
    mut best: Fit,
    effort: Effort,
) -> Result<Fit, CalibrateError> {
    let judge = |at: &Parameters| match sorted.pairs.is_empty() {
        true => sorted.mean_left(at, which),
        false => holdout(sorted, at, effort.subpixels).left,
    };
    let mut left = judge(&best.at);
    for order in NEXT + 1..=*ORDERS.end() {
        let added: Vec<Parameter> = of_order(order).collect();
        let free: Vec<Parameter> = best.free.iter().chain(&added).copied().collect();
        let fit = sorted.pictures.fit(known, &best.at, &free, which, effort, &mut |_| ())?;
        let now = judge(&fit.at);
        let surest = added.iter().filter_map(|p| Some(fit.at.get(*p).abs() / fit.error(*p)?)).fold(0.0, f64::max);
        tracing::debug!("order {order}: {now:.4} after {left:.4} is left, at most {surest:.1} standard errors");
        if !gains(left, now, surest) {
            break;
        }
        (best, left) = (fit, now);
    }
    Ok(best)
}

/// True if an order is kept, by the share that is left of the pictures that were not fitted, before and now, and by its
/// surest term.
fn gains(before: f64, now: f64, surest: f64) -> bool {
    now < (1.0 - GAINS) * before || surest > SURE && now < before
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_stays_while_pictures_gain_or_its_terms_are_sure() {
        assert!(gains(0.10, 0.09, 0.0));
        assert!(!gains(0.10, 0.099, 3.0));
        assert!(gains(0.10, 0.099, 8.0));
        // An order does not stay if the pictures that judge it lose, even if its terms are sure.
        assert!(!gains(0.10, 0.101, 8.0));
    }
}
