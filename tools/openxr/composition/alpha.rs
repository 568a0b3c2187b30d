//! Defines the opacity of texels.

/// The meaning of the opacity of a layer's texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alpha {
    /// True if the texels' opacity counts. Otherwise the layer is opaque.
    pub blends: bool,
    /// True if the colors are not multiplied by the opacity.
    pub unpremultiplied: bool,
    /// True if the texels have transparency instead of opacity.
    pub inverted: bool,
}

impl Alpha {
    /// Returns the light of a texel multiplied by its opacity, and the opacity.
    pub fn premultiplied(self, [r, g, b, a]: [f32; 4]) -> [f32; 4] {
        if !self.blends {
            return [r, g, b, 1.0];
        }
        let a = if self.inverted { 1.0 - a } else { a };
        if self.unpremultiplied { [r * a, g * a, b * a, a] } else { [r, g, b, a] }
    }
}
