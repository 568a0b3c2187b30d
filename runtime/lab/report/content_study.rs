//! Makes the page of a study of still, moving or jumping content, with decibels at the eye over time.

use super::page::{document, figure, row, section, table};
use super::plot::{Axis, Plot};
use crate::study::{ContentRun, StudiedContent, StudiedEye};
use maud::html;

/// Returns the class and the name of the line of a run.
fn ways(run: &ContentRun) -> (&'static str, &'static str) {
    match (run.steered, run.moments) {
        (true, true) => ("m0", "for the pupil, with motion compensation"),
        (true, false) => ("m1", "for the pupil, without it"),
        (false, true) => ("m2", "for the eyebox, with motion compensation"),
        (false, false) => ("m3", "for the eyebox, without it"),
    }
}

fn name(run: &ContentRun) -> &'static str {
    match (run.content, run.eye) {
        (StudiedContent::Still, _) => "Still content",
        (StudiedContent::Jumping, _) => "Jumping content",
        (StudiedContent::Moving, StudiedEye::Rests) => "Moving content, for an eye at rest",
        (StudiedContent::Moving, StudiedEye::Follows) => "Moving content, for an eye that follows it",
    }
}

/// Groups the runs of one content for one eye.
fn groups(runs: &[ContentRun]) -> impl Iterator<Item = &[ContentRun]> {
    runs.chunk_by(|a, b| (a.content, a.eye) == (b.content, b.eye))
}

/// Returns the page. Its means leave out the first `settles` sets after a change.
pub(super) fn page(title: &str, engine: &str, runs: &[ContentRun], settles: u32) -> String {
    let lead = "The image at the eye of content that is still, moves or jumps. The hologram is refined for the pupil \
        or for the whole eyebox, with or without motion compensation.";
    let sets = runs.first().map_or(0, |run| run.samples.len());
    let facts = [("Sets", sets.to_string()), ("Engine", engine.into())];
    let rows = runs.iter().map(|run| {
        let cells =
            run.summary(settles).map_or_else(|| vec!["-".into(); 3], |all| all.map(|db| format!("{db:.2}")).to_vec());
        row(&format!("{}, {}", name(run), ways(run).1), cells)
    });
    let about = format!("PSNR at the eye, dB, outside saccades, starting {settles} sets after each change");
    let body = html! {
        (section("means", "Means", table(&about, &["", "Mean", "Worst", "Best"], rows)))
        @for (i, (_, plot)) in figures(runs).into_iter().enumerate() {
            (section(&format!("content-{i}"), groups(runs).nth(i).and_then(|g| g.first()).map_or("", name), figure(
                &plot,
                "PSNR at the eye,",
                "mean over the colors, against the target image integrated over the motion. Saccades are shaded.",
            )))
        }
    };
    document(title, lead, &facts, body)
}

/// Returns the plots of the page with the names of their files.
pub(super) fn figures(runs: &[ContentRun]) -> Vec<(String, Plot)> {
    groups(runs).filter_map(|group| Some((name(group.first()?).into(), over_time(group)))).collect()
}

fn over_time(group: &[ContentRun]) -> Plot {
    let title = format!("PSNR at the eye over time, {}", group.first().map_or("", name));
    let mut plot = Plot::new(&title, Axis::linear("s").covering([0.0]), Axis::linear("PSNR at the eye, dB"));
    plot = plot.sized(760.0, 268.0);
    if let Some(run) = group.first() {
        for pair in run.samples.windows(2).filter(|pair| pair[1].saccade) {
            let (from, to) = ([pair[0].time_s, f64::NEG_INFINITY], [pair[1].time_s, f64::INFINITY]);
            plot.rect("shade", from, to, "saccade");
        }
    }
    for run in group {
        let points = run.samples.iter().map(|sample| [sample.time_s, sample.db]).collect();
        plot.line(&format!("line {}", ways(run).0), points);
    }
    plot.with_legend(group.iter().map(|run| (ways(run).0.into(), ways(run).1.into())))
}
