//! The report's picture grids: photographs beside what the eye sees.

use super::svg::escape;
use super::{Report, Series};
use crate::evaluate::figures::{Picture, Run, SceneFigures};
use crate::evaluate::measure::{DECADES, ERROR_GAIN};
use crate::evaluate::pupils::CHOSEN;
use std::fmt::Write;

/// One row of pictures: what it is called, and `img` elements.
struct Strip {
    name: String,
    pictures: Vec<String>,
}

fn img(picture: &Picture, alt: &str, class: &str) -> String {
    let Picture { width, height, data, .. } = picture;
    let alt = escape(alt);
    let class = if class.is_empty() { String::new() } else { format!(r#" class="{class}""#) };
    format!(r#"<img{class} width="{width}" height="{height}" alt="{alt}" title="{alt}" src="{data}">"#)
}

/// The results of a scene, by method, at the largest number of sub-frames.
fn runs<'a>(report: &'a Report, scene: &'a SceneFigures) -> Vec<(Series, &'a Run)> {
    let all = report.leading();
    all.into_iter()
        .filter_map(|s| {
            let run =
                report.runs.iter().find(|r| r.method == s.method && r.frames == s.frames && r.scene == scene.name)?;
            Some((s, run))
        })
        .collect()
}

/// So many columns that rows of at most six are about equally full.
fn even_columns(count: usize) -> usize {
    count.max(1).div_ceil(count.max(1).div_ceil(6))
}

/// Through the chosen pupils: the photograph, then every method with its error.
pub fn views(report: &Report, scene: &SceneFigures) -> String {
    let mut out = String::new();
    let runs = runs(report, scene);
    let columns = even_columns(runs.len() + 1);
    for (i, chosen) in CHOSEN.iter().enumerate() {
        let pupil = runs
            .iter()
            .find_map(|(_, r)| r.rows.iter().find(|row| row.group == chosen.group && row.index == chosen.index));
        let place = pupil.map_or(String::new(), |r| {
            let [x, y, d, z] = r.pupil_mm.map(|v| if v.abs() < 0.005 { 0.0 } else { v });
            format!("at ({x:.1}, {y:.1}) mm, {d:.1} mm wide, focused at {z:.2} mm")
        });
        let _ = write!(
            out,
            r#"<p class="case"><b>{}</b> <span class="note">{place}</span></p><div class="shots" style="--n:{columns}">"#,
            chosen.title
        );
        let shot = |out: &mut String, name: &str, under: &str, images: String| {
            let _ = write!(out, r#"<figure>{images}<figcaption><b>{}</b>{under}</figcaption></figure>"#, escape(name));
        };
        let about = chosen.title.to_lowercase();
        if let Some(picture) = scene.pictures.views.get(i) {
            let alt = format!("photograph of {}, {about}", scene.name);
            shot(&mut out, "Photograph", "<br><span class=\"note\">what should be seen</span>", img(picture, &alt, ""));
        }
        for (series, run) in &runs {
            let (Some(view), Some(error)) = (run.pictures.views.get(i), run.pictures.errors.get(i)) else { continue };
            let name = report.title(&series.method);
            let psnr = view.psnr.map_or(String::new(), |p| format!(" {p:.1}\u{a0}dB"));
            let images = [
                img(view, &format!("{name}, {about}:{psnr}"), ""),
                img(error, &format!("error of {name}, {about}"), "error"),
            ];
            shot(&mut out, &name, &psnr, images.concat());
        }
        out.push_str("</div>");
    }
    let _ = write!(
        out,
        r#"<p class="note">Under each view its error: the mean absolute difference over colours, after 2 × 2 averaging, times {ERROR_GAIN:.0}.</p><div class="ramp"><span>0</span><i></i><span>{:.2} of full scale</span></div>"#,
        1.0 / ERROR_GAIN
    );
    out
}

/// The eye focuses through the scene.
pub fn strips(report: &Report, scene: &SceneFigures) -> String {
    let [far, near] = scene.depth_mm;
    let count = scene.pictures.strip.len();
    let depth = |i: usize| far + (near - far) * i as f64 / (count.max(2) - 1) as f64;
    let strip = |name: String, pictures: &[Picture]| {
        let one =
            |(i, p): (usize, &Picture)| img(p, &format!("{name}, {} focused at {:.2} mm", scene.name, depth(i)), "");
        Strip { pictures: pictures.iter().enumerate().map(one).collect(), name }
    };
    let mut all = vec![strip("Photograph".into(), &scene.pictures.strip)];
    all.extend(runs(report, scene).iter().map(|(s, r)| strip(report.title(&s.method), &r.pictures.strip)));
    let mut out = String::from(
        r#"<div class="strips" tabindex="0" role="region" aria-label="Focal strips"><div class="strip"><span></span>"#,
    );
    for i in 0..count {
        let what = if i == 0 {
            "far, "
        } else if i + 1 == count {
            "near, "
        } else {
            ""
        };
        let _ = write!(out, r#"<span class="col">{what}{:.2} mm</span>"#, depth(i));
    }
    out.push_str("</div>");
    for Strip { name, pictures } in all {
        let _ = write!(out, r#"<div class="strip"><span>{}</span>{}</div>"#, escape(&name), pictures.concat());
    }
    out + "</div>"
}

/// One row of the picture while the eye sweeps sideways.
pub fn epipolar(report: &Report, scene: &SceneFigures) -> String {
    let mut out = String::new();
    for (i, (end, z)) in [("near", scene.depth_mm[1]), ("far", scene.depth_mm[0])].into_iter().enumerate() {
        let _ = write!(
            out,
            r#"<p class="case"><b>Focused at the {end} end</b> <span class="note">{z:.2} mm</span></p><div class="pair">"#
        );
        let slice = |out: &mut String, name: &str, under: &str, picture: &Picture| {
            let alt = format!("epipolar slice of {}, {name}, {end} focus", scene.name);
            let _ = write!(
                out,
                r#"<figure class="slice">{}<figcaption><b>{}</b>{under}</figcaption></figure>"#,
                img(picture, &alt, ""),
                escape(name)
            );
        };
        if let Some(picture) = scene.pictures.epipolar.get(i) {
            slice(&mut out, "Photographs", "", picture);
        }
        for (series, run) in runs(report, scene) {
            let Some(picture) = run.pictures.epipolar.get(i) else { continue };
            let psnr = super::stats::mean(run.colors.iter().map(|c| c.epipolar[i]));
            let under = psnr.map_or(String::new(), |p| format!(" {p:.1}\u{a0}dB"));
            slice(&mut out, &report.title(&series.method), &under, picture);
        }
        out.push_str("</div>");
    }
    out
}

/// Where the light is.
pub fn energy(report: &Report, scene: &SceneFigures) -> String {
    let runs = runs(report, scene);
    let mut out = format!(r#"<div class="shots" style="--n:{}">"#, even_columns(runs.len()));
    for (series, run) in runs {
        let Some(map) = &run.pictures.energy else { continue };
        let name = report.title(&series.method);
        let inset = 50.0 * (1.0 - map.share);
        let even = super::stats::mean(run.colors.iter().map(|c| c.variation)).unwrap_or(0.0);
        let alt = format!("energy over the eyebox of {name}, {}, log scale", map.color);
        let _ = write!(
            out,
            r#"<figure class="map"><div class="frame" style="--inset:{inset:.2}%">{}</div><figcaption><b>{}</b><br><span class="note">{}; variation {even:.2}</span></figcaption></figure>"#,
            img(&map.picture, &alt, ""),
            escape(&name),
            map.color
        );
    }
    let ends = DECADES.map(|d| 10f64.powf(d));
    let _ = write!(
        out,
        r#"</div><div class="ramp"><span>{:.2} ×</span><i></i><span>{:.0} × an even eyebox</span></div>"#,
        ends[0], ends[1]
    );
    out
}
