//! Makes the page of a study of the refinement for the tracked pupil.

use super::page::{document, figure, section};
use super::plot::{Axis, Plot};
use crate::study::{Study, StudySample};
use maud::html;

/// The width of the bins in which gains are averaged, in milliseconds.
const BIN_MS: f64 = 20.0;

/// Returns the page with the gain since landing, the quality over time, and the numbers. `engine` is the description of
/// the engine.
pub(super) fn page(title: &str, engine: &str, study: &Study) -> String {
    let [end, soon] = [study.at_the_end_db(), study.within_db(50.0)].map(|all| {
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let least = all.iter().copied().fold(f64::INFINITY, f64::min);
        [mean, least].map(|v| if v.is_finite() { format!("{v:+.2} dB") } else { "-".into() })
    });
    let lead = "The image at the eye of a hologram refined for the tracked pupil, against the same hologram static.";
    let jod = study.at_the_end_jod();
    let jod = [0, 1].map(|i| match jod.is_empty() {
        true => "-".into(),
        false => format!("{:.2} JOD", jod.iter().map(|both| both[i]).sum::<f64>() / jod.len() as f64),
    });
    let facts = [
        ("At the end of a fixation", end[0].clone()),
        ("at least", end[1].clone()),
        ("JOD there", jod[0].clone()),
        ("JOD there, static", jod[1].clone()),
        ("Within 50 ms of a landing", soon[0].clone()),
        ("at least", soon[1].clone()),
        ("At any time at least", study.worst_db().map_or("-".into(), |db| format!("{db:+.2} dB"))),
        ("A step of one color", format!("{:.2} ms", study.step_ms)),
        ("Engine", engine.into()),
    ];
    let [(_, gain), (_, time)] = figures(study);
    let body = html! {
        (section("landing", "Gain since the eye landed", figure(
            &gain,
            "Each dot is a set at its light,",
            "and the line is the mean over 20 ms. Time begins at the end of the saccade and ends at the middle of the light.",
        )))
        (section("time", "Over time", figure(
            &time,
            "PSNR at the eye,",
            "mean over the colors, refined and static (pale). Saccades are shaded.",
        )))
    };
    document(title, lead, &facts, body)
}

/// Returns the plots of the page with the names of their files.
pub(super) fn figures(study: &Study) -> [(&'static str, Plot); 2] {
    let steered = [("m0", "refined"), ("m1 alone", "static")].map(|(class, name)| (class.into(), name.into()));
    [
        ("gain since landing", since_landing(&study.moments)),
        ("psnr over time", over_time(&study.moments).with_legend(steered)),
    ]
}

fn wide(title: &str, x: &str, y: &str) -> Plot {
    Plot::new(title, Axis::linear(x).covering([0.0]), Axis::linear(y)).sized(760.0, 268.0)
}

fn since_landing(moments: &[StudySample]) -> Plot {
    let landed: Vec<(f64, &StudySample)> = moments.iter().filter_map(|m| m.since_landing_ms.map(|t| (t, m))).collect();
    let mut plot =
        wide("gain in decibels against milliseconds since the eye landed", "ms since landing", "dB above static");
    for (t, m) in &landed {
        let text = format!("{t:.0} ms: {:.1} dB, {:.1} dB static", m.steered_db, m.whole_db);
        plot.dot("m0 speck", [*t, m.gain_db()], 2.4, &text);
    }
    let longest = landed.iter().map(|(t, _)| *t).fold(0.0, f64::max);
    let mean = |bin: usize| {
        let inside = landed.iter().filter(|(t, _)| (t / BIN_MS).floor() == bin as f64);
        let gains: Vec<f64> = inside.map(|(_, m)| m.gain_db()).collect();
        let at = (bin as f64 + 0.5) * BIN_MS;
        (!gains.is_empty()).then(|| [at, gains.iter().sum::<f64>() / gains.len() as f64])
    };
    plot.line("line m1", (0..=(longest / BIN_MS) as usize).filter_map(mean).collect());
    plot
}

fn over_time(moments: &[StudySample]) -> Plot {
    let mut plot = wide("PSNR at the eye over time, refined and static", "s", "PSNR at the eye, dB");
    for pair in moments.windows(2).filter(|p| p[1].since_landing_ms.is_none() && p[1].jumps > 0) {
        let (from, to) = ([pair[0].time_s, f64::NEG_INFINITY], [pair[1].time_s, f64::INFINITY]);
        plot.rect("shade", from, to, "saccade");
    }
    plot.line("line alone m1", moments.iter().map(|m| [m.time_s, m.whole_db]).collect());
    plot.line("line m0", moments.iter().map(|m| [m.time_s, m.steered_db]).collect());
    plot
}
