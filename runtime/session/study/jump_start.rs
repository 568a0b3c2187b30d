//! The beginnings that a study of content which jumps compares.

use serde::Serialize;

/// What refinement begins with after content has jumped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum JumpStart {
    /// As a session does: the phases as they are, or those of the retrieval, whichever lose less. Two steps are spent on that.
    Best,
    /// The phases as they are.
    Last,
    /// Random phases.
    Random,
    /// A retrieval in one step from the phases that every picture can begin with; it counts as a step.
    Retrieval,
    /// The same from random phases: a retrieval of which nothing was fitted.
    Unfitted,
}
