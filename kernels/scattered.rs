//! Solves Fourier disparity layers (OPTICS 14) of views at any positions. The method is ridge regression at one
//! frequency, in float64. Positions without symmetry make the normal equations complex.

use crate::regression::Found;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Views at any positions, and the layers that explain them.
#[derive(Debug, Clone)]
pub struct Scattered {
    /// Position (y, x) of each view.
    pub places: Vec<[f64; 2]>,
    /// Pixels by which the content of the first layer moves per unit of position.
    pub slope: f64,
    /// Additional pixels for each further layer. Layers are evenly spaced.
    pub step: f64,
    /// Pixels by which the content of each layer moves across the eyebox, as in
    /// [`Regression`](crate::regression::Regression).
    pub movement: Vec<f64>,
    /// Expected noise, which regularizes all layers.
    pub ridge: f64,
    /// Weight that damps layers that the views cannot distinguish.
    pub smooth: f64,
}

impl Scattered {
    /// Solves the layers at frequency `omega` (y, x) in cycles per pixel, from the spectra of the views there. It also
    /// computes the difference of each view from the prediction by the others.
    pub fn solve(&self, omega: [f64; 2], views: &[Complex64], found: &mut Found) {
        let k = self.movement.len();
        let turns: Vec<f64> = self.places.iter().map(|[y, x]| TAU * (omega[0] * y + omega[1] * x)).collect();
        let row = |turn: f64| (0..k).map(move |i| Complex64::cis(turn * (self.slope + self.step * i as f64)));
        let lag = |l: usize| turns.iter().map(|turn| Complex64::cis(turn * self.step * l as f64)).sum::<Complex64>();
        let lags: Vec<Complex64> = (0..k).map(lag).collect();
        let frequency = omega[0].hypot(omega[1]);
        let mut factor = vec![Complex64::ZERO; k * k];
        for i in 0..k {
            for j in 0..=i {
                factor[i * k + j] = lags[i - j].conj();
            }
            let moved = (frequency * self.movement[i]).powi(4);
            factor[i * k + i] += self.places.len() as f64 * (self.ridge + self.smooth * moved);
        }
        cholesky(&mut factor, k);
        let mut layers = vec![Complex64::ZERO; k];
        for (turn, view) in turns.iter().zip(views) {
            layers.iter_mut().zip(row(*turn)).for_each(|(l, a)| *l += a.conj() * view);
        }
        forward(&factor, &mut layers);
        backward(&factor, &mut layers);
        found.left_out.clear();
        let mut solved = Vec::with_capacity(k);
        for (turn, view) in turns.iter().zip(views) {
            let shown: Complex64 = row(*turn).zip(&layers).map(|(a, l)| a * l).sum();
            solved.clear();
            solved.extend(row(*turn).map(|a| a.conj()));
            forward(&factor, &mut solved);
            let own = 1.0 - solved.iter().map(Complex64::norm_sqr).sum::<f64>();
            found.left_out.push((view - shown) / own);
        }
        found.layers = layers;
    }
}

/// Replaces the lower triangle of a Hermitian matrix by its Cholesky factor.
fn cholesky(matrix: &mut [Complex64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let dot: Complex64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k].conj()).sum();
            let rest = matrix[i * n + j] - dot;
            matrix[i * n + j] = match i == j {
                true => Complex64::new(rest.re.max(f64::MIN_POSITIVE).sqrt(), 0.0),
                false => rest / matrix[j * n + j].re,
            };
        }
    }
}

fn forward(factor: &[Complex64], values: &mut [Complex64]) {
    let n = values.len();
    for i in 0..n {
        let dot: Complex64 = (0..i).map(|k| factor[i * n + k] * values[k]).sum();
        values[i] = (values[i] - dot) / factor[i * n + i].re;
    }
}

fn backward(factor: &[Complex64], values: &mut [Complex64]) {
    let n = values.len();
    for i in (0..n).rev() {
        let dot: Complex64 = (i + 1..n).map(|k| factor[k * n + i].conj() * values[k]).sum();
        values[i] = (values[i] - dot) / factor[i * n + i].re;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regression::Regression;

    /// With positions on a grid, the result equals the regression of the grid.
    #[test]
    fn positions_of_a_grid_are_the_grid() {
        let movement: Vec<f64> = [-1.4, -0.45, 0.5].iter().map(|d| 5.0 * d).collect();
        let (ridge, smooth) = (0.05, 0.0005);
        let grid = Regression { grid: [2, 3], disparity: -1.4, step: 0.95, movement: movement.clone(), ridge, smooth };
        let places = (0..6).map(|v| [(v / 3) as f64 - 0.5, (v % 3) as f64 - 1.0]).collect();
        let any = Scattered { places, slope: -1.4, step: 0.95, movement, ridge, smooth };
        let views: Vec<Complex64> = (0..6).map(|i| Complex64::new((i as f64).sin(), (2.0 * i as f64).cos())).collect();
        let [mut a, mut b] = [Found::default(), Found::default()];
        grid.solve([0.13, -0.21], &views, &mut a);
        any.solve([0.13, -0.21], &views, &mut b);
        let same = |a: &[Complex64], b: &[Complex64]| {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).norm() < 1e-9)
        };
        assert!(same(&a.layers, &b.layers), "{:?} {:?}", a.layers, b.layers);
        assert!(same(&a.left_out, &b.left_out), "{:?} {:?}", a.left_out, b.left_out);
    }
}
