//! `eyebox view`.

use crate::Failure;
use crate::args::{GeometryName, PhaseOptics, View};
use crate::common::{self, Form};
use crate::tiled;
use eyebox::engine::{Buffer, Engine};
use eyebox::evaluate;
use eyebox::hologram::{self, ColorHologram, Hologram};
use eyebox::optics::{Geometry, Optics, Padding, Pupil, WindowFactor};
use eyebox::plan::{Planner, Purpose};
use std::path::Path;

/// Shows one pupil.
pub fn run(args: &View) -> Result<(), Failure> {
    if args.at.is_none() && tiled::is_tiled(&args.hologram) {
        return tiled::view(args);
    }
    let form = common::form(&args.out, &[Form::Png, Form::Npy])?;
    let (hologram, known) = load(&args.hologram, args.at, &args.optics)?;
    for i in 0..hologram.colors.len() {
        args.pupil.check_within(&hologram.optics(i)?)?;
    }
    let mut engine = common::engine(&args.engine)?;
    let planes = through(&hologram, &args.pupil, engine.as_mut())?;
    let exposures = exposures(&hologram, known, &args.optics, &planes);
    let colors: Vec<_> = hologram.colors.iter().map(|c| c.color).collect();
    common::write_image(&args.out, form, hologram.picture_size().into(), &planes, &colors, &exposures)?;
    let [x, y, d, z] = args.pupil.to_mm();
    eprintln!("wrote {}: the view from ({x}, {y}) mm through {d} mm, focused at {z} mm", args.out.display());
    Ok(())
}

/// What a picture of these planes is multiplied by: as asked, the hologram's own where it is known, else what makes them
/// bright.
pub fn exposures(hologram: &Hologram, known: bool, optics: &PhaseOptics, planes: &[Vec<f32>]) -> Vec<f64> {
    match (optics.exposure, known) {
        (Some(exposure), _) => vec![exposure; planes.len()],
        (None, true) => hologram.colors.iter().map(|c| c.exposure).collect(),
        (None, false) => vec![1.0 / percentile(planes, 0.99); planes.len()],
    }
}

/// A hologram holds its own optics: none may be given.
pub fn no_optics(file: &Path, optics: &PhaseOptics) -> Result<(), Failure> {
    if optics.pitch.is_none() && optics.wavelength.is_empty() && optics.focal_length.is_none() {
        return Ok(());
    }
    let what = file.display();
    Err(Failure::Asked(format!("{what} holds its own optics: leave out --pitch, --wavelength and --focal-length")))
}

/// A hologram, or bare phases with the optics given; and whether its exposure is known.
pub fn load(file: &Path, at: Option<u64>, optics: &PhaseOptics) -> Result<(Hologram, bool), Failure> {
    if common::is_hologram(file) {
        no_optics(file, optics)?;
        return Ok((common::hologram(file, at)?, true));
    }
    let missing =
        || Failure::Asked(format!("{}: bare phases need --pitch, --wavelength and --focal-length", file.display()));
    let (pitch, focal_length) =
        (optics.pitch.ok_or_else(missing)? * 1e-6, optics.focal_length.ok_or_else(missing)? * 1e-3);
    let wavelengths: Vec<f64> = optics.wavelength.iter().map(|nm| nm * 1e-9).collect();
    let first = *wavelengths.first().ok_or_else(missing)?;
    Optics::new(1, 1, pitch, first, focal_length)?;
    let phases = hologram::load_phases(file)?;
    if phases.colors.len() != wavelengths.len() {
        let (has, given) = (phases.colors.len(), wavelengths.len());
        return Err(Failure::Asked(format!(
            "{}: it has {has} colours, {given} wavelengths were given",
            file.display()
        )));
    }
    let color =
        |((color, phases), wavelength)| ColorHologram { color, wavelength, exposure: 1.0, efficiency: 1.0, phases };
    let hologram = Hologram {
        frames: phases.frames,
        height: phases.height,
        width: phases.width,
        pitch,
        focal_length,
        geometry: match optics.geometry {
            GeometryName::Relay => Geometry::Relay,
            GeometryName::FarField => Geometry::FarField,
        },
        colors: phases.colors.into_iter().zip(wavelengths).map(color).collect(),
        seed: 0,
        version: String::new(),
        display: String::new(),
        display_wavelengths: Vec::new(),
        scene: String::new(),
        settings: serde_json::Value::Null,
    };
    hologram.check()?;
    Ok((hologram, false))
}

/// The intensity per colour through one pupil, without exposure.
pub fn through(hologram: &Hologram, pupil: &Pupil, engine: &mut dyn Engine) -> Result<Vec<Vec<f32>>, Failure> {
    let mut planes = Vec::new();
    for (i, color) in hologram.colors.iter().enumerate() {
        let plain = Planner::new(hologram.optics(i)?, hologram.frames, WindowFactor::Full);
        let planner = Planner { share: hologram.picture_share(i), ..plain.with_padding(padding_of(hologram)) };
        engine.load(&planner.shape(Purpose::View), None)?;
        engine.write(Buffer::Phases, &color.phases)?;
        planes.append(&mut evaluate::views(engine, &planner, &[*pupil])?);
    }
    Ok(planes)
}

/// Holograms are looked at as they were solved.
pub fn padding_of(hologram: &Hologram) -> Padding {
    let axis = |i: usize| hologram.settings["padding"][i].as_u64().unwrap_or(0).min(65536) as usize;
    Padding { rows: axis(0), columns: axis(1) }
}

fn percentile(planes: &[Vec<f32>], share: f64) -> f64 {
    let mut all: Vec<f32> = planes.concat();
    all.sort_by(f32::total_cmp);
    f64::from(all[((all.len() - 1) as f64 * share) as usize]).max(1e-30)
}
