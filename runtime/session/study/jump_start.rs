//! The beginnings that a study of content which jumps compares.

use serde::Serialize;

/// What refinement begins with after content has jumped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum JumpStart {
    /// As a session does: the phases as they are, or those of the table, whichever lose less. Two steps are spent on that.
    Best,
    /// The phases as they are.
    Last,
    /// Random phases.
    Random,
    /// The phases that a table has for the picture.
    Table,
}
