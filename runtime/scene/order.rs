//! How the views of a folder stand against what their names say.

/// How the views really stand, where their names tell it otherwise. First the names' rows and columns are exchanged, then
/// rows and columns are reversed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Order {
    /// What the names call the row is the column.
    pub transpose: bool,
    /// The first row is the lowest: looks from the largest y.
    pub flip_rows: bool,
    /// The first column is the rightmost: looks from the largest x.
    pub flip_columns: bool,
}
