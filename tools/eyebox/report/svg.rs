//! A small SVG writer. Colours are CSS variables of the page, so that light and dark both read well; `m0`, `m1`, ... are
//! the methods' own.

use std::fmt::Write;

/// Text made safe for HTML and SVG, in attributes too.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            _ => out.push(c),
        }
    }
    out
}

/// A drawing in the making; lengths are pixels of a drawing that is shown at its own size or smaller.
pub struct Svg {
    width: f64,
    height: f64,
    title: String,
    body: String,
}

impl Svg {
    /// `title` is what a screen reader says.
    pub fn new(width: f64, height: f64, title: &str) -> Self {
        Self { width, height, title: title.into(), body: String::new() }
    }

    /// A line.
    pub fn line(&mut self, class: &str, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2]) {
        let _ = write!(self.body, r#"<line class="{class}" x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}"/>"#);
    }

    /// A rectangle, with what it says under the mouse.
    pub fn rect(&mut self, class: &str, [x, y]: [f64; 2], [w, h]: [f64; 2], hover: &str) {
        let _ = write!(
            self.body,
            r#"<rect class="{class}" x="{x:.1}" y="{y:.1}" width="{:.1}" height="{h:.1}" rx="1.5">{}</rect>"#,
            w.max(0.0),
            hovering(hover)
        );
    }

    /// A disc.
    pub fn dot(&mut self, class: &str, [x, y]: [f64; 2], radius: f64, hover: &str) {
        let _ = write!(
            self.body,
            r#"<circle class="{class}" cx="{x:.1}" cy="{y:.1}" r="{radius:.1}">{}</circle>"#,
            hovering(hover)
        );
    }

    /// Straight lines through points.
    pub fn path(&mut self, class: &str, points: &[[f64; 2]]) {
        let steps: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = write!(self.body, r#"<polyline class="{class}" points="{}"/>"#, steps.join(" "));
    }

    /// Text; `anchor` is start, middle or end.
    pub fn text(&mut self, class: &str, anchor: &str, [x, y]: [f64; 2], text: &str) {
        let text = escape(text);
        let _ =
            write!(self.body, r#"<text class="{class}" text-anchor="{anchor}" x="{x:.1}" y="{y:.1}">{text}</text>"#);
    }

    /// The element.
    pub fn finish(self) -> String {
        let Self { width, height, title, body } = self;
        let title = escape(&title);
        format!(
            r#"<svg viewBox="0 0 {width:.0} {height:.0}" role="img" aria-label="{title}" xmlns="http://www.w3.org/2000/svg">{body}</svg>"#
        )
    }
}

fn hovering(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("<title>{}</title>", escape(text)) }
}

/// From values to pixels.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    values: [f64; 2],
    pixels: [f64; 2],
    log: bool,
}

impl Scale {
    /// Linear, `values` onto `pixels`. An empty range gets a width.
    pub fn linear(values: [f64; 2], pixels: [f64; 2]) -> Self {
        let [a, b] = values;
        Self { values: if b > a { values } else { [a - 0.5, a + 0.5] }, pixels, log: false }
    }

    /// Logarithmic; values must be positive.
    pub fn log(values: [f64; 2], pixels: [f64; 2]) -> Self {
        let [a, b] = values;
        Self { values: if b > a { values } else { [a / 1.5, a * 1.5] }, pixels, log: true }
    }

    /// Where a value is.
    pub fn at(&self, value: f64) -> f64 {
        let of = |v: f64| if self.log { v.ln() } else { v };
        let [a, b] = self.values.map(of);
        self.pixels[0] + (of(value) - a) / (b - a) * (self.pixels[1] - self.pixels[0])
    }
}

/// Round numbers that cover the values, and a step between marks: at most `most` marks.
pub fn ticks(values: impl IntoIterator<Item = f64>, most: usize) -> (Vec<f64>, [f64; 2]) {
    let (low, high) = values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if low > high {
        return (vec![0.0, 1.0], [0.0, 1.0]);
    }
    let wide = (high - low).max(1e-6 * high.abs()).max(1e-9);
    let rough = wide / (most.max(2) - 1) as f64;
    let unit = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * unit).into_iter().find(|s| *s >= rough * 0.999).unwrap_or(10.0 * unit);
    let (first, last) = ((low / step).floor(), (high / step).ceil());
    let marks = (0..=(last - first) as usize).map(|i| (first + i as f64) * step).collect();
    (marks, [first * step, last * step])
}

/// A mark's number: no more digits than its step has.
pub fn number(value: f64, step: f64) -> String {
    let digits = (-step.abs().max(1e-9).log10().floor()).max(0.0) as usize;
    let text = format!("{value:.digits$}");
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') {
        text.trim_start_matches('-').into()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_the_page() {
        let mut svg = Svg::new(10.0, 10.0, "a \"<b>\" & c");
        svg.text("x", "start", [0.0, 0.0], "<script>");
        svg.dot("m0", [1.0, 1.0], 2.0, "it's <b>");
        let drawn = svg.finish();
        assert!(
            !drawn.contains("<script>") && !drawn.contains("<b>") && drawn.contains("&quot;&lt;b&gt;&quot; &amp; c")
        );
        assert!(drawn.contains("<title>it&#39;s &lt;b&gt;</title>"));
    }

    #[test]
    fn marks_are_round_and_cover() {
        let (marks, [low, high]) = ticks([18.3, 39.2], 6);
        assert_eq!((marks.as_slice(), low, high), ([15.0, 20.0, 25.0, 30.0, 35.0, 40.0].as_slice(), 15.0, 40.0));
        let (marks, [low, high]) = ticks([0.012, 0.034], 5);
        assert!(low <= 0.012 && high >= 0.034 && marks.len() <= 6, "{marks:?}");
        assert_eq!(ticks([], 5).1, [0.0, 1.0]);
        assert!(ticks([7.0], 5).1[0] <= 7.0 && ticks([7.0], 5).0.len() < 10);
        assert_eq!((number(-0.0, 0.5), number(2.5, 0.5), number(20.0, 5.0)), ("0.0".into(), "2.5".into(), "20".into()));
    }

    #[test]
    fn scales_reach_their_ends() {
        let s = Scale::linear([10.0, 20.0], [100.0, 0.0]);
        assert_eq!((s.at(10.0), s.at(20.0), s.at(15.0)), (100.0, 0.0, 50.0));
        let s = Scale::log([1.0, 16.0], [0.0, 40.0]);
        assert!((s.at(4.0) - 20.0).abs() < 1e-9);
        assert!(Scale::linear([3.0, 3.0], [0.0, 10.0]).at(3.0).is_finite());
    }
}
