//! Compares the kernels of a step with the limits of the processor, for `eyebox bench`.

use eyebox::low_level::engine::{MachineRates, ParallelTime, Timing};
use serde_json::{Map, Value, json};
use std::fmt;

/// A kernel with its rates per thread.
pub struct Row {
    name: &'static str,
    calls: u64,
    milliseconds: f64,
    /// Share of the time of all kernels.
    share: f64,
    /// Bytes per second that it reads and writes, 0 if they were not counted.
    pub bytes: f64,
    /// Operations per second of its transforms, 0 for other kernels.
    operations: f64,
}

/// Computes the rows of all kernels that ran.
pub fn rows(timings: &[Timing]) -> Vec<Row> {
    let sum: f64 = timings.iter().map(|timing| timing.seconds).sum();
    let row = |timing: &Timing| {
        let rate = |count: u64| if timing.seconds > 0.0 { count as f64 / timing.seconds } else { 0.0 };
        Row {
            name: timing.kernel.name(),
            calls: timing.calls,
            milliseconds: timing.seconds * 1e3,
            share: timing.seconds / sum,
            bytes: rate(timing.bytes),
            operations: rate(timing.operations),
        }
    };
    timings.iter().map(row).collect()
}

/// Returns the lines of the table.
pub fn lines(rows: &[Row], machine: Option<MachineRates>) -> Vec<String> {
    let rate = |rate: f64| if rate > 0.0 { format!("{:.1}", rate * 1e-9) } else { String::new() };
    let mut lines = vec![format!(
        "{:16} {:>10} {:>12} {:>10}  {:>8} {:>8}",
        "kernel", "calls", "ms in all", "share", "GB/s", "GFLOP/s"
    )];
    lines.extend(rows.iter().map(|row| {
        let Row { name, calls, milliseconds, share, bytes, operations } = row;
        let line = format!(
            "{name:16} {calls:10} {milliseconds:12.2} {:9.1} %  {:>8} {:>8}",
            100.0 * share,
            rate(*bytes),
            rate(*operations)
        );
        line.trim_end().to_owned()
    }));
    if let Some(MachineRates { memory, arithmetic }) = machine {
        lines.push(format!(
            "{:16} {:>10} {:>12} {:>10}  {:>8} {:>8}",
            "limit per thread",
            "",
            "",
            "",
            rate(memory),
            rate(arithmetic)
        ));
    }
    lines
}

/// Returns the rows as JSON, by kernel.
pub fn as_json(rows: &[Row]) -> Value {
    let one = |row: &Row| {
        let counted = |rate: f64| if rate > 0.0 { json!(rate * 1e-9) } else { Value::Null };
        let value = json!({
            "calls": row.calls, "ms": row.milliseconds, "share": row.share,
            "gb_per_s": counted(row.bytes), "gflop_per_s": counted(row.operations),
        });
        (row.name.to_owned(), value)
    };
    Value::Object(rows.iter().map(one).collect::<Map<_, _>>())
}

/// The part of a solve that threads share.
pub struct Parallel {
    pub time: ParallelTime,
    /// Time of the solve in seconds.
    pub seconds: f64,
}

impl Parallel {
    /// Returns the share of the time in which one thread works.
    fn outside(&self) -> f64 {
        1.0 - self.time.seconds / self.seconds
    }

    /// Returns the times as JSON, in seconds.
    pub fn as_json(&self) -> Value {
        let Self { time: ParallelTime { seconds, shared_seconds }, .. } = self;
        json!({ "outside_share": self.outside(), "regions_s": seconds, "regions_by_threads_s": shared_seconds })
    }
}

impl fmt::Display for Parallel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "outside parallel regions {:.1} % of the solve", 100.0 * self.outside())
    }
}
