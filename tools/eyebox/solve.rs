//! `eyebox solve`.

use crate::Failure;
use crate::args::{DiametersName, OptimizerName, SequenceName, Solve};
use crate::common::{self, Form};
use crate::progress::{self, Bar};
use crate::solve_sequence;
use eyebox::engine::Engine;
use eyebox::hologram::{self, ColorHologram, Hologram};
use eyebox::optics::{Color, Display, Padding};
use eyebox::scene::LightField;
use eyebox::solve::{self, Diameters, Optimizer, Problem, Sequence, Settings, Solution, Stop};
use serde_json::json;
use std::time::Instant;

/// Solves, saves, and says what came of it.
pub fn run(args: &Solve) -> Result<(), Failure> {
    if let Some(scenes) = solve_sequence::scenes(args) {
        return solve_sequence::run(args, &scenes);
    }
    let start = Instant::now();
    let form = common::form(&args.out, &[Form::Zarr, Form::Npy])?;
    let display = common::display(&args.display)?;
    let colors = common::colors(&args.display, &display)?;
    // The engine first: where there is none, nothing needs to be loaded.
    let mut engine = common::engine(&args.engine)?;
    let field = common::scene(&args.scene, &display, &colors)?;
    let depth = common::depths(&args.scene, &field, &display);
    let mut settings = settings_of(args, &display, depth);
    settings.seconds = args.seconds.map(|s| s / colors.len() as f64);
    settings.levels = args.levels.as_deref().map(levels).transpose()?;
    settings.check()?;
    let padding = padding(args.padding, &display, &colors, depth)?;
    if !args.json {
        eprintln!(
            "{}: {} x {} views, {}x{}, depth {:.2}..{:.2} mm",
            field.name,
            field.grid[0],
            field.grid[1],
            display.height,
            display.width,
            depth[0] * 1e3,
            depth[1] * 1e3
        );
        if padding != Padding::default() {
            eprintln!("padded by {} rows and {} columns against circular propagation", padding.rows, padding.columns);
        }
        eprintln!("engine: {}", engine.describe());
    }
    progress::catch_interrupt();
    let solved = solve_colors(&field, &display, &colors, &settings, padding, engine.as_mut(), args.json)?;
    let mut hologram = hologram(&field, &display, &settings, padding, &solved);
    if let Some(depth) = args.scene.depth.filter(|_| args.scene.depth_map.is_some()) {
        // In the order of the map's values, which the range of depths does not keep.
        hologram.settings["depth_map_mm"] = json!(depth.map(|d| d * 1e3));
    }
    match form {
        Form::Zarr => hologram.save(&args.out)?,
        _ => hologram::save_phases(&hologram, &args.out)?,
    }
    let report = |(color, s): &(Color, Solution)| {
        json!({
            "color": color, "psnr_mean_db": s.verdict.mean(), "psnr_worst_db": s.verdict.worst(),
            "exposure": s.exposure, "efficiency": s.efficiency, "steps": s.steps, "seconds": s.seconds, "stopped_by": stop_name(s.stop), "fault": fault(s.stop),
        })
    };
    let timings: Vec<_> = engine
        .timings()
        .iter()
        .map(|t| json!({ "kernel": t.kernel.name(), "calls": t.calls, "ms": t.seconds * 1e3 }))
        .collect();
    if args.json {
        let colors: Vec<_> = solved.iter().map(report).collect();
        let out = json!({
            "out": args.out, "engine": engine.describe(), "seconds": start.elapsed().as_secs_f64(), "colors": colors,
            "settings": settings, "padding": [padding.rows, padding.columns], "timings": timings,
        });
        println!("{out}");
        return Ok(());
    }
    for (color, s) in &solved {
        println!(
            "{color:6} {:.2} dB mean, {:.2} dB worst of {} held-out pupils; exposure {:.3} (efficiency {:.0} %); {} steps in {:.1} s{}",
            s.verdict.mean(),
            s.verdict.worst(),
            s.verdict.psnr.len(),
            s.exposure,
            100.0 * s.efficiency,
            s.steps,
            s.seconds,
            match s.stop {
                Stop::Asked => ", interrupted".to_owned(),
                Stop::NotFinite { .. } => format!("; stopped: {}", fault(s.stop)),
                _ => String::new(),
            }
        );
    }
    if args.timings {
        for t in engine.timings() {
            println!("  {:15} {:8} calls {:10.2} ms", t.kernel.name(), t.calls, t.seconds * 1e3);
        }
    }
    println!("wrote {} after {:.1} s", args.out.display(), start.elapsed().as_secs_f64());
    Ok(())
}

/// Every colour in turn. Once interrupted, the colours that are left get one step each, so that the file is whole.
pub fn solve_colors(
    field: &LightField,
    display: &Display,
    colors: &[Color],
    settings: &Settings,
    padding: Padding,
    engine: &mut dyn Engine,
    quiet: bool,
) -> Result<Vec<(Color, Solution)>, Failure> {
    let mut solved = Vec::new();
    for &color in colors {
        let problem = Problem::new(field, color, display, padding)?;
        let bar = Bar::new(color.to_string(), settings.steps, quiet);
        let solution = solve::solve(&problem, settings, engine, &mut |p| bar.show(p))?;
        bar.finish(format!("{:.1} dB", solution.verdict.mean()));
        solved.push((color, solution));
    }
    Ok(solved)
}

/// The hologram of solved colours.
pub fn hologram(
    field: &LightField,
    display: &Display,
    settings: &Settings,
    padding: Padding,
    solved: &[(Color, Solution)],
) -> Hologram {
    let color = |(color, s): &(Color, Solution)| ColorHologram {
        color: Some(*color),
        wavelength: display.wavelengths.iter().find(|w| w.color == *color).map_or(0.0, |w| w.wavelength),
        exposure: s.exposure,
        efficiency: s.efficiency,
        phases: s.phases.clone(),
    };
    Hologram {
        frames: settings.frames,
        height: display.height,
        width: display.width,
        pitch: display.pitch,
        focal_length: display.focal_length,
        colors: solved.iter().map(color).collect(),
        seed: settings.seed,
        version: env!("CARGO_PKG_VERSION").into(),
        display: display.name.clone(),
        display_wavelengths: display.wavelengths.clone(),
        scene: field.name.clone(),
        settings: json!({ "solve": settings, "padding": [padding.rows, padding.columns], "views": field.grid, "view_pitch_mm": field.cell(display) * 1e3, "eyebox_mm": display.eyebox_min() * 1e3 }),
    }
}

/// Zeros around the SLM, if asked for.
pub fn padding(asked: bool, display: &Display, colors: &[Color], depth: [f64; 2]) -> Result<Padding, Failure> {
    if !asked {
        return Ok(Padding::default());
    }
    // Light walks off by metres: the same for every colour.
    let optics = display.optics(colors[0])?;
    Ok(Padding::required(&optics, depth[0].abs().max(depth[1].abs()), display.eyebox_min() / 2.0))
}

/// The settings that the arguments mean, for depths in metres.
pub fn settings_of(args: &Solve, display: &Display, depth: [f64; 2]) -> Settings {
    let adam = args.optimizer == OptimizerName::Adam;
    let diameters = args.diameters.unwrap_or(if adam { DiametersName::Uniform } else { DiametersName::Log });
    Settings {
        frames: args.frames,
        method: args.method,
        stft_filter: args.stft_filter,
        stft_samples: args.stft_samples,
        evenness: args.evenness,
        patches: args.patches,
        optimizer: if adam { Optimizer::adam() } else { Optimizer::projection() },
        steps: args.steps.unwrap_or(if adam { 200 } else { 60 }),
        pupils: args.pupils.unwrap_or(if adam { 8 } else { 16 }),
        psnr: args.psnr,
        efficiency: args.efficiency,
        window: args.window,
        diameter: common::diameters(args.pupil_diameter, display),
        depth,
        diameters: match diameters {
            DiametersName::Uniform => Diameters::Uniform,
            DiametersName::Log => Diameters::LogUniform,
            DiametersName::Reciprocal => Diameters::Reciprocal,
        },
        sequence: if args.sequence == SequenceName::Sobol { Sequence::Sobol } else { Sequence::Random },
        seed: args.seed,
        ..Settings::default()
    }
}

/// Levels by their number, or from a file.
pub fn levels(text: &str) -> Result<Vec<f64>, Failure> {
    if let Ok(n) = text.parse::<usize>() {
        return Ok(solve::even_levels(n.min(1 << 16)));
    }
    let wrong = |what: String| Failure::Asked(format!("{text}: {what}"));
    let size =
        std::fs::metadata(text).map_err(|e| wrong(format!("neither a number of levels nor a file ({e})")))?.len();
    if size > 1 << 20 {
        return Err(wrong("a file of levels has one phase a line, 256 at most".into()));
    }
    let file = std::fs::read_to_string(text).map_err(|e| wrong(e.to_string()))?;
    let lines = file.lines().map(|l| l.split('#').next().unwrap_or("").trim()).enumerate();
    let phase = |(i, line): (usize, &str)| {
        line.parse::<f64>().map_err(|_| wrong(format!("line {}: '{line}' is not a phase in radians", i + 1)))
    };
    lines.filter(|(_, line)| !line.is_empty()).map(phase).collect()
}

fn stop_name(stop: Stop) -> &'static str {
    match stop {
        Stop::Steps => "steps",
        Stop::Seconds => "seconds",
        Stop::Quality => "psnr",
        Stop::Asked => "interrupt",
        Stop::NotFinite { .. } => "not-finite",
    }
}

/// What went wrong in a step that was not taken.
fn fault(stop: Stop) -> String {
    let Stop::NotFinite { step, kernel } = stop else { return String::new() };
    let first = kernel.map_or("the phases".to_owned(), |k| format!("`{}`", k.name()));
    format!("in step {step}, {first} gave numbers that are not finite; the state before it is kept")
}
