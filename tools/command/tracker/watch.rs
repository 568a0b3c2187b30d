//! `eyebox tracker watch` prints the samples of a tracker, and `eyebox tracker record` writes them.

use super::eye::EyeName;
use super::source::SourceArgs;
use crate::Failure;
use crate::progress;
use crate::show::args::ClockName;
use crate::talk;
use crate::values::{MM, MS, S, not_negative_in, positive_in};
use clap::Args;
use eyebox::low_level::error::{ErrorData, Reason};
use eyebox::low_level::files::{FileError, GrowingFile};
use eyebox::low_level::gaze::place::Counts;
use eyebox::low_level::gaze::{Calibration, Estimator, Eyepiece, Settings};
use eyebox::low_level::reason;
use eyebox::low_level::trackers::recording::{self, Head};
use eyebox::low_level::trackers::{Dropped, Event, Sample, Source, Spec, Stream, TrackerError, line, open};
use serde_json::json;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The arguments of `eyebox tracker watch`.
#[derive(Args)]
pub struct Watch {
    #[command(flatten)]
    pub source: SourceArgs,
    /// Stop after this time, s [default: at the end of the recording, or on ctrl-C]
    #[arg(help_heading = "Samples", long, value_name = "S", value_parser = positive_in(S))]
    pub duration: Option<f64>,
    /// Clock of recordings and of the simulated tracker, which is real, or simulated (as fast as they are read)
    /// [default: simulated, or real for the simulated tracker without --duration]
    #[arg(help_heading = "Samples", long, value_enum, hide_possible_values = true)]
    pub clock: Option<ClockName>,
    /// Print for each sample its place in the pupil plane, the filter, and the pupil predicted after this time, ms
    #[arg(help_heading = "Samples", long, value_name = "MS", num_args = 0..=1, default_missing_value = "20", value_parser = not_negative_in(MS))]
    pub predict: Option<f64>,
    /// Focal length of the display's eyepiece, mm, with --predict. It converts a focus in dioptres to a depth
    #[arg(help_heading = "Samples", long, value_name = "MM", value_parser = positive_in(MM), requires = "predict")]
    pub focal_length: Option<f64>,
    /// Calibration of a user, with --predict
    #[arg(help_heading = "Calibration", long, value_name = "FILE.toml", requires = "predict")]
    pub calibration: Option<PathBuf>,
    /// Eye that is followed, with --predict
    #[arg(help_heading = "Calibration", long, value_enum, default_value = "mean")]
    pub eye: EyeName,
    /// One JSON object per line on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// The arguments of `eyebox tracker record`.
#[derive(Args)]
pub struct Record {
    /// Output file FILE.hid (reports of HID sources) or FILE.jsonl (samples)
    #[arg(help_heading = "Output", short, long, value_name = "OUT")]
    pub out: PathBuf,
    #[command(flatten)]
    pub watch: Watch,
}

/// Prints a line on standard output, and returns its error, because a closed pipe such as `| head` is no failure.
pub fn say(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(line.as_bytes())?;
    out.write_all(b"\n")
}

pub fn said(result: io::Result<()>) -> Result<(), Failure> {
    match result {
        Err(e) if !talk::is_broken_pipe(&e) => {
            Err(Failure::Arguments(reason!("standard-output", "standard output: {e}")))
        }
        _ => Ok(()),
    }
}

/// A source of samples. A live source has a thread of its own.
enum Feed {
    /// A stored source, which is read as fast as possible and drops nothing.
    Direct(Box<dyn Source>),
    Thread(Stream),
}

impl Feed {
    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        let stream = match self {
            Self::Direct(source) => return source.next(timeout),
            Self::Thread(stream) => stream,
        };
        if let Some(note) = stream.note() {
            return Ok(Event::Note(note));
        }
        // The status is read before the channel, so that samples from before the end are still shown.
        let status = stream.status();
        match stream.next_with_report(if status.ended { Duration::ZERO } else { timeout }) {
            Some((sample, report)) => Ok(Event::Sample(sample, report)),
            None if !status.ended => Ok(Event::Nothing),
            None => match status.failure {
                Some(reason) => Err(TrackerError::Setting(Reason::new("tracker", reason))),
                None => Ok(Event::End),
            },
        }
    }

    fn dropped(&self) -> Dropped {
        match self {
            Self::Direct(source) => source.dropped(),
            Self::Thread(stream) => stream.status().source,
        }
    }

    fn tracker(&self) -> Option<String> {
        match self {
            Self::Direct(source) => source.tracker(),
            Self::Thread(stream) => stream.tracker(),
        }
    }

    fn head(&self) -> Option<Head> {
        match self {
            Self::Direct(source) => source.recording_head(),
            Self::Thread(stream) => stream.recording_head(),
        }
    }
}

/// The format of a recording.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Hid,
    Lines,
}

/// Writes samples as they come.
struct Recorder {
    out: GrowingFile,
    form: Form,
    /// The time of the first report.
    first_ns: Option<u64>,
}

impl Recorder {
    fn sample(
        &mut self,
        sample: &Sample,
        report: Option<&[u8]>,
        head: impl FnOnce() -> Option<Head>,
    ) -> Result<(), FileError> {
        if self.form == Form::Lines {
            return self.out.add(|out| writeln!(out, "{}", line::write(sample)));
        }
        let Some(report) = report else { return Ok(()) };
        let (first, head) = match self.first_ns {
            Some(first) => (first, None),
            None => match head() {
                Some(head) => (*self.first_ns.insert(sample.received_ns), Some(head)),
                None => return Ok(()),
            },
        };
        self.out.add(|out| {
            head.map_or(Ok(()), |head| recording::write_head(out, &head))?;
            recording::write_report(out, sample.received_ns.saturating_sub(first) / 1000, report)
        })
    }
}

/// Prints samples of a tracker.
pub fn watch(args: &Watch) -> Result<(), Failure> {
    run(args, None)
}

/// Prints samples and records them.
pub fn record(args: &Record) -> Result<(), Failure> {
    run(&args.watch, Some(&args.out))
}

fn run(args: &Watch, record: Option<&Path>) -> Result<(), Failure> {
    let spec: Spec = args.source.source.parse()?;
    let real_time = match args.clock {
        Some(clock) => clock == ClockName::Real,
        // With a duration, a simulated eye does not need to run in real time.
        None => matches!(spec, Spec::Simulated(_)) && args.duration.is_none(),
    };
    let options = args.source.how.options(real_time);
    let form = record.map(|file| form(file, &spec)).transpose()?;
    let source = open(&spec, &options)?;
    if matches!(spec, Spec::Recording(_) | Spec::Lines(_)) {
        source.about().notes.iter().for_each(|note| eprintln!("note: {note}"));
    }
    let stored = matches!(spec, Spec::Recording(_) | Spec::Lines(_) | Spec::Simulated(_)) && !options.real_time;
    // The estimator is checked before a recording begins.
    let _ = args.predict.map(|_| estimator(args)).transpose()?;
    let mut feed = if stored { Feed::Direct(source) } else { Feed::Thread(Stream::start(source)?) };
    progress::catch_interrupt();
    let (Some(file), Some(form)) = (record, form) else { return show(args, &mut feed, stored, None) };
    let mut recorder = Recorder { out: GrowingFile::new(file)?, form, first_ns: None };
    let shown = show(args, &mut feed, stored, Some(&mut recorder));
    let empty = recorder.out.is_empty();
    lost(recorder.out.finish());
    match shown {
        Ok(()) if empty => {
            Err(Failure::Arguments(reason!("no-report", "{}: no report has come to record", file.display())))
        }
        shown => shown,
    }
}

/// Prints an error of the recording. The rest of the command continues.
fn lost(recorded: Result<(), FileError>) {
    if let Err(error) = recorded {
        let message = format!("{error}; the recording until then is kept");
        talk::lose(&message, &ErrorData::of(&Failure::from(error)));
    }
}

/// Returns the estimator from samples to a pupil.
fn estimator(args: &Watch) -> Result<Estimator, Failure> {
    let calibration = args.calibration.as_deref().map(Calibration::load).transpose()?;
    let depths = [f64::NEG_INFINITY, f64::INFINITY];
    let eyepiece = args.focal_length.map(|mm| Eyepiece { focal_length: mm * 1e-3, depths });
    Ok(Estimator::new(Settings { eye: args.eye.into(), eyepiece, ..Settings::default() }, calibration)?)
}

/// Returns the stages of a sample, and the pupil `ms` milliseconds after its arrival.
fn stages(estimator: &mut Estimator, sample: &Sample, ms: f64, as_json: bool) -> String {
    let stages = estimator.update(sample);
    let light_ns = sample.received_ns.saturating_add((ms * 1e6) as u64);
    let pupil = estimator.predict(light_ns);
    if as_json {
        let mut pupil = json!(pupil);
        pupil["time_ns"] = json!(light_ns);
        json!({ "time_ns": sample.time_ns, "received_ns": sample.received_ns, "stages": stages, "pupil": pupil })
            .to_string()
    } else {
        format!("{:.6} s  {stages}; in {ms} ms {pupil}", sample.time_ns as f64 * 1e-9)
    }
}

/// Returns the counts of refused and dropped samples by reason, or None if all samples were used.
fn summary(dropped: Dropped, counts: Option<Counts>) -> Option<String> {
    let mut parts = Vec::new();
    for (reason, count) in counts.iter().flat_map(Counts::reasons) {
        parts.push(format!("{count} of {} samples refused: {reason}", counts.map_or(0, |c| c.samples())));
    }
    let all = [
        (dropped.messages, "messages without a sample dropped"),
        (dropped.diameters, "impossible diameters dropped"),
        (dropped.clock_sets, "times the clock was set"),
    ];
    parts.extend(all.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")));
    (!parts.is_empty()).then(|| parts.join("; "))
}

/// Returns the format of a recording from the ending of its name, before anything is opened.
fn form(file: &Path, spec: &Spec) -> Result<Form, Failure> {
    match file.extension().and_then(|e| e.to_str()) {
        Some("hid") if matches!(spec, Spec::Hid | Spec::Recording(_)) => Ok(Form::Hid),
        Some("hid") => Err(Failure::Arguments(reason!(
            "not-hid",
            "{}: only HID sources have reports to record. Record this one as .jsonl",
            file.display()
        ))),
        Some("jsonl") => Ok(Form::Lines),
        _ => Err(Failure::Arguments(reason!("ending", "{}: the name must end in .hid or .jsonl", file.display()))),
    }
}

/// Prints samples until the source or the time ends, ctrl-C is pressed, or standard output is closed.
fn show(args: &Watch, feed: &mut Feed, stored: bool, mut recorder: Option<&mut Recorder>) -> Result<(), Failure> {
    let mut estimator = args.predict.map(|ms| Ok::<_, Failure>((estimator(args)?, ms))).transpose()?;
    let start = Instant::now();
    let duration = args.duration.map(|s| Duration::from_secs_f64(s.min(1e9)));
    let mut first_ns = None;
    while !progress::interrupted() {
        if !stored && duration.is_some_and(|d| start.elapsed() >= d) {
            break;
        }
        match feed.next(Duration::from_millis(50))? {
            Event::Sample(sample, report) => {
                if first_ns.is_none()
                    && let (Some((estimator, _)), Some(name)) = (&estimator, feed.tracker())
                    && let Some(note) = estimator.note_on(&name)
                {
                    eprintln!("note: {note} (eyebox tracker calibrate)");
                }
                // The duration of a stored source is measured by the times of its samples.
                let passed = sample.received_ns.saturating_sub(*first_ns.get_or_insert(sample.received_ns));
                if stored && duration.is_some_and(|d| u128::from(passed) >= d.as_nanos()) {
                    break;
                }
                let text = match &mut estimator {
                    Some((estimator, ms)) => stages(estimator, &sample, *ms, args.json),
                    None if args.json => line::write(&sample),
                    None => sample.to_string(),
                };
                if let Some(recorder) = &mut recorder {
                    lost(recorder.sample(&sample, report.as_deref(), || feed.head()));
                }
                match say(&text) {
                    Err(e) if talk::is_broken_pipe(&e) => break,
                    other => said(other)?,
                }
            }
            Event::Note(note) => eprintln!("{note}"),
            Event::Nothing => {
                if let Some(recorder) = &mut recorder {
                    lost(recorder.out.tend());
                }
            }
            Event::End => break,
        }
    }
    if let Some(summary) = summary(feed.dropped(), estimator.map(|(estimator, _)| estimator.counts())) {
        eprintln!("{summary}");
    }
    if first_ns.is_none() {
        let source = &args.source.source;
        return Err(Failure::Arguments(reason!(
            "no-sample",
            "{source}: no sample came in {:.1} s",
            start.elapsed().as_secs_f64()
        )));
    }
    Ok(())
}
