//! Draws a laid-out plot into a page, or as a separate SVG or PDF file.
//!
//! Shapes are in pixels and have the classes of the style sheet. A separate file has fixed colors on white and needs no
//! style sheet.

use super::text::width;
use maud::{Markup, PreEscaped, html};
use pdf_writer::types::TextRenderingMode;
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str};
use std::fmt::Write;

/// The points of a PDF per pixel.
const POINTS: f32 = 0.75;
/// The distance of the baselines of a title's lines, in pixels.
const TITLE_LINE: f64 = 17.0;

/// A laid-out plot, in pixels.
pub(super) struct Drawing {
    pub title: String,
    /// The size of the whole drawing.
    pub width: f64,
    pub height: f64,
    pub elements: Vec<Element>,
}

/// A shape with its classes and its tooltip.
pub(super) struct Element {
    pub class: String,
    pub hover: String,
    pub shape: Shape,
}

pub(super) enum Shape {
    Line(Vec<[f64; 2]>),
    /// The center and the radius.
    Circle([f64; 2], f64),
    /// The upper left corner, and the width and height.
    Rect([f64; 2], [f64; 2]),
    /// The place of the baseline, the anchor (`start`, `middle` or `end`) and the text.
    Text([f64; 2], &'static str, String),
}

/// Formats a number of pixels.
fn p(pixels: f64) -> String {
    format!("{pixels:.1}")
}

fn points(all: &[[f64; 2]]) -> String {
    all.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

type Rgb = [u8; 3];

/// The light colors of `plot.css`.
const CARD: Rgb = [255, 255, 255];
const INK: Rgb = [0x22, 0x25, 0x2a];
const QUIET: Rgb = [0x64, 0x6a, 0x72];
const GRID: Rgb = [0xeb, 0xe8, 0xe1];
const SERIES: [Rgb; 10] = [
    [0x0b, 0x62, 0xb8],
    [0xc7, 0x58, 0x1a],
    [0x2b, 0x8a, 0x57],
    [0x84, 0x58, 0xb3],
    [0xb8, 0x3a, 0x75],
    [0x7b, 0x8a, 0x1c],
    [0x12, 0x84, 0x8c],
    [0x8a, 0x6a, 0x3c],
    [0x56, 0x66, 0xc9],
    [0x6b, 0x72, 0x80],
];

/// The style of a shape without a style sheet. It copies the rules of `plot.css` for its classes, in light colors.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Paint {
    /// The color and its opacity.
    fill: Option<(Rgb, f64)>,
    stroke: Option<(Rgb, f64)>,
    width: f64,
    dash: Option<[f64; 2]>,
    /// The size of text, in pixels.
    size: f64,
    bold: bool,
    /// True for white around the letters.
    halo: bool,
}

impl Paint {
    fn of(element: &Element) -> Self {
        let has = |word: &str| element.class.split(' ').any(|w| w == word);
        let series = (0..SERIES.len()).find(|i| has(&format!("m{i}"))).map(|i| SERIES[i]);
        let c = series.unwrap_or(QUIET);
        let mut paint =
            Self { fill: None, stroke: None, width: 1.0, dash: None, size: 11.0, bold: false, halo: has("halo") };
        if let Shape::Text(..) = element.shape {
            let color = if has("name") || has("title") {
                INK
            } else if has("label") {
                c
            } else {
                QUIET
            };
            paint.fill = Some((color, 1.0));
            paint.bold = has("title");
            let sizes = [("title", 14.0), ("name", 11.5), ("small", 10.0), ("tick", 10.5), ("axis", 10.5)];
            paint.size = sizes.into_iter().find(|(word, _)| has(word)).map_or(11.0, |s| s.1);
            return paint;
        }
        let (full, mut line) = (
            |color| Some((color, 1.0)),
            |color, width| {
                paint.stroke = Some((color, if has("alone") && has("line") { 0.45 } else { 1.0 }));
                paint.width = width;
            },
        );
        match () {
            () if has("grid") => line(GRID, 1.0),
            () if has("line") => line(c, if has("root") || has("beside") { 1.5 } else { 2.0 }),
            () if has("box") || has("median") => {
                line(
                    c,
                    if !has("median") {
                        1.4
                    } else if has("out") {
                        1.6
                    } else {
                        2.6
                    },
                );
            }
            () if has("dot") => line(if has("alone") { c } else { CARD }, if has("alone") { 1.6 } else { 1.0 }),
            () if has("ring") => line(c, 1.5),
            () => {}
        }
        if has("out") && !has("median") {
            paint.width = 1.0;
        }
        paint.dash = match () {
            () if has("line") && (has("root") || has("beside")) => Some([5.0, 4.0]),
            () if has("out") && !has("median") => Some([2.5, 2.0]),
            () => None,
        };
        let is_line = matches!(element.shape, Shape::Line(_));
        paint.fill = match () {
            () if is_line || has("ring") || has("out") => None,
            () if has("paper") || has("mean") || (has("dot") && has("alone")) => full(CARD),
            () if has("dot") => full(c),
            () if has("speck") => Some((c, 0.55)),
            () if has("box") => Some((c, 0.28)),
            () if has("shade") => Some((GRID, 0.8)),
            () if has("bar") => Some((c, if has("pale") { 0.32 } else { 0.8 })),
            () if paint.stroke.is_none() => full(c),
            () => None,
        };
        if is_line && paint.stroke.is_none() {
            paint.stroke = full(c);
        }
        paint
    }

    /// Returns the style as attributes of SVG.
    fn attributes(&self, is_text: bool) -> String {
        let hex = |[r, g, b]: Rgb| format!("#{r:02x}{g:02x}{b:02x}");
        let mut text = String::new();
        let one = |name: &str, paint: Option<(Rgb, f64)>| match paint {
            None => format!(" {name}=\"none\""),
            Some((color, 1.0)) => format!(" {name}=\"{}\"", hex(color)),
            Some((color, opacity)) => format!(" {name}=\"{}\" {name}-opacity=\"{opacity}\"", hex(color)),
        };
        text += &one("fill", self.fill);
        if self.stroke.is_some() {
            let _ = write!(
                text,
                "{} stroke-width=\"{}\" stroke-linejoin=\"round\"",
                one("stroke", self.stroke),
                self.width
            );
        }
        if let Some([on, off]) = self.dash {
            let _ = write!(text, " stroke-dasharray=\"{on} {off}\"");
        }
        if is_text {
            let _ = write!(text, " font-size=\"{}\"", self.size);
            text += if self.bold { " font-weight=\"bold\"" } else { "" };
        }
        text
    }
}

impl Drawing {
    /// Draws an element of a page, which the style sheet colors.
    pub(super) fn markup(&self) -> Markup {
        html! {
            svg viewBox={ "0 0 " (self.width) " " (self.height) } role="img" aria-label=(self.title)
                xmlns="http://www.w3.org/2000/svg" {
                @for element in &self.elements { (element.markup()) }
            }
        }
    }

    /// Adds the title above, in lines as long as the drawing is wide, on white.
    fn titled(self) -> Self {
        let mut lines: Vec<String> = vec![String::new()];
        for word in self.title.split(' ') {
            let last = lines.last_mut().expect("there is one");
            let longer = if last.is_empty() { word.to_string() } else { format!("{last} {word}") };
            if width(&longer, true) * 14.0 <= self.width - 24.0 || last.is_empty() {
                *last = longer;
            } else {
                lines.push(word.into());
            }
        }
        let head = 13.0 + TITLE_LINE * lines.len() as f64;
        let height = self.height + head;
        let element = |class: &str, shape| Element { class: class.into(), hover: String::new(), shape };
        let mut elements = vec![element("paper", Shape::Rect([0.0, 0.0], [self.width, height]))];
        for (i, line) in lines.into_iter().enumerate() {
            elements.push(element("title", Shape::Text([12.0, 22.0 + TITLE_LINE * i as f64], "start", line)));
        }
        elements.extend(self.elements.into_iter().map(|e| e.lowered(head)));
        Self { height, elements, ..self }
    }

    /// Draws a separate SVG file that needs no style sheet.
    pub(super) fn svg_file(self) -> String {
        let titled = self.titled();
        let Self { title, width, height, elements } = &titled;
        html! {
            svg viewBox={ "0 0 " (width) " " (height) } width=(width) height=(height) xmlns="http://www.w3.org/2000/svg"
                font-family="Helvetica, Arial, 'Liberation Sans', sans-serif" {
                title { (title) }
                @for element in elements { (PreEscaped(element.plain())) }
            }
        }
        .into_string()
    }

    /// Draws a separate file as one page of PDF, made of lines and letters. It uses Helvetica, which all PDF readers
    /// have.
    pub(super) fn pdf_file(self) -> Vec<u8> {
        let titled = self.titled();
        let [catalog, tree, page, contents, plain, bold, info] = [1, 2, 3, 4, 5, 6, 7].map(Ref::new);
        let mut content = Content::new();
        // The coordinates are pixels from the upper left corner.
        content.transform([POINTS, 0.0, 0.0, -POINTS, 0.0, titled.height as f32 * POINTS]);
        let mut opacities: Vec<[f64; 2]> = Vec::new();
        for element in &titled.elements {
            element.write(&mut content, &mut opacities);
        }
        let mut pdf = Pdf::new();
        pdf.catalog(catalog).pages(tree);
        pdf.pages(tree).kids([page]).count(1);
        let mut sheet = pdf.page(page);
        sheet.parent(tree).contents(contents);
        sheet.media_box(Rect::new(0.0, 0.0, titled.width as f32 * POINTS, titled.height as f32 * POINTS));
        let mut resources = sheet.resources();
        resources.fonts().pair(Name(b"F"), plain).pair(Name(b"B"), bold);
        let mut states = resources.ext_g_states();
        for (i, [fill, stroke]) in opacities.iter().enumerate() {
            let name = format!("G{i}");
            states
                .insert(Name(name.as_bytes()))
                .start::<pdf_writer::writers::ExtGraphicsState>()
                .non_stroking_alpha(*fill as f32)
                .stroking_alpha(*stroke as f32);
        }
        states.finish();
        resources.finish();
        sheet.finish();
        for (at, name) in [(plain, &b"Helvetica"[..]), (bold, b"Helvetica-Bold")] {
            pdf.type1_font(at).base_font(Name(name)).encoding_predefined(Name(b"WinAnsiEncoding"));
        }
        pdf.document_info(info).title(pdf_writer::TextStr(&titled.title));
        pdf.stream(contents, &content.finish());
        pdf.finish()
    }
}

impl Element {
    fn markup(&self) -> Markup {
        let class = &self.class;
        let hover = html! { @if !self.hover.is_empty() { title { (self.hover) } } };
        match &self.shape {
            Shape::Line(all) => html! { polyline class=(class) points=(points(all)) {} },
            Shape::Circle([x, y], radius) => {
                html! { circle class=(class) cx=(p(*x)) cy=(p(*y)) r=(radius) { (hover) } }
            }
            Shape::Rect([x, y], [w, h]) => {
                html! { rect class=(class) x=(p(*x)) y=(p(*y)) width=(p(*w)) height=(p(*h)) rx="1.5" { (hover) } }
            }
            Shape::Text([x, y], anchor, text) => {
                html! { text class=(class) text-anchor=(anchor) x=(p(*x)) y=(p(*y)) { (text) } }
            }
        }
    }

    /// Draws the shape without classes.
    fn plain(&self) -> String {
        let paint = Paint::of(self);
        let style = paint.attributes(matches!(self.shape, Shape::Text(..)));
        let hover = html! { @if !self.hover.is_empty() { title { (self.hover) } } }.into_string();
        match &self.shape {
            Shape::Line(all) => format!("<polyline points=\"{}\"{style}/>", points(all)),
            Shape::Circle([x, y], r) => {
                format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r}\"{style}>{hover}</circle>")
            }
            Shape::Rect([x, y], [w, h]) => {
                format!("<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\"{style}>{hover}</rect>")
            }
            Shape::Text([x, y], anchor, text) => {
                let escaped = html! { (text) }.into_string();
                let text = |style: &str| {
                    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\"{style}>{escaped}</text>")
                };
                // Programs that ignore the order of painting need the halo as separate text behind the letters.
                let behind = Paint { stroke: Some((CARD, 1.0)), width: 3.0, ..paint };
                let behind = if paint.halo { text(&behind.attributes(true)) } else { String::new() };
                behind + &text(&style)
            }
        }
    }

    fn lowered(mut self, by: f64) -> Self {
        match &mut self.shape {
            Shape::Line(all) => all.iter_mut().for_each(|at| at[1] += by),
            Shape::Circle(at, _) | Shape::Rect(at, _) | Shape::Text(at, ..) => at[1] += by,
        }
        self
    }

    /// Writes the shape into the content of a PDF page. `opacities` lists the named pairs of the opacities of fill and
    /// stroke.
    fn write(&self, to: &mut Content, opacities: &mut Vec<[f64; 2]>) {
        let paint = Paint::of(self);
        let opacity = [paint.fill, paint.stroke].map(|paint| paint.map_or(1.0, |p| p.1));
        let state = opacities.iter().position(|o| *o == opacity).unwrap_or_else(|| {
            opacities.push(opacity);
            opacities.len() - 1
        });
        let part = |[r, g, b]: Rgb| [r, g, b].map(|v| f32::from(v) / 255.0);
        to.save_state().set_parameters(Name(format!("G{state}").as_bytes()));
        if let Some((color, _)) = paint.fill {
            let [r, g, b] = part(color);
            to.set_fill_rgb(r, g, b);
        }
        if let Some((color, _)) = paint.stroke {
            let [r, g, b] = part(color);
            to.set_stroke_rgb(r, g, b).set_line_width(paint.width as f32);
            to.set_line_join(pdf_writer::types::LineJoinStyle::RoundJoin);
        }
        if let Some(dash) = paint.dash {
            to.set_dash_pattern(dash.map(|v| v as f32), 0.0);
        }
        match &self.shape {
            Shape::Text(at, anchor, text) => letters(to, &paint, *at, anchor, text),
            shape => {
                outline(to, shape);
                match (paint.fill, paint.stroke) {
                    (Some(_), Some(_)) => to.fill_nonzero_and_stroke(),
                    (Some(_), None) => to.fill_nonzero(),
                    (None, Some(_)) => to.stroke(),
                    (None, None) => to.end_path(),
                };
            }
        }
        to.restore_state();
    }
}

/// Writes the path of a shape without text.
fn outline(to: &mut Content, shape: &Shape) {
    let f = |v: f64| v as f32;
    match shape {
        Shape::Line(all) => {
            for (i, [x, y]) in all.iter().enumerate() {
                if i == 0 {
                    to.move_to(f(*x), f(*y))
                } else {
                    to.line_to(f(*x), f(*y))
                };
            }
        }
        Shape::Rect([x, y], [w, h]) => {
            to.rect(f(*x), f(*y), f(*w), f(*h));
        }
        Shape::Circle([x, y], r) => {
            let (x, y, r) = (f(*x), f(*y), f(*r));
            // This is the factor of the Bezier curve that is closest to a quarter circle.
            let k = 0.552_284_8 * r;
            to.move_to(x + r, y);
            to.cubic_to(x + r, y + k, x + k, y + r, x, y + r);
            to.cubic_to(x - k, y + r, x - r, y + k, x - r, y);
            to.cubic_to(x - r, y - k, x - k, y - r, x, y - r);
            to.cubic_to(x + k, y - r, x + r, y - k, x + r, y);
            to.close_path();
        }
        Shape::Text(..) => {}
    }
}

fn letters(to: &mut Content, paint: &Paint, [x, y]: [f64; 2], anchor: &str, text: &str) {
    let wide = width(text, paint.bold) * paint.size;
    let x = match anchor {
        "end" => x - wide,
        "middle" => x - wide / 2.0,
        _ => x,
    };
    let bytes = super::text::win_ansi(text);
    let write = |to: &mut Content, mode| {
        to.begin_text().set_font(Name(if paint.bold { b"B" } else { b"F" }), paint.size as f32);
        to.set_text_rendering_mode(mode).set_text_matrix([1.0, 0.0, 0.0, -1.0, x as f32, y as f32]);
        to.show(Str(&bytes)).end_text();
    };
    if paint.halo {
        let [r, g, b] = CARD.map(|v| f32::from(v) / 255.0);
        to.set_stroke_rgb(r, g, b).set_line_width(3.0);
        write(to, TextRenderingMode::Stroke);
    }
    write(to, TextRenderingMode::Fill);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn element(class: &str, shape: Shape) -> Element {
        Element { class: class.into(), hover: "<b>".into(), shape }
    }

    fn drawing(elements: Vec<Element>) -> Drawing {
        Drawing { title: "Mean PSNR against the focus of a pupil & more".into(), width: 200.0, height: 50.0, elements }
    }

    #[test]
    fn every_class_of_the_style_sheet_is_drawn_without_it() {
        let line = || Shape::Line(vec![[0.0, 0.0], [1.0, 1.0]]);
        let rect = || Shape::Rect([0.0, 0.0], [1.0, 1.0]);
        let dot = || Shape::Circle([1.0, 1.0], 2.0);
        let of = |class: &str, shape: Shape| Paint::of(&element(class, shape));
        let (c0, c1) = (SERIES[0], SERIES[1]);
        assert_eq!((of("grid", line()).stroke, of("grid", line()).fill), (Some((GRID, 1.0)), None));
        assert_eq!(of("m1 line", line()).stroke, Some((c1, 1.0)));
        assert_eq!(of("m1 alone line", line()).stroke, Some((c1, 0.45)));
        assert_eq!(of("root line", line()).dash, Some([5.0, 4.0]));
        assert_eq!((of("m0 box", rect()).fill, of("m0 box out", rect()).fill), (Some((c0, 0.28)), None));
        assert_eq!((of("m0 box median", line()).width, of("m0 box out median", line()).dash), (2.6, None));
        assert_eq!(of("m0 box mean", dot()).fill, Some((CARD, 1.0)));
        assert_eq!((of("m0 dot", dot()).fill, of("m0 alone dot", dot()).fill), (Some((c0, 1.0)), Some((CARD, 1.0))));
        assert_eq!((of("m0 ring", dot()).fill, of("m0 speck", dot()).fill), (None, Some((c0, 0.55))));
        assert_eq!((of("shade", rect()).fill, of("m0 bar pale", rect()).fill), (Some((GRID, 0.8)), Some((c0, 0.32))));
        let text = || Shape::Text([0.0, 0.0], "start", "a".into());
        assert_eq!((of("m1 label", text()).fill, of("name halo", text()).halo), (Some((c1, 1.0)), true));
        let known = "alone axis bar beside box dot grid halo label line mean median name out pale paper ring root \
                     shade small speck text tick title";
        let sheet = super::super::plot::STYLE.split("svg .").skip(1);
        for class in sheet.flat_map(|rule| rule.split('{').next().unwrap_or_default().split('.')) {
            let class = class.split([',', ' ']).next().unwrap_or_default();
            assert!(known.split(' ').any(|k| k == class), "{class}: say in Paint::of how it is drawn");
        }
    }

    #[test]
    fn files_are_whole_and_their_titles_fit() {
        let all = || {
            vec![
                element("m0 box", Shape::Rect([1.0, 2.0], [3.0, 4.0])),
                element("name halo", Shape::Text([5.0, 5.0], "end", "a < b".into())),
                element("m0 dot", Shape::Circle([1.0, 1.0], 2.0)),
                element("m0 box out", Shape::Line(vec![[0.0, 0.0], [9.0, 9.0]])),
            ]
        };
        let svg = drawing(all()).svg_file();
        assert!(svg.matches("font-weight").count() == 2 && svg.contains("pupil &amp; more</text>"), "two lines: {svg}");
        assert!(svg.contains("a &lt; b") && !svg.contains("<b>") && !svg.contains("class"), "{svg}");
        let pdf = drawing(all()).pdf_file();
        let text = String::from_utf8_lossy(&pdf);
        for part in ["%PDF-", "(a < b) Tj", "/Helvetica", "/ca 0.28", "[2.5 2] 0 d", "%%EOF"] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}
