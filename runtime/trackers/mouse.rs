//! A mouse as an eye tracker: a window pushes where it points.

use super::{About, Event, Quantity, Reading, Sample, Source, TrackerError, Unit, now_ns};
use crate::mailbox::Mailbox;
use std::time::Duration;

const KEPT: usize = 64;

/// Where a window pushes the mouse's position.
#[derive(Debug, Clone)]
pub struct MouseHandle(Mailbox<(u64, Option<[f64; 2]>)>);

impl MouseHandle {
    /// The pupil is where the mouse points: metres in the pupil plane.
    pub fn push(&self, position: [f64; 2]) {
        self.send(Some(position));
    }

    /// The mouse has left the window: the eye is closed.
    pub fn leave(&self) {
        self.send(None);
    }

    fn send(&self, position: Option<[f64; 2]>) {
        self.0.push((now_ns(), position));
    }
}

/// What the window pushed, as samples.
#[derive(Debug)]
pub struct MouseSource(Mailbox<(u64, Option<[f64; 2]>)>);

/// A mouse: the window's end and the tracker's.
pub fn channel() -> (MouseHandle, MouseSource) {
    let events = Mailbox::new(KEPT);
    (MouseHandle(events.clone()), MouseSource(events))
}

impl Source for MouseSource {
    fn about(&self) -> About {
        About { name: "mouse".into(), kind: "mouse", rate_hz: None, notes: Vec::new() }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        // Asked before: what was pushed last is not missed.
        let closed = self.0.is_alone();
        match self.0.take_within(if closed { Duration::ZERO } else { timeout }) {
            Some((time, position)) => {
                let mut sample = Sample::empty(time);
                let position = position.unwrap_or([f64::NAN; 2]);
                sample.combined = Some(Reading::new(Quantity::Pupil, Unit::Metres, position));
                Ok(Event::Sample(sample, None))
            }
            // The window is closed.
            None if closed => Ok(Event::End),
            None => Ok(Event::Nothing),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
