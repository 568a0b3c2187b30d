//! Defines the drawing of splats on a device. Engines are in crates below this one, so they implement it.

use eyebox_kernels::draw_splats::{Args, Splat};
use std::fmt::Debug;

/// Draws pictures of splats elsewhere than on the CPU. Several threads draw different views at once.
pub trait SplatDrawer: Debug + Send + Sync {
    /// Draws a picture as [`draw_splats`](eyebox_kernels::draw_splats::draw_splats) does. Returns false if it cannot,
    /// and reports the reason once. The CPU then draws the picture.
    fn draw(&self, args: &Args, tiled: &TiledSplats, picture: &mut [f32]) -> bool;
}

/// The splats of a view, and their order in the tiles of its picture.
#[derive(Debug, Clone, Default)]
pub struct TiledSplats {
    /// The splats, with the nearest first.
    pub splats: Vec<Splat>,
    /// Place of the first entry of each tile, and the number of entries.
    pub first: Vec<u32>,
    /// Indices of splats, with the nearest first in each tile.
    pub entries: Vec<u32>,
}
