//! Passes frames from an application to a display through shared memory, as docs/live-input.md defines.
//!
//! The crate has both sides. The display opens a [`Display`] under a name with an [`Offer`] of the frames that it
//! accepts. Each [`Request`] has the time at which the next set is lit and the content that suits it best. The display
//! then takes the [`latest`](Display::latest) complete frame, which never waits and allocates nothing. The application
//! opens an [`Application`] with that name, reads the request and [`send`](Application::send)s frames. Neither side
//! trusts the other.
//!
//! The crate needs no other crate of eyebox. It maps memory with memmap2, and calls Linux through rustix.
//!
//! ```no_run
//! use eyebox_live_input::{Application, Content, FrameInfo, Sample, Transfer};
//! use std::time::Duration;
//!
//! let mut application = Application::connect("demo")?;
//! let [rows, columns] = application.offer().size;
//! let picture = vec![128u8; (rows * columns) as usize * application.offer().channels()];
//! let depth = vec![1.5f32; (rows * columns) as usize];
//! while application.wait(Duration::from_secs(1))? {
//!     let request = application.request().map_or(0, |request| request.number);
//!     let info = FrameInfo { request, ..FrameInfo::new(Content::ColorAndDepth, Sample::U8, Transfer::Srgb) };
//!     application.send(&info, &picture, &depth)?;
//! }
//! # Ok::<(), eyebox_live_input::LiveError>(())
//! ```

#![cfg_attr(not(target_os = "linux"), allow(dead_code, reason = "both sides refuse there"))]

mod content;
#[cfg(target_os = "linux")]
mod device;
mod error;
mod layout;
mod samples;

#[cfg(target_os = "linux")]
mod application;
#[cfg(target_os = "linux")]
mod display;
#[cfg(not(target_os = "linux"))]
mod elsewhere;
#[cfg(all(test, target_os = "linux"))]
mod hostile_tests;
#[cfg(target_os = "linux")]
mod region;
#[cfg(all(test, target_os = "linux"))]
mod shared_tests;
#[cfg(target_os = "linux")]
mod socket;

#[cfg(target_os = "linux")]
pub use application::{Application, Slot};
pub use content::{Content, Dioptres, FrameInfo, Kind, Offer, Pupil, Request, Sample, Transfer, Wanted};
#[cfg(target_os = "linux")]
pub use device::{DeviceIds, DeviceMemory, ViewTaker};
#[cfg(target_os = "linux")]
pub use display::{Counts, Display, Frame, Latest};
#[cfg(not(target_os = "linux"))]
pub use elsewhere::{Application, Display};
pub use error::{FrameFault, LiveError};

/// The largest number of views on an axis, and of layers.
pub const MOST: u32 = 64;

/// Refuses systems whose numbers are not stored as in docs/live-input.md, or whose addresses are too small for a
/// region.
#[cfg(target_os = "linux")]
pub(crate) fn supported() -> Result<(), LiveError> {
    match cfg!(all(target_endian = "little", target_pointer_width = "64")) {
        true => Ok(()),
        false => Err(LiveError::Unsupported),
    }
}
