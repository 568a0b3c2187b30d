//! Reads tiles for a display that is not ideal, across the edges of the SLM.
//!
//! Crosstalk enters a piece from its surroundings, and from beyond the SLM's edges.

use super::super::chunks::check_memory;
use super::super::{HologramError, Metadata};
use super::Tiles;
use crate::plan::ModelTables;
use std::sync::Arc;

impl Tiles {
    /// Returns the phases of a rectangle no larger than the hologram, which may extend over its edges by up to its own
    /// size. Phases beyond one edge come from the opposite side.
    ///
    /// # Errors
    /// Returns the errors of [`read`](Self::read).
    pub(crate) fn read_around(&self, color: usize, at: [i64; 2], size: [usize; 2]) -> Result<Vec<f32>, HologramError> {
        let whole = [self.about.height, self.about.width];
        let runs = [0, 1].map(|k| runs(at[k], size[k], whole[k]));
        if let [&[(0, row, rows)], &[(0, column, columns)]] = [&runs[0][..], &runs[1][..]] {
            return self.read(color, [row, column], [rows, columns]);
        }
        check_memory(self.folder.path(), &[self.about.frames, size[0], size[1]])?;
        let mut out = vec![0.0f32; self.about.frames * size[0] * size[1]];
        for &(y, row, rows) in &runs[0] {
            for &(x, column, columns) in &runs[1] {
                let part = self.read(color, [row, column], [rows, columns])?;
                for (i, line) in part.chunks_exact(columns).enumerate() {
                    let to = (i / rows * size[0] + y + i % rows) * size[1] + x;
                    out[to..to + columns].copy_from_slice(line);
                }
            }
        }
        Ok(out)
    }

    /// Returns the model of its display for one of its colors, over the whole SLM, for pieces that are simulated one at
    /// a time. Returns none for an ideal display.
    ///
    /// # Errors
    /// Returns [`HologramError::NoDisplay`] or [`HologramError::Optics`].
    pub fn model(&self, color: usize) -> Result<Option<&Arc<ModelTables>>, HologramError> {
        if self.models.get().is_none() {
            let one = |color| {
                let whole = self.about.optics(color)?;
                Ok(self.about.model(color, whole, whole)?.map(|model| model.for_pieces()))
            };
            let all = (0..self.about.colors.len()).map(one).collect::<Result<_, HologramError>>()?;
            // A faster thread made the same models.
            let _ = self.models.set(all);
        }
        Ok(self.models.get().and_then(|models| models[color].as_ref()))
    }

    /// Returns the same hologram for reading, with other metadata.
    pub(in super::super) fn described(&self, change: impl FnOnce(&mut Metadata)) -> Self {
        let mut about = self.about.clone();
        change(&mut about.metadata);
        Self::looking(self.folder.clone(), about, self.side, self.made.clone())
    }
}

/// Splits `size` places from `at` on, which wrap around after `whole`, into runs of (index of the first, place,
/// length).
fn runs(at: i64, size: usize, whole: usize) -> Vec<(usize, usize, usize)> {
    let (mut found, mut done) = (Vec::new(), 0);
    while done < size {
        let place = (at + done as i64).rem_euclid(whole as i64) as usize;
        let count = (whole - place).min(size - done);
        found.push((done, place, count));
        done += count;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_hangs_over_an_edge_goes_round() {
        assert_eq!(runs(3, 4, 10), [(0, 3, 4)]);
        assert_eq!(runs(0, 10, 10), [(0, 0, 10)]);
        assert_eq!(runs(-2, 5, 10), [(0, 8, 2), (2, 0, 3)]);
        assert_eq!(runs(7, 5, 10), [(0, 7, 3), (3, 0, 2)]);
        assert_eq!(runs(-1, 4, 3), [(0, 2, 1), (1, 0, 3)]);
    }
}
