//! Stores the instances of OpenXR that applications made.

use super::dispatch::{Next, Table};
use openxr_sys as xr;

/// The instances of the process.
pub static INSTANCES: Table<Instance> = Table::new();

/// An instance of an application.
pub struct Instance {
    pub handle: xr::Instance,
    pub next: Next,
    /// True if the application enabled depth and the runtime does not have it. The layer keeps it then.
    pub depth_is_cut: bool,
}

impl Instance {
    pub fn new(handle: xr::Instance, next: Next, depth_is_cut: bool) -> Self {
        Self { handle, next, depth_is_cut }
    }
}
