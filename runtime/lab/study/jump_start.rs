//! The beginnings that a study of content which jumps compares.

use serde::Serialize;

/// What refinement begins with after content has jumped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum JumpStart {
    /// As a session does: the phases that a table has for the picture, those as they are where there is none.
    Table,
    /// The phases as they are.
    Last,
    /// Random phases.
    Random,
}
