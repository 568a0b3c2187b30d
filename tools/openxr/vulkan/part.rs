//! Defines the copied part of an image.

/// A rectangle of a layer of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// The layer of the array.
    pub layer: u32,
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

impl Part {
    /// Returns true if the other part is inside.
    pub fn contains(&self, other: &Self) -> bool {
        self.layer == other.layer
            && other.x >= self.x
            && other.y >= self.y
            && u64::from(other.x) + u64::from(other.width) <= u64::from(self.x) + u64::from(self.width)
            && u64::from(other.y) + u64::from(other.height) <= u64::from(self.y) + u64::from(self.height)
    }

    /// Returns the smallest rectangle around both. Both are of the same layer.
    pub fn around(&self, other: &Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        Self { x, y, width: right - x, height: bottom - y, ..*self }
    }
}
