//! Describes devices and the choice of one as plain data.

use std::path::PathBuf;

/// Options that choose a device and how it is opened.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Options {
    /// Number of the device or a part of its name. The best one is taken if none is given.
    pub device: Option<String>,
    /// True if a software device may be taken without a better one.
    pub allow_cpu: bool,
    /// True if the validation layer checks all calls. It is slow and must be installed. See
    /// [`Gpu::messages`](super::Gpu).
    pub validation: bool,
    /// Folder for compiled pipelines, which serve the next start. The default is the user's (`$XDG_CACHE_HOME/eyebox`
    /// or `~/.cache/eyebox`).
    pub cache: Option<PathBuf>,
    /// True if the device should present pictures in windows or on displays, as far as it can.
    pub present: bool,
    /// True if everything is recorded and nothing runs. Results are then arbitrary memory, and losses are 0. See
    /// [`Gpu::recorded`](super::Gpu).
    pub record_only: bool,
    /// Kind of device for which lists are recorded, instead of the real kind.
    pub plan_as: Option<DeviceKind>,
}

/// Kinds of device, best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum DeviceKind {
    /// A GPU with memory of its own.
    Discrete,
    /// A GPU that shares the CPU's memory.
    Integrated,
    /// A GPU of a virtual machine.
    Virtual,
    /// Another kind of device.
    Other,
    /// A software Vulkan, which runs on the CPU. It is taken only on request.
    Cpu,
}

impl std::fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Discrete => "discrete GPU",
            Self::Integrated => "integrated GPU",
            Self::Virtual => "virtual GPU",
            Self::Other => "other device",
            Self::Cpu => "software on the CPU",
        })
    }
}

/// Limits of a device's driver that matter for the kernels. Sizes are in bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest range of one buffer that a kernel may bind.
    pub storage_range: u64,
    /// Alignment of the start of such a range.
    pub offset_alignment: u64,
    /// Memory shared by a workgroup.
    pub shared_memory: u32,
    /// Invocations in a workgroup.
    pub invocations: u32,
    /// Workgroups in a dispatch, per axis.
    pub groups: [u32; 3],
    /// Buffers that a kernel may bind.
    pub buffers: u32,
    /// Invocations that run in lockstep. Kernels must not depend on it.
    pub subgroup: u32,
    /// Bytes of the largest single allocation.
    pub allocation: u64,
    /// Bytes of the largest `DEVICE_LOCAL` heap. It is the device's own memory, or the part of the host's memory that
    /// it uses as such.
    pub memory: u64,
    /// Nanoseconds per tick of the timestamps, 0 if there are none.
    pub timestamp_period: f32,
}

/// Results of the test of a device, as error power over signal power against float64.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Tested {
    /// Time of the test, seconds since 1970.
    pub at_unix_s: u64,
    /// Error of the propagation kernel.
    pub transfer: f64,
    /// Error of a transform.
    pub transform: f64,
    /// True if the device packs all halves exactly. Otherwise kernels compute their bits.
    pub halves: bool,
}

/// A device, with the reason if it cannot be used.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceReport {
    /// Number of the device, by which it can be chosen.
    pub index: usize,
    /// Name of the device. Any part of it can choose the device.
    pub name: String,
    /// Kind of the device.
    pub kind: DeviceKind,
    /// Name and version of its driver.
    pub driver: String,
    /// Vulkan version of the device, such as `1.3.230`.
    pub api: String,
    /// Limits of the device.
    pub limits: Limits,
    /// The reason if it cannot be used.
    pub usable: Result<(), String>,
    /// Result of its test with this driver and these kernels, if any. The first engine on a device tests it.
    pub tested: Option<Tested>,
}
