//! Reads scenes of splats (3D Gaussian splatting), and renders views of them.

pub(crate) mod camera;
pub(crate) mod cloud;
pub(crate) mod file;
pub(crate) mod format;
pub(crate) mod options;
pub(crate) mod path;
pub(crate) mod picture;
pub(crate) mod plain;
pub(crate) mod ply;
pub(crate) mod project;
pub(crate) mod spz;
