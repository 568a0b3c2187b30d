//! `eyebox tradeoff`: what quality costs on this machine, and which settings are worth it.
//!
//! [`work`] measures what the runtime's sweep decides; what came of it is plain data ([`found`]) that `page`, `plots` and
//! `tables` show. What is recommended is kept for this device, for `--quality` and `--deadline` of every other command.

mod args;
mod found;
mod page;
mod plots;
mod tables;
mod work;

pub use args::Tradeoff;

use crate::Failure;
use crate::common;
use crate::evaluate::{checksum, keep};
use crate::progress;
use crate::settings::levels_of;
use eyebox::files::{cache_folder, write_file};
use eyebox::optics::Color;
use eyebox::quality::{Measured, Subject};
use eyebox::solve::Settings;
use found::{Checked, Found};
use serde_json::json;
use std::path::Path;
use std::time::Instant;
use work::{Done, Work};

/// Measures, reports, and keeps what is recommended.
pub fn run(args: &Tradeoff) -> Result<(), Failure> {
    let begun = Instant::now();
    let check = args.check.as_deref().map(read_check).transpose()?.unwrap_or_default();
    let display = common::display(&args.display)?;
    let color = leading(&common::colors(&args.display, &display)?);
    let mut base = Settings { frames: args.frames, seed: args.seed, ..Settings::default() };
    base.diameter = common::diameters(args.pupil_diameter, &display);
    let levels = levels_of(args.levels.as_deref(), &display)?;
    Settings { levels: levels.clone(), ..base.clone() }.check()?;
    let mut engine = common::engine(&args.engine)?;
    let field = common::scene(&args.scene, &display, &[color])?;
    base.depth = common::depths(&args.scene, &field, &display);
    keep::writable(&args.out)?;
    if !args.json {
        eprintln!("engine: {}", engine.describe());
        eprintln!(
            "{}: {} x {} views, {}x{}, {color}",
            field.name, field.grid[0], field.grid[1], field.height, field.width
        );
    }
    progress::catch_interrupt();
    let made_by = json!({
        "version": env!("CARGO_PKG_VERSION"), "format": 1, "device": engine.describe(), "base": base, "levels": levels,
        "scene": [json!(checksum(&field)), json!(field.grid), json!(field.cell(&display))], "color": color,
        "display": [json!([display.height, display.width]), json!([display.pitch, display.focal_length]),
            json!(display.wavelengths.iter().map(|w| w.wavelength).collect::<Vec<_>>())],
    });
    let slm_levels = levels.given().map(<[f64]>::len);
    let kept = keep::Keep::new(args.out.clone())?;
    let wanted: Vec<Settings> = check.iter().map(|c| c.setting.trial.recipe.clone()).collect();
    let mut work = Work {
        subject: Subject { field: &field, color, display: &display, base, levels },
        engine: engine.as_mut(),
        keep: &kept,
        made_by: made_by.to_string(),
        budget: args.budget,
        seed: args.seed,
        begun,
        quiet: args.json,
    };
    let Done { trials, levels, levels_recipe, spent_s } = work.run(&wanted)?;
    if trials.is_empty() {
        return Err(Failure::Asked("stopped before anything was measured: the same command starts again".into()));
    }
    let mut found = Found {
        version: env!("CARGO_PKG_VERSION").into(),
        device: engine.describe(),
        scene: field.name.clone(),
        color,
        display: display.name.clone(),
        size: [display.height, display.width],
        frames: args.frames,
        slm_levels,
        seed: args.seed,
        budget_s: args.budget,
        spent_s,
        interrupted: progress::interrupted(),
        recommended: Vec::new(),
        trials,
        levels,
        levels_recipe,
        check,
    };
    found.settle();
    write(&found, &args.out)?;
    let stored = if args.no_store { None } else { store(&found) };
    if args.json {
        println!("{}", tables::json(&found));
    } else {
        print(&found, &args.out);
        if let Some(path) = stored {
            println!("kept for --quality and --deadline on this device: {}", path.display());
        }
    }
    match found.check.iter().find(|c| !c.holds()) {
        Some(c) if c.short_db.is_some() => Err(Failure::Asked(format!(
            "{} is {:.2} dB below the front here: {:.1} is allowed",
            c.setting.quality.name(),
            c.short_db.unwrap_or_default(),
            found::NEAR_DB
        ))),
        _ => Ok(()),
    }
}

/// Green where there is green, else the middle one.
fn leading(colors: &[Color]) -> Color {
    if colors.contains(&Color::Green) { Color::Green } else { colors[colors.len() / 2] }
}

/// The three settings that another run recommends.
fn read_check(file: &Path) -> Result<Vec<Checked>, Failure> {
    let wrong = |what: String| Failure::Asked(format!("{}: {what}", file.display()));
    let size = std::fs::metadata(file).map_err(|e| wrong(e.to_string()))?.len();
    if size > 64 << 20 {
        return Err(wrong("is too large for a tradeoff.json".into()));
    }
    let text = std::fs::read_to_string(file).map_err(|e| wrong(e.to_string()))?;
    #[derive(serde::Deserialize)]
    struct Other {
        recommended: Vec<eyebox::quality::Recommended>,
    }
    let other: Other = serde_json::from_str(&text).map_err(|e| wrong(format!("is no tradeoff.json ({e})")))?;
    if other.recommended.is_empty() || other.recommended.iter().any(|r| !r.trial.is_sound()) {
        return Err(wrong("recommends nothing that could be measured".into()));
    }
    Ok(other.recommended.iter().map(Checked::new).collect())
}

/// Writes `index.html`, `trials.csv` and `tradeoff.json`, each whole or not at all.
fn write(found: &Found, folder: &Path) -> Result<(), Failure> {
    let files = [
        ("trials.csv", tables::csv(found)),
        ("tradeoff.json", format!("{:#}\n", tables::json(found)).into_bytes()),
        ("index.html", page::html(found).into_bytes()),
    ];
    for (name, bytes) in files {
        write_file(&folder.join(name), |out| out.write_all(&bytes))?;
    }
    Ok(())
}

/// Keeps what is recommended in the user's cache, if it is what it promises; what keeps it from being kept is said, and
/// nothing else.
fn store(found: &Found) -> Option<std::path::PathBuf> {
    if let Some(r) = found.recommended.iter().find(|r| !r.met) {
        eprintln!(
            "eyebox: not kept for --quality: no trial is what {} promises; give it more time with --budget",
            r.quality.name()
        );
        return None;
    }
    let measured = Measured {
        device: found.device.clone(),
        scene: found.scene.clone(),
        color: found.color,
        size: found.size,
        frames: found.frames,
        recommended: found.recommended.clone(),
        front: found.by_mean().into_iter().cloned().collect(),
    };
    let saved = measured.save(&cache_folder()?);
    saved.map_err(|error| eprintln!("eyebox: not kept for --quality: {error}")).ok()
}

fn print(found: &Found, out: &Path) {
    println!("             ms   mean dB  worst dB     MiB   setting");
    for r in &found.recommended {
        let t = &r.trial;
        println!(
            "{:9}{:7.0}  {:8.2}  {:8.2}  {:6.0}   {}{}",
            r.quality.name(),
            t.milliseconds,
            t.mean,
            t.worst,
            t.bytes as f64 / f64::from(1 << 20),
            t.recipe,
            if r.met { "" } else { " (the nearest there is)" }
        );
    }
    for c in &found.check {
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
    let stopped = if found.interrupted { "stopped; the same command goes on from there; " } else { "" };
    println!(
        "{} trials in {:.0} s; {stopped}the page: {}",
        found.trials.len(),
        found.spent_s,
        out.join("index.html").display()
    );
}
