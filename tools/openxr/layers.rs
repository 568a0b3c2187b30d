//! The layers of a frame, with the copies of their images.

use crate::composition::{Alpha, Cylinder, DepthRange, Format, Quad, Sheet};
use crate::vulkan::own::{Fault, Own, Texels};
use crate::vulkan::{Captured, Part};
use std::sync::Arc;

/// The distance of a view without depth, in dioptres. The usual displays of headsets focus at about 2 m, too.
pub const WITHOUT_DEPTH: f32 = 0.5;

/// A part of a copied image.
pub struct Piece {
    pub captured: Arc<Captured>,
    pub part: Part,
    pub format: Format,
}

impl Piece {
    /// Returns the texels in memory of the host, after the copy is done.
    pub fn sheet(&self) -> Option<Sheet<'_>> {
        let (raw, stride) = self.captured.bytes(&self.part, self.format.bytes())?;
        Some(Sheet { raw, format: self.format, stride, size: self.size() })
    }

    /// Returns the texels for the layer's own device, after the copy is done.
    ///
    /// # Errors
    /// Returns [`Fault`] if the device cannot import them.
    pub fn texels(&self, own: &Arc<Own>) -> Result<Option<Texels<'_>>, Fault> {
        let found = self.captured.texels(own, &self.part, self.format.bytes())?;
        Ok(found.map(|(bytes, stride)| Texels { bytes, format: self.format, stride, size: self.size() }))
    }

    fn size(&self) -> [usize; 2] {
        [self.part.height as usize, self.part.width as usize]
    }
}

/// The place of a layer's image.
pub enum Place {
    /// The view of the eye, whose edges have these tangents (left, right, up, down), with its depth.
    View {
        edges: [f64; 4],
        depth: Option<(Piece, DepthRange)>,
    },
    Quad(Quad),
    Cylinder(Cylinder),
}

/// A layer of a frame, for one eye.
pub struct Layer {
    pub color: Piece,
    pub alpha: Alpha,
    pub place: Place,
}

/// A frame of an application.
pub struct Frame {
    /// The time at which the application expects it to be shown, in nanoseconds of `CLOCK_MONOTONIC`.
    pub shows_ns: i64,
    /// The layers for the left and the right eye, from the back to the front.
    pub eyes: [Option<Vec<Layer>>; 2],
}
