//! Solves, refines and renders far-field holograms that are larger than memory, region by region (OPTICS 9).
//!
//! A pupil sees nothing but its own piece of a far-field SLM. So a solve visits one *region* after the other: it reads the
//! region's phases from the hologram's tiles, takes a few ordinary steps over pupils inside of it, and puts the phases
//! back. Memory and time follow the region, which follows the largest pupil; the hologram may be as large as the disk.
//! Regions come in a shuffled order, on a grid that is moved from one pass to the next, so that no seam stays.
//!
//! Everything about a visit follows from the job and its number, so that a solve which was cut off goes on and ends in the
//! same bytes. Nothing is kept from visit to visit but the phases.

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

/// Why a large hologram could not be solved or looked at.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TiledError {
    /// The optics.
    Optics(#[from] OpticsError),
    /// The scene.
    Scene(#[from] SceneError),
    /// The settings.
    Solve(#[from] SolveError),
    /// The engine.
    Engine(#[from] EngineError),
    /// The hologram's file.
    Hologram(#[from] HologramError),
    /// Too little memory for the largest pupil.
    #[error(
        "a pupil of {diameter_mm:.2} mm with {frames} sub-frames needs about {needed_mib} MiB, and {given_mib} MiB were given: \
         give more memory, fewer sub-frames or smaller pupils"
    )]
    Memory {
        /// The largest pupil.
        diameter_mm: f64,
        /// Sub-frames.
        frames: usize,
        /// What it takes.
        needed_mib: u64,
        /// What there is.
        given_mib: u64,
    },
    /// A display that is no such thing.
    #[error("{0}")]
    Unsuitable(String),
}
