//! The request for a solve that its arguments make. `solve`, `plan` and `bench` pass it on, and not the arguments.

use crate::args::{CameraArgs, EngineArgs, SceneArgs, SettingsArgs, Solve};
use crate::common;
use crate::failure::Failure;
use crate::quality::{Chosen, QualityArgs};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::optics::{Color, Display, Geometry};
use eyebox::low_level::plan::Storage;
use eyebox::low_level::produce::{SceneJob, SequenceRequest, TilesRequest, is_larger_than_memory};
use eyebox::low_level::scene::{self, LightField};
use eyebox::low_level::solve::{Joint, Levels, Method, Optimizer, Settings, even_levels};
use eyebox::low_level::tiled::MemoryLimit;
use eyebox::low_level::{memory, reason};
use std::path::Path;

/// A request for a solve: scenes, display, settings, engine and output.
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
    /// The settings as they were given.
    pub given: &'a SettingsArgs,
    levels: Option<Vec<f64>>,
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
        request.tiles = tiles(args, &request.scenes, &request.display)?;
        Ok(request)
    }

    /// Returns the request without regions, whatever the memory.
    pub fn at_once(args: &'a Solve) -> Result<Self, Failure> {
        let first = &args.scene.scene;
        let frames = if args.more.is_empty() { scene::sequence(first, &args.scene.options.depth_map)? } else { None };
        let scenes = frames.unwrap_or_else(|| [std::slice::from_ref(first), &args.more].concat());
        let mut display = common::display(&args.display)?;
        args.eye.replace(&mut display.prescription)?;
        display.viewing = args.settings.viewing.over(display.viewing)?;
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
            given: &args.settings,
            levels: args.settings.levels.as_deref().map(levels).transpose()?,
            force: args.display.force,
        })
    }

    /// Returns whether the result is one hologram, solved at once.
    pub fn is_single(&self) -> bool {
        self.scenes.len() == 1 && self.tiles.is_none()
    }

    /// Returns the settings and a note about them. Quality and deadline replace the defaults, and given settings replace both. The
    /// depth range is zero, because the scene is not loaded yet.
    pub fn settings(&self, engine: &dyn Engine) -> Result<(Settings, Option<String>), Failure> {
        let (base, given) = (self.base(&self.display)?, self.given);
        if self.tiles.is_some() {
            // Quality does not apply to a solve in regions.
            let (steps, window) = (given.steps.unwrap_or(TilesRequest::STEPS), given.window.unwrap_or(base.window));
            let diameters = given.diameters.unwrap_or(base.diameters);
            return Ok((Settings { steps, window, diameters, ..base }, None));
        }
        let size = [self.display.height, self.display.width];
        let chosen = self.quality.choose(engine, size, base.frames, self.colors.len())?;
        let adam = |optimizer: &Optimizer| matches!(optimizer, Optimizer::Adam { .. });
        let asked = given.optimizer.map(|o| if adam(&o) { Settings::adam(200, 8) } else { Settings::default() });
        let (quality, about) = match chosen {
            Some(Chosen { settings, about }) => (settings, Some(about)),
            None => (asked.clone().unwrap_or_default(), None),
        };
        let mut settings = base.with_quality_of(&quality);
        if let Some(asked) = asked.filter(|asked| adam(&asked.optimizer) != adam(&settings.optimizer)) {
            (settings.optimizer, settings.diameters) = (asked.optimizer, asked.diameters);
        }
        settings.steps = given.steps.unwrap_or(settings.steps);
        settings.pupils = given.pupils.unwrap_or(settings.pupils);
        settings.window = given.window.unwrap_or(settings.window);
        settings.diameters = given.diameters.unwrap_or(settings.diameters);
        // Tuned settings keep the storage that they were tuned with.
        let preferred = engine.preferred_storage().for_levels(self.display.levels as usize);
        let stored = if about.is_some() { settings.storage } else { preferred };
        settings.storage = given.storage.unwrap_or(stored);
        settings.padding = given.padding.unwrap_or(settings.padding);
        if given.frames.is_some() || given.speckle.is_some() {
            settings.repeats = 1;
        }
        if self.scene.options.views.is_some() {
            settings.views = 1;
        }
        if let Some(levels) = &self.levels {
            settings.levels = Levels::Given(levels.clone());
        }
        Ok((settings, about))
    }

    /// Returns the library's job with these settings.
    pub fn job(&self, settings: Settings) -> SceneJob<'_> {
        SceneJob {
            scenes: self.scenes.clone(),
            colors: self.colors.clone(),
            reading: self.scene.options.reading(self.display.focal_length),
            diameter: self.given.pupil_diameter,
            force: self.force,
            settings: Settings { seconds: self.given.seconds, ..settings },
            full: self.given.full.unwrap_or_default(),
            contrast: self.given.speckle,
            sequence: self.sequence,
            tiles: self.tiles,
            ..SceneJob::new(&self.scene.scene, &self.display)
        }
    }

    /// Loads the scene for a display and returns it with its depth range in meters.
    pub fn load(&self, display: &Display) -> Result<(LightField, [f64; 2]), Failure> {
        let field = common::scene(self.scene, display, &self.colors)?;
        let depth = common::depths(self.scene, &field, display)?;
        Ok((field, depth))
    }

    /// Returns the settings for a display that quality and deadline do not change.
    pub fn base(&self, display: &Display) -> Result<Settings, Failure> {
        let given = self.given;
        Ok(Settings {
            frames: given.frames.unwrap_or(Settings::default().frames),
            joint: given.joint_color.map(|brightness| Joint { brightness }),
            method: given.method,
            first_phases: given.first_phases,
            stft_filter: given.stft_filter,
            stft_samples: given.stft_samples,
            evenness: given.evenness,
            patches: given.patches,
            psnr: given.psnr,
            efficiency: given.efficiency,
            diameter: common::diameters(given.pupil_diameter, display, self.force)?,
            depth: [0.0, 0.0],
            sequence: given.sequence,
            seed: given.seed,
            ..Settings::default()
        })
    }
}

/// Returns the request for a solve region by region if memory is limited or too small for the hologram. Sequences have none.
fn tiles(args: &Solve, scenes: &[String], display: &Display) -> Result<Option<TilesRequest>, Failure> {
    if scenes.len() > 1 {
        return Ok(None);
    }
    let given = &args.settings;
    let frames = given.frames.unwrap_or(Settings::default().frames);
    let relay = display.geometry == Geometry::Relay;
    // In a relay every pupil sees the whole SLM, so regions do not help.
    args.memory.filter(|_| relay).into_iter().for_each(memory::limit);
    if relay || args.memory.is_none() && !is_larger_than_memory(display, frames) {
        if args.passes.is_some() || args.picture.is_some() {
            return Err(Failure::Arguments(reason!(
                "not-in-tiles",
                "--passes and --picture are for far fields with --memory: this is solved all at once"
            )));
        }
        return Ok(None);
    }
    // Settings that a solve in regions does not support.
    let other = [
        (given.method != Method::Slfh, "--method"),
        (given.levels.is_some(), "--levels"),
        (matches!(given.optimizer, Some(Optimizer::Adam { .. })), "--optimizer adam"),
        (given.storage.is_some_and(|s| s != Storage::F32), "--storage fp16"),
        (given.seconds.is_some(), "--seconds"),
        (given.psnr.is_some(), "--psnr"),
        (given.pupils.is_some(), "--pupils"),
    ];
    if let Some((_, name)) = other.iter().find(|other| other.0) {
        return Err(Failure::Arguments(reason!(
            "in-tiles",
            "{name} is not for a hologram that is solved region by region: leave it out, or take a smaller display"
        )));
    }
    let default = TilesRequest::default();
    Ok(Some(TilesRequest {
        memory: args.memory.map_or(default.memory, MemoryLimit),
        passes: args.passes.unwrap_or(default.passes),
        picture: args.picture.unwrap_or(default.picture),
    }))
}

/// Levels by their number, or from a file.
fn levels(text: &str) -> Result<Vec<f64>, Failure> {
    if let Ok(n) = text.parse::<usize>() {
        return Ok(even_levels(n.min(1 << 16)));
    }
    let wrong = |what: String| Failure::Arguments(reason!("levels", "{text}: {what}"));
    let size =
        std::fs::metadata(text).map_err(|e| wrong(format!("neither a number of levels nor a file ({e})")))?.len();
    if size > 1 << 20 {
        return Err(wrong("a file of levels has one phase a line, 256 at most".into()));
    }
    let file = eyebox::low_level::files::read::text(text.as_ref(), eyebox::low_level::files::read::TEXT)
        .map_err(|e| wrong(e.to_string()))?;
    let lines = file.lines().map(|l| l.split('#').next().unwrap_or("").trim()).enumerate();
    let phase = |(i, line): (usize, &str)| {
        line.parse::<f64>().map_err(|_| wrong(format!("line {}: '{line}' is not a phase in radians", i + 1)))
    };
    lines.filter(|(_, line)| !line.is_empty()).map(phase).collect()
}

/// The levels that are asked for, or else those of the display.
pub fn levels_of(asked: Option<&str>, display: &Display) -> Result<Levels, Failure> {
    asked.map_or(Ok(Levels::of(display)), |text| levels(text).map(Levels::Given))
}
