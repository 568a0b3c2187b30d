//! `eyebox device` lists and tests engines and devices that compute.

mod list;
mod measure;
mod small_solve;
mod test;

use crate::Failure;
use clap::Subcommand;

/// The commands of `eyebox device`.
#[derive(Subcommand)]
pub enum Device {
    /// List engines and devices, and the one that --engine auto takes
    #[command(
        after_help = "Example:\n  eyebox device list --json\n\nThe programs that a Vulkan driver compiled are kept in $XDG_CACHE_HOME/eyebox, or ~/.cache/eyebox."
    )]
    List(list::List),
    /// Solve and refine a small scene on a device and on the CPU, and compare the results
    #[command(
        after_help = "Examples:\n  eyebox device test\n  eyebox device test --device 0 --measure\n  eyebox device test --measure --json > report.json"
    )]
    Test(test::Test),
}

/// Runs one of these commands.
pub fn run(device: &Device) -> Result<(), Failure> {
    match device {
        Device::List(args) => list::run(args),
        Device::Test(args) => test::run(args),
    }
}
