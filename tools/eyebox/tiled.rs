//! Far-field holograms larger than memory: solved region by region into their file, gone on with after any end, looked at
//! through the tiles under a pupil alone.

use crate::Failure;
use crate::args::{Photograph, SceneArgs, Score, Solve, View};
use crate::common::{self, Form};
use crate::progress;
use crate::settings::base_of;
use eyebox::engine::Engine;
use eyebox::evaluate::{self, Summary};
use eyebox::hologram::{ColorHologram, Hologram, Tiles};
use eyebox::optics::{Color, Display, Geometry, Pupil, WindowFactor};
use eyebox::plan::Storage;
use eyebox::scene::Request;
use eyebox::solve::{Flow, Method, Optimizer, Settings};
use eyebox::tiled::{self, Job, MemoryLimit, RegionSize, Schedule, TiledError, Views};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::path::Path;
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
    let memory = MemoryLimit(args.memory.unwrap_or(MEMORY));
    let largest = display.eyebox_min() / 2.0;
    let diameter = args.pupil_diameter.unwrap_or([1e-3f64.min(largest / 4.0), 4e-3f64.min(largest)]);
    let optics = display.optics(colors[0])?;
    let frames = args.frames.unwrap_or(Settings::default().frames);
    let side = tile_side(display);
    let picture = args.picture.unwrap_or(1024).min(display.picture_size().0);
    let views = scene(&args.scene, display, &colors, picture)?;
    let held: u64 = views.iter().map(Views::held).sum();
    let left = MemoryLimit(memory.0.saturating_sub(held));
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
    let scores = score_tiles(&tiles, &views, &pupils_seen, engine.as_mut())?;
    let summary = Summary::of(&scores).ok_or_else(|| Failure::Asked("there is no pupil to score".into()))?;
    let peak = common::peak_memory_mib();
    if args.json {
        let rows: Vec<_> =
            pupils_seen.iter().zip(&scores).map(|(p, s)| json!({ "pupil_mm": p.to_mm(), "psnr_db": s })).collect();
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
    for (pupil, score) in pupils_seen.iter().zip(&scores) {
        let [x, y, d, z] = pupil.to_mm();
        println!("({x:6.2}, {y:6.2}) mm, {d:.2} mm wide, focused at {z:7.1} mm: {score:.2} dB");
    }
    println!(
        "{:.2} dB mean, {:.2} dB worst of {} places; {pupils} pupils in {solving:.1} s; read {} MiB, wrote {} MiB; peak {} MiB",
        summary.mean,
        summary.worst,
        scores.len(),
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
pub fn scene_of(args: &SceneArgs, display: &Display, colors: &[Color]) -> Result<Vec<Views>, Failure> {
    scene(args, display, colors, 1024.min(display.picture_size().0))
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
    let mut how = json!({
        "solve": settings, "padding": [0, 0], "passes": passes, "eyebox_mm": display.eyebox_min() * 1e3
    });
    // What was said of the scene, for those who compare with it.
    if let Some(pitch) = args.scene.view_pitch {
        how["view_pitch_mm"] = json!(pitch);
    }
    if let Some(views) = args.scene.views {
        how["views"] = json!([views, views]);
    }
    if let Some(depth) = args.scene.depth.filter(|_| args.scene.depth_map.is_some()) {
        how["depth_map_mm"] = json!(depth.map(|d| d * 1e3));
    }
    Ok(Hologram {
        seed: args.seed,
        version: env!("CARGO_PKG_VERSION").into(),
        scene: args.scene.scene.clone(),
        settings: how,
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

/// PSNR per pupil over all colours, after 2 x 2 averaging of the pupil's own samples, one exposure per colour.
pub fn score_tiles(
    tiles: &Tiles,
    views: &[Views],
    pupils: &[Pupil],
    engine: &mut dyn Engine,
) -> Result<Vec<f64>, Failure> {
    let mut errors = vec![(0.0f64, 0usize); pupils.len()];
    for (color, views) in views.iter().enumerate() {
        let mut pairs = Vec::new();
        for pupil in pupils {
            let seen = tiled::look(tiles, color, pupil, WindowFactor::One, engine)?;
            let wanted = tiled::photograph_of(tiles, color, views, pupil, WindowFactor::One, engine)?;
            let pool = |image: &[f32]| evaluate::pool2(image, seen.size, seen.size);
            pairs.push((pool(&seen.image), pool(&wanted.image)));
        }
        let exposure = evaluate::fit_exposure(pairs.iter().map(|(v, t)| (&v[..], &t[..])))?;
        for ((view, wanted), error) in pairs.iter().zip(&mut errors) {
            let apart = |(v, t): (&f32, &f32)| (exposure * f64::from(*v) - f64::from(*t)).powi(2);
            error.0 += view.iter().zip(wanted).map(apart).sum::<f64>();
            error.1 += view.len();
        }
    }
    Ok(errors.into_iter().map(|(sum, count)| -10.0 * (sum / count.max(1) as f64).log10()).collect())
}

/// Whether a path is a hologram that is to be looked at tile by tile.
pub fn is_tiled(path: &Path) -> bool {
    common::is_hologram(path) && Tiles::is_tiled(path)
}

/// `eyebox view` of a hologram in tiles: what the pupil resolves, two samples averaged to one along each axis.
pub fn view(args: &View) -> Result<(), Failure> {
    let form = common::form(&args.out, &[Form::Png, Form::Npy])?;
    let tiles = Tiles::open(&args.hologram)?;
    let mut engine = common::engine(&args.engine)?;
    let (mut planes, mut size) = (Vec::new(), 0);
    for i in 0..tiles.about().colors.len() {
        args.pupil.check_within(&tiles.about().optics(i)?)?;
        let seen = tiled::look(&tiles, i, &args.pupil, WindowFactor::Two, engine.as_mut())?;
        planes.push(evaluate::pool2(&seen.image, seen.size, seen.size));
        size = (seen.size / 2).max(1);
    }
    let about = tiles.about();
    let exposures: Vec<f64> = about.colors.iter().map(|c| args.optics.exposure.unwrap_or(c.exposure)).collect();
    let colors: Vec<_> = about.colors.iter().map(|c| c.color).collect();
    common::write_image(&args.out, form, [size, size], &planes, &colors, &exposures)?;
    let [x, y, d, z] = args.pupil.to_mm();
    let read = tiles.moved()[0] >> 20;
    eprintln!(
        "wrote {}: the view from ({x}, {y}) mm through {d} mm, focused at {z} mm; read {read} MiB, peak {} MiB",
        args.out.display(),
        common::peak_memory_mib().unwrap_or(0)
    );
    Ok(())
}

/// Whether a display is too large for a photograph from views at its own size.
pub fn is_too_large(display: &Display) -> bool {
    display.geometry == Geometry::FarField && is_large(display, 1)
}

/// `eyebox photograph` for a large far-field display: views from around the pupil, at 1024 pixels or what the pupil
/// resolves.
pub fn photograph(args: &Photograph, display: &Display) -> Result<(), Failure> {
    let form = common::form(&args.out, &[Form::Png, Form::Npy])?;
    let colors = common::colors(&args.display, display)?;
    let mut engine = common::engine(&args.engine)?;
    let (mut planes, mut size) = (Vec::new(), 0);
    for (&color, views) in colors.iter().zip(&scene(&args.scene, display, &colors, 1024)?) {
        let optics = display.optics(color)?;
        args.pupil.check_within(&optics)?;
        let seen = tiled::photograph_at(&optics, views, &args.pupil, WindowFactor::One, engine.as_mut())?;
        size = seen.size;
        planes.push(seen.image);
    }
    let names: Vec<_> = colors.iter().map(|c| Some(*c)).collect();
    common::write_image(&args.out, form, [size, size], &planes, &names, &vec![1.0; planes.len()])?;
    let [x, y, d, z] = args.pupil.to_mm();
    eprintln!("wrote {}: the photograph from ({x}, {y}) mm through {d} mm, focused at {z} mm", args.out.display());
    Ok(())
}

/// `eyebox score` of a hologram in tiles.
pub fn score(args: &Score) -> Result<(), Failure> {
    let tiles = Tiles::open(&args.hologram)?;
    let display = crate::score::display_of(&args.hologram, tiles.about())?;
    let colors: Vec<Color> = tiles.about().colors.iter().filter_map(|c| c.color).collect();
    let scene_args = crate::score::as_solved(&args.scene, tiles.about());
    let views = scene_of(&scene_args, &display, &colors)?;
    let solved: [f64; 2] = serde_json::from_value(tiles.about().settings["solve"]["diameter"].clone())
        .unwrap_or_else(|_| common::diameters(None, &display));
    let depth = scene_args.depth.or(views[0].depth()).unwrap_or([0.0, 0.0]);
    let diameter = args.pupil_diameter.unwrap_or(solved);
    let pupils = crate::score::pupils(&args.pupils, args.seed, &display, diameter, depth)?;
    let mut engine = common::engine(&args.engine)?;
    let scores = score_tiles(&tiles, &views, &pupils, engine.as_mut())?;
    let rows: Vec<_> = (pupils.iter().zip(&scores))
        .map(|(p, &psnr_db)| crate::score::Row { pupil_mm: p.to_mm(), psnr_db, ssim: None })
        .collect();
    let psnr = Summary::of(&scores).ok_or_else(|| Failure::Asked("there is no pupil to score".into()))?;
    if args.json {
        let summary =
            json!({ "mean": psnr.mean, "median": psnr.median, "worst": psnr.worst, "best": psnr.best, "sd": psnr.sd });
        println!("{}", json!({ "psnr_db": summary, "pupils": rows }));
        return Ok(());
    }
    crate::score::print_table(&rows);
    let (mean, worst) = (psnr.mean, psnr.worst);
    println!("PSNR over {} pupils: mean {mean:.2}, worst {worst:.2} dB; after 2 x 2 averaging", rows.len());
    Ok(())
}
