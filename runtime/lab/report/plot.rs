//! Defines the one type of plot, with marks in the units of its axes, drawn as SVG.
//!
//! Colors are CSS variables of the style sheet, so that a light and a dark page are both readable. The classes `m0`,
//! `m1`, ... are the colors of series.

use super::drawing::{self, Drawing, Element};
use super::text::width;
use maud::Markup;

/// The default width of a plot in pixels. A page shows it at this size or at the width of a phone.
const WIDTH: f64 = 370.0;
/// The left margin for tick labels, in pixels.
const NUMBERS: f64 = 44.0;
/// The smallest left margin for names of rows, in pixels.
const NAMES: f64 = 112.0;
const BELOW: f64 = 38.0;
/// The right margin, in pixels.
const MARGIN: f64 = 16.0;
const LEGEND: f64 = 170.0;
/// The largest number of ticks of an axis.
const MOST: usize = 7;
/// The rules of the style sheet that drawings need.
pub(super) const STYLE: &str = include_str!("plot.css");

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Linear,
    Log,
    /// Names, one for each row from the top. Row `i` spans `i` to `i + 1`.
    Rows(Vec<String>),
}

/// An axis with its name and its scale.
#[derive(Debug, Clone)]
pub struct Axis {
    name: String,
    kind: Kind,
    /// Smaller values are drawn at this value.
    floor: f64,
    /// Values that the axis covers in addition to the values of the marks.
    covered: Vec<f64>,
    /// Values with their labels. If there are none, the axis has round numbers.
    ticks: Vec<(f64, String)>,
    text: Option<fn(f64) -> String>,
}

impl Axis {
    fn new(name: &str, kind: Kind) -> Self {
        let (covered, ticks) = (Vec::new(), Vec::new());
        Self { name: name.into(), kind, floor: f64::NEG_INFINITY, covered, ticks, text: None }
    }

    /// Makes a linear axis.
    pub fn linear(name: &str) -> Self {
        Self::new(name, Kind::Linear)
    }

    /// Makes a logarithmic axis, whose values must be positive.
    pub fn log(name: &str) -> Self {
        Self::new(name, Kind::Log)
    }

    /// Makes an axis of named rows, with the first on top. Row `i` spans the values `i` to `i + 1`.
    pub fn rows(names: impl IntoIterator<Item = String>) -> Self {
        Self::new("", Kind::Rows(names.into_iter().collect()))
    }

    /// Draws values below `floor` at `floor`.
    pub fn floor(self, floor: f64) -> Self {
        Self { floor, ..self }
    }

    /// Extends the axis to these values.
    pub(crate) fn covering(self, values: impl IntoIterator<Item = f64>) -> Self {
        Self { covered: values.into_iter().collect(), ..self }
    }

    /// Replaces the round numbers by ticks at these values with these texts.
    pub fn ticks(self, ticks: impl IntoIterator<Item = (f64, String)>) -> Self {
        Self { ticks: ticks.into_iter().collect(), ..self }
    }

    /// Sets the format of the numbers of ticks.
    pub fn text(self, text: fn(f64) -> String) -> Self {
        Self { text: Some(text), ..self }
    }

    /// Returns ticks and range for these values.
    fn laid_out(&self, values: impl Iterator<Item = f64>) -> (Vec<(f64, String)>, [f64; 2]) {
        let all = values.chain(self.covered.iter().copied()).filter(|v| v.is_finite()).map(|v| v.max(self.floor));
        let [low, high] = all.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
        let [low, high] = if low <= high { [low, high] } else { [1.0, 2.0] };
        let write = |marks: Vec<f64>, step: f64| -> Vec<(f64, String)> {
            let text = |v: f64| self.text.map_or_else(|| number(v, step), |text| text(v));
            marks.into_iter().map(|v| (v, text(v))).collect()
        };
        match &self.kind {
            Kind::Rows(names) => (Vec::new(), [0.0, names.len() as f64]),
            Kind::Log => {
                let range = if high > low { [low / 1.06, high * 1.06] } else { [low / 1.5, high * 1.5] };
                let ticks = if self.ticks.is_empty() { write(decades(range), 0.0) } else { self.ticks.clone() };
                (ticks, range)
            }
            Kind::Linear if self.ticks.is_empty() => {
                let (marks, step) = round_numbers([low, high], MOST);
                let range = [marks[0], marks[marks.len() - 1]];
                (write(marks, step), range)
            }
            Kind::Linear => {
                let part = 0.03 * (high - low).max(1e-9);
                (self.ticks.clone(), [low - part, high + part])
            }
        }
    }
}

/// Returns about `most` round numbers that cover a range, and the step between them.
fn round_numbers([low, high]: [f64; 2], most: usize) -> (Vec<f64>, f64) {
    let wide = (high - low).max(1e-6 * high.abs()).max(1e-9);
    let rough = wide / (most.max(2) - 1) as f64;
    let unit = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0].map(|k| k * unit).into_iter().find(|s| *s >= rough * 0.999).unwrap_or(10.0 * unit);
    let (first, last) = ((low / step).floor(), ((high / step).ceil()).max((low / step).floor() + 1.0));
    ((0..=(last - first) as usize).map(|i| (first + i as f64) * step).collect(), step)
}

/// Returns the ticks of a logarithmic axis.
fn decades([low, high]: [f64; 2]) -> Vec<f64> {
    let wide = (high / low).log10();
    let parts: &[f64] = match wide {
        w if w < 0.8 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
        w if w < 2.0 => &[1.0, 2.0, 5.0],
        _ => &[1.0],
    };
    let every = (wide / 8.0).ceil().max(1.0) as usize;
    let powers = (low.log10().floor() as i32..=high.log10().ceil() as i32).step_by(every);
    let all = powers.flat_map(|e| parts.iter().map(move |p| p * 10f64.powi(e)));
    all.filter(|v| (low..=high).contains(v)).collect()
}

/// Formats the number of a tick with the digits of its step. Without a step, it has three significant digits.
fn number(value: f64, step: f64) -> String {
    let size = if step > 0.0 { step } else { value.abs() / 100.0 };
    if step == 0.0 && !(1e-3..1e6).contains(&value.abs()) {
        return format!("{value:.0e}");
    }
    let digits = (-size.max(1e-9).log10().floor()).max(0.0) as usize;
    let text = format!("{value:.digits$}");
    let text = if step == 0.0 && text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') {
        text.trim_start_matches('-').into()
    } else {
        text.into()
    }
}

#[derive(Debug, Clone)]
enum Shape {
    Line(Vec<[f64; 2]>),
    Dot([f64; 2], f64),
    Rect([f64; 2], [f64; 2]),
    /// The place, the offset from it in pixels, the `text-anchor` and the text.
    Text([f64; 2], [f64; 2], &'static str, String),
}

#[derive(Debug, Clone)]
struct Mark {
    class: String,
    hover: String,
    shape: Shape,
}

/// A plot that is being built. Marks are drawn in the order in which they were added.
#[derive(Debug, Clone)]
pub struct Plot {
    title: String,
    x: Axis,
    y: Axis,
    width: f64,
    /// The height of the drawing area, or of one row if there are rows, in pixels.
    height: f64,
    marks: Vec<Mark>,
    /// The class and the name of each series, written at the right.
    legend: Vec<(String, String)>,
}

impl Plot {
    /// Makes an empty plot. Screen readers read `title`.
    pub fn new(title: &str, x: Axis, y: Axis) -> Self {
        let height = if matches!(y.kind, Kind::Rows(_)) { 28.0 } else { 212.0 };
        Self { title: title.into(), x, y, width: WIDTH, height, marks: Vec::new(), legend: Vec::new() }
    }

    /// Sets the total width, and the height of the drawing area or of each row, in pixels.
    pub fn sized(self, width: f64, height: f64) -> Self {
        Self { width, height, ..self }
    }

    fn add(&mut self, class: &str, hover: &str, shape: Shape) {
        self.marks.push(Mark { class: class.into(), hover: hover.into(), shape });
    }

    /// Adds straight lines through points.
    pub fn line(&mut self, class: &str, points: Vec<[f64; 2]>) {
        self.add(class, "", Shape::Line(points));
    }

    /// Adds a disc of `radius` pixels. `hover` is its tooltip.
    pub fn dot(&mut self, class: &str, at: [f64; 2], radius: f64, hover: &str) {
        self.add(class, hover, Shape::Dot(at, radius));
    }

    /// Adds a rectangle between two corners. Infinite coordinates end at the edge.
    pub(crate) fn rect(&mut self, class: &str, from: [f64; 2], to: [f64; 2], hover: &str) {
        self.add(class, hover, Shape::Rect(from, to));
    }

    /// Adds text at this offset in pixels from a place. `anchor` is start, middle or end. The text moves down if it
    /// would cover other text.
    pub fn text(&mut self, class: &str, at: [f64; 2], offset: [f64; 2], anchor: &'static str, text: &str) {
        self.add(class, "", Shape::Text(at, offset, anchor, text.into()));
    }

    /// Adds a line with a dot at each point. The tooltip of a dot has its value.
    pub fn series(&mut self, class: &str, name: &str, points: &[[f64; 2]]) {
        self.line(&format!("{class} line"), points.to_vec());
        for [x, y] in points {
            let hover = format!("{name}: {} at {}", number(*y, 0.0), number(*x, 0.0));
            self.dot(&format!("{class} dot"), [*x, *y], 3.0, &hover);
        }
    }

    /// Adds a box plot along x with the lowest value, quartile, median, quartile and highest value, and the mean if it
    /// is given. Its middle and height are in rows.
    pub(crate) fn boxes(
        &mut self,
        class: &str,
        [middle, tall]: [f64; 2],
        five: [f64; 5],
        mean: Option<f64>,
        hover: &str,
    ) {
        let [low, q25, median, q75, high] = five;
        let across = |x: f64, part: f64| vec![[x, middle - part * tall], [x, middle + part * tall]];
        self.line(class, vec![[low, middle], [high, middle]]);
        self.line(class, across(low, 0.25));
        self.line(class, across(high, 0.25));
        self.rect(class, [q25, middle - tall / 2.0], [q75, middle + tall / 2.0], hover);
        self.line(&format!("{class} median"), across(median, 0.5));
        if let Some(mean) = mean {
            self.dot(&format!("{class} mean"), [mean, middle], 2.2, hover);
        }
    }

    /// Adds a bar along x from `from`, with its value at its end.
    pub fn bar(&mut self, class: &str, [top, bottom]: [f64; 2], [from, to]: [f64; 2], hover: &str, value: &str) {
        self.rect(class, [from, top], [to, bottom], hover);
        self.text("small", [to, (top + bottom) / 2.0], [4.0, 3.5], "start", value);
    }

    /// Names a series at the right of the plot and narrows the drawing area for it.
    pub fn legend(&mut self, class: &str, name: &str) {
        self.legend.push((class.into(), name.into()));
    }

    /// Adds the names of all series at the right and widens the plot for them.
    pub(crate) fn with_legend(mut self, series: impl IntoIterator<Item = (String, String)>) -> Self {
        self.legend.extend(series);
        self.width += LEGEND - MARGIN;
        self
    }

    /// Draws the plot as an element of a page.
    pub fn svg(&self) -> Markup {
        self.laid_out().markup()
    }

    /// Draws the plot as a separate SVG file, with its title, in fixed colors on white.
    pub fn file(&self) -> String {
        self.laid_out().svg_file()
    }

    /// Draws the plot as a PDF of one page, with its title, in fixed colors on white.
    pub fn pdf(&self) -> Vec<u8> {
        self.laid_out().pdf_file()
    }

    fn laid_out(&self) -> Drawing {
        let is_rows = matches!(self.y.kind, Kind::Rows(_));
        let along = |k: usize| self.marks.iter().flat_map(move |m| m.shape.values(k));
        let ((x_ticks, x_range), (y_ticks, y_range)) = (self.x.laid_out(along(0)), self.y.laid_out(along(1)));
        let (left, top) = match &self.y.kind {
            Kind::Rows(names) => (names.iter().map(|n| 12.5 * width(n, false) + 14.0).fold(NAMES, f64::max), 4.0),
            _ => (NUMBERS, 22.0),
        };
        let right = self.width - if self.legend.is_empty() { MARGIN } else { LEGEND };
        let bottom = top + if is_rows { self.height * y_range[1] } else { self.height };
        let pixels = if is_rows { [top, bottom] } else { [bottom, top] };
        let x = Scale { range: x_range, pixels: [left, right], is_log: self.x.kind == Kind::Log };
        let y = Scale { range: y_range, pixels, is_log: self.y.kind == Kind::Log };
        let mut elements = Vec::new();
        let mut add = |class: &str, shape| elements.push(Element { class: class.into(), hover: String::new(), shape });
        let text = |at, anchor, text: &str| drawing::Shape::Text(at, anchor, text.into());
        for (value, name) in &x_ticks {
            let at = x.at(*value);
            add("grid", drawing::Shape::Line(vec![[at, top], [at, bottom]]));
            add("tick", text([at, bottom + 15.0], "middle", name));
        }
        for (value, name) in &y_ticks {
            let at = y.at(*value);
            add("grid", drawing::Shape::Line(vec![[left, at], [right, at]]));
            add("tick", text([left - 6.0, at + 4.0], "end", name));
        }
        if let Kind::Rows(names) = &self.y.kind {
            for (i, name) in names.iter().enumerate() {
                add("name", text([left - 10.0, y.at(i as f64 + 0.5) + 4.0], "end", name));
            }
        }
        add("axis", text([4.0, 11.0], "start", &self.y.name));
        add("axis", text([right, bottom + 31.0], "end", &self.x.name));
        let mut taken = Vec::new();
        elements.extend(self.marks.iter().map(|mark| mark.laid_out(&x, &y, &mut taken)));
        for (i, (class, name)) in self.legend.iter().enumerate() {
            let shape = text([right + 12.0, top + 10.0 + 16.0 * i as f64], "start", name);
            elements.push(Element { class: format!("{class} label"), hover: String::new(), shape });
        }
        Drawing { title: self.title.clone(), width: self.width, height: bottom + BELOW, elements }
    }
}

impl Shape {
    /// Returns the coordinates of the shape along axis `k`.
    fn values(&self, k: usize) -> impl Iterator<Item = f64> {
        let points = match self {
            Self::Line(points) => points.clone(),
            Self::Dot(at, _) | Self::Text(at, ..) => vec![*at],
            Self::Rect(from, to) => vec![*from, *to],
        };
        points.into_iter().map(move |point| point[k])
    }
}

impl Mark {
    /// Converts the mark to pixels. `taken` has the places of the texts before it.
    fn laid_out(&self, x: &Scale, y: &Scale, taken: &mut Vec<[f64; 2]>) -> Element {
        let at = |[a, b]: [f64; 2]| [x.at(a), y.at(b)];
        let shape = match &self.shape {
            Shape::Line(points) => drawing::Shape::Line(points.iter().map(|p| at(*p)).collect()),
            Shape::Dot(place, radius) => drawing::Shape::Circle(at(*place), *radius),
            Shape::Rect(from, to) => {
                let ([x0, y0], [x1, y1]) = (at(*from), at(*to));
                drawing::Shape::Rect([x0.min(x1), y0.min(y1)], [(x1 - x0).abs(), (y1 - y0).abs()])
            }
            Shape::Text(place, [dx, dy], anchor, text) => {
                let [a, b] = at(*place);
                let mut at = [a + dx, b + dy];
                while taken.iter().any(|[u, v]| (u - at[0]).abs() < 62.0 && (v - at[1]).abs() < 9.0) {
                    at[1] += 3.0;
                }
                taken.push(at);
                drawing::Shape::Text(at, anchor, text.clone())
            }
        };
        Element { class: self.class.clone(), hover: self.hover.clone(), shape }
    }
}

/// Converts values to pixels.
#[derive(Debug, Clone, Copy)]
struct Scale {
    range: [f64; 2],
    pixels: [f64; 2],
    is_log: bool,
}

impl Scale {
    /// Returns the pixel of a value. Values outside the range are drawn at the edge.
    fn at(&self, value: f64) -> f64 {
        let of = |v: f64| if self.is_log { v.ln() } else { v };
        let ([a, b], [from, to]) = (self.range.map(of), self.pixels);
        from + (of(value.clamp(self.range[0], self.range[1])) - a) / (b - a) * (to - from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_the_page() {
        let mut plot = Plot::new("a \"<b>\" & c", Axis::linear("<i>"), Axis::linear("y"));
        plot.text("x", [0.0; 2], [0.0; 2], "start", "<script>");
        plot.dot("m0", [1.0, 1.0], 2.0, "it's <b>");
        let drawn = plot.svg().into_string();
        assert!(!drawn.contains("<script>") && !drawn.contains("<b>") && !drawn.contains("<i>"), "{drawn}");
        assert!(drawn.contains("&quot;&lt;b&gt;&quot; &amp; c") && drawn.contains("<title>it's &lt;b&gt;</title>"));
    }

    #[test]
    fn ticks_are_round_and_cover() {
        let (marks, step) = round_numbers([18.3, 39.2], 6);
        assert_eq!((marks.as_slice(), step), ([15.0, 20.0, 25.0, 30.0, 35.0, 40.0].as_slice(), 5.0));
        let (marks, _) = round_numbers([0.012, 0.034], 5);
        assert!(marks[0] <= 0.012 && marks[marks.len() - 1] >= 0.034 && marks.len() <= 6, "{marks:?}");
        assert!((2..10).contains(&round_numbers([7.0, 7.0], 5).0.len()));
        assert!(decades([0.19, 0.8]).iter().zip([0.2, 0.3, 0.4, 0.5, 0.7]).all(|(a, b)| (a - b).abs() < 1e-12));
        assert!(decades([1e-16, 1e-6]).len() <= 8 && decades([20.0, 3200.0]) == [100.0, 1000.0]);
        let written = [number(-0.0, 0.5), number(2.5, 0.5), number(20.0, 5.0), number(0.15, 0.0), number(1e-12, 0.0)];
        assert_eq!(written, ["0.0", "2.5", "20", "0.15", "1e-12"]);
        assert_eq!((number(1000.0, 0.0), number(31.5, 0.0)), ("1000".into(), "31.5".into()));
    }

    #[test]
    fn scales_reach_their_ends() {
        let scale = Scale { range: [10.0, 20.0], pixels: [100.0, 0.0], is_log: false };
        assert_eq!([10.0, 20.0, 15.0, -5.0, f64::INFINITY].map(|v| scale.at(v)), [100.0, 0.0, 50.0, 100.0, 0.0]);
        let scale = Scale { range: [1.0, 16.0], pixels: [0.0, 40.0], is_log: true };
        assert!((scale.at(4.0) - 20.0).abs() < 1e-9);
    }

    #[test]
    fn nothing_to_draw_is_a_drawing() {
        for axis in [Axis::linear("x"), Axis::log("x")] {
            let drawn = Plot::new("empty", axis, Axis::linear("y").floor(0.0)).svg().into_string();
            assert!(drawn.starts_with("<svg") && !drawn.contains("NaN") && !drawn.contains("inf"), "{drawn}");
        }
    }
}
