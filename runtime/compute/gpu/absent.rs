//! Replaces the device in a build without the feature `vulkan`, with no value of [`Gpu`].

use super::error::EngineError;
use super::report::{DeviceReport, Options};
use std::convert::Infallible;
use std::marker::PhantomData;

/// An open Vulkan device, of which this build has none.
#[derive(Debug, Clone)]
pub struct Gpu(Infallible);

impl Gpu {
    /// Opens the device that the options name, or the best one.
    ///
    /// # Errors
    /// The error is always [`EngineError::NoDevice`].
    pub fn open(_: &Options) -> Result<Self, EngineError> {
        Err(EngineError::NoDevice { reason: "this program was built without the feature `vulkan`".into() })
    }

    /// Returns the report of the device.
    pub fn report(&self) -> &DeviceReport {
        match self.0 {}
    }

    /// Returns true if it stopped answering.
    pub fn is_lost(&self) -> bool {
        match self.0 {}
    }

    /// Marks unreachable code, because no value can call this.
    pub(crate) fn absent(&self) -> ! {
        match self.0 {}
    }
}

/// Phases on a device, of which this build has none.
#[derive(Debug, Clone, Copy)]
pub struct PhasesOnDevice<'a>(Infallible, PhantomData<&'a ()>);

/// Lists all devices that the loader finds.
///
/// # Errors
/// The error is always [`EngineError::NoDevice`].
pub fn devices() -> Result<Vec<DeviceReport>, EngineError> {
    Err(EngineError::NoDevice { reason: "this program was built without the feature `vulkan`".into() })
}
