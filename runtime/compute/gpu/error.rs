//! What can go wrong on a device, or with what a device is asked.

#[cfg(feature = "vulkan")]
use ash::vk;

/// What an engine can answer instead of a result.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum EngineError {
    /// No device, no driver or no loader.
    #[error("there is no Vulkan device: {reason}; on Debian or Ubuntu, `tools/setup.sh` installs a software one")]
    NoDevice {
        /// What the loader or the driver said.
        reason: String,
    },
    /// A device that cannot run the kernels.
    #[error("{device} cannot run this: {reason}")]
    Unsuitable {
        /// Its name.
        device: String,
        /// The limit that is too small, and what is needed.
        reason: String,
    },
    /// A device that computes something else than it should.
    #[error(
        "{device} computes {what} wrongly: {error:.1e} of the power is error, {allowed:.0e} at most is right; update its driver \
         ({driver}), choose another device with `device`, or take the CPU with `engine` cpu"
    )]
    WrongResults {
        /// Its name.
        device: String,
        /// Its driver.
        driver: String,
        /// What was tried.
        what: &'static str,
        /// Error power over signal power.
        error: f64,
        /// What is right.
        allowed: f64,
    },
    /// Memory ran out.
    #[error(
        "out of {device} memory: {} for {what} could not be had; use fewer sub-frames, a smaller size or fewer pupils a step",
        amount(*.wanted)
    )]
    OutOfMemory {
        /// Host or a device's name.
        device: String,
        /// The buffer, or the call that needs memory.
        what: String,
        /// Bytes, where they are known: a driver does not say how much it wants for itself.
        wanted: Option<u64>,
    },
    /// The device stopped answering.
    #[error("{device} was lost while it ran {during}; try again, or run on the CPU")]
    DeviceLost {
        /// Its name.
        device: String,
        /// The kernel or the transfer.
        during: String,
    },
    /// The screen takes no pictures any more.
    #[error("{device}: {reason}")]
    ScreenLost {
        /// The device's name.
        device: String,
        /// What became of it.
        reason: String,
    },
    /// Another answer of Vulkan's.
    #[error("{device}: {call} answered {result}")]
    Vulkan {
        /// Its name.
        device: String,
        /// The call.
        call: &'static str,
        /// The code.
        result: String,
    },
    /// The job that it worked for was stopped.
    #[error("the job was stopped")]
    Stopped,
    /// A step that does not fit what was loaded.
    #[error("the step does not fit the engine: {reason}")]
    Mismatch {
        /// What differs.
        reason: String,
    },
}

impl EngineError {
    /// A step that does not fit, for this reason.
    pub(crate) fn mismatch(reason: impl Into<String>) -> Self {
        Self::Mismatch { reason: reason.into() }
    }

    /// An answer of Vulkan's: `call` names the call, `during` the kernel, the transfer or the buffer.
    #[cfg(feature = "vulkan")]
    pub fn vulkan(device: &str, call: &'static str, during: &str, result: vk::Result) -> Self {
        let device = device.to_owned();
        match result {
            vk::Result::ERROR_DEVICE_LOST => Self::DeviceLost { device, during: during.into() },
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => Self::OutOfMemory { device, what: during.into(), wanted: None },
            vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
                Self::OutOfMemory { device: "host".into(), what: during.into(), wanted: None }
            }
            other => Self::Vulkan { device, call, result: format!("{other:?}") },
        }
    }
}

/// Bytes as a person reads them, rounded up.
fn amount(bytes: Option<u64>) -> String {
    match bytes {
        None => "room".into(),
        Some(bytes) if bytes < 1 << 20 => format!("{} KiB", bytes.div_ceil(1 << 10)),
        Some(bytes) => format!("{} MiB", bytes.div_ceil(1 << 20)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_is_missing_is_said_in_true_size() {
        let text =
            |wanted| EngineError::OutOfMemory { device: "host".into(), what: "phases".into(), wanted }.to_string();
        let little = text(Some(1));
        assert!([" host ", " 1 KiB ", " phases "].iter().all(|part| little.contains(part)), "{little}");
        assert!(text(Some((1 << 20) - 1)).contains(" 1024 KiB "));
        assert!(text(Some(1 << 20)).contains(" 1 MiB ") && text(Some((3 << 20) + 1)).contains(" 4 MiB "));
        assert!(text(None).contains("phases") && !text(None).contains(|c: char| c.is_ascii_digit()));
    }
}
