//! Counts the scenes of changing content with their delays, and the reasons for repeats.

use crate::session::content::scenes::FrameFreshness;
use crate::session::feeds::sets::FinishedSet;
use crate::session::frame_log::latency::Histogram;
use serde_json::{Map, Value, json};

/// The counts of scenes on the side that makes sets.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct SceneCounts {
    /// The scenes that sets were made for.
    pub scenes: u64,
    /// The scenes that were skipped because of an error.
    pub refused: u64,
    /// The colors that started with the phases of their scene, and the colors that continued with the previous phases
    /// although the scene brought others.
    pub own_starts: u64,
    pub kept_starts: u64,
    /// The colors that started from a table of phases, because their scene was a different picture and brought no
    /// phases.
    pub looked_up_starts: u64,
}

/// The statistics of changing content.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ContentReport {
    /// The description of the source for people.
    pub source: String,
    /// The scenes that sets were made for.
    pub scenes: u64,
    /// The scenes that were lit.
    pub shown: u64,
    /// The scenes that were skipped because of an error.
    pub refused: u64,
    /// The colors by their start, with the phases of the scene, with the previous refined phases, and with phases of
    /// the table for every picture.
    pub starts: [u64; 3],
    /// The sets by the freshness of their content, in the order of [`FrameFreshness::ALL`]. A set that is shown again
    /// counts again.
    pub sets: [u64; 5],
    /// The time from the arrival of a scene to the beginning of its first light (ms).
    pub arrival_to_light: Histogram,
    /// The estimated PSNR through the pupils of the last step before each set (dB), computed from its loss.
    pub estimated: Histogram,
    /// The steps of each new set, over all colors.
    pub steps: Histogram,
    newest: Option<u64>,
    supply: FrameFreshness,
}

impl ContentReport {
    pub(crate) fn new(source: String) -> Self {
        Self {
            source,
            scenes: 0,
            shown: 0,
            refused: 0,
            starts: [0; 3],
            sets: [0; 5],
            arrival_to_light: Histogram::new(0.1, 20_000),
            estimated: Histogram::new(0.05, 2_000),
            steps: Histogram::new(1.0, 1_000),
            newest: None,
            supply: FrameFreshness::Same,
        }
    }

    /// Records that a set begins to be lit. `None` is the previous set again.
    pub(crate) fn lit(&mut self, set: Option<&FinishedSet>, start_ns: i64) {
        let Some(set) = set else {
            // The same light is repeated. The reason for old content is taken from the previous set, but the content is
            // no longer new.
            let again = if self.supply == FrameFreshness::New { FrameFreshness::Same } else { self.supply };
            self.sets[again as usize] += u64::from(self.newest.is_some());
            return;
        };
        self.supply = match set.supply {
            _ if set.content != self.newest => FrameFreshness::New,
            FrameFreshness::New => FrameFreshness::Same,
            supply => supply,
        };
        self.sets[self.supply as usize] += 1;
        self.steps.add(f64::from(set.steps));
        if let Some(db) = set.estimated_db {
            self.estimated.add(db);
        }
        if set.content != self.newest {
            (self.newest, self.shown) = (set.content, self.shown + 1);
            if let Some(arrived) = set.arrived_ns {
                self.arrival_to_light.add(start_ns.saturating_sub(arrived) as f64 * 1e-6);
            }
        }
    }

    /// Adds the counts of the side that makes sets.
    pub(crate) fn with(mut self, taken: SceneCounts) -> Self {
        let SceneCounts { scenes, refused, own_starts, kept_starts, looked_up_starts } = taken;
        (self.scenes, self.refused, self.starts) = (scenes, refused, [own_starts, kept_starts, looked_up_starts]);
        self
    }

    /// Returns the statistics for programs, with the keys of `docs/live.md`.
    pub fn to_json(&self) -> Value {
        let sets: Map<String, Value> =
            FrameFreshness::ALL.iter().zip(self.sets).map(|(s, n)| (s.name().replace(' ', "_"), json!(n))).collect();
        let replaced = self.scenes.saturating_sub(self.shown);
        json!({
            "source": self.source, "scenes": self.scenes, "shown": self.shown, "replaced_or_pending": replaced,
            "refused": self.refused, "began_with_own_phases": self.starts[0], "went_on_with_phases_before": self.starts[1],
            "began_with_table": self.starts[2], "sets": sets, "arrival_to_light_ms": self.arrival_to_light.to_json(),
            "estimated_psnr_db": self.estimated.to_json(), "steps_per_set": self.steps.to_json(),
        })
    }
}
