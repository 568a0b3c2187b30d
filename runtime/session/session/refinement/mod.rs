//! Refines holograms for the tracked pupil, with the refiner, the source of pupils and the motion during a set.

pub(crate) mod agreement;
pub(crate) mod field;
pub(crate) mod likeness;
pub(crate) mod live_refiner;
pub(crate) mod moments;
pub(crate) mod pupil_source;
pub(crate) mod pupil_tracker;
pub(crate) mod set_timing;
pub(crate) mod work_time;
