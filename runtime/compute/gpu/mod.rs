//! Opens one Vulkan device, which its users share. Without the feature `vulkan` there is none, and no value of
//! [`Gpu`].

#[cfg(not(feature = "vulkan"))]
mod absent;
mod error;
mod report;
#[cfg(feature = "vulkan")]
mod vulkan;

#[cfg(not(feature = "vulkan"))]
pub use absent::{Gpu, PhasesOnDevice, devices};
pub use error::EngineError;
pub use report::{DeviceKind, DeviceReport, Limits, Options, Tested};
#[cfg(feature = "vulkan")]
pub use vulkan::*;
