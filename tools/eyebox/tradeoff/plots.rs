//! The plots of a run: quality against time, and against memory.

use super::found::Found;
use crate::report::svg::{Scale, Svg, number, ticks};
use eyebox::quality::Trial;

const WIDTH: f64 = 370.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 38.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 22.0;
const BOTTOM: f64 = 44.0;

/// One plot: every trial as a dot, the front as a line, the recommended ones ringed and named.
pub struct Plot<'a> {
    /// For a screen reader.
    pub title: &'a str,
    /// Under the axis.
    pub x_name: &'a str,
    /// Above the other.
    pub y_name: &'a str,
    /// Its class: the colour.
    pub class: &'a str,
    /// Along the axis, which is logarithmic: positive.
    pub cost: &'a dyn Fn(&Trial) -> f64,
    /// Up.
    pub good: &'a dyn Fn(&Trial) -> f64,
    /// A cost, for people.
    pub cost_text: &'a dyn Fn(f64) -> String,
}

/// What a trial says under the mouse.
pub fn hover(trial: &Trial) -> String {
    format!(
        "{}: {}, {:.2} dB mean, {:.2} dB worst, {:.0} MiB",
        trial.recipe,
        time(trial.milliseconds),
        trial.mean,
        trial.worst,
        mebibytes(trial)
    )
}

/// Milliseconds for people.
pub fn time(milliseconds: f64) -> String {
    match milliseconds {
        ms if ms < 100.0 => format!("{ms:.1} ms"),
        ms if ms < 1000.0 => format!("{ms:.0} ms"),
        ms if ms < 10_000.0 => format!("{:.2} s", ms / 1e3),
        ms => format!("{:.1} s", ms / 1e3),
    }
}

/// Memory of a trial.
pub fn mebibytes(trial: &Trial) -> f64 {
    trial.bytes as f64 / f64::from(1 << 20)
}

/// Draws it. What is far below the front, a few per cent of the trials, stands on the lower edge.
pub fn draw(found: &Found, plot: &Plot, front: &[&Trial]) -> String {
    let Plot { title, x_name, y_name, class, cost, good, cost_text } = *plot;
    let mut svg = Svg::new(WIDTH, HEIGHT, title);
    let costs: Vec<f64> = found.trials.iter().map(cost).collect();
    let (low, high) = costs.iter().fold((f64::INFINITY, 0.0f64), |(a, b), c| (a.min(*c), b.max(*c)));
    let x = Scale::log([low / 1.15, high * 1.15], [LEFT, WIDTH - RIGHT]);
    // Half of the trials' span below the front's lowest is enough.
    let worst = front.first().map_or(0.0, |t| good(t));
    let best = front.last().map_or(1.0, |t| good(t));
    let bottom = worst - 0.5 * (best - worst).max(1.0);
    let inside = found.trials.iter().map(|t| good(t).max(bottom));
    let (marks, range) = ticks(inside, 7);
    let y = Scale::linear(range, [HEIGHT - BOTTOM, TOP]);
    let step = marks.windows(2).next().map_or(1.0, |m| m[1] - m[0]);
    for &mark in &marks {
        svg.line("grid", [LEFT, y.at(mark)], [WIDTH - RIGHT, y.at(mark)]);
        svg.text("tick", "end", [LEFT - 6.0, y.at(mark) + 4.0], &number(mark, step));
    }
    svg.text("axis", "start", [2.0, 11.0], y_name);
    let decades = (high / low).log10();
    let parts: &[f64] = if decades > 2.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    for mark in (-3..16).flat_map(|e| parts.iter().map(move |p| p * 10f64.powi(e))) {
        if (low / 1.15..=high * 1.15).contains(&mark) {
            svg.line("grid", [x.at(mark), TOP], [x.at(mark), HEIGHT - BOTTOM]);
            svg.text("tick", "middle", [x.at(mark), HEIGHT - BOTTOM + 15.0], &cost_text(mark));
        }
    }
    svg.text("axis", "end", [WIDTH - RIGHT, HEIGHT - 10.0], x_name);
    let at = |t: &Trial| [x.at(cost(t)), y.at(good(t).max(bottom))];
    for trial in &found.trials {
        svg.dot("root speck", at(trial), 2.6, &hover(trial));
    }
    let mut line: Vec<[f64; 2]> = Vec::new();
    for trial in front {
        // Up to here, the one before is the best.
        if let Some(before) = line.last() {
            line.push([at(trial)[0], before[1]]);
        }
        line.push(at(trial));
    }
    svg.path(&format!("{class} line"), &line);
    for trial in front {
        svg.dot(&format!("{class} dot"), at(trial), 3.4, &hover(trial));
    }
    for r in &found.recommended {
        let [px, py] = at(&r.trial);
        svg.dot(&format!("{class} ring"), [px, py], 6.5, &format!("{}: {}", r.quality.name(), hover(&r.trial)));
        // Beside the ring, where there is room and no front: below it, to the right, unless that is the edge.
        let (anchor, dx) = if px > WIDTH - 80.0 { ("end", 4.0) } else { ("start", 9.0) };
        svg.text("name halo", anchor, [px + dx, py + if anchor == "end" { 20.0 } else { 13.0 }], r.quality.name());
    }
    svg.finish()
}
