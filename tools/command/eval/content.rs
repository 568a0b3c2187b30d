//! Studies content of `eyebox eval gaze` that is still, moves or jumps (the setting `gaze.content`).
//!
//! It measures the gains of motion compensation and of pupil steering.

use crate::Failure;
use crate::args::{SceneArgs, SceneOptions};
use crate::common::{self, Engines};
use crate::progress::{self, JobBar};
use crate::subject::Steered;
use crate::talk::print_report;
use crate::values::whole_pixels;
use clap::{Args, ValueEnum};
use eyebox::low_level::files::ManagedDir;
use eyebox::low_level::session::{LiveColor, Policy, start_tables};
use eyebox_lab::report;
use eyebox_lab::study::{
    ContentRun, ContentSettings, JumpStart, StudiedContent, StudiedEye, StudySettings, study_content,
};
use serde_json::{Value, json};

/// The options of content that changes, in the command that studies it.
#[derive(Args)]
pub struct ContentArgs {
    /// Study content of these kinds one after the other, set by set, with and without steering, with moments on and off
    #[arg(long, value_enum, value_delimiter = ',', value_name = "KIND,...")]
    content: Vec<ContentName>,
    /// Sets of each run
    #[arg(long, default_value_t = 60, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    sets: u32,
    /// Steps of every color for each set
    #[arg(long, default_value_t = 3, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    steps_per_set: u32,
    /// Pixels that content moves by in a set
    #[arg(long, default_value_t = 10, value_name = "PX", value_parser = whole_pixels)]
    moves: u32,
    /// Sets between two jumps
    #[arg(long, default_value_t = 15, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    jumps_every: u32,
    /// Scenes that content jumps to, in turn [default: the scene's mirror image, elsewhere]
    #[arg(long, value_delimiter = ',', value_name = "SCENE,...")]
    jumps_to: Vec<String>,
    /// Phases to begin with after a jump
    #[arg(long, value_enum, default_value = "table", value_name = "table|last|random")]
    jumps_from: StartName,
    /// Show complete sets on a display that takes several video frames for one, instead of a rolling update
    #[arg(long)]
    whole_sets: bool,
}

/// The phases to begin with after a jump.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum StartName {
    /// Phases of a table that is fitted once for this display, as in a session
    Table,
    /// Phases of the last step
    Last,
    Random,
}

/// The kind of change of content.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ContentName {
    /// Content that is still
    Still,
    /// Content that moves to the right
    Moving,
    /// Content that changes at intervals
    Jumping,
}

/// The sets after a jump that are reported one by one, from 1.
const AFTER: [u32; 5] = [1, 2, 3, 5, 8];
/// Number of sets after a jump, and after the beginning, that summaries leave out while the content settles.
const SETTLES: u32 = 8;

impl ContentArgs {
    /// Returns whether content is studied.
    pub fn given(&self) -> bool {
        !self.content.is_empty()
    }

    /// Loads the scenes that content jumps to, for the display of the subject.
    fn slides(
        &self,
        subject: &Steered,
        options: &SceneOptions,
        engines: &Engines,
    ) -> Result<Vec<Vec<LiveColor>>, Failure> {
        if self.jumps_to.is_empty() {
            return Ok(Vec::new());
        }
        let engine = engines.open()?;
        let display = subject.hologram.made_for()?;
        let one = |scene: &String| {
            let field = common::scene_on(&SceneArgs::new(scene, options), &display, &subject.colors, engine.as_ref())?;
            Ok(LiveColor::for_scene(&subject.parts, &field, &display)?)
        };
        self.jumps_to.iter().map(one).collect()
    }

    fn settings(
        &self,
        subject: &Steered,
        options: &SceneOptions,
        engines: &Engines,
    ) -> Result<ContentSettings, Failure> {
        let of = |name: &ContentName| match name {
            ContentName::Still => StudiedContent::Still,
            ContentName::Moving => StudiedContent::Moving,
            ContentName::Jumping => StudiedContent::Jumping,
        };
        let start = match self.jumps_from {
            StartName::Last => JumpStart::Last,
            StartName::Random => JumpStart::Random,
            StartName::Table => JumpStart::Table,
        };
        let jumps = self.content.contains(&ContentName::Jumping);
        let wanted = jumps && start == JumpStart::Table;
        let start_tables =
            if wanted { start_tables(&subject.parts, &mut crate::show::tracked::fitting())? } else { Vec::new() };
        Ok(ContentSettings {
            slides: self.slides(subject, options, engines)?,
            start,
            start_tables,
            contents: self.content.iter().map(of).collect(),
            sets: self.sets,
            steps: self.steps_per_set,
            speed: self.moves,
            jumps_every: self.jumps_every,
            lighting: subject.encoder.lighting(!self.whole_sets),
        })
    }
}

/// Studies content and prints the results. `about` has the entries about the study for the page and the numbers.
pub fn run(
    args: &ContentArgs,
    policy: &Policy,
    (subject, options): (&Steered, &SceneOptions),
    engines: &Engines,
    (study, quiet): (&StudySettings, bool),
    (title, mut about, own): (&str, Value, &mut ManagedDir),
) -> Result<(), Failure> {
    progress::catch_interrupt();
    let settings = args.settings(subject, options, engines)?;
    let bar = JobBar::new(quiet);
    let mut open = || engines.open();
    let mut observe = |share| bar.show("content", share);
    let runs = study_content(&subject.parts, policy, &settings, study, &mut open, &mut observe)?;
    bar.finish();
    let row = |run: &ContentRun| {
        let [mean, worst, best] = run.summary(SETTLES).map_or([None; 3], |all| all.map(Some));
        json!({ "content": run.content, "eye": run.eye, "steered": run.steered, "moments": run.moments,
                "mean_db": mean, "worst_db": worst, "best_db": best, "windows_db": run.windows(SETTLES),
                "after_jumps_db": AFTER.map(|nth| run.after_jumps(nth)) })
    };
    let summary: Vec<Value> = runs.iter().map(row).collect();
    about["summary"] = json!(summary);
    about["after_jumps_in_sets"] = json!(AFTER);
    about["settles_in_sets"] = json!(SETTLES);
    let rolls = settings.lighting.turns() > 1;
    about["sets_roll"] = json!(rolls);
    about["sets"] = json!(settings.sets);
    about["steps_per_set"] = json!(settings.steps);
    about["pixels_a_set"] = json!(settings.speed);
    about["sets_between_jumps"] = json!(settings.jumps_every);
    about["jumps_to"] = json!(args.jumps_to);
    about["jumps_from"] = json!(settings.start);
    about["runs"] = json!(runs);
    report::write_content_study(title, &subject.engine, (&runs, SETTLES), &about, own)?;
    if quiet {
        print_report(json!({ "summary": summary, "out": about["out"] }));
        return Ok(());
    }
    let what = if rolls { "windows of a set's time" } else { "sets" };
    println!("what the eye sees, dB: mean (worst) of the {what} outside saccades, {SETTLES} sets after every change");
    table(&runs, |run| run.summary(SETTLES).map_or("-".into(), |[mean, worst, _]| format!("{mean:.1} ({worst:.1})")));
    if rolls {
        println!("means of the windows that end with each video frame of a set, dB: worst to best");
        table(&runs, |run| run.windows(SETTLES).map_or("-".into(), |[worst, best]| format!("{worst:.2}-{best:.2}")));
    }
    for run in runs.iter().filter(|run| run.content == StudiedContent::Jumping && !run.moments) {
        let cell = |nth: u32| run.after_jumps(nth).map_or("-".into(), |db| format!("{db:.1} in set {nth}"));
        let whose = if run.steered { "for the pupil" } else { "for the whole eyebox" };
        println!("  after a jump, {whose}: {}", AFTER.map(cell).join(", "));
    }
    Ok(())
}

fn table(runs: &[ContentRun], cell: impl Fn(&ContentRun) -> String) {
    println!("  {:24} {:>26} {:>26}", "", "for the whole eyebox", "for the pupil");
    println!("  {:24} {:>12}  {:>12} {:>12}  {:>12}", "content, eye", "moments off", "on", "off", "on");
    for four in runs.chunks(4) {
        let cells: Vec<String> = four.iter().map(|run| format!("{:>12}", cell(run))).collect();
        println!("  {:24} {}", name(&four[0]), cells.join("  "));
    }
}

fn name(run: &ContentRun) -> String {
    let content = match run.content {
        StudiedContent::Still => "still",
        StudiedContent::Moving => "moving",
        StudiedContent::Jumping => "jumping",
    };
    let eye = match run.eye {
        StudiedEye::Rests => "rests",
        StudiedEye::Follows => "follows",
    };
    format!("{content}, {eye}")
}
