//! The arguments of `eyebox plan`.

use crate::args::Solve;
use clap::Args;

/// `eyebox plan`
#[derive(Args)]
pub struct Plan {
    /// What would be solved: the arguments of `solve`
    #[command(flatten)]
    pub solve: Solve,
    /// Time this machine's engine again
    #[arg(help_heading = "Engine", long)]
    pub time_again: bool,
}
