//! An image in one colour.

use super::pool2;
use crate::optics::PictureMap;
use crate::scene::Bend;

/// Linear light, or intensity, (row, column).
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Row by row.
    pub values: Vec<f32>,
}

impl Plane {
    /// As it is seen behind what bends the display's picture.
    pub fn as_seen(&self, map: &PictureMap) -> Self {
        Self { values: Bend::to_viewer(map, [self.rows, self.columns]).apply(&self.values), ..*self }
    }

    /// The mean of every block of 2 x 2 pixels ([`pool2`]).
    pub(crate) fn pooled(&self) -> Self {
        let values = pool2(&self.values, self.rows, self.columns);
        if self.rows < 2 || self.columns < 2 {
            return Self { values, ..*self };
        }
        Self { rows: self.rows / 2, columns: self.columns / 2, values }
    }
}
