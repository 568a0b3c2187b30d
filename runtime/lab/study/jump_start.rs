//! Defines the starting phases that a study of jumping content compares.

use serde::Serialize;

/// The phases with which the refinement starts after content has jumped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum JumpStart {
    /// The phases that a table has for the picture, as in a session. Without a table, the phases stay.
    Table,
    /// The phases before the jump.
    Last,
    /// Random phases for each color.
    Random,
}
