//! Shows multiplex sets on time: which content frame is due, what the next video frame shows, and when to wake for it.

pub(crate) mod bench_follower;
pub(crate) mod marks;
pub(crate) mod on_screen;
pub(crate) mod output;
pub(crate) mod pacing;
pub(crate) mod pattern_output;
pub(crate) mod player;
pub(crate) mod record;
pub(crate) mod report;
pub(crate) mod scheduler;
pub(crate) mod stream;
pub(crate) mod ticks;
pub(crate) mod timeline;
