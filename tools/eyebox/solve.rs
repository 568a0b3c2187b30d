//! `eyebox solve`.

use crate::Failure;
use crate::args::Solve;
use crate::common::{self, Form};
use crate::progress::{self, Bar};
use crate::settings::{plan_of, settings_of};
use crate::solve_sequence;
use crate::tiled;
use eyebox::engine::Engine;
use eyebox::hologram::{self, ColorHologram, Hologram};
use eyebox::optics::{Color, Display, Padding};
use eyebox::quality::{Reference, Subject};
use eyebox::scene::LightField;
use eyebox::solve::{Levels, Settings, Solution, Stop};
use serde_json::json;
use std::time::Instant;

/// Solves, saves, and says what came of it.
pub fn run(args: &Solve) -> Result<(), Failure> {
    if let Some(scenes) = solve_sequence::scenes(args) {
        return solve_sequence::run(args, &scenes);
    }
    let start = Instant::now();
    let display = common::display(&args.display)?;
    if tiled::wants(args, &display)? {
        return tiled::solve(args, &display);
    }
    if args.passes.is_some() || args.picture.is_some() {
        return Err(Failure::Asked("--passes and --picture belong to --memory: this is solved all at once".into()));
    }
    let form = common::form(&args.out, &[Form::Zarr, Form::Npy])?;
    let colors = common::colors(&args.display, &display)?;
    // The engine first: where there is none, nothing needs to be loaded.
    let mut engine = common::engine(&args.engine)?;
    let field = common::scene(&args.scene, &display, &colors)?;
    let depth = common::depths(&args.scene, &field, &display);
    let (settings, chosen) = settings_of(args, engine.as_ref(), &display, depth, colors.len())?;
    let plan = plan_of(args, &settings, &field, &display)?;
    // What the hologram's file remembers of its scene is the scene as it is, not what the plan leaves of it.
    let (grid, cell) = (field.grid, field.cell(&display));
    let field = plan.reduce(field, &display);
    let (colors, padding) = (&plan.colors, plan.padding);
    let (base, levels) = (plan.settings.clone(), Levels::of(&display));
    let subject = Subject { field: &field, color: colors[0], display: &display, base, levels };
    let settings = subject.settings(&plan.settings);
    settings.check()?;
    if !args.json {
        eprintln!(
            "{}: {} x {} views, {}x{}, depth {:.2}..{:.2} mm",
            field.name,
            grid[0],
            grid[1],
            display.height,
            display.width,
            settings.depth[0] * 1e3,
            settings.depth[1] * 1e3
        );
        for choice in plan.choices.iter().filter(|c| c.saves || (c.what == "padding" && padding != Padding::default()))
        {
            eprintln!("{}: {} ({})", choice.what, choice.value, choice.why);
        }
        eprintln!("engine: {}", engine.describe());
        chosen.iter().for_each(|about| eprintln!("{about}"));
    }
    progress::catch_interrupt();
    let solved = solve_colors(&subject, colors, &settings, engine.as_mut(), args.json)?;
    let mut hologram = hologram(&field, &display, &settings, padding, &solved);
    hologram.settings["views"] = json!(grid);
    hologram.settings["view_pitch_mm"] = json!(cell * 1e3);
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
            "color": color, "psnr_mean_db": s.validation.mean(), "psnr_worst_db": s.validation.worst(),
            "exposure": s.exposure, "efficiency": s.efficiency, "steps": s.steps, "step_ms": s.step_seconds * 1e3, "seconds": s.seconds, "stopped_by": stop_name(s.stop), "fault": fault(s.stop),
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
            "settings": settings, "padding": [padding.rows, padding.columns], "plan": plan.choices, "timings": timings,
            "peak_memory_mib": common::peak_memory_mib(),
        });
        println!("{out}");
        return Ok(());
    }
    for (color, s) in &solved {
        println!(
            "{color:6} {:.2} dB mean, {:.2} dB worst of {} validation pupils; exposure {:.3} (efficiency {:.0} %); {} steps in {:.1} s{}",
            s.validation.mean(),
            s.validation.worst(),
            s.validation.psnr.len(),
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
    subject: &Subject,
    colors: &[Color],
    settings: &Settings,
    engine: &mut dyn Engine,
    quiet: bool,
) -> Result<Vec<(Color, Solution)>, Failure> {
    let mut solved = Vec::new();
    for &color in colors {
        let subject = Subject { color, ..subject.clone() };
        let bar = Bar::new(color.to_string(), settings.steps, quiet);
        let mut solution = subject.solve(settings, engine, &mut |p| bar.show(p))?.solution;
        if settings.reduces() {
            // Its own validation is about less than the problem.
            let reference = Reference::new(&subject, subject.base.seed, engine)?;
            solution.validation = reference.score(&solution.phases, engine)?;
            if settings.pixel > 1 {
                solution.exposure = solution.validation.exposure;
            }
        }
        bar.finish(format!("{:.1} dB", solution.validation.mean()));
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
        seed: settings.seed,
        version: env!("CARGO_PKG_VERSION").into(),
        scene: field.name.clone(),
        settings: json!({ "solve": settings, "padding": [padding.rows, padding.columns], "views": field.grid, "view_pitch_mm": field.cell(display) * 1e3, "eyebox_mm": display.eyebox_min() * 1e3 }),
        ..Hologram::on(display, settings.frames, solved.iter().map(color).collect())
    }
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
