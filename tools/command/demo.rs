//! `eyebox demo`: the whole way, from a scene to what an eye sees.

use crate::Failure;
use crate::args::Demo;
use crate::common;
use crate::eval::{compare, score};
use crate::progress;
use crate::solve::SolveProgress;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::files::{self, FileError, ManagedDir};
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::{Color, Display, Pupil, dioptres_in_words};
use eyebox::low_level::produce::solve_colors;
use eyebox::low_level::quality::ColorJob;
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::SceneSource;
use eyebox::low_level::scene;
use eyebox::low_level::solve::{Levels, Method, Settings};
use eyebox_lab::comparison::{Comparison, JUDGED, candidates};
use eyebox_lab::report;
use std::path::PathBuf;
use std::time::Instant;

const SCENE: &str = "builtin:still-life";
const HOLOGRAM: &str = "still-life.zarr";
/// What is written beside the report.
const MADE: [&str; 7] = [HOLOGRAM, "left.png", "right.png", "near.png", "far.png", "small.png", "all.png"];

/// Builds the still life, solves it, shows and measures it.
pub fn run(args: &Demo) -> Result<(), Failure> {
    let start = Instant::now();
    if !(16..=4096).contains(&args.size) {
        return Err(Failure::Arguments(reason!("size", "--size {}: a demo has 16 to 4096 pixels a side", args.size)));
    }
    let mut own = ManagedDir::open(&args.out, &MADE, args.overwrite.overwrite)?;
    let mut compared = ManagedDir::open(&args.out.join("report"), &report::COMPARISON, args.overwrite.overwrite)?;
    let mut display = Display::load("paper")?;
    (display.height, display.width) = (args.size, args.size);
    let colors: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
    let mut engine = common::engine(&args.engine)?;
    eprintln!("engine: {}", engine.describe());
    eprintln!("rendering {SCENE}: 9 x 9 views of {0}x{0} pixels", args.size);
    let field = scene::load(SCENE, &scene::Request::new(&display, &colors))?;
    let [far, near] = field.depth_range(&display).unwrap_or([-3e-3, 3e-3]);
    let base =
        Settings { depth: [far, near], diameter: common::diameters(None, &display, false)?, ..Settings::default() };
    let settings = match args.quality.choose(engine.as_ref(), [args.size; 2], base.frames, colors.len())? {
        Some(chosen) => {
            eprintln!("{}", chosen.about);
            chosen.settings
        }
        None => Settings { steps: 120, ..Settings::default() },
    };
    let levels = Levels::of(&display);
    let color_job = ColorJob { field: &field, color: colors[0], display: &display, base, levels };
    let padding = color_job.padding(&settings)?;
    let _made = files::CreatedDirGuard::new(&args.out)?;
    progress::catch_interrupt();
    let mut watch = SolveProgress::new(false);
    let solved = solve_colors(&color_job, &colors, &settings, engine.as_mut(), &mut |event| watch.see(event))?;
    let hologram = Hologram::from_solutions(&field, &display, &color_job.settings(&settings), padding, &solved)?;
    let saved = args.out.join(HOLOGRAM);
    own.claim(HOLOGRAM)?;
    hologram.save(&saved)?;

    let at = |x: f64, y: f64, diameter: f64, depth: f64| Pupil {
        x: x * 1e-3,
        y: y * 1e-3,
        diameter: diameter * 1e-3,
        depth,
    };
    let pupils = [
        ("left", at(-7.0, 0.0, 6.0, 0.0)),
        ("right", at(7.0, 0.0, 6.0, 0.0)),
        ("near", at(0.0, 0.0, 14.0, near)),
        ("far", at(0.0, 0.0, 14.0, far)),
        ("small", at(2.0, 3.0, 3.0, 0.0)),
    ];
    let all = pupils.map(|p| p.1);
    let scene = SceneSource::new(field.clone(), &display)?;
    let scores = hologram.score(&scene, &all, engine.as_mut())?;
    // Each picture: what the eye sees of the hologram, and beside it the photograph of the light field.
    let (n, gap) = (args.size, args.size.div_ceil(64));
    let wide = 2 * n + gap;
    let mut sheet = vec![Vec::new(); 3];
    for (name, pupil) in &pupils {
        let mut planes = vec![vec![1.0f32; n * wide]; 3];
        let seen = hologram.look(pupil, engine.as_mut())?;
        let wanted = scene.photograph(pupil, engine.as_mut())?;
        for (i, color) in colors.iter().enumerate() {
            let exposure = scores.exposures[i] as f32;
            for (y, row) in planes[color.channel()].chunks_exact_mut(wide).enumerate() {
                row[..n].iter_mut().zip(&seen[i].values[y * n..]).for_each(|(to, v)| *to = v * exposure);
                row[n + gap..].copy_from_slice(&wanted[i].values[y * n..][..n]);
            }
        }
        save(&mut own, name, [n, wide], &planes)?;
        for (sheet, plane) in sheet.iter_mut().zip(planes) {
            if !sheet.is_empty() {
                sheet.extend(std::iter::repeat_n(1.0, gap * wide));
            }
            sheet.extend(plane);
        }
    }
    save(&mut own, "all", [sheet[0].len() / wide, wide], &sheet)?;

    println!("\n  what the eye sees of the hologram, against the photograph of the scene:");
    println!("  pupil        x      y      d  focus mm        D   PSNR dB    SSIM   picture");
    for ((name, pupil), score) in pupils.iter().zip(&scores.pupils) {
        let [x, y, d, z] = pupil.to_mm();
        let (ssim, focus) = (score::similarity(score), dioptres_in_words(pupil.depth, display.focal_length));
        println!(
            "  {name:6} {x:7.1} {y:6.1} {d:6.1} {z:7.2} {focus:>10} {:>9}  {ssim}   {}",
            score::decibels(score.psnr),
            args.out.join(format!("{name}.png")).display()
        );
    }
    let report = comparison(args, &display, &colors, engine.as_mut(), &mut compared)?;
    println!(
        "\n  hologram: {}   all pictures: {}   {:.1} s in all",
        saved.display(),
        args.out.join("all.png").display(),
        start.elapsed().as_secs_f64()
    );
    if let Some(page) = report {
        println!("  two methods compared, in pictures and numbers: {}", page.display());
    }
    Ok(())
}

/// Writes a picture of red, green and blue planes.
fn save(own: &mut ManagedDir, name: &str, [rows, columns]: [usize; 2], planes: &[Vec<f32>]) -> Result<(), Failure> {
    let (mut png, name) = (Vec::new(), format!("{name}.png"));
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let encoded = files::encode_png(&mut png, rows, columns, &planes);
    encoded.map_err(|e| FileError::write(&own.path().join(&name), e))?;
    Ok(own.write(vec![(name, png)])?)
}

/// Pixels a side of the comparison, at most: small enough for a few seconds.
const COMPARED: usize = 128;

/// A small evaluation of the same scene; where its page is, if there was time for it.
fn comparison(
    args: &Demo,
    display: &Display,
    colors: &[Color],
    engine: &mut dyn Engine,
    own: &mut ManagedDir,
) -> Result<Option<PathBuf>, Failure> {
    let side = args.size.min(COMPARED);
    let display = Display { height: side, width: side, ..display.clone() };
    let folder = own.path().to_path_buf();
    let settings = Settings { diameter: common::diameters(None, &display, false)?, ..Settings::default() };
    let mut load = |_| -> Result<_, Failure> {
        let field = scene::load(SCENE, &scene::Request::new(&display, colors))?;
        let depth = field.depth_range(&display).unwrap_or(settings.depth);
        Ok((field, [depth[0].min(depth[1]), depth[0].max(depth[1])]))
    };
    let job = Comparison {
        scenes: vec!["still-life".into()],
        candidates: candidates(&[Method::Slfh, Method::Lf2fs], Vec::new())?,
        frames: vec![8],
        display: display.clone(),
        colors: colors.to_vec(),
        settings: settings.clone(),
        speckle: false,
        joint: Vec::new(),
        coherence: Vec::new(),
        masks: Vec::new(),
        sources: false,
        judged: JUDGED,
    };
    let results = compare::compare(&job, &folder, &mut load, engine, false)?;
    if results.runs.is_empty() {
        return Ok(None);
    }
    report::write_comparison(&results, own)?;
    Ok(Some(folder.join("report.html")))
}
