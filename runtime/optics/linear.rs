//! Solves small dense systems of equations.

/// Cholesky's lower factor of a positive definite matrix, or none if the matrix is not positive definite.
pub fn cholesky(matrix: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    let n = matrix.len();
    let mut lower = vec![vec![0.0; n]; n];
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = matrix[i][j] - sum;
            lower[i][j] =
                if i == j { Some(rest.sqrt()).filter(|v| v.is_finite() && *v > 0.0)? } else { rest / lower[j][j] };
        }
    }
    Some(lower)
}

/// Solves for one right side with the factor.
fn substitute(lower: &[Vec<f64>], right: &[f64]) -> Vec<f64> {
    let n = lower.len();
    let mut x = right.to_vec();
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    x
}

/// Solves a positive definite system. Each unknown may have its own unit.
pub fn solve(matrix: &[Vec<f64>], right: &[f64]) -> Option<Vec<f64>> {
    let (scaled, unit) = scaled(matrix);
    let right: Vec<f64> = right.iter().zip(&unit).map(|(r, u)| r * u).collect();
    let x = substitute(&cholesky(&scaled)?, &right);
    Some(x.iter().zip(&unit).map(|(x, u)| x * u).collect())
}

/// The inverse of a positive definite matrix.
pub fn inverse(matrix: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    let (scaled, unit) = scaled(matrix);
    let lower = cholesky(&scaled)?;
    let column = |i: usize| {
        let mut right = vec![0.0; unit.len()];
        right[i] = unit[i];
        substitute(&lower, &right).iter().zip(&unit).map(|(x, u)| x * u).collect()
    };
    Some((0..unit.len()).map(column).collect())
}

/// Least squares by the normal equations, or none if the rows do not determine an unknown.
pub(super) fn least_squares<const N: usize>(rows: impl Iterator<Item = ([f64; N], f64)>) -> Option<[f64; N]> {
    let (mut matrix, mut right) = (vec![vec![0.0; N]; N], [0.0; N]);
    for (row, value) in rows {
        for i in 0..N {
            matrix[i].iter_mut().zip(row).for_each(|(sum, v)| *sum += row[i] * v);
            right[i] += row[i] * value;
        }
    }
    let lower = cholesky(&scaled(&matrix).0)?;
    // The diagonal of the matrix is one, so this is the share of an unknown that the unknowns before it do not
    // determine.
    (0..N).all(|i| lower[i][i].powi(2) > 1e-12).then_some(())?;
    solve(&matrix, &right)?.try_into().ok()
}

/// The matrix scaled to ones on its diagonal, and the factors of its rows and columns.
fn scaled(matrix: &[Vec<f64>]) -> (Vec<Vec<f64>>, Vec<f64>) {
    let unit: Vec<f64> =
        matrix.iter().enumerate().map(|(i, row)| if row[i] > 0.0 { row[i].sqrt().recip() } else { 1.0 }).collect();
    let scaled = matrix.iter().zip(&unit).map(|(row, u)| row.iter().zip(&unit).map(|(v, w)| v * u * w).collect());
    (scaled.collect(), unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_of_very_different_units_are_solved() {
        let matrix = vec![vec![4e12, 2e6, 0.0], vec![2e6, 3.0, 1e-6], vec![0.0, 1e-6, 5e-12]];
        let want = [1e-6, -2.0, 3e6];
        let right: Vec<f64> = matrix.iter().map(|row| row.iter().zip(want).map(|(a, b)| a * b).sum()).collect();
        for (got, want) in solve(&matrix, &right).unwrap().iter().zip(want) {
            assert!((got / want - 1.0).abs() < 1e-9, "{got}, not {want}");
        }
        let inverse = inverse(&matrix).unwrap();
        let product: f64 = (0..3).map(|k| matrix[1][k] * inverse[k][1]).sum();
        assert!((product - 1.0).abs() < 1e-9, "{product}");
        assert!(cholesky(&[vec![1.0, 2.0], vec![2.0, 1.0]]).is_none());
    }
}
