//! Computes the content frame that is due at a display time, with pause, step and speed.

use crate::present::{Rate, SECOND_NS};

/// The speed of content as a fraction of its own rate, such as 1/4 to 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Speed {
    thousandths: u32,
}

impl Speed {
    pub(crate) const ONE: Self = Self { thousandths: 1000 };

    /// Creates a speed from a factor, rounded to thousandths. Returns `None` unless the factor is 0.001 to 1000.
    pub fn new(factor: f64) -> Option<Self> {
        (0.001..=1000.0).contains(&factor).then(|| Self { thousandths: (factor * 1000.0).round() as u32 })
    }

    /// Returns the factor of the speed.
    pub fn factor(self) -> f64 {
        f64::from(self.thousandths) / 1000.0
    }
}

/// The time of content in positions. Positions count content frames from the start of playback or the last seek. The
/// reader maps them to frames of the file, because a loop shows the same frames again.
#[derive(Debug, Clone)]
pub struct Timeline {
    rate: Rate,
    speed: Speed,
    paused: bool,
    /// The time since which the position grows from `from`.
    anchor_time_ns: i64,
    /// The position at the anchor, in parts of which [`Self::unit`] make one content frame.
    from: i128,
}

impl Timeline {
    /// Creates a timeline whose position 0 is due at `start_time_ns`.
    pub fn new(rate: Rate, speed: Speed, start_time_ns: i64) -> Self {
        Self { rate, speed, paused: false, anchor_time_ns: start_time_ns, from: 0 }
    }

    /// Returns the position that is due at a display time, or `None` before the start.
    pub fn due(&self, display_time_ns: i64) -> Option<u64> {
        u64::try_from(self.parts(display_time_ns).div_euclid(self.unit())).ok()
    }

    /// Returns the time since which the position grows.
    pub(crate) fn start_ns(&self) -> i64 {
        self.anchor_time_ns
    }

    /// Returns true if content is paused.
    pub fn is_paused(&self) -> bool {
        self.paused
    }

    /// Pauses or resumes content from a display time on.
    pub fn pause(&mut self, paused: bool, display_time_ns: i64) {
        self.anchor(display_time_ns);
        self.paused = paused;
    }

    /// Sets another speed from a display time on.
    pub fn set_speed(&mut self, speed: Speed, display_time_ns: i64) {
        self.anchor(display_time_ns);
        self.speed = speed;
    }

    /// Advances to the start of a content frame, by `frames` frames. Content is paused from then on.
    pub fn step(&mut self, frames: u32, display_time_ns: i64) {
        self.pause(true, display_time_ns);
        let unit = self.unit();
        self.from = (self.from.div_euclid(unit) + i128::from(frames)).max(0) * unit;
    }

    fn anchor(&mut self, display_time_ns: i64) {
        self.from = self.parts(display_time_ns);
        self.anchor_time_ns = display_time_ns;
    }

    fn parts(&self, display_time_ns: i64) -> i128 {
        if self.paused {
            return self.from;
        }
        let [numerator, _] = self.rate.fraction();
        let a_nanosecond = i128::from(numerator) * i128::from(self.speed.thousandths);
        self.from + (i128::from(display_time_ns) - i128::from(self.anchor_time_ns)) * a_nanosecond
    }

    fn unit(&self) -> i128 {
        let [_, denominator] = self.rate.fraction();
        i128::from(denominator) * 1000 * i128::from(SECOND_NS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(rate: &str) -> Timeline {
        Timeline::new(Rate::parse(rate).unwrap(), Speed::ONE, 1_000)
    }

    #[test]
    fn frames_are_due_to_the_nanosecond() {
        let t = at("59.94");
        assert_eq!((t.due(999), t.due(1_000)), (None, Some(0)));
        // Frame 60000 is due after exactly 1001 seconds.
        assert_eq!((t.due(1_001_000_000_999), t.due(1_001_000_001_000)), (Some(59_999), Some(60_000)));
    }

    #[test]
    fn pause_step_and_speed() {
        let mut t = at("10");
        let s = SECOND_NS;
        t.pause(true, 1_000 + s);
        assert_eq!((t.due(5 * s), t.is_paused()), (Some(10), true));
        t.step(2, 6 * s);
        assert_eq!(t.due(7 * s), Some(12));
        t.pause(false, 8 * s);
        assert_eq!(t.due(9 * s), Some(22));
        t.set_speed(Speed::new(0.5).unwrap(), 9 * s);
        assert_eq!((t.due(9 * s), t.due(11 * s)), (Some(22), Some(32)));
        t.set_speed(Speed::new(4.0).unwrap(), 11 * s);
        assert_eq!(t.due(12 * s), Some(72));
        assert!([f64::NAN, 0.0, -1.0, 1e4].into_iter().all(|f| Speed::new(f).is_none()));
    }

    proptest! {
        #[test]
        fn positions_never_go_back(
            hz in 1u32..240,
            acts in prop::collection::vec((0u8..4, 0i64..2_000_000_000, 0.1f64..10.0), 1..30),
        ) {
            let mut t = Timeline::new(Rate::new(hz, 1).unwrap(), Speed::ONE, 0);
            let (mut now, mut last) = (0i64, Some(0));
            for (act, wait, factor) in acts {
                now += wait;
                prop_assert!(t.due(now) >= last);
                match act {
                    0 => t.pause(true, now),
                    1 => t.pause(false, now),
                    2 => t.step(1, now),
                    _ => t.set_speed(Speed::new(factor).unwrap(), now),
                }
                last = t.due(now);
            }
        }
    }
}
