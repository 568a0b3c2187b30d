//! Far-field holograms larger than memory: solved region by region into their file, gone on with after any end, looked at
//! through the tiles under a pupil alone.

use crate::Failure;
use crate::args::{SceneArgs, Solve};
use crate::common::{self, Form};
use crate::progress;
use crate::settings::base_of;
use eyebox::engine::Engine;
use eyebox::evaluate::Views;
use eyebox::hologram::{ColorHologram, Hologram, Metadata, PhaseSource, SceneSource, Tiles};
use eyebox::optics::{Color, Display, Geometry, Pupil};
use eyebox::plan::Storage;
use eyebox::scene::Request;
use eyebox::solve::{Flow, Method, Optimizer, Settings};
use eyebox::tiled::{self, Job, Memory, RegionSize, Schedule, TiledError};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Without --memory.
const MEMORY: u64 = 4 << 30;
/// Steps of a visit, and passes over the SLM, where neither is given.
const STEPS: usize = 8;
/// As [`STEPS`].
const PASSES: usize = 3;

/// Whether a display's holograms of so many sub-frames are solved region by region: asked for, or larger than memory.
pub fn wants(args: &Solve, display: &Display) -> Result<bool, Failure> {
    if display.geometry == Geometry::Relay {
        return match args.memory {
            Some(_) => Err(Failure::Asked(
                "--memory is for far-field displays: in a relay every pupil sees all of the SLM".into(),
            )),
            None => Ok(false),
        };
    }
    Ok(args.memory.is_some() || is_large(display, args.frames.unwrap_or(Settings::default().frames)))
}

/// Whether all of it at once, with 9 x 9 views, takes more than the memory that is taken unasked.
fn is_large(display: &Display, frames: usize) -> bool {
    let pixels = (display.height * display.width) as u64;
    let colors = display.wavelengths.len() as u64;
    pixels * (32 * frames as u64 + 81 * (4 * colors + 3)) > MEMORY
}

/// Solves every colour, from where the file stands.
pub fn solve(args: &Solve, display: &Display) -> Result<(), Failure> {
    let start = Instant::now();
    refuse_what_is_not_here(args)?;
    common::form(&args.out, &[Form::Zarr])?;
    let colors = common::colors(&args.display, display)?;
    let mut engine = common::engine(&args.engine)?;
    let memory = Memory(args.memory.unwrap_or(MEMORY));
    let largest = display.eyebox_min() / 2.0;
    let diameter = args.pupil_diameter.unwrap_or([1e-3f64.min(largest / 4.0), 4e-3f64.min(largest)]);
    let optics = display.optics(colors[0])?;
    let frames = args.frames.unwrap_or(Settings::default().frames);
    let side = tile_side(display);
    let picture = args.picture.unwrap_or(1024).min(display.picture_size().0);
    let views = scene(&args.scene, display, &colors, picture)?;
    let held: u64 = views.iter().map(Views::held).sum();
    let left = Memory(memory.0.saturating_sub(held));
    let with_held = |error| match error {
        TiledError::Memory { diameter_mm, frames, needed_mib, .. } => {
            let (needed_mib, given_mib) = (needed_mib + (held >> 20), memory.0 >> 20);
            TiledError::Memory { diameter_mm, frames, needed_mib, given_mib }
        }
        other => other,
    };
    // Views that are smaller than the picture take less.
    let seen = views[0].size();
    let size = RegionSize::new(&optics, frames, side, diameter[1], seen, left).map_err(with_held)?;
    let depth = args.scene.depth.or(views[0].depth()).unwrap_or([0.0, 0.0]);
    let mut settings = base_of(args, display, [depth[0].min(depth[1]), depth[0].max(depth[1])]);
    settings.diameter = diameter;
    settings.steps = args.steps.unwrap_or(STEPS);
    if let Some(window) = args.window {
        settings.window = window;
    }
    if let Some(diameters) = args.diameters {
        settings.diameters = diameters;
    }
    settings.check()?;
    let passes = args.passes.unwrap_or(PASSES).max(1);
    let schedule = Schedule::new([display.height, display.width], size, side, passes, args.seed);
    // Everything that decides a byte of the file.
    let mut work = json!({
        "scene": args.scene.scene, "views": [args.scene.views, Some(picture)], "view_pitch": args.scene.view_pitch,
        "display": display.to_toml(), "colors": colors, "settings": settings, "passes": passes, "tile": side,
        "region": [size.rows, size.columns], "engine": engine.describe(),
    });
    if let Some(map) = &args.scene.depth_map {
        work["depth_map"] = json!([map.display().to_string(), args.scene.depth]);
    }
    let mut tiles = match unfinished(&args.out, &work)? {
        Some(tiles) => tiles,
        None => {
            let about = about(args, display, &colors, &views, &settings, passes, engine.as_mut())?;
            Tiles::create(&args.out, &about, side, work)?
        }
    };
    let visits = schedule.visits.len();
    let done = tiles.made().map_or(0, |m| m.done);
    if !args.json {
        eprintln!(
            "{} on {}: {}x{}, {frames} sub-frames, pupils of {:.2} to {:.2} mm, depth {:.1}..{:.1} mm",
            args.scene.scene,
            display.name,
            display.height,
            display.width,
            diameter[0] * 1e3,
            diameter[1] * 1e3,
            settings.depth[0] * 1e3,
            settings.depth[1] * 1e3
        );
        eprintln!(
            "out of core: {visits} visits a colour to regions of {}x{}, {} steps each; about {} MiB of {} MiB",
            size.rows,
            size.columns,
            settings.steps,
            (size.bytes + held) >> 20,
            memory.0 >> 20
        );
        if done > 0 {
            eprintln!("going on after {done} visits");
        }
        eprintln!("engine: {}", engine.describe());
    }
    progress::catch_interrupt();
    let mut pupils = 0;
    for (i, color) in colors.iter().enumerate() {
        let before = (i * visits) as u64;
        let job = Job { color: i, views: &views[i], settings: &settings, schedule: &schedule, size, before };
        let bar = bar(color, visits, done.saturating_sub(before), args.json);
        let flow = tiled::solve(&job, &mut tiles, engine.as_mut(), &mut |step| {
            pupils += step.pupils;
            if let Some(bar) = &bar {
                bar.set_message(format!("{:.1} dB", -10.0 * step.loss.log10()));
                bar.set_position(step.visit as u64);
            }
            if progress::interrupted() { Flow::Stop } else { Flow::Continue }
        })?;
        if let Some(bar) = bar {
            bar.abandon();
        }
        if flow == Flow::Stop && tiles.made().is_some_and(|m| m.done < (colors.len() * visits) as u64) {
            eprintln!("interrupted; the same command goes on from here");
            return Ok(());
        }
    }
    let solving = start.elapsed().as_secs_f64();
    let [read, written] = tiles.moved();
    tiles.finish()?;
    let pupils_seen = places(display, &settings);
    let source = PhaseSource::Tiled(Arc::new(tiles));
    let scores = source.score(&SceneSource::Around(views), &pupils_seen, engine.as_mut())?;
    let summary = scores.summary().ok_or_else(|| Failure::Asked("there is no pupil to score".into()))?;
    let peak = common::peak_memory_mib();
    if args.json {
        let rows: Vec<_> =
            scores.pupils.iter().map(|s| json!({ "pupil_mm": s.pupil.to_mm(), "psnr_db": s.psnr })).collect();
        let timings: Vec<_> = (engine.timings().iter())
            .map(|t| json!({ "kernel": t.kernel.name(), "calls": t.calls, "ms": t.seconds * 1e3 }))
            .collect();
        let out = json!({
            "out": args.out, "engine": engine.describe(), "solve_seconds": solving,
            "seconds": start.elapsed().as_secs_f64(), "psnr_mean_db": summary.mean, "psnr_worst_db": summary.worst,
            "pupils": rows, "visits": visits * colors.len(), "pupils_solved": pupils, "region": [size.rows, size.columns],
            "planned_memory_mib": (size.bytes + held) >> 20, "peak_memory_mib": peak, "read_mib": read >> 20,
            "written_mib": written >> 20, "settings": settings, "timings": timings,
        });
        println!("{out}");
        return Ok(());
    }
    for score in &scores.pupils {
        let [x, y, d, z] = score.pupil.to_mm();
        println!("({x:6.2}, {y:6.2}) mm, {d:.2} mm wide, focused at {z:7.1} mm: {:.2} dB", score.psnr);
    }
    println!(
        "{:.2} dB mean, {:.2} dB worst of {} places; {pupils} pupils in {solving:.1} s; read {} MiB, wrote {} MiB; peak {} MiB",
        summary.mean,
        summary.worst,
        scores.pupils.len(),
        read >> 20,
        written >> 20,
        peak.unwrap_or(0)
    );
    println!("wrote {} after {:.1} s", args.out.display(), start.elapsed().as_secs_f64());
    Ok(())
}

/// What a solve in regions does not have.
fn refuse_what_is_not_here(args: &Solve) -> Result<(), Failure> {
    let given = [
        (args.method != Method::Slfh, "--method"),
        (args.levels.is_some(), "--levels"),
        (matches!(args.optimizer, Some(Optimizer::Adam { .. })), "--optimizer adam"),
        (args.storage.is_some_and(|s| s != Storage::F32), "--storage fp16"),
        (args.seconds.is_some(), "--seconds"),
        (args.psnr.is_some(), "--psnr"),
        (args.pupils.is_some(), "--pupils"),
    ];
    match given.iter().find(|g| g.0) {
        Some((_, name)) => Err(Failure::Asked(format!(
            "{name} is not for a hologram that is solved region by region: leave it out, or take a smaller display"
        ))),
        None => Ok(()),
    }
}

/// Tiles: a fraction of a pupil, and files that are neither tiny nor huge.
fn tile_side(display: &Display) -> usize {
    let pixels = display.height.max(display.width);
    (pixels / 16).next_power_of_two().clamp(32, 512)
}

fn scene(args: &SceneArgs, display: &Display, colors: &[Color], picture: usize) -> Result<Vec<Views>, Failure> {
    let default = Request::new(display, colors);
    let request = Request {
        view_pitch: args.view_pitch.map(|mm| mm * 1e-3),
        views: args.views.unwrap_or(default.views),
        depth_map: args.depth_map.as_deref(),
        depth: args.depth,
        ..default
    };
    Ok(Views::of_colors(&args.scene, &request, picture)?)
}

/// A scene as what an eye sees is compared with it.
pub fn scene_of(args: &SceneArgs, display: &Display, colors: &[Color]) -> Result<SceneSource, Failure> {
    Ok(SceneSource::Around(scene(args, display, colors, 1024.min(display.picture_size().0))?))
}

/// A hologram in the making that this job goes on with.
fn unfinished(path: &Path, work: &Value) -> Result<Option<Tiles>, Failure> {
    if !Tiles::is_tiled(path) {
        return Ok(None);
    }
    let same = Tiles::open(path)?.made().map(|made| made.job == *work);
    match same {
        None => Ok(None),
        Some(true) => Ok(Some(Tiles::resume(path)?)),
        Some(false) => Err(Failure::Asked(format!(
            "{}: another job is under way there: repeat its command to go on, or remove it",
            path.display()
        ))),
    }
}

/// The hologram without its phases; exposures are chosen here, once.
fn about(
    args: &Solve,
    display: &Display,
    colors: &[Color],
    views: &[Views],
    settings: &Settings,
    passes: usize,
    engine: &mut dyn Engine,
) -> Result<Hologram, Failure> {
    let mut solved = Vec::new();
    for (&color, views) in colors.iter().zip(views) {
        let optics = display.optics(color)?;
        let (exposure, mean) = tiled::exposure(&optics, views, settings, engine)?;
        let (wavelength, efficiency) = (optics.wavelength, mean / exposure);
        solved.push(ColorHologram { color: Some(color), wavelength, exposure, efficiency, phases: Vec::new() });
    }
    let metadata = Metadata {
        solve: Some(settings.clone()),
        padded: Some([0, 0]),
        passes: Some(passes),
        eyebox_mm: Some(display.eyebox_min() * 1e3),
        // What was said of the scene, for those who compare with it.
        view_pitch_mm: args.scene.view_pitch,
        views: args.scene.views.map(|views| [views, views]),
        depth_map_mm: args.scene.depth.filter(|_| args.scene.depth_map.is_some()).map(|d| d.map(|m| m * 1e3)),
        ..Metadata::default()
    };
    Ok(Hologram {
        seed: args.seed,
        version: env!("CARGO_PKG_VERSION").into(),
        scene: args.scene.scene.clone(),
        metadata,
        ..Hologram::on(display, settings.frames, solved)
    })
}

fn bar(color: &Color, visits: usize, done: u64, quiet: bool) -> Option<ProgressBar> {
    if quiet {
        return None;
    }
    let bar = ProgressBar::new(visits as u64).with_position(done.min(visits as u64));
    let style = ProgressStyle::with_template("{prefix:6} {bar:30} {pos}/{len} visits  {msg}  {eta} left");
    bar.set_style(style.expect("a sound template"));
    bar.set_prefix(color.to_string());
    bar.reset_eta();
    Some(bar)
}

/// Nine places: the middle, the sides and the corners, each pupil wholly inside; diameters and depths run through theirs.
fn places(display: &Display, settings: &Settings) -> Vec<Pupil> {
    let [small, large] = settings.diameter;
    let [far, near] = settings.depth;
    let one = |i: usize| {
        let diameter = small * (large / small).powf((i * 4 % 9) as f64 / 8.0);
        let reach = (display.eyebox_min() - diameter) / 2.0;
        let (x, y) = ((i % 3) as f64 - 1.0, (i / 3) as f64 - 1.0);
        Pupil { x: x * reach, y: y * reach, diameter, depth: far + (near - far) * (i * 5 % 9) as f64 / 8.0 }
    };
    (0..9).map(one).collect()
}

/// Whether a path is a hologram that is to be looked at tile by tile.
pub fn is_tiled(path: &Path) -> bool {
    common::is_hologram(path) && Tiles::is_tiled(path)
}

/// Whether a display is too large for a photograph from views at its own size.
pub fn is_too_large(display: &Display) -> bool {
    display.geometry == Geometry::FarField && is_large(display, 1)
}
