//! Tests of the transforms of columns.

use super::*;
use num_complex::Complex64;
use pulp::{Arch, Scalar, Scalar512b};
use rustfft::{FftDirection, FftPlanner};

fn noise(count: usize) -> Vec<Complex32> {
    let value = |i: usize| (i.wrapping_mul(2_654_435_761) >> 8 & 0xffff) as f32 / 32768.0 - 1.0;
    (0..count).map(|i| Complex32::new(value(2 * i), value(2 * i + 1))).collect()
}

/// Transforms columns `first..first + count` of noise.
fn transformed(simd: impl Simd, plan: &ColumnPlan, width: usize, [first, count]: [usize; 2]) -> Vec<Complex32> {
    let mut frame = noise(plan.length * width);
    let scratch = &mut vec![Complex32::default(); plan.scratch()];
    simd.vectorize(Transform { plan, frame: &mut frame, width, first, count, scratch });
    frame
}

#[test]
fn columns_are_transformed_and_their_neighbors_kept() {
    for length in (1..=130).chain([144, 180, 210, 256, 343, 512, 625, 1080, 1024, 2048]) {
        for inverse in [false, true] {
            let Some(plan) = ColumnPlan::new(length, inverse) else { continue };
            let direction = if inverse { FftDirection::Inverse } else { FftDirection::Forward };
            let reference = FftPlanner::new().plan_fft(length, direction);
            let (width, columns) = (21, [2, 17]);
            let got = transformed(Scalar512b, &plan, width, columns);
            let before = noise(length * width);
            let (mut error, mut power) = (0.0, 0.0);
            for x in 0..width {
                let column = before.iter().skip(x).step_by(width);
                let mut want: Vec<_> = column.map(|z| Complex64::new(f64::from(z.re), f64::from(z.im))).collect();
                if (2..19).contains(&x) {
                    reference.process(&mut want);
                }
                for (got, want) in got.iter().skip(x).step_by(width).zip(want) {
                    error += (Complex64::new(f64::from(got.re), f64::from(got.im)) - want).norm_sqr();
                    power += want.norm_sqr();
                }
            }
            assert!(error < 1e-13 * power, "{length}, inverse {inverse}: error power {} of the result", error / power);
        }
    }
}

#[test]
fn lengths_with_other_factors_have_no_plan() {
    for length in [1, 2, 7, 8, 11, 22, 53, 1272, 2 * 3 * 5 * 7 * 11] {
        assert!(ColumnPlan::new(length, false).is_none(), "{length}");
    }
    assert_eq!(radices(128), Some(vec![8, 4, 4]));
    assert_eq!(radices(1080), Some(vec![8, 3, 3, 3, 5]));
}

#[test]
fn every_width_of_vectors_gives_the_same_bits() {
    let bits =
        |values: Vec<Complex32>| -> Vec<[u32; 2]> { values.iter().map(|z| [z.re, z.im].map(f32::to_bits)).collect() };
    for length in [6, 35, 40, 64, 210, 240] {
        let Some(plan) = ColumnPlan::new(length, false) else { panic!("{length} has a plan") };
        for columns in [[0, 48], [3, 5], [1, 40]] {
            let want = bits(transformed(Scalar, &plan, 48, columns));
            assert_eq!(bits(transformed(Scalar512b, &plan, 48, columns)), want, "{length}");
            let mut frame = noise(length * 48);
            plan.transform(&mut frame, 48, columns, &mut vec![Complex32::default(); plan.scratch()]);
            assert_eq!(bits(frame), want, "{length} with {:?}", Arch::new());
        }
    }
}
