//! Defines light fields, with views from a grid of pupil positions, their cameras, and target images.

pub(crate) mod cameras;
pub(crate) mod drawer;
pub(crate) mod error;
pub(crate) mod field;
pub(crate) mod light;
pub(crate) mod natural;
pub(crate) mod near;
pub(crate) mod order;
pub(crate) mod photograph;
pub(crate) mod photographs;
pub(crate) mod pyramid;
pub(crate) mod request;
pub(crate) mod resize;
pub(crate) mod shape;
