//! `eyebox evaluate`: every method, every group of pupils, and a report of what came of it.
//!
//! What is compared is decided first ([`subject`]), then done scene by scene; every result is kept as soon as it is
//! there ([`keep`]), so that a run that was stopped goes on where it was. What was measured is plain data ([`figures`])
//! that `report` turns into a page.

pub mod args;
pub mod figures;
pub mod keep;
pub mod measure;
mod picture;
pub mod pupils;
mod speckle;
mod subject;
mod work;

pub use args::Evaluate;
pub use work::{Job, checksum, evaluate};

use crate::Failure;
use crate::common;
use crate::progress;
use crate::quality::Chosen;
use crate::report::{self, Published};
use eyebox::engine::Engine;
use eyebox::evaluate::Group;
use eyebox::optics::{Color, Display};
use eyebox::scene;
use std::path::Path;

/// Solves, measures, reports.
pub fn run(args: &Evaluate) -> Result<(), Failure> {
    let mut job = job(args)?;
    let published = args.reference.as_deref().map(Published::read).transpose()?.unwrap_or_default();
    let mut engine = common::engine(&args.engine)?;
    let chosen = with_quality(&mut job, args, engine.as_ref())?;
    job.check_scenes()?;
    keep::writable(&args.out)?;
    if !args.json {
        eprintln!("engine: {}", engine.describe());
        chosen.iter().for_each(|about| eprintln!("{about}"));
    }
    progress::catch_interrupt();
    let mut report = evaluate(&job, &args.out, engine.as_mut(), args.json)?;
    report.published = published;
    report::write(&report, &args.out)?;
    if args.json {
        println!("{}", report::json(&report));
        return Ok(());
    }
    print_table(&report);
    let page = args.out.join("report.html");
    if report.missing > 0 {
        println!(
            "stopped: {} of {} results are kept, and shown in {}; the same command goes on from there",
            report.runs.len() + report.speckle.len(),
            report.runs.len() + report.speckle.len() + report.missing,
            page.display()
        );
    } else {
        println!("the report: {}", page.display());
    }
    Ok(())
}

/// Steps, pupils, their diameters, window and optimiser as quality or deadline ask for; says which.
fn with_quality(job: &mut Job, args: &Evaluate, engine: &dyn Engine) -> Result<Option<String>, Failure> {
    let frames = job.frames.last().copied().unwrap_or(job.settings.frames);
    let size = job.display.picture_size().into();
    let Some(Chosen { settings, about }) = args.quality.choose(engine, size, frames, job.colors.len())? else {
        return Ok(None);
    };
    let settings = job.settings.with_quality_of(&settings);
    job.settings = eyebox::solve::Settings {
        steps: args.steps.unwrap_or(settings.steps),
        pupils: args.pupils.unwrap_or(settings.pupils),
        // Methods are compared on the whole problem.
        repeats: 1,
        views: 1,
        pixel: 1,
        padding: job.settings.padding,
        levels: job.settings.levels.clone(),
        ..settings
    };
    Ok(Some(about))
}

fn print_table(report: &report::Report) {
    println!("PSNR over random pupils, dB:      mean  median   worst  spread");
    for series in report.series() {
        if let Some(s) = report.psnr(&series, None, Some(Group::Random)) {
            let name = report.label(&series);
            println!("  {name:28} {:8.2}{:8.2}{:8.2}{:8.2}", s.mean, s.median, s.worst, s.sd);
        }
    }
}

/// What the arguments ask for; nothing is computed or written yet.
fn job(args: &Evaluate) -> Result<Job, Failure> {
    if args.depth_map.is_some() && args.scenes.len() > 1 {
        return Err(Failure::Asked("--depth-map belongs to one picture: give one scene".into()));
    }
    if args.frames.is_empty() || args.frames.iter().any(|f| !(1..=4096).contains(f)) {
        return Err(Failure::Asked("--frames: the numbers of sub-frames must be 1 to 4096".into()));
    }
    let defaults = eyebox::solve::Settings::default();
    let (steps, pupils) = (args.steps.unwrap_or(defaults.steps), args.pupils.unwrap_or(defaults.pupils));
    if !(1..=1_000_000).contains(&steps) {
        return Err(Failure::Asked(format!("--steps {steps}: it must be 1 to 1000000")));
    }
    let methods = match &args.methods {
        Some(names) => subject::methods(names)?,
        None if args.hologram.is_empty() => subject::methods(&subject::DEFAULT.map(String::from))?,
        None => Vec::new(),
    };
    let given = subject::given(&args.hologram, args)?;
    let (display, colors) = optics(args, methods.is_empty().then_some(()).and(given.first()))?;
    for hologram in &given {
        hologram.check(&display, &colors)?;
    }
    let mut frames = args.frames.clone();
    frames.sort_unstable();
    frames.dedup();
    let scenes: Vec<_> = (0..args.scenes.len()).map(|i| args.scene(i)).collect();
    for (i, scene) in scenes.iter().enumerate() {
        if scenes[..i].iter().any(|s| s.scene == scene.scene) {
            return Err(Failure::Asked(format!("{}: this scene is given twice", scene.scene)));
        }
    }
    if args.display.size.is_none() {
        same_size(&args.scenes)?;
    }
    let subjects = subject::subjects(&methods, given);
    let settings = eyebox::solve::Settings {
        steps,
        pupils,
        diameter: common::diameters(args.pupil_diameter, &display),
        seed: args.seed,
        ..defaults
    };
    settings.check()?;
    let speckle = !args.no_speckle;
    Ok(Job { scenes, labels: labels(&args.scenes), subjects, frames, display, colors, settings, speckle })
}

/// The display asked for, or, where nothing is solved, that of the first hologram.
fn optics(args: &Evaluate, given: Option<&subject::Given>) -> Result<(Display, Vec<Color>), Failure> {
    match given {
        Some(given) if args.display.size.is_none() => Ok((given.hologram.made_for()?, given.hologram.named_colors())),
        _ => {
            let display = common::display(&args.display)?;
            let colors = common::colors(&args.display, &display)?;
            Ok((display, colors))
        }
    }
}

/// Pictures of one size, or a size that they are all fitted to.
fn same_size(sources: &[String]) -> Result<(), Failure> {
    let mut first: Option<(&str, [usize; 2])> = None;
    for source in sources {
        let Some(size) = scene::native_size(source)? else { continue };
        match first {
            Some((other, before)) if before != size => {
                return Err(Failure::Asked(format!(
                    "{source}: {} x {} pixels, but {other} has {} x {}: say with --size what all are fitted to",
                    size[0], size[1], before[0], before[1]
                )));
            }
            _ => first = first.or(Some((source, size))),
        }
    }
    Ok(())
}

/// Short names of scenes; whole ones where the short ones are not different.
fn labels(sources: &[String]) -> Vec<String> {
    let short = |source: &String| {
        let plain = source.strip_prefix("builtin:").unwrap_or(source);
        let whole = Path::new(plain).canonicalize().unwrap_or_else(|_| plain.into());
        match source.starts_with("builtin:") {
            true => plain.to_string(),
            false => whole.file_name().map_or(plain.to_string(), |n| n.to_string_lossy().into_owned()),
        }
    };
    let all: Vec<String> = sources.iter().map(short).collect();
    let unique = |i: usize| all.iter().filter(|l| **l == all[i]).count() == 1;
    (0..all.len()).map(|i| if unique(i) { all[i].clone() } else { sources[i].clone() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_of_one_name_are_told_apart() {
        let of = |s: &[&str]| labels(&s.iter().map(|s| s.to_string()).collect::<Vec<_>>());
        assert_eq!(of(&["builtin:plane?depth=2", "a/views"]), ["plane?depth=2", "views"]);
        assert_eq!(of(&["a/views", "b/views"]), ["a/views", "b/views"]);
    }
}
