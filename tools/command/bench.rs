//! `eyebox bench` times a step and each kernel, in turn with another program in the same run.

use crate::Failure;
use crate::args::Bench;
use crate::request::SolveRequest;
use crate::talk::print_report;
use crate::{common, dry, roofline};
use eyebox::low_level::engine::{Engine, machine_rates};
use eyebox::low_level::quality::{ColorJob, Prepared};
use eyebox::low_level::reason;
use eyebox::low_level::solve::{self, FirstPhases, Flow, Levels, Problem, Settings, StartTable};
use serde_json::json;
use std::process::Command;
use std::time::Instant;

/// Number of look-ups of first phases, of which the median is reported.
const LOOKS: usize = 9;
/// Light efficiency for which first phases are looked up.
const EFFICIENCY: f64 = 0.4;

/// Returns the median time of a look-up of first phases, ms, or None if the display has no table. The engine has
/// the buffers of a solve.
fn look_up_ms(problem: &Problem, settings: &Settings, engine: &mut dyn Engine) -> Result<Option<f64>, Failure> {
    if settings.first_phases != FirstPhases::Table || !StartTable::fits(problem) {
        return Ok(None);
    }
    let Some(table) = StartTable::of(problem, settings.frames, &mut |_| true)? else { return Ok(None) };
    let mut times = Vec::new();
    for _ in 0..LOOKS {
        let begun = Instant::now();
        let Some(look_up) = table.look_up(problem, problem.mean / EFFICIENCY) else { return Ok(None) };
        engine.look_up(&look_up)?;
        times.push(begun.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(Some(times[LOOKS / 2]))
}

/// Prints a line. It goes to standard error if the report is JSON.
macro_rules! say_beside {
    ($json:expr, $($text:tt)*) => { if $json { eprintln!($($text)*) } else { println!($($text)*) } };
}

/// Times the steps in rounds, in turn with the other program.
pub fn run(args: &Bench) -> Result<(), Failure> {
    let mut request = SolveRequest::at_once(&args.solve)?;
    if request.printed()? {
        return Ok(());
    }
    request.colors.truncate(1);
    let color = request.colors[0];
    let mut engine = common::engine(request.engine)?;
    request.choose_terms(engine.as_mut())?;
    engine.time_kernels(true);
    let begun = Instant::now();
    let (field, depth) = request.load(&request.display, engine.as_ref())?;
    let (settings, chosen) = request.settings(engine.as_ref())?;
    let (settings, display) = (Settings { depth, ..settings }, &request.display);
    let job = ColorJob { field: &field, color, display, base: settings.clone(), levels: Levels::of(display) };
    let Prepared { problem, settings, .. } = job.prepare(&settings)?;
    settings.check()?;
    let loading = begun.elapsed().as_secs_f64();
    drop(field);
    if args.solve.dry_run {
        return dry::run(args, &request, problem, &settings);
    }
    say_beside!(
        args.solve.json,
        "{}; {} {}x{}, {} sub-frames, {} pupils per step",
        engine.describe(),
        color,
        display.height,
        display.width,
        settings.frames,
        settings.pupils
    );
    chosen.iter().for_each(|about| say_beside!(args.solve.json, "{about}"));
    say_beside!(args.solve.json, "scene loaded in {loading:.2} s");
    let mut steps = Vec::new();
    let mut totals = Vec::new();
    for round in 1..=args.rounds.max(1) {
        if let Some(other) = &args.beside {
            say_beside!(args.solve.json, "round {round}, in turn with {other}");
            let status = Command::new("sh")
                .args(["-c", other])
                .status()
                .map_err(|e| Failure::Arguments(reason!("command", "{other}: {e}")))?;
            if !status.success() {
                return Err(Failure::Arguments(reason!("command", "{other}: ended with {status}")));
            }
        }
        let (mut last, mut times) = (None, Vec::new());
        engine.reset_timings();
        let begun = Instant::now();
        let solution = solve::solve(&problem, &settings, engine.as_mut(), &mut |p| {
            // A step that is followed by a validation includes its time, which the median ignores.
            let now = Instant::now();
            times.extend(last.replace(now).map(|before: Instant| now.duration_since(before).as_secs_f64() * 1e3));
            if p.step == 0 {
                last = None;
            }
            Flow::Continue
        })?;
        times.sort_by(f64::total_cmp);
        let median = times.get(times.len() / 2).copied().unwrap_or(f64::NAN);
        let total = begun.elapsed().as_secs_f64();
        say_beside!(
            args.solve.json,
            "round {round}: step median {median:.2} ms; solve {total:.2} s in all for {} steps, {:.2} dB mean, {:.2} dB worst of the validation pupils",
            solution.steps,
            solution.validation.mean(),
            solution.validation.worst()
        );
        steps.push(median);
        totals.push(total);
    }
    let of_last = |(time, seconds): (_, &f64)| roofline::Parallel { time, seconds: *seconds };
    let parallel = engine.parallel_time().zip(totals.last()).map(of_last);
    let look_up = look_up_ms(&problem, &settings, engine.as_mut())?;
    if let Some(ms) = look_up {
        say_beside!(args.solve.json, "first phases looked up in {ms:.2} ms");
    }
    let timings = engine.timings();
    let kernels = roofline::rows(&timings);
    // The arrays of the limits are not memory of the solve.
    let peak = common::peak_memory_mib();
    let machine = kernels.iter().any(|row| row.bytes > 0.0).then(machine_rates);
    roofline::lines(&kernels, machine).iter().for_each(|line| say_beside!(args.solve.json, "{line}"));
    parallel.iter().for_each(|parallel| say_beside!(args.solve.json, "{parallel}"));
    if args.solve.json {
        print_report(json!({
            "step_ms": steps, "look_up_ms": look_up, "solve_s": totals, "load_s": loading,
            "peak_memory_mib": peak, "kernels": roofline::as_json(&kernels),
            "parallel": parallel.as_ref().map(roofline::Parallel::as_json),
            "machine_per_thread": machine.map(|machine| json!({
                "gb_per_s": machine.memory * 1e-9, "gflop_per_s": machine.arithmetic * 1e-9,
            })),
        }));
    }
    match peak {
        Some(mib) => say_beside!(args.solve.json, "peak memory {mib} MiB"),
        None => say_beside!(args.solve.json, "this system does not report the peak memory"),
    }
    Ok(())
}
