//! What a device is, and how one is asked for: plain data.

use std::path::PathBuf;

/// How a device is chosen and watched.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Options {
    /// Its number or a part of its name; the best one if none is given.
    pub device: Option<String>,
    /// Whether a software device may be taken where no better one is.
    pub allow_cpu: bool,
    /// Whether the validation layer watches (slow; it must be installed). See [`Gpu::messages`](super::Gpu).
    pub validation: bool,
    /// Folder in which compiled pipelines are kept for the next start; the user's (`$XDG_CACHE_HOME/eyebox` or
    /// `~/.cache/eyebox`) if none is given.
    pub cache: Option<PathBuf>,
    /// Whether pictures are to be presented from it, in windows or on displays, where it can do that.
    pub present: bool,
    /// Whether all is recorded and nothing is run: results are whatever memory held, losses are 0. See
    /// [`Gpu::recorded`](super::Gpu).
    pub record_only: bool,
    /// Whether lists are recorded as for a device of this kind, whatever this one is.
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
    /// Something else.
    Other,
    /// A software Vulkan, which runs on the CPU: taken only when it is asked for.
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

/// What a device's driver allows, as far as the kernels care. Sizes in bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest range that a kernel may see of one buffer.
    pub storage_range: u64,
    /// Where such a range may start.
    pub offset_alignment: u64,
    /// Memory shared by a workgroup.
    pub shared_memory: u32,
    /// Invocations in a workgroup.
    pub invocations: u32,
    /// Workgroups in a dispatch, per axis.
    pub groups: [u32; 3],
    /// Buffers that a kernel may see.
    pub buffers: u32,
    /// Invocations that run in step, at which kernels are never allowed to guess.
    pub subgroup: u32,
    /// Largest single allocation.
    pub allocation: u64,
    /// Memory of its own, or what it may use of the host's as if it were: its largest heap that is `DEVICE_LOCAL`.
    pub memory: u64,
    /// Nanoseconds per tick of the timestamps, 0 if there are none.
    pub timestamp_period: f32,
}

/// How a device did when it was tried: error power over signal power, against float64.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Tested {
    /// When, seconds since 1970.
    pub at_unix_s: u64,
    /// Of the propagation kernel.
    pub transfer: f64,
    /// Of a transform.
    pub transform: f64,
    /// Whether halves are what they should be, all of them, as the device packs them: if not, kernels make their bits.
    pub halves: bool,
}

/// One device, and whether it can be used.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceReport {
    /// Its number, by which it can be chosen.
    pub index: usize,
    /// Its name, by any part of which it can be chosen.
    pub name: String,
    /// Its kind.
    pub kind: DeviceKind,
    /// Its driver and the driver's version.
    pub driver: String,
    /// The Vulkan that it speaks, as `1.3.230`.
    pub api: String,
    /// What it allows.
    pub limits: Limits,
    /// Why it cannot be used, if it cannot.
    pub usable: Result<(), String>,
    /// When it was tried with this driver and these kernels, if it was: the first engine on it does that.
    pub tested: Option<Tested>,
}
