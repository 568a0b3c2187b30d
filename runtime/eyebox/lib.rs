//! **eyebox** computes phase holograms for near-eye displays. The image stays correct across the whole eyebox and
//! sharpens at the tracked pupil.
//!
//! Stochastic Light Field Holography (Schiffers et al. 2023, <https://arxiv.org/abs/2307.06277>) turns a light field
//! into the phases of a spatial light modulator (SLM). Each step draws pupils from the whole eyebox. It moves the
//! hologram towards the target image of each pupil. The library also simulates, measures, encodes and shows the
//! hologram, and refines it for the tracked pupil.
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
//! // In meters. 2 mm to the right, 4 mm wide, in focus 1 mm from the SLM's image. One plane of linear light per color.
//! let seen = hologram.look(&Pupil { x: 2e-3, y: 0.0, diameter: 4e-3, depth: 1e-3 }, engine.as_mut())?;
//! assert_eq!(seen.len(), hologram.colors.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! More examples are in `examples/`. They show refinement with pupil updates, a display loop, and a Vulkan device that
//! the program owns.
//!
//! # Features
//!
//! All features are on by default. Without them, the library has optics, scenes, the CPU engine, the solvers, holograms
//! and encoding.
//!
//! | feature | adds |
//! |---|---|
//! | `vulkan` | the Vulkan engine and encoder |
//! | `window` | [`present`] and [`session`], windows over monitors, playback, refinement for the tracked pupil |
//! | `direct-display` | displays that no desktop drives |
//! | `plm` | USB access to the controllers of phase light modulators |
//! | `trackers` | HID eye trackers and Pupil Core |
//! | `preview` | [`preview`], a window with the image that an eye sees |
//! | `image-formats` | images in PNG, JPEG, OpenEXR, TIFF, BMP and PPM |
//!
//! # Modules
//!
//! | module | what belongs in it |
//! |---|---|
//! | [`error`] | Represents errors as data |
//! | [`files`] | Reads files up to a limit, and writes files completely or not at all |
//! | [`optics`] | Defines display, pupil, propagation and window as pure functions in float64, without buffers or threads |
//! | [`scene`] | Reads scenes as light fields, from files or built-in scenes, and measures depths and makes views |
//! | [`engine`] | Runs lists of kernels over buffers on the `cpu`, on `vulkan`, or on both in turn (`Handover`) |
//! | [`gpu`] | Opens one Vulkan device, which its users share |
//! | [`present`] | Brings video frames to light in a window, on a direct display or in memory, and reports when each one lit up |
//! | [`encode`] | Converts phases to the bytes that the SLM receives, by calibration, levels and packing |
//! | [`hologram`] | The hologram file holds phase frames with their metadata, for one hologram, a sequence or tiles |
//! | [`produce`] | Makes holograms of scenes, sequences and tiled far fields, and refines finished holograms |
//! | [`reconstruction`] | Computes the image that an eye sees of a hologram, and compares it with the target image of the scene |
//! | [`solve`] | Solves holograms by Stochastic Light Field Holography (Schiffers et al. 2023) and related methods |
//! | [`calibrate`] | Fits a model of a real display to pictures that a camera took of it (OPTICS 10) |
//! | [`gaze`] | Predicts where the pupil will be when the light arrives, as a distribution, from the samples of a tracker |
//! | [`trackers`] | Reads eye trackers as `Sample`s with a steady time |
//! | [`preview`] | Shows the simulated image of a hologram, live, in an ordinary window |
//! | [`session`] | Plays content on a display on time, refines it for the tracked pupil, and records what was shown |
//!
//! A comment with "OPTICS n" refers to section n of `docs/optics.md`. Lengths are in meters and angles in radians.
//! Images are linear light. The axis order is (row = y, column = x), with +y down. Errors are typed, with one enum per
//! module, and [`Error`] wraps each of them. No input panics.

mod library_error;
pub mod low_level;

pub use library_error::{Error, ErrorKind};

/// Errors as data, with a stable code and fields.
pub mod error {
    pub use eyebox_base::error::{ErrorData, Reason};
}

/// Reads files up to a limit, writes files whole or not at all.
pub mod files {
    pub use eyebox_base::files::{FileError, encode_png, end_without_drafts, read_npy, write_npy, write_png};
}

/// Display, pupil and optics, with lengths in meters as float64.
pub mod optics {
    pub use eyebox_optics::{Color, Depth, Display, DisplayModel, Encoding, Geometry, JointColor, Obstruction, Optics};
    pub use eyebox_optics::{OpticsError, PRESETS, Packing, Padding, Prescription, Pupil, PupilDistribution, Sources};
    pub use eyebox_optics::{Viewing, Wavelength, WindowFactor, dioptres, wrap_phase};
}

/// Light fields from files and built-in scenes, with depth and disparity.
pub mod scene {
    #[cfg(target_os = "linux")]
    pub use eyebox_scene::views_of_depths;
    pub use eyebox_scene::{BUILTINS, Fit, Inspection, LightField, Near, Order, Request, SceneError, ViewSynthesis};
    pub use eyebox_scene::{Layer, Places, views_of_layers};
    pub use eyebox_scene::{inspect, load, srgb_to_linear};
}

/// One Vulkan device, opened once and shared.
pub mod gpu {
    pub use eyebox_compute::gpu::{DeviceReport, Gpu, Options, devices};
}

/// Engines for the CPU and for Vulkan.
pub mod engine {
    pub use eyebox_compute::engine::cpu::CpuEngine;
    #[cfg(feature = "vulkan")]
    pub use eyebox_compute::engine::vulkan::VulkanEngine;
    pub use eyebox_compute::engine::{Backend, Choice, Engine, EngineError, open};
    pub use eyebox_compute::plan::Storage;
}

/// Solvers from a light field to phases, and the refinement of phases for a pupil.
pub mod solve {
    pub use eyebox_solve::solve::{
        Diameters, FirstPhases, Flow, Full, Levels, Method, Optimizer, PaddingRule, Problem,
    };
    pub use eyebox_solve::solve::{
        Progress, RefineSettings, Refiner, Sequence, Settings, Solution, SolveError, Stop, Strategy,
    };
    pub use eyebox_solve::solve::{solve, solve_from};
}

/// The hologram file, with phase frames and metadata, for single holograms, sequences and tiles.
pub mod hologram {
    pub use eyebox_solve::hologram::{ColorHologram, Hologram, HologramError, Metadata, NewestHologram, Opening};
    pub use eyebox_solve::hologram::{
        PhaseSource, PhaseUnit, SceneRecord, Sequence, SequenceParts, Start, check_radians,
    };
}

/// The image that an eye sees of a hologram, and its scores.
pub mod reconstruction {
    pub use eyebox_solve::evaluate::{EvaluateError, Group, Plane, Summary, psnr, ssim};
    pub use eyebox_solve::reconstruction::{
        ForwardModel, HologramScores, InputOptions, JodSettings, PupilScore, ReconstructionError,
    };
    pub use eyebox_solve::reconstruction::{SceneReading, SceneSource, SolveInput};
}

/// Holograms of whole scenes, with all colors, sequences and tiled far fields, and the refinement of a finished
/// hologram.
pub mod produce {
    pub use eyebox_solve::produce::solve_scene;
    pub use eyebox_solve::produce::{ProduceError, Refinement, SceneEvent, SceneJob, SceneSolution, SequencePieces};
    pub use eyebox_solve::produce::{SequenceRequest, SolvedHologram, TilePieces, TilesRequest, solve_light_field};
    pub use eyebox_solve::quality::Quality;
    pub use eyebox_solve::tiled::{MemoryLimit, TiledError};
}

/// Phases as the bytes that the SLM receives.
pub mod encode {
    pub use eyebox_solve::encode::{Decoder, EncodeError, Encoder, PhaseSet, VideoFrames};
    pub use eyebox_solve::encoded::Encoded;
}

/// A model of a real display, fitted to pictures that a camera took of it.
pub mod calibrate {
    pub use eyebox_calibrate::{
        Bench, CalibrateError, Calibration, CameraCommand, Event, FEWEST, Report, ShowsPatterns, calibrate,
    };
}

/// Eye trackers as samples with a steady time, from devices, recordings, the network and a simulated eye.
pub mod trackers {
    pub use eyebox_tracking::trackers::pushed::SampleSender;
    pub use eyebox_tracking::trackers::{
        Event, Options, Quantity, Reading, Sample, Source, Spec, Stream, TrackerError,
    };
    pub use eyebox_tracking::trackers::{Unit, now_ns, open};
}

/// The prediction of the pupil at the time of the light, from the samples of a tracker.
pub mod gaze {
    pub use eyebox_tracking::gaze::{Calibration, Estimator, Eye, EyeVelocity, Eyepiece, GazeError, Settings};
}

/// Displays as windows over monitors, direct displays, and memory.
#[cfg(feature = "window")]
pub mod present {
    pub use eyebox_present::{DirectDisplay, Monitor, Offscreen, PresentError, Rate, Sink};
}

/// Plays content on a display on time, refines it for the tracked pupil, and records what was shown.
#[cfg(feature = "window")]
pub mod session {
    pub use eyebox_session::session::{
        Command, Content, Cost, EngineSource, FarField, Live, LiveStatus, MovingSequence,
    };
    pub use eyebox_session::session::{LiveColor, SessionEvent, SessionOptions, Speed, Status, TickedFrame};
    #[cfg(target_os = "linux")]
    pub use eyebox_session::session::{LiveInput, LiveKind, darkness};
    pub use eyebox_session::session::{Output, Play, Policy, PresentedFrame, Report, Scenes, Session, SessionError};
    pub use eyebox_session::session::{TickedOutput, TickedSession, Tracking};
}

/// Shows what an eye sees of a hologram, live, in an ordinary window.
#[cfg(feature = "preview")]
pub mod preview {
    pub use eyebox_session::preview::{
        Controls, Look, PreviewContent, PreviewError, PreviewWindow, RenderedView, Side, Viewer,
    };
}

/// Rust programs in the README are compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
