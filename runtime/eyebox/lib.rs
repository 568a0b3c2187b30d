//! **eyebox**: phase holograms for near-eye displays that look right from anywhere in the eyebox, wherever the eye's pupil is,
//! however wide it is and whatever it focuses on.
//!
//! A light field becomes the phases of a spatial light modulator (SLM) by Stochastic Light Field Holography (Schiffers et al. 2023,
//! <https://arxiv.org/abs/2307.06277>): pupils are drawn from the whole eyebox, and the hologram is moved towards the photograph that
//! each of them should see. What comes of it is looked at, measured, encoded for the SLM, shown, and refined for where an eye is.
//!
//! # From a scene to the SLM's bytes
//!
//! ```
//! use eyebox::engine::{self, Choice};
//! use eyebox::hologram::Hologram;
//! use eyebox::optics::Display;
//! use eyebox::produce::{SceneJob, solve_scene};
//! use eyebox::solve::{Flow, Settings};
//!
//! let display = Display { height: 48, width: 64, ..Display::load("planes8")? };
//! let settings = Settings { steps: 5, ..Settings::default() };
//! let job = SceneJob { settings, ..SceneJob::new("builtin:still-life", &display) };
//! let mut engine = engine::open(Choice::Auto)?;
//! # let folder = tempfile::tempdir()?;
//! # let file = folder.path().join("still-life.zarr");
//! solve_scene(&job, Some(&file), engine.as_mut(), &mut |_| Flow::Continue)?;
//!
//! let frames = Hologram::load(&file)?.encode(&display)?;
//! assert_eq!(frames.bytes().len(), frames.count() * 48 * 64 * frames.channels);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What an eye sees
//!
//! ```
//! use eyebox::engine::{self, Choice};
//! use eyebox::optics::{Display, Pupil};
//! use eyebox::produce::{SceneJob, solve_scene};
//! use eyebox::solve::{Flow, Settings};
//!
//! let display = Display { height: 48, width: 64, ..Display::load("paper")? };
//! let settings = Settings { steps: 5, frames: 2, ..Settings::default() };
//! let job = SceneJob { settings, ..SceneJob::new("builtin:still-life", &display) };
//! let mut engine = engine::open(Choice::Cpu)?;
//! let solved = solve_scene(&job, None, engine.as_mut(), &mut |_| Flow::Continue)?;
//! let hologram = solved.into_hologram().ok_or("one scene makes one hologram")?;
//!
//! // Metres: 2 mm to the right, 4 mm wide, focused at 1 mm from the SLM's image. One plane of linear light per colour.
//! let seen = hologram.look(&Pupil { x: 2e-3, y: 0.0, diameter: 4e-3, depth: 1e-3 }, engine.as_mut())?;
//! assert_eq!(seen.len(), hologram.colors.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! More are in `examples/`: refinement with pupil updates, a display loop, a Vulkan device of the program's own.
//!
//! # Features
//!
//! All are on by default. Without any: optics, scenes, the CPU engine, the solvers, holograms and encoding.
//!
//! | feature | adds |
//! |---|---|
//! | `vulkan` | the Vulkan engine and encoder |
//! | `window` | [`present`] and [`session`]: windows over monitors, playing, refining for the eye |
//! | `direct-display` | displays that no desktop drives |
//! | `trackers` | HID eye trackers and Pupil Core |
//! | `preview` | [`preview`]: what an eye sees, in a window |
//! | `image-formats` | pictures in and out: PNG, JPEG, OpenEXR, TIFF, BMP, PPM |
//!
//! # Modules
//!
//! | module | what belongs in it |
//! |---|---|
//! | [`files`] | Reads files up to a limit, writes files whole or not at all, and has the two plain formats of the runtime, `.npy` and PNG |
//! | [`mailbox`] | A bounded queue between threads that allocates nothing after it is made |
//! | [`memory`] | Checks that memory is available before it is taken, so that no size in a file or an argument ends in an abort |
//! | [`steady`] | The system's monotonic clock, which never steps: one clock for trackers, displays and sessions |
//! | [`linear`] | Small dense systems of equations |
//! | [`scene`] | Light fields: reading, built-in scenes, depth and disparity, target images |
//! | [`encode`] | Converts phases to the bytes that the SLM receives: calibration, levels, packing |
//! | [`encoded`] | Writes holograms as folders of video frames, and reads such folders back |
//! | [`engine`] | Runs lists of kernels over buffers: on the `cpu`, on `vulkan`, or on both in turn (`Handover`) |
//! | [`evaluate`] | Measures images: PSNR, SSIM, exposure, energy, speckle and color, for each pupil and for groups of pupils |
//! | [`gpu`] | One Vulkan device, opened once and shared: queues, memory, pipelines and their cache, validation messages |
//! | [`hologram`] | The hologram file: phase frames with their metadata, whole, in sequences and in tiles |
//! | [`plan`] | Decides what is computed and stores it as plain data: lists of kernels, their arguments and their cost |
//! | [`produce`] | Makes holograms of scenes: all colors of one, sequences, tiled far fields, and the refinement of a finished one |
//! | [`quality`] | Measures the cost and the quality of settings on one color of a scene |
//! | [`reconstruction`] | Computes the image that an eye sees of a hologram, and compares it with the target image of the scene |
//! | [`solve`] | Stochastic Light Field Holography (Schiffers et al. 2023): draws pupils, compares what the wave gives with what the light field gives, moves the phases |
//! | [`tiled`] | Solves, refines and renders far-field holograms that are larger than memory, region by region (OPTICS 9) |
//! | [`calibrate`] | Fits a model of a real display to pictures that a camera took of it (OPTICS 10) |
//! | [`present`] | Brings video frames to light in a window, on a direct display or in memory, and reports when each one lit up |
//! | [`gaze`] | Predicts where the pupil will be when the light arrives, as a distribution, from the samples of a tracker |
//! | [`trackers`] | Reads eye trackers: devices, recordings, the network and a simulated eye, as `Sample`s with a steady time |
//! | [`preview`] | Shows what an eye sees of a hologram, live, in an ordinary window |
//! | [`session`] | Plays content on a display on time, refines it for the tracked pupil, and records what was shown |
//!
//! Comments that say "OPTICS n" mean section n of `docs/optics.md`. Lengths are metres, angles radians, images linear light, axis
//! order (row = y, column = x), +y down. Errors are typed, one enum a module; no input panics.

#[doc(inline)]
pub use eyebox_base::{files, memory};
#[doc(inline)]
pub use eyebox_calibrate as calibrate;
#[doc(inline)]
pub use eyebox_optics as optics;
#[cfg(feature = "window")]
#[doc(inline)]
pub use eyebox_present as present;
#[doc(inline)]
pub use eyebox_scene as scene;
#[cfg(feature = "preview")]
#[doc(inline)]
pub use eyebox_session::preview;
#[cfg(feature = "window")]
#[doc(inline)]
pub use eyebox_session::session;
#[doc(inline)]
pub use eyebox_solve::{
    encode, encoded, engine, evaluate, gpu, hologram, plan, produce, quality, reconstruction, solve, tiled,
};
#[doc(inline)]
pub use eyebox_tracking::{gaze, trackers};

/// The README's program is compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
