//! Shows the progress of a job as a bar, or as lines if there is no terminal, and checks for ctrl-C.

pub use crate::signals::{catch_interrupt, interrupted, let_interrupt};
use eyebox::low_level::solve::{Flow, Progress, ValidationScore};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time from one line to the next if standard error is no terminal.
pub const EVERY: Duration = Duration::from_secs(10);

/// The present part of a job, with the shares that were done at first and are done now, 0 to 1.
struct Reached {
    what: String,
    first: f64,
    share: f64,
}

/// Prints a line about a job at intervals, for logs and pipes, which have no bars. A thread prints them, so they come
/// even while the job reports nothing.
struct Lines {
    reached: Arc<Mutex<Reached>>,
    thread: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Lines {
    /// Starts a thread that passes a line to `say` at each interval `every`.
    fn new(first: f64, every: Duration, mut say: impl FnMut(String) + Send + 'static) -> Self {
        let reached = Arc::new(Mutex::new(Reached { what: String::new(), first, share: first }));
        let (theirs, begun) = (Arc::clone(&reached), Instant::now());
        let (end, ended) = channel();
        let thread = std::thread::Builder::new().name("eyebox progress".into()).spawn(move || {
            while ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                say(line(&theirs.lock().unwrap_or_else(PoisonError::into_inner), begun.elapsed()));
            }
        });
        // Without a thread nothing is printed, and the job continues.
        Self { reached, thread: thread.ok().map(|thread| (end, thread)) }
    }

    /// Prints the lines on standard error, unless it is a terminal, which shows bars.
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

/// Returns a line with the progress of a job after a time, and the time left at the same pace.
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

/// Returns seconds as text in a unit that suits their size.
fn time(seconds: f64) -> String {
    match seconds.round() as u64 {
        s @ 0..=119 => format!("{s} s"),
        s @ 120..=7199 => format!("{} min", (s + 30) / 60),
        s => format!("{:.1} h", s as f64 / 3600.0),
    }
}

/// A bar for the solve of one color, or lines if there is no terminal.
pub struct Bar {
    bar: Option<ProgressBar>,
    lines: Option<Lines>,
    about: [String; 2],
    count: usize,
}

impl Bar {
    /// Creates a bar for `label`, which takes `count` units, of which `done` are done already.
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

    /// Shows a step. Until there is a validation, the PSNR is over the pupils of the step.
    pub fn show(&self, progress: &Progress) -> Flow {
        match (progress.pilot, progress.validation.map(ValidationScore::quality)) {
            _ if progress.fitting.is_some() => {
                let share = 100.0 * progress.fitting.unwrap_or_default();
                self.say(0, &format!("first phases fitted once for this display, {share:.0} %"));
            }
            (Some([taken, all]), _) => self.say(0, &format!("exposure chosen in {taken} of {all} steps")),
            (None, None) => self.at(progress.step, -10.0 * progress.loss.log10()),
            (None, Some(Some([mean, _]))) => self.at(progress.step, mean),
            (None, Some(None)) => self.say(progress.step, "black"),
        }
        if interrupted() { Flow::Stop } else { Flow::Continue }
    }

    /// Shows the number of units that are done, and the PSNR in dB.
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

    /// Leaves the bar on the terminal as it is.
    pub fn leave(self) {
        if let Some(bar) = self.bar {
            bar.abandon();
        }
    }

    /// Leaves the bar on the terminal with this message.
    pub fn finish(self, message: String) {
        if let Some(bar) = self.bar {
            bar.abandon_with_message(message);
        }
    }
}

/// A bar for a whole job of many parts, with the present part and the time left, or lines if there is no terminal.
pub struct JobBar {
    bar: Option<ProgressBar>,
    lines: Option<Lines>,
}

impl JobBar {
    /// Creates a bar, which is invisible if `quiet` is set.
    pub fn new(quiet: bool) -> Self {
        let bar = (!quiet).then(|| {
            let bar = ProgressBar::new(1000);
            let style = ProgressStyle::with_template("{bar:30} {percent:>3} %  {eta:>4} left  {msg}");
            bar.set_style(style.expect("a sound template"));
            // The bar ticks on a thread of its own. Without that thread it moves only when a part reports.
            if std::thread::Builder::new().spawn(|| ()).is_ok() {
                bar.enable_steady_tick(Duration::from_millis(250));
            }
            bar
        });
        Self { bar, lines: Lines::on_stderr(0.0) }
    }

    /// Shows the present part and the share that is done. Returns `Flow::Stop` if ctrl-C was pressed.
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

    /// Removes the bar, because the output that follows has the result.
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
        // Lines before the share is set do not have it. Even on a slow machine, a later line has it.
        while !said.recv().expect("a line").contains("50 % after 0 s, about 0 s left: green") {}
        drop(lines);
        // The channel ends because the thread that sent lines has ended.
        said.iter().for_each(drop);
    }
}
