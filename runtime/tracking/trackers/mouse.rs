//! A mouse as an eye tracker: a window pushes where it points.

use super::pushed::{self, PushedSource, SampleSender};
use std::time::Duration;

/// Where a window pushes the mouse's position.
#[derive(Debug, Clone)]
pub struct MouseHandle(SampleSender);

impl MouseHandle {
    /// The pupil is where the mouse points: metres in the pupil plane.
    pub fn push(&self, position: [f64; 2]) {
        self.0.pupil(position, None, Duration::ZERO);
    }

    /// The mouse has left the window: the eye is closed.
    pub fn leave(&self) {
        self.push([f64::NAN; 2]);
    }
}

/// A mouse: the window's end and the tracker's.
pub fn channel() -> (MouseHandle, PushedSource) {
    let (sender, source) = pushed::named("mouse", "mouse");
    (MouseHandle(sender), source)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trackers::{Event, Source};

    /// As many as wait.
    const KEPT: usize = 64;

    #[test]
    fn the_newest_positions_are_kept_and_leaving_closes_the_eye() {
        let (handle, mut source) = channel();
        for i in 0..1000 {
            handle.push([f64::from(i), 0.0]);
        }
        handle.leave();
        let mut samples = Vec::new();
        while let Event::Sample(sample, _) = source.next(Duration::ZERO).unwrap() {
            samples.push(sample.combined.unwrap());
        }
        assert_eq!(samples.len(), KEPT);
        assert_eq!(samples[KEPT - 2].position[0], 999.0);
        assert!(!samples[KEPT - 1].valid);
        drop(handle);
        // The source holds no sender of its own, so it ends with the window.
        assert_eq!(source.next(Duration::ZERO).unwrap(), Event::End);
    }
}
