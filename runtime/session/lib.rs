//! **eyebox-session**: content, an eye and time under one scheduler, for [eyebox](https://github.com/eyebox/eyebox). [`session`] plays, refines for
//! the eye, and accounts for what was shown; [`preview`] shows what an eye sees, in an ordinary window.

pub mod preview;
pub mod session;

// Modules name these as if they were beside them.
use eyebox_base::{files, mailbox, steady};
use eyebox_calibrate as calibrate;
use eyebox_compute::{engine, gpu, plan};
use eyebox_optics as optics;
use eyebox_present as present;
use eyebox_scene as scene;
use eyebox_solve::{encode, evaluate, hologram, reconstruction, solve, tiled};
use eyebox_tracking::{gaze, trackers};
