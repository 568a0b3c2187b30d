//! Times kernels, and the regions in which several threads may work.

use super::account;
use crate::engine::{Dispatch, Kernel, ParallelTime, Shape, Step, Timing};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

/// Sums of one kernel.
#[derive(Default)]
struct Sums {
    calls: AtomicU64,
    nanoseconds: AtomicU64,
    bytes: AtomicU64,
    operations: AtomicU64,
}

/// The sums of each kernel, and of all parallel regions.
pub(super) struct Clock {
    sums: [Sums; Kernel::ALL.len()],
    /// True if bytes and operations are counted, too.
    pub(super) accounts: bool,
    /// Nanoseconds in parallel regions, and the same divided by the threads that have a task.
    regions: [AtomicU64; 2],
}

impl Clock {
    pub(super) fn new(accounts: bool) -> Self {
        Self { sums: std::array::from_fn(|_| Sums::default()), accounts, regions: Default::default() }
    }

    /// Adds the bytes and operations of a dispatch.
    pub(super) fn account(&self, dispatch: &Dispatch, step: &Step, shape: &Shape) {
        if self.accounts {
            let (bytes, operations) = account::account(dispatch, step, shape);
            let sums = &self.sums[dispatch.kernel as usize];
            sums.bytes.fetch_add(bytes, Relaxed);
            sums.operations.fetch_add(operations, Relaxed);
        }
    }

    pub(super) fn time<R>(&self, kernel: Kernel, work: impl FnOnce() -> R) -> R {
        let start = Instant::now();
        let result = work();
        let Sums { calls, nanoseconds, .. } = &self.sums[kernel as usize];
        calls.fetch_add(1, Relaxed);
        nanoseconds.fetch_add(start.elapsed().as_nanos() as u64, Relaxed);
        result
    }

    /// Runs `work`, which the threads share as this number of tasks. A single task is no parallel region. Regions do
    /// not contain each other.
    pub(super) fn region<R>(&self, tasks: usize, work: impl FnOnce() -> R) -> R {
        if tasks < 2 {
            return work();
        }
        let start = Instant::now();
        let result = work();
        let (passed, busy) = (start.elapsed().as_nanos() as u64, tasks.clamp(1, rayon::current_num_threads()));
        let [whole, shared] = &self.regions;
        whole.fetch_add(passed, Relaxed);
        shared.fetch_add(passed / busy as u64, Relaxed);
        result
    }

    pub(super) fn timings(&self) -> Vec<Timing> {
        let one = |kernel: Kernel| {
            let Sums { calls, nanoseconds, bytes, operations } = &self.sums[kernel as usize];
            let [calls, nanoseconds, bytes, operations] =
                [calls, nanoseconds, bytes, operations].map(|sum| sum.load(Relaxed));
            Timing { kernel, calls, seconds: nanoseconds as f64 * 1e-9, bytes, operations }
        };
        Kernel::ALL.into_iter().map(one).filter(|t| t.calls > 0).collect()
    }

    pub(super) fn parallel_time(&self) -> ParallelTime {
        let [seconds, shared_seconds] = [0, 1].map(|i| self.regions[i].load(Relaxed) as f64 * 1e-9);
        ParallelTime { seconds, shared_seconds }
    }
}
