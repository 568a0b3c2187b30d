//! Refuses live content on systems without it.

use super::args::ShowSettings;
use super::content::Show;
use super::tracked::Stage;
use crate::Failure;
use crate::subject::{Steered, SubjectOptions};
use eyebox::low_level::reason;

/// Refuses an application in another process.
pub(super) fn show(
    _args: &Show,
    _settings: ShowSettings,
    name: &str,
    _listening: impl FnOnce() -> Result<(), Failure>,
) -> Result<(), Failure> {
    refused(name)
}

/// Refuses an application for the displays of two eyes.
pub(super) fn of_two_eyes(
    _args: &Show,
    _settings: &ShowSettings,
    name: &str,
    _subjects: &[SubjectOptions; 2],
    _stage: &Stage,
) -> Result<[Steered; 2], Failure> {
    refused(name)
}

fn refused<T>(name: &str) -> Result<T, Failure> {
    Err(Failure::Arguments(reason!("live-on-linux", "live:{name}: live content exists on Linux alone")))
}
