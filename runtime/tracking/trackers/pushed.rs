//! Receives samples that a program or a window with a mouse pushes.

use super::clock::ForeignClock;
use super::{About, Dropped, Event, Quantity, Reading, Sample, Source, TimeUnit, TrackerError, Unit, now_ns};
use eyebox_base::mailbox::Mailbox;
use std::time::Duration;

/// Number of samples that wait. If there are more, the newest are kept.
const KEPT: usize = 64;
/// Largest age of a sample in [`SampleSender::pupil`].
const OLDEST: Duration = Duration::from_secs(10);

/// The sending end, to which samples are pushed.
#[derive(Debug, Clone)]
pub struct SampleSender(Mailbox<Sample>);

impl SampleSender {
    /// Pushes a sample, whose time is of the [steady clock](now_ns). A time ahead of the arrival, or 10 s behind it,
    /// belongs to another clock (nanoseconds from any origin), and is placed by its arrivals.
    pub fn push(&self, sample: Sample) {
        let now = now_ns();
        // The arrival on another clock is the time of this call.
        let received_ns = if is_near(sample.received_ns, now) { sample.received_ns } else { now };
        self.0.push(Sample { received_ns, ..sample });
    }

    /// Pushes the position of the pupil in the pupil plane, meters (right, down), at `age` before now, at most 10 s.
    /// `diameter` is in meters, if available. A position that is not finite is a closed eye.
    pub fn pupil(&self, position: [f64; 2], diameter: Option<f64>, age: Duration) {
        self.moving_pupil(position, None, diameter, age);
    }

    /// Pushes a pupil with its velocity, meters per second (right, down). A velocity that is not finite is dropped.
    pub fn moving_pupil(&self, position: [f64; 2], velocity: Option<[f64; 2]>, diameter: Option<f64>, age: Duration) {
        let now = now_ns();
        let age_ns = u64::try_from(age.min(OLDEST).as_nanos()).unwrap_or(0);
        let reading = Reading { velocity, diameter, ..Reading::new(Quantity::Pupil, Unit::Metres, position) };
        let sample = Sample { time_ns: now.saturating_sub(age_ns), ..Sample::empty(now) };
        self.push(Sample { combined: Some(reading.checked()), ..sample });
    }
}

/// The window's end, to which it pushes the mouse's position.
#[derive(Debug, Clone)]
pub struct MouseHandle(SampleSender);

impl MouseHandle {
    /// Pushes the position of the mouse as the pupil, meters in the pupil plane.
    pub fn push(&self, position: [f64; 2]) {
        self.0.pupil(position, None, Duration::ZERO);
    }

    /// Reports that the mouse has left the window, which counts as a closed eye.
    pub fn leave(&self) {
        self.push([f64::NAN; 2]);
    }
}

/// True if a time is of the same clock as an arrival.
fn is_near(time_ns: u64, received_ns: u64) -> bool {
    received_ns.checked_sub(time_ns).is_some_and(|age| u128::from(age) <= OLDEST.as_nanos())
}

/// The receiving end, which is a tracker.
#[derive(Debug)]
pub struct PushedSource {
    clock: ForeignClock,
    samples: Mailbox<Sample>,
    name: &'static str,
    kind: &'static str,
}

/// Returns both ends of a program's own tracker.
pub fn channel() -> (SampleSender, PushedSource) {
    named("the program's own tracker", "program")
}

/// Returns the window's end and the tracker's end of a mouse.
pub fn mouse() -> (MouseHandle, PushedSource) {
    let (sender, source) = named("mouse", "mouse");
    (MouseHandle(sender), source)
}

fn named(name: &'static str, kind: &'static str) -> (SampleSender, PushedSource) {
    let samples = Mailbox::new(KEPT);
    let clock = ForeignClock::of(TimeUnit::Seconds);
    (SampleSender(samples.clone()), PushedSource { clock, samples, name, kind })
}

impl Source for PushedSource {
    fn about(&self) -> About {
        About { name: self.name.into(), kind: self.kind, rate_hz: None, notes: Vec::new() }
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        if let Some(event) = self.clock.event() {
            return Ok(Event::Note(format!("{}: {event}", self.name)));
        }
        // The test comes first, so that the last pushed sample is not missed.
        let closed = self.samples.is_alone();
        match self.samples.take_within(if closed { Duration::ZERO } else { timeout }) {
            Some(mut sample) => {
                if !is_near(sample.time_ns, sample.received_ns) {
                    let stamp = self.clock.place(i128::from(sample.time_ns), sample.received_ns);
                    (sample.time_ns, sample.tracker_ns) = (stamp.time_ns, Some(stamp.tracker_ns));
                }
                Ok(Event::Sample(sample, None))
            }
            // The sender is gone.
            None if closed => Ok(Event::End),
            None => Ok(Event::Nothing),
        }
    }

    fn dropped(&self) -> Dropped {
        Dropped { clock_sets: self.clock.sets, ..Dropped::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_is_as_old_as_it_is_said_to_be_and_what_is_no_number_is_no_pupil() {
        let (sender, mut source) = channel();
        sender.pupil([1e-3, -2e-3], Some(3e-3), Duration::from_millis(20));
        sender.pupil([f64::NAN, 0.0], None, Duration::ZERO);
        sender.pupil([0.0; 2], Some(-1.0), Duration::MAX);
        sender.moving_pupil([0.0; 2], Some([0.01, -0.02]), None, Duration::ZERO);
        sender.moving_pupil([0.0; 2], Some([f64::INFINITY, 0.0]), None, Duration::ZERO);
        let mut samples = Vec::new();
        while let Event::Sample(sample, _) = source.next(Duration::ZERO).unwrap() {
            samples.push(sample);
        }
        let reading = samples[0].combined.unwrap();
        assert_eq!((reading.position, reading.diameter, reading.valid), ([1e-3, -2e-3], Some(3e-3), true));
        let velocities: Vec<_> = samples.drain(3..).map(|s| s.combined.unwrap().velocity).collect();
        assert_eq!(velocities, [Some([0.01, -0.02]), None]);
        let ages: Vec<u64> = samples.iter().map(|s| s.received_ns - s.time_ns).collect();
        assert_eq!(ages, [20_000_000, 0, 10_000_000_000.min(samples[2].received_ns)]);
        assert!(!samples[1].valid() && samples[2].valid() && samples[2].combined.unwrap().diameter.is_none());
        assert_eq!(source.about().kind, "program");
        drop(sender);
        assert_eq!(source.next(Duration::ZERO).unwrap(), Event::End);
    }

    /// Samples of another clock, ahead or far behind, are placed by their arrivals. Samples of the steady clock do not
    /// change.
    #[test]
    fn samples_of_another_clock_are_placed_by_their_arrivals() {
        let now = now_ns();
        let received = |i: u64| now - 9_000_000_000 + i * 8_333_333 + (i * 7 % 5) * 1_000_000;
        for ahead in [0, 1_690_000_000, 3600, 20, 100_000, -100, -3600, 60, -11, 1_000_000_000i64] {
            let (sender, mut source) = channel();
            for i in 0..60u64 {
                let taken = now - 9_000_000_000 + i * 8_333_333;
                let time = i128::from(taken) + i128::from(ahead) * 1_000_000_000;
                let Ok(time_ns) = u64::try_from(time) else { continue };
                sender.push(Sample { time_ns, ..Sample::empty(received(i)) });
                let Event::Sample(sample, _) = source.next(Duration::ZERO).unwrap() else { panic!("sample {i}") };
                assert_eq!(sample.received_ns, received(i));
                assert!(sample.time_ns.abs_diff(taken) < 1000 || (ahead != 0 && i < 6), "{ahead} s, {i}");
            }
        }
    }

    #[test]
    fn the_newest_positions_are_kept_and_leaving_closes_the_eye() {
        let (handle, mut source) = mouse();
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
