//! What can go wrong in a command: one line each.

use crate::talk;
use eyebox::low_level::calibrate::CalibrateError;
use eyebox::low_level::encode::EncodeError;
use eyebox::low_level::engine::EngineError;
use eyebox::low_level::error::{ErrorData, Reason};
use eyebox::low_level::evaluate::EvaluateError;
use eyebox::low_level::files::FileError;
use eyebox::low_level::gaze::GazeError;
use eyebox::low_level::hologram::HologramError;
use eyebox::low_level::optics::OpticsError;
use eyebox::low_level::present::PresentError;
use eyebox::low_level::preview::PreviewError;
use eyebox::low_level::produce::ProduceError;
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::reconstruction::ReconstructionError;
use eyebox::low_level::scene::SceneError;
use eyebox::low_level::session::SessionError;
use eyebox::low_level::solve::SolveError;
use eyebox::low_level::tiled::TiledError;
use eyebox::low_level::trackers::TrackerError;
use eyebox_lab::film::FilmError;
use eyebox_live_input::LiveError;
use serde::Serialize;
use std::process::ExitCode;

/// Why a command failed.
#[derive(Debug, thiserror::Error, Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
pub enum Failure {
    /// The display, the pupil or the grid.
    #[error(transparent)]
    Optics(#[from] OpticsError),
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The engine.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The solve.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The hologram.
    #[error(transparent)]
    Hologram(#[from] HologramError),
    /// The encoding.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The comparison.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// A trial of settings.
    #[error(transparent)]
    Quality(#[from] QualityError),
    /// What a job was to make.
    #[error(transparent)]
    Produce(#[from] ProduceError),
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// A film.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// A hologram larger than memory.
    #[error(transparent)]
    Tiled(#[from] TiledError),
    /// An eye tracker.
    #[error(transparent)]
    Tracker(#[from] TrackerError),
    /// A calibration, or a setting of the way from sample to pupil.
    #[error(transparent)]
    Gaze(#[from] GazeError),
    /// The calibration of a display.
    #[error(transparent)]
    Calibrate(#[from] CalibrateError),
    /// A session.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The display, or a window.
    #[error(transparent)]
    Present(#[from] PresentError),
    /// The preview.
    #[error(transparent)]
    Preview(#[from] PreviewError),
    /// A display that takes frames.
    #[error(transparent)]
    #[serde(serialize_with = "eyebox::low_level::error::as_text")]
    Live(#[from] LiveError),
    /// The display was lost while it was played to.
    #[error("{0}")]
    Lost(Reason),
    /// What was asked for does not fit together.
    #[error("{0}")]
    Arguments(Reason),
}

impl From<ReconstructionError> for Failure {
    fn from(error: ReconstructionError) -> Self {
        error.unwrapped()
    }
}

impl Failure {
    /// The exit code.
    pub fn exit_code(&self) -> u8 {
        let ended = matches!(self, Self::Calibrate(e) | Self::Session(SessionError::Calibrate(e)) if e.is_ended());
        if ended || matches!(self, Self::Lost(_)) { 3 } else { 2 }
    }
}

/// Prints a failure as one line on standard error and returns its exit code.
pub fn print(failure: &Failure) -> ExitCode {
    talk::print_error(&in_options(&failure.to_string()), &ErrorData::of(failure));
    ExitCode::from(failure.exit_code())
}

/// Fields and arguments of the library that a sentence may name and the command's options say: all but a few have the same name.
const FIELDS: [&str; 35] = [
    "ahead",
    "at",
    "clock",
    "color",
    "device",
    "display",
    "display_rate",
    "engine",
    "first",
    "focal_length",
    "frames",
    "iris",
    "model_terms",
    "near",
    "order",
    "output",
    "overwrite",
    "padding",
    "passes",
    "phase_unit",
    "photographs",
    "pitch",
    "prescription",
    "pupils",
    "raw",
    "size",
    "speed",
    "start_at",
    "step_time",
    "steps",
    "sync",
    "tracker",
    "unfinished",
    "views",
    "wavelength",
];

/// A sentence of the library in the words of the command: its fields are options here.
pub fn in_options(sentence: &str) -> String {
    let others = [
        ("`depth`=", "--depth="),
        ("`depth`", "--depth MIN..MAX"),
        ("`depth_map`", "--depth-map FILE"),
        ("`fit_exposure`", "`eyebox import --scene`"),
    ];
    let text = others.iter().fold(sentence.to_owned(), |text, (field, option)| text.replace(field, option));
    FIELDS
        .iter()
        .fold(text, |text, field| text.replace(&format!("`{field}`"), &format!("--{}", field.replace('_', "-"))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::Cli;
    use clap::CommandFactory;

    /// An option that no command has would be a remedy that does not work.
    #[test]
    fn fields_of_the_library_are_options_of_a_command() {
        let cli = Cli::command();
        let has = |option: &str| cli.get_subcommands().any(|c| c.get_arguments().any(|a| a.get_long() == Some(option)));
        for field in FIELDS {
            let line = in_options(&format!("give `{field}` 1"));
            let option = line.strip_prefix("give --").and_then(|rest| rest.strip_suffix(" 1")).expect("an option");
            assert!(has(option), "{line}");
        }
        assert_eq!(in_options("by `depth`, as in `depth`=-3..3"), "by --depth MIN..MAX, as in --depth=-3..3");
        assert_eq!(in_options("`disparity` in its lightfield.toml"), "`disparity` in its lightfield.toml");
    }
}
