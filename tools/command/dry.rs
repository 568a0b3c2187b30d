//! `eyebox bench --dry-run` records steps without running them and estimates their time on known devices.

use crate::Failure;
use crate::args::Bench;
use crate::request::SolveRequest;
use crate::talk::print_report;
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox::low_level::optics::PupilDistribution;
use eyebox::low_level::plan::{DEVICES, DeviceModel, Estimate};
use eyebox::low_level::scene;
use eyebox::low_level::session::SplatsDryRun;
use eyebox::low_level::solve::{DryRun, Problem, RefineSettings, Settings};
use serde_json::{Value, json};
use std::time::Duration;

/// Standard deviation of the place of an eye, meters.
const SPREAD: f64 = 0.3e-3;

/// Records steps of a solve, or of a refinement if a pupil is given.
pub fn run(args: &Bench, request: &SolveRequest<'_>, problem: Problem, settings: &Settings) -> Result<(), Failure> {
    let device = args.solve.engine.device.device.clone();
    // Any device records the commands that a GPU would receive, because none of them runs.
    let plan_as = if device.is_none() { Some(DeviceKind::Discrete) } else { None };
    let gpu = Gpu::open(&Options { device, allow_cpu: true, record_only: true, plan_as, ..Options::default() })?;
    let count = args.solve.settings.steps.unwrap_or(8).max(2);
    let dry_run = match &args.pupil {
        Some(pupil) => {
            let aim = PupilDistribution::around(&pupil.before(problem.optics.focal_length), SPREAD);
            let (window, seed, storage) = (settings.window, settings.seed, Some(settings.storage));
            let steering = RefineSettings { window, seed, storage, ..RefineSettings::default() };
            DryRun::of_refinement(problem, settings.frames, steering, aim, &gpu, count)?
        }
        None => DryRun::of_solve(&problem, settings, &gpu, count)?,
    };
    let frame = content_frame(request, &gpu)?;
    if args.solve.json {
        print_report(as_json(&dry_run, frame.as_ref()));
    } else {
        print(&dry_run);
        frame.iter().for_each(|frame| print_frame(frame, &dry_run));
    }
    Ok(())
}

/// Records a content frame of splats, if the scene has splats and a device can draw their views.
fn content_frame(request: &SolveRequest<'_>, gpu: &Gpu) -> Result<Option<SplatsDryRun>, Failure> {
    let Some(source) = request.scenes.first().filter(|source| scene::is_splats(source)) else { return Ok(None) };
    let splats = request.moving_splats(source)?;
    match SplatsDryRun::of(&splats, &request.display, &request.colors, gpu)? {
        Ok(frame) => Ok(Some(frame)),
        Err(reason) => {
            tracing::info!("no content frame is recorded, because {reason}");
            Ok(None)
        }
    }
}

/// Returns the time of a content frame on a device, and of a step, ms. The host orders the splats of the next frame
/// meanwhile.
fn frame_and_step_ms(frame: &SplatsDryRun, dry_run: &DryRun, device: &DeviceModel) -> [f64; 2] {
    let [frame, step] =
        [frame.estimate(device).total().max(frame.host), dry_run.estimate(device).total().max(dry_run.host)];
    [frame, step].map(ms)
}

fn print_frame(frame: &SplatsDryRun, dry_run: &DryRun) {
    println!(
        "\nA content frame of {} splats in {} views around a tracked pupil, while the camera moves ({} splats in tiles):",
        frame.splats, frame.views, frame.entries
    );
    println!("{:24} {:>14} {:14.3}", "host, ms", "", frame.host.as_secs_f64() * 1e3);
    println!(
        "{:24} {:>10} {:>11} {:>10} {:>12} {:>10} {:>18}",
        "ms a frame", "memory", "arithmetic", "stages", "submissions", "in all", "frames/s, 1 step"
    );
    for device in &DEVICES {
        let [of_frame, of_step] = frame_and_step_ms(frame, dry_run, device);
        println!("{} {:18.1}", parts_of(device, &frame.estimate(device), of_frame), 1e3 / (of_frame + of_step));
    }
}

/// Returns the parts of an estimate and the time in all, ms.
fn parts_of(device: &DeviceModel, estimate: &Estimate, in_all: f64) -> String {
    let [memory, arithmetic] = [estimate.memory, estimate.arithmetic].map(ms);
    let [stages, submissions] = [estimate.stages, estimate.submissions].map(ms);
    format!("{:24} {memory:10.3} {arithmetic:11.3} {stages:10.3} {submissions:12.3} {in_all:10.3}", device.name)
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// A named count of the first step, and its mean over the later half of the steps.
type Row = (&'static str, u64, f64);

fn rows(dry_run: &DryRun) -> [Row; 12] {
    let first = &dry_run.steps[0];
    let row = |name, of: fn(&eyebox::low_level::solve::DryRunStep) -> u64| (name, of(first), dry_run.mean(of));
    [
        row("dispatches", |s| s.recording.dispatches() as u64),
        row("barriers", |s| s.recording.barriers() as u64),
        row("stages", |s| s.recording.stage_count() as u64),
        row("bytes_read", |s| s.recording.bytes()[0]),
        row("bytes_written", |s| s.recording.bytes()[1]),
        row("submissions", |s| s.recording.submissions() as u64),
        row("waits_before_recording", |s| s.recording.stalls() as u64),
        row("bytes_up", |s| s.counts.uploaded),
        row("bytes_down", |s| s.counts.read_back),
        row("blocks_made", |s| s.counts.blocks),
        row("pipelines_made", |s| s.counts.pipelines),
        row("descriptor_pools_made", |s| s.counts.pools),
    ]
}

fn print(dry_run: &DryRun) {
    println!("{} steps recorded, none run", dry_run.steps.len());
    println!("{:24} {:>14} {:>14}", "a step", "the first", "later half");
    for (name, first, later) in rows(dry_run) {
        println!("{:24} {first:14} {later:14.1}", name.replace('_', " "));
    }
    let slowest = DEVICES[DEVICES.len() - 1];
    for (what, ms) in ["the longest dispatch", "the longest submission"].into_iter().zip(longest_ms(dry_run)) {
        println!("{:24} {:>14} {ms:14.3}", format!("{what}, ms"), slowest.name);
    }
    println!("{:24} {:>14} {:14.3}", "host, ms", "", dry_run.host.as_secs_f64() * 1e3);
    println!("\n{:24} {:>14} {:>14}", "the last, by kernel", "dispatches", "MB");
    let last = dry_run.steps.last().map(|step| step.recording.by_kernel()).unwrap_or_default();
    for (kernel, dispatches, bytes) in last {
        println!("{:24} {dispatches:14} {:14.1}", kernel.name(), bytes as f64 / 1e6);
    }
    println!("\nModeled, while the host works at the same time (within 20 % on the H200, the only one measured):");
    println!(
        "{:24} {:>10} {:>11} {:>10} {:>12} {:>10}",
        "ms a step", "memory", "arithmetic", "stages", "submissions", "in all"
    );
    for device in &DEVICES {
        let estimate = dry_run.estimate(device);
        println!("{}", parts_of(device, &estimate, ms(estimate.total().max(dry_run.host))));
    }
}

/// Returns the times of the longest dispatch and the longest submission of any step on the slowest device, ms.
fn longest_ms(dry_run: &DryRun) -> [f64; 2] {
    let slowest = DEVICES[DEVICES.len() - 1];
    dry_run.steps.iter().fold([0.0; 2], |most, step| {
        let one = slowest.longest(&step.recording).map(|time| time.as_secs_f64() * 1e3);
        [most[0].max(one[0]), most[1].max(one[1])]
    })
}

fn as_json(dry_run: &DryRun, frame: Option<&SplatsDryRun>) -> Value {
    let rows = rows(dry_run).map(|(name, first, later)| (name.to_owned(), json!({ "first": first, "later": later })));
    let devices = DEVICES.iter().map(|device| {
        let estimate = dry_run.estimate(device);
        let parts = json!({
            "memory_ms": ms(estimate.memory),
            "arithmetic_ms": ms(estimate.arithmetic),
            "stages_ms": ms(estimate.stages),
            "submissions_ms": ms(estimate.submissions),
            "with_host_ms": ms(estimate.total().max(dry_run.host)),
        });
        (device.name.to_owned(), parts)
    });
    let kernels = dry_run.steps.last().map(|step| step.recording.by_kernel()).unwrap_or_default();
    let kernels = kernels.into_iter().map(|(kernel, dispatches, bytes)| {
        (kernel.name().to_owned(), json!({ "dispatches": dispatches, "bytes": bytes }))
    });
    let content_frame = frame.map(|frame| {
        let devices = DEVICES.iter().map(|device| {
            let [of_frame, of_step] = frame_and_step_ms(frame, dry_run, device);
            let parts =
                json!({ "with_host_ms": of_frame, "frames_per_second_with_a_step": 1e3 / (of_frame + of_step) });
            (device.name.to_owned(), parts)
        });
        json!({
            "splats": frame.splats,
            "views": frame.views,
            "splats_in_tiles": frame.entries,
            "host_ms": frame.host.as_secs_f64() * 1e3,
            "modelled": Value::Object(devices.collect()),
        })
    });
    json!({
        "content_frame": content_frame,
        "step": Value::Object(rows.into_iter().collect()),
        "longest_dispatch_ms": longest_ms(dry_run)[0],
        "longest_submission_ms": longest_ms(dry_run)[1],
        "host_ms": dry_run.host.as_secs_f64() * 1e3,
        "kernels": Value::Object(kernels.collect()),
        "modelled": Value::Object(devices.collect()),
    })
}
