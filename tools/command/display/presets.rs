//! Lists the displays that are built in, prints them, and writes display files from them.

use crate::Failure;
use crate::talk::print_report;
use crate::{common, progress};
use clap::Args;
use eyebox::low_level::files;
use eyebox::low_level::optics::{Color, Display, PRESETS, display_template, preset_about, preset_text};
use eyebox::low_level::reason;
use serde_json::{Value, json};
use std::path::PathBuf;

/// The arguments of `eyebox display list`.
#[derive(Args)]
pub struct List {
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// The arguments of `eyebox display show`.
#[derive(Args)]
pub struct ShowDisplay {
    /// Display preset or TOML file
    #[arg(value_name = "PRESET|FILE")]
    pub display: String,
}

/// The arguments of `eyebox display new`.
#[derive(Args)]
pub struct New {
    /// Display preset to begin with
    #[arg(value_name = "PRESET")]
    pub preset: String,
    /// Output file, which must not exist yet
    #[arg(help_heading = "Output", short, long, value_name = "OUT.toml")]
    pub out: PathBuf,
}

/// Prints a display as its file, with its source.
pub fn show(ShowDisplay { display }: &ShowDisplay) -> Result<(), Failure> {
    if preset_text(display).is_none() {
        common::say_model_age(&Display::load(display)?);
    }
    print!("{}", preset_text(display).map_or_else(|| Ok::<_, Failure>(Display::load(display)?.to_toml()), Ok)?);
    Ok(())
}

/// Writes a display file from a preset.
pub fn new(New { preset, out }: &New) -> Result<(), Failure> {
    let Some(text) = display_template(preset) else {
        let all = PRESETS.join(", ");
        return Err(Failure::Arguments(reason!("no-such-preset", "no preset '{preset}': expected one of {all}")));
    };
    common::check_ending(out, "toml")?;
    if out.exists() {
        return Err(Failure::Arguments(reason!("exists", "{}: the file exists, and is left alone", out.display())));
    }
    files::write_file(out, |to| to.write_all(text.as_bytes()))?;
    eprintln!("wrote {}. Give it as --display {}", out.display(), out.display());
    let display = Display::load(&out.to_string_lossy())?;
    let colors: Vec<Color> = display.wavelengths.iter().map(|w| w.color).collect();
    progress::catch_interrupt();
    common::prepare_first_phases(&display, &colors, false)
}

/// Lists the presets of displays.
pub fn list(List { json: as_json }: &List) -> Result<(), Failure> {
    let presets: Vec<(&str, Display)> =
        PRESETS.iter().filter_map(|name| Some((*name, Display::preset(name)?))).collect();
    if *as_json {
        let one = |(name, d): &(&str, Display)| -> Value {
            let wavelengths: serde_json::Map<_, _> = d
                .wavelengths
                .iter()
                .map(|w| (w.color.to_string(), json!((w.wavelength * 1e12).round() / 1e3)))
                .collect();
            json!({
                "name": name, "about": preset_about(name), "resolution": [d.height, d.width],
                "pitch_um": (d.pitch * 1e9).round() / 1e3, "focal_length_mm": (d.focal_length * 1e6).round() / 1e3,
                "wavelengths_nm": wavelengths, "levels": d.levels, "rate_hz": d.rate_hz, "geometry": d.geometry.name(),
                "packing": d.encoding.packing,
            })
        };
        print_report(json!({ "displays": presets.iter().map(one).collect::<Vec<_>>() }));
        return Ok(());
    }
    println!("{:20} {:>13} {:>8} {:>7}  packing   description", "name", "rows x cols", "pitch um", "levels");
    for (name, d) in presets {
        let packing = json!(d.encoding.packing);
        println!(
            "{name:20} {:>13} {:8.2} {:7}  {:9} {}",
            format!("{} x {}", d.height, d.width),
            d.pitch * 1e6,
            d.levels,
            packing.as_str().unwrap_or_default(),
            preset_about(name).unwrap_or_default()
        );
    }
    Ok(())
}
