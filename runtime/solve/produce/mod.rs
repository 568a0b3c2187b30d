//! Makes holograms of scenes: all colors of one, sequences, tiled far fields, and the refinement of a finished one.
//!
//! A [`SceneJob`] says which scenes, for which display and with which settings; [`solve_scene`] loads them, decides what of
//! them is computed ([`ScenePlan`](crate::solve::ScenePlan)), solves every colour, and writes what came of it. Whoever
//! watches is told of every step ([`SceneEvent`]) and may end it ([`Flow::Stop`](crate::solve::Flow::Stop)): what is made so far is kept.
//! A [`Refinement`] refines all colors of a finished hologram for the tracked pupil.

mod colors;
mod driver;
mod error;
mod job;
mod joint;
mod refinement;
mod sequence;
mod settings_text;
mod tile_pieces;
mod tiles;

pub use colors::solve_colors;
pub use driver::{SceneSolution, SolvedHologram, solve_light_field, solve_scene};
pub use error::ProduceError;
pub use job::{SceneEvent, SceneJob, SequenceRequest, TilesPlan, TilesRequest};
pub use joint::{JointColors, solve_joint_colors};
pub use refinement::Refinement;
pub use sequence::{SequencePieces, SolvedSequence};
pub use tile_pieces::TilePieces;
pub use tiles::{SolvedTiles, is_larger_than_memory, plan_tiles};
