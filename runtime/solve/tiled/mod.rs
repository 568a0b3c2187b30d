//! Solves, refines and renders far-field holograms that are larger than memory, region by region (OPTICS 9).
//!
//! A pupil sees only its own piece of a far-field SLM. Therefore a solve visits one *region* after the other. It reads
//! the region's phases from the hologram's tiles, takes a few ordinary steps over pupils inside it, and writes the
//! phases back. Memory and time depend on the region, whose size depends on the largest pupil. The hologram may be as
//! large as the disk. Regions come in a shuffled order, on a grid that moves from one pass to the next, so that no seam
//! remains.
//!
//! The job and the number of a visit decide everything about it. An interrupted solve thus continues and ends in the
//! same bytes. Only the phases are kept from visit to visit.

mod refine;
mod region;
mod solve;
mod visits;

pub use refine::{TileRect, problem_around};
pub use region::{MemoryLimit, RegionSize};
pub use solve::{Job, Visit, Visited, exposure, solve, visit};
pub use visits::{Schedule, Waits};

use crate::engine::EngineError;
use crate::evaluate::Views;
use crate::hologram::HologramError;
use crate::optics::OpticsError;
use crate::scene::SceneError;
use crate::solve::SolveError;

/// The reason why a large hologram could not be solved or simulated.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TiledError {
    /// The optics are impossible.
    Optics(#[from] OpticsError),
    /// The scene cannot be used.
    Scene(#[from] SceneError),
    /// The settings are invalid.
    Solve(#[from] SolveError),
    /// The engine reported a failure.
    Engine(#[from] EngineError),
    /// The hologram's file cannot be used.
    Hologram(#[from] HologramError),
    /// The memory is too small for the largest pupil.
    #[error(
        "a pupil of {diameter_mm:.2} mm with {frames} sub-frames: needs about {needed_mib} MiB, but the limit is \
         {given_mib} MiB. Give more memory, fewer sub-frames or smaller pupils"
    )]
    Memory {
        /// The largest pupil diameter in mm.
        diameter_mm: f64,
        /// The number of sub-frames.
        frames: usize,
        /// Required memory in MiB.
        needed_mib: u64,
        /// The memory limit in MiB.
        given_mib: u64,
    },
    /// The display, the aim or the optimizer is not suitable.
    #[error("{0}")]
    Unsuitable(String),
}
