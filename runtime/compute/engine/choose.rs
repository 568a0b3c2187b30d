//! Chooses the engine and its device.

#[cfg(feature = "vulkan")]
use super::vulkan::{self, VulkanEngine};
use super::{At, Engine, EngineError, Handover, Kernel, cpu::CpuEngine};
use crate::gpu::{DeviceKind, DeviceReport, Gpu, Options, devices};
use std::sync::{Arc, Mutex, PoisonError};

/// The choice of the user.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// A real GPU if there is one, otherwise the CPU, which is many times faster than a software Vulkan.
    Auto,
    /// The CPU engine, always.
    Cpu,
    /// Vulkan, including software devices.
    Vulkan,
}

/// Returns the engine that [`Choice::Auto`] takes, and the reason in a sentence.
pub fn reason(found: &Result<Vec<DeviceReport>, EngineError>) -> (Choice, String) {
    let devices = match found {
        Ok(devices) => devices,
        Err(error) => return (Choice::Cpu, format!("the CPU: {error}")),
    };
    let real = |d: &&DeviceReport| d.kind != DeviceKind::Cpu;
    if let Some(device) = devices.iter().filter(real).find(|d| d.usable.is_ok()) {
        return (Choice::Vulkan, format!("{}, a real GPU that can run every kernel", device.name));
    }
    let why = match devices.iter().find(real) {
        Some(DeviceReport { name, usable: Err(reason), .. }) => format!("{name} cannot be used ({reason})"),
        _ => "the only Vulkan devices are software, which is slower than the CPU engine".into(),
    };
    (Choice::Cpu, format!("the CPU: {why}"))
}

/// The CPU, or one Vulkan device that all engines share. Clones share the device.
#[derive(Clone)]
pub struct Backend {
    gpu: Option<Arc<Mutex<Gpu>>>,
    /// Options to reopen a lost device. There are none for a device that the program supplied.
    options: Option<Options>,
    reason: String,
}

impl Backend {
    /// Opens the chosen engine. `options` describe how a device is opened. A software device is taken only for
    /// [`Choice::Vulkan`], or if the options name it.
    ///
    /// # Errors
    /// [`EngineError::NoDevice`] and other errors of Vulkan, if Vulkan was chosen by name.
    pub fn open(choice: Choice, options: &Options) -> Result<Self, EngineError> {
        // A named device is wanted, even if others are better.
        let choice = if choice == Choice::Auto && options.device.is_some() { Choice::Vulkan } else { choice };
        let options = Options { allow_cpu: choice == Choice::Vulkan, ..options.clone() };
        let (gpu, reason) = match choice {
            Choice::Cpu => (None, "the CPU, as requested".into()),
            Choice::Vulkan => {
                let gpu = open_tested(&options)?;
                let reason = format!("{}, because Vulkan was requested", gpu.report().name);
                (Some(gpu), reason)
            }
            Choice::Auto => match reason(&devices()) {
                (Choice::Vulkan, why) => match open_tested(&options) {
                    Ok(gpu) => (Some(gpu), why),
                    // A GPU that is listed and then does not open, or fails its test, is no reason to fail.
                    Err(error) => (None, format!("the CPU: {error}")),
                },
                (_, why) => (None, why),
            },
        };
        tracing::debug!("engines run on {reason}");
        Ok(Self { gpu: gpu.map(|gpu| Arc::new(Mutex::new(gpu))), options: Some(options), reason })
    }

    /// Uses a device that the program opened and keeps ([`Gpu::from_raw`]).
    ///
    /// # Errors
    /// [`EngineError::WrongResults`] if it computes wrong results, and other errors of a device.
    pub fn on_device(gpu: Gpu) -> Result<Self, EngineError> {
        #[cfg(feature = "vulkan")]
        vulkan::self_test(&gpu)?;
        let reason = format!("{}, the program's own device", gpu.report().name);
        Ok(Self { gpu: Some(Arc::new(Mutex::new(gpu))), options: None, reason })
    }

    /// Returns what runs, and the reason, in a sentence.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// Returns the device, if there is one, for other work and for presentation on it. A lost device is reopened,
    /// unless the program supplied it.
    ///
    /// # Errors
    /// The errors of [`Gpu::open`], and [`EngineError::DeviceLost`] for the program's own device.
    pub fn gpu(&self) -> Result<Option<Gpu>, EngineError> {
        let Some(gpu) = &self.gpu else { return Ok(None) };
        let mut gpu = gpu.lock().unwrap_or_else(PoisonError::into_inner);
        if gpu.is_lost() {
            let during = "earlier work".into();
            let lost = || EngineError::DeviceLost { device: gpu.report().name.clone(), during };
            let options = self.options.as_ref().ok_or_else(lost)?;
            *gpu = Gpu::open(options)?;
        }
        Ok(Some(gpu.clone()))
    }

    /// Makes another engine there.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn engine(&self) -> Result<Box<dyn Engine>, EngineError> {
        Ok(match self.gpu()? {
            #[cfg(feature = "vulkan")]
            Some(gpu) => Box::new(VulkanEngine::new(&gpu)?),
            #[cfg(not(feature = "vulkan"))]
            Some(gpu) => gpu.absent(),
            None => Box::new(CpuEngine::new()),
        })
    }

    /// Makes an engine that runs a list on the CPU up to a kernel and on this backend from there. It finds a wrong
    /// kernel in minutes.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn engine_from(&self, kernel: Kernel) -> Result<Box<dyn Engine>, EngineError> {
        Ok(Box::new(Handover::new(Box::new(CpuEngine::new()), self.engine()?, At::Kernel(kernel))))
    }
}

/// Opens a device and tests its results.
fn open_tested(options: &Options) -> Result<Gpu, EngineError> {
    let gpu = Gpu::open(options)?;
    #[cfg(feature = "vulkan")]
    vulkan::self_test(&gpu)?;
    Ok(gpu)
}

/// Opens an engine with its own device, for a program that needs only one.
///
/// # Errors
/// The errors of [`Backend::open`].
pub fn open(choice: Choice) -> Result<Box<dyn Engine>, EngineError> {
    Backend::open(choice, &Options::default())?.engine()
}
