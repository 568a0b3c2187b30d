//! A build without the feature `vulkan`: there is no device, and no value of [`Gpu`].

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
    /// [`EngineError::NoDevice`], always.
    pub fn open(_: &Options) -> Result<Self, EngineError> {
        Err(EngineError::NoDevice { reason: "this program was built without the feature `vulkan`".into() })
    }

    /// The device.
    pub fn report(&self) -> &DeviceReport {
        match self.0 {}
    }

    /// Whether it stopped answering.
    pub fn is_lost(&self) -> bool {
        match self.0 {}
    }

    /// There is no value to call this with.
    pub(crate) fn absent(&self) -> ! {
        match self.0 {}
    }
}

/// Phases that lie on a device, of which this build has none.
#[derive(Debug, Clone, Copy)]
pub struct PhasesOnDevice<'a>(Infallible, PhantomData<&'a ()>);

/// All devices that can be found.
///
/// # Errors
/// [`EngineError::NoDevice`], always.
pub fn devices() -> Result<Vec<DeviceReport>, EngineError> {
    Err(EngineError::NoDevice { reason: "this program was built without the feature `vulkan`".into() })
}
