//! Measures the limits of this processor. A comparison of kernels with them is the roofline model of Williams, Waterman
//! and Patterson (Communications of the ACM 52, page 65).

use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

/// Number of measurements, of which the best counts.
const ROUNDS: usize = 5;
/// Values of each array of the memory test. Both arrays together have 128 MiB, more than the caches of one processor hold.
const VALUES: usize = 1 << 24;
/// Values of a piece that one thread copies at a time.
const PIECE: usize = 1 << 16;
/// Vectors that are under way at once. They hide the latency of a fused multiplication and addition.
const CHAINS: usize = 12;
/// Repetitions of the arithmetic test.
const REPEATS: usize = 1 << 20;

/// The limits of a processor for each thread of the current pool, while all of them work.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MachineRates {
    /// Bytes per second that are read and written, in arrays that no cache holds.
    pub memory: f64,
    /// Operations per second in float32. A fused multiplication and addition counts as two.
    pub arithmetic: f64,
}

/// Measures the limits with all threads of the current pool. It takes about a second and 128 MiB.
pub fn machine_rates() -> MachineRates {
    let threads = rayon::current_num_threads() as f64;
    MachineRates { memory: memory_rate() / threads, arithmetic: arithmetic_rate() }
}

/// Returns the shortest time of the rounds, seconds.
fn best(mut work: impl FnMut()) -> f64 {
    let mut time = || {
        let begun = Instant::now();
        work();
        begun.elapsed().as_secs_f64()
    };
    (0..ROUNDS).map(|_| time()).fold(f64::INFINITY, f64::min)
}

fn memory_rate() -> f64 {
    let from = vec![1.0_f32; VALUES];
    let mut to = vec![0.0_f32; VALUES];
    let seconds = best(|| {
        to.par_chunks_mut(PIECE).zip(from.par_chunks(PIECE)).for_each(|(to, from)| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = 1.5 * from);
        });
        black_box(&mut to);
    });
    (2 * VALUES * size_of::<f32>()) as f64 / seconds
}

fn arithmetic_rate() -> f64 {
    let mut operations = 0;
    let seconds = best(|| {
        let done = rayon::broadcast(|_| crate::simd::vectors(Chains { start: black_box(1.0) }));
        operations = done.into_iter().max().unwrap_or(0);
    });
    operations as f64 / seconds
}

/// Independent chains of multiplications and additions in registers. The result is their number of operations.
struct Chains {
    start: f32,
}

impl WithSimd for Chains {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> usize {
        let (factor, term) = (simd.splat_f32s(0.999_999), simd.splat_f32s(1e-7));
        let mut chains = [simd.splat_f32s(self.start); CHAINS];
        for _ in 0..REPEATS {
            for chain in &mut chains {
                *chain = simd.mul_add_e_f32s(*chain, factor, term);
            }
        }
        black_box(chains.map(|chain| simd.reduce_sum_f32s(chain)));
        2 * CHAINS * REPEATS * S::F32_LANES
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_finite() {
        // The ratio of both is not tested, because an emulated processor may have any.
        let MachineRates { memory, arithmetic } = machine_rates();
        assert!([memory, arithmetic].iter().all(|rate| *rate > 1e6 && rate.is_finite()), "{memory} {arithmetic}");
    }
}
