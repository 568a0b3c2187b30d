//! What each saving costs and gains: the same scene solved with it and without it, in processes of their own, and judged
//! by the full model: all views, padded as wide as light walks off, the whole spectrum.

use super::{Plan, check};
use crate::{Failure, common};
use eyebox::engine::{Buffer, Engine};
use eyebox::evaluate::{self, Sums};
use eyebox::hologram::Hologram;
use eyebox::optics::{Color, Display, Padding, Pupil, WindowFactor};
use eyebox::plan::{Planner, Purpose, Viewpoint};
use eyebox::scene::LightField;
use eyebox::solve::{Diameters, Problem, PupilRange, Sampler, ScenePlan, Sequence};
use serde_json::{Value, json};
use std::sync::Arc;

/// Pupils through which all are judged, the same for all.
const PUPILS: usize = 16;
/// Of them, those whose images are compared with each other.
const COMPARED: usize = 6;

/// What one solve came to.
#[derive(Debug, Clone, Copy, Default)]
struct Measured {
    seconds: f64,
    step_ms: f64,
    mib: f64,
    mean: f64,
    worst: f64,
    /// dB between its images and those of the plan's solve.
    results: f64,
}

/// Solves and prints; as JSON where it is asked for.
pub fn run(args: &Plan, plan: &ScenePlan, field: &LightField, display: &Display) -> Result<Value, Failure> {
    let judge = Judge::new(args, plan, field, display)?;
    let mut variants: Vec<(&str, &str)> = vec![("as planned", "--full=")];
    if !plan.dark.is_empty() {
        variants.push(("colours kept", "--full=colors"));
    }
    if plan.merge > 1 || plan.outer != [0, 0] {
        variants.push(("views kept", "--full=views"));
    }
    if judge.padding != plan.padding {
        variants.push(("padded", "--full=padding"));
    }
    if plan.settings.window != WindowFactor::Full {
        if plan.settings.window == WindowFactor::One {
            variants.push(("window twice", "--window=2"));
        }
        variants.push(("window full", "--full=window"));
    }
    variants.push(("all in full", "--full=all"));
    let temp = tempfile::tempdir().map_err(|e| Failure::Asked(format!("no folder for a while: {e}")))?;
    let file = temp.path().join("hologram.zarr");
    let mut rows = vec![Vec::new(); variants.len()];
    let mut models = Vec::new();
    let mut engine = common::engine(&args.solve.engine)?;
    for seed in args.solve.seed..args.solve.seed + args.seeds.max(1) {
        let mut planned = Vec::new();
        for (rows, (name, option)) in rows.iter_mut().zip(&variants) {
            if !args.solve.json {
                eprint!("\r  seed {seed}: {name:20}");
            }
            let _ = std::fs::remove_dir_all(&file);
            // An empty list keeps nothing.
            let more: &[&str] = if *option == "--full=" { &[] } else { &[option] };
            let said = check::solve(&file, seed, more)?;
            let hologram = Hologram::load(&file)?;
            let seen = judge.look(&hologram, engine.as_mut())?;
            if planned.is_empty() {
                models.push(judge.model(&hologram, engine.as_mut())?);
                planned = seen.images.clone();
            }
            let colors = said["colors"].as_array().cloned().unwrap_or_default();
            let sum = |key: &str| colors.iter().filter_map(|c| c[key].as_f64()).sum::<f64>();
            rows.push(Measured {
                seconds: sum("seconds"),
                step_ms: sum("step_ms"),
                mib: said["peak_memory_mib"].as_f64().unwrap_or(f64::NAN),
                mean: seen.mean,
                worst: seen.worst,
                results: likeness(&planned, &seen.images),
            });
        }
    }
    if !args.solve.json {
        eprint!("\r{:40}\r", "");
    }
    let rows: Vec<Measured> = rows.iter().map(|r| average(r)).collect();
    let model = models.iter().sum::<f64>() / models.len() as f64;
    if !args.solve.json {
        say(&variants, &rows, model, args.seeds);
    }
    let row = |((name, _), m): (&(&str, &str), &Measured)| {
        json!({
            "variant": name, "seconds": m.seconds, "step_ms": m.step_ms, "peak_memory_mib": m.mib, "mean_db": m.mean, "worst_db": m.worst,
            "to_the_planned_db": if m.results.is_finite() { json!(m.results) } else { Value::Null },
        })
    };
    let model = if model.is_finite() { json!(model) } else { Value::Null };
    Ok(
        json!({ "rows": variants.iter().zip(&rows).map(row).collect::<Vec<_>>(), "two_models_db": model, "seeds": args.seeds }),
    )
}

fn say(variants: &[(&str, &str)], rows: &[Measured], model: f64, seeds: u64) {
    println!("\n  each judged by the full model through {PUPILS} pupils, mean of {seeds} seeds:");
    println!(
        "  {:14} {:>9} {:>9} {:>8} {:>9} {:>9} {:>12}",
        "", "solve s", "step ms", "MiB", "mean dB", "worst dB", "to planned"
    );
    let first = rows[0];
    for ((name, _), m) in variants.iter().zip(rows) {
        let to = if m.results.is_finite() { format!("{:.1} dB", m.results) } else { "the same".into() };
        println!(
            "  {name:14} {:9.2} {:9.1} {:8.0} {:9.2} {:9.2} {to:>12}   {:.1} times, {:+.2} dB",
            m.seconds,
            m.step_ms,
            m.mib,
            m.mean,
            m.worst,
            m.seconds / first.seconds,
            m.mean - first.mean
        );
    }
    let said = if model.is_finite() { format!("{model:.1} dB apart") } else { "the same".into() };
    println!("  the planned hologram's retinal images by the plan's model and by the full one: {said}");
}

fn average(rows: &[Measured]) -> Measured {
    let mean = |of: &dyn Fn(&Measured) -> f64| rows.iter().map(of).sum::<f64>() / rows.len().max(1) as f64;
    Measured {
        seconds: mean(&|m| m.seconds),
        step_ms: mean(&|m| m.step_ms),
        mib: mean(&|m| m.mib),
        mean: mean(&|m| m.mean),
        worst: mean(&|m| m.worst),
        results: mean(&|m| m.results),
    }
}

/// One colour of the full model.
struct Truth {
    color: Color,
    problem: Problem,
}

/// The full model, and what it is looked at through.
struct Judge {
    truths: Vec<Truth>,
    padding: Padding,
    planned: Padding,
    pupils: Vec<Pupil>,
}

/// What was seen of a hologram.
struct Seen {
    mean: f64,
    worst: f64,
    /// Exposed, of each colour that holds light and each compared pupil.
    images: Vec<Vec<f32>>,
}

impl Judge {
    fn new(args: &Plan, plan: &ScenePlan, field: &LightField, display: &Display) -> Result<Self, Failure> {
        let [far, near] = plan.settings.depth;
        let optics = display.optics(plan.colors[0])?;
        let padding = Padding::required(&optics, far.abs().max(near.abs()), display.eyebox_min() / 2.0);
        let truth =
            |color: &Color| Ok(Truth { color: *color, problem: Problem::new(field, *color, display, padding)? });
        let range = PupilRange {
            eyebox: display.eyebox_min(),
            diameter: plan.settings.diameter,
            depth: plan.settings.depth,
            diameters: Diameters::Uniform,
        };
        let mut sampler = Sampler::new(range, Sequence::Sobol, !args.solve.seed ^ 0x6d65_6173);
        Ok(Self {
            truths: plan.colors.iter().map(truth).collect::<Result<_, Failure>>()?,
            padding,
            planned: plan.padding,
            pupils: (0..PUPILS).map(|_| sampler.draw()).collect(),
        })
    }

    /// By the full model.
    fn look(&self, hologram: &Hologram, engine: &mut dyn Engine) -> Result<Seen, Failure> {
        let viewpoints: Vec<Viewpoint> = self.pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect();
        let (mut psnr, mut images) = (Vec::new(), Vec::new());
        for truth in &self.truths {
            let Some(solved) = hologram.colors.iter().find(|c| c.color == Some(truth.color)) else { continue };
            let planner = truth.problem.planner(hologram.frames, WindowFactor::Full);
            engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&truth.problem.pyramid)))?;
            engine.write(Buffer::Phases, &solved.phases)?;
            let sums = evaluate::sums(engine, &planner, &viewpoints)?;
            let exposure = Sums::fit_exposure(&sums)?;
            psnr.extend(sums.iter().map(|s| s.psnr(exposure)));
            for mut image in evaluate::images(engine, &planner, &viewpoints[..COMPARED])? {
                image.iter_mut().for_each(|v| *v *= exposure as f32);
                images.push(image);
            }
        }
        let mean = psnr.iter().sum::<f64>() / psnr.len().max(1) as f64;
        Ok(Seen { mean, worst: psnr.into_iter().fold(f64::INFINITY, f64::min), images })
    }

    /// dB between what two models see of one hologram: the plan's (its padding) and the full one.
    fn model(&self, hologram: &Hologram, engine: &mut dyn Engine) -> Result<f64, Failure> {
        let mut pairs = (Vec::new(), Vec::new());
        for truth in &self.truths {
            let Some(solved) = hologram.colors.iter().find(|c| c.color == Some(truth.color)) else { continue };
            for (padding, images) in [(self.planned, &mut pairs.0), (self.padding, &mut pairs.1)] {
                let plain = Planner::new(truth.problem.optics, hologram.frames, WindowFactor::Full);
                let planner = plain.with_padding(padding);
                engine.load(&planner.shape(Purpose::View), None)?;
                engine.write(Buffer::Phases, &solved.phases)?;
                for mut image in evaluate::views(engine, &planner, &self.pupils[..COMPARED])? {
                    image.iter_mut().for_each(|v| *v *= solved.exposure as f32);
                    images.push(image);
                }
            }
        }
        Ok(likeness(&pairs.0, &pairs.1))
    }
}

/// dB between images, 1 being full scale; infinite where they are the same.
fn likeness(one: &[Vec<f32>], other: &[Vec<f32>]) -> f64 {
    let error = |(a, b): (&Vec<f32>, &Vec<f32>)| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
    let count: usize = one.iter().map(Vec::len).sum();
    let sum: f64 = one.iter().zip(other).map(error).sum();
    if sum > 0.0 { -10.0 * (sum / count as f64).log10() } else { f64::INFINITY }
}
