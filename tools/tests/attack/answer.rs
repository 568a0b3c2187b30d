//! Judges the end of a case by its exit status and its standard error.

use std::fmt;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

/// The way in which a case ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Answer {
    /// The command did its work and exited with 0.
    Done,
    /// The command ended after ctrl-C, with 0 or by the signal.
    Interrupted,
    /// The command exited with 2 and an error line.
    Refused,
    /// The command ended in a forbidden way.
    Bad,
}

impl fmt::Display for Answer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Done => "done",
            Self::Interrupted => "interrupted",
            Self::Refused => "refused",
            Self::Bad => "BAD",
        })
    }
}

/// Texts that standard error must never contain.
const NEVER: [&str; 4] = ["panicked at", "has overflowed its stack", "internal error", "unreachable code"];

/// Returns whether a line of standard error is an error in the requested form.
fn is_error(line: &str, json: bool) -> bool {
    if !json {
        return line.starts_with("eyebox: ");
    }
    serde_json::from_str::<serde_json::Value>(line).is_ok_and(|line| {
        let error = &line["error"];
        error["code"].is_string() && error["message"].is_string() && error["fields"].is_object()
    })
}

/// Returns how a run ended, or the fault of its end. `said` is standard error, if the test read it. With `json`, errors
/// must be JSON.
pub fn judge(
    status: ExitStatus,
    interrupted: bool,
    said: Option<&str>,
    json: bool,
    starved: bool,
) -> Result<Answer, String> {
    let quoted = said.map_or(String::new(), |s| format!(": {}", s.chars().take(600).collect::<String>()));
    let code = match (status.code(), status.signal()) {
        (Some(code), _) => code,
        // A command that does not catch ctrl-C ends by the signal. A shell reports this as 130.
        (None, Some(2)) if interrupted => return Ok(Answer::Interrupted),
        _ => return Err(format!("it ended by {status}{quoted}")),
    };
    if let Some(word) = NEVER.iter().find(|word| quoted.contains(*word)) {
        return Err(format!("it printed '{word}'{quoted}"));
    }
    // If the case takes memory away, the command may notice this only by a failed allocation.
    if !starved && quoted.contains("memory allocation of") {
        return Err(format!("it requested memory without a check of the free memory{quoted}"));
    }
    match code {
        0 if interrupted => Ok(Answer::Interrupted),
        0 => Ok(Answer::Done),
        2 => {
            if said.is_some_and(|said| !starved && !said.lines().any(|line| is_error(line, json))) {
                return Err(format!("no line states the error{quoted}"));
            }
            Ok(Answer::Refused)
        }
        code => Err(format!("it ended with {code}{quoted}")),
    }
}
