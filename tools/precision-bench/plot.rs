//! A plot of error power over signal power, both axes logarithmic: one file that reads well on light and on dark.

use crate::svg::{Scale, Svg, escape};
use std::fmt::Write;

const WIDTH: f64 = 640.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 170.0;
const TOP: f64 = 44.0;
const HIGH: f64 = 260.0;
const AXIS: f64 = 44.0;

/// Colours of the lines and of the rest, by what the reader's system shows; the report's own.
const STYLE: &str = "svg{--paper:#fff;--ink:#22252a;--quiet:#646a72;--grid:#ebe8e1;--c0:#0b62b8;--c1:#c7581a;--c2:#2b8a57;--c3:#8458b3;\
--c4:#b83a75;--c5:#7b8a1c;font:12px system-ui,-apple-system,\"Segoe UI\",Roboto,Arial,sans-serif;background:var(--paper)}\
@media (prefers-color-scheme:dark){svg{--paper:#1b1e23;--ink:#e4e3df;--quiet:#9aa0a8;--grid:#30353d;--c0:#62abf2;--c1:#f09458;\
--c2:#66c792;--c3:#b795e2;--c4:#ec82b2;--c5:#bccb5e}}\
.paper{fill:var(--paper)}text{fill:var(--quiet)}.title{fill:var(--ink);font-size:14px;font-weight:600}.grid{stroke:var(--grid)}\
.m0{--c:var(--c0)}.m1{--c:var(--c1)}.m2{--c:var(--c2)}.m3{--c:var(--c3)}.m4{--c:var(--c4)}.m5{--c:var(--c5)}\
.line{fill:none;stroke:var(--c);stroke-width:2;stroke-linejoin:round}.beside.line{stroke-dasharray:5 4;stroke-width:1.5}\
.dot{fill:var(--c)}text.label{fill:var(--c)}";

/// One line of a plot.
pub struct Line {
    /// What was measured.
    pub name: String,
    /// Drawn dashed: not what eyebox does, but what it could do.
    pub beside: bool,
    /// (x, error power over signal power).
    pub points: Vec<[f64; 2]>,
}

/// Lines over one axis.
pub struct Plot {
    /// In words.
    pub title: String,
    /// What is along x, with its unit.
    pub axis: &'static str,
    /// Marks along x, and what is written at them.
    pub marks: Vec<(f64, String)>,
    /// The lines.
    pub lines: Vec<Line>,
}

impl Plot {
    /// A plot without lines yet.
    pub fn new(title: &str, axis: &'static str, marks: impl IntoIterator<Item = (f64, String)>) -> Self {
        Self { title: title.into(), axis, marks: marks.into_iter().collect(), lines: Vec::new() }
    }

    /// Adds a point to the line of this name, which is begun if it is new.
    pub fn add(&mut self, name: &str, beside: bool, x: f64, error: f64) {
        let at = self.lines.iter().position(|l| l.name == name).unwrap_or_else(|| {
            self.lines.push(Line { name: name.into(), beside, points: Vec::new() });
            self.lines.len() - 1
        });
        self.lines[at].points.push([x, error]);
    }

    /// A table in Markdown, a row for each x.
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

    /// The drawing, a file by itself.
    pub fn draw(&self) -> String {
        let all = || self.lines.iter().flat_map(|l| &l.points).filter(|p| p[1] > 0.0);
        let (low, high) = all().fold((f64::INFINITY, 0.0f64), |(a, b), p| (a.min(p[1]), b.max(p[1])));
        let (low, high) = if high > 0.0 { (low.log10().floor() as i32, high.log10().ceil() as i32) } else { (-16, -6) };
        let (bottom, right) = (TOP + HIGH, WIDTH - RIGHT);
        let mut svg = Svg::new(WIDTH, bottom + AXIS, &self.title);
        svg.rect("paper", [0.0, 0.0], [WIDTH, bottom + AXIS], "");
        svg.text("title", "start", [12.0, 22.0], &self.title);
        let y = Scale::log([10f64.powi(low), 10f64.powi(high)], [bottom, TOP]);
        let first = self.marks.first().map_or(1.0, |m| m.0);
        let last = self.marks.last().map_or(2.0, |m| m.0);
        let x = Scale::log([first, last], [LEFT, right]);
        let every = ((high - low) / 8).max(1);
        for power in (low..=high).filter(|p| (p - low) % every == 0) {
            let at = y.at(10f64.powi(power));
            svg.line("grid", [LEFT, at], [right, at]);
            svg.text("tick", "end", [LEFT - 8.0, at + 4.0], &format!("1e{power}"));
        }
        for (value, mark) in &self.marks {
            svg.line("grid", [x.at(*value), TOP], [x.at(*value), bottom]);
            svg.text("tick", "middle", [x.at(*value), bottom + 16.0], mark);
        }
        svg.text("axis", "end", [right, bottom + 34.0], self.axis);
        svg.text("axis", "start", [LEFT, TOP - 8.0], "error power / signal power");
        // Names stand at their line's end, moved apart where lines meet.
        let mut ends: Vec<(usize, f64)> = self
            .lines
            .iter()
            .enumerate()
            .filter_map(|(i, l)| l.points.iter().rev().find(|p| p[1] > 0.0).map(|p| (i, y.at(p[1]))))
            .collect();
        ends.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mut above = f64::NEG_INFINITY;
        for (_, at) in &mut ends {
            *at = at.max(above + 14.0);
            above = *at;
        }
        let over = (above - bottom).max(0.0);
        for (i, at) in ends {
            let line = &self.lines[i];
            let beside = if line.beside { " beside" } else { "" };
            let points: Vec<[f64; 2]> =
                line.points.iter().filter(|p| p[1] > 0.0).map(|p| [x.at(p[0]), y.at(p[1])]).collect();
            svg.path(&format!("m{} line{beside}", i % 6), &points);
            for (point, value) in points.iter().zip(line.points.iter().filter(|p| p[1] > 0.0)) {
                svg.dot(&format!("m{} dot", i % 6), *point, 2.6, &format!("{}: {:.1e}", line.name, value[1]));
            }
            svg.text(&format!("m{} label", i % 6), "start", [right + 10.0, at - over + 4.0], &line.name);
        }
        let drawn = svg.finish();
        drawn.replacen('>', &format!("><title>{}</title><style>{STYLE}</style>", escape(&self.title)), 1)
    }
}
