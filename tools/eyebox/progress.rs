//! The progress bar, and ctrl-C.

pub use crate::signals::{catch_interrupt, interrupted};
use eyebox::solve::{Flow, Progress};
use indicatif::{ProgressBar, ProgressStyle};

/// A bar for one colour's solve; nothing where nobody looks.
pub struct Bar(Option<ProgressBar>);

impl Bar {
    /// `label` says what is solved, in so many `unit`s, of which some may be `done`.
    pub fn new(label: String, count: usize, done: u64, unit: &str, quiet: bool) -> Self {
        if quiet {
            return Self(None);
        }
        let bar = ProgressBar::new(count as u64).with_position(done);
        let style = ProgressStyle::with_template(&format!(
            "{{prefix:6}} {{bar:30}} {{pos}}/{{len}} {unit}  {{msg}}  {{eta}} left"
        ))
        .expect("a sound template");
        bar.set_style(style);
        bar.set_prefix(label);
        bar.reset_eta();
        Self(Some(bar))
    }

    /// After a step. Until there is a validation, this step's own pupils stand for it.
    pub fn show(&self, progress: &Progress) -> Flow {
        let psnr = progress.validation.map_or(-10.0 * progress.loss.log10(), |v| v.mean());
        self.at(progress.step, psnr);
        if interrupted() { Flow::Stop } else { Flow::Continue }
    }

    /// So many are done, and it is so good, dB.
    pub fn at(&self, done: usize, psnr: f64) {
        if let Some(bar) = &self.0 {
            bar.set_message(format!("{psnr:.1} dB"));
            bar.set_position(done as u64);
        }
    }

    /// The bar stays as it is.
    pub fn leave(self) {
        if let Some(bar) = self.0 {
            bar.abandon();
        }
    }

    /// The last line stays.
    pub fn finish(self, message: String) {
        if let Some(bar) = self.0 {
            bar.abandon_with_message(message);
        }
    }
}

/// A bar over a whole job of many parts: what is being done, and the time that is left.
pub struct JobBar(Option<ProgressBar>);

impl JobBar {
    /// Nothing is shown where it is to be `quiet`.
    pub fn new(quiet: bool) -> Self {
        Self((!quiet).then(|| {
            let bar = ProgressBar::new(1000);
            let style = ProgressStyle::with_template("{bar:30} {percent:>3} %  {eta:>4} left  {msg}");
            bar.set_style(style.expect("a sound template"));
            bar.enable_steady_tick(std::time::Duration::from_millis(250));
            bar
        }))
    }

    /// Shows what is being done, and the share that is done; stops where ctrl-C was pressed.
    pub fn show(&self, what: &str, share: f64) -> Flow {
        if let Some(bar) = &self.0 {
            bar.set_message(what.to_string());
            bar.set_position((1000.0 * share) as u64);
        }
        if interrupted() { Flow::Stop } else { Flow::Continue }
    }

    /// The bar goes; what follows says what came of it.
    pub fn finish(self) {
        if let Some(bar) = self.0 {
            bar.finish_and_clear();
        }
    }
}
