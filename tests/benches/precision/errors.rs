//! Error power over signal power, as a table and as a plot with both axes logarithmic.

use eyebox_lab::report::{Axis, Plot};
use std::fmt::Write;

/// One measured line of the plot.
struct Line {
    name: String,
    /// The line is dashed, because it shows another possible computation instead of eyebox.
    beside: bool,
    /// Pairs of x and error power over signal power.
    points: Vec<[f64; 2]>,
}

/// Errors along one axis.
pub struct Errors {
    title: String,
    /// The name of the axis x.
    axis: &'static str,
    /// Marks along x, and their labels.
    marks: Vec<(f64, String)>,
    lines: Vec<Line>,
}

impl Errors {
    /// Makes a plot without any measurement.
    pub fn new(title: &str, axis: &'static str, marks: impl IntoIterator<Item = (f64, String)>) -> Self {
        Self { title: title.into(), axis, marks: marks.into_iter().collect(), lines: Vec::new() }
    }

    /// Adds a point to the line of this name. A new name begins a line.
    pub fn add(&mut self, name: &str, beside: bool, x: f64, error: f64) {
        let at = self.lines.iter().position(|l| l.name == name).unwrap_or_else(|| {
            self.lines.push(Line { name: name.into(), beside, points: Vec::new() });
            self.lines.len() - 1
        });
        self.lines[at].points.push([x, error]);
    }

    /// Returns a table in Markdown with a row for each x.
    pub fn table(&self) -> String {
        let mut text = format!("{}\n\n| {} |", self.title, self.axis);
        self.lines.iter().for_each(|l| {
            let _ = write!(text, " {} |", l.name);
        });
        let _ = write!(text, "\n|---|{}", "---|".repeat(self.lines.len()));
        for (x, mark) in &self.marks {
            let _ = write!(text, "\n| {mark} |");
            for line in &self.lines {
                let value = line.points.iter().find(|p| p[0] == *x).map(|p| p[1]);
                let _ = match value {
                    Some(0.0) => write!(text, " 0 |"),
                    Some(value) => write!(text, " {value:.1e} |"),
                    None => write!(text, " |"),
                };
            }
        }
        text
    }

    /// Returns the plot as the text of a complete file.
    pub fn draw(&self) -> String {
        let x = Axis::log(self.axis).ticks(self.marks.clone());
        let mut plot = Plot::new(&self.title, x, Axis::log("error power / signal power")).sized(640.0, 260.0);
        for (i, line) in self.lines.iter().enumerate() {
            let class = format!("m{i}{}", if line.beside { " beside" } else { "" });
            let points: Vec<[f64; 2]> = line.points.iter().copied().filter(|p| p[1] > 0.0).collect();
            plot.series(&class, &line.name, &points);
            plot.legend(&class, &line.name);
        }
        plot.file()
    }
}
