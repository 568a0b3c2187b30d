//! Evaluates Zernike polynomials by their ANSI index.

use std::sync::LazyLock;

/// The precomputed numbers of a polynomial.
struct Polynomial {
    /// m|, the number of periods around the middle.
    around: u32,
    is_sine: bool,
    /// Factor that makes the RMS 1.
    norm: f64,
    /// R(rho) / rho^|m| in powers of rho^2, the highest first.
    radial: Vec<f64>,
}

impl Polynomial {
    fn of(j: u32) -> Self {
        let n = order(j);
        let m = 2 * i64::from(j) - i64::from(n) * i64::from(n + 2);
        let around = m.unsigned_abs() as u32;
        let half = (n - around) / 2;
        let choose = |n: u32, k: u32| (0..k).fold(1.0, |c, i| c * f64::from(n - i) / f64::from(i + 1));
        let coefficient =
            |k: u32| if k.is_multiple_of(2) { 1.0 } else { -1.0 } * choose(n - k, k) * choose(n - 2 * k, half - k);
        let norm = (f64::from(n + 1) * if m == 0 { 1.0 } else { 2.0 }).sqrt();
        Self { around, is_sine: m < 0, norm, radial: (0..=half).map(coefficient).collect() }
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        let rho2 = x * x + y * y;
        let radial = self.radial.iter().fold(0.0, |sum, c| sum * rho2 + c);
        // The pair is rho^|m| times cosine and sine of |m| theta.
        let (cos, sin) = (0..self.around).fold((1.0, 0.0), |(c, s), _| (c * x - s * y, c * y + s * x));
        self.norm * radial * if self.is_sine { sin } else { cos }
    }
}

/// Z_j at (x, y) of the unit disc, by ANSI index `j = (n (n + 2) + m) / 2` (ANSI Z80.28). Its RMS is 1 over the disc,
/// and it continues outside. The angle runs from +x towards +y, which points down (OPTICS 10).
pub fn zernike(j: u32, x: f64, y: f64) -> f64 {
    /// Polynomials up to order 10 are evaluated for each bin of each iris.
    static FIRST: LazyLock<Vec<Polynomial>> = LazyLock::new(|| (0..66).map(Polynomial::of).collect());
    match FIRST.get(j as usize) {
        Some(polynomial) => polynomial.at(x, y),
        None => Polynomial::of(j).at(x, y),
    }
}

/// The optician's name of Z_j, for example coma y (the sine) and coma x (the cosine), 2nd astigmatism 45°, trefoil sin.
pub fn zernike_name(j: u32) -> String {
    let n = order(j);
    let m = 2 * i64::from(j) - i64::from(n) * i64::from(n + 2);
    let around = m.unsigned_abs() as u32;
    let (name, first) = match around {
        0 if n == 0 => ("piston", 0),
        0 if n == 2 => ("defocus", 2),
        0 => ("spherical", 4),
        1 if n == 1 => ("tilt", 1),
        1 => ("coma", 3),
        2 => ("astigmatism", 2),
        3 => ("trefoil", 3),
        4 => ("quadrafoil", 4),
        5 => ("pentafoil", 5),
        _ => ("foil", around),
    };
    let rank = match (n - first) / 2 {
        0 => String::new(),
        1 => "2nd ".into(),
        2 => "3rd ".into(),
        k => format!("{}th ", k + 1),
    };
    let name = if name == "foil" { format!("{around}-foil") } else { name.into() };
    let side = match (around, m < 0) {
        (0, _) => "",
        (1, true) => " y",
        (1, false) => " x",
        (2, true) => " 45°",
        (2, false) => " 0°",
        (_, true) => " sin",
        (_, false) => " cos",
    };
    format!("{rank}{name}{side}")
}

/// Z_j as a polynomial, with the coefficients of x^i y^k, by i and then k.
pub(super) fn coefficients(j: u32) -> Vec<Vec<f64>> {
    let n = order(j);
    let size = n as usize + 1;
    // Each axis has as many places as there are powers. Newton's divided differences run along x, then along y.
    let places: Vec<f64> = (0..size).map(|i| (i as f64 - 0.5 * f64::from(n)) / f64::from(n.max(1))).collect();
    let interpolate = |mut values: Vec<f64>| {
        for step in 1..size {
            for i in (step..size).rev() {
                values[i] = (values[i] - values[i - 1]) / (places[i] - places[i - step]);
            }
        }
        // Horner's scheme converts Newton's form to powers.
        let mut powers = vec![0.0; size];
        for i in (0..size).rev() {
            for k in (0..size).rev() {
                powers[k] = if k > 0 { powers[k - 1] } else { 0.0 } - places[i] * powers[k];
            }
            powers[0] += values[i];
        }
        powers
    };
    let rows: Vec<Vec<f64>> =
        places.iter().map(|y| interpolate(places.iter().map(|x| zernike(j, *x, *y)).collect())).collect();
    let column = |i: usize| interpolate(rows.iter().map(|row| row[i]).collect());
    let clean = |row: Vec<f64>| row.into_iter().map(|c| if c.abs() < 1e-9 { 0.0 } else { c }).collect();
    (0..size).map(|i| clean(column(i))).collect()
}

/// The radial order n of the polynomial.
fn order(j: u32) -> u32 {
    (0..).find(|n| (n + 1) * (n + 2) / 2 > j).expect("orders have no end")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_those_of_the_standard() {
        // Values from the definition, in float64 NumPy.
        let at = [
            1.0,
            -1.4,
            0.6,
            -1.0287856919689347,
            0.2771281292110202,
            -0.979795897113271,
            0.43557777721091306,
            0.5147737367038071,
            -0.22061731573020305,
            -1.1709688296449225,
            1.0625252938165752,
            0.9031464997440894,
            -1.0321689784139025,
            0.8601395235657993,
            -0.05186135362676159,
        ];
        for (j, want) in (0..).zip(at) {
            assert!((zernike(j, 0.3, -0.7) - want).abs() < 1e-12, "{j}");
        }
        for (j, want) in
            [(20, -4.140017122283434), (27, 3.938554623438145), (44, 16.720628488614096), (65, -16.665565174619537)]
        {
            assert!((zernike(j, 0.8, 0.9) - want).abs() < 1e-9, "{j}");
        }
        assert!((zernike(4, 0.6, 0.0) - 3.0f64.sqrt() * (2.0 * 0.36 - 1.0)).abs() < 1e-12);
        assert!((zernike(3, 0.6, 0.5) - 6.0f64.sqrt() * 2.0 * 0.3).abs() < 1e-12);
    }

    #[test]
    fn they_have_the_names_that_opticians_know() {
        let named = [0, 2, 3, 4, 5, 7, 8, 9, 11, 12, 14, 20, 24, 27, 31, 35].map(zernike_name);
        let want = [
            "piston",
            "tilt x",
            "astigmatism 45°",
            "defocus",
            "astigmatism 0°",
            "coma y",
            "coma x",
            "trefoil cos",
            "2nd astigmatism 45°",
            "spherical",
            "quadrafoil cos",
            "pentafoil cos",
            "2nd spherical",
            "6-foil cos",
            "3rd coma y",
            "7-foil cos",
        ];
        assert_eq!(named, want);
    }

    #[test]
    fn as_polynomials_they_are_the_same() {
        for j in 0..=65 {
            let coefficients = coefficients(j);
            for (x, y) in [(0.3, -0.7), (1.4, 0.9), (-0.2, 0.05)] {
                let row = |row: &Vec<f64>| row.iter().rev().fold(0.0, |sum, c| sum * y + c);
                let value = coefficients.iter().rev().fold(0.0, |sum, c| sum * x + row(c));
                assert!((value - zernike(j, x, y)).abs() < 1e-6 * (1.0 + value.abs()), "{j} at ({x}, {y})");
            }
        }
    }

    #[test]
    fn they_are_orthonormal_over_the_disc() {
        let place = |i: usize| (i as f64 + 0.5) / 100.0 - 1.0;
        let inside = (0..200 * 200).map(|i| (place(i % 200), place(i / 200))).filter(|(x, y)| x * x + y * y < 1.0);
        let rows: Vec<Vec<f64>> = inside.map(|(x, y)| (0..15).map(|j| zernike(j, x, y)).collect()).collect();
        for (j, k) in (0..15).flat_map(|j| (0..=j).map(move |k| (j, k))) {
            let mean = rows.iter().map(|row| row[j] * row[k]).sum::<f64>() / rows.len() as f64;
            assert!((mean - if j == k { 1.0 } else { 0.0 }).abs() < 0.03, "{j} {k}: {mean}");
        }
    }
}
