//! Models the time of a recorded step on a GPU, from bytes, arithmetic, stages and submissions.
//!
//! Bytes pass through a cache while arithmetic on waves runs. The bytes come from the recording, and the rest is
//! modeled. The H200's time per value and between stages was fitted to its steps of 256 to 1920 pixels
//! (docs/results/gpu-h200.json), within 20 % of each. The arithmetic of the other devices is scaled from the H200 by
//! the float32 rates in their data sheets. Their bandwidths are from data sheets too, and neither device was
//! measured.

use super::traffic::{Move, Recording, Stage};
use super::{Group, Kernel};
use std::collections::{BTreeMap, HashMap};
use std::time::Duration;

/// The parameters of a device in this model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeviceModel {
    /// Name of the device.
    pub name: &'static str,
    /// Memory bandwidth that is reached, bytes per second.
    pub bandwidth: f64,
    /// Bytes of the last cache that a list has to itself.
    pub cache: u64,
    /// Bandwidth of that cache, bytes per second.
    pub cache_bandwidth: f64,
    /// Seconds per complex value that a kernel of waves reads or writes, independent of its bytes. Transforms wait
    /// for their own arithmetic, not for memory.
    pub value_s: f64,
    /// Seconds from the end of a stage's work to the beginning of the next stage.
    pub stage_s: f64,
    /// Seconds per further dispatch in a stage.
    pub dispatch_s: f64,
    /// Seconds from the end of a recording to its start on the device, and back to the host.
    pub submission_s: f64,
}

/// The devices of the comparison.
pub const DEVICES: [DeviceModel; 3] = [
    DeviceModel {
        name: "H200",
        bandwidth: 0.85 * 4.8e12,
        cache: 35_000_000,
        cache_bandwidth: 8.8e12,
        value_s: 10e-12,
        stage_s: 17e-6,
        dispatch_s: 0.7e-6,
        submission_s: 22e-6,
    },
    DeviceModel {
        name: "RTX 4090",
        bandwidth: 0.88 * 1.008e12,
        cache: 60_000_000,
        cache_bandwidth: 4e12,
        value_s: 8.1e-12,
        stage_s: 17e-6,
        dispatch_s: 0.7e-6,
        submission_s: 22e-6,
    },
    DeviceModel {
        name: "Radeon 780M",
        bandwidth: 0.85 * 90e9,
        cache: 0,
        cache_bandwidth: 1e12,
        value_s: 81e-12,
        stage_s: 17e-6,
        dispatch_s: 1.2e-6,
        submission_s: 40e-6,
    },
];

/// Most bytes that a dispatch moves on a GPU, which take 10 ms on the slowest device of the comparison.
pub(crate) const DISPATCH_BYTES: u64 = (DEVICES[DEVICES.len() - 1].bandwidth * 10e-3) as u64;

/// Bytes after which the rest of a list becomes another submission. With one more dispatch and the gaps between
/// stages these take 100 ms on the slowest device. Drivers abort work that takes seconds.
pub(crate) const SUBMISSION_BYTES: u64 = 8 * DISPATCH_BYTES;

/// The modeled time of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Estimate {
    /// Time to move bytes.
    pub memory: Duration,
    /// Time of arithmetic on waves, which runs while bytes move.
    pub arithmetic: Duration,
    /// Time between stages, and of further dispatches within one.
    pub stages: Duration,
    /// Time in which the device waits for the host while the host waits for the device.
    pub submissions: Duration,
}

impl Estimate {
    /// Returns the total time, if the host does nothing meanwhile.
    pub fn total(self) -> Duration {
        self.memory.max(self.arithmetic) + self.stages + self.submissions
    }
}

/// Float32 operations per second in the data sheet of the H200.
const H200_FLOAT_RATE: f64 = 67e12;

impl DeviceModel {
    /// Returns the float32 operations per second in the data sheet of the device.
    pub fn float_rate(&self) -> f64 {
        H200_FLOAT_RATE * DEVICES[0].value_s / self.value_s
    }

    /// Estimates the time of these recordings on this device, with `value_bytes` bytes per value of a wave. Each
    /// recording starts with the cache contents that the one before it left. The result is the mean over all but the
    /// first, whose cache is empty.
    pub fn estimate(&self, recordings: &[&Recording], value_bytes: usize) -> Estimate {
        let mut cache = Cache { room: self.cache, ..Cache::default() };
        let all: Vec<_> = recordings.iter().map(|recording| self.one(recording, value_bytes, &mut cache)).collect();
        let later = &all[usize::from(all.len() > 1)..];
        let mean = |of: fn(&Estimate) -> Duration| later.iter().map(of).sum::<Duration>() / later.len().max(1) as u32;
        Estimate {
            memory: mean(|e| e.memory),
            arithmetic: mean(|e| e.arithmetic),
            stages: mean(|e| e.stages),
            submissions: mean(|e| e.submissions),
        }
    }

    /// Estimates the longest dispatch and the longest submission of a recording, each by its bytes and without a
    /// cache.
    pub fn longest(&self, recording: &Recording) -> [Duration; 2] {
        recording.largest().map(|bytes| Duration::from_secs_f64(bytes as f64 / self.bandwidth))
    }

    fn one(&self, recording: &Recording, value_bytes: usize, cache: &mut Cache) -> Estimate {
        let (mut memory, mut between) = (0.0, 0.0);
        for stage in recording.stages() {
            let moved: u64 = stage.iter().flat_map(|moves| moves.iter()).map(|m| m.bytes).sum();
            let missed = cache.pass(&stage);
            memory += f64::max(missed as f64 / self.bandwidth, moved as f64 / self.cache_bandwidth);
            between += self.stage_s + self.dispatch_s * (stage.len() - 1) as f64;
        }
        let waves = |kernel: Kernel| !matches!(kernel.group(), Group::Photograph | Group::Levels);
        let of_waves = recording.by_kernel().into_iter().filter(|(kernel, ..)| waves(*kernel));
        let values = of_waves.map(|(.., bytes)| bytes).sum::<u64>() as f64 / value_bytes as f64;
        Estimate {
            memory: Duration::from_secs_f64(memory),
            arithmetic: Duration::from_secs_f64(values * self.value_s),
            stages: Duration::from_secs_f64(between),
            submissions: Duration::from_secs_f64(recording.stalls() as f64 * self.submission_s),
        }
    }
}

/// Bytes of one piece in the modeled cache.
const PIECE: u64 = 1 << 20;

/// The place of a move and the number of a piece in it.
type Key = ((u64, u64), u64);

/// A least-recently-used cache. Written pieces go to memory when they are evicted.
#[derive(Default)]
struct Cache {
    room: u64,
    used: u64,
    clock: u64,
    /// Time of last use, bytes, and true if written, for each place and piece.
    held: HashMap<Key, (u64, u64, bool)>,
    /// The pieces by time of last use.
    order: BTreeMap<u64, Key>,
}

impl Cache {
    /// Returns the bytes that go from or to memory in a stage.
    fn pass(&mut self, stage: &Stage<'_>) -> u64 {
        stage.iter().flat_map(|moves| moves.iter()).map(|m| self.touch(m)).sum()
    }

    fn touch(&mut self, by: &Move) -> u64 {
        if self.room == 0 {
            return by.bytes;
        }
        let mut missed = 0;
        let pieces = by.bytes.div_ceil(PIECE);
        for piece in 0..pieces {
            let bytes = by.bytes / pieces;
            let key = (by.place, piece);
            self.clock += 1;
            let held = self.held.remove(&key);
            if let Some((when, had, _)) = held {
                self.order.remove(&when);
                self.used -= had;
            } else if !by.write {
                missed += bytes;
            }
            let (had, written) = held.map_or((0, false), |(_, had, written)| (had, written));
            self.held.insert(key, (self.clock, bytes.max(had), by.write || written));
            self.order.insert(self.clock, key);
            self.used += bytes.max(had);
            while self.used > self.room && self.order.len() > 1 {
                let Some((_, oldest)) = self.order.pop_first() else { break };
                let Some((_, bytes, written)) = self.held.remove(&oldest) else { continue };
                self.used -= bytes;
                missed += if written { bytes } else { 0 };
            }
        }
        missed
    }
}

#[cfg(test)]
mod tests {
    use super::super::traffic::Entry;
    use super::*;

    fn work(moves: &[(u64, u64, bool)]) -> Entry {
        let moves = moves.iter().map(|&(at, bytes, write)| Move { place: (at, 0), bytes, write }).collect();
        Entry::Work { moves, dispatch: true }
    }

    #[test]
    fn what_a_cache_holds_is_not_fetched_again() {
        let room = 8 * PIECE;
        let mut cache = Cache { room, ..Cache::default() };
        let of = |at, bytes, write| Move { place: (at, 0), bytes, write };
        assert_eq!(cache.touch(&of(1, 4 * PIECE, false)), 4 * PIECE);
        assert_eq!(cache.touch(&of(1, 4 * PIECE, false)), 0);
        // Written pieces cost nothing until they have to make room.
        assert_eq!(cache.touch(&of(2, 4 * PIECE, true)), 0);
        assert_eq!(cache.touch(&of(3, 4 * PIECE, false)), 4 * PIECE);
        assert_eq!(cache.touch(&of(4, 4 * PIECE, false)), 8 * PIECE);
        assert!(cache.used <= room);
    }

    #[test]
    fn an_estimate_is_bytes_by_bandwidth_and_what_lies_between() {
        let device = DeviceModel {
            cache: 0,
            bandwidth: 1e9,
            cache_bandwidth: 1e15,
            value_s: 5e-9,
            stage_s: 1e-3,
            dispatch_s: 1e-4,
            submission_s: 0.5,
            name: "",
        };
        let mut recording = Recording::default();
        for entry in [
            work(&[(1, 500_000_000, false)]),
            work(&[(2, 500_000_000, true)]),
            Entry::Barrier,
            Entry::Barrier,
            work(&[(1, 1_000_000_000, false)]),
            Entry::Mark(Kernel::Modulate as usize),
            Entry::Submit,
            Entry::Stall,
        ] {
            recording.push(entry);
        }
        assert_eq!((recording.dispatches(), recording.barriers(), recording.stage_count()), (3, 2, 2));
        assert_eq!(recording.bytes(), [1_500_000_000, 500_000_000]);
        let estimate = device.estimate(&[&recording], 8);
        assert!((estimate.memory.as_secs_f64() - 2.0).abs() < 1e-9);
        assert!((estimate.stages.as_secs_f64() - 2.1e-3).abs() < 1e-9);
        assert!((estimate.total().as_secs_f64() - 2.5021).abs() < 1e-9);
        // Values of half the bytes are twice the number: 5e8 values take longer than their bytes. Kernels of target
        // images count no values.
        let halves = device.estimate(&[&recording], 4);
        assert!((halves.arithmetic.as_secs_f64() - 2.5).abs() < 1e-9 && estimate.memory == halves.memory);
        assert!((halves.total().as_secs_f64() - 3.0021).abs() < 1e-9);
        let mut seen = Recording::default();
        seen.push(work(&[(1, 1_000_000_000, false)]));
        seen.push(Entry::Mark(Kernel::Photograph as usize));
        assert_eq!(device.estimate(&[&seen], 4).arithmetic, Duration::ZERO);
        // The RTX 4090 has 82.6e12 operations per second.
        assert!((DEVICES[1].float_rate() / 82.6e12 - 1.0).abs() < 0.01);
    }
}
