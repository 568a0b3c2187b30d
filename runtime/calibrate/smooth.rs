//! What smooth patterns tell of a display, before anything is known of its crosstalk: they excite none (OPTICS 10).

use super::error::CalibrateError;
use super::fit::{Effort, Exposure};
use super::parameters::{Parameter, Parameters};
use super::sorted::Sorted;

/// What is fitted without crosstalk.
pub(super) const PLAIN: Effort = Effort { subpixels: 1, slopes: 1, rounds: 12, enough: 0.01 };
/// Smooth patterns of a display that is inside the model are fitted to so many times the noise; crosstalk is not in that fit.
const TOLD: f64 = 2.0;
/// So many phases of undiffracted light are tried from one place.
const GUESSES: usize = 3;

/// What smooth patterns tell: the map, source, table, undiffracted light. Undiffracted light has many minima: where a fit is far
/// from the noise, others begin elsewhere.
pub(super) fn smooth(
    sorted: &Sorted,
    start: &Parameters,
    map: &[Parameter],
    observe: &mut dyn FnMut(f64),
) -> Result<Parameters, CalibrateError> {
    let pictures = &sorted.pictures;
    // A model from a file knows the crosstalk; an unknown one is not to be seen in smooth patterns.
    let near =
        |p: &Parameter| !matches!(p, Parameter::Crosstalk(_) | Parameter::Fill | Parameter::Lag | Parameter::Map(_));
    let rest = |p: &Parameter| matches!(p, Parameter::Undiffracted(_));
    let mut free: Vec<Parameter> = Parameter::all().into_iter().filter(|p| near(p) && !rest(p)).collect();
    free.extend(map);
    let without = pictures.fit(start, &free, &sorted.smooth, PLAIN, &mut |part| observe(0.3 * part))?;
    let mut from = vec![(without.at.clone(), without.exposure)];
    if start.model.undiffracted == [0.0; 5] {
        // What there is of it may have led the others astray.
        let seen = pictures.see(start, 1, &sorted.smooth, &[]);
        from.push((start.clone(), pictures.exposure(&sorted.smooth, &seen)));
    }
    free.extend((0..5).map(Parameter::Undiffracted));
    let guesses = from.iter().flat_map(|(at, exposure)| match at.model.undiffracted == [0.0; 5] {
        true => undiffracted(sorted, at, *exposure),
        false => vec![at.clone()],
    });
    let effort = Effort { rounds: 40, enough: 3e-3, ..PLAIN };
    let (mut best, mut done) = (without, 0.3);
    for guess in guesses {
        let ahead = 0.5 * (1.0 - done);
        let fit = pictures.fit(&guess, &free, &sorted.smooth, effort, &mut |part| observe(done + ahead * part))?;
        done += ahead;
        tracing::debug!("smooth patterns: {:.2} times the noise is left", fit.squares);
        if fit.squares < best.squares {
            best = fit;
        }
        if best.squares < TOLD {
            break;
        }
    }
    Ok(best.at)
}

/// With undiffracted light that explains most of what a fit left, and with what does nearly so well by another phase, in that order:
/// nothing of the phase shows while the amplitude is 0.
fn undiffracted(sorted: &Sorted, at: &Parameters, exposure: Exposure) -> Vec<Parameters> {
    let pictures = &sorted.pictures;
    let which: Vec<usize> = sorted.smooth.iter().copied().take(4).collect();
    let free = [Parameter::Undiffracted(0), Parameter::Undiffracted(1)];
    let now = pictures.see(at, 1, &which, &[]);
    let residuals: Vec<Vec<f64>> =
        which.iter().zip(&now).map(|(v, seen)| pictures.residuals(*v, seen, exposure)).collect();
    let mut all = Vec::new();
    for i in 0..9 * 9 * 3 {
        let phase = [f64::from(i % 9 - 4), f64::from(i / 9 % 9 - 4), f64::from(i / 81 - 1)];
        let mut at = at.clone();
        at.model.undiffracted[2..].copy_from_slice(&phase);
        let seen = pictures.see(&at, 1, &which, &free);
        let mut sums = [0.0; 5];
        for ((v, seen), residuals) in which.iter().zip(&seen).zip(&residuals) {
            let gain = exposure.gain * pictures.views[*v].exposure_ms;
            for (i, r) in residuals.iter().enumerate() {
                let (re, im, w) =
                    (seen.slopes[0][i] * gain, seen.slopes[1][i] * gain, 1.0 / pictures.views[*v].variance[i]);
                for (sum, term) in sums.iter_mut().zip([re * re, re * im, im * im, -re * r, -im * r]) {
                    *sum += term * w;
                }
            }
        }
        let [rr, ri, ii, r, m] = sums;
        let det = rr * ii - ri * ri;
        let (re, im) = ((ii * r - ri * m) / det, (rr * m - ri * r) / det);
        let gained = re * r + im * m;
        if gained.is_finite() && gained > 0.0 && re.hypot(im) < 0.5 {
            all.push((gained, [re, im, phase[0], phase[1], phase[2]]));
        }
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let apart = unlike(all.into_iter().map(|(_, guess)| guess));
    let with = |guess: [f64; 5]| {
        let mut at = at.clone();
        at.model.undiffracted = guess;
        at
    };
    apart.into_iter().map(with).collect()
}

/// The first [`GUESSES`] of them whose phases are unlike: neighbours on the grid lead to the same minimum.
fn unlike(guesses: impl Iterator<Item = [f64; 5]>) -> Vec<[f64; 5]> {
    let mut apart: Vec<[f64; 5]> = Vec::new();
    for guess in guesses {
        if apart.iter().all(|other| (2..5).any(|i| (other[i] - guess[i]).abs() > 1.5)) {
            apart.push(guess);
        }
        if apart.len() == GUESSES {
            break;
        }
    }
    apart
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guesses_are_unlike_and_the_best_comes_first() {
        let phase = |x, y, r| [0.1, 0.0, x, y, r];
        let all = [
            phase(0.0, 0.0, 0.0),
            phase(1.0, 0.0, 1.0),
            phase(-2.0, 0.0, 1.0),
            phase(0.0, 2.0, 0.0),
            phase(4.0, 4.0, 0.0),
        ];
        assert_eq!(unlike(all.into_iter()), [all[0], all[2], all[3]]);
        assert_eq!(unlike(std::iter::empty()), [[0.0; 5]; 0]);
    }
}
