//! Provides options for tests on any device, with the validation layer, for one test at a time.
//!
//! tests/both.rs includes this file as well. The layer keeps the instances and devices of a process in a table
//! without a lock. Every Vulkan call looks its device up there (`GetLayerDataPtr` in layers/vk_layer_data.h of
//! 1.3.239 says "We probably should lock here"), while another thread that makes or destroys an instance changes the
//! table. Two tests at once then sometimes crash inside the layer.

use super::Options;
use std::sync::{Mutex, MutexGuard, PoisonError};

static TURN: Mutex<()> = Mutex::new(());

thread_local! {
    // The guard is dropped when the thread ends, after everything that the test has made.
    static HELD: MutexGuard<'static, ()> = TURN.lock().unwrap_or_else(PoisonError::into_inner);
}

/// Returns options for a validated device with a cache for tests. Waits until no other test of this process uses the
/// validation layer, and blocks other tests until the calling thread ends.
pub fn watched() -> Options {
    HELD.with(|_| ());
    let cache = Some(std::env::temp_dir().join("eyebox-tests"));
    Options { allow_cpu: true, validation: true, cache, ..Options::default() }
}
