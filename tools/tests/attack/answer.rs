//! What came of a case, and what may come of it.

use std::fmt;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

/// How a case ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Answer {
    /// It was done.
    Done,
    /// It was done as far as it was when ctrl-C came.
    Interrupted,
    /// It was refused with a line.
    Refused,
    /// In a way that must not be.
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

/// What no run may say.
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

/// Returns how a run ended, or the fault of its end. `said` is standard error if it was kept. With `json`, errors must be JSON.
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
        // What does not catch ctrl-C ends by it: 130, to a shell.
        (None, Some(2)) if interrupted => return Ok(Answer::Interrupted),
        _ => return Err(format!("it ended by {status}{quoted}")),
    };
    if let Some(word) = NEVER.iter().find(|word| quoted.contains(*word)) {
        return Err(format!("it said '{word}'{quoted}"));
    }
    // Where memory was taken away from it, it may find that out by asking for some.
    if !starved && quoted.contains("memory allocation of") {
        return Err(format!("it took memory that it had not looked for{quoted}"));
    }
    match code {
        0 if interrupted => Ok(Answer::Interrupted),
        0 => Ok(Answer::Done),
        2 => {
            if said.is_some_and(|said| !starved && !said.lines().any(|line| is_error(line, json))) {
                return Err(format!("no line says what was wrong{quoted}"));
            }
            Ok(Answer::Refused)
        }
        code => Err(format!("it ended with {code}{quoted}")),
    }
}
