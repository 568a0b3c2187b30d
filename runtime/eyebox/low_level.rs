//! Exports all public items of the crates behind the facade, which may change at any time.
//!
//! They are kernels and plans, buffers of engines, the Vulkan device with its handles (`ash`), stages of sessions, and
//! fits of calibrations. The command, the laboratory and the tests use them.

#[doc(inline)]
pub use eyebox_base::{error, files, memory, quantity, reason};
#[doc(inline)]
pub use eyebox_calibrate as calibrate;
#[doc(inline)]
pub use eyebox_compute::{engine, gpu, plan};
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
pub use eyebox_solve::{encode, encoded, evaluate, hologram, produce, quality, reconstruction, solve, tiled};
#[doc(inline)]
pub use eyebox_tracking::{gaze, trackers};
