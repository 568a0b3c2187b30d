//! Which engine runs.

use super::vulkan::{DeviceKind, DeviceReport, Options, VulkanEngine, devices};
use super::{At, Engine, EngineError, Handover, Kernel, cpu::CpuEngine};

/// What the user asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// A real GPU where there is one, else the CPU: it is many times faster than a software Vulkan.
    Auto,
    /// The CPU.
    Cpu,
    /// Vulkan, a software device included.
    Vulkan,
}

/// What [`Choice::Auto`] takes, and why, in a sentence.
pub fn reason(found: &Result<Vec<DeviceReport>, EngineError>) -> (Choice, String) {
    let devices = match found {
        Ok(devices) => devices,
        Err(error) => return (Choice::Cpu, format!("the CPU: {error}")),
    };
    let real = |d: &&DeviceReport| d.kind != DeviceKind::Cpu;
    if let Some(device) = devices.iter().filter(real).find(|d| d.usable.is_ok()) {
        return (Choice::Vulkan, format!("{}: it is a real GPU that can run every kernel", device.name));
    }
    let why = match devices.iter().find(real) {
        Some(DeviceReport { name, usable: Err(reason), .. }) => format!("{name} cannot be used ({reason})"),
        _ => "the only Vulkan devices are software, which is slower than the CPU engine".into(),
    };
    (Choice::Cpu, format!("the CPU: {why}"))
}

/// Opens the engine asked for.
///
/// # Errors
/// [`EngineError::NoDevice`] and other answers of Vulkan's, where Vulkan was asked for by name.
pub fn open(choice: Choice) -> Result<Box<dyn Engine>, EngineError> {
    let vulkan = |allow_cpu| VulkanEngine::open(&Options { allow_cpu, ..Options::default() });
    match choice {
        Choice::Cpu => Ok(Box::new(CpuEngine::new())),
        Choice::Vulkan => Ok(Box::new(vulkan(true)?)),
        Choice::Auto if reason(&devices()).0 == Choice::Vulkan => match vulkan(false) {
            Ok(engine) => Ok(Box::new(engine)),
            // A GPU that lists itself and does not open is no reason to fail.
            Err(_) => Ok(Box::new(CpuEngine::new())),
        },
        Choice::Auto => Ok(Box::new(CpuEngine::new())),
    }
}

/// The CPU up to a kernel of the list, Vulkan from it on: finds a wrong kernel in minutes.
///
/// # Errors
/// As [`open`] with [`Choice::Vulkan`].
pub fn open_handover(from: Kernel) -> Result<Box<dyn Engine>, EngineError> {
    Ok(Box::new(Handover::new(open(Choice::Cpu)?, open(Choice::Vulkan)?, At::Kernel(from))))
}
