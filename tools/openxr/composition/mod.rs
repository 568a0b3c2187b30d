//! Composes the picture that an eye sees, with the distance of each pixel, from the layers of a frame.

mod alpha;
mod canvas;
mod geometry;
mod sampling;
mod surfaces;
mod taps;
mod texels;

pub use alpha::Alpha;
pub use canvas::Canvas;
pub use geometry::Pose;
pub use sampling::Sheet;
pub use surfaces::{Cylinder, Quad};
pub use taps::{Frustum, Taps, taps};
pub use texels::{DepthRange, Format, srgb_curve};
