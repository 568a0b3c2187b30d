//! Makes new views by reprojection, interpolation, Fourier disparity layers and depth maps.

pub(crate) mod closer;
pub(crate) mod given;
pub(crate) mod interpolate;
pub(crate) mod layers;
pub(crate) mod merge;
pub(crate) mod parallax;
pub(crate) mod rays;
pub(crate) mod registered;
pub(crate) mod reproject;
