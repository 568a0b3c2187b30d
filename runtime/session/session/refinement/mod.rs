//! Refines holograms for the tracked pupil: the refiner without threads, the pupil that it refines for, and what moves while a set is lit.

pub(crate) mod field;
pub(crate) mod likeness;
pub(crate) mod live_refiner;
pub(crate) mod moments;
pub(crate) mod pupil_source;
pub(crate) mod pupil_tracker;
pub(crate) mod set_timing;
pub(crate) mod work_time;
