//! What is steered: a hologram with its scene, or a scene that is solved first.

use crate::args::{DisplayArgs, EngineArgs, EyeArgs, OtherSceneArgs, SceneArgs, SceneOptions};
use crate::common::{self, Engines};
use crate::phases::{PhaseUnitArgs, tell_unfinished};
use crate::quality::QualityArgs;
use crate::solve::Watch;
use crate::{Failure, progress, score};
use clap::Args;
use eyebox::encode::Encoder;
use eyebox::hologram::{ColorHologram, Hologram, Opening, Phases, Unfinished};
use eyebox::optics::{Color, Display};
use eyebox::produce::solve_colors;
use eyebox::quality::Subject;
use eyebox::scene::LightField;
use eyebox::session::SteeredColor;
use eyebox::solve::{Levels, Problem, Settings};
use std::path::Path;

/// What is steered, in every command that does.
#[derive(Args)]
pub struct SubjectArgs {
    /// NAME.zarr, solved for the whole eyebox; NAME.npy, phases with --scene; or a scene, which is solved first
    pub what: String,
    /// With a hologram: its scene [default: the one it was solved from]
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<String>,
    /// A scene that the hologram was not made of
    #[command(flatten)]
    pub other: OtherSceneArgs,
    /// How the scene is read
    #[command(flatten)]
    pub options: SceneOptions,
    /// Display that is encoded for, and, with a scene, solved for; bare phases are for it
    #[command(flatten)]
    pub display: DisplayArgs,
    /// The eye that looks
    #[command(flatten)]
    pub eye: EyeArgs,
    /// Bare phases
    #[command(flatten)]
    pub unit: PhaseUnitArgs,
    /// With a scene: quality of the hologram for the whole eyebox
    #[command(flatten)]
    pub quality: QualityArgs,
    /// Engine
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// It, loaded.
pub struct Steered {
    /// The hologram for the whole eyebox.
    pub hologram: Hologram,
    /// Its colours.
    pub colors: Vec<Color>,
    /// What is refined.
    pub parts: Vec<SteeredColor>,
    /// To what the SLM receives.
    pub encoder: Encoder,
    /// What computes.
    pub engine: String,
    /// How far the hologram is, where it is not finished.
    pub unfinished: Option<Unfinished>,
}

/// Loads or solves it.
pub fn load(args: &SubjectArgs, engines: &Engines) -> Result<Steered, Failure> {
    let path = Path::new(&args.what);
    let scene = |scene: &str| SceneArgs::new(scene, &args.options);
    let phases = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy"));
    let (hologram, optics, field, unfinished) = if phases || (!Phases::are_at(path) && !path.join("views").exists()) {
        let unfinished = tell_unfinished(path)?;
        let mut hologram = Opening { unfinished: true, ..args.unit.chosen(&args.display)? }.hologram(path)?;
        args.eye.replace(&mut hologram.metadata.prescription)?;
        let optics = score::display_of(path, &hologram)?;
        let name = args.scene.as_deref().unwrap_or(&hologram.scene);
        if name.is_empty() {
            return Err(Failure::Asked(format!("{}: it does not say of which scene it is: give --scene", args.what)));
        }
        args.other.check(path, &hologram, name)?;
        let colors: Vec<Color> = hologram.colors.iter().filter_map(|c| c.color).collect();
        let field = common::scene(&score::as_solved(&scene(name), &hologram), &optics, &colors)?;
        hologram.fit_exposure(&field, engines.open()?.as_mut())?;
        (hologram, optics, field, unfinished)
    } else {
        if args.scene.is_some() {
            return Err(Failure::Asked(format!("{} is a scene already: leave out --scene", args.what)));
        }
        let mut display = common::display(&args.display)?;
        args.eye.replace(&mut display.prescription)?;
        let colors = common::colors(&args.display, &display)?;
        let mut engine = engines.open()?;
        let field = common::scene(&scene(&args.what), &display, &colors)?;
        let depth = common::depths(&scene(&args.what), &field, &display)?;
        let base = Settings { depth, diameter: common::diameters(None, &display, false)?, ..Settings::default() };
        let chosen =
            args.quality.choose(engine.as_ref(), [display.height, display.width], base.frames, colors.len())?;
        let settings = chosen.map_or_else(Settings::default, |c| c.settings);
        let levels = Levels::of(&display);
        let subject = Subject { field: &field, color: colors[0], display: &display, base, levels };
        eprintln!("solving {} for the whole eyebox: {settings}", args.what);
        progress::catch_interrupt();
        let mut watch = Watch::new(false);
        let solved = solve_colors(&subject, &colors, &settings, engine.as_mut(), &mut |event| watch.see(event))?;
        let padding = subject.padding(&settings)?;
        let hologram = Hologram::from_solutions(&field, &display, &subject.settings(&settings), padding, &solved)?;
        (hologram, display, field, None)
    };
    let mut shown = common::display(&args.display)?;
    if args.display.size.is_none() {
        (shown.height, shown.width) = (hologram.height, hologram.width);
    }
    let colors: Vec<Color> = hologram.colors.iter().filter_map(|c| c.color).collect();
    let encoder = Encoder::new(&shown, &colors, hologram.frames)?;
    let ([eh, ew], [h, w]) = (encoder.hologram_size(), [hologram.height, hologram.width]);
    if [eh, ew] != [h, w] {
        let name = &shown.name;
        return Err(Failure::Asked(format!(
            "{}: it is {h}x{w} pixels, and the display '{name}' takes {eh}x{ew}: give --size, or another --display",
            args.what
        )));
    }
    let parts = parts(&hologram, &field, &optics)?;
    let engine = engines.open()?.describe();
    Ok(Steered { colors, parts, encoder, engine, hologram, unfinished })
}

/// What is refined of a hologram of `field`, made for `display`.
pub fn parts(hologram: &Hologram, field: &LightField, display: &Display) -> Result<Vec<SteeredColor>, Failure> {
    let padding = hologram.metadata.padding();
    let part = |c: &ColorHologram| -> Result<SteeredColor, Failure> {
        let problem = Problem::new(field, c.color.unwrap_or(Color::Green), display, padding)?;
        Ok(SteeredColor { problem, phases: c.phases.clone(), exposure: c.exposure })
    };
    hologram.colors.iter().map(part).collect()
}
