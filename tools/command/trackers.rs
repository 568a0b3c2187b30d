//! `eyebox trackers`.

use crate::Failure;
use crate::progress;
use crate::talk;
use crate::values::{HZ, MM, MS, S, Targets, not_negative_in, positive_in, targets};
use clap::{Args, ValueEnum};
use eyebox::low_level::error::{ErrorData, Reason};
use eyebox::low_level::files::{FileError, GrowingFile};
use eyebox::low_level::gaze::place::Counts;
use eyebox::low_level::gaze::{Calibration, Estimator, Eyepiece, Settings};
use eyebox::low_level::reason;
use eyebox::low_level::trackers::hid::{self, Description, DeviceFile};
use eyebox::low_level::trackers::recording::{self, Head, Recording};
use eyebox::low_level::trackers::{Dropped, Event, Options, Sample, Source, Spec, Stream, TrackerError, line, open};
use serde_json::json;
use std::fmt::Write as _;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Whose pupil.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum EyeName {
    /// The left eye's
    Left,
    /// The right eye's
    Right,
    /// The mean of both, or what the tracker has
    Mean,
}

impl From<EyeName> for eyebox::low_level::gaze::Eye {
    fn from(name: EyeName) -> Self {
        match name {
            EyeName::Left => Self::Left,
            EyeName::Right => Self::Right,
            EyeName::Mean => Self::Mean,
        }
    }
}

/// `eyebox trackers`
#[derive(Args)]
pub struct Trackers {
    /// Explain a HID report descriptor: binary, text in hexadecimal, or the first of a recording of hid-recorder
    #[arg(help_heading = "Samples", long, value_name = "FILE", conflicts_with_all = ["watch", "record"])]
    pub describe: Option<PathBuf>,
    /// Show decoded samples, one a line [default source: hid]
    #[arg(help_heading = "Samples", long, value_name = "SOURCE", num_args = 0..=1, default_missing_value = "hid")]
    pub watch: Option<String>,
    /// Record what is watched: FILE.hid (reports, of HID sources), or FILE.jsonl (samples)
    #[arg(help_heading = "Output", long, value_name = "OUT")]
    pub record: Option<PathBuf>,
    /// Seconds to watch [default: until the recording ends, or Ctrl-C]
    #[arg(help_heading = "Samples", long, value_name = "S", value_parser = positive_in(S))]
    pub duration: Option<f64>,
    /// A HID device with a layout of its own, described in a TOML file
    #[arg(help_heading = "Eye", long, value_name = "FILE.toml")]
    pub device_file: Option<PathBuf>,
    /// Time between the eye and the arrival of its sample, ms
    #[arg(help_heading = "Samples", long, value_name = "MS", default_value_t = 0.0, value_parser = not_negative_in(MS))]
    pub latency: f64,
    /// Samples a second of the simulated tracker
    #[arg(help_heading = "Samples", long, value_name = "HZ", default_value_t = 120.0, value_parser = positive_in(HZ))]
    pub rate: f64,
    /// Replay recordings in real time, not as fast as they are read
    #[arg(help_heading = "Samples", long)]
    pub real_time: bool,
    /// Show, for each sample, what becomes of it: its place in the pupil plane, the filter, and the pupil expected after
    /// so many ms
    #[arg(help_heading = "Samples", long, value_name = "MS", num_args = 0..=1, default_missing_value = "20", value_parser = not_negative_in(MS))]
    pub pupil: Option<f64>,
    /// With --pupil: focal length of the display's eyepiece, mm, which makes depths of a focus in dioptres
    #[arg(help_heading = "Samples", long, value_name = "MM", value_parser = positive_in(MM), requires = "pupil")]
    pub focal_length: Option<f64>,
    /// Calibrate the source that is watched for a user: asks to look at each target, and writes the user's file
    #[arg(help_heading = "Calibration", long, value_name = "OUT.toml", conflicts_with_all = ["pupil", "record", "duration", "describe"])]
    pub calibrate: Option<PathBuf>,
    /// With --calibrate: directions of the targets, degrees to the right and down
    #[arg(help_heading = "Calibration", long, value_name = "X,Y;X,Y;...", default_value = "0,0;-8,0;8,0;0,-6;0,6", value_parser = targets)]
    pub targets: Targets,
    /// With --pupil: a user's calibration
    #[arg(help_heading = "Calibration", long, value_name = "FILE.toml", requires = "pupil")]
    pub calibration: Option<PathBuf>,
    /// With --pupil: whose pupil
    #[arg(help_heading = "Calibration", long, value_enum, default_value = "mean")]
    pub eye: EyeName,
    /// JSON on standard output: one object, or one a line
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Lists, describes or watches.
pub fn run(args: &Trackers) -> Result<(), Failure> {
    if let Some(file) = &args.describe {
        return describe(file, args.json);
    }
    match &args.watch {
        Some(source) => watch(args, source),
        None if args.record.is_some() => watch(args, "hid"),
        None => list(args),
    }
}

/// Standard output, of which nobody may be left: `| head` is no mistake.
fn say(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(line.as_bytes())?;
    out.write_all(b"\n")
}

fn said(result: io::Result<()>) -> Result<(), Failure> {
    match result {
        Err(e) if !talk::is_broken_pipe(&e) => {
            Err(Failure::Arguments(reason!("standard-output", "standard output: {e}")))
        }
        _ => Ok(()),
    }
}

fn describe(file: &Path, json: bool) -> Result<(), Failure> {
    let wrong = |reason: String| Failure::from(TrackerError::file(file, reason));
    let bytes = descriptor_of(file)?;
    let description = Description::of(&bytes).map_err(|e| wrong(e.to_string()))?;
    let text = if json {
        serde_json::to_string_pretty(&description).map_err(|e| wrong(e.to_string()))?
    } else {
        description.to_string().trim_end().to_owned()
    };
    said(say(&text))
}

/// The bytes of a descriptor: of a recording, of text in hexadecimal, or the file's own.
fn descriptor_of(file: &Path) -> Result<Vec<u8>, Failure> {
    let wrong = |reason: String| Failure::from(TrackerError::file(file, reason));
    // Enough to tell what it is: a recording may be long.
    let mut start = Vec::new();
    let open = eyebox::low_level::files::read::open(file).map_err(|e| wrong(e.to_string()))?;
    open.take(256 << 10).read_to_end(&mut start).map_err(|e| wrong(e.to_string()))?;
    let Some(text) = std::str::from_utf8(&start).ok().filter(|t| !t.contains('\0')) else { return Ok(start) };
    if text.lines().any(|l| l.starts_with("R:")) {
        let recording = Recording::load(file)?;
        let first = recording.devices.into_iter().map(|d| d.descriptor).find(|d| !d.is_empty());
        return first.ok_or_else(|| wrong("the recording has no descriptor".into()));
    }
    // Listings have remarks behind the bytes.
    let code = |line| -> &str { str::split(line, '#').next().and_then(|l| l.split("//").next()).unwrap_or_default() };
    let words = || text.lines().map(code).flat_map(|l| l.split([' ', '\t', ','])).filter(|w| !w.is_empty());
    let digits = |w: &str| w.trim_start_matches("0x").trim_start_matches("0X").to_owned();
    let is_hex = |w: &str| !w.is_empty() && w.len().is_multiple_of(2) && w.bytes().all(|b| b.is_ascii_hexdigit());
    if words().next().is_some() && words().all(|w| is_hex(&digits(w))) {
        let hex: String = words().map(digits).collect();
        return (0..hex.len() / 2)
            .map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).map_err(|e| wrong(e.to_string())))
            .collect();
    }
    Ok(start)
}

fn list(args: &Trackers) -> Result<(), Failure> {
    let file = args.device_file.as_deref().map(DeviceFile::load).transpose()?;
    let listed = hid::system_bus().and_then(|mut bus| hid::list(bus.as_mut(), file.as_ref()));
    // No HID is no mistake: the other sources are there all the same.
    let (found, problem) = match listed {
        Ok(found) => (found, None),
        Err(e) => (Vec::new(), Some(e.to_string())),
    };
    if args.json {
        let devices: Vec<_> = found
            .iter()
            .map(|d| {
                json!({
                    "path": d.info.path, "vendor": d.info.vendor, "product": d.info.product, "name": d.info.name,
                    "eye_tracker": d.tracker.is_ok(), "reason": d.tracker.as_ref().err().map(ToString::to_string),
                    "rate_hz": d.tracker.as_ref().ok().and_then(|t| t.rate_hz),
                    "notes": d.tracker.as_ref().map(|t| t.notes.clone()).unwrap_or_default(),
                })
            })
            .collect();
        return said(say(&json!({ "hid": devices, "problem": problem, "sources": SOURCES.map(|s| s.0) }).to_string()));
    }
    let mut text = String::new();
    let trackers = found.iter().filter(|d| d.tracker.is_ok()).count();
    match &problem {
        Some(problem) => text += &format!("hid         {problem}\n"),
        None => {
            let _ = writeln!(text, "hid         {trackers} eye trackers among {} HID devices", found.len());
        }
    }
    for d in &found {
        let _ = write!(text, "            {} ({:04x}:{:04x}): ", d.info.name, d.info.vendor, d.info.product);
        match &d.tracker {
            Ok(about) => {
                let rate = about.rate_hz.map_or_else(String::new, |hz| format!("{hz} Hz; "));
                let _ = writeln!(text, "{rate}{}", about.notes.join("; "));
            }
            Err(e) => {
                let _ = writeln!(text, "{e}");
            }
        }
    }
    for (name, what) in SOURCES.iter().skip(1) {
        let _ = writeln!(text, "{name:11} {what}");
    }
    said(say(text.trim_end()))
}

const SOURCES: [(&str, &str); 6] = [
    ("hid", "HID devices of usage page 0x12"),
    ("FILE.hid", "a recording of hid-recorder"),
    ("FILE.jsonl", "recorded samples"),
    ("pupil://", "Pupil Core's network interface: pupil://HOST[:50020]"),
    ("udp://", "lines of JSON in datagrams: udp://:PORT, loopback; udp://HOST:PORT elsewhere"),
    ("simulated", "a simulated eye before a simulated tracker: simulated[:SEED]"),
];

/// A source, on a thread of its own where it goes on by itself.
enum Feed {
    /// As fast as it is read; nothing may be dropped.
    Direct(Box<dyn Source>),
    /// Live.
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
        // Asked before the channel is looked at: what came before the end is still shown.
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

/// What a recording becomes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Hid,
    Lines,
}

/// Writes samples as they come.
struct Recorder {
    out: GrowingFile,
    form: Form,
    /// When the first report came.
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

/// What a source is opened with, in real time.
pub fn options(args: &Trackers) -> Options {
    Options {
        latency: Duration::from_secs_f64((args.latency * 1e-3).min(1e6)),
        device_file: args.device_file.clone(),
        real_time: true,
        rate_hz: args.rate,
    }
}

fn watch(args: &Trackers, source: &str) -> Result<(), Failure> {
    let spec: Spec = source.parse()?;
    let options = Options {
        // For a while that is asked for, a simulated eye need not be waited for.
        real_time: args.real_time || (matches!(spec, Spec::Simulated(_)) && args.duration.is_none()),
        ..options(args)
    };
    let form = args.record.as_deref().map(|file| form(file, &spec)).transpose()?;
    let source = open(&spec, &options)?;
    if matches!(spec, Spec::Recording(_) | Spec::Lines(_)) {
        source.about().notes.iter().for_each(|note| eprintln!("note: {note}"));
    }
    let stored = matches!(spec, Spec::Recording(_) | Spec::Lines(_) | Spec::Simulated(_)) && !options.real_time;
    // Says no before a recording begins.
    let _ = args.pupil.map(|_| estimator(args)).transpose()?;
    let mut feed = if stored { Feed::Direct(source) } else { Feed::Thread(Stream::start(source)?) };
    progress::catch_interrupt();
    let (Some(file), Some(form)) = (&args.record, form) else { return show(args, &mut feed, stored, None) };
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

/// What cannot be recorded is said, and everything else goes on.
fn lost(recorded: Result<(), FileError>) {
    if let Err(error) = recorded {
        let message = format!("{error}; what was recorded until then is kept");
        talk::lose(&message, &ErrorData::of(&Failure::from(error)));
    }
}

/// The way from sample to pupil.
fn estimator(args: &Trackers) -> Result<Estimator, Failure> {
    let calibration = args.calibration.as_deref().map(Calibration::load).transpose()?;
    let depths = [f64::NEG_INFINITY, f64::INFINITY];
    let eyepiece = args.focal_length.map(|mm| Eyepiece { focal_length: mm * 1e-3, depths });
    Ok(Estimator::new(Settings { eye: args.eye.into(), eyepiece, ..Settings::default() }, calibration)?)
}

/// What became of a sample, and the pupil so many milliseconds after its arrival.
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

/// The samples that were refused and dropped, by reason; none if all of them were used.
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

/// The form that a recording's name asks for; says no before anything is opened.
fn form(file: &Path, spec: &Spec) -> Result<Form, Failure> {
    match file.extension().and_then(|e| e.to_str()) {
        Some("hid") if matches!(spec, Spec::Hid | Spec::Recording(_)) => Ok(Form::Hid),
        Some("hid") => Err(Failure::Arguments(reason!(
            "not-hid",
            "{}: only HID sources have reports to record: record this one as .jsonl",
            file.display()
        ))),
        Some("jsonl") => Ok(Form::Lines),
        _ => Err(Failure::Arguments(reason!("ending", "{}: the name must end in .hid or .jsonl", file.display()))),
    }
}

/// Shows samples until the source or the time ends, someone presses ctrl-C, or nobody reads any more.
fn show(args: &Trackers, feed: &mut Feed, stored: bool, mut recorder: Option<&mut Recorder>) -> Result<(), Failure> {
    let mut estimator = args.pupil.map(|ms| Ok::<_, Failure>((estimator(args)?, ms))).transpose()?;
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
                    eprintln!("note: {note} (--watch with --calibrate)");
                }
                // What is not waited for lasts as long as its own times say.
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
        let source = args.watch.as_deref().unwrap_or_default();
        return Err(Failure::Arguments(reason!(
            "no-sample",
            "{source}: no sample came in {:.1} s",
            start.elapsed().as_secs_f64()
        )));
    }
    Ok(())
}
