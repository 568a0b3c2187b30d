//! What a tracker's own clock says on the steady clock.

use std::collections::VecDeque;

/// Slices of time whose quickest arrivals are remembered.
const SLICES: usize = 8;
const SLICE_NS: u64 = 500_000_000;
/// Beyond this the tracker's clock has been set, or lies.
const STEP_NS: i128 = 250_000_000;

/// Maps a tracker's clock to the steady one by its quickest arrivals.
///
/// A sample never arrives before it was taken, and some are hardly delayed on the way: over the last four seconds the
/// smallest (arrival - tracker time) is the offset of the clocks plus the least delay. So times come out free of the
/// jitter of USB, network and scheduler. The least delay itself cannot be seen this way: that is the latency setting.
#[derive(Debug, Clone, Default)]
pub struct ClockOffset {
    /// (slice, smallest difference in it).
    slices: VecDeque<(u64, i128)>,
    last_tracker_ns: Option<u64>,
}

impl ClockOffset {
    /// When, on the steady clock, a sample with the tracker's time arrived at the earliest; at most `received_ns`.
    pub fn arrival(&mut self, tracker_ns: u64, received_ns: u64) -> u64 {
        if self.last_tracker_ns == Some(tracker_ns) {
            return received_ns; // A clock that stands is none.
        }
        let difference = i128::from(received_ns) - i128::from(tracker_ns);
        let stepped = self.least().is_some_and(|least| (difference - least).abs() > STEP_NS);
        let backwards = self.last_tracker_ns.is_some_and(|last| tracker_ns < last);
        self.last_tracker_ns = Some(tracker_ns);
        if stepped || backwards {
            self.slices.clear();
        }
        let slice = received_ns / SLICE_NS;
        match self.slices.back_mut() {
            Some((last, least)) if *last >= slice => *least = difference.min(*least),
            _ => self.slices.push_back((slice, difference)),
        }
        while self.slices.len() > SLICES || self.slices.front().is_some_and(|(s, _)| *s + SLICES as u64 <= slice) {
            self.slices.pop_front();
        }
        let least = self.least().unwrap_or(difference);
        u64::try_from(i128::from(tracker_ns) + least).unwrap_or(received_ns).min(received_ns)
    }

    fn least(&self) -> Option<i128> {
        self.slices.iter().map(|(_, d)| *d).min()
    }
}

/// Makes one clock of a counter that may be narrow and wrap around.
#[derive(Debug, Clone, Default)]
pub struct Unwrap {
    last: Option<u64>,
    turns: u64,
}

impl Unwrap {
    /// The count without wrap-around, for a counter of `bits` bits. A step back by less than half the range is a step
    /// back (the tracker lies, or a report came late), not a turn.
    pub fn count(&mut self, value: u64, bits: u32) -> u64 {
        if bits >= 64 {
            return value;
        }
        let range = 1u64 << bits;
        if let Some(last) = self.last
            && value < last
            && last - value > range / 2
        {
            self.turns += 1;
        }
        self.last = Some(value);
        self.turns.saturating_mul(range).saturating_add(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quickest_arrivals_set_the_offset() {
        let mut clock = ClockOffset::default();
        let start = 7_000_000_000u64;
        for i in 0..1000u64 {
            let tracker = i * 2_000_000;
            // 3 ms at least, and up to 9 more.
            let delay = 3_000_000 + (i * 7919 % 10) * 1_000_000;
            let arrival = clock.arrival(tracker, start + tracker + delay);
            if i > 20 {
                assert_eq!(arrival, start + tracker + 3_000_000);
            }
            assert!(arrival <= start + tracker + delay);
        }
    }

    #[test]
    fn a_clock_that_drifts_is_followed_and_one_that_is_set_starts_again() {
        let mut clock = ClockOffset::default();
        let mut worst = 0;
        for i in 0..60_000u64 {
            let received = i * 1_000_000 + 5_000_000_000;
            let tracker = (i as f64 * 1_000_100.0) as u64; // 100 ppm fast
            worst = worst.max(received - clock.arrival(tracker, received));
        }
        assert!(worst < 500_000, "{worst} ns late");
        let received = 100_000_000_000;
        assert_eq!(clock.arrival(5, received), received, "set back: starts again");
        assert_eq!(clock.arrival(u64::MAX, received + 1), received + 1);
        assert_eq!(clock.arrival(0, 1), 1, "never panics");
        // One that stands, and one that runs a thousand times too slowly, are off by a quarter of a second at most.
        let (mut stands, mut slow) = (ClockOffset::default(), ClockOffset::default());
        for i in 1..5000u64 {
            let received = i * 1_000_000;
            assert_eq!(stands.arrival(7, received), received);
            assert!(received - slow.arrival(i * 1000, received) <= 250_000_000);
        }
    }

    #[test]
    fn a_narrow_counter_goes_on() {
        let mut unwrap = Unwrap::default();
        let counts: Vec<u64> = [65_000, 65_535, 0, 20, 10, 65_530].iter().map(|v| unwrap.count(*v, 16)).collect();
        assert_eq!(counts[..5], [65_000, 65_535, 65_536, 65_556, 65_546]);
        assert_eq!(Unwrap::default().count(u64::MAX, 64), u64::MAX);
    }
}
