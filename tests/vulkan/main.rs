//! The Vulkan engine against the kernels' twins: kernel by kernel, transform by transform, step by step.

mod dry_run;
mod encode;
mod faults;
mod fft;
mod flight;
mod fused;
mod instances;
mod joint;
mod kernels;
mod mask;
mod one_device;
mod shared;
mod source;
mod steps;
mod views;
