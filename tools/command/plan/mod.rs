//! `eyebox solve --dry-run` prints the plan of a solve with its reasons, time and memory.

mod tiled;

use crate::args::Solve;
use crate::failure::in_options;
use crate::request::SolveRequest;
use crate::talk::print_report;
use crate::{Failure, common, model_terms};
use eyebox::low_level::encode;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::optics::{Color, Display, USUAL_RATE_HZ, dioptres};
use eyebox::low_level::plan::Group;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{Forecast, Loaded, Problem, Rates, ScenePlan, forecast, model_work};
use serde_json::json;

/// Memory of the program if the system does not report it, bytes.
const PROGRAM: u64 = 10 << 20;

/// Plans a solve and prints the plan.
pub fn run(args: &Solve) -> Result<(), Failure> {
    let mut request = SolveRequest::of(args)?;
    if request.printed()? {
        return Ok(());
    }
    let json = request.report.json;
    let mut engine = common::engine(request.engine)?;
    if let Some(tiles) = request.tiles {
        request.choose_terms(engine.as_mut())?;
        return tiled::run(&request, &tiles, engine.as_ref());
    }
    let worth = request.worth(engine.as_mut())?;
    request.keep_terms(&worth);
    let program = common::memory_kib("VmRSS").map_or(PROGRAM, |kib| kib << 10);
    let (field, _) = request.load(&request.display, engine.as_ref())?;
    let loading = common::memory_kib("VmHWM").map_or(0, |kib| kib << 10);
    let (settings, chosen) = request.settings(engine.as_ref())?;
    let plan = request.job(settings)?.plan(&field)?;
    let display = plan.lit(&request.display);
    let slow = encode::flicker(&display, &plan.colors, plan.settings.frames, display.rate_hz.unwrap_or(USUAL_RATE_HZ));
    let timing = |name: &str| {
        if !json {
            eprintln!("timing {name}, once on this machine");
        }
    };
    let rates = Rates::of(engine.as_mut(), plan.settings.storage, args.time_again, timing)?;
    let forecasts = forecasts(&plan, &field, &display, [program, loading], engine.as_ref(), &rates)?;
    let models = models(&plan, &field, &display)?;
    if !json {
        println!("{} on {}, {}x{}", field.name, display.name, display.height, display.width);
        println!("shows {}", display.reach());
        println!("{}; lists are run {}\n", engine.describe(), engine.lists());
        chosen.iter().for_each(|about| println!("{about}\n"));
        say(&plan, &forecasts);
        models.iter().for_each(say_model);
        common::say_model_age(&display);
        worth.iter().for_each(|worth| println!("  {:13}  {}", "", model_terms::in_words(worth)));
        slow.iter().for_each(|slow| println!("  {:13}  {slow}", "flicker"));
    }
    if json {
        let forecast = |(color, f): &(Color, Forecast)| {
            let groups: serde_json::Map<_, _> = Group::ALL
                .iter()
                .zip(f.group_seconds)
                .map(|(g, s)| (format!("{g:?}").to_lowercase(), json!(s * 1e3)))
                .collect();
            let memory: serde_json::Map<_, _> =
                f.memory.iter().map(|(name, bytes)| ((*name).into(), json!(bytes))).collect();
            json!({ "color": color, "step_ms": f.step_seconds * 1e3, "groups_ms": groups, "peak_memory_bytes": f.peak_bytes(), "memory_bytes": memory, "windows": f.windows })
        };
        let out = json!({
            "scene": field.name, "display": display.name, "size": [display.height, display.width],
            "colors": plan.colors, "dark": plan.dark, "choices": plan.choices,
            "views_left_out": plan.outer, "views_merged": plan.merge, "padding": [plan.padding.rows, plan.padding.columns],
            "settings": plan.settings, "forecast": forecasts.iter().map(forecast).collect::<Vec<_>>(),
            "depth_mm": plan.settings.depth.map(|z| z * 1e3),
            "depth_dioptres": plan.settings.depth.map(|z| dioptres(z, display.focal_length)),
            "reach": display.reach(), "flicker": slow, "lists": engine.lists(),
            "model_work": models.iter().map(|(color, work)| json!({ "color": color, "share_of_ideal_step": work })).collect::<Vec<_>>(),
            "model_worth": worth.iter().map(|worth| json!({ "measured": worth, "auto": worth.kept(), "subpixels": worth.subpixels() })).collect::<Vec<_>>(),
        });
        print_report(out);
    }
    Ok(())
}

/// The shares of a step that the terms of the display's model add, color by color.
type ModelWork = (Color, Vec<(&'static str, f64)>);

fn models(plan: &ScenePlan, field: &LightField, display: &Display) -> Result<Vec<ModelWork>, Failure> {
    let left = plan.left(field, display);
    let one = |color: &Color| {
        let problem = Problem::outline(display, *color, plan.padding, left)?;
        Ok((*color, model_work(&problem, &plan.settings)))
    };
    plan.colors.iter().map(one).filter(|of| of.as_ref().map_or(true, |(_, work)| !work.is_empty())).collect()
}

fn say_model((color, work): &ModelWork) {
    let terms: Vec<String> = work.iter().map(|(term, share)| format!("{term} {:+.1} %", share * 100.0)).collect();
    println!("  {:13}  {color}: {} of an ideal display's step", "display model", terms.join(", "));
}

/// Returns one forecast per color.
fn forecasts(
    plan: &ScenePlan,
    field: &LightField,
    display: &Display,
    [program, loading]: [u64; 2],
    engine: &dyn Engine,
    rates: &Rates,
) -> Result<Vec<(Color, Forecast)>, Failure> {
    let all = field.grid[0] * field.grid[1];
    let left = plan.left(field, display);
    let pixels = field.height * field.width;
    let loaded = Loaded {
        // All colors are loaded, and merging makes new views in addition to them.
        values: pixels
            * (field.colors.len() * all
                + if plan.merge > 1 { plan.colors.len() * left.rows * left.columns } else { 0 }),
        program,
        loading,
        memory: engine.memory(),
        done: 0,
    };
    let one = |(done, color): (usize, &Color)| {
        let problem = Problem::outline(display, *color, plan.padding, left)?;
        Ok((*color, forecast(&problem, &plan.settings, rates, Loaded { done, ..loaded })))
    };
    plan.colors.iter().enumerate().map(one).collect()
}

fn say(plan: &ScenePlan, forecasts: &[(Color, Forecast)]) {
    let widest = plan.choices.iter().map(|c| c.value.len()).max().unwrap_or(0).min(28);
    for c in &plan.choices {
        println!("  {:13}  {:widest$}  {}", c.what, c.value, in_options(&c.why));
    }
    let s = &plan.settings;
    println!();
    let mut total = 0.0;
    for (color, f) in forecasts {
        total += f.step_seconds * s.steps as f64;
        let parts: Vec<String> = Group::ALL
            .iter()
            .zip(f.group_seconds)
            .filter(|(_, s)| *s > 0.0)
            .map(|(g, s)| format!("{} {:.1}", format!("{g:?}").to_lowercase(), s * 1e3))
            .collect();
        println!(
            "  {:13}  {:.1} ms a step of {} pupils ({}); windows {} to {}",
            color.to_string(),
            f.step_seconds * 1e3,
            s.pupils,
            parts.join(", "),
            f.windows[0],
            f.windows[1]
        );
    }
    println!("  {:13}  {total:.1} s for {} steps a color, validation and loading beside", "time", s.steps);
    if let Some((_, f)) = forecasts.iter().max_by_key(|(_, f)| f.peak_bytes()) {
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        let parts: Vec<String> = f.memory.iter().map(|(name, b)| format!("{name} {}", mib(*b))).collect();
        println!("  {:13}  {} MiB at its peak ({})", "memory", mib(f.peak_bytes()), parts.join(", "));
    }
}
