//! Predicts the pupil of a tracked eye for [eyebox](https://github.com/eyebox/eyebox).
//!
//! The crate reads eye trackers in [`trackers`], as samples with a steady time. [`gaze`] turns the samples into a
//! distribution of the pupil at the time when the light arrives.

pub mod gaze;
pub mod trackers;
