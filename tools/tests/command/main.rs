//! Tests of the command `eyebox` as a user runs it. All modules are one binary, so that it is linked once.

mod at;
mod basics;
#[cfg(target_os = "linux")]
mod calibrate;
#[cfg(target_os = "linux")]
mod calibrated;
#[cfg(target_os = "linux")]
mod camera;
mod common;
mod depth_maps;
mod displays;
mod encode;
mod encoded;
mod evaluate;
mod eyes;
#[cfg(target_os = "linux")]
mod feed;
mod files;
mod generate;
mod inspect;
#[cfg(target_os = "linux")]
mod interference;
#[cfg(target_os = "linux")]
mod interrupted;
mod joint_color;
mod kept;
#[cfg(target_os = "linux")]
mod link;
#[cfg(target_os = "linux")]
mod live;
mod mask;
mod model;
mod numbers;
mod odd_values;
#[cfg(target_os = "linux")]
mod on_a_device;
#[cfg(target_os = "linux")]
mod openxr;
mod orders;
mod own_display;
mod own_scene;
mod phases;
mod plan;
mod play;
mod plm;
#[cfg(target_os = "linux")]
mod preview;
mod refine;
mod reliability;
mod reports;
mod seen;
mod settings;
mod show;
#[cfg(target_os = "linux")]
mod simulated;
mod source;
mod sources;
mod splats;
#[cfg(target_os = "linux")]
mod test_picture;
mod tiled;
mod trackers;
mod tradeoff;
mod tree;
#[cfg(target_os = "linux")]
mod two_eyes;
#[cfg(target_os = "linux")]
mod two_eyes_live;
mod units;
mod usage;
#[cfg(target_os = "linux")]
mod wayland;
#[cfg(target_os = "linux")]
mod window;
#[cfg(target_os = "linux")]
mod window_ends;
