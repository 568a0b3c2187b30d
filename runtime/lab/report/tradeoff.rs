//! Makes the page of a tuning, with the cost of quality and the recommended settings, and its numbers as CSV and JSON.

use super::page::{document, figure, row, section, statements, table};
use super::plot::{Axis, Plot};
use super::tables;
use crate::tuning::{NEAR_DB, Trial, Tuned};
use eyebox::low_level::optics::WindowFactor;
use eyebox::low_level::quality::{Quality, REFERENCE_PUPILS};
use eyebox::low_level::solve::{Levels, Optimizer, PaddingRule, Settings};
use maud::{Markup, html};
use serde_json::{Value, json};

/// Returns the complete page as HTML.
pub fn page(tuned: &Tuned) -> String {
    let title = format!("Speed against accuracy for {}", tuned.scene);
    let lead = "The cost of a better picture on this machine. Each trial solves one color of the scene with other \
        settings, and all are scored in the same way. The line joins the trials that no other trial beats.";
    let facts = [
        ("Scene", tuned.scene.clone()),
        ("Display", format!("{}, {} × {} pixels", tuned.display, tuned.size[0], tuned.size[1])),
        ("Color", tuned.color.to_string()),
        ("Sub-frames shown", tuned.frames.to_string()),
        ("Levels", tuned.slm_levels.map_or("any phase".into(), |n| n.to_string())),
        (
            "Ceiling",
            tuned.ceiling.map_or("none".into(), |[mean, worst]| format!("{mean:.1} dB mean, {worst:.1} dB worst")),
        ),
        ("Engine", tuned.device.clone()),
        ("Trials", tuned.trials.len().to_string()),
        ("Time", format!("{:.0} of {:.0} s", tuned.spent_s, tuned.budget_s)),
        ("Seed", tuned.seed.to_string()),
    ];
    let body = html! {
        @if tuned.interrupted {
            p.warn {
                "The tuning was stopped, and the page has its results until then. Run the same command again to resume."
            }
        }
        (recommended(tuned)) (fronts(tuned)) (alone(tuned)) (levels(tuned)) (trials(tuned)) (how())
        footer { "eyebox " (tuned.version) ", seed " (tuned.seed) "." }
    };
    document(&title, lead, &facts, body)
}

/// Formats milliseconds for the page.
fn time(milliseconds: f64) -> String {
    match milliseconds {
        ms if ms < 100.0 => format!("{ms:.1} ms"),
        ms if ms < 1000.0 => format!("{ms:.0} ms"),
        ms if ms < 10_000.0 => format!("{:.2} s", ms / 1e3),
        ms => format!("{:.1} s", ms / 1e3),
    }
}

/// Formats the mean and the worst JOD, if the trial was judged.
fn jod(trial: &Trial) -> [String; 2] {
    trial.jod.map_or_else(|| ["–".into(), "–".into()], |jod| jod.map(|jod| format!("{jod:.2}")))
}

fn mebibytes(trial: &Trial) -> f64 {
    trial.bytes as f64 / f64::from(1 << 20)
}

fn recommended(tuned: &Tuned) -> Markup {
    let accurate = tuned.recommended.iter().find(|r| r.quality == Quality::Accurate).map(|r| r.trial.milliseconds);
    let rows = tuned.recommended.iter().map(|r| {
        let t = &r.trial;
        let name = format!("{}{}", r.quality.name(), if r.met { "" } else { " *" });
        let faster = accurate.map_or(1.0, |a| a / t.milliseconds);
        let [faster, memory] = [format!("{faster:.1} ×"), format!("{:.0}", mebibytes(t))];
        let [mean, worst] = [t.mean, t.worst].map(|v| format!("{v:.2}"));
        let [jod, _] = jod(t);
        row(&name, [time(t.milliseconds), faster, mean, worst, jod, memory, t.recipe.to_string()])
    });
    let checked = tuned.check.iter().map(|c| {
        let (class, tag) = if c.holds() { ("holds", "holds") } else { ("fails", "does not hold") };
        let short = c.short_db.map_or("not measured".into(), |db| {
            format!("{db:.2} dB below the best that costs no more, with {NEAR_DB} dB allowed")
        });
        let t = &c.setting.trial;
        let (took, there) = (time(t.milliseconds), c.mean_there);
        let line = format!("{took}, {:.2} dB mean (there {there:.2} dB, through other pupils), {short}", t.mean);
        (class, c.setting.quality.name().to_string(), tag, vec![line], t.recipe.to_string())
    });
    let body = html! {
        p {
            b { "accurate" } " has the best mean. Among equal means, the worst pupil decides. " b { "balanced" }
            " is the cheapest within 0.5 dB of it, and takes at most a fifth of its time. " b { "fast" }
            " is the best that takes at most a twentieth of its time. All three are on the line of the first plot."
        }
        (table(
            "The three settings",
            &["Name", "time", "faster", "mean, dB", "worst, dB", "JOD", "memory, MiB", "settings"],
            rows,
        ))
        @if tuned.recommended.iter().any(|r| !r.met) {
            p.warn {
                "* No trial meets the conditions of this name. This one comes nearest. Allow more time to find more."
            }
        }
        @if !tuned.check.is_empty() {
            h3 { "Settings of another run" }
            p { "These settings were measured again with this run's seed and pupils, against this run's front." }
            (statements(checked))
        }
    };
    section("three", "Three settings", body)
}

/// The largest distance of a drawn ceiling above the best trial, in dB.
const ABOVE: f64 = 10.0;

/// Reads a number of a trial.
type Number = fn(&Trial) -> f64;

/// Plots each trial as a dot, the front as a line, and the recommended trials with rings and names.
fn front(
    tuned: &Tuned,
    title: &str,
    class: &str,
    [x, y]: [Axis; 2],
    [cost, good]: [Number; 2],
    front: &[&Trial],
    ceiling: Option<f64>,
) -> Plot {
    // A few percent of the trials are far below the front. They are drawn at the lower edge.
    let (worst, best) = (front.first().map_or(0.0, |t| good(t)), front.last().map_or(1.0, |t| good(t)));
    let y = y.floor(worst - 0.5 * (best - worst).max(1.0));
    let mut plot = Plot::new(title, x, y).sized(370.0, 234.0);
    let at = |t: &Trial| [cost(t), good(t)];
    let hover = |t: &Trial| {
        let (took, mib) = (time(t.milliseconds), mebibytes(t));
        let seen = t.jod.map_or(String::new(), |[mean, _]| format!("{mean:.2} JOD, "));
        format!("{}: {took}, {:.2} dB mean, {:.2} dB worst, {seen}{mib:.0} MiB", t.recipe, t.mean, t.worst)
    };
    for trial in &tuned.trials {
        plot.dot("root speck", at(trial), 2.6, &hover(trial));
    }
    let mut line: Vec<[f64; 2]> = Vec::new();
    for trial in front {
        // Up to this cost, the trial before is the best.
        line.extend(line.last().map(|before| [cost(trial), before[1]]));
        line.push(at(trial));
    }
    // A ceiling far above the trials limits none of them, so it is not drawn.
    if let Some(ceiling) = ceiling.filter(|db| *db <= best + ABOVE) {
        let costs = tuned.trials.iter().map(cost);
        let [from, to] = costs.fold([f64::INFINITY, 0.0], |[a, b], v| [v.min(a), v.max(b)]);
        plot.line("root line", vec![[from, ceiling], [to, ceiling]]);
        plot.text("small", [from, ceiling], [2.0, -4.0], "start", &format!("ceiling {ceiling:.1}"));
    }
    plot.line(&format!("{class} line"), line);
    for trial in front {
        plot.dot(&format!("{class} dot"), at(trial), 3.4, &hover(trial));
    }
    for r in &tuned.recommended {
        let name = r.quality.name();
        plot.dot(&format!("{class} ring"), at(&r.trial), 6.5, &format!("{name}: {}", hover(&r.trial)));
        // The name is below the ring, or to its left if the ring is near the edge.
        let is_last = r.quality == Quality::Accurate;
        let (offset, anchor) = if is_last { ([4.0, 20.0], "end") } else { ([9.0, 13.0], "start") };
        plot.text("name halo", at(&r.trial), offset, anchor, name);
    }
    plot
}

/// Returns the plots of the page with the names of their files.
pub fn figures(tuned: &Tuned) -> Vec<(&'static str, Plot)> {
    let milliseconds = || {
        Axis::log("time of a solve").text(|ms| if ms < 1000.0 { format!("{ms} ms") } else { format!("{} s", ms / 1e3) })
    };
    let [mean_db, worst_db] = ["mean PSNR, dB", "worst PSNR, dB"].map(|name| move || Axis::linear(name));
    let (ms, mean, worst): (Number, Number, Number) = (|t| t.milliseconds, |t| t.mean, |t| t.worst);
    let memory = Axis::log("memory, MiB");
    let [most_mean, most_worst] = [0, 1].map(|i| tuned.ceiling.map(|c| c[i]));
    let [a, b, c] = ["Mean quality against time", "Worst quality against time", "Mean quality against memory"];
    let (x, y) = (milliseconds, [mebibytes, mean]);
    let mut all = vec![
        ("time and mean", front(tuned, a, "m0", [x(), mean_db()], [ms, mean], &tuned.by_mean(), most_mean)),
        ("time and worst", front(tuned, b, "m1", [x(), worst_db()], [ms, worst], &tuned.by_worst(), most_worst)),
        ("memory and mean", front(tuned, c, "m2", [memory, mean_db()], y, &tuned.by_memory(), most_mean)),
    ];
    if tuned.trials.iter().all(|t| t.jod.is_some()) {
        let jod: Number = |t| t.jod.map_or(0.0, |[mean, _]| mean);
        let d = "Perceived quality against time";
        let plot = front(tuned, d, "m3", [x(), Axis::linear("mean JOD")], [ms, jod], &tuned.by_jod(), None);
        all.push(("time and JOD", plot));
    }
    all
}

fn fronts(tuned: &Tuned) -> Markup {
    let figures = figures(tuned);
    let notes = [
        ("Time and mean", "the mean over all pupils"),
        ("Time and worst pupil", "the worst of all pupils"),
        ("Memory and mean", "buffers at the peak of the solve, as planned"),
        ("Time and JOD", "just-objectionable differences by ColorVideoVDP, where 10 is no visible difference"),
    ];
    let body = html! {
        p {
            "Each dot is a trial. Its settings are in the tooltip and in the table below. Time and memory are \
             logarithmic. The dashed line, if it is near, is the ceiling, which is the highest PSNR that diffraction \
             at the pupils allows."
        }
        div.plots {
            @for ((_, plot), (name, note)) in figures.iter().zip(notes) { (figure(plot, name, note)) }
        }
    };
    section("fronts", "Fronts", body)
}

/// Shows the effect of each setting alone on the default.
fn alone(tuned: &Tuned) -> Markup {
    let changed = tuned.trials.iter().filter_map(|t| Some((only_change(&t.recipe)?, t))).collect::<Vec<_>>();
    let base = tuned.trials.iter().find(|t| t.recipe == Settings::default());
    let Some(base) = base.filter(|_| !changed.is_empty()) else { return Markup::default() };
    let rows = changed.iter().map(|(change, t)| {
        let times = |share: f64| format!("× {share:.2}");
        let decibels = |db: f64| format!("{db:+.2}");
        let (took, memory) = (t.milliseconds / base.milliseconds, t.bytes as f64 / base.bytes.max(1) as f64);
        row(change, [times(took), decibels(t.mean - base.mean), decibels(t.worst - base.worst), times(memory)])
    });
    let body = html! {
        p {
            "One setting is changed, and the others have their defaults (" (base.recipe) ", " (time(base.milliseconds))
            (format!(", {:.2} dB mean, {:.2} dB worst).", base.mean, base.worst))
        }
        (table("Each setting alone", &["Change", "time", "mean, dB", "worst, dB", "memory"], rows))
    };
    section("alone", "Each setting alone", body)
}

/// Returns the one setting in which a recipe differs from the default. Returns `None` if no setting differs, or more
/// than one.
fn only_change(recipe: &Settings) -> Option<String> {
    let (start, [from, to]) = (Settings::default(), [&Settings::default(), recipe].map(|r| json!(r)));
    let changed: Vec<&String> =
        to.as_object()?.iter().filter(|(key, v)| from[*key] != **v).map(|(key, _)| key).collect();
    match changed[..] {
        [key] if key == "steps" => Some(format!("{} steps", recipe.steps)),
        [key] if key == "pupils" => Some(format!("{} pupils per step", recipe.pupils)),
        [_] => {
            let (words, plain) = (recipe.to_string(), start.to_string());
            let of_start: Vec<&str> = plain.split(", ").collect();
            Some(words.split(", ").filter(|part| !of_start.contains(part)).collect::<Vec<_>>().join(", "))
        }
        _ => None,
    }
}

fn levels(tuned: &Tuned) -> Markup {
    let rows = tuned.levels.iter().map(|l| {
        let own = if tuned.slm_levels == Some(l.levels) { " (this SLM)" } else { "" };
        let lost = |k: usize, of: [f64; 2]| format!("{:.2}", l.free[k] - of[k]);
        let took = format!("× {:.2}", l.milliseconds[1] / l.milliseconds[0]);
        let cells = [lost(0, l.after), lost(0, l.optimised), lost(1, l.after), lost(1, l.optimised), took];
        row(&format!("{}{own}", l.levels), cells)
    });
    let body = html! {
        @if let Some(first) = tuned.levels.first() {
            p {
                "An SLM shows only a limited number of phase levels. The table compares the loss from rounding each \
                 phase to its nearest level after the solve with the loss of a solve for these levels. Phases without \
                 levels have "
                (format!("{:.2} dB mean, {:.2} dB worst ({}).", first.free[0], first.free[1], tuned.levels_recipe))
            }
            @let columns = [
                "Levels", "rounding loss, dB", "optimized loss, dB", "worst, rounding", "worst, optimized", "its time",
            ];
            (table("Levels", &columns, rows))
        } @else { p { "There was no time to compare levels." } }
    };
    section("levels", "Levels of the SLM", body)
}

fn trials(tuned: &Tuned) -> Markup {
    let list = |name: &str, all: &[&Trial]| {
        let rows = all.iter().map(|t| {
            let [mean, worst] = [t.mean, t.worst].map(|v| format!("{v:.2}"));
            let [jod, worst_jod] = jod(t);
            let cells = [time(t.milliseconds), mean, worst, jod, worst_jod, format!("{:.0}", mebibytes(t))];
            row(&t.recipe.to_string(), cells)
        });
        table(name, &["Settings", "time", "mean, dB", "worst, dB", "JOD", "worst JOD", "MiB"], rows)
    };
    let mut all: Vec<&Trial> = tuned.trials.iter().collect();
    all.sort_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
    let body = html! {
        (list("The front of mean against time", &tuned.by_mean()))
        details { summary { "The worst pupil against time" } (list("Worst against time", &tuned.by_worst())) }
        details { summary { "Mean against memory" } (list("Mean against memory", &tuned.by_memory())) }
        details { summary { "All " (all.len()) " trials" } (list("All trials", &all)) }
    };
    section("tables", "Tables", body)
}

fn how() -> Markup {
    let body = html! {
        p {
            "Quality is the PSNR through " (REFERENCE_PUPILS) " random pupils, uniform in diameter, that no solve \
             draws. The phases are rounded to the SLM's levels. The target images are of the whole light field, with \
             the full spectral window and all the padding that the scene requires. PSNR is after averaging over 2 × 2 \
             pixels, with one exposure for all. The measure is the same for all trials, so fewer views, coarser pixels \
             or no padding gain nothing by an easier target."
        }
        p {
            "JOD are just-objectionable differences by ColorVideoVDP, where 10 is no visible difference. They are for \
             whole pictures in this color, as gray ones, through some of the same pupils, at the display's luminance \
             and pixels per degree. No solve optimizes them."
        }
        p {
            "Time runs from the light field in memory to the phases of one color, including the choice of the \
             exposure, alone in the process. Repeated times give their median. Memory counts all buffers that the \
             solve plans."
        }
        p {
            "The first trials are the default, as many steps as a trial has time for (a sixth of the allowed time), \
             and a fifth and a twentieth of these steps. Then come each setting alone, and a grid of steps, windows, \
             optimizers and pupils per step."
        }
    };
    section("how", "How it was measured", body)
}

/// Returns all numbers with the trials that are on each front.
pub fn json(tuned: &Tuned) -> Value {
    let mut all = serde_json::to_value(tuned).expect("plain data");
    let places = |front: Vec<&Trial>| -> Vec<usize> {
        front.iter().filter_map(|t| tuned.trials.iter().position(|other| other.recipe == t.recipe)).collect()
    };
    all["fronts"] = json!({
        "mean": places(tuned.by_mean()), "worst": places(tuned.by_worst()), "memory": places(tuned.by_memory()),
    });
    all
}

/// Returns a CSV file with one line per trial.
pub fn csv(tuned: &Tuned) -> Vec<u8> {
    let head = "trial,steps,pupils,optimizer,momentum,diameters,window,repeats,views,storage,levels,padding,pixel,ms,times,\
                mean_db,worst_db,jod_mean,jod_worst,bytes,on_mean_front,on_worst_front,on_memory_front,recommended";
    let (mean, worst, memory) = (tuned.by_mean(), tuned.by_worst(), tuned.by_memory());
    let on = |front: &[&Trial], t: &Trial| usize::from(front.iter().any(|f| f.recipe == t.recipe)).to_string();
    let line = |(i, t): (usize, &Trial)| {
        let r = &t.recipe;
        let (optimizer, momentum) = match r.optimizer {
            Optimizer::Projection { momentum, .. } => ("projection", momentum.to_string()),
            Optimizer::Adam { .. } => ("adam", String::new()),
        };
        let window = match r.window {
            WindowFactor::One => "1",
            WindowFactor::Two => "2",
            WindowFactor::Full => "full",
        };
        let named = tuned.recommended.iter().filter(|n| n.trial.recipe == *r).map(|n| n.quality.name());
        let mut line = vec![i, r.steps, r.pupils].into_iter().map(|n| n.to_string()).collect::<Vec<_>>();
        line.extend([optimizer.into(), momentum, r.diameters.name().into(), window.into()]);
        line.extend([r.repeats.to_string(), r.views.to_string(), r.storage.name().into()]);
        let (levels, padding) = (r.levels != Levels::Any, matches!(r.padding, PaddingRule::Need | PaddingRule::Always));
        line.extend([usize::from(levels), usize::from(padding), r.pixel].map(|n| n.to_string()));
        line.extend([format!("{:.3}", t.milliseconds), t.times.len().to_string()]);
        line.extend([t.mean, t.worst].map(|db| format!("{db:.4}")));
        line.extend(t.jod.map_or_else(|| [String::new(), String::new()], |jod| jod.map(|jod| format!("{jod:.4}"))));
        line.extend([t.bytes.to_string(), on(&mean, t), on(&worst, t), on(&memory, t)]);
        line.push(named.collect::<Vec<_>>().join(" "));
        line
    };
    tables::csv(&head.split(',').collect::<Vec<_>>(), tuned.trials.iter().enumerate().map(line))
}

#[cfg(test)]
mod tests {
    use super::*;

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
