//! The numbers of a run as CSV and JSON.

use super::found::Found;
use eyebox::optics::WindowFactor;
use eyebox::quality::Trial;
use eyebox::solve::{Diameters, Levels, Optimizer, PaddingRule};
use serde_json::{Value, json};

/// Everything, and which trials are on which front.
pub fn json(found: &Found) -> Value {
    let mut all = serde_json::to_value(found).expect("plain data");
    let places = |front: Vec<&Trial>| -> Vec<usize> {
        front.iter().filter_map(|t| found.trials.iter().position(|other| other.recipe == t.recipe)).collect()
    };
    all["fronts"] = json!({
        "mean": places(found.by_mean()), "worst": places(found.by_worst()), "memory": places(found.by_memory()),
    });
    all
}

/// One line per trial.
pub fn csv(found: &Found) -> Vec<u8> {
    let mut out = csv::Writer::from_writer(Vec::new());
    let head = [
        "trial",
        "steps",
        "pupils",
        "optimizer",
        "momentum",
        "diameters",
        "window",
        "repeats",
        "views",
        "storage",
        "levels",
        "padding",
        "pixel",
        "ms",
        "times",
        "mean_db",
        "worst_db",
        "bytes",
        "on_mean_front",
        "on_worst_front",
        "on_memory_front",
        "recommended",
    ];
    out.write_record(head).expect("a vector takes everything");
    let (mean, worst, memory) = (found.by_mean(), found.by_worst(), found.by_memory());
    let on = |front: &[&Trial], t: &Trial| usize::from(front.iter().any(|f| f.recipe == t.recipe)).to_string();
    for (i, t) in found.trials.iter().enumerate() {
        let r = &t.recipe;
        let (optimizer, momentum) = match r.optimizer {
            Optimizer::Projection { momentum, .. } => ("projection", momentum.to_string()),
            Optimizer::Adam { .. } => ("adam", String::new()),
        };
        let diameters = match r.diameters {
            Diameters::Uniform => "uniform",
            Diameters::LogUniform => "log",
            Diameters::Reciprocal => "reciprocal",
        };
        let window = match r.window {
            WindowFactor::One => "1",
            WindowFactor::Two => "2",
            WindowFactor::Full => "full",
        };
        let named = found.recommended.iter().filter(|n| n.trial.recipe == *r).map(|n| n.quality.name());
        let line = [
            i.to_string(),
            r.steps.to_string(),
            r.pupils.to_string(),
            optimizer.into(),
            momentum,
            diameters.into(),
            window.into(),
            r.repeats.to_string(),
            r.views.to_string(),
            r.storage.name().into(),
            usize::from(r.levels != Levels::Any).to_string(),
            usize::from(r.padding != PaddingRule::Never).to_string(),
            r.pixel.to_string(),
            format!("{:.3}", t.milliseconds),
            t.times.len().to_string(),
            format!("{:.4}", t.mean),
            format!("{:.4}", t.worst),
            t.bytes.to_string(),
            on(&mean, t),
            on(&worst, t),
            on(&memory, t),
            named.collect::<Vec<_>>().join(" "),
        ];
        out.write_record(line).expect("a vector takes everything");
    }
    out.into_inner().expect("a vector takes everything")
}
