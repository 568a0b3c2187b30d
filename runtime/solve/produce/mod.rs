//! Makes holograms of scenes: all colors of one, sequences, tiled far fields, and the refinement of a finished one.
//!
//! A [`SceneJob`] says which scenes, for which display and with which settings; [`solve_scene`] loads them, decides what of
//! them is computed ([`ScenePlan`](crate::solve::ScenePlan)), solves every colour, and writes what came of it. Whoever
//! watches is told of every step ([`SceneEvent`]) and may end it ([`Flow::Stop`](crate::solve::Flow::Stop)): what is made so far is kept.
//! A [`Refinement`] refines all colors of a finished hologram for the tracked pupil.

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

/// Why a job failed.
#[derive(Debug, thiserror::Error, serde::Serialize)]
#[error(transparent)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ProduceError {
    /// The display, a colour that it does not have, or a pupil outside of its eyebox.
    Optics(#[from] OpticsError),
    /// The scene.
    Scene(#[from] SceneError),
    /// The engine.
    Engine(#[from] EngineError),
    /// The solve.
    Solve(#[from] SolveError),
    /// The solve with reduced settings, or its score.
    Quality(#[from] QualityError),
    /// The hologram's file.
    Hologram(#[from] HologramError),
    /// The score of the hologram.
    Reconstruction(#[from] ReconstructionError),
    /// The solve in tiles.
    Tiled(#[from] TiledError),
    /// The solve ended where its numbers did.
    #[error("{color}: a loss was no finite number at step {step}: take smaller gains or rates, or storage = \"fp32\"")]
    NotFinite {
        /// The colour.
        color: Color,
        /// The step, from 1.
        step: usize,
    },
    /// A job that contradicts itself.
    #[error("{0}")]
    Job(Reason),
}
