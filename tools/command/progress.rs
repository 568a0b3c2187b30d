//! The progress bar, the lines in its place where there is no terminal; and whether ctrl-C was pressed.

pub use crate::signals::{catch_interrupt, interrupted, let_interrupt};
use eyebox::low_level::solve::{Flow, Progress, ValidationScore};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// From one line to the next where standard error is no terminal.
pub const EVERY: Duration = Duration::from_secs(10);

/// What a job is at, and how much of it was done at first and is done now, 0 to 1.
struct Reached {
    what: String,
    first: f64,
    share: f64,
}

/// A line now and then, while it is there, of how far a job is: for logs and pipes, which have no bars. A thread says them,
/// however long the job is silent.
struct Lines {
    reached: Arc<Mutex<Reached>>,
    thread: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Lines {
    /// Says a line `every` so often by `say`.
    fn new(first: f64, every: Duration, mut say: impl FnMut(String) + Send + 'static) -> Self {
        let reached = Arc::new(Mutex::new(Reached { what: String::new(), first, share: first }));
        let (theirs, begun) = (Arc::clone(&reached), Instant::now());
        let (end, ended) = channel();
        let thread = std::thread::Builder::new().name("eyebox progress".into()).spawn(move || {
            while ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                say(line(&theirs.lock().unwrap_or_else(PoisonError::into_inner), begun.elapsed()));
            }
        });
        // Without a thread nothing is said: the job goes on.
        Self { reached, thread: thread.ok().map(|thread| (end, thread)) }
    }

    /// On standard error, unless it is a terminal: bars are for that.
    fn on_stderr(first: f64) -> Option<Self> {
        (!std::io::stderr().is_terminal()).then(|| Self::new(first, EVERY, |line| eprintln!("{line}")))
    }

    fn at(&self, what: String, share: f64) {
        let mut reached = self.reached.lock().unwrap_or_else(PoisonError::into_inner);
        (reached.what, reached.share) = (what, share);
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        if let Some((end, thread)) = self.thread.take() {
            drop(end);
            let _ = thread.join();
        }
    }
}

/// How far a job is after so long, and what is left at the same pace.
fn line(reached: &Reached, passed: Duration) -> String {
    let Reached { what, first, share } = reached;
    let seconds = passed.as_secs_f64();
    let left = seconds * (1.0 - share) / (share - first);
    let percent = (100.0 * share).clamp(0.0, 100.0).floor();
    match left.is_finite() && left >= 0.0 {
        true => format!("{percent:3} % after {}, about {} left: {what}", time(seconds), time(left)),
        false => format!("after {}: {what}", time(seconds)),
    }
}

/// Seconds, as people say them.
fn time(seconds: f64) -> String {
    match seconds.round() as u64 {
        s @ 0..=119 => format!("{s} s"),
        s @ 120..=7199 => format!("{} min", (s + 30) / 60),
        s => format!("{:.1} h", s as f64 / 3600.0),
    }
}

/// A bar for one color's solve; where there is no terminal, lines.
pub struct Bar {
    bar: Option<ProgressBar>,
    lines: Option<Lines>,
    about: [String; 2],
    count: usize,
}

impl Bar {
    /// `label` says what is solved, in so many `unit`s, of which some may be `done`.
    pub fn new(label: String, count: usize, done: u64, unit: &str, quiet: bool) -> Self {
        let lines = Lines::on_stderr(done as f64 / count.max(1) as f64);
        let about = [label.clone(), unit.to_string()];
        if quiet {
            return Self { bar: None, lines, about, count };
        }
        let bar = ProgressBar::new(count as u64).with_position(done);
        let style = ProgressStyle::with_template(&format!(
            "{{prefix:6}} {{bar:30}} {{pos}}/{{len}} {unit}  {{msg}}  {{eta}} left"
        ))
        .expect("a sound template");
        bar.set_style(style);
        bar.set_prefix(label);
        bar.reset_eta();
        Self { bar: Some(bar), lines, about, count }
    }

    /// After a step. Until there is a validation, this step's own pupils stand for it.
    pub fn show(&self, progress: &Progress) -> Flow {
        match (progress.pilot, progress.validation.map(ValidationScore::quality)) {
            _ if progress.fitting.is_some() => {
                let share = 100.0 * progress.fitting.unwrap_or_default();
                self.say(0, &format!("first phases fitted, once for this display: {share:.0} %"));
            }
            (Some([taken, all]), _) => self.say(0, &format!("exposure chosen in {taken} of {all} steps")),
            (None, None) => self.at(progress.step, -10.0 * progress.loss.log10()),
            (None, Some(Some([mean, _]))) => self.at(progress.step, mean),
            (None, Some(None)) => self.say(progress.step, "black"),
        }
        if interrupted() { Flow::Stop } else { Flow::Continue }
    }

    /// So many are done, and it is so good, dB.
    pub fn at(&self, done: usize, psnr: f64) {
        self.say(done, &format!("{psnr:.1} dB"));
    }

    fn say(&self, done: usize, message: &str) {
        if let Some(bar) = &self.bar {
            bar.set_message(message.to_owned());
            bar.set_position(done as u64);
        }
        if let Some(lines) = &self.lines {
            let ([label, unit], count) = (&self.about, self.count);
            lines.at(format!("{label}, {done} of {count} {unit}, {message}"), done as f64 / count.max(1) as f64);
        }
    }

    /// The bar stays as it is.
    pub fn leave(self) {
        if let Some(bar) = self.bar {
            bar.abandon();
        }
    }

    /// The last line stays.
    pub fn finish(self, message: String) {
        if let Some(bar) = self.bar {
            bar.abandon_with_message(message);
        }
    }
}

/// A bar over a whole job of many parts: what is being done, and the time that is left; where there is no terminal, lines.
pub struct JobBar {
    bar: Option<ProgressBar>,
    lines: Option<Lines>,
}

impl JobBar {
    /// No bar is shown where it is to be `quiet`.
    pub fn new(quiet: bool) -> Self {
        let bar = (!quiet).then(|| {
            let bar = ProgressBar::new(1000);
            let style = ProgressStyle::with_template("{bar:30} {percent:>3} %  {eta:>4} left  {msg}");
            bar.set_style(style.expect("a sound template"));
            // It ticks by a thread of its own, and without one when something is done.
            if std::thread::Builder::new().spawn(|| ()).is_ok() {
                bar.enable_steady_tick(Duration::from_millis(250));
            }
            bar
        });
        Self { bar, lines: Lines::on_stderr(0.0) }
    }

    /// Shows what is being done, and the share that is done; stops where ctrl-C was pressed.
    pub fn show(&self, what: &str, share: f64) -> Flow {
        if let Some(bar) = &self.bar {
            bar.set_message(what.to_string());
            bar.set_position((1000.0 * share) as u64);
        }
        if let Some(lines) = &self.lines {
            lines.at(what.to_string(), share);
        }
        if interrupted() { Flow::Stop } else { Flow::Continue }
    }

    /// The bar goes; what follows says what came of it.
    pub fn finish(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_far_it_is_and_what_is_left_at_that_pace() {
        let at =
            |first, share, seconds| line(&Reached { what: "slfh".into(), first, share }, Duration::from_secs(seconds));
        assert_eq!(at(0.0, 0.25, 20), " 25 % after 20 s, about 60 s left: slfh");
        assert_eq!(
            at(0.5, 0.75, 600),
            " 75 % after 10 min, about 10 min left: slfh",
            "what was done before is not counted"
        );
        assert_eq!(at(0.0, 0.0, 10), "after 10 s: slfh", "nothing is known yet");
        assert_eq!(at(0.0, 0.01, 200), "  1 % after 3 min, about 5.5 h left: slfh");
    }

    #[test]
    fn lines_come_by_themselves_and_end_with_the_job() {
        let (say, said) = channel();
        let lines = Lines::new(0.0, Duration::from_millis(1), move |line| drop(say.send(line)));
        lines.at("green".into(), 0.5);
        // However slow the machine is, one comes that knows; after the end, none.
        while !said.recv().expect("a line").contains("50 % after 0 s, about 0 s left: green") {}
        drop(lines);
        // Comes to its end because what said lines is gone.
        said.iter().for_each(drop);
    }
}
