//! The report's plots.

use super::svg::{Scale, Svg, number, ticks};
use super::{Report, Series};
use eyebox::evaluate::{Group, Summary};

/// Width of every drawing: it is shown at this size, or a phone's width.
const WIDTH: f64 = 370.0;
/// Room for names at the left of horizontal plots.
const NAMES: f64 = 112.0;
const RIGHT: f64 = 14.0;
/// Room for the axis.
const AXIS: f64 = 36.0;

/// Class of a method's colour; `more` are classes beside it.
fn tint(report: &Report, method: &str, more: &str) -> String {
    format!("m{} {more}", report.place(method) % 10)
}

/// PSNR as it is drawn: below 0 dB nothing is left to tell apart.
fn drawn(psnr: f64) -> f64 {
    psnr.max(0.0)
}

/// The box plots' axis: the same for all groups.
fn decibels(report: &Report) -> (Vec<f64>, [f64; 2]) {
    let mut values = Vec::new();
    for series in report.leading() {
        for group in Group::ALL {
            if let Some(s) = report.psnr(&series, None, Some(group)) {
                values.extend([s.worst, s.best].map(drawn));
            }
            values.extend(published(report, &series, group).into_iter().flat_map(|p| [p.min, p.max]).map(drawn));
        }
    }
    ticks(values, 7)
}

fn published<'a>(report: &'a Report, series: &Series, group: Group) -> Option<&'a super::Published> {
    report.published.iter().find(|p| p.is_of(&series.method, group.name()))
}

/// Vertical grid lines and their numbers.
fn vertical_grid(svg: &mut Svg, x: &Scale, marks: &[f64], top: f64, bottom: f64, unit: &str) {
    let step = marks.windows(2).next().map_or(1.0, |m| m[1] - m[0]);
    for &mark in marks {
        svg.line("grid", [x.at(mark), top], [x.at(mark), bottom]);
        svg.text("tick", "middle", [x.at(mark), bottom + 14.0], &number(mark, step));
    }
    svg.text("axis", "end", [WIDTH - RIGHT, bottom + 30.0], unit);
}

/// Box plots of one group: a row per method, published numbers under the measured ones.
pub fn boxes(report: &Report, group: Group) -> String {
    let all = report.leading();
    let beside = all.iter().any(|s| published(report, s, group).is_some());
    let row = if beside { 38.0 } else { 28.0 };
    let (marks, range) = decibels(report);
    let bottom = 6.0 + row * all.len() as f64;
    let mut svg = Svg::new(WIDTH, bottom + AXIS, &format!("PSNR of each method, {}", group.name()));
    let x = Scale::linear(range, [NAMES, WIDTH - RIGHT]);
    vertical_grid(&mut svg, &x, &marks, 2.0, bottom, "PSNR, dB");
    for (i, series) in all.iter().enumerate() {
        let top = 6.0 + row * i as f64;
        svg.text("name", "end", [NAMES - 10.0, top + 16.0], &report.title(&series.method));
        if let Some(s) = report.psnr(series, None, Some(group)) {
            let hover = format!(
                "{}: mean {:.1}, median {:.1}, quartiles {:.1} to {:.1}, worst {:.1}, best {:.1} dB",
                report.title(&series.method),
                s.mean,
                s.median,
                s.q25,
                s.q75,
                s.worst,
                s.best
            );
            let five = [s.worst, s.q25, s.median, s.q75, s.best];
            one_box(&mut svg, &tint(report, &series.method, "box"), &x, top + 12.0, 14.0, five, Some(s.mean), &hover);
        }
        if let Some(p) = published(report, series, group) {
            let hover = format!(
                "published, {} scores: mean {:.1}, median {:.1}, quartiles {:.1} to {:.1}, worst {:.1}, best {:.1} dB",
                p.n, p.mean, p.median, p.q25, p.q75, p.min, p.max
            );
            let five = [p.min, p.q25, p.median, p.q75, p.max];
            one_box(&mut svg, &tint(report, &series.method, "box out"), &x, top + 27.0, 7.0, five, None, &hover);
        }
    }
    svg.finish()
}

#[allow(clippy::too_many_arguments)]
fn one_box(
    svg: &mut Svg,
    class: &str,
    x: &Scale,
    middle: f64,
    tall: f64,
    [low, q25, median, q75, high]: [f64; 5],
    mean: Option<f64>,
    hover: &str,
) {
    let [low, q25, median, q75, high] = [low, q25, median, q75, high].map(drawn);
    let (top, bottom) = (middle - tall / 2.0, middle + tall / 2.0);
    svg.line(class, [x.at(low), middle], [x.at(high), middle]);
    for end in [low, high] {
        svg.line(class, [x.at(end), middle - tall / 4.0], [x.at(end), middle + tall / 4.0]);
    }
    svg.rect(class, [x.at(q25), top], [x.at(q75) - x.at(q25), tall], hover);
    svg.line(&format!("{class} median"), [x.at(median), top], [x.at(median), bottom]);
    if let Some(mean) = mean {
        svg.dot(&format!("{class} mean"), [x.at(drawn(mean)), middle], 2.2, hover);
    }
}

/// Every random pupil as a dot, the worst one ringed.
pub fn scatter(report: &Report) -> String {
    let all = report.leading();
    let of = |s: &Series| report.rows(s, None, Some(Group::Random)).collect::<Vec<_>>();
    let (marks, range) = ticks(all.iter().flat_map(&of).map(|r| drawn(r.psnr)).collect::<Vec<_>>(), 7);
    let row = 46.0;
    let bottom = 4.0 + row * all.len() as f64;
    let mut svg = Svg::new(WIDTH, bottom + AXIS, "PSNR of every random pupil, by method");
    let x = Scale::linear(range, [NAMES, WIDTH - RIGHT]);
    vertical_grid(&mut svg, &x, &marks, 2.0, bottom, "PSNR, dB");
    for (i, series) in all.iter().enumerate() {
        let middle = 4.0 + row * (i as f64 + 0.5);
        let title = report.title(&series.method);
        svg.text("name", "end", [NAMES - 10.0, middle + 1.0], &title);
        let rows = of(series);
        let Some(summary) = Summary::of(&rows.iter().map(|r| r.psnr).collect::<Vec<_>>()) else { continue };
        svg.text("small", "end", [NAMES - 10.0, middle + 14.0], &format!("worst {:.1}", summary.worst));
        let hover = |r: &crate::evaluate::figures::Row| {
            let [px, py, d, z] = r.pupil_mm;
            format!(
                "{title}: {:.1} dB, {}, pupil at ({px:.1}, {py:.1}) mm, {d:.1} mm wide, focus {z:.2} mm",
                r.psnr, r.color
            )
        };
        for (k, r) in rows.iter().enumerate() {
            // Golden ratio: even, and the same on every run.
            let jitter = ((k as f64 * 0.618_034).fract() - 0.5) * row * 0.62;
            svg.dot(&tint(report, &series.method, "speck"), [x.at(drawn(r.psnr)), middle + jitter], 2.1, &hover(r));
            if r.psnr == summary.worst {
                svg.dot(&tint(report, &series.method, "ring"), [x.at(drawn(r.psnr)), middle + jitter], 5.0, &hover(r));
            }
        }
        svg.line(
            &tint(report, &series.method, "median"),
            [x.at(summary.mean), middle - 15.0],
            [x.at(summary.mean), middle + 15.0],
        );
    }
    svg.finish()
}

/// A line of a plot: class, what it is called, points.
struct Line {
    class: String,
    name: String,
    points: Vec<[f64; 2]>,
    dots: bool,
}

struct Frame<'a> {
    title: &'a str,
    x_name: &'a str,
    y_name: &'a str,
    x_marks: Vec<(f64, String)>,
    log_x: bool,
    log_y: bool,
}

fn lines(frame: &Frame, all: &[Line]) -> String {
    let (left, top, bottom) = (44.0, 22.0, 232.0);
    // Every plot that is not logarithmic is of PSNR.
    let shown = |k: usize, v: f64| if k == 1 && !frame.log_y { drawn(v) } else { v };
    let values = |k: usize| all.iter().flat_map(move |l| l.points.iter().map(move |p| shown(k, p[k])));
    let fold = |k: usize| values(k).fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
    let mut svg = Svg::new(WIDTH, bottom + AXIS, frame.title);
    if all.iter().all(|l| l.points.is_empty()) {
        return svg.finish();
    }
    let pixels = [left + 8.0, WIDTH - RIGHT - 8.0];
    let x = if frame.log_x { Scale::log(fold(0), pixels) } else { Scale::linear(fold(0), pixels) };
    let (marks, y) = if frame.log_y {
        let [low, high] = fold(1);
        let step = [0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0];
        let range = [low / 1.08, high * 1.08];
        let marks: Vec<f64> = step.into_iter().filter(|m| (range[0]..=range[1]).contains(m)).collect();
        (marks, Scale::log(range, [bottom, top]))
    } else {
        let (marks, range) = ticks(values(1), 6);
        (marks, Scale::linear(range, [bottom, top]))
    };
    let step = marks.windows(2).map(|m| m[1] - m[0]).fold(f64::INFINITY, f64::min);
    for mark in marks {
        svg.line("grid", [left, y.at(mark)], [WIDTH - RIGHT, y.at(mark)]);
        svg.text(
            "tick",
            "end",
            [left - 6.0, y.at(mark) + 4.0],
            &number(mark, if step.is_finite() { step } else { 0.1 }),
        );
    }
    svg.text("axis", "start", [4.0, 11.0], frame.y_name);
    for (mark, text) in &frame.x_marks {
        svg.line("mark", [x.at(*mark), bottom], [x.at(*mark), bottom + 4.0]);
        svg.text("tick", "middle", [x.at(*mark), bottom + 17.0], text);
    }
    svg.text("axis", "end", [WIDTH - RIGHT, bottom + 32.0], frame.x_name);
    for line in all {
        let at: Vec<[f64; 2]> = line.points.iter().map(|[a, b]| [x.at(*a), y.at(shown(1, *b))]).collect();
        svg.path(&format!("{} line", line.class), &at);
        if line.dots {
            for ([a, b], place) in line.points.iter().zip(at) {
                let digits = if frame.log_y { 3 } else { 1 };
                svg.dot(&format!("{} dot", line.class), place, 3.0, &format!("{}: {b:.digits$} at {a:.2}", line.name));
            }
        }
    }
    svg.finish()
}

/// Marks of an axis: every value, or every other one where they are many.
fn marks_of(values: &[f64], digits: usize) -> Vec<(f64, String)> {
    let every = values.len().div_ceil(6).max(1);
    values.iter().step_by(every).map(|v| (*v, number(*v, 10f64.powi(-(digits as i32))))).collect()
}

fn group_lines(report: &Report, group: Group, x: impl Fn(&[f64; 4]) -> f64) -> (Vec<Line>, Vec<f64>) {
    let mut xs: Vec<f64> = Vec::new();
    let mut all = Vec::new();
    for series in report.leading() {
        let mut points = Vec::new();
        for index in 0.. {
            let row = report.rows(&series, None, Some(group)).find(|r| r.index == index);
            let (Some(row), Some(psnr)) = (row, report.at(&series, None, group, index)) else { break };
            points.push([x(&row.pupil_mm), psnr]);
        }
        if xs.len() < points.len() {
            xs = points.iter().map(|p| p[0]).collect();
        }
        all.push(Line {
            class: tint(report, &series.method, ""),
            name: report.title(&series.method),
            points,
            dots: true,
        });
    }
    (all, xs)
}

/// Mean PSNR against the diameter of a centred pupil.
pub fn aperture(report: &Report) -> String {
    let (all, xs) = group_lines(report, Group::VaryingAperture, |p| p[2]);
    let x_marks = marks_of(&xs, 1);
    let title = "Mean PSNR against the diameter of a centred pupil";
    lines(&Frame { title, x_name: "diameter, mm", y_name: "PSNR, dB", x_marks, log_x: true, log_y: false }, &all)
}

/// Mean PSNR against the focus, from the scenes' far ends to their near ends.
pub fn focus(report: &Report) -> String {
    let (mut all, _) = group_lines(report, Group::FocalStack, |p| p[3]);
    // Scenes differ in depth: places in the stack are what they have in common.
    for line in &mut all {
        let last = line.points.len().max(2) - 1;
        line.points.iter_mut().enumerate().for_each(|(i, p)| p[0] = i as f64 / last as f64);
    }
    let x_marks = [(0.0, "far"), (0.5, "middle"), (1.0, "near")].map(|(v, t)| (v, t.to_string())).to_vec();
    let title = "Mean PSNR against the focus of a centred pupil as wide as the eyebox";
    lines(&Frame { title, x_name: "focus", y_name: "PSNR, dB", x_marks, log_x: false, log_y: false }, &all)
}

/// Mean PSNR over random pupils against the number of sub-frames; nothing where only one was compared.
pub fn frames(report: &Report) -> Option<String> {
    let mut counts: Vec<usize> = report.series().iter().map(|s| s.frames).collect();
    counts.sort_unstable();
    counts.dedup();
    if counts.len() < 2 {
        return None;
    }
    let of = |method: &str| -> Vec<[f64; 2]> {
        let series = report.series().into_iter().filter(|s| s.method == method);
        series.filter_map(|s| Some([s.frames as f64, report.psnr(&s, None, Some(Group::Random))?.mean])).collect()
    };
    let all: Vec<Line> = report
        .methods
        .iter()
        .map(|m| Line { class: tint(report, &m.name, ""), name: m.title.clone(), points: of(&m.name), dots: true })
        .collect();
    let x_marks = counts.iter().map(|c| (*c as f64, c.to_string())).collect();
    let title = "Mean PSNR over random pupils against the number of sub-frames";
    Some(lines(&Frame { title, x_name: "sub-frames", y_name: "PSNR, dB", x_marks, log_x: true, log_y: false }, &all))
}

/// Speckle contrast of one method against the number of sub-frames, both axes logarithmic.
pub fn speckle(report: &Report, figures: &crate::evaluate::figures::SpeckleFigures) -> String {
    let points = |of: &[(usize, f64)]| of.iter().map(|(n, c)| [*n as f64, *c]).collect::<Vec<_>>();
    let independent = points(&figures.independent);
    let one = independent.first().map_or(1.0, |p| p[1]);
    let class = tint(report, &figures.method, "");
    let all = [
        Line {
            class: "root".into(),
            name: "1/\u{221a}F".into(),
            points: independent.iter().map(|p| [p[0], one / p[0].sqrt()]).collect(),
            dots: false,
        },
        Line { class: format!("{class} alone"), name: "independent frames".into(), points: independent, dots: true },
        Line { class, name: "optimised together".into(), points: points(&figures.joint), dots: true },
    ];
    let x_marks = figures.independent.iter().map(|p| (p.0 as f64, p.0.to_string())).collect();
    let title = format!("Speckle contrast of {} against the number of sub-frames", report.title(&figures.method));
    lines(&Frame { title: &title, x_name: "sub-frames", y_name: "contrast", x_marks, log_x: true, log_y: true }, &all)
}

/// Two bars a method: near edges in depth, and elsewhere. Nothing where there is no colour error.
pub fn colors(report: &Report) -> Option<String> {
    let of = |s: &Series| {
        let errors: Vec<_> = report.runs_of(s, None).filter_map(|r| r.color_error).collect();
        let edges = super::stats::mean(errors.iter().filter_map(|e| e.edges));
        let elsewhere = super::stats::mean(errors.iter().filter_map(|e| e.elsewhere));
        (edges.is_some() || elsewhere.is_some()).then_some([edges, elsewhere])
    };
    let all: Vec<(Series, [Option<f64>; 2])> =
        report.leading().into_iter().filter_map(|s| of(&s).map(|v| (s, v))).collect();
    if all.is_empty() {
        return None;
    }
    let row = 34.0;
    let bottom = 6.0 + row * all.len() as f64;
    let mut svg = Svg::new(WIDTH, bottom + AXIS, "Mean CIEDE2000 near edges in depth and elsewhere, by method");
    let (marks, range) = ticks(all.iter().flat_map(|a| a.1).flatten().chain([0.0]), 7);
    let x = Scale::linear(range, [NAMES, WIDTH - RIGHT - 26.0]);
    vertical_grid(&mut svg, &x, &marks, 2.0, bottom, "CIEDE2000");
    for (i, (series, values)) in all.iter().enumerate() {
        let top = 6.0 + row * i as f64;
        let title = report.title(&series.method);
        svg.text("name", "end", [NAMES - 10.0, top + 18.0], &title);
        for (k, (value, what)) in values.iter().zip(["near edges", "elsewhere"]).enumerate() {
            let Some(value) = value else { continue };
            let place = [x.at(0.0), top + 3.0 + 12.0 * k as f64];
            let class = tint(report, &series.method, if k == 0 { "bar" } else { "bar pale" });
            svg.rect(&class, place, [x.at(*value) - x.at(0.0), 10.0], &format!("{title}, {what}: {value:.2}"));
            svg.text("small", "start", [x.at(*value) + 4.0, place[1] + 9.0], &format!("{value:.1}"));
        }
    }
    Some(svg.finish())
}

/// How uneven the light is over the eyebox, mean over colours and scenes.
pub fn variation(report: &Report) -> String {
    let of = |s: &Series| super::stats::mean(report.runs_of(s, None).flat_map(|r| &r.colors).map(|c| c.variation));
    let all: Vec<(Series, f64)> = report.leading().into_iter().filter_map(|s| of(&s).map(|v| (s, v))).collect();
    let row = 26.0;
    let bottom = 6.0 + row * all.len() as f64;
    let mut svg = Svg::new(WIDTH, bottom + AXIS, "Variation of the light over the eyebox, by method");
    let low = all.iter().map(|a| a.1).fold(f64::INFINITY, f64::min).max(1e-3);
    let high = all.iter().map(|a| a.1).fold(low, f64::max);
    let steps = [0.001, 0.01, 0.1, 1.0, 10.0];
    let from = steps.into_iter().rev().find(|s| *s <= low).unwrap_or(0.001);
    let to = (high * 1.1).max(from * 10.0);
    let x = Scale::log([from, to], [NAMES, WIDTH - RIGHT - 34.0]);
    for mark in [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0] {
        if (from..=to).contains(&mark) {
            svg.line("grid", [x.at(mark), 2.0], [x.at(mark), bottom]);
            svg.text("tick", "middle", [x.at(mark), bottom + 14.0], &format!("{mark}"));
        }
    }
    svg.text("axis", "end", [WIDTH - RIGHT, bottom + 30.0], "standard deviation / mean");
    for (i, (series, value)) in all.iter().enumerate() {
        let top = 6.0 + row * i as f64;
        let title = report.title(&series.method);
        svg.text("name", "end", [NAMES - 10.0, top + 14.0], &title);
        let class = tint(report, &series.method, "bar");
        svg.rect(&class, [NAMES, top + 3.0], [x.at(value.max(from)) - NAMES, 14.0], &format!("{title}: {value:.3}"));
        svg.text("small", "start", [x.at(value.max(from)) + 4.0, top + 14.0], &format!("{value:.2}"));
    }
    svg.finish()
}
