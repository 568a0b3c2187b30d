//! From the arguments of a solve to its settings.

use crate::args::Solve;
use crate::quality::Chosen;
use crate::{Failure, common};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::produce::{SceneJob, SequenceRequest, TilesRequest};
use eyebox::low_level::reason;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{Joint, Levels, Optimizer, ScenePlan, Settings, even_levels};

/// The settings that the arguments mean, for depths in metres, and what there is to say of them: the defaults, or what
/// quality and deadline ask for; what is given itself wins.
pub fn settings_of(
    args: &Solve,
    engine: &dyn Engine,
    display: &Display,
    depth: [f64; 2],
    colors: usize,
) -> Result<(Settings, Option<String>), Failure> {
    let base = base_of(args, display, depth)?;
    let chosen = args.quality.choose(engine, [display.height, display.width], base.frames, colors)?;
    let adam = |optimizer: &Optimizer| matches!(optimizer, Optimizer::Adam { .. });
    let asked = args.optimizer.map(|o| if adam(&o) { Settings::adam(200, 8) } else { Settings::default() });
    let (quality, about) = match chosen {
        Some(Chosen { settings, about }) => (settings, Some(about)),
        None => (asked.clone().unwrap_or_default(), None),
    };
    let mut settings = base.with_quality_of(&quality);
    if let Some(asked) = asked.filter(|asked| adam(&asked.optimizer) != adam(&settings.optimizer)) {
        (settings.optimizer, settings.diameters) = (asked.optimizer, asked.diameters);
    }
    settings.steps = args.steps.unwrap_or(settings.steps);
    settings.pupils = args.pupils.unwrap_or(settings.pupils);
    settings.window = args.window.unwrap_or(settings.window);
    settings.diameters = args.diameters.unwrap_or(settings.diameters);
    // What was tuned was tuned as it is stored.
    let stored =
        if about.is_some() { settings.storage } else { engine.preferred_storage().for_levels(display.levels as usize) };
    settings.storage = args.storage.unwrap_or(stored);
    settings.padding = args.padding.unwrap_or(settings.padding);
    if args.frames.is_some() || args.speckle.is_some() {
        settings.repeats = 1;
    }
    if args.scene.options.views.is_some() {
        settings.views = 1;
    }
    if let Some(text) = &args.levels {
        settings.levels = Levels::Given(levels(text)?);
    }
    Ok((settings, about))
}

/// The settings of a solve in tiles: no quality decides them.
pub fn of_tiles(args: &Solve, display: &Display) -> Result<Settings, Failure> {
    let base = base_of(args, display, [0.0, 0.0])?;
    Ok(Settings {
        steps: args.steps.unwrap_or(TilesRequest::STEPS),
        window: args.window.unwrap_or(base.window),
        diameters: args.diameters.unwrap_or(base.diameters),
        ..base
    })
}

/// The job that the arguments mean, with the settings that were chosen for it.
pub fn job_of<'a>(
    args: &'a Solve,
    display: &'a Display,
    scenes: Vec<String>,
    colors: Vec<Color>,
    settings: Settings,
    tiles: Option<TilesRequest>,
) -> SceneJob<'a> {
    SceneJob {
        scenes,
        colors,
        reading: args.scene.options.reading(display.focal_length),
        diameter: args.pupil_diameter,
        force: args.display.force,
        settings: Settings { seconds: args.seconds, ..settings },
        full: args.full.unwrap_or_default(),
        contrast: args.speckle,
        sequence: SequenceRequest { rate: args.rate.fraction(), start: args.warm_start },
        tiles,
        ..SceneJob::new(&args.scene.scene, display)
    }
}

/// What of the scene is solved, by these arguments and the settings that they mean.
pub fn plan_of(args: &Solve, settings: &Settings, field: &LightField, display: &Display) -> Result<ScenePlan, Failure> {
    let job = job_of(args, display, vec![args.scene.scene.clone()], field.colors.clone(), settings.clone(), None);
    Ok(job.plan(field)?)
}

/// What is no matter of quality and time, for depths in metres.
pub fn base_of(args: &Solve, display: &Display, depth: [f64; 2]) -> Result<Settings, Failure> {
    Ok(Settings {
        frames: args.frames.unwrap_or(Settings::default().frames),
        joint: args.joint_color.map(|brightness| Joint { brightness }),
        method: args.method,
        first_phases: args.first_phases,
        stft_filter: args.stft_filter,
        stft_samples: args.stft_samples,
        evenness: args.evenness,
        patches: args.patches,
        psnr: args.psnr,
        efficiency: args.efficiency,
        diameter: common::diameters(args.pupil_diameter, display, args.display.force)?,
        depth,
        sequence: args.sequence,
        seed: args.seed,
        ..Settings::default()
    })
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
