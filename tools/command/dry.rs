//! `eyebox bench --dry`: what steps ask of a device, recorded and not run, and what devices would make of them.

use crate::Failure;
use crate::args::Bench;
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox::low_level::optics::PupilDistribution;
use eyebox::low_level::plan::DEVICES;
use eyebox::low_level::solve::{Problem, Rehearsal, Settings, Steering};
use serde_json::{Value, json};

/// How well the place of an eye is known, metres.
const SPREAD: f64 = 0.3e-3;

/// Records steps of a solve, or of a refinement for a pupil where one is given.
pub fn run(args: &Bench, problem: Problem, settings: &Settings) -> Result<(), Failure> {
    let device = args.solve.engine.device.device.clone();
    // Nothing runs, so that any device records what a GPU would get.
    let plan_as = if device.is_none() { Some(DeviceKind::Discrete) } else { None };
    let gpu = Gpu::open(&Options { device, allow_cpu: true, record_only: true, plan_as, ..Options::default() })?;
    let count = args.solve.steps.unwrap_or(8).max(2);
    let rehearsal = match &args.pupil {
        Some(pupil) => {
            let aim = PupilDistribution::around(&pupil.before(problem.optics.focal_length), SPREAD);
            let (window, seed, storage) = (settings.window, settings.seed, Some(settings.storage));
            let steering = Steering { window, seed, storage, ..Steering::default() };
            Rehearsal::of_refinement(problem, settings.frames, steering, aim, &gpu, count)?
        }
        None => Rehearsal::of_solve(&problem, settings, &gpu, count)?,
    };
    if args.solve.json {
        println!("{}", as_json(&rehearsal));
    } else {
        print(&rehearsal);
    }
    Ok(())
}

/// Numbers of a step: of the first one, and the mean of the later half.
type Row = (&'static str, u64, f64);

fn rows(rehearsal: &Rehearsal) -> [Row; 12] {
    let first = &rehearsal.steps[0];
    let row = |name, of: fn(&eyebox::low_level::solve::RehearsedStep) -> u64| (name, of(first), rehearsal.mean(of));
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

fn print(rehearsal: &Rehearsal) {
    println!("{} steps recorded, none run", rehearsal.steps.len());
    println!("{:24} {:>14} {:>14}", "a step", "the first", "later half");
    for (name, first, later) in rows(rehearsal) {
        println!("{:24} {first:14} {later:14.1}", name.replace('_', " "));
    }
    let slowest = DEVICES[DEVICES.len() - 1];
    for (what, ms) in ["the longest dispatch", "the longest submission"].into_iter().zip(longest_ms(rehearsal)) {
        println!("{:24} {:>14} {ms:14.3}", format!("{what}, ms"), slowest.name);
    }
    println!("{:24} {:>14} {:14.3}", "host, ms", "", rehearsal.host.as_secs_f64() * 1e3);
    println!("\n{:24} {:>14} {:>14}", "the last, by kernel", "dispatches", "MB");
    let last = rehearsal.steps.last().map(|step| step.recording.by_kernel()).unwrap_or_default();
    for (kernel, dispatches, bytes) in last {
        println!("{:24} {dispatches:14} {:14.1}", kernel.name(), bytes as f64 / 1e6);
    }
    println!("\nModelled, with the host's time beside (within 20 % on the H200, the only one measured):");
    println!(
        "{:24} {:>10} {:>11} {:>10} {:>12} {:>10}",
        "ms a step", "memory", "arithmetic", "stages", "submissions", "in all"
    );
    for device in &DEVICES {
        let estimate = rehearsal.estimate(device);
        let ms = |time: std::time::Duration| time.as_secs_f64() * 1e3;
        println!(
            "{:24} {:10.3} {:11.3} {:10.3} {:12.3} {:10.3}",
            device.name,
            ms(estimate.memory),
            ms(estimate.arithmetic),
            ms(estimate.stages),
            ms(estimate.submissions),
            ms(estimate.total().max(rehearsal.host))
        );
    }
}

/// What the longest dispatch and the longest submission of any step would take on the slowest device.
fn longest_ms(rehearsal: &Rehearsal) -> [f64; 2] {
    let slowest = DEVICES[DEVICES.len() - 1];
    rehearsal.steps.iter().fold([0.0; 2], |most, step| {
        let one = slowest.longest(&step.recording).map(|time| time.as_secs_f64() * 1e3);
        [most[0].max(one[0]), most[1].max(one[1])]
    })
}

fn as_json(rehearsal: &Rehearsal) -> Value {
    let rows = rows(rehearsal).map(|(name, first, later)| (name.to_owned(), json!({ "first": first, "later": later })));
    let devices = DEVICES.iter().map(|device| {
        let estimate = rehearsal.estimate(device);
        let ms = |time: std::time::Duration| time.as_secs_f64() * 1e3;
        let parts = json!({
            "memory_ms": ms(estimate.memory),
            "arithmetic_ms": ms(estimate.arithmetic),
            "stages_ms": ms(estimate.stages),
            "submissions_ms": ms(estimate.submissions),
            "with_host_ms": ms(estimate.total().max(rehearsal.host)),
        });
        (device.name.to_owned(), parts)
    });
    let kernels = rehearsal.steps.last().map(|step| step.recording.by_kernel()).unwrap_or_default();
    let kernels = kernels.into_iter().map(|(kernel, dispatches, bytes)| {
        (kernel.name().to_owned(), json!({ "dispatches": dispatches, "bytes": bytes }))
    });
    json!({
        "step": Value::Object(rows.into_iter().collect()),
        "longest_dispatch_ms": longest_ms(rehearsal)[0],
        "longest_submission_ms": longest_ms(rehearsal)[1],
        "host_ms": rehearsal.host.as_secs_f64() * 1e3,
        "kernels": Value::Object(kernels.collect()),
        "modelled": Value::Object(devices.collect()),
    })
}
