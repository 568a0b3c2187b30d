//! Shows the gain of a calibration in decibels, and the faults of the bench to correct.

use super::super::page::{figure, section, statements};
use super::super::plot::{Axis, Plot};
use eyebox::low_level::calibrate::Gain;
use maud::{Markup, html};

/// Lists the faults that are worth a correction, with the adjustment for each.
pub(super) fn mend(gain: &Gain) -> Markup {
    let tags: Vec<String> = gain.mend.iter().map(|m| format!("{:.2} dB", m.costs_db)).collect();
    let all = gain.mend.iter().zip(&tags);
    let all = all.map(|(m, tag)| ("partly", m.fault.into(), &tag[..], vec![m.remedy.into()], String::new()));
    let body = html! {
        @if gain.mend.is_empty() {
            p { "No fault that can be corrected on a bench costs 0.2 dB or more." }
        } @else {
            p {
                "These faults cost 0.2 dB or more although the model contains them. A display without the fault is \
                 better by that amount. Correct the first fault, and calibrate again."
            }
            (statements(all))
        }
    };
    section("mend", "Faults to correct", body)
}

/// Sorts the terms by their gain, with the largest first.
fn ranked(gain: &Gain) -> Vec<(&'static str, f64)> {
    let mut all: Vec<(&'static str, f64)> = gain.terms_db.iter().map(|(term, db)| (*term, *db)).collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all
}

/// Draws the gain of each term of the model as bars.
fn bars(gain: &Gain) -> Plot {
    let all = ranked(gain);
    let x = Axis::linear("dB").covering([0.0]);
    let names = Axis::rows(all.iter().map(|(term, _)| term.to_string()));
    let mut plot = Plot::new("Gain of each term of the model", x, names).sized(370.0, 24.0);
    for (i, (term, db)) in all.iter().enumerate() {
        let (row, hover) = (i as f64, format!("{term}: {db:.2} dB"));
        plot.rect("m0 bar", [db.min(0.0), row + 0.18], [db.max(0.0), row + 0.82], &hover);
        plot.text("small", [db.max(0.0), row + 0.5], [4.0, 3.5], "start", &format!("{db:.2}"));
    }
    plot
}

/// Shows the gain of the calibration and of each of its terms.
pub(super) fn decibels(gain: &Gain) -> Markup {
    let body = html! {
        p {
            (format!(
                "The built-in still life on {} x {} of the display's pixels, with {} steps, scored on the fitted \
                 display as the mean of random pupils. A solve for the display of the original file has {:.2} dB \
                 (worst pupil {:.2}). A solve for the fitted display has {:.2} dB (worst pupil {:.2}).",
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
