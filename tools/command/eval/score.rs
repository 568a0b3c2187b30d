//! `eyebox eval score` measures a hologram against its scene over many pupils.

use crate::Failure;
use crate::args::Score;
use crate::args::scene_of;
use crate::common;
use crate::experiment::Table;
use crate::jod::{JudgedPupils, ViewingArgs};
use crate::progress::JobBar;
use crate::talk::print_report;
use eyebox::low_level::evaluate::Summary;
use eyebox::low_level::files::CreatedDirGuard;
use eyebox::low_level::hologram::{Hologram, PhaseSource};
use eyebox::low_level::optics::{Color, Depth, Display, Pupil, dioptres, dioptres_in_words};
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::{FOVEA_DEGREES, HologramScores, JodSettings, PupilScore};
use eyebox::low_level::solve::{Diameters, PupilRange, Sampler, Sequence};
use serde_json::{Value, json};
use std::path::Path;

/// Measures a hologram over many pupils.
pub fn run(args: &Score) -> Result<(), Failure> {
    if args.experiment.printed_tables(&[("viewing", ViewingArgs::table)])? {
        return Ok(());
    }
    let viewing: ViewingArgs = args.experiment.table("viewing")?;
    check_judging(args)?;
    let (source, display) = load(args)?;
    let input = scene_of(
        &args.hologram,
        source.about(),
        args.scene.scene.as_deref(),
        &args.scene.options,
        args.phases.display.force,
    )?;
    let source = if args.ideal { source.on_ideal_display() } else { source };
    let source = match args.eye.given()? {
        Some(eye) => source.seen_by(Some(eye))?,
        None => source,
    };
    let source = source.obstructed(args.obstructions.obstructed);
    let about = source.about();
    let colors = about.named_colors();
    let mut engine = common::engine(&args.engine)?;
    let tiled = matches!(source, PhaseSource::Tiled(_));
    let (scene, depth) = input.drawn_by(engine.as_ref()).scene(tiled)?;
    let solved = about.metadata.solve.as_ref().filter(|_| tiled);
    let diameter = args.pupil_diameter.or(solved.map(|settings| settings.diameter));
    let diameter = common::diameters(diameter, &display, args.phases.display.force)?;
    let pupils = pupils(args, &display, colors.first().copied(), diameter, depth)?;
    let bar = JobBar::new(true);
    bar.show(&format!("looking through {} pupils", pupils.len()), 0.0);
    let mut scores = source.score(&scene, &pupils, engine.as_mut())?;
    let shown = Display { viewing: viewing.over(display.viewing)?, ..display.clone() };
    let judging = JodSettings {
        viewing: shown.viewing,
        pixels_per_degree: shown.pixels_per_degree(),
        most: args.seen.pupils(JUDGED),
        sub_frame_rate_hz: args.sub_frame_rate,
        gaze: args.gaze,
        maps: args.jod_maps.as_deref(),
    };
    let _made = args.jod_maps.as_deref().map(CreatedDirGuard::new).transpose()?;
    let judged = judging.places(pupils.len()).len();
    source.judge(&scene, &mut scores, &judging, engine.as_mut(), &mut |done| {
        bar.show(&format!("judging {judged} pupils"), done as f64 / judged.max(1) as f64);
    })?;
    bar.finish();
    let (psnr, against_clear) = (scores.summary(), scores.summary_of(|pupil| pupil.against_clear));
    if args.json {
        let summary = |of: Option<Summary>| {
            of.map(|s| json!({ "mean": s.mean, "median": s.median, "worst": s.worst, "best": s.best, "sd": s.sd }))
        };
        let exposures: serde_json::Map<_, _> =
            colors.iter().zip(&scores.exposures).map(|(c, e)| (c.to_string(), json!(e))).collect();
        let rows: Vec<Value> = scores.pupils.iter().map(|score| row(score, &display)).collect();
        print_report(json!({
            "psnr_db": summary(psnr), "against_clear_db": summary(against_clear), "jod": scores.summary_of(|pupil| pupil.jod), "jod_there": scores.summary_of(|pupil| pupil.jod_there), "viewing": viewing_of(&judging), "exposure": exposures,
            "pupils": rows, "unfinished": source.unfinished(),
        }));
        return Ok(());
    }
    print_text(&scores, &display, &colors, &judging);
    Ok(())
}

/// Prints the scores as a table and sentences.
fn print_text(scores: &HologramScores, display: &Display, colors: &[Color], judging: &JodSettings) {
    let (psnr, against_clear) = (scores.summary(), scores.summary_of(|pupil| pupil.against_clear));
    let judged = judging.places(scores.pupils.len()).len();
    print_table(scores, display);
    match psnr {
        Some(psnr) => println!(
            "PSNR over {}: mean {:.2}, median {:.2}, worst {:.2}, spread {:.2} dB",
            common::counted(scores.pupils.iter().filter(|score| score.psnr.is_some()).count(), "pupil"),
            psnr.mean,
            psnr.median,
            psnr.worst,
            psnr.sd
        ),
        None => {
            println!(
                "no PSNR, because the target image is black through {}",
                common::counted(scores.pupils.len(), "pupil")
            )
        }
    }
    if let Some(clear) = against_clear {
        println!(
            "PSNR against what the hologram shows a clear pupil: mean {:.2}, median {:.2}, worst {:.2} dB",
            clear.mean, clear.median, clear.worst
        );
    }
    if let Some(jod) = scores.summary_of(|pupil| pupil.jod) {
        println!(
            "JOD over {judged} of them: mean {:.2}, median {:.2}, worst {:.2}; {}",
            jod.mean,
            jod.median,
            jod.worst,
            viewing_in_words(judging)
        );
    }
    if let (Some(there), Some(gaze)) = (scores.summary_of(|pupil| pupil.jod_there), judging.gaze) {
        let [x, y] = gaze.map(f64::to_degrees);
        println!(
            "JOD of the {FOVEA_DEGREES} degrees around {x:.1},{y:.1}: mean {:.2}, median {:.2}, worst {:.2}",
            there.mean, there.median, there.worst
        );
    }
    let fitted: Vec<String> = colors.iter().zip(&scores.exposures).map(|(c, e)| format!("{c} {e:.3}")).collect();
    println!("one exposure per color for all pupils: {}; after 2 x 2 averaging", fitted.join(", "));
}

/// Refuses options of scores in JOD if no pupil is judged.
fn check_judging(args: &Score) -> Result<(), Failure> {
    if args.seen.jod == JudgedPupils::None
        && (args.sub_frame_rate.is_some() || args.gaze.is_some() || args.jod_maps.is_some())
    {
        return Err(Failure::Arguments(reason!(
            "jod-none",
            "--sub-frame-rate, --gaze and --jod-maps are for scores in JOD. Leave out --jod none"
        )));
    }
    Ok(())
}

/// Number of pupils that are judged by default.
const JUDGED: usize = 16;

/// Returns the viewing conditions of the judged pictures for the JSON report.
fn viewing_of(judging: &JodSettings) -> Value {
    json!({
        "luminance_cd_m2": judging.viewing.luminance_cd_m2, "black_cd_m2": judging.viewing.black_cd_m2,
        "pixels_per_degree": judging.pixels_per_degree, "sub_frame_rate_hz": judging.sub_frame_rate_hz,
    })
}

/// Returns the viewing conditions of the judged pictures in words.
fn viewing_in_words(judging: &JodSettings) -> String {
    let flicker = match judging.sub_frame_rate_hz {
        Some(rate) => format!("sub-frames seen at {rate} Hz"),
        None => "the mean of the sub-frames".into(),
    };
    format!(
        "{flicker}, {:.0} pixels per degree, white {} and black {} cd/m2",
        judging.pixels_per_degree, judging.viewing.luminance_cd_m2, judging.viewing.black_cd_m2
    )
}

/// Prints one line per pupil.
fn print_table(scores: &HologramScores, display: &Display) {
    println!(
        "      x       y       d   focus mm           D   PSNR dB  ceiling dB    SSIM    JOD   finest cycles/degree"
    );
    for score in &scores.pupils {
        let ([x, y, d, z], focus) = (score.pupil.to_mm(), dioptres_in_words(score.pupil.depth, display.focal_length));
        let ceiling =
            score.ceiling.map_or("-".into(), |db| if db.is_finite() { format!("{db:.2}") } else { "unlimited".into() });
        let (similarity, jod) = (similarity(score), score.jod.map_or("     -".into(), |jod| format!("{jod:6.2}")));
        println!(
            "{x:7.2} {y:7.2} {d:7.2}   {z:8.2} {focus:>11} {:>9}  {ceiling:>10}  {similarity} {jod}   {:20.0}",
            decibels(score.psnr),
            score.finest_cycles_per_degree
        );
    }
    println!("The ceiling is the highest PSNR that diffraction at the pupil allows, for any hologram");
}

/// Returns a PSNR in words: "black" for a target without light.
pub fn decibels(psnr: Option<f64>) -> String {
    psnr.map_or("black".into(), |db| format!("{db:.2}"))
}

/// Returns SSIM as an entry of the table.
pub fn similarity(score: &PupilScore) -> String {
    score.ssim.map_or("      -".into(), |s| format!("{s:7.4}"))
}

fn row(score: &PupilScore, display: &Display) -> Value {
    json!({
        "pupil_mm": score.pupil.to_mm(), "focus_dioptres": dioptres(score.pupil.depth, display.focal_length),
        "psnr_db": score.psnr, "ceiling_db": score.ceiling, "against_clear_db": score.against_clear, "ssim": score.ssim, "jod": score.jod, "jod_there": score.jod_there,
        "finest_cycles_per_degree": score.finest_cycles_per_degree,
    })
}

/// Returns the display that a hologram, read from `file`, was made for.
pub fn display_of(file: &Path, hologram: &Hologram) -> Result<Display, Failure> {
    hologram.made_for().map_err(|e| Failure::Arguments(reason!("scores", "{}: {e}", file.display())))
}

/// Loads the hologram, and the display that it was made for.
fn load(args: &Score) -> Result<(PhaseSource<'static>, Display), Failure> {
    let source = args.encoded.source(&args.phases, &args.hologram, args.which.at)?;
    let display = display_of(&args.hologram, source.about())?;
    Ok((source, display))
}

/// Returns the pupils of `random:N`, or of a JSON list of [x, y, diameter, focus] in mm. The focus may be in dioptres.
fn pupils(
    args: &Score,
    display: &Display,
    color: Option<Color>,
    diameter: [f64; 2],
    depth: [f64; 2],
) -> Result<Vec<Pupil>, Failure> {
    let text = &args.test_pupils;
    if let Some(count) = text.strip_prefix("random:") {
        let count = count.parse::<usize>().ok().filter(|n| (1..=100_000).contains(n));
        let count = count.ok_or_else(|| {
            Failure::Arguments(reason!("pupils", "--test-pupils {text}: expected random:N with N from 1 to 100000"))
        })?;
        let range = PupilRange { eyebox: display.eyebox_min(), diameter, depth, diameters: Diameters::Uniform };
        let regions = color.map_or_else(Vec::new, |color| display.regions(color));
        let mut sampler = Sampler::new(range, Sequence::Random, args.seed).over(regions);
        return Ok((0..count).map(|_| sampler.draw()).collect());
    }
    let wrong = |reason: String| {
        Failure::Arguments(reason!(
            "pupils",
            "{text}: {reason}; expected random:N or a JSON file such as [[0, 0, 4, 1.5], [2, -1, 6, \"0.01D\"]]"
        ))
    };
    let read = eyebox::low_level::files::read::text(Path::new(text), eyebox::low_level::files::read::TABLE)
        .map_err(|e| wrong(e.to_string()))?;
    let rows: Vec<(f64, f64, f64, Depth)> = serde_json::from_str(&read).map_err(|e| wrong(e.to_string()))?;
    if rows.is_empty() {
        return Err(wrong("it lists no pupil".into()));
    }
    let mut pupils = Vec::new();
    for (x, y, diameter, focus) in rows {
        let depth = focus.metres(display.focal_length);
        let pupil = Pupil { depth, ..Pupil::from_mm([x, y, diameter, 0.0]) };
        for w in &display.wavelengths {
            common::usual(args.phases.display.force, display.check_pupil(w.color, pupil).map(drop))?;
        }
        pupils.push(pupil);
    }
    Ok(pupils)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::{Cli, Command};
    use crate::eval::Eval;
    use clap::Parser;
    use eyebox::low_level::hologram::ColorHologram;
    use eyebox::low_level::optics::Color;

    /// Judged over one color's own, wider eyebox, a hologram of that color loses light that it never aimed there.
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
        for (name, display) in [("x.zarr", &[][..]), ("x.npy", &["--display", "paper"])] {
            let path = here.path().join(name);
            hologram.save(&path).unwrap();
            let words = ["eyebox", "eval", "score", path.to_str().unwrap(), "builtin:plane", "--color", "green"];
            let Command::Eval(Eval::Score(args)) = Cli::parse_from([&words, display].concat()).command else {
                panic!("not score")
            };
            let (loaded, found) = load(&args).unwrap();
            assert_eq!(loaded.about().colors.len(), 1);
            assert!((found.eyebox_min() - 22e-3).abs() < 1e-9, "{name}: {}", found.eyebox_min());
        }
    }
}
