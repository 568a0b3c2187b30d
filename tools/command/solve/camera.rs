//! Runs the last steps of a solve with a camera.

use crate::Failure;
use crate::display::patterns;
use crate::groups::CameraSettings;
use crate::progress::{self, JobBar};
use crate::request::{Report, SolveRequest};
use eyebox::low_level::calibrate::{CalibrateError, CameraBench, CameraCommand, CameraGain, CameraJob, Event};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::hologram::TakenWithCamera;
use eyebox::low_level::produce::SolvedHologram;
use eyebox::low_level::reason;
use eyebox::low_level::session::PatternOutput;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;

/// Opens the bench if a camera is given.
pub fn open<'a>(
    request: &SolveRequest<'a>,
    output: &'a mut Option<PatternOutput>,
    say: &'a mut dyn FnMut(&str),
) -> Result<Option<CameraBench<'a>>, Failure> {
    let args = request.camera;
    let (Some(command), Some(steps)) = (&args.camera, args.camera_steps) else { return Ok(None) };
    if !request.is_single() {
        return Err(Failure::Arguments(reason!(
            "camera-of-many",
            "--camera is for one hologram that is solved all at once. Leave it out, or give one scene and no --memory"
        )));
    }
    progress::catch_interrupt();
    let of_camera: CameraSettings = request.options.experiment.table("camera")?;
    let limit = of_camera.timeout.map(Duration::from_secs_f64);
    let command = CameraCommand { command, keep: args.keep.as_deref(), limit, iris_mm: of_camera.iris };
    let SolveRequest { display, colors, .. } = request;
    *output = args.patterns.open(of_camera.settle, display, colors)?;
    Ok(Some(CameraBench::open(display, colors, &command, steps, patterns::shows(output), say)?))
}

/// Takes the camera's steps of every color. Phases that improved replace the solved ones in the file.
pub fn run(
    report: Report<'_>,
    solved: &mut SolvedHologram,
    mut bench: CameraBench,
    engine: &mut dyn Engine,
) -> Result<Vec<CameraGain>, Failure> {
    let problems = solved.hologram.problems(&solved.field)?;
    let mut gains: Vec<CameraGain> = Vec::new();
    let bar = JobBar::new(report.json);
    let count = problems.len() as f64;
    for (i, (problem, (color, _))) in problems.iter().zip(&solved.solutions).enumerate() {
        if progress::interrupted() || gains.iter().any(|g| g.trouble.is_some()) {
            break;
        }
        let of = &mut solved.hologram.colors[i];
        let job = CameraJob { problem, color: *color, settings: &solved.settings, exposure: of.exposure };
        let mut observe = |event: Event| {
            if let Event::At(what, share) = event {
                bar.show(what, (i as f64 + share) / count);
            }
        };
        gains.push(bench.improve(job, &mut of.phases, engine, &mut observe));
    }
    bar.finish();
    if gains.iter().all(|g| g.trouble.is_none()) {
        bench.close();
    }
    solved.hologram.metadata.camera = gains.iter().map(record).collect();
    if !gains.is_empty() {
        solved.hologram.save(report.out)?;
    }
    Ok(gains)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Returns the PSNR before and after, dB, if the one before was measured.
fn decibels(gain: &CameraGain) -> Option<[f64; 2]> {
    (!gain.before.is_empty()).then(|| [mean(&gain.before), mean(&gain.after)])
}

fn record(gain: &CameraGain) -> TakenWithCamera {
    TakenWithCamera { color: gain.color, steps: gain.kept, pictures: gain.pictures, psnr_db: decibels(gain) }
}

/// Returns the gain as an entry of the JSON report.
pub fn as_json(gain: &CameraGain) -> Value {
    json!({
        "color": gain.color, "steps": gain.taken, "kept_steps": gain.kept, "pictures": gain.pictures,
        "psnr_before_db": gain.before, "psnr_after_db": gain.after,
        "trouble": gain.trouble.as_ref().map(ToString::to_string),
    })
}

/// Returns the gain in words.
pub fn in_words(gain: &CameraGain) -> String {
    let (color, pictures) = (gain.color, gain.pictures);
    let about = format!("{color:6} {} camera steps, {pictures} pictures", gain.taken);
    match decibels(gain) {
        None => format!("{about}, the hologram stays as it was solved"),
        Some([before, _]) if gain.kept == 0 => format!(
            "{about}: pictures that no step used show no gain (they are at {before:.2} dB). The hologram stays as it was solved"
        ),
        Some([before, after]) => {
            format!("{about}: pictures that no step used went from {before:.2} to {after:.2} dB")
        }
    }
}

/// Returns the error that ended the steps, after the hologram is written.
pub fn trouble(out: &Path, gains: Vec<CameraGain>) -> Result<(), Failure> {
    match gains.into_iter().find_map(|g| g.trouble) {
        None => Ok(()),
        Some(CalibrateError::Stopped) => {
            eprintln!("interrupted: {} has the best so far", out.display());
            Ok(())
        }
        Some(error) => {
            eprintln!("{} has the best so far", out.display());
            Err(error.into())
        }
    }
}
