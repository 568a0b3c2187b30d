//! `eyebox eval` measures holograms, methods, pupil steering and settings.

pub mod compare;
mod content;
pub mod gaze;
pub mod score;
mod tune;

use crate::Failure;
use clap::Subcommand;

/// The commands of `eyebox eval`.
#[derive(Subcommand)]
pub enum Eval {
    /// Measure a hologram against its scene over many pupils
    #[command(
        after_help = "Examples:\n  eyebox eval score still-life.zarr\n  eyebox eval score still-life.zarr builtin:still-life --test-pupils random:16\n  eyebox eval score mine.zarr builtin:still-life --prescription none"
    )]
    Score(Box<crate::args::Score>),
    /// Compare methods over every group of pupils, and write a report
    #[command(
        after_help = "Examples:\n  eyebox eval compare builtin:still-life --size 256x256 -o comparison\n  eyebox eval compare lightfield/ builtin:dense-grass --size 256x256 --methods slfh,lf2fs --frames 1,8 -o comparison\n  eyebox eval compare builtin:still-life --hologram mine=still-life.zarr -o comparison\n\nThe methods are slfh, lf2fs, stft, stft-unfiltered, stft-exact, smooth, dpac and pupil-aware."
    )]
    Compare(Box<compare::Compare>),
    /// Measure the gain of pupil steering for a simulated eye
    #[command(
        after_help = "Examples:\n  eyebox eval gaze still-life.zarr --display planes24 --duration 6 -o study\n  eyebox eval gaze builtin:still-life --display planes24 --size 256x256 --color green -o study\n  eyebox eval gaze mine.zarr --display planes24 --prescription none -o others\n\nTime is counted and not waited for. It passes by the time of refinement and encoding on this machine, and stops while\nquality is judged."
    )]
    Gaze(Box<gaze::Gaze>),
    /// Measure the time and quality of settings on this machine, for --quality
    #[command(after_help = "Examples:\n  eyebox eval tune builtin:still-life --size 256x256 -o tradeoff\n  \
                      eyebox eval tune lightfield/ --size 512x512 --duration 600 --engine vulkan -o tradeoff\n  \
                      eyebox eval tune builtin:still-life --size 256x256 --seed 1 --check tradeoff/tradeoff.json --no-store -o again\n\n\
                      The recommended settings are kept in $XDG_CACHE_HOME/eyebox, or ~/.cache/eyebox, for each device.")]
    Tune(Box<tune::Tune>),
}

/// Runs one of these commands.
pub fn run(eval: &Eval) -> Result<(), Failure> {
    match eval {
        Eval::Score(args) => score::run(args),
        Eval::Compare(args) => compare::run(args),
        Eval::Gaze(args) => gaze::run(args),
        Eval::Tune(args) => tune::run(args),
    }
}
