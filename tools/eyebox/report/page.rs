//! The page: one file that opens from disk, without scripts and without a network.

use super::claims::{Verdict, claims};
use super::svg::escape;
use super::{Report, Series, pictures, plots, stats};
use eyebox::evaluate::Group;
use std::fmt::Write;

const STYLE: &str = include_str!("style.css");

/// All of it.
pub fn html(report: &Report) -> String {
    let title = if report.scenes.len() == 1 {
        format!("Methods compared: {}", report.scenes[0].name)
    } else {
        format!("Methods compared over {} scenes", report.scenes.len())
    };
    let body: String = [
        head(report, &title),
        findings(report),
        scores(report),
        over_pupils(report),
        seen(report),
        light(report),
        speckle(report),
        colors(report),
        tables(report),
        methods(report),
    ]
    .concat();
    document(&title, &body)
}

/// A self-contained page around `body`.
pub fn document(title: &str, body: &str) -> String {
    let title = escape(title);
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n<title>{title}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{body}</main>\n</body>\n</html>\n"
    )
}

fn head(report: &Report, title: &str) -> String {
    let a = &report.about;
    let methods: Vec<String> = report.methods.iter().map(|m| m.title.clone()).collect();
    let list = |v: Vec<String>| escape(&v.join(", "));
    let facts = [
        ("Scenes", list(report.scene_names().iter().map(|s| s.to_string()).collect())),
        ("Methods", list(methods)),
        ("Pixels", format!("{} × {}", a.size[0], a.size[1])),
        ("Sub-frames", list(a.frames.iter().map(usize::to_string).collect())),
        ("Colours", list(a.colors.iter().map(|c| c.to_string()).collect())),
        ("Eyebox", format!("{:.1} mm", a.eyebox_mm)),
        ("Steps", format!("{}, of {} pupils each", a.steps, a.pupils)),
        ("Engine", escape(&a.engine)),
    ];
    let mut out = format!(
        "<header><h1>{}</h1>\n<p class=\"lead\">A hologram should look right from anywhere in the eyebox: wherever the \
         pupil is, however wide, whatever it focuses on. Here every method makes holograms of the same scenes, with the \
         same steps, pupils and settings, and each is looked at through the same pupils.</p>\n<dl class=\"facts\">",
        escape(title)
    );
    for (name, value) in facts {
        let _ = write!(out, "<div><dt>{name}</dt><dd>{value}</dd></div>");
    }
    out.push_str("</dl>");
    if report.missing > 0 {
        let _ = write!(
            out,
            r#"<p class="warn">The evaluation was stopped: {} results are not here yet. The same command goes on from where it was.</p>"#,
            report.missing
        );
    }
    out.push_str(
        "<nav aria-label=\"Sections\"><a href=\"#shows\">What this shows</a><a href=\"#scores\">Scores</a>\
         <a href=\"#seen\">What the eye sees</a><a href=\"#eyebox\">Light in the eyebox</a>",
    );
    if !report.speckle.is_empty() {
        out.push_str("<a href=\"#speckle\">Speckle</a>");
    }
    out.push_str("<a href=\"#tables\">Tables</a><a href=\"#methods\">Methods</a></nav></header>\n");
    out
}

fn findings(report: &Report) -> String {
    let mut out = String::from("<section aria-labelledby=\"shows\"><h2 id=\"shows\">What this shows</h2>\n");
    out.push_str(&summary(report));
    out.push_str("<p>What the paper says, and whether it holds here:</p><ul class=\"claims\">");
    for claim in claims(report) {
        let class = match claim.verdict {
            Verdict::Holds => "holds",
            Verdict::Partly => "partly",
            Verdict::Fails => "fails",
            Verdict::Open => "open",
        };
        let numbers: String = claim.numbers.iter().map(|n| format!("<li>{}</li>", escape(n))).collect();
        let _ = write!(
            out,
            "<li class=\"{class}\"><div class=\"head\"><strong>{}</strong><span class=\"tag\">{}</span></div>\
             <ul>{numbers}</ul><p>{}</p></li>",
            escape(claim.title),
            claim.verdict.words(),
            escape(&claim.note)
        );
    }
    out + "</ul></section>\n"
}

/// A few sentences from the numbers.
fn summary(report: &Report) -> String {
    let random = |s: &Series| report.psnr(s, None, Some(Group::Random));
    let mut all: Vec<_> = report.leading().into_iter().filter_map(|s| random(&s).map(|r| (s, r))).collect();
    if all.is_empty() {
        return "<p>Nothing is measured yet.</p>".into();
    }
    let title = |s: &Series| format!("<b>{}</b>", escape(&report.title(&s.method)));
    all.sort_by(|a, b| b.1.mean.total_cmp(&a.1.mean));
    let (best, r) = &all[0];
    let mut out = format!(
        "<p>Through pupils anywhere in the eyebox, {} gives the best picture on average: {:.1} dB, and {:.1} dB at worst.",
        title(best),
        r.mean,
        r.worst
    );
    all.sort_by(|a, b| b.1.worst.total_cmp(&a.1.worst));
    if all.len() > 1 {
        let (first, r) = &all[0];
        let (second, other) = &all[1];
        let (last, lowest) = &all[all.len() - 1];
        let _ = write!(
            out,
            " The worst pupil is least bad with {} ({:.1} dB), then {} ({:.1} dB); it is worst with {} ({:.1} dB).",
            title(first),
            r.worst,
            title(second),
            other.worst,
            title(last),
            lowest.worst
        );
    }
    let variation = |s: &Series| stats::mean(report.runs_of(s, None).flat_map(|r| &r.colors).map(|c| c.variation));
    let mut even: Vec<_> = report.leading().into_iter().filter_map(|s| variation(&s).map(|v| (s, v))).collect();
    even.sort_by(|a, b| a.1.total_cmp(&b.1));
    if even.len() > 1 {
        let (most, a) = &even[0];
        let (least, b) = &even[even.len() - 1];
        let _ = write!(
            out,
            " Light is spread most evenly over the eyebox by {} (it varies by {:.0} %), least by {} ({:.0} %).",
            title(most),
            100.0 * a,
            title(least),
            100.0 * b
        );
    }
    out + "</p>"
}

fn legend(report: &Report) -> String {
    let mut out = String::from("<ul class=\"legend\" aria-label=\"Methods and their colours\">");
    for series in report.leading() {
        let place = report.place(&series.method) % 10;
        let _ = write!(out, "<li class=\"m{place}\"><i></i>{}</li>", escape(&report.title(&series.method)));
    }
    out + "</ul>"
}

fn figure(svg: &str, name: &str, about: &str) -> String {
    format!("<figure><figcaption><b>{}</b> <span>{}</span></figcaption>{svg}</figure>", escape(name), escape(about))
}

fn scores(report: &Report) -> String {
    let mut out = String::from(
        "<section aria-labelledby=\"scores\"><h2 id=\"scores\">Scores</h2>\n<p>PSNR of every view against the photograph \
         of the scene, after averaging over 2 × 2 pixels. Each hologram and colour has one exposure for all pupils, set as a \
         photographer would: through the widest one, over the focal stack. Boxes hold the middle half, whiskers reach from the worst to the best, the thick line is the median, the \
         ring the mean; pupils of all colours and scenes count alike. What lies below 0 dB is drawn at 0.",
    );
    if !report.published.is_empty() {
        out.push_str(
            " Dashed boxes are the published numbers that were given: from other scenes, with their own count of scores (under the \
             mouse), so read them as company and not as a target.",
        );
    }
    out.push_str("</p>\n<div class=\"plots\">");
    for group in Group::ALL {
        out.push_str(&figure(&plots::boxes(report, group), group.name(), group.about()));
    }
    out.push_str(&figure(
        &plots::scatter(report),
        "Every random pupil",
        "one dot per pupil and colour; the bar is the mean, the worst is ringed",
    ));
    out + "</div></section>\n"
}

fn over_pupils(report: &Report) -> String {
    let mut out = format!("<section><h3>Against aperture and depth</h3>{}<div class=\"plots\">", legend(report));
    out.push_str(&figure(&plots::aperture(report), "Aperture", "centred, focused at the middle of the scene"));
    out.push_str(&figure(&plots::focus(report), "Depth", "centred, as wide as the eyebox"));
    if let Some(svg) = plots::frames(report) {
        out.push_str(&figure(&svg, "Sub-frames", "mean over random pupils"));
    }
    out + "</div></section>\n"
}

fn seen(report: &Report) -> String {
    let mut out = String::from("<section aria-labelledby=\"seen\"><h2 id=\"seen\">What the eye sees</h2>\n");
    for scene in &report.scenes {
        if !report.runs.iter().any(|r| r.scene == scene.name) {
            continue;
        }
        if report.scenes.len() > 1 {
            let _ = write!(out, "<h2>{}</h2>", escape(&scene.name));
        }
        out.push_str("<h3>Views</h3>");
        out.push_str(&pictures::views(report, scene));
        out.push_str(
            "<h3>Focus</h3><p>A pupil of 80 % of the eyebox, focused from the far end of the scene to the near end. What is out of \
             focus should blur as it does in the photographs, and not ring.</p>",
        );
        out.push_str(&pictures::strips(report, scene));
        let _ = write!(
            out,
            "<h3>Parallax</h3><p>Rows {} and {} of the picture, one slice for each of 31 places of a pupil of 1/8 of the eyebox, \
             from the left edge (top) to the right. Content in focus stands upright, the rest leans; where parallax is lost, \
             lines break. It is the pair of rows whose photographs change most along the sweep.</p>",
            scene.row,
            scene.row + 1
        );
        out.push_str(&pictures::epipolar(report, scene));
    }
    out + "</section>\n"
}

fn light(report: &Report) -> String {
    let mut out = String::from(
        "<section aria-labelledby=\"eyebox\"><h2 id=\"eyebox\">Light in the eyebox</h2>\n<p>Energy over the pupil plane, summed \
         over sub-frames. An even map looks equally bright from everywhere; a bright middle and a dark rest mean a picture \
         that is lost when the eye moves. The dashed square is the eyebox that all colours share.</p>",
    );
    for scene in &report.scenes {
        if report.scenes.len() > 1 {
            let _ = write!(out, "<h3>{}</h3>", escape(&scene.name));
        }
        out.push_str(&pictures::energy(report, scene));
    }
    out.push_str("<div class=\"plots\">");
    out.push_str(&figure(
        &plots::variation(report),
        "Unevenness",
        "standard deviation over mean of the light through a pupil of 1/8 of the eyebox, at 9 × 9 places; log scale",
    ));
    out + "</div></section>\n"
}

fn speckle(report: &Report) -> String {
    let Some(first) = report.speckle.first() else { return String::new() };
    let mut out = format!(
        "<section aria-labelledby=\"speckle\"><h2 id=\"speckle\">Speckle</h2>\n<p>Contrast (standard deviation over mean) of an \
         even grey plane of {0} × {0} pixels, {1}, through a centred pupil of {2:.1} mm, without any averaging of pixels. \
         Independent frames, each solved for itself, average as 1/√F; frames solved together do better, because they know of \
         each other. Both axes are logarithmic.</p>\
         <ul class=\"legend\"><li><i class=\"line\"></i>1/√F from one frame</li><li><i class=\"ring\"></i>independent frames</li>\
         <li><i style=\"--c:var(--quiet)\"></i>optimised together</li></ul><div class=\"plots\">",
        first.side, first.color, first.diameter_mm
    );
    for figures in &report.speckle {
        out.push_str(&figure(&plots::speckle(report, figures), &report.title(&figures.method), ""));
    }
    out + "</div></section>\n"
}

fn colors(report: &Report) -> String {
    let Some(svg) = plots::colors(report) else { return String::new() };
    let shares: Vec<f64> = report.runs.iter().filter_map(|r| r.color_error).map(|e| e.share).collect();
    let share = stats::mean(shares.into_iter()).unwrap_or(0.0);
    format!(
        "<section aria-labelledby=\"color\"><h2 id=\"color\">Colour</h2>\n<p>Mean CIEDE2000 over the random pupils, after 2 × 2 \
         averaging, within 3 pixels of a step in the central view's depth ({:.0} % of the picture), and elsewhere (paler). A \
         difference of 1 is about the least that people notice. The display's linear channels are taken as linear sRGB (D65).</p>\
         <div class=\"plots\">{}</div></section>\n",
        100.0 * share,
        figure(&svg, "Colour error", "near edges in depth, and elsewhere")
    )
}

fn tables(report: &Report) -> String {
    let mut out = String::from("<section aria-labelledby=\"tables\"><h2 id=\"tables\">Tables</h2>\n");
    out.push_str(&table(report, None, Some(Group::Random), "Random pupils, all scenes"));
    out.push_str(&costs(report));
    for group in Group::ALL.into_iter().filter(|g| *g != Group::Random) {
        let inner = table(report, None, Some(group), &format!("{}, all scenes", group.name()));
        let _ = write!(out, "<details><summary>{}</summary>{inner}</details>", group.name());
    }
    if report.scenes.len() > 1 {
        for scene in report.scene_names() {
            let tables: String = Group::ALL
                .iter()
                .map(|g| table(report, Some(scene), Some(*g), &format!("{}, {}", g.name(), scene)))
                .collect();
            let _ = write!(out, "<details><summary>{}</summary>{tables}</details>", escape(scene));
        }
    }
    out.push_str(
        "<p class=\"note\">Every score of every pupil is in scores.csv, these tables in summary.csv, and all numbers in \
         report.json, beside this page.</p></section>\n",
    );
    out
}

fn table(report: &Report, scene: Option<&str>, group: Option<Group>, caption: &str) -> String {
    let rows: Vec<_> =
        report.series().into_iter().filter_map(|s| report.psnr(&s, scene, group).map(|p| (s, p))).collect();
    let mut out = format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{0}\"><table><caption>{0}</caption><thead><tr>\
         <th scope=\"col\" class=\"left\">Method</th><th scope=\"col\">n</th>",
        escape(caption)
    );
    for name in ["mean dB", "median", "quartiles", "worst", "best", "spread", "SSIM", "worst SSIM"] {
        let _ = write!(out, "<th scope=\"col\">{name}</th>");
    }
    out.push_str("</tr></thead><tbody>");
    // The best of each column, to the digit that is shown.
    let shown = |v: f64| (v * 100.0).round();
    let high = |of: &dyn Fn(&eyebox::evaluate::Summary) -> f64| {
        rows.iter().map(|r| shown(of(&r.1))).fold(f64::NEG_INFINITY, f64::max)
    };
    let (mean, median, worst) = (high(&|s| s.mean), high(&|s| s.median), high(&|s| s.worst));
    let spread = rows.iter().map(|r| shown(r.1.sd)).fold(f64::INFINITY, f64::min);
    for (series, s) in &rows {
        let n = report.rows(series, scene, group).count();
        let ssim = report.ssim(series, scene, group);
        let cell = |v: f64, best: f64| {
            let class = if shown(v) == best && rows.len() > 1 { " class=\"best\"" } else { "" };
            format!("<td{class}>{v:.2}</td>")
        };
        let _ = write!(
            out,
            "<tr><th scope=\"row\" class=\"dotted m{}\">{}</th><td>{n}</td>{}{}<td>{:.1}–{:.1}</td>{}<td>{:.2}</td>{}<td>{}</td><td>{}</td></tr>",
            report.place(&series.method) % 10,
            escape(&report.label(series)),
            cell(s.mean, mean),
            cell(s.median, median),
            s.q25,
            s.q75,
            cell(s.worst, worst),
            s.best,
            cell(s.sd, spread),
            ssim.map_or("–".into(), |s| format!("{:.3}", s.mean)),
            ssim.map_or("–".into(), |s| format!("{:.3}", s.worst)),
        );
    }
    if scene.is_none() {
        let published = report.published.iter().filter(|p| group.is_some_and(|g| p.is_of(&p.method, g.name())));
        for (i, p) in published.enumerate() {
            let _ = write!(
                out,
                "<tr{}><th scope=\"row\">{}, published</th><td>{}</td><td>{:.2}</td><td>{:.2}</td><td>{:.1}–{:.1}</td><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td><td>–</td><td>–</td></tr>",
                if i == 0 { " class=\"first\"" } else { "" },
                escape(&p.method),
                p.n,
                p.mean,
                p.median,
                p.q25,
                p.q75,
                p.min,
                p.max,
                p.std
            );
        }
    }
    out + "</tbody></table></div>"
}

/// What does not fit the other table: light, parallax, colour, time.
fn costs(report: &Report) -> String {
    let mut out = String::from(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"Light, parallax, colour, time\"><table><caption>Light, \
         parallax, colour, time; means over colours and scenes</caption><thead><tr><th scope=\"col\" class=\"left\">Method</th>",
    );
    for name in ["unevenness", "slices near, dB", "slices far, dB", "ΔE edges", "ΔE elsewhere", "solve, s"] {
        let _ = write!(out, "<th scope=\"col\">{name}</th>");
    }
    out.push_str("</tr></thead><tbody>");
    let show = |v: Option<f64>, digits: usize| v.map_or("–".into(), |v| format!("{v:.digits$}"));
    for series in report.series() {
        let colors = || report.runs_of(&series, None).flat_map(|r| &r.colors);
        let errors = || report.runs_of(&series, None).filter_map(|r| r.color_error);
        let _ = write!(
            out,
            "<tr><th scope=\"row\" class=\"dotted m{}\">{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            report.place(&series.method) % 10,
            escape(&report.label(&series)),
            show(stats::mean(colors().map(|c| c.variation)), 3),
            show(stats::mean(colors().map(|c| c.epipolar[0])), 1),
            show(stats::mean(colors().map(|c| c.epipolar[1])), 1),
            show(stats::mean(errors().filter_map(|e| e.edges)), 2),
            show(stats::mean(errors().filter_map(|e| e.elsewhere)), 2),
            show(stats::mean(report.runs_of(&series, None).filter_map(|r| r.seconds)), 1),
        );
    }
    out + "</tbody></table></div>"
}

fn methods(report: &Report) -> String {
    let mut out =
        String::from("<section aria-labelledby=\"methods\"><h2 id=\"methods\">Methods</h2>\n<dl class=\"methods\">");
    for m in &report.methods {
        let _ = write!(
            out,
            "<dt>{}</dt><dd>{}<small>{}</small></dd>",
            escape(&m.title),
            escape(&m.about),
            escape(&m.citation)
        );
    }
    let a = &report.about;
    let _ = write!(
        out,
        "</dl></section>\n<footer>eyebox {}; display {} ({} × {} pixels of {:.1} µm), seed {}. One exposure per hologram and \
         colour, never one per pupil.</footer>\n",
        escape(&a.version),
        escape(&a.display),
        a.size[0],
        a.size[1],
        a.pitch_um,
        a.seed
    );
    out
}
