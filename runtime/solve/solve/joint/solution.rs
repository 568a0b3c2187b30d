//! What comes of solving all colours at once.

use crate::solve::outcome::Solution;

/// Colours that were solved together.
#[derive(Debug, Clone)]
pub struct JointSolution {
    /// One a colour, in the order of the problems; its phases are those that the colour has of the shared drives.
    pub colors: Vec<Solution>,
    /// Power of each colour's laser in each sub-frame, over its mean: (colour, sub-frame).
    pub powers: Vec<Vec<f64>>,
}
