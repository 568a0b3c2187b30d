//! The functions of OpenXR that the layer takes part in. Each passes the call on.

// Calls of OpenXR, and the structures that they point to, are `unsafe`. Each use has its reason.
#![allow(unsafe_code)]

mod chain;
mod dispatch;
mod ending;
mod extensions;
mod frame;
mod functions;
mod instance;
mod negotiate;
mod session;
mod swapchain;
