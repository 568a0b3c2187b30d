//! The primaries.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A primary of the display, ordered red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Color {
    /// The longest wavelength.
    Red,
    /// The middle one.
    Green,
    /// The shortest.
    Blue,
}

impl Color {
    /// Channel of an RGB image.
    pub fn channel(self) -> usize {
        self as usize
    }
}

impl fmt::Display for Color {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(["red", "green", "blue"][self.channel()])
    }
}
