//! `eyebox demo` solves a scene and draws what an eye sees of it in one labeled picture.

use crate::Failure;
use crate::args::Demo;
use crate::common::{self, Engines};
use crate::eval::score::decibels;
use crate::progress;
use crate::quality::Chosen;
use crate::solve::SolveProgress;
use crate::talk::print_report;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::evaluate::Plane;
use eyebox::low_level::files::{self, FileError, ManagedDir};
use eyebox::low_level::gpu::Options;
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::{Color, Display, Pupil, PupilDistribution};
use eyebox::low_level::preview::{Overlay, Picture, develop, draw_overlay};
use eyebox::low_level::produce::solve_colors;
use eyebox::low_level::quality::ColorJob;
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::{HologramScores, SceneSource};
use eyebox::low_level::scene::{self, LightField};
use eyebox::low_level::solve::{FirstPhases, Flow, Levels, RefineSettings, Settings};
use serde_json::json;
use std::time::Instant;

const SCENE: &str = "builtin:still-life";
const HOLOGRAM: &str = "still-life.zarr";
const REFINED: &str = "refined.zarr";
const PICTURE: &str = "demo.png";
/// The files that the demo writes.
const MADE: [&str; 3] = [HOLOGRAM, REFINED, PICTURE];
/// The pupil of the picture as x, y, diameter and depth, mm. It is focused on the display.
const PUPIL: [f64; 4] = [3.0, 1.0, 5.0, 0.0];
/// Steps for the whole eyebox, and for the pupil. On two cores, the demo takes less than a minute with 512 x 512
/// pixels.
const STEPS: [usize; 2] = [16, 16];
/// Smallest side of a panel, pixels.
const PANEL: usize = 512;
/// Rows of pixels below a panel for its label.
const LABEL: usize = 26;

/// Solves the still life, refines it for a pupil, and writes a picture of both next to the target image.
pub fn run(args: &Demo) -> Result<(), Failure> {
    let start = Instant::now();
    let [size, columns] = args.size;
    if size != columns || !(16..=4096).contains(&size) {
        let text = "a demo is a square with sides of 16 to 4096 pixels";
        return Err(Failure::Arguments(reason!("size", "--size {size}x{columns}: {text}")));
    }
    let mut own = ManagedDir::open(&args.out, &MADE, args.overwrite.overwrite)?;
    let mut display = Display::load("paper")?;
    (display.height, display.width) = (size, size);
    let colors: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
    let mut engine = common::engine(&args.engine)?;
    eprintln!("{SCENE} on {}, {size}x{size}, on {}", display.name, engine.describe());
    let field = scene::load(SCENE, &scene::Request::new(&display, &colors))?;
    let _made = files::CreatedDirGuard::new(&args.out)?;
    progress::catch_interrupt();
    let hologram = solve(args, &field, &display, &colors, engine.as_mut())?;
    own.claim(HOLOGRAM)?;
    hologram.save(&args.out.join(HOLOGRAM))?;
    let pupil = Pupil::from_mm(PUPIL);
    let refined = refine(args, &hologram, &field, &pupil)?;
    own.claim(REFINED)?;
    refined.save(&args.out.join(REFINED))?;

    let scene = SceneSource::new(field, &display)?;
    let [before, after] = [&hologram, &refined].map(|hologram| hologram.score(&scene, &[pupil], engine.as_mut()));
    let psnr = |scores: &HologramScores| scores.pupils[0].psnr;
    let (before, after) = (before?, after?);
    let [psnr_db, refined_psnr_db] = [psnr(&before), psnr(&after)];
    let [before, after] = [before, after].map(|scores| (decibels(psnr(&scores)), scores.exposures));
    let seen = [hologram.look(&pupil, engine.as_mut())?, refined.look(&pupil, engine.as_mut())?];
    let target = scene.photograph(&pupil, engine.as_mut())?;
    let ones = vec![1.0; colors.len()];
    let panels = [
        panel(&seen[0], &before.1, &colors, &format!("for the whole eyebox: {} dB", before.0)),
        panel(&seen[1], &after.1, &colors, &format!("refined for this pupil: {} dB", after.0)),
        panel(&target, &ones, &colors, "target image"),
    ];
    save(&mut own, &beside(&panels))?;
    let path = |name| args.out.join(name).display().to_string();
    let seconds = start.elapsed().as_secs_f64();
    if args.json {
        print_report(json!({
            "picture": path(PICTURE), "hologram": path(HOLOGRAM), "refined": path(REFINED), "pupil_mm": PUPIL,
            "psnr_db": psnr_db, "refined_psnr_db": refined_psnr_db, "seconds": seconds,
        }));
        return Ok(());
    }
    let [x, y, d, _] = PUPIL;
    println!(
        "through a pupil of {d} mm at ({x}, {y}) mm: {} dB for the whole eyebox, {} dB refined",
        before.0, after.0
    );
    let path = |name| args.out.join(name).display().to_string();
    println!("wrote {} ({}, {}) in {:.0} s", path(PICTURE), path(HOLOGRAM), path(REFINED), seconds);
    Ok(())
}

/// Solves the scene for the whole eyebox.
fn solve(
    args: &Demo,
    field: &LightField,
    display: &Display,
    colors: &[Color],
    engine: &mut dyn Engine,
) -> Result<Hologram, Failure> {
    let [far, near] = field.depth_range(display).unwrap_or([-3e-3, 3e-3]);
    let base =
        Settings { depth: [far, near], diameter: common::diameters(None, display, false)?, ..Settings::default() };
    let size = [display.height, display.width];
    let settings = match args.quality.choose(engine, size, base.frames, colors.len())? {
        Some(Chosen { settings, about }) => {
            eprintln!("{about}");
            settings
        }
        // A table of first phases takes longer to fit than this solve, and a demo solves once.
        None => Settings { steps: STEPS[0], first_phases: FirstPhases::Random, ..Settings::default() },
    };
    let levels = Levels::of(display);
    let color_job = ColorJob { field, color: colors[0], display, base, levels };
    let padding = color_job.padding(&settings)?;
    let mut watch = SolveProgress::new(args.json);
    let solved = solve_colors(&color_job, colors, &settings, engine, &mut |event| watch.see(event))?;
    Ok(Hologram::from_solutions(field, display, &color_job.settings(&settings), padding, &solved)?)
}

/// Refines the hologram for the pupil.
fn refine(args: &Demo, hologram: &Hologram, field: &LightField, pupil: &Pupil) -> Result<Hologram, Failure> {
    let engines = Engines::new(&args.engine, &Options::default())?;
    let mut refinement = hologram.clone().refine(field, RefineSettings::default(), || engines.open())?;
    let diameter = [pupil.diameter - 0.5e-3, pupil.diameter + 0.5e-3];
    let centre = [pupil.x, pupil.y];
    let aim = PupilDistribution { centre, spread: 0.25e-3, diameter, focus: [pupil.depth; 2], elsewhere: 0.0 };
    refinement.set_pupil(aim)?;
    refinement.refine(STEPS[1], &mut |_| if progress::interrupted() { Flow::Stop } else { Flow::Continue })?;
    Ok(refinement.best()?.clone())
}

/// Draws planes at their exposures with a label below.
fn panel(planes: &[Plane], exposures: &[f64], colors: &[Color], label: &str) -> Picture {
    let size = planes.first().map_or([0, 0], |plane| [plane.rows, plane.columns]);
    let zoom = PANEL.div_ceil(size[0].max(1));
    let colors: Vec<_> = colors.iter().copied().map(Some).collect();
    let mut picture = develop(planes, &colors, exposures, size, size.map(|n| n * zoom));
    picture.size[0] += LABEL;
    picture.rgb.resize(3 * picture.size[0] * picture.size[1], 0);
    draw_overlay(&mut picture, &Overlay { line: Some(label.into()), ..Overlay::default() });
    picture
}

/// Puts pictures of one height next to each other.
fn beside(panels: &[Picture]) -> Picture {
    let rows = panels.iter().map(|panel| panel.size[0]).max().unwrap_or(0);
    let columns: usize = panels.iter().map(|panel| panel.size[1]).sum();
    let mut all = Picture::black([rows, columns]);
    let mut left = 0;
    for panel in panels {
        let [high, wide] = panel.size;
        for row in 0..high {
            let to = 3 * (row * columns + left);
            all.rgb[to..to + 3 * wide].copy_from_slice(&panel.rgb[3 * row * wide..][..3 * wide]);
        }
        left += wide;
    }
    all
}

/// Writes the picture as PNG.
fn save(own: &mut ManagedDir, picture: &Picture) -> Result<(), Failure> {
    let mut png = Vec::new();
    let [rows, columns] = picture.size;
    let encoded = files::encode_png8(&mut png, rows, columns, 3, &picture.rgb);
    encoded.map_err(|e| FileError::write(&own.path().join(PICTURE), e))?;
    Ok(own.write(vec![(PICTURE.to_owned(), png)])?)
}
