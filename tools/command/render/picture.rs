//! `eyebox render --pupil` renders one picture of a hologram, of its target, or of both.

use super::args::{Render, RenderedContent};
use crate::Failure;
use crate::args::{SceneArgs, scene_of};
use crate::common::{self, Engines, Form};
use crate::subject::{self, SubjectOptions};
use crate::talk::print_report;
use crate::values::GivenPupil;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::evaluate::Plane;
use eyebox::low_level::gpu::Options;
use eyebox::low_level::hologram::{Hologram, PhaseSource};
use eyebox::low_level::optics::{Color, Display, Pupil, depth_in_words};
use eyebox::low_level::produce::is_larger_than_memory;
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::{Sampling, SceneSource};
use serde_json::json;
use std::path::Path;

/// The planes of each color with their exposures, and a description.
struct Rendered {
    planes: Vec<Plane>,
    exposures: Vec<f64>,
    colors: Vec<Option<Color>>,
    pupil: Pupil,
    focal_length: f64,
    about: String,
}

/// Renders the picture through one pupil.
pub fn run(args: &Render, pupil: &GivenPupil) -> Result<(), Failure> {
    let form = common::form(&args.out, &[Form::Png, Form::Npy])?;
    let is_hologram = args.is_hologram();
    if is_hologram {
        subject::refuse_quality(&args.what, &args.how)?;
    }
    let content = args.content.unwrap_or(if is_hologram { RenderedContent::Image } else { RenderedContent::Target });
    let rendered = match (is_hologram, content) {
        (true, RenderedContent::Image) => image_of_hologram(args, pupil)?,
        (true, _) => with_target(args, pupil, content)?,
        (false, RenderedContent::Target) => target_of_scene(args, pupil)?,
        (false, _) => solved_first(args, pupil, content)?,
    };
    let Rendered { planes, exposures, colors, pupil, focal_length, about } = &rendered;
    common::write_image(&args.out, form, planes, colors, exposures)?;
    let ([x, y, d, _], focus) =
        (pupil.to_mm().map(|mm| (mm * 1e6).round() / 1e6), depth_in_words(pupil.depth, *focal_length));
    if args.json {
        let size = planes.first().map(|plane| [plane.rows, plane.columns]);
        let report = json!({
            "out": args.out.display().to_string(), "size": size, "pupil_mm": pupil.to_mm(), "exposure": exposures,
        });
        print_report(report);
        return Ok(());
    }
    let what = content.in_words();
    eprintln!("wrote {}: {what} from ({x}, {y}) mm through {d} mm, focused at {focus}{about}", args.out.display());
    Ok(())
}

/// Opens the hologram as the eye and the options have it.
fn source(args: &Render) -> Result<PhaseSource<'static>, Failure> {
    let source = args.encoded.source(&args.phases(), Path::new(&args.what), args.which.at)?;
    let source = if args.ideal { source.on_ideal_display() } else { source };
    Ok(match args.how.eye.given()? {
        Some(eye) => source.seen_by(Some(eye))?,
        None => source,
    })
}

/// Renders the image of a hologram.
fn image_of_hologram(args: &Render, pupil: &GivenPupil) -> Result<Rendered, Failure> {
    let source = source(args)?;
    let about = source.about();
    let pupil = common::pupil_of(pupil, about, args.how.display.force)?;
    let mut engine = common::engine(&args.how.engine)?;
    let planes = about.as_seen(source.look(None, &pupil, engine.as_mut())?);
    let exposures = exposures(about, args.exposure, &planes);
    let cost = match &source {
        PhaseSource::Whole(_) => String::new(),
        PhaseSource::Tiled(tiles) => {
            let (read, peak) = (tiles.moved()[0] >> 20, common::peak_memory_mib().unwrap_or(0));
            format!("; read {read} MiB, peak {peak} MiB")
        }
    };
    Ok(Rendered {
        colors: about.colors.iter().map(|c| c.color).collect(),
        focal_length: about.focal_length,
        about: through(about) + &cost,
        planes,
        exposures,
        pupil,
    })
}

/// Renders the target image of the hologram's scene, and the hologram's image if both are requested.
fn with_target(args: &Render, pupil: &GivenPupil, content: RenderedContent) -> Result<Rendered, Failure> {
    let source = source(args)?;
    let PhaseSource::Whole(hologram) = &source else {
        return Err(Failure::Arguments(reason!(
            "target-of-tiles",
            "{}: a far field in tiles has no target image here. Render its scene",
            args.what
        )));
    };
    let how = &args.how;
    let mut engine = common::engine(&how.engine)?;
    let input = scene_of(Path::new(&args.what), hologram, how.scene.as_deref(), &how.options, how.display.force)?
        .drawn_by(engine.as_ref());
    let (mut hologram, field, mut display) =
        (hologram.clone().into_owned(), input.light_field()?, input.display.clone());
    let pupil = common::pupil_of(pupil, &hologram, how.display.force)?;
    hologram.fit_exposure(&field, engine.as_mut())?;
    // The target is what an eye should see, wherever the display shows it.
    display.picture = Default::default();
    let scene = SceneSource::new(field, &display)?;
    beside(args, &hologram, &scene, pupil, content, engine.as_mut())
}

/// Solves a scene and renders the hologram's image, with the target image if both are requested.
fn solved_first(args: &Render, pupil: &GivenPupil, content: RenderedContent) -> Result<Rendered, Failure> {
    let engines = Engines::new(&args.how.engine, &Options::default())?;
    let (hologram, field, mut display) = subject::solved(&args.what, &args.how, &engines)?;
    let pupil = common::pupil_of(pupil, &hologram, args.how.display.force)?;
    display.picture = Default::default();
    let scene = SceneSource::new(field, &display)?;
    beside(args, &hologram, &scene, pupil, content, engines.open()?.as_mut())
}

/// Renders the requested content of a hologram and its scene.
fn beside(
    args: &Render,
    hologram: &Hologram,
    scene: &SceneSource,
    pupil: Pupil,
    content: RenderedContent,
    engine: &mut dyn Engine,
) -> Result<Rendered, Failure> {
    let mut colors: Vec<_> = hologram.colors.iter().map(|c| c.color).collect();
    let mut planes = Vec::new();
    let mut exposures = Vec::new();
    if content != RenderedContent::Target {
        planes = hologram.as_seen(hologram.look(&pupil, engine)?);
        exposures = self::exposures(hologram, args.exposure, &planes);
    }
    if content != RenderedContent::Image {
        let targets = targets(scene, pupil, engine)?;
        if planes.is_empty() {
            (planes, exposures) = (targets, vec![1.0; colors.len()]);
        } else {
            for ((plane, target), exposure) in planes.iter_mut().zip(&targets).zip(&mut exposures) {
                *plane = side_by_side(plane, target, std::mem::replace(exposure, 1.0));
            }
        }
    }
    colors.truncate(planes.len());
    let about = if content == RenderedContent::Target { String::new() } else { through(hologram) };
    Ok(Rendered { planes, exposures, colors, pupil, focal_length: hologram.focal_length, about })
}

/// Puts a target on the right of an image times its exposure.
fn side_by_side(image: &Plane, target: &Plane, exposure: f64) -> Plane {
    let (rows, columns) = (image.rows.min(target.rows), image.columns + target.columns);
    let mut values = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        values.extend(image.values[row * image.columns..][..image.columns].iter().map(|v| v * exposure as f32));
        values.extend_from_slice(&target.values[row * target.columns..][..target.columns]);
    }
    Plane { rows, columns, values }
}

/// Returns the display and the colors of a target image. The target is what an eye should see, wherever the display
/// shows it.
pub fn target_display(args: &Render) -> Result<(Display, Vec<Color>), Failure> {
    let mut display = common::display(&args.how.display)?;
    display.picture = Default::default();
    let colors = common::colors(&args.how.display, &display)?;
    Ok((display, colors))
}

/// Computes the target image of each color.
fn targets(scene: &SceneSource, pupil: Pupil, engine: &mut dyn Engine) -> Result<Vec<Plane>, Failure> {
    let mut planes = Vec::new();
    for color in 0..scene.colors() {
        planes.append(&mut scene.photographs(color, &[pupil], Sampling::Pupil, engine)?);
    }
    Ok(planes)
}

/// Renders the target image of a scene. Nothing is solved.
fn target_of_scene(args: &Render, pupil: &GivenPupil) -> Result<Rendered, Failure> {
    let SubjectOptions { display: display_args, options, .. } = &args.how;
    let (display, colors) = target_display(args)?;
    let check = |pupil| colors.iter().try_fold(pupil, |pupil, color| display.check_pupil(*color, pupil));
    let pupil = common::pupil(pupil, display.focal_length, check, display_args.force)?;
    let mut engine = common::engine(&args.how.engine)?;
    let scene = SceneArgs::new(&args.what, options);
    let scene = match is_larger_than_memory(&display, 1) {
        true => SceneSource::Around(common::scene_around(&scene, &display, &colors)?),
        false => SceneSource::new(common::scene_on(&scene, &display, &colors, engine.as_ref())?, &display)?,
    };
    let planes = targets(&scene, pupil, engine.as_mut())?;
    Ok(Rendered {
        exposures: vec![1.0; planes.len()],
        colors: colors.into_iter().map(Some).collect(),
        focal_length: display.focal_length,
        about: String::new(),
        planes,
        pupil,
    })
}

/// Describes the display's model and the eye, unless the display is ideal and the eye perfect.
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

/// Returns the exposure of each plane. It is the requested one, or the hologram's own if it is known. Otherwise the
/// 99th percentile becomes white.
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
