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
//! Along the way the light goes; each imports only those above it:
//!
//! | module | what belongs in it |
//! |---|---|
//! | [`memory`] | what memory there is; promised before it is taken |
//! | [`files`] | regular files, read up to a limit; files that appear whole or not at all; `.npy` and PNG |
//! | [`optics`] | geometry, pupil, propagation (angular spectrum method), window: pure functions in float64 |
//! | [`scene`] | light fields: loading, built-in scenes, depth and disparity, photographs |
//! | [`plan`] | what is to be computed, as plain data: lists of kernels and their arguments |
//! | [`gpu`] | one Vulkan device, opened once and shared |
//! | [`engine`] | runs lists of kernels over buffers, on the CPU or on Vulkan |
//! | [`evaluate`] | what an eye sees and should see: PSNR, SSIM, exposure, energy, speckle, colour |
//! | [`solve`] | pupil sampling, the optimisers, the solver and the refiner: one for every engine |
//! | [`hologram`] | phase frames with their metadata and their file: whole, in sequences, in tiles |
//! | [`tiled`] | far-field holograms larger than memory: region by region, from and to their file |
//! | [`quality`] | what settings cost and gain, on one color of a scene |
//! | [`produce`] | from scenes to holograms: all colours, sequences, tiles |
//! | [`encode`] | calibration, levels, packing: phases to what the SLM receives |
//! | [`calibrate`] | a model of the display as it is, fitted from pictures that a camera took |
//! | [`trackers`] | eye trackers: devices, recordings, network, simulated; samples with a steady time |
//! | [`gaze`] | from a tracker's samples to where the pupil will be, with its uncertainty |
//! | [`present`] | video frames to light: windows, direct displays, memory; when what lit up |
//! | [`session`] | content, eye and time under one scheduler: play, live, and the account of what was shown |
//! | [`preview`] | what an eye sees, live, in an ordinary window |
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
pub use eyebox_solve::{encode, engine, evaluate, gpu, hologram, plan, produce, quality, solve, tiled};
#[doc(inline)]
pub use eyebox_tracking::{gaze, trackers};

/// The README's program is compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
