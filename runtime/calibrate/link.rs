//! Runs the camera's command, sends it one request at a time and restarts it if it is lost.

use super::error::CalibrateError;
use super::message::{CameraReply, Hello, LONGEST_LINE, PROTOCOL};
use eyebox_base::error::Reason;
use eyebox_base::files::asked_to_end;
use eyebox_base::reason;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Number of losses after which the command is given up.
const DEATHS: usize = 3;
/// Number of repetitions of a request that failed.
const AGAIN: usize = 2;
const HELLO: Duration = Duration::from_secs(60);
/// Time between closing its input and asking it to end, and between that and killing it.
const POLITE: Duration = Duration::from_secs(5);
/// Interval of the checks for a stop by the user.
const LOOK: Duration = Duration::from_millis(50);
/// Number of lines of its standard error that are kept.
const TAIL: usize = 4;

/// A line of its standard output, or `None` if it is longer than the limit.
type Line = Option<String>;

struct Process {
    child: Child,
    input: Option<ChildStdin>,
    lines: Receiver<Line>,
    last: Arc<Mutex<VecDeque<String>>>,
}

enum Trouble {
    /// The command is lost, for this reason.
    Lost(Reason),
    Stopped,
    /// The command failed with this text. `again` is true if the request may be repeated.
    Failed {
        text: String,
        again: bool,
    },
}

pub(super) struct Link<'a> {
    words: Vec<String>,
    /// The user's limit for each request.
    limit: Option<Duration>,
    process: Option<Process>,
    hello: Option<Value>,
    deaths: usize,
    next: u64,
    /// Receives lines that are not part of the protocol.
    say: &'a mut dyn FnMut(&str),
}

/// Reads lines of bounded length until the stream ends or `each` returns false.
fn read_lines(from: impl Read, mut each: impl FnMut(Line) -> bool) {
    let mut from = BufReader::new(from);
    let mut bytes = Vec::new();
    loop {
        bytes.clear();
        match from.by_ref().take(LONGEST_LINE as u64 + 1).read_until(b'\n', &mut bytes) {
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        let whole = bytes.len() <= LONGEST_LINE;
        let line = whole.then(|| String::from_utf8_lossy(&bytes).trim().to_string());
        if !each(line) {
            return;
        }
    }
}

impl Process {
    fn start(words: &[String]) -> io::Result<Self> {
        let mut command = Command::new(&words[0]);
        command.args(&words[1..]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C in a terminal is for eyebox only, which then says bye.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let (input, output, errors) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
        let (tell, lines) = channel();
        let last = Arc::new(Mutex::new(VecDeque::new()));
        let theirs = Arc::clone(&last);
        let process = Self { child, input, lines, last };
        let thread = |name: &str| std::thread::Builder::new().name(format!("eyebox camera {name}"));
        if let (Some(output), Some(errors)) = (output, errors) {
            thread("output").spawn(move || read_lines(output, |line| tell.send(line).is_ok()))?;
            thread("errors").spawn(move || {
                read_lines(errors, |line| {
                    let line = line.unwrap_or_default();
                    let _ = writeln!(io::stderr(), "{line}");
                    let mut last = theirs.lock().unwrap_or_else(PoisonError::into_inner);
                    last.push_back(line);
                    if last.len() > TAIL {
                        last.pop_front();
                    }
                    true
                });
            })?;
        }
        Ok(process)
    }

    /// True if the process ends within this time.
    fn ends_within(&mut self, patience: Duration) -> bool {
        let begun = Instant::now();
        loop {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return true;
            }
            if begun.elapsed() >= patience {
                return false;
            }
            std::thread::sleep(LOOK / 5);
        }
    }

    /// The reason of an end that eyebox did not request.
    fn obituary(&mut self) -> String {
        let how = match self.ends_within(Duration::from_secs(1)) {
            true => self.child.try_wait().ok().flatten().map_or_else(String::new, |status| format!(" ({status})")),
            false => ", or closed its output".into(),
        };
        // The last lines are complete when the thread that reads them has ended. A child process may hold them open.
        let begun = Instant::now();
        while Arc::strong_count(&self.last) > 1 && begun.elapsed() < Duration::from_secs(1) {
            std::thread::sleep(LOOK / 5);
        }
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let said: Vec<&str> = last.iter().map(|l| l.trim()).filter(|l| !l.is_empty()).collect();
        if said.is_empty() { format!("ended{how}") } else { format!("ended{how}: {}", said.join(" | ")) }
    }

    #[cfg(unix)]
    fn signal(&mut self, signal: rustix::process::Signal) {
        // The signal goes to the process group, so that child processes end too.
        if let Some(group) = rustix::process::Pid::from_raw(self.child.id().cast_signed()) {
            let _ = rustix::process::kill_process_group(group, signal);
        }
    }
}

impl Drop for Process {
    /// Closes its input, asks it to end 5 s later, and kills it after 5 s more.
    fn drop(&mut self) {
        self.input = None;
        if self.ends_within(POLITE) {
            return;
        }
        #[cfg(unix)]
        {
            self.signal(rustix::process::Signal::TERM);
            if self.ends_within(POLITE) {
                return;
            }
            self.signal(rustix::process::Signal::KILL);
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl<'a> Link<'a> {
    /// Starts `command`, split into words as a POSIX shell does, and requests the abilities of the bench. `limit` is
    /// for each request, instead of the protocol's own limits. The callback `say` receives the lines that are not part
    /// of the protocol, and a line for each loss.
    ///
    /// # Errors
    /// [`CalibrateError::Words`], [`Start`](CalibrateError::Start), and the errors of [`ask`](Self::ask).
    pub(super) fn start(
        command: &str,
        limit: Option<Duration>,
        say: &'a mut dyn FnMut(&str),
    ) -> Result<(Self, Hello), CalibrateError> {
        let words = shlex::split(command).filter(|w| !w.is_empty());
        let words = words.ok_or_else(|| CalibrateError::Words { command: command.into() })?;
        let process = Process::start(&words);
        let process = process.map_err(|source| CalibrateError::Start { program: words[0].clone(), source })?;
        let mut link = Self { words, limit, process: Some(process), hello: None, deaths: 0, next: 0, say };
        let hello = link.greeted()?;
        Ok((link, hello))
    }

    /// Requests a picture until there is one and `check` accepts it.
    ///
    /// # Errors
    /// [`CalibrateError::Lost`] after three losses, and [`Stopped`](CalibrateError::Stopped). The inner error has the
    /// command's own text if it could not take the picture.
    pub(super) fn ask<T>(
        &mut self,
        question: &Value,
        limit: Duration,
        mut check: impl FnMut(&Value) -> Result<T, Reason>,
    ) -> Result<Result<T, Reason>, CalibrateError> {
        let mut failed = 0;
        loop {
            let trouble = match self.try_ask(question, limit) {
                Ok(answer) => match check(&answer) {
                    Ok(answer) => return Ok(Ok(answer)),
                    Err(reason) => Trouble::Lost(reason),
                },
                Err(trouble) => trouble,
            };
            match trouble {
                Trouble::Stopped => return Err(CalibrateError::Stopped),
                Trouble::Failed { text, again } if !again || failed >= AGAIN => return Ok(Err(text.into())),
                Trouble::Failed { text, .. } => {
                    (self.say)(&format!("the camera's command failed ({text}), repeating the request"));
                    failed += 1;
                }
                Trouble::Lost(reason) => {
                    self.lost(reason)?;
                    self.greeted()?;
                }
            }
        }
    }

    /// Says bye and waits until the command has ended.
    pub(super) fn bye(mut self) {
        if self.process.is_some() {
            let _ = self.try_ask(&json!({"do": "bye"}), POLITE);
        }
    }

    /// Counts a loss and ends the process.
    fn lost(&mut self, reason: Reason) -> Result<(), CalibrateError> {
        self.process = None;
        self.deaths += 1;
        if self.deaths >= DEATHS {
            return Err(CalibrateError::Lost { deaths: self.deaths, reason });
        }
        (self.say)(&format!("the camera's command {reason}, starting it again"));
        Ok(())
    }

    /// Starts the command if it does not run, and sends hello. The answer must not change.
    fn greeted(&mut self) -> Result<Hello, CalibrateError> {
        let refused = |text| CalibrateError::Refused { what: "say what it is".into(), text };
        loop {
            if self.process.is_none() {
                let started = Process::start(&self.words);
                let program = || self.words[0].clone();
                self.process = Some(started.map_err(|source| CalibrateError::Start { program: program(), source })?);
            }
            let reason = match self.try_ask(&json!({"do": "hello", "protocol": PROTOCOL}), HELLO) {
                Ok(mut hello) => {
                    hello.as_object_mut().map(|o| o.remove("id"));
                    if self.hello.as_ref().is_none_or(|before| *before == hello) {
                        let hello = self.hello.insert(hello);
                        return Hello::read(hello).map_err(|reason| refused(reason.to_string()));
                    }
                    reason!("other-hello", "answers hello differently than before")
                }
                Err(Trouble::Lost(reason)) => reason,
                Err(Trouble::Stopped) => return Err(CalibrateError::Stopped),
                Err(Trouble::Failed { text, .. }) => return Err(refused(text)),
            };
            self.lost(reason)?;
        }
    }

    fn try_ask(&mut self, question: &Value, limit: Duration) -> Result<Value, Trouble> {
        let limit = self.limit.unwrap_or(limit);
        let id = self.next;
        self.next += 1;
        let process = self.process.as_mut().ok_or_else(|| Trouble::Lost(reason!("not-running", "does not run")))?;
        let mut asked = json!({"id": id});
        for (key, value) in question.as_object().into_iter().flatten() {
            asked[key.as_str()] = value.clone();
        }
        let sent = process.input.as_mut().map(|input| writeln!(input, "{asked}").and_then(|()| input.flush()));
        if !matches!(sent, Some(Ok(()))) {
            return Err(Trouble::Lost(process.obituary().into()));
        }
        let mut until = Instant::now() + limit;
        let mut allowed = limit;
        loop {
            if asked_to_end().load(Ordering::SeqCst) {
                return Err(Trouble::Stopped);
            }
            let left = until.saturating_duration_since(Instant::now());
            match process.lines.recv_timeout(left.min(LOOK)) {
                Ok(None) => {
                    return Err(Trouble::Lost(reason!(
                        "line-length",
                        "wrote a line of more than {LONGEST_LINE} bytes"
                    )));
                }
                Ok(Some(line)) => match CameraReply::read(&line, id).map_err(Trouble::Lost)? {
                    CameraReply::Said(line) => (self.say)(&line),
                    CameraReply::Wait(seconds) => {
                        allowed = Duration::from_secs_f64(seconds);
                        until = Instant::now() + allowed;
                    }
                    CameraReply::Failed { text, again } => return Err(Trouble::Failed { text, again }),
                    CameraReply::Answered(answer) => return Ok(answer),
                },
                Err(RecvTimeoutError::Disconnected) => return Err(Trouble::Lost(process.obituary().into())),
                Err(RecvTimeoutError::Timeout) if left.is_zero() => {
                    return Err(Trouble::Lost(reason!(
                        "no-answer",
                        "gave no answer within {:.0} s",
                        allowed.as_secs_f64()
                    )));
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }
}
