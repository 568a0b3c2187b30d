//! Designs masks whose light goes evenly into a square of directions, and nowhere else.

use eyebox_base::random::{GOLDEN, SplitMix};
use eyebox_kernels::Complex64;
use eyebox_kernels::fft::{Direction, transform_f64};
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex};

/// Steps per turn of a mask's stored phases. They are finer than any mask is made, and two characters of a file.
pub(super) const PARTS: u32 = 4096;
/// Iterations between the mask and its directions. After ten, the light outside falls slowly.
const TURNS: usize = 16;

type Key = (u64, u64, [usize; 2]);
/// The last mask that was made. Every color and every simulation of a hologram uses the same.
static LAST: Mutex<Option<(Key, Arc<[u16]>)>> = Mutex::new(None);

/// A random part of a turn for pixel `i`, the same on every machine. It is number `i` of the generator of this seed.
pub(super) fn random_part(seed: u64, i: usize) -> u32 {
    let before = seed.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add((i as u64).wrapping_mul(GOLDEN));
    (SplitMix(before).next() >> 52) as u32
}

/// The phases in parts of a turn, row by row, designed from random phases. Each iteration darkens the directions
/// outside the band's square and makes those inside equally bright. Then it makes the mask's pixels equally bright
/// (Gerchberg and Saxton 1972, Wyrowski and Bryngdahl 1988).
pub(super) fn designed(seed: u64, band: f64, size: [usize; 2]) -> Arc<[u16]> {
    let key = (seed, band.to_bits(), size);
    let mut last = LAST.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    if let Some((_, made)) = last.as_ref().filter(|(made_for, _)| *made_for == key) {
        return Arc::clone(made);
    }
    let [rows, columns] = size;
    let unit = |turn: f64| Complex64::from_polar(1.0, TAU * turn);
    let start = |i: usize| unit(f64::from(random_part(seed, i)) / f64::from(PARTS));
    let mut field: Vec<Complex64> = (0..rows * columns).map(start).collect();
    let inside = |k: usize, n: usize| (k.min(n - k) as f64) <= 0.5 * band * n as f64;
    for _ in 0..TURNS {
        // The spectrum is transposed, and returns the same way.
        transform(&mut field, size, Direction::Forward);
        field.par_chunks_mut(rows).enumerate().for_each(|(kx, line)| {
            for (ky, value) in line.iter_mut().enumerate() {
                let lit = inside(ky, rows) && inside(kx, columns);
                *value = if lit { *value / value.norm().max(1e-12) } else { Complex64::default() };
            }
        });
        transform(&mut field, [columns, rows], Direction::Inverse);
        field.par_iter_mut().for_each(|value| *value /= value.norm().max(1e-12));
    }
    let part = |value: &Complex64| ((value.arg() / TAU).rem_euclid(1.0) * f64::from(PARTS)).round() as u32 % PARTS;
    let made: Arc<[u16]> = field.iter().map(|value| part(value) as u16).collect();
    *last = Some((key, Arc::clone(&made)));
    made
}

/// Transforms (rows, columns) values in place. The result is transposed, (columns, rows).
fn transform(values: &mut Vec<Complex64>, [rows, columns]: [usize; 2], direction: Direction) {
    values.par_chunks_mut(columns).for_each(|line| transform_f64(line, columns, direction));
    let from = &*values;
    let turned = |i: usize| from[i % rows * columns + i / rows];
    let mut turned: Vec<Complex64> = (0..rows * columns).into_par_iter().map(turned).collect();
    turned.par_chunks_mut(rows).for_each(|line| transform_f64(line, rows, direction));
    *values = turned;
}
