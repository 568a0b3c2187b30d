//! Tests the interface for C from Rust, from C and from C++.

#![allow(unsafe_code)]

mod common;
mod errors;
mod fuzzed;
mod own_scene;
#[cfg(target_os = "linux")]
#[path = "../../../tests/command/common/printed.rs"]
mod printed;
#[cfg(target_os = "linux")]
mod programs;
mod same;
mod sessions;
