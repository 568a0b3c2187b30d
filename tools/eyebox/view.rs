//! `eyebox view`.

use crate::Failure;
use crate::args::{GeometryName, PhaseOptics, View};
use crate::common::{self, Form};
use eyebox::evaluate::Plane;
use eyebox::hologram::{self, Hologram, PhaseSource};
use eyebox::optics::{Geometry, depth_in_words};
use std::path::Path;

/// Shows one pupil.
pub fn run(args: &View) -> Result<(), Failure> {
    let form = common::form(&args.out, &[Form::Png, Form::Npy])?;
    let (source, known) = load(&args.hologram, args.at, &args.optics)?;
    let about = source.about();
    let pupil = common::pupil(&args.pupil, (0..about.colors.len()).map(|i| about.optics(i)), args.optics.force)?;
    let mut engine = common::engine(&args.engine)?;
    let planes = source.look(None, &pupil, engine.as_mut())?;
    let exposures = exposures(about, known, &args.optics, &planes);
    let colors: Vec<_> = about.colors.iter().map(|c| c.color).collect();
    common::write_image(&args.out, form, &planes, &colors, &exposures)?;
    let ([x, y, d, _], focus) = (pupil.to_mm(), depth_in_words(pupil.depth, about.focal_length));
    let cost = match &source {
        PhaseSource::Whole(_) => String::new(),
        PhaseSource::Tiled(tiles) => {
            let (read, peak) = (tiles.moved()[0] >> 20, common::peak_memory_mib().unwrap_or(0));
            format!("; read {read} MiB, peak {peak} MiB")
        }
    };
    eprintln!("wrote {}: the view from ({x}, {y}) mm through {d} mm, focused at {focus}{cost}", args.out.display());
    Ok(())
}

/// What a picture of these planes is multiplied by: as asked, the hologram's own where it is known, else what makes them
/// bright.
pub fn exposures(hologram: &Hologram, known: bool, optics: &PhaseOptics, planes: &[Plane]) -> Vec<f64> {
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
pub fn load(file: &Path, at: Option<u64>, optics: &PhaseOptics) -> Result<(PhaseSource<'static>, bool), Failure> {
    if common::is_hologram(file) {
        no_optics(file, optics)?;
        return Ok((PhaseSource::open(file, at)?, true));
    }
    let (Some(pitch), Some(focal_length), [_, ..]) = (optics.pitch, optics.focal_length, &optics.wavelength[..]) else {
        let what = file.display();
        return Err(Failure::Asked(format!("{what}: bare phases need --pitch, --wavelength and --focal-length")));
    };
    let wavelengths: Vec<f64> = optics.wavelength.iter().map(|nm| nm * 1e-9).collect();
    let geometry = match optics.geometry {
        GeometryName::Relay => Geometry::Relay,
        GeometryName::FarField => Geometry::FarField,
    };
    let phases = hologram::load_phases(file)?;
    let hologram = phases.with_optics(pitch * 1e-6, focal_length * 1e-3, geometry, &wavelengths);
    let hologram = hologram.map_err(|e| Failure::Asked(format!("{}: {e}", file.display())))?;
    for i in 0..hologram.colors.len() {
        common::usual(optics.force, hologram.optics(i)?.check_usual())?;
    }
    Ok((hologram.into(), false))
}

fn percentile(planes: &[Plane], share: f64) -> f64 {
    let mut all: Vec<f32> = planes.iter().flat_map(|p| &p.values).copied().collect();
    all.sort_by(f32::total_cmp);
    f64::from(all[((all.len() - 1) as f64 * share) as usize]).max(1e-30)
}
