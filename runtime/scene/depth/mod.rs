//! Reads depth maps, and measures disparities between views and the range of depths of a scene.

pub(crate) mod central;
pub(crate) mod displacement;
pub(crate) mod flat;
pub(crate) mod map;
pub(crate) mod maps;
pub(crate) mod neighbors;
pub(crate) mod range;
pub(crate) mod subpixel;
pub(crate) mod survey;
pub(crate) mod sweep;
