//! **eyebox-tracking**: where the pupil is and will be, for [eyebox](https://github.com/eyebox/eyebox). [`trackers`] gives samples with a steady time,
//! [`gaze`] makes of them a distribution of where the pupil will be when the light arrives.

pub mod gaze;
pub mod trackers;
