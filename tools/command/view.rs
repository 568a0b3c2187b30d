//! `eyebox view`.

use crate::Failure;
use crate::args::View;
use crate::common::{self, Form};
use eyebox::low_level::evaluate::Plane;
use eyebox::low_level::hologram::{Hologram, PhaseSource};
use eyebox::low_level::optics::depth_in_words;

/// Shows one pupil.
pub fn run(args: &View) -> Result<(), Failure> {
    let form = common::form(&args.out, &[Form::Png, Form::Npy])?;
    let source = args.encoded.source(&args.phases, &args.hologram, args.which.at)?;
    let source = if args.ideal { source.on_ideal_display() } else { source };
    let source = match args.eye.given()? {
        Some(eye) => source.seen_by(Some(eye))?,
        None => source,
    };
    let about = source.about();
    let pupil = common::pupil_of(&args.pupil, about, args.phases.force)?;
    let mut engine = common::engine(&args.engine)?;
    let planes = about.as_seen(source.look(None, &pupil, engine.as_mut())?);
    let exposures = exposures(about, args.exposure, &planes);
    let colors: Vec<_> = about.colors.iter().map(|c| c.color).collect();
    common::write_image(&args.out, form, &planes, &colors, &exposures)?;
    let ([x, y, d, _], focus) =
        (pupil.to_mm().map(|mm| (mm * 1e6).round() / 1e6), depth_in_words(pupil.depth, about.focal_length));
    let cost = match &source {
        PhaseSource::Whole(_) => String::new(),
        PhaseSource::Tiled(tiles) => {
            let (read, peak) = (tiles.moved()[0] >> 20, common::peak_memory_mib().unwrap_or(0));
            format!("; read {read} MiB, peak {peak} MiB")
        }
    };
    let through = through(about);
    eprintln!(
        "wrote {}: the view from ({x}, {y}) mm through {d} mm, focused at {focus}{through}{cost}",
        args.out.display()
    );
    Ok(())
}

/// What is looked through, where that is not an ideal display and a perfect eye.
fn through(hologram: &Hologram) -> String {
    let model = |color| hologram.planner(color).ok()?.model;
    let mut terms: Vec<_> =
        (0..hologram.colors.len()).filter_map(model).flat_map(|tables| tables.model().terms()).collect();
    terms.sort_unstable();
    terms.dedup();
    let mut said = String::new();
    if !terms.is_empty() {
        said = format!(", through the display's {} (--ideal looks past it)", terms.join(", "));
    }
    if !hologram.metadata.picture.is_empty() {
        said += ", where the display's picture is seen (--ideal looks past it)";
    }
    let modes = (0..hologram.colors.len()).filter_map(|color| hologram.modes(color).ok());
    if let Some(most) = modes.map(|modes| modes.len()).max().filter(|most| *most > 0) {
        said += &format!(", in the light of a source of {most} modes (--ideal looks with a laser)");
    }
    if let Some(mask) = &hologram.metadata.mask {
        said += &format!(
            ", behind a mask of {k} x {k} pixels on each of the SLM's (--ideal looks past it)",
            k = mask.factor
        );
    }
    if let Some(eye) = &hologram.metadata.prescription {
        said += &format!(", by an eye of {eye} (--prescription none looks with a perfect one)");
    }
    said
}

/// What a picture of these planes is multiplied by: as asked, the hologram's own where it is known, else what makes them
/// bright.
pub fn exposures(hologram: &Hologram, asked: Option<f64>, planes: &[Plane]) -> Vec<f64> {
    match (asked, hologram.metadata.exposure_assumed) {
        (Some(exposure), _) => vec![exposure; planes.len()],
        (None, false) => hologram.colors.iter().map(|c| c.exposure).collect(),
        (None, true) => vec![1.0 / percentile(planes, 0.99); planes.len()],
    }
}

fn percentile(planes: &[Plane], share: f64) -> f64 {
    let mut all: Vec<f32> = planes.iter().flat_map(|p| &p.values).copied().collect();
    all.sort_by(f32::total_cmp);
    f64::from(all[((all.len() - 1) as f64 * share) as usize]).max(1e-30)
}
