//! Shows multiplex sets on time, and decides on the content frame, the next video frame and the time to wake.

pub(crate) mod bench_follower;
pub(crate) mod connection;
pub(crate) mod controller;
pub(crate) mod marks;
pub(crate) mod on_screen;
pub(crate) mod output;
pub(crate) mod pacing;
pub(crate) mod pattern_output;
pub(crate) mod picture_output;
pub(crate) mod player;
pub(crate) mod pulses;
pub(crate) mod record;
pub(crate) mod report;
pub(crate) mod scheduler;
pub(crate) mod stream;
pub(crate) mod ticks;
pub(crate) mod timeline;
pub(crate) mod triggers;
