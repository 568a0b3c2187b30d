//! Composes frames on the device that has the application's images.
//!
//! An application's queue belongs to the application except during some of its calls, so that the layer may not compose
//! there. This device is the layer's own, on the same physical device with the same driver. It imports the memory of
//! copies from the application's device, and the memory of the display from the display's process.

mod composer;
mod device;
mod fault;
mod memory;
mod pipelines;
mod support;
mod tables;
#[cfg(test)]
mod tests;

pub use composer::{Composer, Shape, Target};
pub use device::Own;
pub use fault::Fault;
pub use memory::{Layout, Memory};
pub use support::{device_extensions, instance_extensions};
pub use tables::{Bytes, Seen, SeenPlace, Texels};
