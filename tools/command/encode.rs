//! `eyebox encode` writes the video frames that a display receives as pictures.

use crate::Failure;
use crate::args::{DisplayArgs, Encode, EngineName};
use crate::common;
use crate::talk::print_report;
use eyebox::low_level::encode::{self, Encoder, PhaseSet, VideoFrames};
use eyebox::low_level::engine::vulkan::VulkanEncoder;
use eyebox::low_level::gpu::{Gpu, Options};
use eyebox::low_level::hologram::{ColorHologram, Hologram, Opening, Phases};
use eyebox::low_level::optics::{Color, Display, USUAL_RATE_HZ};
use eyebox::low_level::reason;
use serde_json::{Value, json};
use std::borrow::Cow;

/// The phases that are encoded.
struct Input {
    frames: usize,
    size: [usize; 2],
    colors: Vec<(Color, Vec<f32>)>,
    notes: Vec<String>,
    /// The hologram without its phases.
    hologram: Hologram,
}

/// Encodes one hologram and writes its video frames.
pub fn run(args: &Encode) -> Result<(), Failure> {
    let (input, display) = load(args)?;
    let colors: Vec<Color> = input.colors.iter().map(|c| c.0).collect();
    let encoder = Encoder::new(&display, &colors, input.frames)?;
    if encoder.hologram_size() != input.size {
        let ([h, w], [eh, ew]) = (input.size, encoder.hologram_size());
        let (name, turned) = (&display.name, if display.encoding.rotation_deg % 180 == 0 { "" } else { ", turned," });
        // --size is the size of the SLM, which may show the hologram turned.
        let [sh, sw] = if turned.is_empty() { [h, w] } else { [w, h] };
        return Err(Failure::Arguments(reason!(
            "size",
            "{}: {h}x{w} pixels, but the display '{name}'{turned} takes {eh}x{ew}. Give --size {sh}x{sw}, or the \
             display that it was made for",
            args.hologram.display()
        )));
    }
    let slices: Vec<&[f32]> = input.colors.iter().map(|c| &c.1[..]).collect();
    let phases = PhaseSet::new(&slices, input.size)?;
    let frames = match args.engine.device.engine(args.engine.engine)? {
        // Reading and writing files takes longer than the CPU needs.
        EngineName::Auto | EngineName::Cpu => encoder.encode(&phases)?,
        EngineName::Vulkan | EngineName::VulkanFrom(_) => {
            let device = args.engine.device.device.clone();
            let options = Options { device, allow_cpu: true, ..Options::default() };
            let mut frames = encoder.frames();
            VulkanEncoder::new(&Gpu::open(&options)?, encoder.plan())?.encode(phases.colors(), frames.bytes_mut())?;
            frames
        }
    };
    encoder.save(&frames, Some(&input.hologram), &args.out)?;
    let slow = encode::flicker(&display, &colors, input.frames, display.rate_hz.unwrap_or(USUAL_RATE_HZ));
    let notes: Vec<&String> = input.notes.iter().chain(&slow).chain(encoder.notes()).collect();
    input.notes.iter().for_each(|note| tracing::warn!("{note}"));
    slow.iter().for_each(|slow| tracing::debug!("{slow}"));
    if args.json {
        print_report(report(args, &encoder, &frames, &notes));
    }
    let (count, height, width) = (common::counted(frames.count(), "video frame"), frames.height, frames.width);
    let kind = if frames.channels == 1 { "gray" } else { "RGB" };
    eprintln!("wrote {}: {count} of {height}x{width}, 8-bit {kind}", args.out.display());
    Ok(())
}

/// Loads the requested colors of the hologram, each with its name, and the display.
fn load(args: &Encode) -> Result<(Input, Display), Failure> {
    let display = Phases::are_at(&args.hologram).then(|| common::display(&args.display)).transpose()?;
    let opening = args.unit.opening(display.as_ref(), args.display.color.one());
    let opening = Opening { at: args.which.at, unfinished: args.unfinished.unfinished, ..opening };
    let mut hologram = opening.hologram(&args.hologram).map_err(|e| args.unfinished.failure(e))?;
    let DisplayArgs { display: name, size, force, .. } = &args.display;
    let solved_for = || common::display_of(name.as_deref(), *size, *force, &hologram);
    let display = display.map_or_else(solved_for, Ok)?;
    let notes = differences(&hologram, &display);
    let named = |c: &ColorHologram| {
        c.color.ok_or_else(|| {
            Failure::Arguments(reason!("colors-not-named", "{}: its colors are not named", args.hologram.display()))
        })
    };
    let (frames, size) = (hologram.frames, [hologram.height, hologram.width]);
    let names = hologram.colors.iter().map(named).collect::<Result<Vec<_>, _>>()?;
    let sent = hologram.sent_colors().into_iter().map(|i| names[i]);
    let colors = sent.zip(hologram.sent_phases().into_iter().map(Cow::into_owned)).collect();
    hologram.colors.iter_mut().for_each(|color| color.phases = Vec::new());
    Ok((Input { frames, size, colors, notes, hologram }, display))
}

/// Returns a note for each difference between the display and the one that the hologram was made for.
fn differences(hologram: &Hologram, display: &Display) -> Vec<String> {
    let mut notes = Vec::new();
    if hologram.geometry != display.geometry {
        let (made, is) = (hologram.geometry.name(), display.geometry.name());
        notes.push(format!("the hologram was made for a {made} display, and this one is {is}"));
    }
    if (hologram.pitch / display.pitch - 1.0).abs() > 1e-3 {
        let (made, is) = (hologram.pitch * 1e6, display.pitch * 1e6);
        notes.push(format!("the hologram was made for a pitch of {made:.3} um, the display's is {is:.3} um"));
    }
    for c in &hologram.colors {
        let of = display.wavelengths.iter().find(|w| Some(w.color) == c.color);
        if let Some(w) = of.filter(|w| (w.wavelength / c.wavelength - 1.0).abs() > 2e-3) {
            let (made, is) = (c.wavelength * 1e9, w.wavelength * 1e9);
            notes.push(format!("{} was made for {made:.1} nm, the display's is {is:.1} nm", w.color));
        }
    }
    notes
}

/// Returns the report with the content of each frame.
fn report(args: &Encode, encoder: &Encoder, frames: &VideoFrames, notes: &[&String]) -> Value {
    json!({
        "folder": args.out.display().to_string(),
        "display": encoder.display().name,
        "height": frames.height,
        "width": frames.width,
        "channels": frames.channels,
        "frames": encoder.contents(),
        "notes": notes,
    })
}
