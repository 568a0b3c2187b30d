//! `eyebox convert` converts phases between holograms, arrays, gray pictures and video frames.

use crate::Failure;
use crate::args::{EngineArgs, SceneArgs, SceneOptions};
use crate::common::{self, Form};
use crate::eval::score;
use crate::phases::{AtArgs, EncodedArgs, PhaseArgs, UnfinishedArgs};
use crate::talk::print_report;
use crate::values::positive;
use clap::Args;
use eyebox::low_level::hologram::{self, Hologram, Opening, PhaseSource, Phases, SceneRecord};
use eyebox::low_level::reason;
use serde_json::{Value, json};
use std::path::PathBuf;

/// The arguments of `eyebox convert`.
#[derive(Args)]
pub struct Convert {
    /// NAME.zarr, phases (NAME.npy or a folder of PNGs), or video frames (the folder of encode)
    #[arg(value_name = "IN")]
    pub file: PathBuf,
    /// NAME.zarr (a hologram), NAME.npy (float32 radians), or a folder for one 8-bit gray PNG per color and sub-frame
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    #[command(flatten)]
    pub which: AtArgs,
    #[command(flatten)]
    pub unfinished: UnfinishedArgs,
    #[command(flatten)]
    pub phases: PhaseArgs,
    #[command(flatten)]
    pub encoded: EncodedArgs,
    /// Scene of phases that become a hologram. The hologram stores its name, and it determines the exposures
    #[arg(help_heading = "Scene", long, value_name = "SCENE")]
    pub scene: Option<String>,
    #[command(flatten)]
    pub options: SceneOptions,
    /// Exposure of phases that become a hologram [default: the best fit with --scene, otherwise not known]
    #[arg(help_heading = "Bare phases", long, value_parser = positive, conflicts_with = "scene")]
    pub exposure: Option<f64>,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Converts the input to the format of the output.
pub fn run(args: &Convert) -> Result<(), Failure> {
    let is_hologram = args.out.extension().is_some_and(|end| end.eq_ignore_ascii_case("zarr"));
    if is_hologram {
        return import(args);
    }
    if args.out.extension().is_some() {
        common::form(&args.out, &[Form::Npy, Form::Zarr])?;
    }
    if let Some((_, option)) =
        [(args.scene.is_some(), "--scene"), (args.exposure.is_some(), "--exposure")].iter().find(|o| o.0)
    {
        return Err(Failure::Arguments(reason!(
            "not-a-hologram",
            "{option} is for a hologram. Give an output NAME.zarr"
        )));
    }
    args.options.check(None)?;
    export(args, &opened(args)?)
}

/// Opens phases, one hologram, or video frames.
fn opened(args: &Convert) -> Result<Hologram, Failure> {
    if args.encoded.are_at(&args.file) || args.encoded.as_shown.is_some() {
        return match args.encoded.source(&args.phases, &args.file, args.which.at)? {
            PhaseSource::Whole(hologram) => Ok(hologram.into_owned()),
            PhaseSource::Tiled(_) => Err(Failure::Arguments(reason!("tiles", "video frames are not in tiles"))),
        };
    }
    let opening = args.phases.opening(&args.file, args.which.at)?;
    let opening = Opening { unfinished: args.unfinished.unfinished, ..opening };
    opening.hologram(&args.file).map_err(|e| args.unfinished.failure(e))
}

/// Writes the phases as one array, or as a folder of gray pictures.
fn export(args: &Convert, hologram: &Hologram) -> Result<(), Failure> {
    let count = hologram.colors.len() * hologram.frames;
    let (height, width) = (hologram.height, hologram.width);
    if args.out.extension().is_some() {
        hologram::save_phases(hologram, &args.out)?;
        report(args, hologram, &format!("{count} sub-frames of {height}x{width}, radians"));
    } else {
        hologram.save_pngs(&args.out)?;
        report(args, hologram, &format!("{count} pictures of {height}x{width}, 256 levels per turn"));
    }
    Ok(())
}

/// Prints a report of the output.
fn report(args: &Convert, hologram: &Hologram, about: &str) {
    let out = args.out.display().to_string();
    if !args.json {
        eprintln!("wrote {out}: {about}");
        return;
    }
    let known = !hologram.metadata.exposure_assumed;
    let colors: Vec<Value> = hologram
        .colors
        .iter()
        .map(|c| json!({ "color": c.color, "wavelength_nm": c.wavelength * 1e9, "exposure": known.then_some(c.exposure) }))
        .collect();
    let size = [hologram.height, hologram.width];
    print_report(json!({ "out": out, "size": size, "frames": hologram.frames, "colors": colors }));
}

/// Writes the input as a hologram.
fn import(args: &Convert) -> Result<(), Failure> {
    common::form(&args.out, &[Form::Zarr])?;
    args.options.check(args.scene.as_ref())?;
    let what = args.file.display();
    if !Phases::are_at(&args.file) && !args.encoded.are_at(&args.file) && args.which.at.is_none() {
        return Err(Failure::Arguments(reason!("hologram-already", "{what} is a hologram already")));
    }
    let mut hologram = opened(args)?;
    hologram.version = env!("CARGO_PKG_VERSION").into();
    let exposures = if let Some(scene) = &args.scene {
        let display = score::display_of(&args.file, &hologram)?;
        let asked = SceneArgs::new(scene, &args.options);
        let mut engine = common::engine(&args.engine)?;
        let field = common::scene_on(&asked, &display, &hologram.named_colors(), engine.as_ref())?;
        hologram.fit_exposure(&field, engine.as_mut())?;
        let maps = common::maps_of(&asked)?;
        let record = SceneRecord::of_source(scene, maps.first().map(PathBuf::as_path))?;
        hologram.set_scene(&field.name, record);
        hologram.metadata.near = args.options.near;
        let depth = args.options.depth_before(&display).filter(|_| !args.options.depth_map.is_empty());
        hologram.metadata.depth_map_mm = depth.map(|both| both.map(|metres| metres * 1e3));
        hologram.metadata.order = args.options.order;
        hologram.metadata.photographs = args.options.photographs;
        let (views, cell) = field.own_views(&display);
        hologram.metadata.views = Some(views);
        hologram.metadata.view_pitch_mm = Some(cell * 1e3);
        "fitted to the scene"
    } else if let Some(exposure) = args.exposure {
        hologram.colors.iter_mut().for_each(|c| c.exposure = exposure);
        hologram.metadata.exposure_assumed = false;
        "as given"
    } else {
        "not known"
    };
    hologram.save(&args.out)?;
    let each: Vec<String> = hologram.colors.iter().map(|c| format!("{:.4}", c.exposure)).collect();
    let each = if hologram.metadata.exposure_assumed { String::new() } else { format!(" ({})", each.join(", ")) };
    let (colors, frames) = (common::counted(hologram.colors.len(), "color"), hologram.frames);
    let size = format!("{}x{}", hologram.height, hologram.width);
    report(args, &hologram, &format!("{colors}, {frames} sub-frames of {size}; exposure {exposures}{each}"));
    Ok(())
}
