//! Draws a view of splats in the tiles of its picture.

use crate::light_field::drawer::SplatDrawer;
use crate::light_field::light::srgb_to_linear;
use crate::splats::project::{Displaced, Ordered};
use eyebox_kernels::draw_splats::{Splat, VALUES, draw_splats};
use std::sync::{Arc, OnceLock};

/// Steps of the table of the sRGB curve. The error between them is below 1e-7.
const STEPS: usize = 4096;

/// The splats of a view, and their order in the tiles of its picture.
pub(crate) struct TiledSplats {
    /// The splats, with the nearest first.
    pub splats: Vec<Splat>,
    /// Place of the first entry of each tile, and the number of entries.
    pub first: Vec<u32>,
    /// Indices of splats, with the nearest first in each tile.
    pub entries: Vec<u32>,
}

/// Projects a view and assigns its splats to the tiles that they touch.
pub(crate) fn tiled(splats: &Ordered, view: &Displaced) -> TiledSplats {
    let (args, splats) = (splats.args(), splats.project(view));
    let mut first = vec![0u32; args.tiles() + 1];
    for tile in splats.iter().flat_map(|splat| splat.tiles(args.across)) {
        first[tile + 1] += 1;
    }
    (1..first.len()).for_each(|tile| first[tile] += first[tile - 1]);
    let (mut next, count) = (first.clone(), first[args.tiles()] as usize);
    let mut entries = vec![0u32; count];
    for (i, splat) in splats.iter().enumerate() {
        for tile in splat.tiles(args.across) {
            entries[next[tile] as usize] = i as u32;
            next[tile] += 1;
        }
    }
    TiledSplats { splats, first, entries }
}

/// Draws a view on the CPU, or with `drawer`. The result has [`VALUES`] planes in the transfer function of the splats.
pub(crate) fn draw(splats: &Ordered, view: &Displaced, drawer: Option<&Arc<dyn SplatDrawer>>) -> Vec<f32> {
    let args = splats.args();
    let mut picture = vec![0.0; VALUES * (args.height * args.width) as usize];
    if !drawer.is_some_and(|drawer| drawer.draw(splats.stored(), &splats.camera(view), &mut picture)) {
        let tiled = tiled(splats, view);
        draw_splats(&args, &tiled.splats, &tiled.first, &tiled.entries, &mut picture);
    }
    picture
}

/// Converts a plane from the sRGB curve to linear light up to 1.
pub(crate) fn light(plane: &[f32]) -> Vec<f32> {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    let curve = || (0..=STEPS + 1).map(|i| srgb_to_linear(i as f64 / STEPS as f64) as f32).collect();
    let table = TABLE.get_or_init(curve);
    let one = |v: &f32| {
        let at = v.clamp(0.0, 1.0) * STEPS as f32;
        let (below, share) = (at as usize, at - at.floor());
        (table[below] + share * (table[below + 1] - table[below])).min(1.0)
    };
    plane.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_that_of_the_curve() {
        let values: Vec<f32> = (-5..1100).map(|i| i as f32 / 1000.0).collect();
        for (v, found) in values.iter().zip(light(&values)) {
            let exact = srgb_to_linear(f64::from(v.clamp(0.0, 1.0)));
            assert!((f64::from(found) - exact).abs() < 2e-7, "{v} {found} {exact}");
        }
    }
}
