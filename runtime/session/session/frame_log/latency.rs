//! Measures the time from the sample to the light of each set, stage by stage.

use serde_json::{Value, json};

/// The times of the events of a set (ns on the clock of the player).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Timestamps {
    /// The time of the newest sample that its pupil was predicted from, or `None` before the first sample.
    pub sample_ns: Option<i64>,
    /// The time at which that sample had arrived and was decoded.
    pub decoded_ns: Option<i64>,
    /// The time at which it was filtered.
    pub filtered_ns: Option<i64>,
    /// The time at which refinement for the set began.
    pub refine_start_ns: i64,
    /// The time at which refinement last requested the predicted pupil.
    pub aimed_ns: i64,
    /// The time at which refinement ended.
    pub refine_end_ns: i64,
    /// The time at which the set was encoded and handed over.
    pub handed_over_ns: i64,
    /// The predicted middle of its light.
    pub predicted_light_ns: i64,
}

/// A stage of the latency, or a sum of stages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stage {
    /// The time from the sample to its arrival.
    Tracker,
    /// The time from the arrival through the filter.
    Filter,
    /// The time from the filter until refinement last requested the predicted pupil, which is the age of the sample.
    Waiting,
    /// The time from that request to the end of refinement.
    Refinement,
    /// The time of encoding and handing over.
    Encoding,
    /// The time from there until the set was presented.
    HandOver,
    /// The time from there until the set was lit, in the middle of its first light.
    Display,
    /// The time from the sample to the light, which is the sum of these stages, for sets that are the first to follow
    /// their sample. A tracker without new samples adds no latency.
    SampleToLight,
    /// The age of the newest sample at the light of any set.
    SampleAge,
    /// The whole refinement for the set, during which it reads the predicted pupil repeatedly.
    AllRefinement,
    /// The time from the arrival of the sample to the light, for sets that are the first to follow it. This is the time
    /// that eyebox adds to the latency of the tracker.
    ArrivalToLight,
}

impl Stage {
    /// All stages in the order of the statistics.
    pub const ALL: [Self; 11] = [
        Self::Tracker,
        Self::Filter,
        Self::Waiting,
        Self::Refinement,
        Self::Encoding,
        Self::HandOver,
        Self::Display,
        Self::SampleToLight,
        Self::SampleAge,
        Self::AllRefinement,
        Self::ArrivalToLight,
    ];

    /// Returns the name for programs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracker => "tracker",
            Self::Filter => "filter",
            Self::Waiting => "waiting",
            Self::Refinement => "refinement",
            Self::Encoding => "encoding",
            Self::HandOver => "hand_over",
            Self::Display => "display",
            Self::SampleToLight => "sample_to_light",
            Self::SampleAge => "sample_age",
            Self::AllRefinement => "all_refinement",
            Self::ArrivalToLight => "arrival_to_light",
        }
    }
}

/// A histogram with even bins and constant size. Its percentiles are exact to half a bin.
#[derive(Debug, Clone)]
pub struct Histogram {
    bin: f64,
    counts: Vec<u32>,
    count: u64,
    sum: f64,
    largest: f64,
}

impl Histogram {
    /// Creates a histogram of values from 0 on, in `bins` bins of width `bin`. Larger values count in the last bin.
    pub fn new(bin: f64, bins: usize) -> Self {
        Self { bin, counts: vec![0; bins.max(1)], count: 0, sum: 0.0, largest: 0.0 }
    }

    /// Adds a value. NaN is ignored.
    pub fn add(&mut self, value: f64) {
        if value.is_nan() {
            return;
        }
        let value = value.max(0.0);
        let last = self.counts.len() - 1;
        let bin = &mut self.counts[((value / self.bin) as usize).min(last)];
        *bin = bin.saturating_add(1);
        self.count += 1;
        self.sum += value;
        self.largest = self.largest.max(value);
    }

    /// Returns the number of values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the value that this share of all values does not exceed, or `None` without values. In the last bin it
    /// returns the largest value.
    pub fn percentile(&self, share: f64) -> Option<f64> {
        let wanted = (share.clamp(0.0, 1.0) * self.count as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        let bin = self.counts.iter().position(|c| {
            seen += u64::from(*c);
            seen >= wanted
        })?;
        if bin + 1 == self.counts.len() {
            return Some(self.largest);
        }
        Some(((bin as f64 + 0.5) * self.bin).min(self.largest))
    }

    /// Returns the mean, the median, the percentiles 90 and 99, and the largest value.
    pub fn to_json(&self) -> Value {
        let mean = (self.count > 0).then(|| self.sum / self.count as f64);
        json!({
            "count": self.count, "mean": mean, "p50": self.percentile(0.5), "p90": self.percentile(0.9),
            "p99": self.percentile(0.99), "largest": (self.count > 0).then_some(self.largest),
        })
    }
}

/// The latencies of all shown sets, in ms for each stage, and the distance of the pupil from its predicted position.
#[derive(Debug, Clone)]
pub struct Latency {
    stages: Vec<Histogram>,
    error_mm: Histogram,
    /// The sample that the previous set followed.
    sample_ns: Option<i64>,
    /// The age of the newest sample at the newest light (ms).
    age_ms: Option<f64>,
}

impl Default for Latency {
    fn default() -> Self {
        let stages = vec![Histogram::new(0.05, 20_000); Stage::ALL.len()];
        Self { stages, error_mm: Histogram::new(0.01, 3_000), sample_ns: None, age_ms: None }
    }
}

impl Latency {
    /// Records that a set was presented for the first time. `light_ns` is the middle of its first light.
    pub fn shown(&mut self, timestamps: &Timestamps, presented_ns: i64, light_ns: i64) {
        let ms = |from: i64, to: i64| to.saturating_sub(from) as f64 * 1e-6;
        let since = |from: Option<i64>, to: Option<i64>| from.zip(to).map(|(from, to)| ms(from, to));
        let aimed = Some(timestamps.aimed_ns);
        // A sample that an earlier set followed did not wait for this one.
        let fresh = Some(*timestamps).filter(|t| t.sample_ns != self.sample_ns).unwrap_or_default();
        self.sample_ns = timestamps.sample_ns;
        self.age_ms = since(timestamps.sample_ns, Some(light_ns));
        let values = [
            (Stage::Tracker, since(fresh.sample_ns, fresh.decoded_ns)),
            (Stage::Filter, since(fresh.decoded_ns, fresh.filtered_ns)),
            (Stage::Waiting, since(fresh.filtered_ns, aimed)),
            (Stage::Refinement, since(aimed, Some(timestamps.refine_end_ns))),
            (Stage::Encoding, since(Some(timestamps.refine_end_ns), Some(timestamps.handed_over_ns))),
            (Stage::HandOver, since(Some(timestamps.handed_over_ns), Some(presented_ns))),
            (Stage::Display, since(Some(presented_ns), Some(light_ns))),
            (Stage::SampleToLight, since(fresh.sample_ns, Some(light_ns))),
            (Stage::SampleAge, self.age_ms),
            (Stage::AllRefinement, since(Some(timestamps.refine_start_ns), Some(timestamps.refine_end_ns))),
            (Stage::ArrivalToLight, since(fresh.decoded_ns, Some(light_ns))),
        ];
        for (stage, value) in values {
            if let Some(value) = value {
                self.stages[stage as usize].add(value);
            }
        }
    }

    /// Records the distance (m) of the pupil from its predicted position at the light of a set.
    pub(crate) fn missed_by(&mut self, error: f64) {
        self.error_mm.add(error * 1e3);
    }

    /// Returns the histogram of a stage (ms).
    pub fn of(&self, stage: Stage) -> &Histogram {
        &self.stages[stage as usize]
    }

    /// Returns the histogram of the distance of the pupil from its predicted position (mm).
    pub fn error_mm(&self) -> &Histogram {
        &self.error_mm
    }

    /// Returns the age of the newest sample at the newest light (ms).
    pub fn sample_age_ms(&self) -> Option<f64> {
        self.age_ms
    }

    /// Returns the latencies for programs.
    pub fn to_json(&self) -> Value {
        let stages: serde_json::Map<String, Value> =
            Stage::ALL.iter().map(|s| (format!("{}_ms", s.name()), self.of(*s).to_json())).collect();
        json!({ "stages": stages, "pupil_error_mm": self.error_mm.to_json() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_values() {
        let mut histogram = Histogram::new(0.1, 1000);
        assert_eq!(histogram.percentile(0.5), None);
        (0..1000).for_each(|i| histogram.add(f64::from(i) * 0.05));
        histogram.add(f64::NAN);
        for (share, value) in [(0.5, 25.0), (0.9, 45.0), (0.99, 49.5), (1.0, 49.95)] {
            let got = histogram.percentile(share).unwrap();
            assert!((got - value).abs() <= 0.1, "{share}: {got} for {value}");
        }
        histogram.add(1e9);
        histogram.add(-1.0);
        assert_eq!(histogram.count(), 1002);
        assert_eq!(histogram.percentile(1.0), Some(1e9), "what no bin holds is not made smaller");
    }

    /// While a mouse rests, many sets follow its last sample.
    #[test]
    fn a_sample_that_grows_old_is_no_latency() {
        let mut latency = Latency::default();
        let ms = 1_000_000;
        for set in 0..1000 {
            // The mouse moves for ten sets and then rests.
            let sample = 16 * ms * set.min(10);
            let timestamps = Timestamps { sample_ns: Some(sample), decoded_ns: Some(sample), ..Timestamps::default() };
            latency.shown(&timestamps, 16 * ms * set + 20 * ms, 16 * ms * set + 30 * ms);
        }
        let light = latency.of(Stage::SampleToLight);
        assert_eq!(light.count(), 11);
        assert!((light.percentile(1.0).unwrap() - 30.0).abs() < 0.05, "{light:?}");
        assert_eq!(latency.of(Stage::SampleAge).count(), 1000);
        assert_eq!(latency.sample_age_ms(), Some(f64::from(16 * 989 + 30)));
        assert_eq!(latency.of(Stage::SampleAge).percentile(1.0), latency.sample_age_ms());
    }

    #[test]
    fn stages_add_up_to_the_whole_way() {
        let mut latency = Latency::default();
        let timestamps = Timestamps {
            sample_ns: Some(1_000_000),
            decoded_ns: Some(9_000_000),
            filtered_ns: Some(9_100_000),
            refine_start_ns: 5_000_000,
            aimed_ns: 10_000_000,
            refine_end_ns: 20_000_000,
            handed_over_ns: 21_000_000,
            predicted_light_ns: 40_000_000,
        };
        latency.shown(&timestamps, 22_000_000, 40_000_000);
        latency.missed_by(0.2e-3);
        let median = |stage| latency.of(stage).percentile(0.5).unwrap();
        let sum: f64 = Stage::ALL[..7].iter().map(|s| median(*s)).sum();
        assert!((sum - 39.0).abs() < 0.2 && (median(Stage::SampleToLight) - 39.0).abs() < 0.05, "{sum}");
        assert!((median(Stage::AllRefinement) - 15.0).abs() < 0.05);
        assert!((median(Stage::ArrivalToLight) - 31.0).abs() < 0.05);
        assert!((latency.error_mm().percentile(0.5).unwrap() - 0.2).abs() < 0.01);
        // Before the first sample there is no latency to record.
        latency.shown(&Timestamps { sample_ns: None, decoded_ns: None, filtered_ns: None, ..timestamps }, 0, 0);
        assert_eq!(latency.of(Stage::SampleToLight).count(), 1);
        assert_eq!(latency.of(Stage::Refinement).count(), 2);
    }
}
