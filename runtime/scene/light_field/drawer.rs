//! Defines the drawing of splats on a device. Engines are in crates below this one, so they implement it.

use eyebox_kernels::project_splats::Args;
use std::fmt::Debug;
use std::ops::Range;

/// Draws pictures of splats elsewhere than on the CPU. Several threads draw different views at once.
pub trait SplatDrawer: Debug + Send + Sync {
    /// Draws a picture, which has [`VALUES`](eyebox_kernels::draw_splats::VALUES) planes. Returns false if it cannot,
    /// and reports the reason once. The CPU then draws the picture.
    fn draw(&self, splats: &dyn StoredSplats, camera: &Args, picture: &mut [f32]) -> bool;
}

/// Splats that the kernel [`project_splats`](eyebox_kernels::project_splats) reads.
pub trait StoredSplats: Sync {
    /// Returns a number that no other splats of this process have. The splats of a number do not change.
    fn id(&self) -> u64;

    /// Returns the number of splats.
    fn count(&self) -> usize;

    /// Returns the words of some splats, as many for each.
    fn words(&self, range: Range<usize>) -> Vec<u32>;
}
