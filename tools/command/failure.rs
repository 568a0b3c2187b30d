//! The failures of a command, each of which prints one line.

use crate::talk;
use eyebox::Error;
use eyebox::low_level::error::{ErrorData, Reason};
use eyebox::low_level::session::SessionError;
use eyebox_lab::film::FilmError;
use eyebox_live_input::LiveError;
use serde::Serialize;

/// The failure of a command.
#[derive(Debug, thiserror::Error, Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
pub enum Failure {
    /// An error of the library.
    #[error(transparent)]
    Library(Error),
    /// An error of a film.
    #[error(transparent)]
    Film(FilmError),
    /// An error of the connection to a display that takes frames.
    #[error(transparent)]
    #[serde(serialize_with = "eyebox::low_level::error::as_text")]
    Live(LiveError),
    /// The display was lost while it was in use.
    #[error("{0}")]
    Lost(Reason),
    /// The arguments contradict each other.
    #[error("{0}")]
    Arguments(Reason),
    /// A key of a table of the settings is unknown, or has no such value.
    #[error("{setting}: {reason}")]
    #[serde(rename = "arguments")]
    Setting {
        /// The table and the key.
        setting: String,
        reason: Reason,
    },
}

impl<E: Into<Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Library(error.into())
    }
}

impl Failure {
    /// Returns the exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Lost(_) => 3,
            Self::Library(Error::Calibrate(e) | Error::Session(SessionError::Calibrate(e))) if e.is_ended() => 3,
            _ => 2,
        }
    }
}

/// Prints a failure as one line on standard error and returns its exit code.
pub fn print(failure: &Failure) -> u8 {
    talk::print_error(&in_options(&failure.to_string()), &ErrorData::of(failure));
    failure.exit_code()
}

/// Fields and arguments of the library that have an option of the same name. [`in_options`] has the few others.
const FIELDS: [&str; 26] = [
    "at",
    "clock",
    "color",
    "device",
    "display",
    "display_rate",
    "engine",
    "focal_length",
    "frames",
    "model_terms",
    "near",
    "order",
    "output",
    "overwrite",
    "phase_unit",
    "photographs",
    "pitch",
    "prescription",
    "pupils",
    "size",
    "start_at",
    "steps",
    "tracker",
    "unfinished",
    "views",
    "wavelength",
];

/// Returns a sentence of the library with the options of the command instead of its fields.
pub fn in_options(sentence: &str) -> String {
    let others = [
        ("`depth`=", "--depth="),
        ("`depth`", "--depth MIN..MAX"),
        ("`padding` exact", "--set padding=exact"),
        ("`padding`", "--set padding=need"),
        ("`depth_map`", "--depth-map FILE"),
        ("`ahead`", "show.ahead"),
        ("`speed`", "show.speed"),
        ("`step_time`", "show.step_time"),
        ("`sync`", "show.sync"),
        ("`iris`", "camera.iris"),
        ("`passes`", "tiles.passes"),
        ("`first`", "--at"),
        ("`raw`", "--output raw:FILE"),
        ("`fit_exposure`", "`eyebox convert --scene`"),
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
    use eyebox::low_level::calibrate::CalibrateError;
    use eyebox::low_level::files::FileError;
    use eyebox::low_level::produce::ProduceError;

    /// Scripts rely on both.
    #[test]
    fn errors_have_a_code_and_an_exit_code() {
        let why = || Reason::new("why", "a sentence");
        let file = || FileError::Content { file: "a".into(), reason: why() };
        let cases: [(Failure, &str, u8); 9] = [
            (file().into(), "file/content/why", 2),
            (ProduceError::Job(why()).into(), "produce/job/why", 2),
            (CalibrateError::from(file()).into(), "file/content/why", 2),
            (CalibrateError::Stopped.into(), "calibrate/stopped", 3),
            (SessionError::from(CalibrateError::Stopped).into(), "calibrate/stopped", 3),
            (Failure::Film(FilmError::Setting(why())), "film/setting/why", 2),
            (Failure::Live(LiveError::Gone), "live", 2),
            (Failure::Lost(why()), "lost/why", 3),
            (Failure::Arguments(why()), "arguments/why", 2),
        ];
        for (failure, code, exit) in cases {
            assert_eq!((&*ErrorData::of(&failure).code, failure.exit_code()), (code, exit), "{failure:?}");
        }
    }

    /// An option that no command has would be a remedy that does not work.
    #[test]
    fn fields_of_the_library_are_options_of_a_command() {
        let cli = Cli::command();
        let leaves = crate::headings::leaves(&cli);
        let has = |option: &str| leaves.iter().any(|(_, c)| c.get_arguments().any(|a| a.get_long() == Some(option)));
        for field in FIELDS {
            let line = in_options(&format!("give `{field}` 1"));
            let option = line.strip_prefix("give --").and_then(|rest| rest.strip_suffix(" 1")).expect("an option");
            assert!(has(option), "{line}");
        }
        assert_eq!(in_options("by `depth`, as in `depth`=-3..3"), "by --depth MIN..MAX, as in --depth=-3..3");
        assert_eq!(in_options("`disparity` in its lightfield.toml"), "`disparity` in its lightfield.toml");
    }
}
