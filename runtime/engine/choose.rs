//! Which engine runs.

use super::vulkan::{Options, VulkanEngine};
use super::{At, Engine, EngineError, Handover, Kernel, cpu::CpuEngine};

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
    let software = Options { allow_cpu: true, ..Options::default() };
    Ok(match choice {
        Choice::Cpu => Box::new(CpuEngine::new()),
        Choice::Vulkan => Box::new(VulkanEngine::open(&software)?),
        // On a CPU, the CPU engine is many times faster than a software Vulkan.
        Choice::Auto => match VulkanEngine::open(&Options::default()) {
            Ok(engine) => Box::new(engine),
            Err(_) => Box::new(CpuEngine::new()),
        },
    })
}

/// The CPU up to a kernel of the list, Vulkan from it on: finds a wrong kernel in minutes.
///
/// # Errors
/// As [`open`] with [`Choice::Vulkan`].
pub fn open_handover(from: Kernel) -> Result<Box<dyn Engine>, EngineError> {
    let (first, second) = (open(Choice::Cpu)?, open(Choice::Vulkan)?);
    Ok(Box::new(Handover::new(first, second, At::Kernel(from))))
}
