//! Chooses the hologram of a sequence that is due.

use crate::Failure;
use eyebox::low_level::hologram::{Hologram, Sequence};
use eyebox::low_level::preview::Reader;
use std::time::Instant;

/// A sequence that is played and begins again at its end.
pub struct Playing {
    reader: Reader,
    turn: Turn,
    count: u64,
    under_way: bool,
    since: Instant,
}

/// The function from a time to the number of the hologram that is due.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Turn {
    /// Number of the hologram at the time 0.
    first: u64,
    /// The rate, or None while the sequence is paused.
    hz: Option<f64>,
}

impl Turn {
    fn due(&self, seconds: f64, count: u64) -> u64 {
        let passed = (seconds.max(0.0) * self.hz.unwrap_or(0.0)) as u64;
        (self.first % count + passed % count) % count
    }
}

impl Playing {
    /// Starts a sequence, whose first hologram is shown already.
    pub fn new(sequence: Sequence, hz: f64) -> Result<Self, Failure> {
        let count = sequence.count().max(1);
        let turn = Turn { first: 0, hz: Some(hz) };
        Ok(Self { reader: Reader::start(sequence)?, turn, count, under_way: false, since: Instant::now() })
    }

    /// Returns the number of holograms.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Pauses at `shown`, or continues from it at this rate.
    pub fn pause(&mut self, shown: u64, hz: f64) {
        let hz = if self.turn.hz.is_some() { None } else { Some(hz) };
        (self.turn, self.since) = (Turn { first: shown, hz }, Instant::now());
    }

    /// Pauses `by` holograms after `shown`.
    pub fn step(&mut self, shown: u64, by: i64) {
        let to = (shown as i128 + i128::from(by)).rem_euclid(i128::from(self.count)) as u64;
        (self.turn, self.since) = (Turn { first: to, hz: None }, Instant::now());
    }

    /// Returns the next hologram, if one was read. Requests the one that is due, if it is not `shown` and the last one
    /// was seen (`ready`).
    pub fn next(&mut self, shown: u64, ready: bool) -> Result<Option<(u64, Hologram)>, Failure> {
        let read = self.reader.newest()?;
        if read.is_some() {
            self.under_way = false;
        }
        let due = self.turn.due(self.since.elapsed().as_secs_f64(), self.count);
        if due != shown && ready && !self.under_way && read.is_none() {
            self.reader.want(due);
            self.under_way = true;
        }
        match read {
            None => Ok(None),
            Some((index, hologram)) => Ok(Some((index, hologram?))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holograms_are_due_at_their_rate_and_begin_again() {
        let turn = Turn { first: 0, hz: Some(30.0) };
        let due: Vec<u64> = [0.0, 0.02, 0.034, 0.099, 0.101, 1.0, -1.0].map(|s| turn.due(s, 4)).to_vec();
        assert_eq!(due, [0, 0, 1, 2, 3, 2, 0]);
        let still = Turn { first: 7, hz: None };
        assert_eq!((still.due(0.0, 10), still.due(1e9, 10), still.due(1.0, 5)), (7, 7, 2));
        assert_eq!(Turn { first: u64::MAX, hz: Some(1e300) }.due(1e300, 3), 0);
    }
}
