//! `eyebox solve`.

use crate::Failure;
use crate::args::{DiametersName, OptimizerName, PaddingName, SequenceName, Solve};
use crate::common::{self, Form};
use crate::progress::{self, Bar};
use crate::quality::{self, Chosen};
use crate::solve_sequence;
use crate::tiled;
use eyebox::engine::Engine;
use eyebox::hologram::{self, ColorHologram, Hologram, Metadata};
use eyebox::optics::{Color, Display, Padding};
use eyebox::quality::{Recipe, Reference, Subject};
use eyebox::scene::LightField;
use eyebox::solve::{self, Diameters, Optimizer, PaddingRule, ScenePlan, Sequence, Settings, Solution, Stop, Wish};
use serde_json::json;
use std::time::Instant;

/// Solves, saves, and says what came of it.
pub fn run(args: &Solve) -> Result<(), Failure> {
    if let Some(scenes) = solve_sequence::scenes(args) {
        return solve_sequence::run(args, &scenes);
    }
    let start = Instant::now();
    let display = common::display(&args.display)?;
    if tiled::wants(args, &display)? {
        return tiled::solve(args, &display);
    }
    if args.passes.is_some() || args.picture.is_some() {
        return Err(Failure::Asked("--passes and --picture belong to --memory: this is solved all at once".into()));
    }
    let form = common::form(&args.out, &[Form::Zarr, Form::Npy])?;
    let colors = common::colors(&args.display, &display)?;
    // The engine first: where there is none, nothing needs to be loaded.
    let mut engine = common::engine(&args.engine)?;
    let field = common::scene(&args.scene, &display, &colors)?;
    let (mut recipe, chosen) = recipe_of(args, engine.as_ref(), &display, colors.len())?;
    let plan = plan_of(args, &recipe, &field, &display)?;
    // What the hologram's file remembers of its scene is the scene as it is, not what the plan leaves of it.
    let (grid, cell) = (field.grid, field.cell(&display));
    let field = plan.reduce(field, &display);
    let (colors, padding) = (&plan.colors, plan.padding);
    recipe.follow(&plan.settings, padding);
    // What the recipe is optimised for, if it is: the display's own levels.
    let own = quality::levels_of(None, &display)?;
    let subject =
        Subject { field: &field, color: colors[0], display: &display, base: plan.settings.clone(), levels: own };
    let settings = subject.settings(&recipe);
    settings.check()?;
    if !args.json {
        eprintln!(
            "{}: {} x {} views, {}x{}, depth {:.2}..{:.2} mm",
            field.name,
            grid[0],
            grid[1],
            display.height,
            display.width,
            settings.depth[0] * 1e3,
            settings.depth[1] * 1e3
        );
        for choice in plan.choices.iter().filter(|c| c.saves || (c.what == "padding" && padding != Padding::default()))
        {
            eprintln!("{}: {} ({})", choice.what, choice.value, choice.why);
        }
        eprintln!("engine: {}", engine.describe());
        chosen.iter().for_each(|about| eprintln!("{about}"));
    }
    progress::catch_interrupt();
    let solved = solve_colors(&subject, colors, &recipe, engine.as_mut(), args.json)?;
    let mut hologram = hologram(&field, &display, &settings, padding, &solved);
    hologram.frames = subject.base.frames;
    if chosen.is_some() {
        hologram.metadata.recipe = Some(json!(recipe));
    }
    hologram.metadata.views = Some(grid);
    hologram.metadata.view_pitch_mm = Some(cell * 1e3);
    if let Some(depth) = args.scene.depth.filter(|_| args.scene.depth_map.is_some()) {
        // In the order of the map's values, which the range of depths does not keep.
        hologram.metadata.depth_map_mm = Some(depth.map(|d| d * 1e3));
    }
    match form {
        Form::Zarr => hologram.save(&args.out)?,
        _ => hologram::save_phases(&hologram, &args.out)?,
    }
    let report = |(color, s): &(Color, Solution)| {
        json!({
            "color": color, "psnr_mean_db": s.verdict.mean(), "psnr_worst_db": s.verdict.worst(),
            "exposure": s.exposure, "efficiency": s.efficiency, "steps": s.steps, "step_ms": s.step_seconds * 1e3, "seconds": s.seconds, "stopped_by": stop_name(s.stop), "fault": fault(s.stop),
        })
    };
    let timings: Vec<_> = engine
        .timings()
        .iter()
        .map(|t| json!({ "kernel": t.kernel.name(), "calls": t.calls, "ms": t.seconds * 1e3 }))
        .collect();
    if args.json {
        let colors: Vec<_> = solved.iter().map(report).collect();
        let out = json!({
            "out": args.out, "engine": engine.describe(), "seconds": start.elapsed().as_secs_f64(), "colors": colors,
            "settings": settings, "padding": [padding.rows, padding.columns], "plan": plan.choices, "timings": timings,
            "peak_memory_mib": common::peak_memory_mib(),
        });
        println!("{out}");
        return Ok(());
    }
    for (color, s) in &solved {
        println!(
            "{color:6} {:.2} dB mean, {:.2} dB worst of {} held-out pupils; exposure {:.3} (efficiency {:.0} %); {} steps in {:.1} s{}",
            s.verdict.mean(),
            s.verdict.worst(),
            s.verdict.psnr.len(),
            s.exposure,
            100.0 * s.efficiency,
            s.steps,
            s.seconds,
            match s.stop {
                Stop::Asked => ", interrupted".to_owned(),
                Stop::NotFinite { .. } => format!("; stopped: {}", fault(s.stop)),
                _ => String::new(),
            }
        );
    }
    if args.timings {
        for t in engine.timings() {
            println!("  {:15} {:8} calls {:10.2} ms", t.kernel.name(), t.calls, t.seconds * 1e3);
        }
    }
    println!("wrote {} after {:.1} s", args.out.display(), start.elapsed().as_secs_f64());
    Ok(())
}

/// Every colour in turn. Once interrupted, the colours that are left get one step each, so that the file is whole.
pub fn solve_colors(
    subject: &Subject,
    colors: &[Color],
    recipe: &Recipe,
    engine: &mut dyn Engine,
    quiet: bool,
) -> Result<Vec<(Color, Solution)>, Failure> {
    let mut solved = Vec::new();
    for &color in colors {
        let subject = Subject { color, ..subject.clone() };
        let bar = Bar::new(color.to_string(), recipe.steps, quiet);
        let mut solution = subject.solve(recipe, engine, &mut |p| bar.show(p))?.solution;
        if recipe.reduces() {
            // Its own verdict is about less than the problem.
            let reference = Reference::new(&subject, subject.base.seed, engine)?;
            solution.verdict = reference.judge(&solution.phases, engine)?;
            if recipe.pixel > 1 {
                solution.exposure = solution.verdict.exposure;
            }
        }
        bar.finish(format!("{:.1} dB", solution.verdict.mean()));
        solved.push((color, solution));
    }
    Ok(solved)
}

/// The hologram of solved colours.
pub fn hologram(
    field: &LightField,
    display: &Display,
    settings: &Settings,
    padding: Padding,
    solved: &[(Color, Solution)],
) -> Hologram {
    let color = |(color, s): &(Color, Solution)| ColorHologram {
        color: Some(*color),
        wavelength: display.wavelengths.iter().find(|w| w.color == *color).map_or(0.0, |w| w.wavelength),
        exposure: s.exposure,
        efficiency: s.efficiency,
        phases: s.phases.clone(),
    };
    Hologram {
        seed: settings.seed,
        version: env!("CARGO_PKG_VERSION").into(),
        scene: field.name.clone(),
        metadata: Metadata {
            solve: Some(settings.clone()),
            padded: Some([padding.rows, padding.columns]),
            views: Some(field.grid),
            view_pitch_mm: Some(field.cell(display) * 1e3),
            eyebox_mm: Some(display.eyebox_min() * 1e3),
            ..Metadata::default()
        },
        ..Hologram::on(display, settings.frames, solved.iter().map(color).collect())
    }
}

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
        return Ok(solve::even_levels(n.min(1 << 16)));
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

fn stop_name(stop: Stop) -> &'static str {
    match stop {
        Stop::Steps => "steps",
        Stop::Seconds => "seconds",
        Stop::Quality => "psnr",
        Stop::Asked => "interrupt",
        Stop::NotFinite { .. } => "not-finite",
    }
}

/// What went wrong in a step that was not taken.
fn fault(stop: Stop) -> String {
    let Stop::NotFinite { step, kernel } = stop else { return String::new() };
    let first = kernel.map_or("the phases".to_owned(), |k| format!("`{}`", k.name()));
    format!("in step {step}, {first} gave numbers that are not finite; the state before it is kept")
}
