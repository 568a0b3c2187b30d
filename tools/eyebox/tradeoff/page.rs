//! The page: one file that opens from disk, without scripts and without a network.

use super::found::{Found, NEAR_DB};
use super::plots::{self, Plot, mebibytes, time};
use crate::report::document;
use crate::report::svg::escape;
use eyebox::quality::{Quality, REFERENCE_PUPILS, Recommended, Trial};
use eyebox::solve::Settings;
use std::fmt::Write;

/// All of it.
pub fn html(found: &Found) -> String {
    let title = format!("Speed against accuracy: {}", found.scene);
    let body = [
        head(found, &title),
        recommended(found),
        fronts(found),
        alone(found),
        levels(found),
        tables(found),
        how(found),
    ]
    .concat();
    document(&title, &body)
}

fn head(found: &Found, title: &str) -> String {
    let facts = [
        ("Scene", escape(&found.scene)),
        ("Display", format!("{}, {} × {} pixels", escape(&found.display), found.size[0], found.size[1])),
        ("Colour", found.color.to_string()),
        ("Sub-frames shown", found.frames.to_string()),
        ("Levels", found.slm_levels.map_or("any phase".into(), |n| n.to_string())),
        ("Engine", escape(&found.device)),
        ("Trials", found.trials.len().to_string()),
        ("Time", format!("{:.0} of {:.0} s", found.spent_s, found.budget_s)),
        ("Seed", found.seed.to_string()),
    ];
    let mut out = format!(
        "<header><h1>{}</h1>\n<p class=\"lead\">What a better picture costs on this machine. Each trial solves one colour of the \
         scene with other settings; all are judged alike. The line is what no trial beats: every point above it would be a \
         surprise.</p>\n<dl class=\"facts\">",
        escape(title)
    );
    for (name, value) in facts {
        let _ = write!(out, "<div><dt>{name}</dt><dd>{value}</dd></div>");
    }
    out.push_str("</dl>");
    if found.interrupted {
        out.push_str(
            "<p class=\"warn\">It was stopped: this is what was measured until then. The same command goes on from there.</p>",
        );
    }
    out + "</header>\n"
}

fn of(found: &Found, quality: Quality) -> Option<&Recommended> {
    found.recommended.iter().find(|r| r.quality == quality)
}

fn recommended(found: &Found) -> String {
    let mut out = String::from(
        "<section aria-labelledby=\"three\"><h2 id=\"three\">Three settings</h2>\n<p><b>accurate</b> has the best mean; where means \
         are alike, the best worst pupil. <b>balanced</b> is the cheapest within 0.5 dB of it that takes a fifth of its time at \
         most. <b>fast</b> is the best that takes a twentieth of its time at most. All three lie on the line of the first \
         plot.</p>",
    );
    let accurate = of(found, Quality::Accurate).map(|r| &r.trial);
    out.push_str(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"The three settings\"><table><thead><tr><th scope=\"col\" \
         class=\"left\">Name</th><th scope=\"col\">time</th><th scope=\"col\">faster</th><th scope=\"col\">mean, dB</th><th \
         scope=\"col\">worst, dB</th><th scope=\"col\">memory, MiB</th><th scope=\"col\" class=\"left\">settings</th></tr></thead><tbody>",
    );
    for r in &found.recommended {
        let t = &r.trial;
        let faster = accurate.map_or(1.0, |a| a.milliseconds / t.milliseconds);
        let _ = write!(
            out,
            "<tr><th scope=\"row\">{}{}</th><td>{}</td><td>{faster:.1} ×</td><td>{:.2}</td><td>{:.2}</td><td>{:.0}</td><td class=\"words\">{}</td></tr>",
            r.quality.name(),
            if r.met { "" } else { " *" },
            time(t.milliseconds),
            t.mean,
            t.worst,
            mebibytes(t),
            escape(&t.recipe.to_string())
        );
    }
    out.push_str("</tbody></table></div>");
    if found.recommended.iter().any(|r| !r.met) {
        out.push_str("<p class=\"warn\">* No trial is what this name promises; it is the nearest there is. More time finds more: --budget.</p>");
    }
    if !found.check.is_empty() {
        out.push_str("<h3>Settings of another run</h3><p>Measured again here, with this run's seed and pupils, against this run's front.</p><ul class=\"claims\">");
        for c in &found.check {
            let (class, tag) = if c.holds() { ("holds", "holds") } else { ("fails", "does not hold") };
            let short = c.short_db.map_or("not measured".into(), |db| {
                format!("{db:.2} dB below the best that costs no more; {NEAR_DB} dB is allowed")
            });
            let t = &c.setting.trial;
            let _ = write!(
                out,
                "<li class=\"{class}\"><div class=\"head\"><strong>{}</strong><span class=\"tag\">{tag}</span></div><ul><li>{}, {:.2} \
                 dB mean (there {:.2} dB, through other pupils): {short}</li></ul><p>{}</p></li>",
                c.setting.quality.name(),
                time(t.milliseconds),
                t.mean,
                c.mean_there,
                escape(&t.recipe.to_string())
            );
        }
        out.push_str("</ul>");
    }
    out + "</section>\n"
}

fn fronts(found: &Found) -> String {
    let seconds = |ms: f64| if ms < 1000.0 { format!("{ms} ms") } else { format!("{} s", ms / 1e3) };
    let mib = |m: f64| format!("{m}");
    let (ms, bytes) = (|t: &Trial| t.milliseconds, mebibytes);
    let plot = |name: &str, about: &str, plot: Plot, front: Vec<&Trial>| {
        format!(
            "<figure><figcaption><b>{name}</b> <span>{about}</span></figcaption>{}</figure>",
            plots::draw(found, &plot, &front)
        )
    };
    let mut out = String::from(
        "<section aria-labelledby=\"fronts\"><h2 id=\"fronts\">Fronts</h2>\n<p>One dot a trial; what it did is under the mouse, and in \
         the table below. Time and memory are logarithmic.</p><div class=\"plots\">",
    );
    out.push_str(&plot(
        "Time and mean",
        "the mean over all pupils",
        Plot {
            title: "Mean PSNR against time",
            x_name: "time of a solve",
            y_name: "mean PSNR, dB",
            class: "m0",
            cost: &ms,
            good: &|t| t.mean,
            cost_text: &seconds,
        },
        found.by_mean(),
    ));
    out.push_str(&plot(
        "Time and worst pupil",
        "the worst of all pupils",
        Plot {
            title: "PSNR of the worst pupil against time",
            x_name: "time of a solve",
            y_name: "worst PSNR, dB",
            class: "m1",
            cost: &ms,
            good: &|t| t.worst,
            cost_text: &seconds,
        },
        found.by_worst(),
    ));
    out.push_str(&plot(
        "Memory and mean",
        "buffers at the peak of the solve, as planned",
        Plot {
            title: "Mean PSNR against memory",
            x_name: "memory, MiB",
            y_name: "mean PSNR, dB",
            class: "m2",
            cost: &bytes,
            good: &|t| t.mean,
            cost_text: &mib,
        },
        found.by_memory(),
    ));
    out + "</div></section>\n"
}

/// What each setting alone does to the default.
fn alone(found: &Found) -> String {
    let start = Settings::default();
    let Some(base) = found.trials.iter().find(|t| t.recipe == start) else { return String::new() };
    let rows: Vec<(String, &Trial)> = found.trials.iter().filter_map(|t| Some((only_change(&t.recipe)?, t))).collect();
    if rows.is_empty() {
        return String::new();
    }
    let mut out = format!(
        "<section aria-labelledby=\"alone\"><h2 id=\"alone\">Each setting alone</h2>\n<p>One setting changed, the others as they are by \
         default ({}: {}, {:.2} dB mean, {:.2} dB worst).</p><div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"Each \
         setting alone\"><table><thead><tr><th scope=\"col\" class=\"left\">Change</th><th scope=\"col\">time</th><th scope=\"col\">mean, \
         dB</th><th scope=\"col\">worst, dB</th><th scope=\"col\">memory</th></tr></thead><tbody>",
        escape(&base.recipe.to_string()),
        time(base.milliseconds),
        base.mean,
        base.worst
    );
    for (change, t) in rows {
        let _ = write!(
            out,
            "<tr><th scope=\"row\">{}</th><td>× {:.2}</td><td>{:+.2}</td><td>{:+.2}</td><td>× {:.2}</td></tr>",
            escape(&change),
            t.milliseconds / base.milliseconds,
            t.mean - base.mean,
            t.worst - base.worst,
            t.bytes as f64 / base.bytes.max(1) as f64
        );
    }
    out + "</tbody></table></div></section>\n"
}

/// The one setting in which a recipe differs from the default; nothing where it is none, or more.
fn only_change(recipe: &Settings) -> Option<String> {
    let start = Settings::default();
    let as_start = |change: &dyn Fn(&mut Settings)| {
        let mut back = recipe.clone();
        change(&mut back);
        back == start && *recipe != start
    };
    let words = |r: &Settings| r.to_string().split(", ").last().unwrap_or_default().to_string();
    match () {
        _ if as_start(&|r| r.steps = start.steps) => Some(format!("{} steps", recipe.steps)),
        _ if as_start(&|r| r.pupils = start.pupils) => Some(format!("{} pupils a step", recipe.pupils)),
        _ if as_start(&|r| r.window = start.window) => Some(words(recipe)),
        _ if as_start(&|r| r.optimizer = start.optimizer) => {
            Some(recipe.to_string().split(", ").skip(2).collect::<Vec<_>>().join(", "))
        }
        _ if as_start(&|r| r.diameters = start.diameters) => Some(words(recipe)),
        _ if as_start(&|r| r.repeats = start.repeats) => Some(words(recipe)),
        _ if as_start(&|r| r.views = start.views) => Some(words(recipe)),
        _ if as_start(&|r| r.storage = start.storage) => Some(words(recipe)),
        _ if as_start(&|r| r.levels = start.levels.clone()) => Some(words(recipe)),
        _ if as_start(&|r| r.padding = start.padding) => Some(words(recipe)),
        _ if as_start(&|r| r.pixel = start.pixel) => Some(words(recipe)),
        _ => None,
    }
}

fn levels(found: &Found) -> String {
    let mut out = String::from("<section aria-labelledby=\"levels\"><h2 id=\"levels\">Levels of the SLM</h2>\n");
    let Some(first) = found.levels.first() else {
        return out + "<p>There was no time to compare levels.</p></section>\n";
    };
    let _ = write!(
        out,
        "<p>An SLM shows so many phases and no others. What that loses after the fact, when each phase goes to its nearest level, \
         against what it loses when the solve knew the levels. Without levels: {:.2} dB mean, {:.2} dB worst ({}).</p><div \
         class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"Levels\"><table><thead><tr><th scope=\"col\" \
         class=\"left\">Levels</th><th scope=\"col\">lost after the fact, dB</th><th scope=\"col\">lost when optimised for, dB</th><th \
         scope=\"col\">worst: after</th><th scope=\"col\">worst: optimised</th><th scope=\"col\">its time</th></tr></thead><tbody>",
        first.free[0],
        first.free[1],
        escape(&found.levels_recipe)
    );
    for row in &found.levels {
        let _ = write!(
            out,
            "<tr><th scope=\"row\">{}{}</th><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td><td>× {:.2}</td></tr>",
            row.levels,
            if found.slm_levels == Some(row.levels) { " (this SLM)" } else { "" },
            row.free[0] - row.after[0],
            row.free[0] - row.optimised[0],
            row.free[1] - row.after[1],
            row.free[1] - row.optimised[1],
            row.milliseconds[1] / row.milliseconds[0]
        );
    }
    out + "</tbody></table></div></section>\n"
}

fn tables(found: &Found) -> String {
    let rows = |all: &[&Trial]| {
        all.iter().fold(String::new(), |mut out, t| {
            let _ = write!(
                out,
                "<tr><th scope=\"row\" class=\"words\">{}</th><td>{}</td><td>{:.2}</td><td>{:.2}</td><td>{:.0}</td></tr>",
                escape(&t.recipe.to_string()),
                time(t.milliseconds),
                t.mean,
                t.worst,
                mebibytes(t)
            );
            out
        })
    };
    let table = |name: &str, all: &[&Trial]| {
        format!(
            "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{name}\"><table><thead><tr><th scope=\"col\" \
             class=\"left\">Settings</th><th scope=\"col\">time</th><th scope=\"col\">mean, dB</th><th scope=\"col\">worst, dB</th><th \
             scope=\"col\">MiB</th></tr></thead><tbody>{}</tbody></table></div>",
            rows(all)
        )
    };
    let mut all: Vec<&Trial> = found.trials.iter().collect();
    all.sort_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
    format!(
        "<section aria-labelledby=\"tables\"><h2 id=\"tables\">Tables</h2>\n<h3>What no trial beats: mean against time</h3>{}\n\
         <details><summary>The worst pupil against time</summary>{}</details>\n<details><summary>Mean against memory</summary>{}</details>\n\
         <details><summary>All {} trials</summary>{}</details></section>\n",
        table("Mean against time", &found.by_mean()),
        table("Worst against time", &found.by_worst()),
        table("Mean against memory", &found.by_memory()),
        all.len(),
        table("All trials", &all)
    )
}

fn how(found: &Found) -> String {
    format!(
        "<section aria-labelledby=\"how\"><h2 id=\"how\">How it was measured</h2>\n<p>Quality: PSNR through {REFERENCE_PUPILS} random pupils \
         that no solve draws, uniform in diameter, of the phases as the SLM's levels show them, against photographs of the whole light \
         field, with the full window and all the padding that the scene requires, after averaging over 2 × 2 pixels, with one exposure \
         for all. It is the same for every trial: fewer views, coarser pixels or no padding gain nothing by being judged by \
         themselves.</p><p>Time: from the light field in memory to the phases of one colour, the choice of the exposure included, \
         alone in the process; the median where it was taken more than once. Memory: all buffers that the solve plans.</p><p>What was \
         tried: the default, a spine from few steps to as many as a trial has time for, each setting alone, points of a low-discrepancy sequence, then \
         neighbours of the front. A trial may take a fifth of the time given.</p></section>\n<footer>eyebox {}, seed {}.</footer>\n",
        escape(&found.version),
        found.seed
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::solve::Optimizer;

    #[test]
    fn the_only_change_is_named() {
        let start = Settings::default;
        assert_eq!(only_change(&start()), None);
        assert_eq!(only_change(&Settings { steps: 8, ..start() }).unwrap(), "8 steps");
        assert_eq!(only_change(&Settings { views: 2, ..start() }).unwrap(), "every second view");
        assert_eq!(only_change(&Settings { optimizer: Optimizer::momentum(), ..start() }).unwrap(), "momentum 0.7");
        assert_eq!(only_change(&Settings { pixel: 2, ..start() }).unwrap(), "pixels of 2 x 2");
        assert_eq!(only_change(&Settings { pixel: 2, steps: 8, ..start() }), None);
    }
}
