//! A mouse as an eye tracker: a window pushes where it points.

use super::{About, Event, Quantity, Reading, Sample, Source, TrackerError, Unit, now_ns};
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};
use std::time::Duration;

const KEPT: usize = 64;

/// Where a window pushes the mouse's position.
#[derive(Debug, Clone)]
pub struct MouseHandle {
    sender: Sender<(u64, Option<[f64; 2]>)>,
    oldest: Receiver<(u64, Option<[f64; 2]>)>,
}

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
        let mut event = (now_ns(), position);
        while let Err(TrySendError::Full(back)) = self.sender.try_send(event) {
            let _ = self.oldest.try_recv();
            event = back;
        }
    }
}

/// What the window pushed, as samples.
#[derive(Debug)]
pub struct MouseSource {
    events: Receiver<(u64, Option<[f64; 2]>)>,
}

/// A mouse: the window's end and the tracker's.
pub fn channel() -> (MouseHandle, MouseSource) {
    let (sender, events) = bounded(KEPT);
    (MouseHandle { sender, oldest: events.clone() }, MouseSource { events })
}

impl Source for MouseSource {
    fn about(&self) -> About {
        About { name: "mouse".into(), kind: "mouse", rate_hz: None, notes: Vec::new() }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        match self.events.recv_timeout(timeout) {
            Ok((time, position)) => {
                let mut sample = Sample::empty(time);
                let position = position.unwrap_or([f64::NAN; 2]);
                sample.combined = Some(Reading::new(Quantity::Pupil, Unit::Metres, position));
                Ok(Event::Sample(sample, None))
            }
            Err(RecvTimeoutError::Timeout) => Ok(Event::Nothing),
            // The window is closed.
            Err(RecvTimeoutError::Disconnected) => Ok(Event::End),
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
