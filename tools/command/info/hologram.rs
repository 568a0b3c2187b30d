//! Prints `eyebox info` of a hologram, a sequence, phases or video frames.

use super::args::Info;
use crate::Failure;
use crate::common;
use crate::talk::print_report;
use eyebox::low_level::encoded::{Encoded, is_encoded};
use eyebox::low_level::hologram::{Hologram, Opening, Phases, Sequence, Tiles, Unfinished};
use eyebox::low_level::optics::depths_in_words;
use eyebox::low_level::reason;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Prints the contents of a hologram.
pub fn run(args: &Info, path: &Path) -> Result<(), Failure> {
    if args.out.is_some() {
        return Err(Failure::Arguments(reason!(
            "views-of-hologram",
            "{}: --out is for the views of a scene",
            args.what
        )));
    }
    let mut more = Map::new();
    let (kind, about) = about(args, path, &mut more)?;
    // Phases without a display were opened with the optics of a preset, which may differ from their own.
    let has_optics = !Phases::are_at(path) || is_encoded(path) || args.display.display.is_some();
    let unfinished = if Phases::are_at(path) || is_encoded(path) { None } else { Unfinished::at(path)? };
    if args.json {
        let colors: Vec<Value> = about
            .colors
            .iter()
            .map(|c| {
                json!({
                    "color": c.color, "wavelength_nm": has_optics.then_some((c.wavelength * 1e12).round() / 1e3), "exposure": c.exposure, "efficiency": c.efficiency,
                })
            })
            .collect();
        let mut all = json!({
            "kind": kind, "size": [about.height, about.width], "frames": about.frames, "colors": colors,
            "pitch_um": has_optics.then_some((about.pitch * 1e9).round() / 1e3),
            "focal_length_mm": has_optics.then_some((about.focal_length * 1e6).round() / 1e3),
            "geometry": has_optics.then(|| about.geometry.name()), "display": about.display, "scene": about.scene, "version": about.version,
            "unfinished": unfinished, "solve": about.metadata,
        });
        all.as_object_mut().into_iter().for_each(|all| all.extend(more.clone()));
        print_report(all);
        return Ok(());
    }
    let line = |what: &str, value: String| println!("  {what:11} {value}");
    println!("{}: {kind}", args.what);
    let colors = common::counted(about.colors.len(), "color");
    let frames = common::counted(about.frames, "sub-frame");
    line("size", format!("{} x {} pixels, {colors}, {frames}", about.height, about.width));
    for c in about.colors.iter().filter(|_| has_optics) {
        let name = c.color.map_or_else(|| "color".into(), |color| color.to_string());
        let known = !about.metadata.exposure_assumed;
        let exposure = if known { format!(", exposure {:.3}", c.exposure) } else { ", exposure not known".into() };
        line(&name, format!("{:.1} nm{exposure}", c.wavelength * 1e9));
    }
    let (pitch, focal_length) = (about.pitch * 1e6, about.focal_length * 1e3);
    if has_optics {
        line("optics", format!("{}, pitch {pitch:.2} um, focal length {focal_length:.1} mm", about.geometry.name()));
    } else {
        line("optics", "not known (--display)".into());
    }
    if !about.display.is_empty() {
        line("display", about.display.clone());
    }
    if !about.scene.is_empty() {
        line("scene", about.scene.clone());
    }
    if let Some(settings) = &about.metadata.solve {
        line("solved with", settings.to_string());
        line("depth", depths_in_words(settings.depth, about.focal_length));
    }
    if let Some(eye) = &about.metadata.prescription {
        line("eye", eye.to_string());
    }
    if about.metadata.refined.is_some() {
        line("refined", "for a pupil".into());
    }
    more.iter().for_each(|(key, value)| line(key, value.to_string()));
    if let Some(how_far) = unfinished {
        line("unfinished", how_far.to_string());
    }
    Ok(())
}

/// Opens the file, without its phases if it is large, and adds the entries that only its kind has.
fn about(args: &Info, path: &Path, more: &mut Map<String, Value>) -> Result<(&'static str, Hologram), Failure> {
    let display = || args.display.display.is_some().then(|| common::display(&args.display)).transpose();
    if is_encoded(path) {
        let encoded = Encoded::open(path, display()?.as_ref(), args.display.color.one())?;
        more.insert("frames_are".into(), json!(encoded.describe()));
        return Ok(("video frames", encoded.decode(Default::default())?));
    }
    if Phases::are_at(path) {
        let display = common::display(&args.display)?;
        let opening =
            crate::phases::PhaseUnitArgs { phase_unit: None }.opening(Some(&display), args.display.color.one());
        let mut hologram = opening.hologram(path)?;
        hologram.display = String::new();
        return Ok(("phases", hologram));
    }
    if Tiles::is_tiled(path) {
        let tiles = Tiles::open(path)?;
        more.insert("tile".into(), json!(tiles.side()));
        return Ok(("a far field in tiles", tiles.about().clone()));
    }
    let opening = Opening { unfinished: true, ..Opening::default() };
    if Sequence::is_at(path) {
        let sequence = opening.sequence(path)?;
        let [holograms, seconds] = sequence.rate();
        more.insert("holograms".into(), json!(sequence.count()));
        more.insert("rate_hz".into(), json!(f64::from(holograms) / f64::from(seconds)));
        return Ok(("a sequence", sequence.about().clone()));
    }
    Ok(("a hologram", opening.hologram(path)?))
}
