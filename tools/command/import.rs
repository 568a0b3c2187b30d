//! `eyebox import`: the reverse of `eyebox export`.

use crate::args::{EngineArgs, SceneArgs, SceneOptions};
use crate::common::{self, Form};
use crate::phases::PhaseArgs;
use crate::values::positive;
use crate::{Failure, score};
use clap::Args;
use eyebox::low_level::hologram::{Phases, SceneRecord};
use eyebox::low_level::reason;
use std::path::PathBuf;

/// `eyebox import`
#[derive(Args)]
pub struct Import {
    /// Phases: NAME.npy, or a folder of PNGs
    pub file: PathBuf,
    /// The hologram: NAME.zarr
    #[arg(help_heading = "Output", short, long, value_name = "OUT.zarr")]
    pub out: PathBuf,
    /// Bare phases
    #[command(flatten)]
    pub phases: PhaseArgs,
    /// The scene that they show: it is named in the hologram, and decides the exposures
    #[arg(help_heading = "Scene", long, value_name = "SCENE")]
    pub scene: Option<String>,
    /// How the scene is read
    #[command(flatten)]
    pub options: SceneOptions,
    /// The exposure that they were made for [default: with --scene, what fits it best; else not known]
    #[arg(help_heading = "Bare phases", long, value_parser = positive, conflicts_with = "scene")]
    pub exposure: Option<f64>,
    /// Engine
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// Makes a hologram of bare phases.
pub fn run(args: &Import) -> Result<(), Failure> {
    common::form(&args.out, &[Form::Zarr])?;
    args.options.check(args.scene.as_ref())?;
    let what = args.file.display();
    if !Phases::are_at(&args.file) {
        return Err(Failure::Arguments(reason!("hologram-already", "{what} is a hologram already")));
    }
    let mut hologram = args.phases.opening(&args.file, None)?.hologram(&args.file)?;
    hologram.version = env!("CARGO_PKG_VERSION").into();
    let exposures = if let Some(scene) = &args.scene {
        let display = score::display_of(&args.file, &hologram)?;
        let asked = SceneArgs::new(scene, &args.options);
        let field = common::scene(&asked, &display, &hologram.named_colors())?;
        hologram.fit_exposure(&field, common::engine(&args.engine)?.as_mut())?;
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
    let (colors, frames, h, w) = (hologram.colors.len(), hologram.frames, hologram.height, hologram.width);
    let each: Vec<String> = hologram.colors.iter().map(|c| format!("{:.4}", c.exposure)).collect();
    let each = if hologram.metadata.exposure_assumed { String::new() } else { format!(" ({})", each.join(", ")) };
    eprintln!(
        "wrote {}: {colors} colour{}, {frames} sub-frames of {h}x{w}; exposure {exposures}{each}",
        args.out.display(),
        if colors == 1 { "" } else { "s" }
    );
    Ok(())
}
