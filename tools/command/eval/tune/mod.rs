//! `eyebox eval tune` measures the time and quality of settings on this machine.
//!
//! The recommended settings are kept for this device, for `--quality` of every other command.

mod args;

pub use args::Tune;

use crate::Failure;
use crate::common;
use crate::experiment::Table;
use crate::jod::ViewingArgs;
use crate::progress::{self, JobBar};
use crate::talk::print_report;
use eyebox::low_level::files::{ManagedDir, cache_folder};
use eyebox::low_level::optics::Color;
use eyebox::low_level::quality::ColorJob;
use eyebox::low_level::reason;
use eyebox::low_level::solve::{Levels, Settings};
use eyebox_lab::report;
use eyebox_lab::tuning::{NEAR_DB, Recommended, Tuned, Tuning};
use eyebox_lab::writable;
use std::path::Path;
use std::time::Instant;

/// Pupils through which a trial is judged in JOD, unless all or none are requested. One judgment takes as long as many
/// reconstructions.
const JUDGED: usize = 2;

/// Measures settings, writes the report, and keeps the recommended settings.
pub fn run(args: &Tune) -> Result<(), Failure> {
    if args.experiment.printed(&[("viewing", ViewingArgs::table)])? {
        return Ok(());
    }
    let begun = Instant::now();
    let mut own = ManagedDir::open(&args.out, &report::TUNED, args.overwrite.overwrite)?;
    let check = args.check.as_deref().map(read_check).transpose()?.unwrap_or_default();
    let mut display = common::display(&args.display)?;
    display.viewing = args.experiment.table::<ViewingArgs>("viewing")?.over(display.viewing)?;
    let color = leading(&common::colors(&args.display, &display)?);
    let mut given = args.experiment.given()?.before(display.focal_length)?;
    given.insert("frames", args.frames);
    given.insert("seed", args.seed);
    given.insert("diameter", args.pupil_diameter);
    let diameter = common::diameters(given.get("diameter")?, &display, args.display.force)?;
    let mut base = given.over(&Settings { diameter, ..Settings::default() })?;
    base.check()?;
    let levels = match base.levels {
        Levels::Any => Levels::of(&display),
        ref given => given.clone(),
    };
    let mut engine = common::engine(&args.engine)?;
    let field = common::scene_on(&args.scene, &display, &[color], engine.as_ref())?;
    base.depth = common::depths(&args.scene, &field, &display)?;
    let _made = writable(&args.out)?;
    if !args.json {
        eprintln!("engine: {}", engine.describe());
        eprintln!(
            "{}: {} x {} views, {}x{}, {color}",
            field.name, field.grid[0], field.grid[1], field.height, field.width
        );
    }
    progress::catch_interrupt();
    let seed = base.seed;
    let job = ColorJob { field: &field, color, display: &display, base, levels };
    let bar = JobBar::new(args.json);
    let judged = args.seen.pupils(JUDGED);
    let tuning = Tuning { job, budget: args.duration, seed, check, judged, begun };
    let tuned = tuning.run(&args.out, engine.as_mut(), &mut |what, share| bar.show(what, share))?;
    bar.finish();
    if tuned.trials.is_empty() {
        return Err(Failure::Arguments(reason!(
            "stopped",
            "stopped before anything was measured. The same command starts again"
        )));
    }
    report::write_tuned(&tuned, &mut own)?;
    let stored = if args.no_store { None } else { store(&tuned) };
    if args.json {
        print_report(report::tuned_json(&tuned));
    } else {
        print(&tuned, &args.out);
        if let Some(path) = stored {
            println!("kept for --quality on this device: {}", path.display());
        }
    }
    match tuned.check.iter().find(|c| !c.holds()) {
        Some(c) if c.short_db.is_some() => Err(Failure::Arguments(reason!(
            "below-the-front",
            "{} is {:.2} dB below the front here, and {NEAR_DB:.1} is allowed",
            c.setting.quality.name(),
            c.short_db.unwrap_or_default()
        ))),
        _ => Ok(()),
    }
}

/// Returns green if there is green, otherwise the middle color.
fn leading(colors: &[Color]) -> Color {
    if colors.contains(&Color::Green) { Color::Green } else { colors[colors.len() / 2] }
}

/// Reads the three settings that another run recommends.
fn read_check(file: &Path) -> Result<Vec<Recommended>, Failure> {
    let wrong = |what: String| Failure::Arguments(reason!("tradeoff-file", "{}: {what}", file.display()));
    let size = std::fs::metadata(file).map_err(|e| wrong(e.to_string()))?.len();
    if size > 64 << 20 {
        return Err(wrong("is too large for a tradeoff.json".into()));
    }
    let text = eyebox::low_level::files::read::text(file, eyebox::low_level::files::read::RESULTS)
        .map_err(|e| wrong(e.to_string()))?;
    #[derive(serde::Deserialize)]
    struct Other {
        recommended: Vec<Recommended>,
    }
    let other: Other = serde_json::from_str(&text).map_err(|e| wrong(format!("is no tradeoff.json ({e})")))?;
    if other.recommended.is_empty() || other.recommended.iter().any(|r| !r.trial.is_sound()) {
        return Err(wrong("recommends nothing that could be measured".into()));
    }
    Ok(other.recommended)
}

/// Keeps the recommended settings in the user's cache, if they reach the quality of their names. An error of that is
/// printed, and the command continues.
fn store(tuned: &Tuned) -> Option<std::path::PathBuf> {
    let Some(measured) = tuned.measured() else {
        eprintln!(
            "eyebox: not kept for --quality: a setting misses the quality of its name; give it more time with --duration"
        );
        return None;
    };
    let saved = measured.save(&cache_folder()?);
    saved.map_err(|error| eprintln!("eyebox: not kept for --quality: {error}")).ok()
}

fn print(tuned: &Tuned, out: &Path) {
    println!("             ms   mean dB  worst dB     JOD     MiB   setting");
    for r in &tuned.recommended {
        let t = &r.trial;
        println!(
            "{:9}{:7.0}  {:8.2}  {:8.2}  {:>6}  {:6.0}   {}{}",
            r.quality.name(),
            t.milliseconds,
            t.mean,
            t.worst,
            t.jod.map_or("-".into(), |[mean, _]| format!("{mean:.2}")),
            t.bytes as f64 / f64::from(1 << 20),
            t.recipe,
            if r.met { "" } else { " (the nearest there is)" }
        );
    }
    for c in &tuned.check {
        let t = &c.setting.trial;
        let name = c.setting.quality.name();
        match c.short_db {
            Some(db) => println!(
                "checked: {name} of the other run: {:.0} ms, {:.2} dB, {db:.2} dB below the front here: {}",
                t.milliseconds,
                t.mean,
                if c.holds() { "holds" } else { "does not hold" }
            ),
            None => println!("checked: {name} of the other run: not measured"),
        }
    }
    let stopped = if tuned.interrupted { "stopped; the same command continues from there; " } else { "" };
    println!(
        "{} trials in {:.0} s; {stopped}the page is {}",
        tuned.trials.len(),
        tuned.spent_s,
        out.join("index.html").display()
    );
}
