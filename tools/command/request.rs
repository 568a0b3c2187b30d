//! Makes the request for a solve from its arguments. `solve`, its dry run and `bench` pass on the request alone.

use crate::args::{CameraArgs, EngineArgs, SceneArgs, SettingsArgs, Solve, TilesSettings};
use crate::common;
use crate::experiment::{self, Table, TableOf};
use crate::failure::Failure;
use crate::groups::CameraSettings;
use crate::jod::ViewingArgs;
use crate::quality::{Chosen, QualityArgs};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::optics::{Color, Display, Geometry};
use eyebox::low_level::plan::Storage;
use eyebox::low_level::produce::{GivenSettings, SceneJob, SequenceRequest, TilesRequest, is_larger_than_memory};
use eyebox::low_level::scene::{self, LightField, MovingSplats};
use eyebox::low_level::solve::{Joint, Levels, Method, Optimizer, Settings};
use eyebox::low_level::tiled::MemoryLimit;
use eyebox::low_level::{memory, reason};
use std::path::Path;

/// A request for a solve, with scenes, display, settings, engine and output.
pub struct SolveRequest<'a> {
    /// The display, with the prescription of the eye.
    pub display: Display,
    /// The requested colors of the display.
    pub colors: Vec<Color>,
    /// The named scenes, or the frames of a folder.
    pub scenes: Vec<String>,
    /// Memory, passes and views of a solve region by region. None solves the whole hologram at once.
    pub tiles: Option<TilesRequest>,
    /// The camera for the last steps.
    pub camera: &'a CameraArgs,
    /// The engine and its device.
    pub engine: &'a EngineArgs,
    /// The output file and the form of the report.
    pub report: Report<'a>,
    scene: &'a SceneArgs,
    sequence: SequenceRequest,
    quality: QualityArgs,
    /// The settings of the file and of the options.
    pub given: GivenSettings,
    /// The options of settings.
    pub options: &'a SettingsArgs,
    force: bool,
}

/// The output file and the form of the report.
#[derive(Clone, Copy)]
pub struct Report<'a> {
    /// The file of the hologram or sequence.
    pub out: &'a Path,
    /// Print one JSON object instead of text.
    pub json: bool,
    /// Print the time of each kernel.
    pub timings: bool,
}

impl<'a> SolveRequest<'a> {
    /// Loads the display and finds its colors and the scenes.
    pub fn of(args: &'a Solve) -> Result<Self, Failure> {
        let mut request = Self::at_once(args)?;
        request.tiles = request.tiles(args)?;
        Ok(request)
    }

    /// Returns the request without regions, whatever the memory.
    pub fn at_once(args: &'a Solve) -> Result<Self, Failure> {
        let first = &args.scene.scene;
        let frames = if args.more.is_empty() { scene::sequence(first, &args.scene.options.depth_map)? } else { None };
        let scenes = frames.unwrap_or_else(|| [std::slice::from_ref(first), &args.more].concat());
        let mut display = common::display(&args.display)?;
        args.eye.replace(&mut display.prescription)?;
        display.viewing = args.settings.experiment.table::<ViewingArgs>("viewing")?.over(display.viewing)?;
        let given = given(&args.settings)?.before(display.focal_length)?;
        Ok(Self {
            tiles: None,
            colors: common::colors(&args.display, &display)?,
            display,
            scenes,
            camera: &args.camera,
            engine: &args.engine,
            report: Report { out: &args.out, json: args.json, timings: args.timings },
            scene: &args.scene,
            sequence: SequenceRequest { rate: args.rate.fraction(), start: args.warm_start },
            quality: args.quality,
            given,
            options: &args.settings,
            force: args.display.force,
        })
    }

    /// Prints the settings if they are requested. Returns whether it did.
    pub fn printed(&self) -> Result<bool, Failure> {
        let is_printed = self.options.experiment.is_printed();
        if is_printed {
            let (settings, _) = self.settings(common::engine(self.engine)?.as_ref())?;
            let tables: [TableOf; 3] =
                [("camera", CameraSettings::table), ("tiles", TilesSettings::table), ("viewing", ViewingArgs::table)];
            experiment::print(Some(&settings), &self.given, &tables)?;
        }
        Ok(is_printed)
    }

    /// Returns whether the result is one hologram, solved at once.
    pub fn is_single(&self) -> bool {
        self.scenes.len() == 1 && self.tiles.is_none()
    }

    /// Returns the settings and a note about them. Quality and deadline replace the defaults, and given settings
    /// replace both. The depth range is zero unless it is given, because the scene is not loaded yet.
    pub fn settings(&self, engine: &dyn Engine) -> Result<(Settings, Option<String>), Failure> {
        let (base, given) = (self.base(&self.display)?, &self.given);
        if self.tiles.is_some() {
            // Quality does not apply to a solve in regions.
            return Ok((given.over(&Settings { steps: TilesRequest::STEPS, ..base })?, None));
        }
        let size = [self.display.height, self.display.width];
        let chosen = self.quality.with(given)?.choose(engine, size, base.frames, self.colors.len())?;
        let (chosen, about) = chosen.map(|Chosen { settings, about }| (settings, about)).unzip();
        let mut settings = given.with_quality(&base, chosen.as_ref());
        if chosen.is_none() {
            // Tuned settings keep the storage that they were tuned with.
            settings.storage = engine.preferred_storage().for_levels(self.display.levels as usize);
        }
        if given.has("frames") || given.has("contrast") {
            settings.repeats = 1;
        }
        if self.scene.options.views.is_some() {
            settings.views = 1;
        }
        Ok((given.over(&settings)?, about))
    }

    /// Returns the library's job with these settings.
    pub fn job(&self, settings: Settings) -> Result<SceneJob<'_>, Failure> {
        let mut job = SceneJob {
            scenes: self.scenes.clone(),
            colors: self.colors.clone(),
            reading: self.scene.options.reading(self.display.focal_length),
            force: self.force,
            settings,
            sequence: self.sequence,
            tiles: self.tiles,
            ..SceneJob::new(&self.scene.scene, &self.display)
        };
        job.take_own(&self.given)?;
        Ok(job)
    }

    /// Loads the scene for a display and returns it with its depth range in meters. The device of the engine draws the
    /// views of splats.
    pub fn load(&self, display: &Display, engine: &dyn Engine) -> Result<(LightField, [f64; 2]), Failure> {
        let field = common::scene_on(self.scene, display, &self.colors, engine)?;
        let depth = match self.given.get("depth")? {
            Some(depth) if self.scene.options.depth.is_none() => depth,
            _ => common::depths(self.scene, &field, display)?,
        };
        Ok((field, depth))
    }

    /// Reads splats for a camera that moves.
    pub fn moving_splats(&self, source: &str) -> Result<MovingSplats, Failure> {
        let reading = self.scene.options.reading(self.display.focal_length);
        Ok(MovingSplats::new(source, &reading.request(&self.display, &self.colors, None, self.force))?)
    }

    /// Returns the settings for a display that quality and deadline do not change.
    pub fn base(&self, display: &Display) -> Result<Settings, Failure> {
        let (asked, force) = (self.given.get("diameter")?, self.force || self.given.get("force")?.unwrap_or(false));
        let diameter = common::diameters(asked, display, force)?;
        Ok(self.given.over(&Settings { diameter, depth: [0.0, 0.0], ..Settings::default() })?)
    }
}

impl SolveRequest<'_> {
    /// Returns the request for a solve region by region if memory is limited or too small for the hologram. Sequences
    /// have none.
    fn tiles(&self, args: &Solve) -> Result<Option<TilesRequest>, Failure> {
        if self.scenes.len() > 1 {
            return Ok(None);
        }
        let (given, display) = (&self.given, &self.display);
        let own: TilesSettings = self.options.experiment.table("tiles")?;
        let settings = self.base(display)?;
        let frames = settings.frames;
        let relay = display.geometry == Geometry::Relay;
        // In a relay every pupil sees the whole SLM, so regions do not help.
        args.memory.filter(|_| relay).into_iter().for_each(memory::limit);
        if relay || args.memory.is_none() && !is_larger_than_memory(display, frames) {
            let is_printed = self.options.experiment.is_printed();
            if (own.passes.is_some() || own.picture.is_some()) && !is_printed {
                return Err(Failure::Arguments(reason!(
                    "not-in-tiles",
                    "tiles.passes and tiles.picture are for far fields with --memory. This hologram is solved all at once"
                )));
            }
            return Ok(None);
        }
        // Settings that a solve in regions does not support.
        let other = [
            (settings.method != Method::Slfh, "--method"),
            (settings.levels != Levels::Any, "the setting levels"),
            (matches!(settings.optimizer, Optimizer::Adam { .. }), "the setting optimizer"),
            (settings.storage != Storage::F32, "the setting storage"),
            (settings.seconds.is_some(), "--duration"),
            (settings.psnr.is_some(), "--psnr"),
            (given.has("pupils"), "--pupils"),
        ];
        if let Some((_, name)) = other.iter().find(|other| other.0) {
            return Err(Failure::Arguments(reason!(
                "in-tiles",
                "{name} is not for a hologram that is solved region by region. Leave it out, or take a smaller display"
            )));
        }
        let default = TilesRequest::default();
        Ok(Some(TilesRequest {
            memory: args.memory.map_or(default.memory, MemoryLimit),
            passes: own.passes.unwrap_or(default.passes),
            picture: own.picture.unwrap_or(default.picture),
        }))
    }
}

/// Returns the settings of the file, replaced by the given options.
fn given(options: &SettingsArgs) -> Result<GivenSettings, Failure> {
    let mut given = options.experiment.given()?.clone();
    if given.has("contrast") && options.frames.is_some() {
        let text = "contrast and --frames both decide the number of sub-frames. Leave out one of them";
        return Err(Failure::Arguments(reason!("frames-and-contrast", "{text}")));
    }
    given.insert("frames", options.frames);
    given.insert("joint", options.joint_color.map(|brightness| Joint { brightness }));
    given.insert("method", options.method);
    given.insert("pupils", options.pupils);
    given.insert("steps", options.steps);
    given.insert("seconds", options.duration);
    given.insert("psnr", options.psnr);
    given.insert("diameter", options.pupil_diameter);
    given.insert("seed", options.seed);
    Ok(given)
}
