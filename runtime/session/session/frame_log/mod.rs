//! Records the video frames, latencies, notes and the trace of a session, and holds the threads that write them.

pub(crate) mod account;
pub(crate) mod error;
pub(crate) mod latency;
pub(crate) mod notes;
pub(crate) mod threads;
pub(crate) mod trace;
