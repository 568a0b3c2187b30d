//! `eyebox solve` over several scenes: a sequence of holograms, each from the one before.

use crate::Failure;
use crate::args::{Solve, Start};
use crate::common::{self, Form};
use crate::progress::{self, Bar};
use crate::settings::{plan_of, settings_of};
use crate::solve;
use eyebox::hologram::{ColorHologram, Hologram, Sequence, SequenceWriter};
use eyebox::optics::{Color, Display};
use eyebox::scene;
use eyebox::solve::{Levels, Problem, Settings, Solution, Stop, Warm, solve_from};
use serde_json::json;
use std::fs;
use std::path::Path;
use std::time::Instant;

/// The scenes of a sequence; none where a single scene is meant.
pub fn scenes(args: &Solve) -> Option<Vec<String>> {
    let first = &args.scene.scene;
    if !args.more.is_empty() {
        return Some([std::slice::from_ref(first), &args.more].concat());
    }
    folders(Path::new(first))
}

/// The folders in a folder that has no pictures of its own, in the order of the numbers in their names.
fn folders(folder: &Path) -> Option<Vec<String>> {
    let entries: Vec<_> = fs::read_dir(folder).ok()?.flatten().collect();
    if scene::native_size(folder.to_str()?).is_ok() {
        return None;
    }
    let mut found: Vec<String> = (entries.iter())
        .filter(|e| e.path().is_dir() && !e.file_name().to_string_lossy().starts_with('.'))
        .filter_map(|e| e.path().to_str().map(str::to_owned))
        .collect();
    found.sort_by_cached_key(|name| natural(name));
    (!found.is_empty()).then_some(found)
}

/// A name as pieces of text and numbers: frame-9 comes before frame-10.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut pieces = vec![(String::new(), 0u64)];
    let mut in_number = false;
    for c in name.chars() {
        match (c.to_digit(10), pieces.last_mut()) {
            (Some(digit), Some(last)) => {
                last.1 = last.1.saturating_mul(10).saturating_add(u64::from(digit));
                in_number = true;
            }
            (None, Some(last)) if !in_number => last.0.push(c),
            _ => {
                pieces.push((c.to_string(), 0));
                in_number = false;
            }
        }
    }
    pieces
}

/// What a frame came to.
struct Solved {
    frame: usize,
    colors: Vec<(Color, Solution)>,
}

/// Solves one scene after the other into a sequence; goes on where an earlier run of the same command stopped.
pub fn run(args: &Solve, scenes: &[String]) -> Result<(), Failure> {
    let start = Instant::now();
    common::form(&args.out, &[Form::Zarr])?;
    let display = common::display(&args.display)?;
    let colors = common::colors(&args.display, &display)?;
    let mut engine = common::engine(&args.engine)?;
    let planned = Some(scenes.len() as u64);
    let rate = args.rate.fraction();
    let mut field = load(args, &scenes[0], &display, &colors)?;
    // What all frames have in common is decided by the first: it says what the file says.
    let depth = common::depths(&args.scene, &field, &display);
    let (settings, chosen) = settings_of(args, engine.as_ref(), &display, depth, colors.len())?;
    // Of a quality a sequence takes what a solve itself is told: each frame is all views and all pixels.
    let settings = Settings { repeats: 1, views: 1, pixel: 1, ..settings };
    let plan = plan_of(args, &settings, &field, &display)?;
    let (mut settings, padding) = (plan.settings, plan.padding);
    settings.seconds = args.seconds.map(|s| s / colors.len() as f64);
    if settings.levels == Levels::Display {
        settings.levels = Levels::of(&display);
    }
    let mut like = solve::hologram(&field, &display, &settings, padding, &[]);
    like.colors = colors.iter().map(|c| empty(*c, &display)).collect();
    like.scene = scenes.join(", ");
    like.settings["warm_start"] = match args.warm_start {
        Start::Cold => json!("cold"),
        Start::Warm(progress) => json!(progress),
    };
    let mut writer = match fs::metadata(&args.out).is_ok() {
        false => None,
        true => match SequenceWriter::resume(&args.out, &like, rate, planned)? {
            Some(writer) => Some(writer),
            None => {
                println!("{} is complete: {} holograms", args.out.display(), scenes.len());
                return Ok(());
            }
        },
    };
    let done = writer.as_ref().map_or(0, |w| w.count() as usize);
    if !args.json {
        let going_on = if done > 0 { format!(", going on after {done}") } else { String::new() };
        eprintln!("a sequence of {} holograms, {}x{}{going_on}", scenes.len(), display.height, display.width);
        eprintln!("engine: {}", engine.describe());
        chosen.iter().for_each(|about| eprintln!("{about}"));
    }
    let mut before: Option<Hologram> = match done {
        0 => None,
        _ => Some(Sequence::open(&args.out)?.load(done as u64 - 1)?),
    };
    progress::catch_interrupt();
    let mut report = Vec::new();
    for (frame, name) in scenes.iter().enumerate().skip(done) {
        if frame > 0 {
            field = load(args, name, &display, &colors)?;
        }
        let depth = common::depths(&args.scene, &field, &display);
        let mut solved = Solved { frame, colors: Vec::new() };
        for (index, &color) in colors.iter().enumerate() {
            let problem = Problem::new(&field, color, &display, padding)?;
            let of_before = before.as_ref().map(|b| &b.colors[index]);
            let settings = Settings {
                depth,
                // One exposure for all frames, that of the first: lasers do not change from frame to frame.
                efficiency: of_before
                    .map(|b| (problem.mean / b.exposure).min(1.0))
                    .filter(|e| *e > 0.0)
                    .or(settings.efficiency),
                ..settings.clone()
            };
            let warm = match (args.warm_start, of_before) {
                (Start::Warm(progress), Some(b)) => Some(Warm { phases: &b.phases, progress }),
                _ => None,
            };
            let bar = Bar::new(format!("{}/{} {color}", frame + 1, scenes.len()), settings.steps, args.json);
            let solution = solve_from(&problem, &settings, warm, engine.as_mut(), &mut |p| bar.show(p))?;
            bar.finish(format!("{:.1} dB", solution.validation.mean()));
            if progress::interrupted() {
                let out = args.out.display();
                let n = scenes.len();
                return Err(Failure::Asked(format!(
                    "interrupted: {out} has {frame} of {n} holograms; the same command goes on with the next"
                )));
            }
            if solution.stop == Stop::Asked {
                return Err(Failure::Asked("interrupted".into()));
            }
            solved.colors.push((color, solution));
        }
        let mut hologram = solve::hologram(&field, &display, &settings, padding, &solved.colors);
        if let Some(before) = &before {
            for (c, b) in hologram.colors.iter_mut().zip(&before.colors) {
                (c.exposure, c.efficiency) = (b.exposure, b.efficiency);
            }
        }
        let to = match &mut writer {
            Some(writer) => writer,
            None => {
                for (l, c) in like.colors.iter_mut().zip(&hologram.colors) {
                    *l = c.clone();
                }
                writer.insert(SequenceWriter::create(&args.out, &like, rate, planned)?)
            }
        };
        to.append(&hologram)?;
        report.push(said(&solved, name));
        if !args.json {
            let mean: Vec<String> =
                solved.colors.iter().map(|(c, s)| format!("{c} {:.2} dB", s.validation.mean())).collect();
            println!("{:4} {name}: {}", solved.frame, mean.join(", "));
        }
        before = Some(hologram);
    }
    if let Some(writer) = writer {
        writer.finish()?;
    }
    let seconds = start.elapsed().as_secs_f64();
    if args.json {
        let out = json!({ "out": args.out, "engine": engine.describe(), "seconds": seconds, "frames": report });
        println!("{out}");
        return Ok(());
    }
    println!("wrote {}: {} holograms after {seconds:.1} s", args.out.display(), scenes.len());
    Ok(())
}

fn load(args: &Solve, name: &str, display: &Display, colors: &[Color]) -> Result<scene::LightField, Failure> {
    let one = crate::args::SceneArgs { scene: name.into(), ..args.scene.clone() };
    common::scene(&one, display, colors)
}

/// A colour of which nothing is solved yet.
fn empty(color: Color, display: &Display) -> ColorHologram {
    let wavelength = display.wavelengths.iter().find(|w| w.color == color).map_or(0.0, |w| w.wavelength);
    ColorHologram { color: Some(color), wavelength, exposure: 1.0, efficiency: 1.0, phases: Vec::new() }
}

fn said(solved: &Solved, scene: &str) -> serde_json::Value {
    let color = |(color, s): &(Color, Solution)| {
        json!({
            "color": color, "psnr_mean_db": s.validation.mean(), "psnr_worst_db": s.validation.worst(),
            "exposure": s.exposure, "steps": s.steps, "seconds": s.seconds,
        })
    };
    json!({ "frame": solved.frame, "scene": scene, "colors": solved.colors.iter().map(color).collect::<Vec<_>>() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_in_the_order_of_their_numbers() {
        let mut names = ["f10", "f9", "a/2/f1", "f9b2", "f9b10", "f", "f99999999999999999999999"];
        names.sort_by_cached_key(|n| natural(n));
        assert_eq!(names, ["a/2/f1", "f", "f9", "f9b2", "f9b10", "f10", "f99999999999999999999999"]);
    }
}
