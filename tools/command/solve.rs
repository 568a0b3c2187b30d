//! `eyebox solve` solves scenes, writes the holograms and prints the report.

mod camera;
mod progress;

use crate::args::Solve;
use crate::common::{self, Form};
use crate::eval::score::decibels;
use crate::request::{Report, SolveRequest};
use crate::talk::print_report;
use crate::{Failure, plan};
use eyebox::low_level::calibrate::CameraGain;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::optics::{Color, Display, depth_in_words, dioptres};
use eyebox::low_level::produce::{SceneJob, SceneSolution, SolvedHologram, SolvedSequence, SolvedTiles, solve_scene};
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::PupilScore;
use eyebox::low_level::solve::{Solution, Stop};
pub use progress::SolveProgress;
use serde_json::{Value, json};
use std::time::Instant;

/// Solves the scenes, saves the holograms and prints the report.
pub fn run(args: &Solve) -> Result<(), Failure> {
    if args.dry_run {
        return plan::run(args);
    }
    let start = Instant::now();
    let mut request = SolveRequest::of(args)?;
    let report = request.report;
    if request.printed()? {
        return Ok(());
    }
    common::form(report.out, if request.is_single() { &[Form::Zarr, Form::Npy] } else { &[Form::Zarr] })?;
    // The camera opens before any work that takes long.
    let mut say = |line: &str| eprintln!("{line}");
    let mut output = None;
    let camera = camera::open(&request, &mut output, &mut say)?;
    // The engine opens first, because nothing needs to be loaded if there is none.
    let mut engine = common::engine(request.engine)?;
    request.choose_terms(engine.as_mut())?;
    engine.time_kernels(report.timings || report.json);
    let (settings, chosen) = request.settings(engine.as_ref())?;
    let job = request.job(settings)?;
    let mut watch = SolveProgress::of_job(&job, engine.describe(), chosen, report.json);
    let mut solved = solve_scene(&job, Some(report.out), engine.as_mut(), &mut |event| watch.see(event))?;
    if let (SceneSolution::Hologram(solved), Some(camera)) = (&mut solved, camera) {
        let gains = camera::run(report, solved, camera, engine.as_mut())?;
        say_hologram(report, solved, Some(&gains), &request.display, engine.as_ref(), start);
        return camera::trouble(report.out, gains);
    }
    let engine = engine.as_ref();
    match solved {
        SceneSolution::Hologram(solved) => say_hologram(report, &solved, None, &request.display, engine, start),
        SceneSolution::Sequence(solved) => say_sequence(report, &solved, watch.frames(), engine, start)?,
        SceneSolution::Tiles(solved) => say_tiles(report, &solved, &job, engine, start),
        _ => {}
    }
    Ok(())
}

/// Returns the calls and the time of each kernel.
fn timings(engine: &dyn Engine) -> Vec<Value> {
    let one = |t: &eyebox::low_level::plan::Timing| json!({ "kernel": t.kernel.name(), "calls": t.calls, "ms": t.seconds * 1e3 });
    engine.timings().iter().map(one).collect()
}

fn say_hologram(
    report: Report<'_>,
    solved: &SolvedHologram,
    gains: Option<&[CameraGain]>,
    display: &Display,
    engine: &dyn Engine,
    start: Instant,
) {
    let seconds = start.elapsed().as_secs_f64();
    if report.json {
        let about = |(color, s): &(Color, Solution)| {
            json!({
                "color": color, "psnr_mean_db": s.validation.quality().map(|q| q[0]),
                "psnr_worst_db": s.validation.quality().map(|q| q[1]), "exposure": s.exposure, "efficiency": s.efficiency, "steps": s.steps, "step_ms": s.step_seconds * 1e3,
                "seconds": s.seconds, "stopped_by": stop_name(s.stop), "fault": fault(s.stop),
            })
        };
        let colors: Vec<_> = solved.solutions.iter().map(about).collect();
        let padding = solved.plan.padding;
        let mut out = json!({
            "out": report.out.display().to_string(), "engine": engine.describe(), "seconds": seconds, "colors": colors,
            "settings": solved.settings, "padding": [padding.rows, padding.columns], "plan": solved.plan.choices,
            "timings": timings(engine), "peak_memory_mib": common::peak_memory_mib(), "reach": display.reach(),
            "depth_mm": solved.settings.depth.map(|z| z * 1e3),
            "depth_dioptres": solved.settings.depth.map(|z| dioptres(z, display.focal_length)),
        });
        if let Some(joint) = &solved.hologram.metadata.joint_color {
            out["joint_color"] = json!(joint);
            out["brightness"] = json!(joint.brightness());
        }
        if let Some(gains) = gains {
            out["camera"] = gains.iter().map(camera::as_json).collect();
        }
        print_report(out);
        return;
    }
    for (color, s) in &solved.solutions {
        println!(
            "{color:6} {}; exposure {:.3} (efficiency {:.0} %); {} steps in {:.1} s{}",
            match s.validation.quality() {
                Some([mean, worst]) => {
                    format!("{mean:.2} dB mean, {worst:.2} dB worst of {} validation pupils", s.validation.psnr.len())
                }
                None => "no PSNR, since the scene is black in this color".into(),
            },
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
    if let Some(joint) = &solved.hologram.metadata.joint_color {
        let times = joint.brightness();
        println!(
            "all colors at once: white is {times:.2} times brighter than of one color after another by the same lasers"
        );
    }
    gains.into_iter().flatten().for_each(|gain| println!("{}", camera::in_words(gain)));
    if report.timings {
        for t in engine.timings() {
            println!("  {:15} {:8} calls {:10.2} ms", t.kernel.name(), t.calls, t.seconds * 1e3);
        }
    }
    println!("wrote {} after {seconds:.1} s", report.out.display());
}

fn say_sequence(
    report: Report<'_>,
    solved: &SolvedSequence,
    frames: &[Value],
    engine: &dyn Engine,
    start: Instant,
) -> Result<(), Failure> {
    let (out, SolvedSequence { done, count, solved, .. }) = (report.out.display(), *solved);
    let seconds = start.elapsed().as_secs_f64();
    if done < count {
        return Err(Failure::Arguments(reason!(
            "interrupted",
            "interrupted: {out} has {done} of {count} holograms. The same command continues with the next"
        )));
    }
    if solved == 0 {
        println!("{out} is complete: {count} holograms");
    } else if report.json {
        print_report(
            json!({ "out": report.out.display().to_string(), "engine": engine.describe(), "seconds": seconds, "frames": frames }),
        );
    } else {
        println!("wrote {out}: {count} holograms after {seconds:.1} s");
    }
    Ok(())
}

fn say_tiles(report: Report<'_>, solved: &SolvedTiles, job: &SceneJob, engine: &dyn Engine, start: Instant) {
    let (plan, peak, display, colors) = (&solved.plan, common::peak_memory_mib(), job.display, job.colors.len());
    let Some(scores) = &solved.scores else {
        eprintln!("interrupted; the same command continues from here");
        return;
    };
    let summary = scores.summary();
    let ([read, written], seconds) = (solved.moved, start.elapsed().as_secs_f64());
    if report.json {
        let focus = |s: &PupilScore| dioptres(s.pupil.depth, display.focal_length);
        let row =
            |s: &PupilScore| json!({ "pupil_mm": s.pupil.to_mm(), "focus_dioptres": focus(s), "psnr_db": s.psnr });
        let out = json!({
            "out": report.out.display().to_string(), "engine": engine.describe(), "solve_seconds": solved.seconds, "seconds": seconds,
            "psnr_mean_db": summary.map(|s| s.mean), "psnr_worst_db": summary.map(|s| s.worst),
            "pupils": scores.pupils.iter().map(row).collect::<Vec<_>>(), "visits": plan.visits * colors, "views": plan.views,
            "pupils_solved": solved.pupils, "region": [plan.region.rows, plan.region.columns],
            "planned_memory_mib": plan.bytes() >> 20, "peak_memory_mib": peak, "read_mib": read >> 20,
            "written_mib": written >> 20, "settings": plan.settings, "timings": timings(engine), "reach": display.reach(),
            "depth_mm": plan.settings.depth.map(|z| z * 1e3),
            "depth_dioptres": plan.settings.depth.map(|z| dioptres(z, display.focal_length)),
        });
        print_report(out);
        return;
    }
    for score in &scores.pupils {
        let ([x, y, d, _], focus) = (score.pupil.to_mm(), depth_in_words(score.pupil.depth, display.focal_length));
        println!("({x:6.2}, {y:6.2}) mm, {d:.2} mm wide, focused at {focus}: {} dB", decibels(score.psnr));
    }
    println!(
        "{} dB mean, {} dB worst of {} places; {} pupils in {:.1} s; read {} MiB, wrote {} MiB; peak {} MiB",
        decibels(summary.map(|s| s.mean)),
        decibels(summary.map(|s| s.worst)),
        scores.pupils.len(),
        solved.pupils,
        solved.seconds,
        read >> 20,
        written >> 20,
        peak.unwrap_or(0)
    );
    println!("wrote {} after {seconds:.1} s", report.out.display());
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

/// Returns the fault of a step that was not taken, in words.
fn fault(stop: Stop) -> String {
    let Stop::NotFinite { step, kernel } = stop else { return String::new() };
    let first = kernel.map_or("the phases".to_owned(), |k| format!("`{}`", k.name()));
    format!("in step {step}, {first} gave numbers that are not finite; the state before it is kept")
}
