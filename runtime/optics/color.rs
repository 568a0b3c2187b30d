//! Names the primary colors of a display.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A primary of the display, in the order red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Color {
    /// The primary with the longest wavelength.
    Red,
    /// The primary with the middle wavelength.
    Green,
    /// The primary with the shortest wavelength.
    Blue,
}

impl Color {
    /// The channel of this color in an RGB image.
    pub fn channel(self) -> usize {
        self as usize
    }
}

impl fmt::Display for Color {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(["red", "green", "blue"][self.channel()])
    }
}
