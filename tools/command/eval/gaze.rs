//! `eyebox eval gaze` measures the gain of pupil steering for a simulated eye.

use super::content::{self, ContentArgs};
use crate::Failure;
use crate::args::OverwriteArgs;
use crate::common::{self, Engines};
use crate::experiment::Table;
use crate::jod::{JodArgs, JudgedPupils, ViewingArgs};
use crate::phases::AtArgs;
use crate::progress::{self, JobBar};
use crate::subject::{self, Steered, SubjectArgs};
use crate::talk::print_report;
use crate::values::{HZ, MM, MS, S, depth, not_negative, not_negative_in, positive_in, share};
use clap::Args;
use eyebox::low_level::files::{self, ManagedDir};
use eyebox::low_level::gpu::Options as VulkanOptions;
use eyebox::low_level::hologram::Sequence;
use eyebox::low_level::optics::{Depth, Display, depth_in_words, dioptres};
use eyebox::low_level::reason;
use eyebox::low_level::session::{Cost, Policy, SetTiming};
use eyebox::low_level::solve::Flow;
use eyebox::low_level::trackers::simulated;
use eyebox_lab::report;
use eyebox_lab::study::{self, Judging, Study, StudySettings};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The arguments of `eyebox eval gaze`.
#[derive(Args)]
pub struct Gaze {
    #[command(flatten)]
    pub subject: SubjectArgs,
    #[command(flatten)]
    pub which: AtArgs,
    /// Output folder of the plot and the numbers
    #[arg(help_heading = "Output", short, long, default_value = "study", value_name = "OUT_DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Stop after this time of the eye, s
    #[arg(help_heading = "Time", long, default_value_t = 6.0, value_name = "S", value_parser = positive_in(S))]
    pub duration: f64,
    /// Samples per second of the tracker
    #[arg(help_heading = "Eye", long, default_value_t = 120.0, value_name = "HZ", value_parser = positive_in(HZ))]
    pub tracker_rate: f64,
    /// Focus of the eye, mm, or dioptres as in 0.5D
    #[arg(help_heading = "Eye", long, default_value = "0", value_name = "MM|D", value_parser = depth)]
    pub focus: Depth,
    /// The ends of fixations that are judged in JOD.
    #[command(flatten)]
    pub seen: JodArgs,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// The table `gaze` of the settings.
#[derive(Args)]
pub struct GazeSettings {
    /// Sets per second of the display
    #[arg(long, default_value_t = 60.0, value_name = "HZ", value_parser = positive_in(HZ))]
    pub set_rate: f64,
    /// Duration of a fixation of the eye, ms
    #[arg(help_heading = "Eye", long, default_value_t = 300.0, value_name = "MS", value_parser = positive_in(MS))]
    pub fixation: f64,
    /// Share of fixations that become a pursuit
    #[arg(help_heading = "Eye", long, default_value_t = 0.0, value_name = "SHARE", value_parser = share)]
    pub pursuit: f64,
    /// Blinks of the eye per minute
    #[arg(help_heading = "Eye", long, default_value_t = 0.0, value_name = "N", value_parser = not_negative)]
    pub blinks: f64,
    /// Delay of the tracker, ms
    #[arg(help_heading = "Eye", long, default_value_t = 8.0, value_name = "MS", value_parser = not_negative_in(MS))]
    pub tracker_delay: f64,
    /// Noise of the tracker, mm
    #[arg(help_heading = "Eye", long, default_value_t = 0.1, value_name = "MM", value_parser = not_negative_in(MM))]
    pub tracker_noise: f64,
    /// Seed of the simulated eye
    #[arg(help_heading = "Eye", long, default_value_t = 0, value_name = "S")]
    pub eye_seed: u64,
    /// Time of a step of one color, ms, for one result on every machine [default: the time on this machine]
    #[arg(help_heading = "Eye", long, value_name = "MS", value_parser = positive_in(MS))]
    pub step_time: Option<f64>,
    /// Time of encoding a set with step_time, ms
    #[arg(help_heading = "Eye", long, default_value_t = 1.0, value_name = "MS", value_parser = positive_in(MS))]
    pub encode_time: f64,
    #[command(flatten)]
    pub content: ContentArgs,
}

impl Gaze {
    fn settings(&self, table: &GazeSettings, focal_length: f64) -> StudySettings {
        let mut settings = StudySettings { seconds: self.duration, ..StudySettings::default() };
        settings.period_ns = (1e9 / table.set_rate) as i64;
        settings.lead_ns = SetTiming::usual_lead_ns(settings.period_ns);
        settings.light_after_ns = settings.period_ns / 2;
        settings.eye = simulated::Settings {
            seed: table.eye_seed,
            rate_hz: self.tracker_rate,
            delay: table.tracker_delay * 1e-3,
            noise: table.tracker_noise * 1e-3,
            fixation: [table.fixation * 1e-3; 2],
            pursuit: table.pursuit,
            blinks: table.blinks,
            ..simulated::Settings::default()
        };
        let time = |ms: f64| Duration::from_secs_f64((ms * 1e-3).min(1e3));
        if let Some(step) = table.step_time {
            settings.cost = Cost::Fixed { step: time(step), encode: time(table.encode_time) };
        }
        settings.gaze.focus = [self.focus.metres(focal_length); 2];
        settings
    }
}

/// Studies a simulated eye and prints the results.
pub fn run(args: &Gaze) -> Result<(), Failure> {
    if args.subject.how.experiment.printed(&[("gaze", GazeSettings::table), ("viewing", ViewingArgs::table)])? {
        return Ok(());
    }
    let table: GazeSettings = args.subject.how.experiment.table("gaze")?;
    let viewing: ViewingArgs = args.subject.how.experiment.table("viewing")?;
    let policy = args.subject.how.experiment.policy()?;
    let mut own = ManagedDir::open(&args.out, &report::STUDY, args.overwrite.overwrite)?;
    let engines = Engines::new(&args.subject.how.engine, &VulkanOptions::default())?;
    let subject = subject::load(&args.subject.what, &args.subject.how, (args.which.at, true), &engines)?;
    if subject.scenes.is_some() {
        let what = &args.subject.what;
        return Err(Failure::Arguments(if Sequence::is_at(Path::new(what)) {
            reason!("sequence", "{what} is a sequence. `eval gaze` takes one of its holograms, such as --at 0")
        } else {
            reason!(
                "tiles",
                "{what} is a far field in tiles, which `eval gaze` does not take. Give a hologram that is not in tiles, or a scene"
            )
        }));
    }
    let focal_length = subject.hologram.focal_length;
    let mut settings = args.settings(&table, focal_length);
    if args.seen.jod != JudgedPupils::None {
        let display = subject.hologram.made_for()?;
        let viewing = viewing.over(display.viewing)?;
        let pixels_per_degree = Display { viewing, ..display }.pixels_per_degree();
        settings.judging = Some(Judging { viewing, pixels_per_degree, colors: subject.colors.clone() });
    }
    let focus = settings.gaze.focus[0];
    if !args.json {
        eprintln!(
            "{}: {}, {}, {}x{}, the eye focused at {}; {}",
            subject.hologram.scene,
            common::counted(subject.hologram.frames, "sub-frame"),
            common::counted(subject.colors.len(), "color"),
            subject.hologram.height,
            subject.hologram.width,
            depth_in_words(focus, focal_length),
            subject.engine
        );
    }
    let mut all = json!({
        "what": args.subject.what, "scene": subject.hologram.scene, "engine": subject.engine,
        "colors": subject.colors, "size": [subject.hologram.height, subject.hologram.width],
        "frames": subject.hologram.frames, "policy": policy, "unfinished": subject.unfinished, "out": args.out.display().to_string(),
        "eye": { "seed": table.eye_seed, "rate_hz": args.tracker_rate, "delay_ms": table.tracker_delay,
                 "noise_mm": table.tracker_noise, "fixation_ms": table.fixation, "sets_per_second": table.set_rate,
                 "focus_mm": focus * 1e3, "focus_dioptres": dioptres(focus, focal_length) },
    });
    let file = args.out.join("study.json");
    let page = args.out.join("study.html");
    let wrote = format!("wrote {} and {}", page.display(), file.display());
    let focused = depth_in_words(focus, focal_length);
    if table.content.given() {
        let title = format!("Content that changes: {}, focused at {focused}", subject.hologram.scene);
        let about = (title.as_str(), all, &mut own);
        let _made = files::CreatedDirGuard::new(&args.out)?;
        let how = (&settings, args.json);
        let shown = (&subject, &args.subject.how.options);
        content::run(&table.content, &policy, shown, &engines, how, about)?;
        if !args.json {
            println!("{wrote}");
        }
        return Ok(());
    }
    let study = study((&subject, &policy), &engines, &settings, args.json)?;
    let summary = summary(&study);
    let _made = files::CreatedDirGuard::new(&args.out)?;
    (all["summary"], all["study"]) = (summary.clone(), json!(study));
    let title = format!("Steering {}, focused at {focused}", subject.hologram.scene);
    report::write_study(&title, &subject.engine, &study, &all, &mut own)?;
    if args.json {
        print_report(json!({ "summary": summary, "out": args.out.display().to_string() }));
        return Ok(());
    }
    print(&study);
    println!("{wrote}");
    Ok(())
}

fn study(
    (subject, policy): (&Steered, &Policy),
    engines: &Engines,
    settings: &StudySettings,
    quiet: bool,
) -> Result<Study, Failure> {
    progress::catch_interrupt();
    let bar = JobBar::new(quiet);
    let mut open = || engines.open();
    let result =
        study::study(&subject.parts, policy, &subject.encoder, settings, &mut open, &mut |moment, _, share| {
            let what = format!("steering gains {:+.1} dB", moment.gain_db());
            matches!(bar.show(&what, share), Flow::Continue)
        });
    bar.finish();
    Ok(result?)
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn least(values: &[f64]) -> Option<f64> {
    values.iter().copied().reduce(f64::min)
}

/// Returns the summary of a study for the JSON report.
fn summary(study: &Study) -> Value {
    let (end, soon) = (study.at_the_end_db(), study.within_db(50.0));
    let errors: Vec<f64> =
        study.moments.iter().filter(|m| m.since_landing_ms.is_some()).filter_map(|m| m.error).collect();
    json!({
        "fixations": end.len(), "end_of_fixation_db": { "mean": mean(&end), "least": least(&end) },
        "within_50_ms_db": { "mean": mean(&soon), "least": least(&soon) },
        "end_of_fixation_jod": jod(study).map(|[steered, whole]| json!({ "steered": steered, "unsteered": whole })),
        "worst_db": study.worst_db(), "step_ms": study.step_ms, "encode_ms": study.encode_ms, "steps": study.steps,
        "restarts": study.restarts, "pupil_error_mm": mean(&errors).map(|e| e * 1e3),
        "sets": study.moments.len(), "dark_sets": { "eye_moves": study.dark_sets()[0], "eye_rests": study.dark_sets()[1] },
        "most_sources": most_sources(study),
    })
}

/// Returns the largest number of switchable sources that are lit at once.
fn most_sources(study: &Study) -> usize {
    study.moments.iter().map(|m| m.sources).max().unwrap_or(0)
}

/// Returns the mean JOD at the ends of fixations, with and without pupil steering.
fn jod(study: &Study) -> Option<[f64; 2]> {
    let all = study.at_the_end_jod();
    let [steered, whole] = [0, 1].map(|i| mean(&all.iter().map(|j| j[i]).collect::<Vec<_>>()));
    Some([steered?, whole?])
}

fn print(study: &Study) {
    let db = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:+.2}"));
    let (end, soon) = (study.at_the_end_db(), study.within_db(50.0));
    println!("the image with pupil steering, against the same hologram without, over {} fixations:", end.len());
    println!("  at the end of a fixation   {} dB, at least {} dB", db(mean(&end)), db(least(&end)));
    if let Some([steered, whole]) = jod(study) {
        println!("                             {steered:.2} JOD, {whole:.2} without steering");
    }
    println!("  within 50 ms of a landing  {} dB, at least {} dB", db(mean(&soon)), db(least(&soon)));
    println!("  at any time                at least {} dB", db(study.worst_db()));
    let most = most_sources(study);
    if most > 0 {
        let ([moves, rests], sets) = (study.dark_sets(), study.moments.len());
        println!(
            "switchable sources: at most {most} lit at once; of {sets} sets {rests} were dark to an eye that rested, {moves} to one \
             under way"
        );
    }
    println!(
        "{} steps of {:.2} ms, {} restarts, {:.2} ms to encode a set",
        study.steps, study.step_ms, study.restarts, study.encode_ms
    );
}
