//! The page of a comparison of methods.

use super::page::{document, figure, row, section, table};
use super::{coherence, etendue, joint, pictures, plots, sources};
use crate::comparison::{Results, SceneFigures, Series, mean};
use eyebox::low_level::evaluate::{Group, Summary};
use maud::{Markup, html};

/// All of it.
pub fn page(results: &Results) -> String {
    let title = match &results.scenes[..] {
        [one] => format!("Methods compared: {}", one.name),
        all => format!("Methods compared over {} scenes", all.len()),
    };
    let lead = "A hologram should look right from anywhere in the eyebox: wherever the pupil is, however wide, whatever it \
        focuses on. Here every method makes holograms of the same scenes, with the same steps, pupils and settings, and each \
        is looked at through the same pupils.";
    // Without methods there is nothing but what was asked for beside them.
    let compares = !results.methods.is_empty();
    let body = html! {
        @if results.missing > 0 {
            p.warn {
                "The evaluation was stopped: " (results.missing)
                " results are not here yet. The same command resumes where it was."
            }
        }
        nav aria-label="Sections" {
            @if compares {
                a href="#shows" { "What this shows" }
                a href="#scores" { "Scores" }
                a href="#seen" { "What the eye sees" }
                a href="#eyebox" { "Light in the eyebox" }
            }
            @if !results.speckle.is_empty() { a href="#speckle" { "Speckle" } }
            @if !results.joint.is_empty() { a href="#joint" { "All colours at once" } }
            @if !results.coherence.is_empty() { a href="#coherence" { "Coherence" } }
            @if !results.etendue.is_empty() { a href="#etendue" { "Masks against eyebox" } }
            @if !results.sources.is_empty() { a href="#sources" { "Sources against eyebox" } }
            @if compares {
                a href="#tables" { "Tables" }
                a href="#methods" { "Methods" }
            }
        }
        @if compares {
            (shows(results)) (scores(results)) (over_pupils(results)) (seen(results)) (light(results)) (speckle(results))
            (colors(results))
        }
        (joint::section(results))
        (coherence::section(results))
        (etendue::section(results))
        (sources::section(results))
        @if compares { (tables(results)) (methods(results)) }
    };
    document(&title, lead, &facts(results), body)
}

fn facts(results: &Results) -> Vec<(&'static str, String)> {
    let a = &results.about;
    let list = |v: Vec<String>| v.join(", ");
    vec![
        ("Scenes", list(results.scenes.iter().map(|s| s.name.clone()).collect())),
        ("Methods", list(results.methods.iter().map(|m| m.title.clone()).collect())),
        ("Pixels", format!("{} × {}", a.size[0], a.size[1])),
        ("Sub-frames", list(a.frames.iter().map(usize::to_string).collect())),
        ("Colours", list(a.colors.iter().map(|c| c.to_string()).collect())),
        ("Display shows", a.reach.clone()),
        ("Depth", list(results.scenes.iter().map(SceneFigures::depths_in_words).collect())),
        ("Steps", format!("{}, of {} pupils each", a.steps, a.pupils)),
        ("Engine", a.engine.clone()),
    ]
}

fn shows(results: &Results) -> Markup {
    section("shows", "What this shows", summary(results))
}

/// A few sentences from the numbers.
fn summary(results: &Results) -> Markup {
    let ranked = |number: &dyn Fn(&Series) -> Option<f64>| {
        let mut all: Vec<_> = results.leading().into_iter().filter_map(|s| Some((number(&s)?, s))).collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all
    };
    let random = |s: &Series, of: fn(Summary) -> f64| results.psnr(s, None, Group::Random).map(of);
    let (means, worst) = (ranked(&|s| random(s, |r| r.mean)), ranked(&|s| random(s, |r| r.worst)));
    let uneven = ranked(&|s| results.mean_of(s, |c| Some(c.variation)));
    let name = |s: &Series| html! { b { (results.title(&s.method)) } };
    let db = |v: f64| format!("{v:.1} dB");
    html! {
        p {
            @if let Some((best, series)) = means.first() {
                "Through pupils anywhere in the eyebox, " (name(series)) " gives the best picture on average: " (db(*best))
                @if let Some(least) = random(series, |r| r.worst) { ", and " (db(least)) " at worst" } "."
            } @else { "Nothing is measured yet." }
            @if let [(a, first), (b, second), .., ] = &worst[..] && let Some((c, last)) = worst.last() {
                " The worst pupil is least bad with " (name(first)) " (" (db(*a)) "), then " (name(second)) " (" (db(*b))
                "); it is worst with " (name(last)) " (" (db(*c)) ")."
            }
            @if let [(most, least_even), .., (least, most_even)] = &uneven[..] {
                " Light is spread most evenly over the eyebox by " (name(most_even))
                (format!(" (it varies by {:.0} %), least by ", 100.0 * least)) (name(least_even))
                (format!(" ({:.0} %).", 100.0 * most))
            }
        }
    }
}

fn scores(results: &Results) -> Markup {
    let body = html! {
        p {
            "PSNR of every view against the photograph of the scene, after averaging over 2 × 2 pixels. Each hologram and \
             colour has one exposure for all pupils, set as a photographer would: through the widest one, over the focal \
             stack. Boxes hold the middle half, whiskers reach from the worst to the best, the thick line is the median, the \
             ring the mean; pupils of all colours and scenes count alike. What lies below 0 dB is drawn at 0. The dashed line \
             is the ceiling, the mean of what diffraction at the pupil leaves of each photograph at most: no hologram, however \
             solved, scores more. Where it is far to the right of the axis it is not drawn, and hinders nobody."
            @if !results.published.is_empty() {
                " Dashed boxes are the published numbers that were given: from other scenes, with their own count of scores \
                 (under the mouse), so read them as company and not as a target."
            }
        }
        div.plots {
            @for group in Group::ALL { (figure(&plots::boxes(results, group), group.name(), group.about())) }
            (figure(
                &plots::scatter(results),
                "Every random pupil",
                "one dot per pupil and colour; the bar is the mean, the worst is ringed",
            ))
        }
    };
    section("scores", "Scores", body)
}

fn over_pupils(results: &Results) -> Markup {
    html! {
        section {
            h3 { "Against aperture and depth" }
            ul.legend aria-label="Methods and their colours" {
                @for series in results.leading() {
                    li class=(plots::color(results, &series.method)) { i {} (results.title(&series.method)) }
                }
                li { i.line {} "ceiling: what diffraction at the pupil leaves at most" }
            }
            div.plots {
                (figure(&plots::aperture(results), "Aperture", "centred, focused at the middle of the scene"))
                (figure(&plots::focus(results), "Depth", "centred, as wide as the eyebox"))
                @if let Some(plot) = plots::jod(results) {
                    (figure(&plot, "What people see", "JOD of random pupils: mean, and the worst"))
                }
                @if let Some(plot) = plots::frames(results) {
                    (figure(&plot, "Sub-frames", "mean over random pupils"))
                }
            }
        }
    }
}

fn seen(results: &Results) -> Markup {
    let body = html! {
        @for scene in results.scenes.iter().filter(|s| results.runs.iter().any(|r| r.scene == s.name)) {
            @if results.scenes.len() > 1 { h2 { (scene.name) } }
            h3 { "Views" }
            (pictures::views(results, scene))
            h3 { "Focus" }
            p {
                "A pupil of 80 % of the eyebox, focused from the far end of the scene to the near end. What is out of focus \
                 should blur as it does in the photographs, and not ring."
            }
            (pictures::strips(results, scene))
            h3 { "Parallax" }
            p {
                "Rows " (scene.row) " and " (scene.row + 1) " of the picture, one slice for each of 31 places of a pupil of \
                 1/8 of the eyebox, from the left edge (top) to the right. Content in focus stands upright, the rest leans; \
                 where parallax is lost, lines break. It is the pair of rows whose photographs change most along the sweep."
            }
            (pictures::epipolar(results, scene))
        }
    };
    section("seen", "What the eye sees", body)
}

fn light(results: &Results) -> Markup {
    let body = html! {
        p {
            "Energy over the pupil plane, summed over sub-frames. An even map looks equally bright from everywhere; a bright \
             middle and a dark rest mean a picture that is lost when the eye moves. The dashed square is the eyebox that all \
             colours share."
        }
        @for scene in &results.scenes {
            @if results.scenes.len() > 1 { h3 { (scene.name) } }
            (pictures::energy(results, scene))
        }
        div.plots {
            (figure(
                &plots::variation(results),
                "Unevenness",
                "standard deviation over mean of the light through a pupil of 1/8 of the eyebox, at 9 × 9 places; log scale",
            ))
        }
    };
    section("eyebox", "Light in the eyebox", body)
}

fn speckle(results: &Results) -> Markup {
    let Some(first) = results.speckle.first() else { return Markup::default() };
    let body = html! {
        p {
            (format!(
                "Contrast (standard deviation over mean) of an even grey plane of {0} × {0} pixels, {1}, through a centred \
                 pupil of {2:.1} mm, without any averaging of pixels. Independent frames, each solved for itself, average as \
                 1/√F; frames solved together do better, because they know of each other. Both axes are logarithmic.",
                first.side, first.color, first.diameter_mm
            ))
        }
        ul.legend {
            li { i.line {} "1/√F from one frame" }
            li { i.ring {} "independent frames" }
            li { i style="--c:var(--quiet)" {} "optimised together" }
        }
        div.plots {
            @for figures in &results.speckle {
                (figure(&plots::speckle(results, figures), &results.title(&figures.method), ""))
            }
        }
    };
    section("speckle", "Speckle", body)
}

fn colors(results: &Results) -> Markup {
    let Some(plot) = plots::colors(results) else { return Markup::default() };
    let share = mean(results.runs.iter().filter_map(|r| r.color_error).map(|e| e.share)).unwrap_or(0.0);
    let body = html! {
        p {
            (format!(
                "Mean CIEDE2000 over the random pupils, after 2 × 2 averaging, within 3 pixels of a step in the central view's \
                 depth ({:.0} % of the picture), and elsewhere (paler). A difference of 1 is about the least that people \
                 notice. The display's linear channels are taken as linear sRGB (D65).",
                100.0 * share
            ))
        }
        div.plots { (figure(&plot, "Colour error", "near edges in depth, and elsewhere")) }
    };
    section("color", "Colour", body)
}

fn tables(results: &Results) -> Markup {
    let body = html! {
        (of_group(results, None, Group::Random, "Random pupils, all scenes"))
        (costs(results))
        @for group in Group::ALL.into_iter().filter(|g| *g != Group::Random) {
            details {
                summary { (group.name()) }
                (of_group(results, None, group, &format!("{}, all scenes", group.name())))
            }
        }
        @if results.scenes.len() > 1 {
            @for scene in results.scenes.iter().map(|s| &s.name[..]) {
                details {
                    summary { (scene) }
                    @for group in Group::ALL {
                        (of_group(results, Some(scene), group, &format!("{}, {scene}", group.name())))
                    }
                }
            }
        }
        @if let (Some(judged), Some([white, black, pixels])) = (results.judged(), results.about.viewing) {
            p.note {
                (format!(
                    "JOD: just-objectionable differences by ColorVideoVDP, 10 where nothing is seen and 1 less where three of four \
                     people prefer the photograph; of whole pictures in all colours at once, of {judged} pupils of each group, \
                     seen at {pixels:.0} pixels a degree with white of {white:.0} and black of {black:.2} cd/m²."
                ))
            }
        }
        p.note {
            "Every score of every pupil is in scores.csv, these tables in summary.csv, and all numbers in report.json, beside \
             this page."
        }
    };
    section("tables", "Tables", body)
}

/// A row of a table in the colour of its method; cells, and whether they are the best of their column.
fn of_method(results: &Results, series: &Series, cells: Vec<(String, bool)>) -> Markup {
    html! {
        tr {
            th scope="row" class={ "dotted " (plots::color(results, &series.method)) } { (results.label(series)) }
            @for (cell, best) in cells { td .best[best] { (cell) } }
        }
    }
}

fn of_group(results: &Results, scene: Option<&str>, group: Group, caption: &str) -> Markup {
    let rows: Vec<(Series, Summary)> =
        results.series().into_iter().filter_map(|s| results.psnr(&s, scene, group).map(|p| (s, p))).collect();
    // The best of each column, to the digit that is shown.
    let shown = |v: f64| (v * 100.0).round();
    let cell = |s: &Summary, of: fn(&Summary) -> f64| {
        let is_best = rows.len() > 1 && rows.iter().all(|r| shown(of(&r.1)) <= shown(of(s)));
        (format!("{:.2}", of(s)), is_best)
    };
    let measured = rows.iter().map(|(series, s)| {
        let ssim = results.ssim(series, scene, group);
        let of_ssim = |of: fn(Summary) -> f64| ssim.map_or("–".into(), |s| format!("{:.3}", of(s)));
        let jod = results.jod(series, scene, group);
        let of_jod = |of: fn(Summary) -> f64| jod.map_or("–".into(), |s| format!("{:.2}", of(s)));
        let cells = vec![
            (results.rows(series, scene, group).count().to_string(), false),
            cell(s, |s| s.mean),
            cell(s, |s| s.median),
            (format!("{:.1}–{:.1}", s.q25, s.q75), false),
            cell(s, |s| s.worst),
            (format!("{:.2}", s.best), false),
            (format!("{:.2}", s.sd), cell(s, |s| -s.sd).1),
            (of_ssim(|s| s.mean), false),
            (of_ssim(|s| s.worst), false),
            (of_jod(|s| s.mean), false),
            (of_jod(|s| s.worst), false),
        ];
        of_method(results, series, cells)
    });
    let published = results.published.iter().filter(|p| scene.is_none() && p.is_of(&p.method, group)).map(|p| {
        let quartiles = format!("{:.1}–{:.1}", p.q25, p.q75);
        let [mean, median, min, max, std] = [p.mean, p.median, p.min, p.max, p.std].map(|v| format!("{v:.2}"));
        let none = || "–".to_string();
        let cells = [p.n.to_string(), mean, median, quartiles, min, max, std, none(), none(), none(), none()];
        row(&format!("{}, published", p.method), cells)
    });
    let columns = [
        "Method",
        "n",
        "mean dB",
        "median",
        "quartiles",
        "worst",
        "best",
        "spread",
        "SSIM",
        "worst SSIM",
        "JOD",
        "worst JOD",
    ];
    table(caption, &columns, measured.chain(published))
}

/// What does not fit the other table: light, parallax, colour, time.
fn costs(results: &Results) -> Markup {
    let show = |v: Option<f64>, digits: usize| (v.map_or("–".into(), |v| format!("{v:.digits$}")), false);
    let series = results.series();
    let rows = series.iter().map(|series| {
        let [edges, elsewhere] = results.color_error(series);
        let cells = vec![
            show(results.mean_of(series, |c| Some(c.variation)), 3),
            show(results.mean_of(series, |c| c.epipolar[0]), 1),
            show(results.mean_of(series, |c| c.epipolar[1]), 1),
            show(edges, 2),
            show(elsewhere, 2),
            show(mean(results.runs_of(series, None).filter_map(|r| r.seconds)), 1),
        ];
        of_method(results, series, cells)
    });
    let columns = ["Method", "unevenness", "slices near, dB", "slices far, dB", "ΔE edges", "ΔE elsewhere", "solve, s"];
    table("Light, parallax, colour, time; means over colours and scenes", &columns, rows)
}

fn methods(results: &Results) -> Markup {
    let a = &results.about;
    let body = html! {
        dl.methods {
            @for m in &results.methods { dt { (m.title) } dd { (m.about) small { (m.citation) } } }
        }
    };
    html! {
        (section("methods", "Methods", body))
        footer {
            (format!(
                "eyebox {}; display {} ({} × {} pixels of {:.1} µm), seed {}. One exposure per hologram and colour, never one \
                 per pupil.",
                a.version, a.display, a.size[0], a.size[1], a.pitch_um, a.seed
            ))
        }
    }
}
