//! Makes holograms of scenes, sequences and tiled far fields, and refines finished holograms.
//!
//! A [`SceneJob`] names the scenes, the display and the settings. The function [`solve_scene`] loads the scenes,
//! decides which parts are computed ([`ScenePlan`](crate::solve::ScenePlan)), solves every color, and writes the
//! results. An observer receives every step ([`SceneEvent`]) and can end the solve
//! ([`Flow::Stop`](crate::solve::Flow::Stop)), which keeps the results up to that point. A [`Refinement`] refines all
//! colors of a finished hologram for the tracked pupil.

mod colors;
mod driver;
mod given_settings;
mod job;
mod refinement;
mod sequence;
mod tile_pieces;
mod tiles;

pub use colors::{solve_colors, solve_joint_colors};
pub use driver::{SceneSolution, SolvedHologram, solve_light_field, solve_scene};
pub use given_settings::GivenSettings;
pub use job::{SceneEvent, SceneJob, SequenceRequest, TilesPlan, TilesRequest};
pub use refinement::Refinement;
pub use sequence::{SequencePieces, SolvedSequence};
pub use tile_pieces::TilePieces;
pub use tiles::{SolvedTiles, is_larger_than_memory, plan_tiles};

use crate::engine::EngineError;
use crate::hologram::HologramError;
use crate::optics::{Color, OpticsError};
use crate::quality::QualityError;
use crate::reconstruction::ReconstructionError;
use crate::scene::SceneError;
use crate::solve::SolveError;
use crate::tiled::TiledError;
use eyebox_base::error::Reason;

/// The reason why a job failed.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ProduceError {
    /// The display is invalid, lacks a color, or a pupil is outside its eyebox.
    Optics(#[from] OpticsError),
    /// The scene cannot be used.
    Scene(#[from] SceneError),
    /// The engine reported a failure.
    Engine(#[from] EngineError),
    /// The solve ended with an error.
    Solve(#[from] SolveError),
    /// The solve with reduced settings failed, or its score.
    Quality(#[from] QualityError),
    /// The hologram's file cannot be used.
    Hologram(#[from] HologramError),
    /// The score of the hologram failed.
    Reconstruction(#[from] ReconstructionError),
    /// The solve in tiles failed.
    Tiled(#[from] TiledError),
    /// The solve ended because a loss was not finite.
    #[error("{color}: the loss is not finite at step {step}. Take smaller gains or rates, or storage = \"fp32\"")]
    NotFinite {
        /// The color of the failed solve.
        color: Color,
        /// The step, from 1.
        step: usize,
    },
    /// The job contradicts itself.
    #[error("{0}")]
    Job(Reason),
}
