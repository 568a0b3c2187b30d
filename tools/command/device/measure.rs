//! Measures the steps of a device for `eyebox device test --measure`.

use super::small_solve::{Solve, solve};
use crate::common::Engines;
use crate::{Failure, progress};
use eyebox::low_level::engine::Storage;
use eyebox::low_level::gpu::{self, Gpu};
use serde_json::{Value, json};
use std::time::Instant;

/// The measured solves. Each has 8 sub-frames. The step is the median, which the first steps do not change.
const SOLVES: [Solve; 5] = [
    Solve { size: [256, 256], pupils: 16, steps: 40 },
    Solve { size: [512, 512], pupils: 4, steps: 40 },
    Solve { size: [512, 512], pupils: 16, steps: 40 },
    Solve { size: [1080, 1920], pupils: 4, steps: 20 },
    Solve { size: [1080, 1920], pupils: 16, steps: 20 },
];

/// A solve of the measurement, with its result.
pub struct Row {
    solve: Solve,
    storage: Storage,
    /// Median time of a step, ms.
    step: f64,
    /// Time of the solve besides its steps, s. The compilation of kernels has most of it on a new device.
    other: f64,
    pipelines: u64,
    /// Mean PSNR of the validation pupils, dB.
    psnr: Option<f64>,
}

/// Measures all solves in fp32 and fp16. With `prints`, it prints each when it is measured. Ctrl-C ends with the rows
/// until then.
pub fn rows(engines: &Engines, prints: bool) -> Result<Vec<Row>, Failure> {
    if prints {
        println!(
            "{:>12} {:>7} {:>8} {:>10} {:>10} {:>10} {:>8}",
            "size", "pupils", "storage", "step, ms", "other, s", "pipelines", "PSNR, dB"
        );
    }
    let mut rows = Vec::new();
    for (of, storage) in SOLVES.into_iter().flat_map(|of| [Storage::F32, Storage::F16].map(|storage| (of, storage))) {
        if progress::interrupted() {
            break;
        }
        let row = measured(engines, of, storage)?;
        if prints {
            println!("{}", row.line());
        }
        rows.push(row);
    }
    Ok(rows)
}

fn measured(engines: &Engines, of: Solve, storage: Storage) -> Result<Row, Failure> {
    let gpu = engines.gpu()?;
    let pipelines = || gpu.as_ref().map_or(0, |gpu: &Gpu| gpu.counts().pipelines);
    let (before, begun) = (pipelines(), Instant::now());
    let solution = solve(engines.open()?.as_mut(), of, storage)?;
    Ok(Row {
        solve: of,
        storage,
        step: solution.step_seconds * 1e3,
        other: begun.elapsed().as_secs_f64() - solution.step_seconds * solution.steps as f64,
        pipelines: pipelines() - before,
        psnr: solution.validation.quality().map(|[mean, _]| mean),
    })
}

impl Row {
    fn storage(&self) -> &'static str {
        match self.storage {
            Storage::F32 => "fp32",
            Storage::F16 => "fp16",
        }
    }

    fn line(&self) -> String {
        let [rows, columns] = self.solve.size;
        let psnr = self.psnr.map_or(String::new(), |psnr| format!("{psnr:.2}"));
        format!(
            "{:>12} {:>7} {:>8} {:>10.3} {:>10.2} {:>10} {psnr:>8}",
            format!("{rows}x{columns}"),
            self.solve.pupils,
            self.storage(),
            self.step,
            self.other,
            self.pipelines
        )
    }

    /// Returns the row for a report.
    pub fn as_json(&self) -> Value {
        json!({
            "size": self.solve.size, "pupils": self.solve.pupils, "storage": self.storage(), "step_ms": self.step,
            "other_s": self.other, "pipelines": self.pipelines, "psnr_mean_db": self.psnr,
        })
    }
}

/// Returns the kind and the driver of the device that an engine describes.
pub fn driver(engine: &str) -> Value {
    let found = gpu::devices();
    let devices = found.as_deref().unwrap_or_default();
    let report = devices.iter().find(|report| engine.contains(&report.name));
    json!(report.map(|report| json!({
        "name": report.name, "kind": report.kind.to_string(), "driver": report.driver, "api": report.api,
        "memory_mib": report.limits.memory >> 20, "subgroup": report.limits.subgroup,
    })))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::groups::{DeviceArgs, EngineArgs, EngineName};
    use eyebox::low_level::gpu::Options;

    #[test]
    fn a_row_has_the_time_and_the_quality_of_its_solve() {
        let args = EngineArgs { engine: EngineName::Cpu, device: DeviceArgs { device: None } };
        let engines = Engines::new(&args, &Options::default()).expect("the CPU");
        let row = measured(&engines, Solve { size: [48, 64], pupils: 3, steps: 5 }, Storage::F16).expect("solved");
        assert!(row.step > 0.0 && row.other > 0.0 && row.pipelines == 0, "{} {}", row.step, row.other);
        let json = row.as_json();
        assert_eq!((&json["size"], &json["pupils"], &json["storage"]), (&json!([48, 64]), &json!(3), &json!("fp16")));
        assert!(json["psnr_mean_db"].as_f64().is_some_and(|db| db > 10.0), "{json}");
        assert_eq!(row.line().split_whitespace().count(), 7, "{}", row.line());
    }
}
