//! Draws a test picture for the link, and finds what the link changed in a capture of it.
//!
//! `draw` makes the picture, `orient` finds how a capture is turned and how its channels are ordered, and `judge` names
//! the faults. A capture is the digital picture at the panel's end of the cable, as a capture card or an exact grab of
//! the screen gives it. A picture of a camera does not show single pixels and levels, and is
//! refused.

mod draw;
mod judge;
mod orient;
#[cfg(test)]
mod tests;

pub use draw::{TestPictureError, test_picture};
pub use judge::{CaptureReport, LinkFault, judge_capture};
