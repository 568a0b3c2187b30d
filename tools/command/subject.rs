//! Loads the content that is refined, which is a hologram with its scene, or a scene that is solved first.

use crate::args::{DisplayArgs, EngineArgs, EyeArgs, SceneArgs, SceneOptions, scene_of};
use crate::common::{self, Engines};
use crate::eval::score;
use crate::experiment::ExperimentArgs;
use crate::phases::{BareOpticsArgs, EncodedArgs, PhaseUnitArgs, tell_unfinished};
use crate::quality::QualityArgs;
use crate::solve::SolveProgress;
use crate::{Failure, progress};
use clap::Args;
use eyebox::low_level::encode::Encoder;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::hologram::{ColorHologram, Hologram, Opening, Phases, Sequence, Tiles, Unfinished};
use eyebox::low_level::optics::{Color, Display, PupilDistribution};
use eyebox::low_level::produce::solve_colors;
use eyebox::low_level::quality::ColorJob;
use eyebox::low_level::reason;
use eyebox::low_level::scene::{self, LightField};
use eyebox::low_level::session::{FarField, Field, LiveColor, MovingSequence, Scenes, darkness, whole_eyebox};
use eyebox::low_level::solve::{Levels, Settings};
use std::path::Path;

/// The content, in every command that refines for a tracked pupil.
#[derive(Args)]
pub struct SubjectArgs {
    /// NAME.zarr (a hologram for the whole eyebox or a sequence of them), NAME.npy (phases with --scene), or a scene,
    /// which is solved first
    pub what: String,
    #[command(flatten)]
    pub how: SubjectOptions,
}

/// The options for reading or solving the content.
#[derive(Args, Clone)]
pub struct SubjectOptions {
    /// Scene of a hologram [default: the one it was solved from]
    #[arg(help_heading = "Scene", long, value_name = "SCENE")]
    pub scene: Option<String>,
    #[command(flatten)]
    pub options: SceneOptions,
    /// The display that the content is encoded for. Scenes are solved for it, and bare phases belong to it.
    #[command(flatten)]
    pub display: DisplayArgs,
    #[command(flatten)]
    pub eye: EyeArgs,
    #[command(flatten)]
    pub unit: PhaseUnitArgs,
    /// The quality of the hologram for the whole eyebox, if the content is a scene.
    #[command(flatten)]
    pub quality: QualityArgs,
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// The content after it was loaded.
pub struct Steered {
    /// The hologram for the whole eyebox.
    pub hologram: Hologram,
    pub colors: Vec<Color>,
    /// The problem and the phases of each color.
    pub parts: Vec<LiveColor>,
    /// The scenes that follow, if the scene changes.
    pub scenes: Option<Box<dyn Scenes>>,
    /// The whole of a far field in tiles.
    pub field: Option<Field>,
    /// The encoder to video frames for the SLM.
    pub encoder: Encoder,
    /// The name of the engine.
    pub engine: String,
    /// The progress of a hologram that is not finished.
    pub unfinished: Option<Unfinished>,
}

/// Loads or solves the content. A sequence that is `looped` begins again at its end. `at` chooses one hologram of it.
pub fn load(
    what: &str,
    args: &SubjectOptions,
    (at, looped): (Option<u64>, bool),
    engines: &Engines,
) -> Result<Steered, Failure> {
    let path = Path::new(what);
    if Sequence::is_at(path) || Tiles::is_tiled(path) || is_hologram(path) {
        refuse_quality(what, args)?;
    }
    if at.is_none() && Sequence::is_at(path) {
        return moving(path, args, looped, engines);
    }
    if Tiles::is_tiled(path) {
        return far_field(path, args, engines);
    }
    let (hologram, parts, unfinished) = if is_hologram(path) {
        let unfinished = tell_unfinished(path)?;
        let mut hologram = Opening { at, unfinished: true, ..args.unit.chosen(&args.display)? }.hologram(path)?;
        args.eye.replace(&mut hologram.metadata.prescription)?;
        let optics = score::display_of(path, &hologram)?;
        let mut engine = engines.open()?;
        let input = scene_of(path, &hologram, args.scene.as_deref(), &args.options, args.display.force)?;
        let field = input.drawn_by(engine.as_ref()).light_field()?;
        hologram.fit_exposure(&field, engine.as_mut())?;
        let parts = LiveColor::all_of(&hologram, &field, &optics)?;
        (hologram, parts, unfinished)
    } else {
        if at.is_some() {
            return Err(Failure::Arguments(reason!(
                "at-of-scene",
                "{what} is a scene, and --at is for a sequence. Leave it out"
            )));
        }
        let (hologram, field, display) = solved(what, args, engines)?;
        let parts = LiveColor::all_of(&hologram, &field, &display)?;
        (hologram, parts, None)
    };
    Steered::new(what, args, hologram, parts, engines, unfinished)
}

/// Returns whether the path is a hologram or bare phases, and not a scene.
pub fn is_hologram(path: &Path) -> bool {
    let phases = Phases::are_named_at(path) && (!path.is_file() || scene::may_be_phases(path));
    phases || (!Phases::are_at(path) && !path.join("views").exists())
}

/// Returns whether the content is a hologram, bare phases or video frames, and not a scene. Options of bare phases decide
/// before the name does.
pub fn is_phases(what: &str, how: &SubjectOptions, optics: &BareOpticsArgs, encoded: &EncodedArgs) -> bool {
    let path = Path::new(what);
    how.unit.phase_unit.is_some() || optics.is_given() || encoded.are_at(path) || is_hologram(path)
}

/// Refuses `--quality` for content that is not solved.
pub fn refuse_quality(what: &str, how: &SubjectOptions) -> Result<(), Failure> {
    match how.quality.quality {
        Some(_) => Err(Failure::Arguments(reason!(
            "quality-of-phases",
            "--quality is for a scene that is solved first, and {what} is not a scene. Leave it out"
        ))),
        None => Ok(()),
    }
}

/// Solves a scene for the whole eyebox with `--quality`. Returns the hologram, the scene and the display.
pub fn solved(
    what: &str,
    args: &SubjectOptions,
    engines: &Engines,
) -> Result<(Hologram, LightField, Display), Failure> {
    let mut display = common::display(&args.display)?;
    args.eye.replace(&mut display.prescription)?;
    let mut engine = engines.open()?;
    let (hologram, field) = solved_on(what, args, &display, None, engine.as_mut())?;
    Ok((hologram, field, display))
}

/// Solves a scene for a display on an engine. `frames` replaces the usual number of sub-frames.
pub fn solved_on(
    what: &str,
    args: &SubjectOptions,
    display: &Display,
    frames: Option<usize>,
    engine: &mut dyn Engine,
) -> Result<(Hologram, LightField), Failure> {
    if args.scene.is_some() {
        return Err(Failure::Arguments(reason!("scene-of-scene", "{what} is a scene already. Leave out --scene")));
    }
    let scene = SceneArgs::new(what, &args.options);
    let colors = common::colors(&args.display, display)?;
    let field = common::scene_on(&scene, display, &colors, engine)?;
    let depth = common::depths(&scene, &field, display)?;
    let mut given = args.experiment.given()?.before(display.focal_length)?;
    given.insert("frames", frames);
    let diameter = common::diameters(given.get("diameter")?, display, false)?;
    let base = given.over(&Settings { depth, diameter, ..Settings::default() })?;
    let quality = args.quality.with(&given)?;
    let chosen = quality.choose(engine, [display.height, display.width], base.frames, colors.len())?;
    let settings = given.with_quality(&Settings::default(), chosen.map(|chosen| chosen.settings).as_ref());
    let settings = given.over(&Settings { frames: base.frames, ..settings })?;
    let levels = Levels::of(display);
    let color_job = ColorJob { field: &field, color: colors[0], display, base, levels };
    eprintln!("solving {what} for the whole eyebox: {settings}");
    progress::catch_interrupt();
    let mut watch = SolveProgress::new(false);
    let solved = solve_colors(&color_job, &colors, &settings, engine, &mut |event| watch.see(event))?;
    let padding = color_job.padding(&settings)?;
    let hologram = Hologram::from_solutions(&field, display, &color_job.settings(&settings), padding, &solved)?;
    Ok((hologram, field))
}

/// Loads a sequence, each of whose holograms is refined for the scene that it names.
fn moving(path: &Path, args: &SubjectOptions, looped: bool, engines: &Engines) -> Result<Steered, Failure> {
    let what = path.display().to_string();
    if args.scene.is_some() {
        return Err(Failure::Arguments(reason!(
            "scene-of-sequence",
            "{what} is a sequence, whose holograms name their scenes. Leave out --scene"
        )));
    }
    let unfinished = tell_unfinished(path)?;
    let opening = Opening { unfinished: true, ..args.unit.chosen(&args.display)? };
    let mut sequence = opening.sequence(path)?;
    let mut first = sequence.load(0)?;
    args.eye.replace(&mut first.metadata.prescription)?;
    let (options, eye) = (args.options.clone(), first.metadata.prescription.clone());
    let (force, file) = (args.display.force, path.to_path_buf());
    let load = move |hologram: &Hologram| -> Result<(LightField, Display), String> {
        let mut input = scene_of(&file, hologram, None, &options, force).map_err(|e| e.to_string())?;
        input.display.prescription.clone_from(&eye);
        Ok((input.light_field().map_err(|e| e.to_string())?, input.display))
    };
    let (scenes, parts) = MovingSequence::start(sequence, looped, Box::new(load))?;
    let steered = Steered::new(&what, args, first, parts, engines, unfinished)?;
    Ok(Steered { scenes: Some(Box::new(scenes)), ..steered })
}

/// Diameter of a usual pupil, meters. The first piece is for such a pupil in the middle.
const USUAL_PUPIL: f64 = 4e-3;

/// Loads a far field in tiles, whose piece around the eye is refined.
fn far_field(path: &Path, args: &SubjectOptions, engines: &Engines) -> Result<Steered, Failure> {
    let what = path.display().to_string();
    // It holds its own optics.
    args.unit.chosen(&args.display)?;
    if args.eye.given()?.is_some_and(|eye| !eye.is_perfect()) {
        return Err(Failure::Arguments(reason!(
            "eye-of-tiles",
            "{what}: a hologram in tiles is refined for a perfect eye only"
        )));
    }
    let unfinished = tell_unfinished(path)?;
    let tiles = Tiles::open(path)?;
    let hologram = tiles.about().clone();
    let optics = score::display_of(path, &hologram)?;
    let views = scene_of(path, &hologram, args.scene.as_deref(), &args.options, args.display.force)?.around()?;
    // Until the place of the eye is known, the middle is refined.
    let middle = whole_eyebox(optics.eyebox_min(), [0.0; 2]);
    let usual = middle.diameter.map(|d| d.min(USUAL_PUPIL));
    let first = PupilDistribution { spread: 0.0, diameter: usual, ..middle };
    let (pieces, parts, field) = FarField::start(&what, tiles, views, &first)?;
    let steered = Steered::new(&what, args, hologram, parts, engines, unfinished)?;
    Ok(Steered { scenes: Some(Box::new(pieces)), field: Some(field), ..steered })
}

impl Steered {
    /// Returns dark content with random phases of a number of sub-frames and a seed, before the first scene arrives.
    pub fn dark(
        scene: &str,
        display: &Display,
        colors: Vec<Color>,
        (frames, seed): (usize, u64),
        engine: &dyn Engine,
    ) -> Result<Self, Failure> {
        let encoder = Encoder::new(display, &colors, frames)?;
        let parts = darkness(display, &colors, frames, seed)?;
        let of = |(color, part): (&Color, &LiveColor)| ColorHologram {
            color: Some(*color),
            wavelength: part.problem.optics.wavelength,
            exposure: part.exposure,
            efficiency: part.exposure,
            phases: part.phases.clone(),
        };
        let mut hologram = Hologram::on(display, frames, colors.iter().zip(&parts).map(of).collect());
        hologram.scene = scene.into();
        let engine = engine.describe();
        Ok(Self { hologram, colors, parts, scenes: None, field: None, encoder, engine, unfinished: None })
    }

    fn new(
        what: &str,
        args: &SubjectOptions,
        hologram: Hologram,
        parts: Vec<LiveColor>,
        engines: &Engines,
        unfinished: Option<Unfinished>,
    ) -> Result<Self, Failure> {
        let mut shown =
            common::display_of(args.display.display.as_deref(), args.display.size, args.display.force, &hologram)?;
        if args.display.size.is_none() && args.display.display.is_some() {
            (shown.height, shown.width) = (hologram.height, hologram.width);
        }
        let colors: Vec<Color> = hologram.colors.iter().filter_map(|c| c.color).collect();
        let sent: Vec<Color> = hologram.sent_colors().into_iter().filter_map(|i| hologram.colors[i].color).collect();
        let encoder = Encoder::new(&shown, &sent, hologram.frames)?;
        let ([eh, ew], [h, w]) = (encoder.hologram_size(), [hologram.height, hologram.width]);
        if [eh, ew] != [h, w] {
            let name = &shown.name;
            return Err(Failure::Arguments(reason!(
                "size",
                "{what}: {h}x{w} pixels, but the display '{name}' takes {eh}x{ew}. Give --size, or another --display"
            )));
        }
        let engine = engines.open()?.describe();
        Ok(Self { colors, parts, encoder, engine, hologram, scenes: None, field: None, unfinished })
    }
}
