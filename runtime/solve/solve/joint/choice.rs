//! What is chosen of all colours at once.

use serde::{Deserialize, Serialize};

/// How all colours share their sub-frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Joint {
    /// Times that white is to be brighter than of one colour after another, by lasers of the same peak power: 1 to the number of
    /// colours. Powers are then at most the number of colours over it, times their mean: the brightest leaves them all alike.
    pub brightness: f64,
}

impl Default for Joint {
    fn default() -> Self {
        Self { brightness: 1.0 }
    }
}
