//! eyebox for C and C++. `eyebox.h` is the interface of this crate, and docs/c.md describes its use.
//!
//! This crate converts arguments and results. The crate `eyebox` does the work. A handle is a box that the caller owns
//! and lends. A function takes it as `Option<&Handle>`, which is a pointer that may be null, and `free` takes the box
//! back. A failure is a status, and a sentence that the thread stores ([`eyebox_last_error`]). This keeps signatures
//! short, the caller frees no error, and threads do not disturb each other. No panic crosses into the caller, because
//! each function runs in `failure::answer`, which turns a panic into a status.

// The names for C are exported unmangled, and the types behind pointers are what the caller states.
#![allow(unsafe_code)]
#![allow(clippy::missing_safety_doc, reason = "the head of the header states it for all functions (cbindgen.toml)")]

mod arrays;
mod display;
mod encoder;
mod engine;
mod failure;
mod hologram;
mod interface;
mod pupil;
mod refiner;
mod scene;
mod session;
mod solve;
mod vulkan;

pub use display::{
    EyeboxDisplay, eyebox_display_free, eyebox_display_from_toml, eyebox_display_load, eyebox_display_resized,
};
pub use encoder::{
    EyeboxEncoder, EyeboxVideo, eyebox_encode, eyebox_encoder_free, eyebox_encoder_new, eyebox_encoder_video,
};
pub use engine::{EyeboxEngine, eyebox_engine_free, eyebox_engine_open, eyebox_engine_reason};
pub use failure::{EyeboxStatus, eyebox_last_error, eyebox_last_error_code};
pub use hologram::{
    EyeboxHologram, EyeboxSize, eyebox_hologram_display, eyebox_hologram_free, eyebox_hologram_metadata,
    eyebox_hologram_open, eyebox_hologram_phases, eyebox_hologram_save, eyebox_hologram_size, eyebox_scene_of_hologram,
    eyebox_score, eyebox_view,
};
pub use interface::{EYEBOX_BLUE, EYEBOX_GREEN, EYEBOX_INTERFACE, EYEBOX_RED, eyebox_interface};
pub use pupil::{EyeboxPupil, EyeboxScore};
pub use refiner::{
    EyeboxRefiner, eyebox_refiner_aim, eyebox_refiner_best, eyebox_refiner_free, eyebox_refiner_hologram,
    eyebox_refiner_new, eyebox_refiner_step,
};
pub use scene::{EyeboxScene, EyeboxViews, eyebox_scene_free, eyebox_scene_from_views, eyebox_scene_load};
pub use session::{
    EyeboxAccount, EyeboxFrame, EyeboxSample, EyeboxSession, eyebox_session_account, eyebox_session_follow,
    eyebox_session_free, eyebox_session_look, eyebox_session_look_moving, eyebox_session_play, eyebox_session_steer,
    eyebox_session_tick, eyebox_session_video,
};
pub use solve::{EyeboxProgress, EyeboxStep, eyebox_solve};
pub use vulkan::{EyeboxUse, eyebox_engine_vulkan_device, eyebox_engine_with_queue};
