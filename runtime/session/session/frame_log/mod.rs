//! What was shown and why: the account of video frames, latencies, notes and the trace, with the threads that write them.

pub(crate) mod account;
pub(crate) mod error;
pub(crate) mod latency;
pub(crate) mod notes;
pub(crate) mod threads;
pub(crate) mod trace;
