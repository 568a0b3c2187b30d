//! Defines the errors of a device, and of requests that a device cannot fulfill.

#[cfg(feature = "vulkan")]
use ash::vk;

/// An error of an engine.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum EngineError {
    /// No device, no driver or no loader.
    #[error("no Vulkan device: {reason}. On Debian or Ubuntu, `tools/setup.sh` installs a software one.")]
    NoDevice {
        /// The reason from the loader or the driver.
        reason: String,
    },
    /// A device that cannot run the kernels.
    #[error("{device} cannot run this: {reason}")]
    Unsuitable {
        /// Name of the device.
        device: String,
        /// The limit that is too small, and the needed value.
        reason: String,
    },
    /// A device that computes wrong results.
    #[error(
        "{device} computes {what} wrongly: {error:.1e} of the power is error, {allowed:.0e} is allowed. \
         Update its driver ({driver}), name another device in `device`, or set `engine` to cpu."
    )]
    WrongResults {
        /// Name of the device.
        device: String,
        /// Name of its driver.
        driver: String,
        /// The operation that was tested.
        what: &'static str,
        /// Error power over signal power.
        error: f64,
        /// Largest error that passes.
        allowed: f64,
    },
    /// The host or a device ran out of memory.
    #[error(
        "out of {device} memory: {} for {what} is not available. \
         Use fewer sub-frames, a smaller size or fewer pupils per step.",
        amount(*.wanted)
    )]
    OutOfMemory {
        /// The host, or the name of a device.
        device: String,
        /// The buffer, or the call that needs memory.
        what: String,
        /// Number of bytes, if available. A driver does not report how much it needs for itself.
        wanted: Option<u64>,
    },
    /// The device stopped answering.
    #[error("{device} was lost while it ran {during}. Try again, or run on the CPU.")]
    DeviceLost {
        /// Name of the device.
        device: String,
        /// The kernel or the transfer.
        during: String,
    },
    /// The screen accepts no more pictures.
    #[error("{device}: {reason}")]
    ScreenLost {
        /// Name of the device.
        device: String,
        /// The reason for the loss.
        reason: String,
    },
    /// Another error code of Vulkan.
    #[error("{device}: {call} returned {result}")]
    Vulkan {
        /// Name of the device.
        device: String,
        /// Name of the Vulkan call.
        call: &'static str,
        /// Name of the error code.
        result: String,
    },
    /// The job of the engine was stopped.
    #[error("the job was stopped")]
    Stopped,
    /// A step that does not fit the loaded data.
    #[error("the step does not fit the engine: {reason}")]
    Mismatch {
        /// Description of the difference.
        reason: String,
    },
}

impl EngineError {
    /// Makes the error of a step that does not fit, for this reason.
    pub(crate) fn mismatch(reason: impl Into<String>) -> Self {
        Self::Mismatch { reason: reason.into() }
    }

    /// Turns an error code of Vulkan into an error. `call` names the call, `during` the kernel, the transfer or the
    /// buffer.
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

/// Formats bytes in KiB or MiB, rounded up.
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
