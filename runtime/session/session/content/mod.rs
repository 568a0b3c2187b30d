//! Supplies changing content, such as successive scenes, pieces of a far field, or frames of other processes.

#[cfg(target_os = "linux")]
pub(crate) mod application;
pub(crate) mod decoded_views;
mod device_splats;
#[cfg(target_os = "linux")]
pub(crate) mod device_views;
pub(crate) mod far_field;
pub(crate) mod moving;
pub(crate) mod near_eye;
pub(crate) mod scenes;
mod shared_camera;
pub(crate) mod shifted;
pub(crate) mod splats_dry_run;
pub(crate) mod walk;
