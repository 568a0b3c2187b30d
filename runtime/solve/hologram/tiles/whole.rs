//! A hologram in tiles as one in memory.

use super::super::chunks::check_length;
use super::super::{Hologram, HologramError};
use super::Tiles;

impl Tiles {
    /// All of it in memory; that every tile of a finished one is there, and as long as it must be, is known before any is read.
    pub(in super::super) fn into_hologram(self) -> Result<Hologram, HologramError> {
        let size = [self.about.height, self.about.width];
        if self.made.is_none() {
            let [rows, columns] = self.range([0, 0], size);
            let values = self.about.frames * self.side * self.side;
            for color in 0..self.about.colors.len() {
                for (row, column) in rows.clone().flat_map(|r| columns.clone().map(move |c| (r, c))) {
                    check_length(&self.folder, &self.name([color, row, column]), values, true)?;
                }
            }
        }
        let mut hologram = self.about.clone();
        for (color, of) in hologram.colors.iter_mut().enumerate() {
            of.phases = self.read(color, [0, 0], size)?;
        }
        Ok(hologram)
    }
}
