//! Makes the page of a comparison of methods.

use super::page::{document, figure, row, section, table};
use super::{coherence, etendue, joint, pictures, plots, sources};
use crate::comparison::{Results, SceneFigures, Series, mean};
use eyebox::low_level::evaluate::{Group, Summary};
use maud::{Markup, html};

/// Returns the complete page as HTML.
pub fn page(results: &Results) -> String {
    let title = match &results.scenes[..] {
        [one] => format!("Comparison of methods for {}", one.name),
        all => format!("Comparison of methods over {} scenes", all.len()),
    };
    let lead = "A hologram should give a correct image across the whole eyebox, for each position, diameter and focus \
        of the pupil. Each method solves holograms of the same scenes, with the same steps, pupils and settings. All \
        holograms are scored through the same pupils.";
    // A comparison without methods has only the other sections.
    let compares = !results.methods.is_empty();
    let body = html! {
        @if results.missing > 0 {
            p.warn {
                "The evaluation was stopped, and " (results.missing)
                " results are missing. Run the same command again to resume."
            }
        }
        nav aria-label="Sections" {
            @if compares {
                a href="#shows" { "Summary" }
                a href="#scores" { "Scores" }
                a href="#seen" { "Images" }
                a href="#eyebox" { "Light in the eyebox" }
            }
            @if !results.speckle.is_empty() { a href="#speckle" { "Speckle" } }
            @if !results.joint.is_empty() { a href="#joint" { "Simultaneous color" } }
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
        ("Colors", list(a.colors.iter().map(|c| c.to_string()).collect())),
        ("Display shows", a.reach.clone()),
        ("Depth", list(results.scenes.iter().map(SceneFigures::depths_in_words).collect())),
        ("Steps", format!("{}, of {} pupils each", a.steps, a.pupils)),
        ("Engine", a.engine.clone()),
    ]
}

fn shows(results: &Results) -> Markup {
    section("shows", "Summary", summary(results))
}

/// Summarizes the numbers in a few sentences.
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
                "Through pupils anywhere in the eyebox, " (name(series)) " gives the best picture on average, with " (db(*best))
                @if let Some(least) = random(series, |r| r.worst) { ", and " (db(least)) " at worst" } "."
            } @else { "There are no measurements yet." }
            @if let [(a, first), (b, second), .., ] = &worst[..] && let Some((c, last)) = worst.last() {
                " The worst pupil has the highest score with " (name(first)) " (" (db(*a)) "), then " (name(second)) " (" (db(*b))
                "). The lowest score is from " (name(last)) " (" (db(*c)) ")."
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
            "PSNR of each reconstruction against the target image of the scene, after averaging over 2 × 2 pixels. \
             Each hologram and color has one exposure for all pupils. As in photography, the widest pupil sets it, \
             over the focal stack. Boxes hold the middle half, and whiskers reach from the worst to the best score. \
             The thick line is the median, and the ring is the mean. Pupils of all colors and scenes count alike. \
             Scores below 0 dB are drawn at 0. The dashed line is the ceiling, which is the mean of the highest PSNR \
             that diffraction at each pupil allows. No hologram scores more. A ceiling far above the scores is not \
             drawn."
            @if !results.published.is_empty() {
                " Dashed boxes are published numbers from other scenes, with their own count of scores in the tooltip. \
                 They are context and not a target."
            }
        }
        div.plots {
            @for group in Group::ALL { (figure(&plots::boxes(results, group), group.name(), group.about())) }
            (figure(
                &plots::scatter(results),
                "Every random pupil",
                "one dot per pupil and color, with a bar at the mean and a ring around the worst",
            ))
        }
    };
    section("scores", "Scores", body)
}

fn over_pupils(results: &Results) -> Markup {
    html! {
        section {
            h3 { "Against aperture and depth" }
            ul.legend aria-label="Methods and their colors" {
                @for series in results.leading() {
                    li class=(plots::color(results, &series.method)) { i {} (results.title(&series.method)) }
                }
                li { i.line {} "ceiling, the highest PSNR that diffraction at the pupil allows" }
            }
            div.plots {
                (figure(&plots::aperture(results), "Aperture", "centered, focused at the middle of the scene"))
                (figure(&plots::focus(results), "Depth", "centered, as wide as the eyebox"))
                @if let Some(plot) = plots::jod(results) {
                    (figure(&plot, "Perceived quality", "mean and worst JOD of random pupils"))
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
                "A pupil of 80 % of the eyebox, focused from the far end of the scene to the near end. Content out of \
                 focus should blur as in the target images, without ringing."
            }
            (pictures::strips(results, scene))
            h3 { "Parallax" }
            p {
                "Rows " (scene.row) " and " (scene.row + 1) " of the picture, with one slice for each of 31 places of \
                 a pupil of 1/8 of the eyebox, from the left edge (top) to the right. Content in focus is vertical, \
                 and other content is slanted. Lines break if parallax is lost. The target images of this pair of rows \
                 change most along the sweep."
            }
            (pictures::epipolar(results, scene))
        }
    };
    section("seen", "Images", body)
}

fn light(results: &Results) -> Markup {
    let body = html! {
        p {
            "Energy over the pupil plane, summed over sub-frames. If the map is even, the picture is equally bright \
             from all positions. If the middle is bright and the rest is dark, the picture is lost if the eye moves. \
             The dashed square is the eyebox that all colors share."
        }
        @for scene in &results.scenes {
            @if results.scenes.len() > 1 { h3 { (scene.name) } }
            (pictures::energy(results, scene))
        }
        div.plots {
            (figure(
                &plots::variation(results),
                "Unevenness",
                "standard deviation over mean of the light through a pupil of 1/8 of the eyebox, at 9 × 9 places",
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
                "Contrast (standard deviation over mean) of an even gray plane of {0} × {0} pixels, {1}, through a \
                 centered pupil of {2:.1} mm, without any averaging of pixels. Independent frames, which are solved \
                 separately, average as 1/√F. Frames that are solved together have less speckle, because they \
                 compensate each other. Both axes are logarithmic.",
                first.side, first.color, first.diameter_mm
            ))
        }
        ul.legend {
            li { i.line {} "1/√F from one frame" }
            li { i.ring {} "independent frames" }
            li { i style="--c:var(--quiet)" {} "optimized together" }
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
                "Mean CIEDE2000 over the random pupils, after 2 × 2 averaging, within 3 pixels of a step in the \
                 central view's depth ({:.0} % of the picture), and elsewhere (paler). A difference of 1 is about the \
                 smallest visible difference. The display's linear channels are used as linear sRGB (D65).",
                100.0 * share
            ))
        }
        div.plots { (figure(&plot, "Color error", "near edges in depth, and elsewhere")) }
    };
    section("color", "Color", body)
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
                    "JOD are just-objectionable differences by ColorVideoVDP. 10 JOD is no visible difference, and at \
                     9 JOD three of four people prefer the target image. They are for whole pictures in all colors \
                     together, through {judged} pupils of each group, at {pixels:.0} pixels per degree with white of \
                     {white:.0} and black of {black:.2} cd/m²."
                ))
            }
        }
        p.note {
            "The folder of this page has all scores of all pupils in scores.csv, these tables in summary.csv, and all \
             numbers in report.json."
        }
    };
    section("tables", "Tables", body)
}

/// A row of a table in the color of its method. Each cell has its text and true if it is the best of its column.
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
    // Two values are equal for the best of a column if their shown digits are equal.
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

/// The table of light, parallax, color and time.
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
    table("Light, parallax, color and time, as means over colors and scenes", &columns, rows)
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
                "eyebox {}, display {} ({} × {} pixels of {:.1} µm), seed {}. Each hologram and color has one exposure \
                 for all pupils.",
                a.version, a.display, a.size[0], a.size[1], a.pitch_um, a.seed
            ))
        }
    }
}
