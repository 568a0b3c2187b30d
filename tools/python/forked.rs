//! Processes that were forked after eyebox had computed. Threads do not survive a fork, so a child computes on its own
//! threads. It refuses Vulkan handles and sessions of its parent.

use crate::failure::{Answer, Failure};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::mem::{forget, take};
use std::process::id;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

/// The process that computed first, in which rayon's own threads run. It is 0 before the first computation.
static COMPUTED: AtomicU32 = AtomicU32::new(0);
/// The process that opened Vulkan first, or 0 if none did.
static OPENED_VULKAN: AtomicU32 = AtomicU32::new(0);
/// The process and the idle thread pools of a forked child. Calls that run at the same time have one pool each. With
/// one pool for all calls, a call could wait for another one on the same thread.
static POOLS: Mutex<(u32, Vec<ThreadPool>)> = Mutex::new((0, Vec::new()));

/// Marks the first use by this process. Returns whether an ancestor was first.
fn is_after(first: &AtomicU32) -> bool {
    let own = id();
    first.compare_exchange(0, own, Ordering::SeqCst, Ordering::SeqCst).is_err_and(|first| first != own)
}

/// Returns whether this process was forked after an ancestor had opened Vulkan. If not, Vulkan is marked as opened by
/// this process.
pub(crate) fn is_after_vulkan() -> bool {
    is_after(&OPENED_VULKAN)
}

/// Refuses an operation in a forked child if it needs more threads than a call has.
pub(crate) fn refuse_after_computing(what: &'static str, remedy: &'static str) -> Answer<()> {
    if is_after(&COMPUTED) { Err(Failure::Forked { what, remedy }) } else { Ok(()) }
}

/// Runs work where rayon's threads exist. A forked child runs it in its own pool.
pub(crate) fn on_live_threads<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    if !is_after(&COMPUTED) {
        return work();
    }
    let idle = || {
        let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
        if pools.0 != id() {
            // The threads of these pools exist only in the parent.
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
        // A pool of the current thread alone starts no thread.
        Err(_) => match ThreadPoolBuilder::new().num_threads(1).use_current_thread().build() {
            Ok(pool) => pool.install(work),
            Err(_) => work(),
        },
    }
}

/// Runs work on this number of threads. Without a number, or if they cannot be started, it runs on the usual ones.
pub(crate) fn on_threads<T: Send>(threads: Option<usize>, work: impl FnOnce() -> T + Send) -> T {
    match threads.map(|count| ThreadPoolBuilder::new().num_threads(count).build()) {
        Some(Ok(pool)) => pool.install(work),
        _ => work(),
    }
}

/// A value with threads or device handles, which exist only in the process that made it. A forked child neither uses
/// nor drops it.
pub(crate) struct OfProcess<T> {
    /// The value, or `None` once it is dropped.
    value: Option<T>,
    process: u32,
    /// The name of the value in messages.
    what: &'static str,
    remedy: &'static str,
}

impl<T> OfProcess<T> {
    pub(crate) fn new(value: T, what: &'static str, remedy: &'static str) -> Self {
        Self { value: Some(value), process: id(), what, remedy }
    }

    /// Returns the value in the process that made it, and an error in a forked child.
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
