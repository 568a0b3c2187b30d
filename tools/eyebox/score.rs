//! `eyebox score`.

use crate::Failure;
use crate::args::Score;
use crate::common;
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
    let (hologram, display) = load(args)?;
    let colors: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
    let mut engine = common::engine(&args.engine)?;
    let field = common::scene(&args.scene, &display, &colors)?;
    let depth = common::depths(&args.scene, &field, &display);
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
    let (height, width) = (display.height, display.width);
    let mut exposures = Vec::new();
    let mut images: Vec<Vec<(Vec<f32>, Vec<f32>)>> = vec![Vec::new(); pupils.len()];
    for (i, wavelength) in display.wavelengths.iter().enumerate() {
        let problem = Problem::new(field, wavelength.color, display, Padding::default())?;
        let planner = problem.planner(hologram.frames, WindowFactor::Full);
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
        let targets = evaluate::photographs(engine, &planner, pupils)?;
        // Looked at as it was solved: with its padding, without the views.
        let padded = planner.with_padding(view::padding_of(hologram));
        engine.load(&padded.shape(Purpose::View), None)?;
        engine.write(eyebox::engine::Buffer::Phases, &hologram.colors[i].phases)?;
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

/// The hologram, and the display that its own optics make (or, for bare phases, that the flags say).
fn load(args: &Score) -> Result<(Hologram, Display), Failure> {
    if common::is_hologram(&args.hologram) {
        let hologram = Hologram::load(&args.hologram)?;
        let base = common::display(&args.display)?;
        let wavelengths: Option<Vec<_>> = hologram
            .colors
            .iter()
            .map(|c| c.color.map(|color| Wavelength { color, wavelength: c.wavelength }))
            .collect();
        let wavelengths = wavelengths.ok_or_else(|| {
            Failure::Asked(format!("{}: its colours have no names to find in the scene", args.hologram.display()))
        })?;
        // The eyebox that pupils are drawn in is that of the display it was made for.
        let (height, width, pitch, focal_length) =
            (hologram.height, hologram.width, hologram.pitch, hologram.focal_length);
        let display = Display {
            name: hologram.display.clone(),
            height,
            width,
            pitch,
            focal_length,
            wavelengths,
            levels: base.levels,
        };
        return Ok((hologram, display));
    }
    let phases = hologram::load_phases(&args.hologram)?;
    let mut display = common::display(&args.display)?;
    let colors = common::colors(&args.display, &display)?;
    display.wavelengths.retain(|w| colors.contains(&w.color));
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
    let colors = phases.colors.into_iter().zip(&display.wavelengths).map(color).collect();
    let (pitch, focal_length) = (display.pitch, display.focal_length);
    let hologram = Hologram {
        frames: phases.frames,
        height: phases.height,
        width: phases.width,
        pitch,
        focal_length,
        colors,
        seed: 0,
        version: String::new(),
        display: display.name.clone(),
        scene: String::new(),
        settings: serde_json::Value::Null,
    };
    hologram.check()?;
    Ok((hologram, display))
}

/// `random:N`, or a JSON list of [x, y, diameter, focus] in mm.
fn pupils(
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
