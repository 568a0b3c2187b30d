//! Solves Fourier disparity layers (OPTICS 14) by ridge regression at one frequency, in float64. The code is in this
//! crate because a debug build still optimizes it.

use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

/// Views on a grid around the axis, and the layers that explain them.
#[derive(Debug, Clone)]
pub struct Regression {
    /// Rows and columns of the grid of views.
    pub grid: [usize; 2],
    /// Pixels by which the content of the first layer moves from view to view.
    pub disparity: f64,
    /// Additional pixels for each further layer. Layers are evenly spaced.
    pub step: f64,
    /// Pixels by which the content of each layer moves across the eyebox.
    pub movement: Vec<f64>,
    /// Expected noise, which regularizes all layers.
    pub ridge: f64,
    /// Weight that damps layers that the views cannot distinguish.
    pub smooth: f64,
}

/// Results at one frequency, and reusable memory.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// Spectra of the layers.
    pub layers: Vec<Complex64>,
    /// Difference of each view from the prediction by the other views.
    pub left_out: Vec<Complex64>,
    matrix: Vec<f64>,
    seen: Vec<Complex64>,
    solved: Vec<Complex64>,
    /// Factors for each row, then for each column of views. The first turns the content of the first layer, and the
    /// second is the additional turn of each further layer.
    turns: Vec<[Complex64; 2]>,
    steps: Vec<Complex64>,
    /// One entry per distance of two layers.
    diagonals: Vec<f64>,
    /// Inverse of the factor of the normal equations, row by row.
    inverse: Vec<f64>,
}

impl Regression {
    /// Solves the layers at frequency `omega` (y, x) in cycles per pixel, from the spectra of the views there. The
    /// views are symmetric, so the normal equations `(A^H A + Gamma) L = A^H V` are real. The layers are evenly spaced.
    /// The entries of `A^H A`, and the inverse of the equations as a view sees it, therefore depend on the distances of
    /// the layers only.
    pub fn solve(&self, omega: [f64; 2], views: &[Complex64], found: &mut Found) {
        let (k, [rows, columns]) = (self.movement.len(), self.grid);
        found.layers.resize(k, Complex64::ZERO);
        self.turn(omega, found);
        let Found { layers, left_out, matrix, seen, turns, steps, diagonals, inverse, .. } = found;
        // The Gram matrix, stored by its diagonals.
        diagonals.clear();
        diagonals.resize(k, 0.0);
        let mut powers = [Complex64::ONE; 2];
        let (down, along) = turns.split_at(rows);
        seen.clear();
        seen.resize(rows + columns, Complex64::ONE);
        for entry in diagonals.iter_mut() {
            powers.fill(Complex64::ZERO);
            for (i, (power, [_, step])) in seen.iter_mut().zip(down.iter().chain(along)).enumerate() {
                powers[usize::from(i >= rows)] += *power;
                *power *= step;
            }
            *entry = powers[0].re * powers[1].re;
        }
        let (frequency, n) = (omega[0].hypot(omega[1]), (rows * columns) as f64);
        matrix.resize(k * k, 0.0);
        for i in 0..k {
            for j in 0..=i {
                matrix[i * k + j] = diagonals[i - j];
            }
            let moved = (frequency * self.movement[i]).powi(4);
            matrix[i * k + i] += n * (self.ridge + self.smooth * moved);
        }
        cholesky(matrix, k);
        // The rows of A, one per view. Content of disparity d is displaced by -d views.
        seen.clear();
        for (first, step) in down.iter().flat_map(|a| along.iter().map(|b| a[0] * b[0])).zip(steps.iter()) {
            let mut turn = first;
            for _ in 0..k {
                seen.push(turn);
                turn *= step;
            }
        }
        layers_of(matrix, seen, views, layers);
        lag_sums(matrix, k, inverse, diagonals);
        left_out.clear();
        for ((row, view), step) in seen.chunks_exact(k).zip(views).zip(steps.iter()) {
            let shown: Complex64 = row.iter().zip(layers.iter()).map(|(a, l)| a * l).sum();
            // a^H P a is the sum over lags of P's diagonal sums, times the turns between layers at that distance
            // (Chebyshev's recurrence).
            let (mut before, mut now, mut sum) = (1.0, step.re, diagonals[0]);
            for lag in &diagonals[1..] {
                sum += 2.0 * lag * now;
                (before, now) = (now, 2.0 * step.re * now - before);
            }
            left_out.push((view - shown) / (1.0 - sum));
        }
    }

    /// Computes the turns of the layers at frequency `omega` for the rows, the columns and the views.
    fn turn(&self, omega: [f64; 2], found: &mut Found) {
        let Found { turns, steps, .. } = found;
        turns.clear();
        for (axis, n) in self.grid.into_iter().enumerate() {
            let place = |i: usize| omega[axis] * (i as f64 - (n as f64 - 1.0) / 2.0);
            turns.extend((0..n).map(|i| [self.disparity, self.step].map(|d| Complex64::cis(TAU * place(i) * d))));
        }
        let (down, along) = turns.split_at(self.grid[0]);
        steps.clear();
        steps.extend(down.iter().flat_map(|a| along.iter().map(|b| a[1] * b[1])));
    }
}

/// Pictures through one round aperture, each focused at another depth, and the layers that explain them. This is a
/// focal stack (Le Pendu, Guillemot and Smolic, IEEE Transactions on Image Processing 28, 2019).
#[derive(Debug, Clone)]
pub struct Defocus {
    /// Pixels by which the content of each layer moves across the eyebox, as in [`Regression`].
    pub blur: Vec<f64>,
    /// Expected noise, which regularizes all layers, as in [`Regression`].
    pub movement: Vec<f64>,
    /// Weight that damps layers that the pictures cannot distinguish, as in [`Regression`].
    pub ridge: f64,
    /// Weight that damps layers that the pictures cannot distinguish, as in [`Regression`].
    pub smooth: f64,
}

impl Defocus {
    /// Solves the layers at frequency `omega` (y, x) in cycles per pixel, from the spectra of the pictures there. Each
    /// picture shows each layer through the real spectrum of a disc, `2 J1(t) / t` with `t = pi |omega| blur`.
    pub fn solve(&self, omega: [f64; 2], pictures: &[Complex64], found: &mut Found) {
        let k = self.movement.len();
        let frequency = omega[0].hypot(omega[1]);
        let Found { layers, left_out, matrix, seen, solved, .. } = found;
        seen.clear();
        seen.extend(self.blur.iter().map(|blur| Complex64::new(disc(PI * frequency * blur), 0.0)));
        matrix.resize(k * k, 0.0);
        for i in 0..k {
            for j in 0..=i {
                matrix[i * k + j] = seen.chunks_exact(k).map(|row| row[i].re * row[j].re).sum();
            }
            let moved = (frequency * self.movement[i]).powi(4);
            matrix[i * k + i] += pictures.len() as f64 * (self.ridge + self.smooth * moved);
        }
        cholesky(matrix, k);
        layers.resize(k, Complex64::ZERO);
        layers_of(matrix, seen, pictures, layers);
        left_out.clear();
        for (row, picture) in seen.chunks_exact(k).zip(pictures) {
            let shown: Complex64 = row.iter().zip(layers.iter()).map(|(a, l)| a * l).sum();
            solved.clear();
            solved.extend_from_slice(row);
            forward(matrix, solved);
            let own = 1.0 - solved.iter().map(Complex64::norm_sqr).sum::<f64>();
            left_out.push((picture - shown) / own);
        }
    }
}

/// Computes the layers from the factor of the normal equations and the rows of `A`. The length of `layers` gives their
/// number.
fn layers_of(factor: &[f64], seen: &[Complex64], views: &[Complex64], layers: &mut [Complex64]) {
    layers.fill(Complex64::ZERO);
    for (row, view) in seen.chunks_exact(layers.len()).zip(views) {
        layers.iter_mut().zip(row).for_each(|(l, a)| *l += a.conj() * view);
    }
    forward(factor, layers);
    backward(factor, layers);
}

/// Computes the sums along the diagonals of the inverse of `factor factor^T`, `n` x `n`, from the main diagonal
/// outwards.
fn lag_sums(factor: &[f64], n: usize, inverse: &mut Vec<f64>, sums: &mut [f64]) {
    // Inverse of the factor, row by row, lower triangle. The inverse of the product is its transpose times it.
    inverse.clear();
    inverse.resize(n * n, 0.0);
    for i in 0..n {
        let (above, below) = inverse.split_at_mut(i * n);
        let own = &mut below[..=i];
        own[i] = 1.0;
        for (j, weight) in factor[i * n..][..i].iter().enumerate() {
            own.iter_mut().zip(&above[j * n..][..=j]).for_each(|(own, above)| *own -= weight * above);
        }
        let by = 1.0 / factor[i * n + i];
        own.iter_mut().for_each(|own| *own *= by);
    }
    sums.fill(0.0);
    for i in 0..n {
        let row = &inverse[i * n..][..=i];
        for (lag, sum) in sums[..=i].iter_mut().enumerate() {
            *sum += row.iter().zip(&row[lag..]).map(|(a, b)| a * b).sum::<f64>();
        }
    }
}

/// Returns `2 J1(t) / t` for `t >= 0`, with an error below 1e-5. Below 16 it integrates over the chords of the disc,
/// which takes few nodes there. Beyond, it uses Hankel's expansion.
pub fn disc(t: f64) -> f64 {
    if t < 16.0 {
        // The trapezoidal rule over a period is exact to rounding with this number of nodes.
        const NODES: usize = 24;
        let node = |i: usize| (2.0 * i as f64 - 1.0) * PI / (4.0 * NODES as f64);
        let chord = |i: usize| 2.0 * node(i).sin().powi(2) * (t * node(i).cos()).cos();
        return (1..=NODES).map(chord).sum::<f64>() / NODES as f64;
    }
    let (turn, u) = (t - 0.75 * PI, 1.0 / (8.0 * t));
    let (even, odd) = (1.0 + 7.5 * u * u, 3.0 * u * (1.0 - 17.5 * u * u));
    2.0 / t * (2.0 / (PI * t)).sqrt() * (even * turn.cos() - odd * turn.sin())
}

/// Replaces the lower triangle by its Cholesky factor.
fn cholesky(matrix: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let (above, below) = matrix.split_at_mut(i * n);
            let own = &mut below[..n];
            let dot = if i == j {
                own[..j].iter().map(|a| a * a).sum::<f64>()
            } else {
                own[..j].iter().zip(&above[j * n..][..j]).map(|(a, b)| a * b).sum()
            };
            let rest = own[j] - dot;
            own[j] = if i == j { rest.max(f64::MIN_POSITIVE).sqrt() } else { rest / above[j * n + j] };
        }
    }
}

fn forward(factor: &[f64], values: &mut [Complex64]) {
    let n = values.len();
    for i in 0..n {
        let row = &factor[i * n..][..=i];
        let dot: Complex64 = row[..i].iter().zip(values.iter()).map(|(a, b)| b * a).sum();
        values[i] = (values[i] - dot) / row[i];
    }
}

fn backward(factor: &[f64], values: &mut [Complex64]) {
    let n = values.len();
    for i in (0..n).rev() {
        values[i] /= factor[i * n + i];
        let own = values[i];
        values[..i].iter_mut().zip(&factor[i * n..]).for_each(|(v, a)| *v -= own * a);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spectrum_of_a_disc_is_that_of_tables() {
        // Abramowitz and Stegun, table 9.1, has J1 at 1, 5, 10 and 17.5, and its first zero.
        for (t, j) in [(1.0, 0.4400505857), (5.0, -0.3275791376), (10.0, 0.0434727462), (17.5, -0.1634199694)] {
            assert!((disc(t) - 2.0 * j / t).abs() < 1e-5, "{t}: {}, not {}", disc(t), 2.0 * j / t);
        }
        assert!((disc(0.0) - 1.0).abs() < 1e-12 && disc(3.8317059702).abs() < 1e-9);
        assert!((disc(15.999999) - disc(16.000001)).abs() < 1e-5);
    }

    /// Pictures of layers blurred by discs give these layers back, if the pictures distinguish them.
    #[test]
    fn layers_of_a_focal_stack_are_found() {
        let (k, focus) = (3, [-6.0, -2.0, 2.0, 6.0]);
        let movement = vec![-5.0, 0.0, 5.0];
        let blur: Vec<f64> = focus.iter().flat_map(|f| movement.iter().map(move |m: &f64| (m - f).abs())).collect();
        let problem = Defocus { blur, movement, ridge: 1e-9, smooth: 0.0 };
        let layers: Vec<Complex64> = (0..k).map(|i| Complex64::new((i as f64 + 1.0).sin(), i as f64 - 0.4)).collect();
        let omega = [0.11f64, 0.07];
        let through = |row: &[f64]| -> Complex64 {
            row.iter().zip(&layers).map(|(blur, layer)| layer * disc(PI * omega[0].hypot(omega[1]) * blur)).sum()
        };
        let pictures: Vec<Complex64> = problem.blur.chunks_exact(k).map(through).collect();
        let mut found = Found::default();
        problem.solve(omega, &pictures, &mut found);
        assert!(found.layers.iter().zip(&layers).all(|(a, b)| (a - b).norm() < 1e-4), "{:?}", found.layers);
        assert!(found.left_out.iter().all(|e| e.norm() < 1e-3), "{:?}", found.left_out);
    }

    /// Checks the residual of the normal equations, and compares each left-out view with a fit that really omits it.
    #[test]
    fn layers_solve_their_equations_and_leaving_out_is_leaving_out() {
        let disparities = [-1.4, -0.45, 0.5, 1.45];
        let movement: Vec<f64> = disparities.iter().map(|d| 5.0 * d).collect();
        let problem = Regression { grid: [2, 3], disparity: -1.4, step: 0.95, movement, ridge: 0.05, smooth: 0.0005 };
        let omega = [0.13, -0.21];
        let views: Vec<Complex64> = (0..6).map(|i| Complex64::new((i as f64).sin(), (2.0 * i as f64).cos())).collect();
        let mut found = Found::default();
        problem.solve(omega, &views, &mut found);
        let a = |v: usize, d: f64| {
            Complex64::cis(TAU * d * (omega[0] * ((v / 3) as f64 - 0.5) + omega[1] * ((v % 3) as f64 - 1.0)))
        };
        let shown = |v: usize, layers: &[Complex64]| -> Complex64 {
            disparities.iter().zip(layers).map(|(d, l)| a(v, *d) * l).sum()
        };
        let gamma = |m: f64| 6.0 * (0.05 + 0.0005 * (omega[0].hypot(omega[1]) * m).powi(4));
        for (k, d) in disparities.iter().enumerate() {
            let back: Complex64 = (0..6).map(|v| a(v, *d).conj() * (views[v] - shown(v, &found.layers))).sum();
            assert!((back - found.layers[k] * gamma(problem.movement[k])).norm() < 1e-12, "layer {k}");
        }
        // Steepest descent on the other five views, with the same ridge.
        for left in 0..6 {
            let mut layers = found.layers.clone();
            for _ in 0..20_000 {
                let slope: Vec<Complex64> = (disparities.iter().enumerate())
                    .map(|(k, d)| {
                        let others = (0..6).filter(|v| *v != left);
                        let back: Complex64 = others.map(|v| a(v, *d).conj() * (views[v] - shown(v, &layers))).sum();
                        back - layers[k] * gamma(problem.movement[k])
                    })
                    .collect();
                layers.iter_mut().zip(slope).for_each(|(l, s)| *l += 0.05 * s);
            }
            let want = views[left] - shown(left, &layers);
            assert!((found.left_out[left] - want).norm() < 1e-9, "view {left}: {} {want}", found.left_out[left]);
        }
    }
}
