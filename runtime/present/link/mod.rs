//! Checks the link between the swapchain and the panel.
//!
//! `report` has the result as data. `properties` judges the properties of an output, by the names of the drivers, and
//! `range` decides if an output sends all levels. `x_output` reads an output of an X server. `x_ramp` and `x_power` set
//! the gamma ramp, the screen saver and power saving right, and put them back. Their `x_record` lives in the X server,
//! so that the next session puts back what a killed session left. `console` reads what the kernel reports of a
//! connector without a desktop.

#[cfg(feature = "direct-display")]
pub(super) mod console;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod properties;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod range;
mod report;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod x_link;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod x_output;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod x_power;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod x_ramp;
#[cfg(all(unix, not(target_vendor = "apple")))]
mod x_record;

pub use report::{Link, LinkCheck, LinkPart, LinkState, LinkSystem};
#[cfg(all(unix, not(target_vendor = "apple")))]
pub(super) use x_link::XLink;
