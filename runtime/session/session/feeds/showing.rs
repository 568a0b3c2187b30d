//! The account of content that changes while it is refined: which of it was shown, how long after it came, and why not more.

use crate::session::content::scenes::FrameFreshness;
use crate::session::feeds::sets::FinishedSet;
use crate::session::frame_log::latency::Histogram;
use serde_json::{Map, Value, json};

/// What became of scenes, as the side that makes sets knows it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct SceneCounts {
    /// Scenes that sets were made for.
    pub scenes: u64,
    /// Scenes that were left out because something was wrong with them.
    pub refused: u64,
    /// Colours that began with the phases that their scene brought, and colours that went on with those before, though there were
    /// others.
    pub own_starts: u64,
    pub kept_starts: u64,
    /// Of those that brought none and were other pictures altogether: colours that began with the phases for every picture.
    pub looked_up_starts: u64,
}

/// The account of content that changes.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ContentReport {
    /// What it is, for people.
    pub source: String,
    /// Scenes that sets were made for.
    pub scenes: u64,
    /// Scenes that came to light.
    pub shown: u64,
    /// Scenes that were left out because something was wrong with them.
    pub refused: u64,
    /// Colours of scenes that had phases to begin with: begun with the scene's own, gone on with those that were refined before,
    /// begun with those that every picture can begin with.
    pub starts: [u64; 3],
    /// Sets by how their content came, in the order of [`FrameFreshness::ALL`]; a set that is shown again counts again.
    pub sets: [u64; 5],
    /// From a scene's arrival to the beginning of its first light, ms.
    pub arrival_to_light: Histogram,
    /// What the pupils of the last step before each set saw, dB, by its loss: an estimate.
    pub estimated: Histogram,
    /// Steps over all colours, of each new set.
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

    /// A set begins to be lit: a new one, or the one before.
    pub(crate) fn lit(&mut self, set: Option<&FinishedSet>, start_ns: i64) {
        let Some(set) = set else {
            // The same light again: why its content is not newer is what the set before said, but it is new no more.
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

    /// With what the side that makes sets has counted.
    pub(crate) fn with(mut self, taken: SceneCounts) -> Self {
        let SceneCounts { scenes, refused, own_starts, kept_starts, looked_up_starts } = taken;
        (self.scenes, self.refused, self.starts) = (scenes, refused, [own_starts, kept_starts, looked_up_starts]);
        self
    }

    /// For programs: the keys are those of `docs/live.md`.
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
