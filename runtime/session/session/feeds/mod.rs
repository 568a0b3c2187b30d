//! The two things that a session shows, and the threads that make their sets: holograms that were solved before, and live content that is refined.

pub(crate) mod following;
pub(crate) mod journal;
pub(crate) mod live;
pub(crate) mod play;
pub(crate) mod refine;
pub(crate) mod replay;
pub(crate) mod running;
pub(crate) mod sets;
pub(crate) mod showing;
pub(crate) mod sidecar;
pub(crate) mod statistics;
