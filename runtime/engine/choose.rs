//! Which engine runs.

use super::{Engine, EngineError, Kernel, cpu::CpuEngine};

/// What the user asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// A real GPU where there is one, else the CPU.
    Auto,
    /// The CPU.
    Cpu,
    /// Vulkan, a software device included.
    Vulkan,
}

/// Opens the engine asked for.
///
/// # Errors
/// [`EngineError::NoDevice`] and other answers of Vulkan's, where Vulkan was asked for by name.
pub fn open(choice: Choice) -> Result<Box<dyn Engine>, EngineError> {
    match choice {
        Choice::Auto | Choice::Cpu => Ok(Box::new(CpuEngine::new())),
        Choice::Vulkan => Err(EngineError::NoDevice { reason: "not in this build".into() }),
    }
}

/// The CPU up to a kernel of the list, Vulkan from it on: finds a wrong kernel in minutes.
///
/// # Errors
/// As [`open`] with [`Choice::Vulkan`].
pub fn open_handover(_from: Kernel) -> Result<Box<dyn Engine>, EngineError> {
    open(Choice::Vulkan)
}
