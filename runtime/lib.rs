//! **eyebox**: phase holograms that look right from anywhere in the eyebox.
//!
//! Rooms, along the way the light goes; each imports only rooms above it:
//!
//! | room | what belongs in it |
//! |---|---|
//! | [`optics`] | geometry, pupil, propagation, window: pure functions in float64 |
//! | [`files`] | files that appear whole or not at all; `.npy` and PNG |
//! | [`scene`] | light fields: loading, built-in scenes, depth and disparity, the photograph |
//! | [`plan`] | what a scene requires, decided once, as plain data |
//! | [`gpu`] | one Vulkan device, opened once and shared |
//! | [`engine`] | runs lists of kernels over buffers, on the CPU or on Vulkan |
//! | [`evaluate`] | PSNR, SSIM, the exposure that compares a hologram with its scene |
//! | [`solve`] | pupil sampling, the optimisers, the solver: one for every engine |
//! | [`quality`] | what a solve costs and how good it is: recipes, their judge, which to recommend, what was measured |
//! | [`hologram`] | phase frames and their file |
//! | [`tiled`] | far-field holograms larger than memory: region by region, from and to their file |
//! | [`produce`] | from scenes to holograms: all colours, sequences, tiles; one driver |
//! | [`encode`] | calibration, levels, packing: phases to what the SLM receives |
//! | [`present`] | video frames to light: windows, direct displays, memory; when what lit up |
//! | [`session`] | content, an eye and time: what is shown when, streaming, refinement, an account of what was shown |
//! | [`preview`] | what an eye sees, live, in an ordinary window |
//! | [`trackers`] | eye trackers: devices, recordings, network, simulated; samples with a steady time |
//! | [`gaze`] | from a tracker's samples to where the pupil will be, with its uncertainty |
//!
//! Comments that say "OPTICS n" mean section n of `docs/optics.md`.
//!
//! Lengths are metres, angles radians, images linear light, axis order (row = y, column = x), +y down.

pub mod encode;
pub mod engine;
pub mod evaluate;
pub mod files;
pub mod gaze;
#[cfg_attr(not(feature = "direct-display"), allow(dead_code, unused_imports, reason = "presenting uses part of it"))]
pub mod gpu;
pub mod hologram;
#[cfg_attr(not(feature = "preview"), allow(dead_code, reason = "previews use all of it"))]
mod mailbox;
pub mod optics;
pub mod plan;
#[cfg(feature = "window")]
#[cfg_attr(not(feature = "direct-display"), allow(dead_code, reason = "direct displays use all of it"))]
pub mod present;
#[cfg(feature = "preview")]
pub mod preview;
pub mod produce;
pub mod quality;
#[cfg(feature = "reports")]
pub mod report;
pub mod scene;
#[cfg(feature = "window")]
pub mod session;
pub mod solve;
pub mod tiled;
pub mod trackers;

/// The README's program is compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
