//! Represents distributions by few points, with Gaussian quadrature along a line and over a disc (Stroud 1971).

/// The most points on a line, and the most rings of the formulas for a disc.
pub(super) const MOST: usize = 5;

/// A place in units of the half width (standard deviation for a Gaussian), and its share. Shares add up to 1.
pub(super) type Node<P> = (P, f64);

/// An even distribution over -1 to 1, by Gauss-Legendre with 1 to [`MOST`] points.
pub(super) fn even(points: usize) -> Vec<Node<f64>> {
    match points {
        0 | 1 => vec![(0.0, 1.0)],
        2 => symmetric(&[(1.0 / 3f64.sqrt(), 0.5)], None),
        3 => symmetric(&[(0.6f64.sqrt(), 5.0 / 18.0)], Some(8.0 / 18.0)),
        4 => {
            let root = (6.0f64 / 5.0).sqrt() * 2.0 / 7.0;
            let share = 30f64.sqrt() / 72.0;
            symmetric(&[((3.0 / 7.0 - root).sqrt(), 0.25 + share), ((3.0 / 7.0 + root).sqrt(), 0.25 - share)], None)
        }
        _ => {
            let (root, share) = (2.0 * (10.0f64 / 7.0).sqrt(), 13.0 * 70f64.sqrt());
            let node = |sign: f64| ((5.0 + sign * root).sqrt() / 3.0, (322.0 - sign * share) / 1800.0);
            symmetric(&[node(-1.0), node(1.0)], Some(64.0 / 225.0))
        }
    }
}

/// A normal distribution, by Gauss-Hermite with 1 to [`MOST`] points, in standard deviations.
pub(super) fn normal(points: usize) -> Vec<Node<f64>> {
    match points {
        0 | 1 => vec![(0.0, 1.0)],
        2 => symmetric(&[(1.0, 0.5)], None),
        3 => symmetric(&[(3f64.sqrt(), 1.0 / 6.0)], Some(2.0 / 3.0)),
        4 => {
            let root = 6f64.sqrt();
            let node = |sign: f64| ((3.0 + sign * root).sqrt(), (3.0 - sign * root) / 12.0);
            symmetric(&[node(-1.0), node(1.0)], None)
        }
        _ => {
            let root = 10f64.sqrt();
            let node = |sign: f64| ((5.0 + sign * root).sqrt(), (7.0 - sign * 2.0 * root) / 60.0);
            symmetric(&[node(-1.0), node(1.0)], Some(8.0 / 15.0))
        }
    }
}

/// An even distribution over the unit disc, (x, y), by formulas of degree 1, 3, 5 and 7 with 1, 4, 7 and 12 points.
pub(super) fn disc(points: usize) -> Vec<Node<[f64; 2]>> {
    let cross = |at: f64, share: f64| [[at, 0.0], [-at, 0.0], [0.0, at], [0.0, -at]].map(|place| (place, share));
    let corners = |at: f64, share: f64| [[at, at], [-at, at], [at, -at], [-at, -at]].map(|place| (place, share));
    match points {
        0 | 1 => vec![([0.0; 2], 1.0)],
        2 => corners(0.5, 0.25).to_vec(),
        3 => {
            let ring = (0..6).map(|k| (f64::from(k) * std::f64::consts::FRAC_PI_3).sin_cos());
            let radius = (2.0f64 / 3.0).sqrt();
            let ring = ring.map(|(sin, cos)| ([radius * cos, radius * sin], 0.125));
            std::iter::once(([0.0; 2], 0.25)).chain(ring).collect()
        }
        _ => {
            let root = 29f64.sqrt();
            let (inner, outer) = (((27.0 - 3.0 * root) / 104.0).sqrt(), ((27.0 + 3.0 * root) / 104.0).sqrt());
            let shares = [(551.0 + 41.0 * root) / 6264.0, (551.0 - 41.0 * root) / 6264.0];
            [cross(0.75f64.sqrt(), 2.0 / 27.0), corners(inner, shares[0]), corners(outer, shares[1])].concat()
        }
    }
}

/// The product of a line with itself along two axes.
pub(super) fn square(line: &[Node<f64>]) -> Vec<Node<[f64; 2]>> {
    line.iter().flat_map(|(y, v)| line.iter().map(move |(x, u)| ([*x, *y], u * v))).collect()
}

fn symmetric(pairs: &[Node<f64>], middle: Option<f64>) -> Vec<Node<f64>> {
    let below = pairs.iter().rev().map(|(at, share)| (-at, *share));
    below.chain(middle.map(|share| (0.0, share))).chain(pairs.iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(nodes: &[Node<f64>], power: i32) -> f64 {
        nodes.iter().map(|(at, share)| share * at.powi(power)).sum()
    }

    /// A formula with n points is exact to degree 2 n - 1.
    #[test]
    fn lines_have_the_moments_of_what_they_stand_for() {
        for n in 1..=MOST {
            for power in (0..2 * n as i32).step_by(2) {
                let even = moment(&even(n), power) - 1.0 / f64::from(power + 1);
                let double_factorial: f64 = (1..power).step_by(2).map(f64::from).product();
                let normal = moment(&normal(n), power) - double_factorial;
                assert!(even.abs() < 1e-14 && normal.abs() < 1e-12, "{n} points, x^{power}: {even:e}, {normal:e}");
            }
        }
    }

    #[test]
    fn discs_have_the_moments_of_a_disc() {
        // Means over the unit disc. They are 1/4 for x^2 and y^2, 1/8 for x^4, 1/24 for x^2 y^2, 5/64 for x^6 and 1/64
        // for x^4 y^2.
        let all =
            [(2, 0, 0.25), (0, 2, 0.25), (4, 0, 0.125), (2, 2, 1.0 / 24.0), (6, 0, 5.0 / 64.0), (4, 2, 1.0 / 64.0)];
        for (points, degree) in [(1, 1), (2, 3), (3, 5), (4, 7)] {
            let nodes = disc(points);
            let mean = |i: i32, j: i32| nodes.iter().map(|([x, y], w)| w * x.powi(i) * y.powi(j)).sum::<f64>();
            assert!((mean(0, 0) - 1.0).abs() < 1e-14 && mean(1, 0).abs() < 1e-15);
            for (i, j, want) in all.into_iter().filter(|(i, j, _)| i + j <= degree) {
                assert!((mean(i, j) - want).abs() < 1e-14, "{points}: x^{i} y^{j} is {}, not {want}", mean(i, j));
            }
        }
    }
}
