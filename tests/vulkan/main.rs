//! The Vulkan engine against the CPU twins of its kernels, by kernel, by transform and by step.

mod dry_run;
mod encode;
mod faults;
mod fft;
mod flight;
mod forward;
mod fused;
mod instances;
mod joint;
mod kernels;
mod mask;
mod one_device;
mod posing;
mod shared;
mod source;
mod splats;
mod steps;
mod views;
