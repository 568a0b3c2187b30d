//! From the arguments of a solve to its settings.

use crate::args::{DiametersName, OptimizerName, PaddingName, SequenceName, Solve};
use crate::quality::Chosen;
use crate::{Failure, common};
use eyebox::engine::Engine;
use eyebox::optics::Display;
use eyebox::quality::Recipe;
use eyebox::scene::LightField;
use eyebox::solve::{Diameters, Optimizer, PaddingRule, ScenePlan, Sequence, Settings, Wish, even_levels};

/// The recipe that the arguments mean, and what there is to say of it: the default, or what quality and deadline ask for;
/// what is given itself wins.
pub fn recipe_of(
    args: &Solve,
    engine: &dyn Engine,
    display: &Display,
    colors: usize,
) -> Result<(Recipe, Option<String>), Failure> {
    let frames = args.frames.unwrap_or(Settings::default().frames);
    let chosen = args.quality.choose(engine, [display.height, display.width], frames, colors)?;
    let (mut recipe, about) = match chosen {
        Some(Chosen { recipe, about }) => (recipe, Some(about)),
        None if args.optimizer == Some(OptimizerName::Adam) => (Recipe::adam(200, 8), None),
        None => (Recipe::default(), None),
    };
    let is_adam = matches!(recipe.optimizer, Optimizer::Adam { .. });
    match args.optimizer {
        Some(OptimizerName::Adam) if !is_adam => {
            let Recipe { optimizer, diameters, .. } = Recipe::adam(1, 1);
            recipe = Recipe { optimizer, diameters, ..recipe };
        }
        Some(OptimizerName::Projection) if is_adam => {
            let Recipe { optimizer, diameters, .. } = Recipe::default();
            recipe = Recipe { optimizer, diameters, ..recipe };
        }
        _ => {}
    }
    recipe.steps = args.steps.unwrap_or(recipe.steps);
    recipe.pupils = args.pupils.unwrap_or(recipe.pupils);
    recipe.window = args.window.unwrap_or(recipe.window);
    recipe.diameters = args.diameters.map_or(recipe.diameters, Diameters::from);
    recipe.storage = args.storage.unwrap_or(recipe.storage);
    if let Some(padding) = args.padding {
        recipe.padding = padding != PaddingName::Never;
    }
    if args.frames.is_some() || args.speckle.is_some() {
        recipe.repeats = 1;
    }
    if args.scene.views.is_some() {
        recipe.views = 1;
    }
    recipe.levels &= args.levels.is_none();
    Ok((recipe, about))
}

/// What of the scene is solved, by these arguments.
pub fn plan_of(args: &Solve, recipe: &Recipe, field: &LightField, display: &Display) -> Result<ScenePlan, Failure> {
    let mut settings = base_of(args, display, common::depths(&args.scene, field, display));
    // All sub-frames that are shown: of which some may repeat is the recipe's.
    Recipe { repeats: 1, ..recipe.clone() }.apply(&mut settings);
    settings.levels = args.levels.as_deref().map(levels).transpose()?;
    let wish = Wish {
        settings: &settings,
        depth: args.scene.depth,
        full: args.full.unwrap_or_default(),
        padding: match args.padding {
            Some(PaddingName::Need) => PaddingRule::Need,
            _ if recipe.padding => PaddingRule::Always,
            _ => PaddingRule::Never,
        },
        contrast: args.speckle,
    };
    let mut plan = ScenePlan::new(field, display, &wish)?;
    plan.settings.seconds = args.seconds.map(|s| s / plan.colors.len() as f64);
    Ok(plan)
}

/// Everything that no recipe decides, for depths in metres.
pub fn base_of(args: &Solve, display: &Display, depth: [f64; 2]) -> Settings {
    Settings {
        frames: args.frames.unwrap_or(Settings::default().frames),
        method: args.method,
        stft_filter: args.stft_filter,
        stft_samples: args.stft_samples,
        evenness: args.evenness,
        patches: args.patches,
        psnr: args.psnr,
        efficiency: args.efficiency,
        diameter: common::diameters(args.pupil_diameter, display),
        depth,
        sequence: if args.sequence == SequenceName::Sobol { Sequence::Sobol } else { Sequence::Random },
        seed: args.seed,
        ..Settings::default()
    }
}

impl From<DiametersName> for Diameters {
    fn from(name: DiametersName) -> Self {
        match name {
            DiametersName::Uniform => Self::Uniform,
            DiametersName::Log => Self::LogUniform,
            DiametersName::Reciprocal => Self::Reciprocal,
        }
    }
}

/// Levels by their number, or from a file.
pub fn levels(text: &str) -> Result<Vec<f64>, Failure> {
    if let Ok(n) = text.parse::<usize>() {
        return Ok(even_levels(n.min(1 << 16)));
    }
    let wrong = |what: String| Failure::Asked(format!("{text}: {what}"));
    let size =
        std::fs::metadata(text).map_err(|e| wrong(format!("neither a number of levels nor a file ({e})")))?.len();
    if size > 1 << 20 {
        return Err(wrong("a file of levels has one phase a line, 256 at most".into()));
    }
    let file = std::fs::read_to_string(text).map_err(|e| wrong(e.to_string()))?;
    let lines = file.lines().map(|l| l.split('#').next().unwrap_or("").trim()).enumerate();
    let phase = |(i, line): (usize, &str)| {
        line.parse::<f64>().map_err(|_| wrong(format!("line {}: '{line}' is not a phase in radians", i + 1)))
    };
    lines.filter(|(_, line)| !line.is_empty()).map(phase).collect()
}

/// The levels that are asked for, or else those of the display; none where they are more than can be told apart.
pub fn levels_of(asked: Option<&str>, display: &Display) -> Result<Option<Vec<f64>>, Failure> {
    match asked {
        Some(text) => levels(text).map(Some),
        None => Ok(Some(display.levels as usize).filter(|n| *n <= 256).map(even_levels)),
    }
}
