//! Makes the plots of a comparison of methods.

use super::plot::{Axis, Plot};
use crate::comparison::{Published, Results, Series, SpeckleFigures, mean};
use eyebox::low_level::evaluate::{Group, Summary};

/// Returns the class of a method's color.
pub fn color(results: &Results, method: &str) -> String {
    format!("m{}", results.methods.iter().position(|m| m.name == method).unwrap_or(0) % 10)
}

/// Returns an axis of PSNR. Scores below 0 dB have no useful differences.
fn decibels() -> Axis {
    Axis::linear("PSNR, dB").floor(0.0)
}

fn names(results: &Results, all: &[Series]) -> Axis {
    Axis::rows(all.iter().map(|s| results.title(&s.method)))
}

fn published<'a>(results: &'a Results, series: &Series, group: Group) -> Option<&'a Published> {
    results.published.iter().find(|p| p.is_of(&series.method, group))
}

/// Returns all plots of the page with the names of their files. Each is complete in itself.
pub fn figures(results: &Results) -> Vec<(String, Plot)> {
    let series = || results.leading().into_iter().map(|s| (color(results, &s.method), results.title(&s.method)));
    let mut all: Vec<(String, Plot)> =
        Group::ALL.map(|group| (format!("psnr {}", group.name()), boxes(results, group))).into();
    all.push(("psnr every random pupil".into(), scatter(results)));
    all.push(("psnr against aperture".into(), aperture(results).with_legend(series())));
    all.push(("psnr against focus".into(), focus(results).with_legend(series())));
    all.extend(jod(results).map(|plot| ("jod of random pupils".into(), plot)));
    all.extend(frames(results).map(|plot| ("psnr against sub-frames".into(), plot.with_legend(series()))));
    all.push(("light over the eyebox".into(), variation(results)));
    let speckles = results.speckle.iter().map(|s| {
        let class = color(results, &s.method);
        let names = ["optimized together", "independent frames", "1 / root of their number"];
        let classes = [class.clone(), format!("{class} alone"), "root".into()];
        let legend = classes.into_iter().zip(names.map(String::from));
        (format!("speckle {}", s.method), speckle(results, s).with_legend(legend))
    });
    all.extend(speckles);
    all.extend(colors(results).map(|plot| ("color error".into(), plot)));
    all
}

/// Returns the extremes of the box plots of all groups, which share an axis.
fn extremes(results: &Results) -> Vec<f64> {
    let mut values = Vec::new();
    for series in results.leading() {
        for group in Group::ALL {
            values.extend(results.psnr(&series, None, group).into_iter().flat_map(|s| [s.worst, s.best]));
            values.extend(published(results, &series, group).into_iter().flat_map(|p| [p.min, p.max]));
        }
    }
    values
}

/// Plots one group as box plots, with one row per method. Published numbers are under the measured ones.
pub(crate) fn boxes(results: &Results, group: Group) -> Plot {
    let all = results.leading();
    let several = all.iter().any(|s| published(results, s, group).is_some());
    let (tall, middle, height) = if several { (38.0, 0.34, 0.37) } else { (28.0, 0.5, 0.5) };
    let title = format!("PSNR of each method, {}", group.name());
    let mut plot = Plot::new(&title, decibels().covering(extremes(results)), names(results, &all)).sized(370.0, tall);
    for (i, series) in all.iter().enumerate() {
        let (row, color) = (i as f64, color(results, &series.method));
        if let Some(s) = results.psnr(series, None, group) {
            let five = [s.worst, s.q25, s.median, s.q75, s.best];
            let hover = said(&format!("{}:", results.title(&series.method)), s.mean, five);
            plot.boxes(&format!("{color} box"), [row + middle, height], five, Some(s.mean), &hover);
        }
        if let Some(p) = published(results, series, group) {
            let five = [p.min, p.q25, p.median, p.q75, p.max];
            let hover = said(&format!("published, {} scores:", p.n), p.mean, five);
            plot.boxes(&format!("{color} box out"), [row + 0.76, 0.18], five, None, &hover);
        }
    }
    let ceilings: Option<Vec<f64>> =
        all.first().and_then(|s| results.rows(s, None, group).map(|r| r.ceiling).collect());
    if let Some(ceiling) = ceilings.and_then(|c| mean(c.into_iter())).filter(|db| *db <= highest(results) + ABOVE) {
        plot.line("root line", vec![[ceiling, 0.0], [ceiling, all.len() as f64]]);
        plot.text("small", [ceiling, 0.0], [-4.0, -3.0], "end", &format!("ceiling {ceiling:.1}"));
    }
    plot
}

fn said(what: &str, mean: f64, [worst, q25, median, q75, best]: [f64; 5]) -> String {
    format!(
        "{what} mean {mean:.1}, median {median:.1}, quartiles {q25:.1} to {q75:.1}, worst {worst:.1}, best {best:.1} dB"
    )
}

/// Plots each random pupil as a dot, with a ring around the worst one.
pub(crate) fn scatter(results: &Results) -> Plot {
    let all = results.leading();
    let rows = names(results, &all);
    let mut plot = Plot::new("PSNR of every random pupil, by method", decibels(), rows).sized(370.0, 46.0);
    for (i, series) in all.iter().enumerate() {
        let (middle, color) = (i as f64 + 0.5, color(results, &series.method));
        let title = results.title(&series.method);
        let rows: Vec<_> = results.rows(series, None, Group::Random).collect();
        let Some(summary) = Summary::of(&rows.iter().filter_map(|r| r.psnr).collect::<Vec<_>>()) else { continue };
        let worst = format!("worst {:.1}", summary.worst);
        plot.text("small", [f64::NEG_INFINITY, middle], [-10.0, 16.0], "end", &worst);
        for (k, (r, psnr)) in rows.iter().filter_map(|r| Some((r, r.psnr?))).enumerate() {
            // Steps of the golden ratio are even and equal on each run.
            let at = [psnr, middle + ((k as f64 * 0.618_034).fract() - 0.5) * 0.62];
            let [x, y, d, z] = r.pupil_mm;
            let hover = format!(
                "{title}: {:.1} dB of {}, {}, pupil at ({x:.1}, {y:.1}) mm, {d:.1} mm wide, focus {z:.2} mm ({:.3} D)",
                psnr,
                r.ceiling.map_or("no ceiling".into(), |db| format!("{db:.1} at most")),
                r.color,
                r.focus_dioptres
            );
            plot.dot(&format!("{color} speck"), at, 2.1, &hover);
            if psnr == summary.worst {
                plot.dot(&format!("{color} ring"), at, 5.0, &hover);
            }
        }
        let mean = summary.mean;
        plot.line(&format!("{color} median"), vec![[mean, middle - 0.33], [mean, middle + 0.33]]);
    }
    plot
}

/// Plots the mean PSNR of each method at all places of a group, against a number that `x` computes from the place and
/// its pupil.
fn over_group(results: &Results, plot: &mut Plot, group: Group, x: impl Fn(usize, &[f64; 4]) -> f64) {
    for series in results.leading() {
        let place = |index: usize| {
            let row = results.rows(&series, None, group).find(|r| r.index == index)?;
            Some([x(index, &row.pupil_mm), results.at(&series, None, group, index)?])
        };
        let points: Vec<[f64; 2]> = (0..).map_while(place).collect();
        plot.series(&color(results, &series.method), &results.title(&series.method), &points);
    }
    let highest = highest(results) + ABOVE;
    let Some(leading) = results.leading().into_iter().next() else { return };
    let place = |index: usize| {
        let row = results.rows(&leading, None, group).find(|r| r.index == index)?;
        Some(results.ceiling_at(group, index).map(|db| [x(index, &row.pupil_mm), db]))
    };
    // A ceiling far above the scores limits no method, so it is not drawn.
    let points: Vec<[f64; 2]> = (0..).map_while(place).map_while(|p| p.filter(|p| p[1] <= highest)).collect();
    plot.line("root line", points);
}

/// The largest distance of a drawn ceiling above the best score, in dB.
const ABOVE: f64 = 10.0;

/// Returns the best score of any method in any group.
fn highest(results: &Results) -> f64 {
    let best = |s: Series| Group::ALL.map(|g| results.psnr(&s, None, g).map_or(0.0, |p| p.best));
    results.leading().into_iter().flat_map(best).fold(0.0, f64::max)
}

/// Plots the mean PSNR against the diameter of a centered pupil.
pub(crate) fn aperture(results: &Results) -> Plot {
    let title = "Mean PSNR against the diameter of a centered pupil";
    let mut plot = Plot::new(title, Axis::log("diameter, mm"), decibels());
    over_group(results, &mut plot, Group::VaryingAperture, |_, pupil| pupil[2]);
    plot
}

/// Plots the mean PSNR against the focus, from the scenes' far ends to their near ends.
pub fn focus(results: &Results) -> Plot {
    // Scenes differ in depth. Their common coordinate is the place in the focal stack.
    let places = results.runs.iter().flat_map(|r| &r.rows).filter(|r| r.group == Group::FocalStack).map(|r| r.index);
    let last = places.max().unwrap_or(1).max(1);
    let ticks = [(0.0, "far"), (0.5, "middle"), (1.0, "near")].map(|(share, name)| (share, name.to_string()));
    let title = "Mean PSNR against the focus of a centered pupil as wide as the eyebox";
    let depths = match &results.scenes[..] {
        [one] => format!("focus, {}", one.depths_in_words()),
        _ => "focus".into(),
    };
    let mut plot = Plot::new(title, Axis::linear(&depths).ticks(ticks), decibels());
    over_group(results, &mut plot, Group::FocalStack, |index, _| index as f64 / last as f64);
    plot
}

/// Returns numbers of sub-frames as ticks.
pub(super) fn counts(all: impl IntoIterator<Item = usize>) -> Vec<(f64, String)> {
    let mut counts: Vec<usize> = all.into_iter().collect();
    counts.sort_unstable();
    counts.dedup();
    counts.into_iter().map(|n| (n as f64, n.to_string())).collect()
}

/// Plots the mean PSNR over random pupils against the number of sub-frames. Returns `None` if only one number was
/// compared.
pub fn frames(results: &Results) -> Option<Plot> {
    let ticks = counts(results.series().iter().map(|s| s.frames));
    if ticks.len() < 2 {
        return None;
    }
    let title = "Mean PSNR over random pupils against the number of sub-frames";
    let mut plot = Plot::new(title, Axis::log("sub-frames").ticks(ticks), decibels());
    for method in &results.methods {
        let series = results.series().into_iter().filter(|s| s.method == method.name);
        let points: Vec<[f64; 2]> =
            series.filter_map(|s| Some([s.frames as f64, results.psnr(&s, None, Group::Random)?.mean])).collect();
        plot.series(&color(results, &method.name), &method.title, &points);
    }
    Some(plot)
}

/// Plots the speckle contrast of one method against the number of sub-frames, with two logarithmic axes.
pub fn speckle(results: &Results, figures: &SpeckleFigures) -> Plot {
    let points = |of: &[(usize, f64)]| of.iter().map(|(n, c)| [*n as f64, *c]).collect::<Vec<_>>();
    let independent = points(&figures.independent);
    let one = independent.first().map_or(1.0, |p| p[1]);
    let class = color(results, &figures.method);
    let title = format!("Speckle contrast of {} against the number of sub-frames", results.title(&figures.method));
    let x = Axis::log("sub-frames").ticks(counts(figures.independent.iter().map(|p| p.0)));
    let mut plot = Plot::new(&title, x, Axis::log("contrast"));
    plot.line("root line", independent.iter().map(|p| [p[0], one / p[0].sqrt()]).collect());
    plot.series(&format!("{class} alone"), "independent frames", &independent);
    plot.series(&class, "optimized together", &points(&figures.joint));
    plot
}

/// Plots the color error of each method as two bars, near edges in depth and elsewhere. Returns `None` without color
/// errors.
pub fn colors(results: &Results) -> Option<Plot> {
    let mut all = results.leading();
    all.retain(|s| results.color_error(s) != [None, None]);
    if all.is_empty() {
        return None;
    }
    let title = "Mean CIEDE2000 near edges in depth and elsewhere, by method";
    let x = Axis::linear("CIEDE2000").covering([0.0]);
    let mut plot = Plot::new(title, x, names(results, &all)).sized(370.0, 34.0);
    for (i, series) in all.iter().enumerate() {
        let color = color(results, &series.method);
        let bars = [("bar", "near edges", 0.09), ("bar pale", "elsewhere", 0.45)];
        for (value, (class, what, top)) in results.color_error(series).into_iter().zip(bars) {
            let Some(value) = value else { continue };
            let hover = format!("{}, {what}: {value:.2}", results.title(&series.method));
            let across = [i as f64 + top, i as f64 + top + 0.3];
            plot.bar(&format!("{color} {class}"), across, [0.0, value], &hover, &format!("{value:.1}"));
        }
    }
    Some(plot)
}

/// Plots the JOD through random pupils as a bar to the mean and a paler one to the worst. Returns `None` if no pupil
/// was judged.
pub fn jod(results: &Results) -> Option<Plot> {
    let judged = |s: Series| results.jod(&s, None, Group::Random).map(|jod| (s, jod));
    let all: Vec<(Series, Summary)> = results.leading().into_iter().filter_map(judged).collect();
    let series: Vec<Series> = all.iter().map(|a| a.0.clone()).collect();
    let least = all.iter().map(|(_, jod)| jod.worst).reduce(f64::min)?;
    // The bars begin at a whole number below the worst.
    let from = (least - 0.5).floor();
    let x = Axis::linear("JOD").covering([from, 10.0]);
    let mut plot = Plot::new("JOD over random pupils, by method", x, names(results, &series)).sized(370.0, 34.0);
    for (i, (series, jod)) in all.iter().enumerate() {
        let color = color(results, &series.method);
        let bars = [("bar", "mean", jod.mean, 0.09), ("bar pale", "worst", jod.worst, 0.45)];
        for (class, what, value, top) in bars {
            let hover = format!("{}, {what}: {value:.2} JOD", results.title(&series.method));
            let across = [i as f64 + top, i as f64 + top + 0.3];
            plot.bar(&format!("{color} {class}"), across, [from, value], &hover, &format!("{value:.1}"));
        }
    }
    Some(plot)
}

/// Plots the unevenness of the light over the eyebox, as the mean over colors and scenes.
pub fn variation(results: &Results) -> Plot {
    let with_value = |s: Series| results.mean_of(&s, |c| Some(c.variation)).map(|v| (s, v));
    let all: Vec<(Series, f64)> = results.leading().into_iter().filter_map(with_value).collect();
    let names = Axis::rows(all.iter().map(|(s, _)| results.title(&s.method)));
    let least = all.iter().map(|a| a.1).fold(1.0, f64::min).max(1e-3);
    // The axis begins at the power of ten below.
    let from = 10f64.powf(least.log10().floor());
    let x = Axis::log("standard deviation / mean").covering([from, 10.0 * from]);
    let mut plot = Plot::new("Variation of the light over the eyebox, by method", x, names);
    for (i, (series, value)) in all.iter().enumerate() {
        let across = [i as f64 + 0.2, i as f64 + 0.75];
        let hover = format!("{}: {value:.3}", results.title(&series.method));
        let class = format!("{} bar", color(results, &series.method));
        plot.bar(&class, across, [from, value.max(from)], &hover, &format!("{value:.2}"));
    }
    plot
}
