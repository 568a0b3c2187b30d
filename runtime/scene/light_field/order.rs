//! Converts the named order of views to their true order, by exchanging and reversing axes.

use crate::LightField;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// The true order of the views, relative to their names. First the rows and columns of the names are exchanged, and
/// then rows and columns are reversed. The text form is `as-named`, or the operations with commas, as in
/// `transpose,flip-rows`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Order {
    /// True if the row of the names is the column.
    pub transpose: bool,
    /// True if the first row is the lowest, with the largest y.
    pub flip_rows: bool,
    /// True if the first column is the rightmost, with the largest x.
    pub flip_columns: bool,
}

impl Order {
    fn parts(self) -> impl Iterator<Item = &'static str> {
        let parts = [(self.transpose, "transpose"), (self.flip_rows, "flip-rows"), (self.flip_columns, "flip-columns")];
        parts.into_iter().filter(|(done, _)| *done).map(|(_, name)| name)
    }

    /// Returns the keys of `lightfield.toml` that state this order.
    pub(crate) fn keys(self) -> String {
        self.parts().map(|name| format!("`{} = true`", name.replace('-', "_"))).collect::<Vec<_>>().join(" and ")
    }

    /// Returns rows and columns of the ordered grid. For each of its places, row by row, it also returns the index of
    /// the named view.
    pub(crate) fn places(self, [rows, columns]: [usize; 2]) -> ([usize; 2], Vec<usize>) {
        let [high, wide] = if self.transpose { [columns, rows] } else { [rows, columns] };
        let named = |i: usize| {
            let (r, c) = (i / wide, i % wide);
            let r = if self.flip_rows { high - 1 - r } else { r };
            let c = if self.flip_columns { wide - 1 - c } else { c };
            if self.transpose { c * columns + r } else { r * columns + c }
        };
        ([high, wide], (0..high * wide).map(named).collect())
    }

    /// Returns the same views in this order.
    pub(crate) fn apply(self, field: LightField) -> LightField {
        let (grid, places) = self.places(field.grid);
        field.reordered(grid, &places)
    }
}

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let parts: Vec<_> = self.parts().collect();
        f.write_str(&if parts.is_empty() { "as-named".into() } else { parts.join(",") })
    }
}

impl FromStr for Order {
    type Err = Reason;

    fn from_str(text: &str) -> Result<Self, Reason> {
        let mut order = Self::default();
        for part in text.split(',').filter(|_| text != "as-named") {
            match part.trim() {
                "transpose" => order.transpose = true,
                "flip-rows" => order.flip_rows = true,
                "flip-columns" => order.flip_columns = true,
                _ => {
                    return Err(reason!(
                        "order",
                        "expected as-named, or transpose, flip-rows, flip-columns with commas between"
                    ));
                }
            }
        }
        Ok(order)
    }
}

impl TryFrom<String> for Order {
    type Error = Reason;

    fn try_from(text: String) -> Result<Self, Reason> {
        text.parse()
    }
}

impl From<Order> for String {
    fn from(order: Order) -> Self {
        order.to_string()
    }
}
