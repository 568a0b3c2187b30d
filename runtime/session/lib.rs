//! **eyebox-session** plays holograms, refines them for the tracked pupil and previews them, for
//! [eyebox](https://github.com/eyebox/eyebox).
//!
//! [`session`] plays content, refines it for the pupil, and counts what was shown when. [`preview`] shows the simulated
//! image of an eye in an ordinary window.

pub mod preview;
pub mod session;

// Modules use these names as if they were modules of this crate.
use eyebox_base::{files, mailbox, steady};
use eyebox_calibrate as calibrate;
use eyebox_compute::{engine, gpu, plan};
use eyebox_optics as optics;
use eyebox_present as present;
use eyebox_scene as scene;
use eyebox_solve::{encode, evaluate, hologram, reconstruction, solve, tiled};
use eyebox_tracking::{gaze, trackers};
