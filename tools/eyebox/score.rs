//! `eyebox score`.

use crate::Failure;
use crate::args::{SceneArgs, Score};
use crate::common;
use crate::tiled;
use crate::view;
use eyebox::engine::Engine;
use eyebox::evaluate::{self, Summary};
use eyebox::hologram::{self, ColorHologram, Hologram};
use eyebox::optics::{Color, Display, Padding, Pupil, Wavelength, WindowFactor};
use eyebox::plan::Purpose;
use eyebox::scene::LightField;
use eyebox::solve::{Diameters, Problem, PupilRange, Sampler, Sequence};
use serde::Serialize;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

/// What one pupil scored.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// x, y, diameter, focus, mm.
    pub pupil_mm: [f64; 4],
    /// PSNR over all colours, dB.
    pub psnr_db: f64,
    /// Mean SSIM over colours; none where the picture is smaller than SSIM's window.
    pub ssim: Option<f64>,
}

/// Scores, and the images that they were computed from.
pub struct Scores {
    /// One per pupil.
    pub rows: Vec<Row>,
    /// The exposure per colour that was fitted over all pupils.
    pub exposures: Vec<f64>,
    /// Per pupil, per colour: the view (with exposure) and the photograph.
    pub images: Vec<Vec<(Vec<f32>, Vec<f32>)>>,
}

/// Measures a hologram over many pupils.
pub fn run(args: &Score) -> Result<(), Failure> {
    if tiled::is_tiled(&args.hologram) {
        return tiled::score(args);
    }
    let (hologram, display) = load(args)?;
    let colors: Vec<Color> = hologram.colors.iter().filter_map(|c| c.color).collect();
    let mut engine = common::engine(&args.engine)?;
    let scene = as_solved(&args.scene, &hologram);
    let field = common::scene(&scene, &display, &colors)?;
    let depth = common::depths(&scene, &field, &display);
    let diameter = common::diameters(args.pupil_diameter, &display);
    let pupils = pupils(&args.pupils, args.seed, &display, diameter, depth)?;
    let scores = score(&hologram, &field, &display, &pupils, engine.as_mut())?;
    let psnr = Summary::of(&scores.rows.iter().map(|r| r.psnr_db).collect::<Vec<_>>())
        .ok_or_else(|| Failure::Asked("there is no pupil to score".into()))?;
    if args.json {
        let summary =
            json!({ "mean": psnr.mean, "median": psnr.median, "worst": psnr.worst, "best": psnr.best, "sd": psnr.sd });
        let exposures: serde_json::Map<_, _> =
            colors.iter().zip(&scores.exposures).map(|(c, e)| (c.to_string(), json!(e))).collect();
        println!("{}", json!({ "psnr_db": summary, "exposure": exposures, "pupils": scores.rows }));
        return Ok(());
    }
    print_table(&scores.rows);
    println!(
        "PSNR over {} pupils: mean {:.2}, median {:.2}, worst {:.2}, spread {:.2} dB",
        scores.rows.len(),
        psnr.mean,
        psnr.median,
        psnr.worst,
        psnr.sd
    );
    let fitted: Vec<String> = colors.iter().zip(&scores.exposures).map(|(c, e)| format!("{c} {e:.3}")).collect();
    println!("one exposure per colour for all pupils: {}; after 2 x 2 averaging", fitted.join(", "));
    Ok(())
}

/// One line per pupil.
pub fn print_table(rows: &[Row]) {
    println!("      x       y       d   focus mm     PSNR dB    SSIM");
    for row in rows {
        let [x, y, d, z] = row.pupil_mm;
        let ssim = row.ssim.map_or("      -".into(), |s| format!("{s:7.4}"));
        println!("{x:7.2} {y:7.2} {d:7.2} {z:7.2}    {:9.2}  {ssim}", row.psnr_db);
    }
}

/// Views and photographs through every pupil, compared after 2 x 2 averaging with one exposure per colour.
pub fn score(
    hologram: &Hologram,
    field: &LightField,
    display: &Display,
    pupils: &[Pupil],
    engine: &mut dyn Engine,
) -> Result<Scores, Failure> {
    let (height, width) = display.picture_size();
    let mut exposures = Vec::new();
    let mut images: Vec<Vec<(Vec<f32>, Vec<f32>)>> = vec![Vec::new(); pupils.len()];
    // The display may have more colours than the hologram.
    for solved in &hologram.colors {
        let Some(color) = solved.color else { continue };
        let problem = Problem::new(field, color, display, Padding::default())?;
        let planner = problem.planner(hologram.frames, WindowFactor::Full);
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
        let targets = evaluate::photographs(engine, &planner, pupils)?;
        // Looked at as it was solved: with its padding, without the views.
        let padded = planner.with_padding(view::padding_of(hologram));
        engine.load(&padded.shape(Purpose::View), None)?;
        engine.write(eyebox::engine::Buffer::Phases, &solved.phases)?;
        let mut seen = evaluate::views(engine, &padded, pupils)?;
        let pool = |image: &[f32]| evaluate::pool2(image, height, width);
        let pooled: Vec<_> = seen.iter().zip(&targets).map(|(v, t)| (pool(v), pool(t))).collect();
        let exposure = evaluate::fit_exposure(pooled.iter().map(|(v, t)| (&v[..], &t[..])))?;
        exposures.push(exposure);
        for ((view, target), images) in seen.drain(..).zip(targets).zip(&mut images) {
            images.push((view.iter().map(|v| v * exposure as f32).collect(), target));
        }
    }
    let rows = pupils.iter().zip(&images).map(|(p, images)| row(p, images, height, width)).collect();
    Ok(Scores { rows, exposures, images })
}

fn row(pupil: &Pupil, images: &[(Vec<f32>, Vec<f32>)], height: usize, width: usize) -> Row {
    let pooled: Vec<_> =
        images.iter().map(|(v, t)| (evaluate::pool2(v, height, width), evaluate::pool2(t, height, width))).collect();
    let (h, w) = if height < 2 || width < 2 { (height, width) } else { (height / 2, width / 2) };
    let ssim: Option<Vec<f64>> = pooled.iter().map(|(v, t)| evaluate::ssim(v, t, h, w).ok()).collect();
    // All colours in one number, every pixel counting the same.
    let (seen, wanted): (Vec<_>, Vec<_>) = pooled.into_iter().unzip();
    Row {
        pupil_mm: pupil.to_mm(),
        psnr_db: evaluate::psnr(&seen.concat(), &wanted.concat()).unwrap_or(f64::NAN),
        ssim: ssim.map(|s| s.iter().sum::<f64>() / s.len() as f64),
    }
}

/// What was said of the scene when it was solved holds, where nothing else is said now.
pub fn as_solved(args: &SceneArgs, hologram: &Hologram) -> SceneArgs {
    let mut args = args.clone();
    let settings = &hologram.settings;
    args.view_pitch = args.view_pitch.or_else(|| settings["view_pitch_mm"].as_f64());
    args.views = args.views.or_else(|| usize::try_from(settings["views"][0].as_u64()?).ok());
    // What a depth map's values mean has an order; other scenes have a range, in metres.
    let (depth, unit) = match args.depth_map {
        Some(_) => (&settings["depth_map_mm"], 1e-3),
        None => (&settings["solve"]["depth"], 1.0),
    };
    args.depth = args.depth.or_else(|| Some([depth[0].as_f64()? * unit, depth[1].as_f64()? * unit]));
    args
}

/// A hologram, and the display that it was made for.
pub fn with_display(file: &Path) -> Result<(Hologram, Display), Failure> {
    let hologram = Hologram::load(file)?;
    let display = display_of(file, &hologram)?;
    Ok((hologram, display))
}

/// The display that a hologram, read from `file`, was made for.
pub fn display_of(file: &Path, hologram: &Hologram) -> Result<Display, Failure> {
    let known = |color: Color| hologram.display_wavelengths.iter().any(|w| w.color == color);
    if !hologram.colors.iter().all(|c| c.color.is_some_and(known)) {
        let what = file.display();
        return Err(Failure::Asked(format!("{what}: its colours are not named, or not those of its display")));
    }
    // The eyebox that pupils are drawn in is that of the display it was made for.
    Ok(Display {
        name: hologram.display.clone(),
        height: hologram.height,
        width: hologram.width,
        pitch: hologram.pitch,
        focal_length: hologram.focal_length,
        geometry: hologram.geometry,
        wavelengths: hologram.display_wavelengths.clone(),
        levels: 256,
        encoding: Default::default(),
    })
}

/// The hologram, and the display that its own optics make (or, for bare phases, that the flags say).
fn load(args: &Score) -> Result<(Hologram, Display), Failure> {
    if common::is_hologram(&args.hologram) {
        return with_display(&args.hologram);
    }
    let phases = hologram::load_phases(&args.hologram)?;
    let mut display = common::display(&args.display)?;
    let colors = common::colors(&args.display, &display)?;
    (display.height, display.width) = (phases.height, phases.width);
    if phases.colors.len() != colors.len() {
        let (has, given) = (phases.colors.len(), colors.len());
        return Err(Failure::Asked(format!(
            "{}: it has {has} colours, the display has {given}: choose with --color",
            args.hologram.display()
        )));
    }
    let color = |((_, phases), w): ((_, Vec<f32>), &Wavelength)| ColorHologram {
        color: Some(w.color),
        wavelength: w.wavelength,
        exposure: 1.0,
        efficiency: 1.0,
        phases,
    };
    let colors = phases
        .colors
        .into_iter()
        .zip(display.wavelengths.iter().filter(|w| colors.contains(&w.color)))
        .map(color)
        .collect();
    let hologram = Hologram::on(&display, phases.frames, colors);
    hologram.check()?;
    Ok((hologram, display))
}

/// `random:N`, or a JSON list of [x, y, diameter, focus] in mm.
pub fn pupils(
    text: &str,
    seed: u64,
    display: &Display,
    diameter: [f64; 2],
    depth: [f64; 2],
) -> Result<Vec<Pupil>, Failure> {
    if let Some(count) = text.strip_prefix("random:") {
        let count = count.parse::<usize>().ok().filter(|n| (1..=100_000).contains(n));
        let count = count
            .ok_or_else(|| Failure::Asked(format!("--pupils {text}: expected random:N with N from 1 to 100000")))?;
        let range = PupilRange { eyebox: display.eyebox_min(), diameter, depth, diameters: Diameters::Uniform };
        let mut sampler = Sampler::new(range, Sequence::Random, seed);
        return Ok((0..count).map(|_| sampler.draw()).collect());
    }
    let wrong = |reason: String| {
        Failure::Asked(format!(
            "{text}: {reason}; expected random:N or a JSON file such as [[0, 0, 4, 1.5], [2, -1, 6, 0]]"
        ))
    };
    let read = std::fs::read_to_string(Path::new(text)).map_err(|e| wrong(e.to_string()))?;
    let rows: Vec<[f64; 4]> = serde_json::from_str(&read).map_err(|e| wrong(e.to_string()))?;
    if rows.is_empty() {
        return Err(wrong("it lists no pupil".into()));
    }
    let mut pupils = Vec::new();
    for row in rows {
        let pupil = Pupil::from_mm(row);
        for w in &display.wavelengths {
            pupil.check_within(&display.optics(w.color)?)?;
        }
        pupils.push(pupil);
    }
    Ok(pupils)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::{Cli, Command};
    use clap::Parser;

    /// Judged over one colour's own, wider eyebox, a hologram of that colour loses light that it never aimed there.
    #[test]
    fn one_colour_is_scored_in_the_eyebox_that_its_display_serves() {
        let here = tempfile::tempdir().unwrap();
        let display = Display::preset("paper").unwrap();
        let color = ColorHologram {
            color: Some(Color::Green),
            wavelength: 520e-9,
            exposure: 0.35,
            efficiency: 0.4,
            phases: vec![0.5; 6],
        };
        let hologram = Hologram { height: 2, width: 3, ..Hologram::on(&display, 1, vec![color]) };
        for name in ["x.zarr", "x.npy"] {
            let path = here.path().join(name);
            hologram.save(&path).unwrap();
            let words = ["eyebox", "score", path.to_str().unwrap(), "builtin:plane", "--color", "green"];
            let Command::Score(args) = Cli::parse_from(words).command else { panic!("not score") };
            let (loaded, found) = load(&args).unwrap();
            assert_eq!(loaded.colors.len(), 1);
            assert!((found.eyebox_min() - 22e-3).abs() < 1e-9, "{name}: {}", found.eyebox_min());
        }
    }
}
