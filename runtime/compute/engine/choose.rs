//! Which engine runs, and on what.

#[cfg(feature = "vulkan")]
use super::vulkan::{self, VulkanEngine};
use super::{At, Engine, EngineError, Handover, Kernel, cpu::CpuEngine};
use crate::gpu::{DeviceKind, DeviceReport, Gpu, Options, devices};
use std::sync::{Arc, Mutex, PoisonError};

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

/// Where engines run: on the CPU, or on one Vulkan device that all of them share. Clones are the same one.
#[derive(Clone)]
pub struct Backend {
    gpu: Option<Arc<Mutex<Gpu>>>,
    /// How a device that was lost is opened anew; none for one that the program brought.
    options: Option<Options>,
    reason: String,
}

impl Backend {
    /// Opens what is asked for. `options` say how a device is opened; a software one is taken for [`Choice::Vulkan`] alone,
    /// and for one that the options name.
    ///
    /// # Errors
    /// [`EngineError::NoDevice`] and other answers of Vulkan's, where Vulkan was asked for by name.
    pub fn open(choice: Choice, options: &Options) -> Result<Self, EngineError> {
        // Who names a device wants it, whatever else there is.
        let choice = if choice == Choice::Auto && options.device.is_some() { Choice::Vulkan } else { choice };
        let options = Options { allow_cpu: choice == Choice::Vulkan, ..options.clone() };
        let (gpu, reason) = match choice {
            Choice::Cpu => (None, "the CPU: it was asked for".into()),
            Choice::Vulkan => {
                let gpu = open_tested(&options)?;
                let reason = format!("{}: Vulkan was asked for", gpu.report().name);
                (Some(gpu), reason)
            }
            Choice::Auto => match reason(&devices()) {
                (Choice::Vulkan, why) => match open_tested(&options) {
                    Ok(gpu) => (Some(gpu), why),
                    // A GPU that lists itself and does not open, or computes nonsense, is no reason to fail.
                    Err(error) => (None, format!("the CPU: {error}")),
                },
                (_, why) => (None, why),
            },
        };
        tracing::debug!("engines run on {reason}");
        Ok(Self { gpu: gpu.map(|gpu| Arc::new(Mutex::new(gpu))), options: Some(options), reason })
    }

    /// On a device that the program opened and keeps ([`Gpu::from_raw`]).
    ///
    /// # Errors
    /// [`EngineError::WrongResults`] where it computes something else than it should, and what else a device answers.
    pub fn on_device(gpu: Gpu) -> Result<Self, EngineError> {
        #[cfg(feature = "vulkan")]
        vulkan::self_test(&gpu)?;
        let reason = format!("{}: the program's own device", gpu.report().name);
        Ok(Self { gpu: Some(Arc::new(Mutex::new(gpu))), options: None, reason })
    }

    /// What runs, and why that and nothing else, in a sentence.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// The device, if it is one: what else is to run there, or to present from there, is made from this. One that was lost
    /// is opened anew, unless the program brought it.
    ///
    /// # Errors
    /// Those of [`Gpu::open`]; [`EngineError::DeviceLost`] for the program's own.
    pub fn gpu(&self) -> Result<Option<Gpu>, EngineError> {
        let Some(gpu) = &self.gpu else { return Ok(None) };
        let mut gpu = gpu.lock().unwrap_or_else(PoisonError::into_inner);
        if gpu.is_lost() {
            let during = "what came before".into();
            let lost = || EngineError::DeviceLost { device: gpu.report().name.clone(), during };
            let options = self.options.as_ref().ok_or_else(lost)?;
            *gpu = Gpu::open(options)?;
        }
        Ok(Some(gpu.clone()))
    }

    /// One more engine.
    ///
    /// # Errors
    /// The device's.
    pub fn engine(&self) -> Result<Box<dyn Engine>, EngineError> {
        Ok(match self.gpu()? {
            #[cfg(feature = "vulkan")]
            Some(gpu) => Box::new(VulkanEngine::new(&gpu)?),
            #[cfg(not(feature = "vulkan"))]
            Some(gpu) => gpu.absent(),
            None => Box::new(CpuEngine::new()),
        })
    }

    /// The CPU up to a kernel of the list, this from it on: finds a wrong kernel in minutes.
    ///
    /// # Errors
    /// The device's.
    pub fn engine_from(&self, kernel: Kernel) -> Result<Box<dyn Engine>, EngineError> {
        Ok(Box::new(Handover::new(Box::new(CpuEngine::new()), self.engine()?, At::Kernel(kernel))))
    }
}

/// A device that computes what it should.
fn open_tested(options: &Options) -> Result<Gpu, EngineError> {
    let gpu = Gpu::open(options)?;
    #[cfg(feature = "vulkan")]
    vulkan::self_test(&gpu)?;
    Ok(gpu)
}

/// An engine of its own, for a program that needs one only.
///
/// # Errors
/// Those of [`Backend::open`].
pub fn open(choice: Choice) -> Result<Box<dyn Engine>, EngineError> {
    Backend::open(choice, &Options::default())?.engine()
}
