//! The arguments of `eyebox plan`.

use crate::args::Solve;
use clap::Args;

/// `eyebox plan`
#[derive(Args)]
pub struct Plan {
    /// What would be solved: the arguments of `solve`
    #[command(flatten)]
    pub solve: Solve,
    /// Then solve it, and say how far the forecast was off
    #[arg(long)]
    pub check: bool,
    /// Time this machine's engine again
    #[arg(long)]
    pub time_again: bool,
}
