//! Represents a source by fewer modes, for pupils that are wide enough to show no difference.
//!
//! If the image of a source is small compared with the pupil, its modes are nearly one disc and average nearly one
//! speckle. A wide pupil depends only on the mean distance of the modes. Therefore a few modes with the same mean and
//! spread are enough.

use super::light::{EXACT, place, speckle_contrast};
use super::source::SourceMode;
use std::sync::Arc;

/// Fewer modes that represent a source for wide pupils.
#[derive(Debug, Clone, PartialEq)]
pub struct FewerModes {
    /// Smallest diameter of a pupil for these modes, in meters. Narrower pupils need more modes.
    pub from: f64,
    /// The modes. Their weights add up to 1.
    pub modes: Arc<[SourceMode]>,
}

/// Diameters in meters that the search covers. They are the widest, the narrowest, and the ratio of neighbors.
const WIDEST: f64 = 0.1;
const NARROWEST: f64 = 0.5e-3;
const STEP: f64 = 1.05;

/// Lists of fewer and fewer modes for a source, in the order of their smallest diameters. From that diameter on, the
/// speckle contrast is right to 3 %. A wavelength counts as a place of the light at the eyebox's edge, `reach` meters
/// from the axis.
///
/// The lists are formulas of degree 3, 2 and 1 for the mean and covariance of the modes (Stroud 1971). They have 2 k
/// points, k + 1 points and one point, in the k dimensions that the modes fill. Two points of the same mean and mean
/// square distance are another list.
pub fn fewer_modes(modes: &[SourceMode], reach: f64, focal_length: f64) -> Vec<FewerModes> {
    let mut diameters = Vec::new();
    let mut diameter = WIDEST;
    while diameter >= NARROWEST && modes.len() > 1 {
        diameters.push((diameter, speckle_contrast(modes, diameter, reach, focal_length)));
        diameter /= STEP;
    }
    let mut found: Vec<FewerModes> = Vec::new();
    for few in candidates(modes, reach, focal_length) {
        let does = |(diameter, exact): &&(f64, f64)| {
            (speckle_contrast(&few, *diameter, reach, focal_length) / exact - 1.0).abs() <= EXACT
        };
        let Some((from, _)) = diameters.iter().take_while(does).last() else { continue };
        // A list with fewer modes that is as good replaces the longer ones.
        found.retain(|more| more.from < *from);
        found.push(FewerModes { from: *from, modes: few.into() });
    }
    found
}

/// Candidate lists of modes, the longest first.
fn candidates(modes: &[SourceMode], reach: f64, focal_length: f64) -> Vec<Vec<SourceMode>> {
    let mean_wavelength = modes.iter().map(|mode| mode.weight * mode.wavelength).sum::<f64>();
    let place = |mode: &SourceMode| (place(mode, mean_wavelength, reach, focal_length), mode.weight);
    let places: Vec<([f64; 3], f64)> = modes.iter().map(place).collect();
    let mean: [f64; 3] = std::array::from_fn(|i| places.iter().map(|(p, w)| w * p[i]).sum());
    let covariance: [[f64; 3]; 3] = std::array::from_fn(|i| {
        std::array::from_fn(|j| places.iter().map(|(p, w)| w * (p[i] - mean[i]) * (p[j] - mean[j])).sum())
    });
    let axes = root(covariance);
    let filled = axes.len();
    let along = |shares: &[f64]| -> [f64; 3] {
        std::array::from_fn(|i| axes.iter().zip(shares).map(|(axis, share)| axis[i] * share).sum())
    };
    let of = |points: Vec<[f64; 3]>| -> Vec<SourceMode> {
        let weight = 1.0 / points.len() as f64;
        let mode = |p: [f64; 3]| SourceMode {
            angle: [0, 1].map(|i| (mean[i] + p[i]) / focal_length),
            wavelength: if reach > 0.0 { mean_wavelength * (1.0 + p[2] / reach) } else { mean_wavelength },
            weight,
            ..SourceMode::centred(mean_wavelength)
        };
        points.into_iter().map(mode).collect()
    };
    let unit = |i: usize, by: f64| (0..filled).map(|j| if i == j { by } else { 0.0 }).collect::<Vec<_>>();
    let far = (filled as f64).sqrt();
    let cross = (0..filled).flat_map(|i| [along(&unit(i, far)), along(&unit(i, -far))]).collect();
    let corners = simplex(filled).iter().map(|corner| along(corner)).collect();
    let spread = covariance.iter().enumerate().map(|(i, row)| row[i]).sum::<f64>().sqrt();
    let diagonal = along(&vec![1.0; filled]);
    let long = diagonal.iter().map(|v| v * v).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    let two = vec![diagonal.map(|v| v * spread / long), diagonal.map(|v| -v * spread / long)];
    let mut lists: Vec<Vec<SourceMode>> = [cross, corners, two, vec![[0.0; 3]]].map(of).into();
    lists.retain(|list| list.len() < modes.len());
    lists.dedup_by_key(|list| list.len());
    lists
}

/// Vectors whose outer products add up to this symmetric, semi-definite matrix. They are the columns of Cholesky's
/// factor without the zero ones.
fn root(mut matrix: [[f64; 3]; 3]) -> Vec<[f64; 3]> {
    let whole = matrix.iter().enumerate().map(|(i, row)| row[i]).sum::<f64>();
    let mut columns = Vec::new();
    for i in 0..3 {
        if matrix[i][i] <= 1e-12 * whole {
            continue;
        }
        let pivot = matrix[i][i].sqrt();
        let column: [f64; 3] = std::array::from_fn(|j| matrix[j][i] / pivot);
        for (j, row) in matrix.iter_mut().enumerate() {
            row.iter_mut().zip(column).for_each(|(value, k)| *value -= column[j] * k);
        }
        columns.push(column);
    }
    columns
}

/// The corners of a regular simplex in this many dimensions. Its center is 0 and its covariance is 1 along each axis.
fn simplex(dimensions: usize) -> Vec<Vec<f64>> {
    let n = dimensions as f64;
    (0..=dimensions)
        .map(|corner| {
            let at = |axis: usize| {
                // The usual construction puts corner `axis` out along its axis, and the later corners on the opposite
                // side.
                let left = n - axis as f64;
                let out = ((n + 1.0) * left / (left + 1.0)).sqrt();
                match corner.cmp(&axis) {
                    std::cmp::Ordering::Less => 0.0,
                    std::cmp::Ordering::Equal => out,
                    std::cmp::Ordering::Greater => -out / left,
                }
            };
            (0..dimensions).map(at).collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const F: f64 = 0.4;
    const REACH: f64 = 11e-3;

    /// A grid of 3 x 3 modes of this width in meters, with this many lines that are two nanometers apart.
    fn grid(width: f64, lines: usize) -> Vec<SourceMode> {
        let at = |i: usize| (i as f64 - 1.0) * 0.5 * width / F;
        let mode = |i: usize, line: usize| SourceMode {
            angle: [at(i % 3) + 1e-3, 0.5 * at(i / 3)],
            wavelength: 520e-9 + 2e-9 * (line as f64 - 0.5 * (lines as f64 - 1.0)),
            weight: 1.0 / (9 * lines) as f64,
            ..SourceMode::centred(520e-9)
        };
        (0..9).flat_map(|i| (0..lines).map(move |line| mode(i, line))).collect()
    }

    fn moments(modes: &[SourceMode]) -> Vec<f64> {
        let of = |of: &dyn Fn(&SourceMode) -> f64| modes.iter().map(|m| m.weight * of(m)).sum::<f64>();
        let value = |m: &SourceMode| [m.angle[0] * 1e3, m.angle[1] * 1e3, m.wavelength * 1e9 - 520.0];
        let first = (0..3).map(|i| of(&|m| value(m)[i]));
        let second = (0..9).map(|k| of(&|m| value(m)[k / 3] * value(m)[k % 3]));
        first.chain(second).collect()
    }

    #[test]
    fn fewer_modes_have_the_source_s_mean_and_spread() {
        for (lines, lengths) in [(1, vec![4, 3, 2, 1]), (2, vec![6, 4, 2, 1])] {
            let all = grid(2e-3, lines);
            let lists = candidates(&all, REACH, F);
            assert_eq!(lists.iter().map(Vec::len).collect::<Vec<_>>(), lengths);
            let wanted = moments(&all);
            for list in &lists {
                let found = moments(list);
                assert!((list.iter().map(|m| m.weight).sum::<f64>() - 1.0).abs() < 1e-12);
                let same = |range: std::ops::Range<usize>| {
                    range.into_iter().all(|i| (found[i] - wanted[i]).abs() < 1e-9 * wanted[3].abs())
                };
                assert!(same(0..3), "{} modes: {found:?} {wanted:?}", list.len());
                assert!(list.len() < 3 || same(3..12), "{} modes: {found:?} {wanted:?}", list.len());
            }
        }
    }

    #[test]
    fn wide_pupils_have_fewer_and_their_speckle_stays() {
        let all = grid(2e-3, 1);
        let fewer = fewer_modes(&all, REACH, F);
        let counts: Vec<usize> = fewer.iter().map(|few| few.modes.len()).collect();
        assert_eq!(counts, [4, 3, 2, 1]);
        assert!(fewer.windows(2).all(|pair| pair[0].from < pair[1].from), "{fewer:?}");
        for few in &fewer {
            for wider in [1.0, 1.3, 2.0] {
                let contrast = |modes: &[SourceMode]| speckle_contrast(modes, wider * few.from, REACH, F);
                assert!((contrast(&few.modes) / contrast(&all) - 1.0).abs() <= EXACT);
            }
        }
        // A smaller source needs fewer modes at the same pupil. A point needs none.
        let smaller = fewer_modes(&grid(1e-3, 1), REACH, F);
        assert!(smaller.iter().zip(&fewer).all(|(a, b)| a.from < b.from));
        assert!(fewer_modes(&all[..1], REACH, F).is_empty());
    }
}
