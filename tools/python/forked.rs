//! Processes that were forked after eyebox had computed. Threads do not survive a fork: a child computes on threads of its own, and
//! refuses Vulkan handles and sessions of its parent.

use crate::failure::{Answer, Failure};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::mem::{forget, take};
use std::process::id;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

/// The process that computed first, in which rayon's own threads run; 0 before.
static COMPUTED: AtomicU32 = AtomicU32::new(0);
/// The process that opened Vulkan first; 0 before.
static OPENED_VULKAN: AtomicU32 = AtomicU32::new(0);
/// Idle threads of a forked child: its process and one pool per call that ran at the same time. With one pool for all calls, a
/// call could wait for another one on the same thread.
static POOLS: Mutex<(u32, Vec<ThreadPool>)> = Mutex::new((0, Vec::new()));

/// Marks a first use by this process; whether an ancestor was first.
fn is_after(first: &AtomicU32) -> bool {
    let own = id();
    first.compare_exchange(0, own, Ordering::SeqCst, Ordering::SeqCst).is_err_and(|first| first != own)
}

/// Whether this process was forked after an ancestor had opened Vulkan; otherwise it is marked as opened now.
pub(crate) fn is_after_vulkan() -> bool {
    is_after(&OPENED_VULKAN)
}

/// Refuses what needs threads beside those of a call in a forked child.
pub(crate) fn refuse_after_computing(what: &'static str, remedy: &'static str) -> Answer<()> {
    if is_after(&COMPUTED) { Err(Failure::Forked { what, remedy }) } else { Ok(()) }
}

/// Runs work where rayon's threads exist: as it is, or in a forked child in a pool of its own.
pub(crate) fn on_live_threads<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    if !is_after(&COMPUTED) {
        return work();
    }
    let idle = || {
        let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
        if pools.0 != id() {
            // Their threads stayed in the parent.
            forget(take(&mut pools.1));
            pools.0 = id();
        }
        pools
    };
    let kept = idle().1.pop();
    match kept.map_or_else(|| ThreadPoolBuilder::new().build(), Ok) {
        Ok(pool) => {
            let result = pool.install(work);
            idle().1.push(pool);
            result
        }
        // A pool of this thread alone always exists.
        Err(_) => match ThreadPoolBuilder::new().num_threads(1).use_current_thread().build() {
            Ok(pool) => pool.install(work),
            Err(_) => work(),
        },
    }
}

/// Something with threads or device handles, which exist in the process that made it alone. In a forked child it is neither used nor
/// dropped.
pub(crate) struct OfProcess<T> {
    /// None once it is dropped.
    value: Option<T>,
    process: u32,
    /// Its name in messages.
    what: &'static str,
    remedy: &'static str,
}

impl<T> OfProcess<T> {
    pub(crate) fn new(value: T, what: &'static str, remedy: &'static str) -> Self {
        Self { value: Some(value), process: id(), what, remedy }
    }

    /// It, in the process that made it.
    pub(crate) fn get(&self) -> Answer<&T> {
        let Self { what, remedy, .. } = *self;
        self.value.as_ref().filter(|_| self.process == id()).ok_or(Failure::Forked { what, remedy })
    }
}

impl<T> Drop for OfProcess<T> {
    fn drop(&mut self) {
        if self.process != id() {
            forget(self.value.take());
        }
    }
}
