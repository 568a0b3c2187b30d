//! `eyebox tracker calibrate` fits a user's calibration from looks at targets, one after another.

use super::source::SourceArgs;
use crate::Failure;
use crate::progress;
use crate::values::{Targets, targets};
use clap::Args;
use eyebox::low_level::error::Reason;
use eyebox::low_level::gaze::{Calibration, Fit, Pair, Settings};
use eyebox::low_level::reason;
use eyebox::low_level::trackers::{Reading, Sample, Spec, Stream, Unit, open};
use std::io::{self, BufRead};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time until the eye reaches the target after the prompt was read.
const SETTLE: Duration = Duration::from_millis(300);
/// Time in which the samples of a fixation are taken.
const FIXATION: Duration = Duration::from_millis(600);
/// Time without a sample after which the tracker has failed.
const TRACKER_TIMEOUT: Duration = Duration::from_secs(5);
const MOST_SAMPLES: usize = 10_000;

/// The arguments of `eyebox tracker calibrate`.
#[derive(Args)]
pub struct Calibrate {
    #[command(flatten)]
    pub source: SourceArgs,
    /// Output file of the user's calibration
    #[arg(help_heading = "Output", short, long, value_name = "OUT.toml")]
    pub out: PathBuf,
    /// Directions of the targets, degrees to the right and down
    #[arg(help_heading = "Calibration", long, value_name = "X,Y;X,Y;...", default_value = "0,0;-8,0;8,0;0,-6;0,6", value_parser = targets)]
    pub targets: Targets,
}

/// Prompts the user to look at each target, takes samples, fits, and writes the user's file.
pub fn run(args: &Calibrate) -> Result<(), Failure> {
    let file = &args.out;
    let spec: Spec = args.source.source.parse()?;
    let stream = Stream::start(open(&spec, &args.source.how.options(true))?)?;
    progress::catch_interrupt();
    let radius = Settings::default().radius;
    let mut pairs: [Vec<(Unit, Pair)>; 3] = Default::default();
    let mut enter = io::stdin().lock();
    for (i, [x, y]) in args.targets.0.iter().enumerate() {
        eprintln!("{} of {}: look at ({x}, {y}) degrees and press Enter", i + 1, args.targets.0.len());
        let mut line = String::new();
        let read = enter
            .read_line(&mut line)
            .map_err(|e| Failure::Arguments(reason!("standard-input", "standard input: {e}")))?;
        if read == 0 || progress::interrupted() {
            return Err(Failure::Arguments(reason!(
                "broken-off",
                "the calibration was interrupted: nothing is written"
            )));
        }
        let samples = fixation(&stream)?;
        let pupil = [x, y].map(|degrees| radius * degrees.to_radians().sin());
        let eyes: [fn(&Sample) -> Option<Reading>; 3] = [|s| s.left, |s| s.right, |s| s.combined];
        for (pairs, eye) in pairs.iter_mut().zip(eyes) {
            if let Some((unit, tracker)) = middle(&samples, eye) {
                pairs.push((unit, Pair { tracker, pupil }));
            }
        }
    }
    let [left, right, combined] = pairs.map(|pairs| {
        // An eye that was seen at every target is calibrated.
        let unit = pairs.first()?.0;
        let all: Vec<Pair> = pairs.iter().filter(|p| p.0 == unit).map(|p| p.1).collect();
        (all.len() == args.targets.0.len()).then(|| Fit::new(&all, unit))
    });
    let user = file.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let [left, right, combined] = [left.transpose()?, right.transpose()?, combined.transpose()?];
    let calibration = Calibration { user, tracker: stream.tracker(), left, right, combined };
    let fits = [("left", &calibration.left), ("right", &calibration.right), ("combined", &calibration.combined)];
    if fits.iter().all(|(_, fit)| fit.is_none()) {
        return Err(Failure::Arguments(reason!("no-eye", "no eye was seen at every target: nothing is written")));
    }
    calibration.save(file)?;
    for (name, fit) in fits {
        if let Some(fit) = fit {
            let [used, left_out] = fit.used;
            println!("{name}: {:.2} mm off on average over {used} targets, {left_out} left out", fit.residual * 1e3);
        }
    }
    Ok(())
}

/// Returns the valid samples of the tracker while the eye rests.
fn fixation(stream: &Stream) -> Result<Vec<Sample>, Failure> {
    let asked = Instant::now();
    while asked.elapsed() < SETTLE {
        let _ = stream.next(Duration::from_millis(20));
    }
    let _ = stream.arrived().count();
    let (mut samples, mut first) = (Vec::new(), None::<Instant>);
    loop {
        if let Some(sample) = stream.next(Duration::from_millis(20)).filter(Sample::valid) {
            first.get_or_insert_with(Instant::now);
            samples.push(sample);
        }
        if let Some(note) = stream.note() {
            eprintln!("{note}");
        }
        if first.is_some_and(|at| at.elapsed() >= FIXATION) || samples.len() == MOST_SAMPLES {
            return Ok(samples);
        }
        if let Some(failure) = stream.status().failure {
            return Err(Failure::Arguments(Reason::new("tracker", failure)));
        }
        if (first.is_none() && asked.elapsed() > TRACKER_TIMEOUT) || progress::interrupted() {
            return Err(Failure::Arguments(reason!(
                "no-eye",
                "the tracker saw no eye for five seconds: nothing is written"
            )));
        }
    }
}

/// Returns the median of an eye's valid readings, and their unit.
fn middle(samples: &[Sample], eye: fn(&Sample) -> Option<Reading>) -> Option<(Unit, [f64; 2])> {
    let readings: Vec<Reading> = samples.iter().filter_map(eye).filter(|r| r.valid).collect();
    let unit = readings.first()?.unit;
    let median = |axis: usize| {
        let mut values: Vec<f64> = readings.iter().map(|r| r.position[axis]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    Some((unit, [median(0), median(1)]))
}
