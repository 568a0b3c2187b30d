//! The plot of a study: decibels against milliseconds since the eye landed.

use crate::report::document;
use crate::report::svg::{Scale, Svg, escape, ticks};
use eyebox::session::{Study, StudySample};
use serde_json::Value;
use std::fmt::Write;

const SIZE: [f64; 2] = [760.0, 330.0];
const LEFT: f64 = 52.0;
const TOP: f64 = 18.0;
const BOTTOM: f64 = 44.0;

/// The page: gain since landing, quality over time, and the numbers.
pub fn page(title: &str, engine: &str, study: &Study, summary: &Value) -> String {
    let mut body = format!("<h1>{}</h1><p>{}</p>", escape(title), escape(engine));
    let number = |name: &str, of: &str| summary[name][of].as_f64().map_or("-".into(), |v| format!("{v:+.2} dB"));
    let _ = write!(
        body,
        "<p>What the eye sees, against the same hologram unsteered: <b>{}</b> at the end of a fixation (at least {}), {} \
         within 50 ms of landing (at least {}); never less than {:+.2} dB. A step of one colour takes {:.2} ms.</p>",
        number("end_of_fixation_db", "mean"),
        number("end_of_fixation_db", "least"),
        number("within_50_ms_db", "mean"),
        number("within_50_ms_db", "least"),
        study.worst_db(),
        study.step_ms
    );
    let _ = write!(
        body,
        "<h2>Gain since the eye landed</h2><figure>{}<figcaption>Each dot is a set at its light; the line is their mean over 20 ms. Time runs from the end of the saccade to the middle of the set's light.</figcaption></figure>",
        since_landing(&study.moments)
    );
    let _ = write!(
        body,
        "<h2>Over time</h2><figure>{}<figcaption>PSNR at the eye, mean over the colours: steered, and the same hologram unsteered (pale). The shaded times are saccades.</figcaption></figure>",
        over_time(&study.moments)
    );
    document(title, &body)
}

fn axes(svg: &mut Svg, [x, y]: [&Scale; 2], xs: &[f64], ys: &[f64], labels: [&str; 2]) {
    let [w, h] = SIZE;
    for v in ys {
        svg.line("grid", [LEFT, y.at(*v)], [w - 10.0, y.at(*v)]);
        svg.text("tick", "end", [LEFT - 6.0, y.at(*v) + 4.0], &format!("{v}"));
    }
    for v in xs {
        svg.text("tick", "middle", [x.at(*v), h - BOTTOM + 18.0], &format!("{v}"));
    }
    svg.text("tick", "middle", [(LEFT + w) / 2.0, h - 8.0], labels[0]);
    svg.text("tick", "start", [4.0, 12.0], labels[1]);
}

/// Decibels against milliseconds since landing.
pub fn since_landing(moments: &[StudySample]) -> String {
    let landed: Vec<(f64, &StudySample)> = moments.iter().filter_map(|m| m.since_landing_ms.map(|t| (t, m))).collect();
    let [w, h] = SIZE;
    let mut svg = Svg::new(w, h, "gain in decibels against milliseconds since the eye landed");
    let (ys, yr) = ticks(landed.iter().map(|(_, m)| m.gain_db()).chain([0.0]), 8);
    let (xs, xr) = ticks(landed.iter().map(|(t, _)| *t).chain([0.0]), 8);
    let (x, y) = (Scale::linear(xr, [LEFT, w - 10.0]), Scale::linear(yr, [h - BOTTOM, TOP]));
    axes(&mut svg, [&x, &y], &xs, &ys, ["ms since landing", "dB above unsteered"]);
    for (t, m) in &landed {
        let text = format!("{t:.0} ms: {:.1} dB, {:.1} unsteered", m.steered_db, m.whole_db);
        svg.dot("m0 speck", [x.at(*t), y.at(m.gain_db())], 2.4, &text);
    }
    let mut line = Vec::new();
    let longest = landed.iter().map(|(t, _)| *t).fold(0.0, f64::max);
    for bin in 0..(longest / 20.0).ceil() as usize {
        let inside = |t: f64| (bin as f64 * 20.0..(bin + 1) as f64 * 20.0).contains(&t);
        let gains: Vec<f64> = landed.iter().filter(|(t, _)| inside(*t)).map(|(_, m)| m.gain_db()).collect();
        if !gains.is_empty() {
            line.push([x.at(bin as f64 * 20.0 + 10.0), y.at(gains.iter().sum::<f64>() / gains.len() as f64)]);
        }
    }
    svg.path("line m1", &line);
    svg.finish()
}

/// Both over time.
pub fn over_time(moments: &[StudySample]) -> String {
    let [w, h] = SIZE;
    let mut svg = Svg::new(w, h, "PSNR at the eye over time, steered and unsteered");
    let (ys, yr) = ticks(moments.iter().flat_map(|m| [m.steered_db, m.whole_db]), 8);
    let (xs, xr) = ticks(moments.iter().map(|m| m.time_s).chain([0.0]), 10);
    let (x, y) = (Scale::linear(xr, [LEFT, w - 10.0]), Scale::linear(yr, [h - BOTTOM, TOP]));
    for pair in moments.windows(2).filter(|p| p[1].since_landing_ms.is_none() && p[1].jumps > 0) {
        let (from, to) = (x.at(pair[0].time_s), x.at(pair[1].time_s));
        svg.rect("shade", [from, TOP], [to - from, h - BOTTOM - TOP], "saccade");
    }
    axes(&mut svg, [&x, &y], &xs, &ys, ["s", "PSNR at the eye, dB"]);
    let of =
        |value: fn(&StudySample) -> f64| moments.iter().map(|m| [x.at(m.time_s), y.at(value(m))]).collect::<Vec<_>>();
    svg.path("line alone m1", &of(|m| m.whole_db));
    svg.path("line m0", &of(|m| m.steered_db));
    svg.finish()
}
