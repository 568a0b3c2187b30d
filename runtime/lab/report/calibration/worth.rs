//! What a calibration is worth in decibels, and what to mend on the bench.

use super::super::page::{figure, section, statements};
use super::super::plot::{Axis, Plot};
use eyebox::low_level::calibrate::Gain;
use maud::{Markup, html};

/// Faults that are worth mending, with what is turned for each.
pub(super) fn mend(gain: &Gain) -> Markup {
    let tags: Vec<String> = gain.mend.iter().map(|m| format!("{:.2} dB", m.costs_db)).collect();
    let all = gain.mend.iter().zip(&tags);
    let all = all.map(|(m, tag)| ("partly", m.fault.into(), &tag[..], vec![m.remedy.into()], String::new()));
    let body = html! {
        @if gain.mend.is_empty() {
            p { "No fault that can be mended on a bench costs 0.2 dB or more." }
        } @else {
            p {
                "These faults cost 0.2 dB or more although the model has them: a display without the fault is better by that. Mend \
                 the first one, and calibrate again."
            }
            (statements(all))
        }
    };
    section("mend", "Mend first", body)
}

/// The terms, those first that are worth most.
fn ranked(gain: &Gain) -> Vec<(&'static str, f64)> {
    let mut all: Vec<(&'static str, f64)> = gain.terms_db.iter().map(|(term, db)| (*term, *db)).collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all
}

/// Bars of what each term of the model gains.
fn bars(gain: &Gain) -> Plot {
    let all = ranked(gain);
    let x = Axis::linear("dB").covering([0.0]);
    let names = Axis::rows(all.iter().map(|(term, _)| term.to_string()));
    let mut plot = Plot::new("What each term of the model gains", x, names).sized(370.0, 24.0);
    for (i, (term, db)) in all.iter().enumerate() {
        let (row, hover) = (i as f64, format!("{term}: {db:.2} dB"));
        plot.rect("m0 bar", [db.min(0.0), row + 0.18], [db.max(0.0), row + 0.82], &hover);
        plot.text("small", [db.max(0.0), row + 0.5], [4.0, 3.5], "start", &format!("{db:.2}"));
    }
    plot
}

/// What the calibration and each of its terms are worth.
pub(super) fn decibels(gain: &Gain) -> Markup {
    let body = html! {
        p {
            (format!(
                "Built-in still life: {} x {} of the display's pixels, {} steps, mean of random pupils, seen on the fitted display. \
                 Solved for the display as its file was: {:.2} dB (worst pupil {:.2}). Solved for the fitted one: {:.2} dB (worst \
                 pupil {:.2}).",
                gain.size[0], gain.size[1], gain.steps, gain.before_db[0], gain.before_db[1], gain.after_db[0], gain.after_db[1]
            ))
        }
        @if !gain.terms_db.is_empty() {
            div.plots {
                (figure(&bars(gain), "Gained by each term", "a solve with the whole model less one without the term"))
            }
        }
    };
    section("worth", "Decibels", body)
}
