//! Defines the number of workgroups of a dispatch.

use super::block::Range;

/// The number of workgroups of a dispatch.
#[derive(Clone, Copy)]
pub(crate) enum Groups<'a> {
    /// These numbers of workgroups.
    These([u32; 3]),
    /// The numbers that this range holds when the dispatch runs.
    At(Range<'a>),
}

impl From<[u32; 3]> for Groups<'_> {
    fn from(groups: [u32; 3]) -> Self {
        Self::These(groups)
    }
}
