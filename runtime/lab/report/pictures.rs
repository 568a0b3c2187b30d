//! Makes grids of pictures, with target images next to reconstructions.

use crate::comparison::{DECADES, ERROR_GAIN, Picture, Results, Run, SHOWN, SceneFigures, Series, mean};
use maud::{Markup, html};

pub(super) fn img(picture: &Picture, alt: &str, class: Option<&str>) -> Markup {
    let Picture { width, height, data, .. } = picture;
    html! { img class=[class] width=(width) height=(height) alt=(alt) title=(alt) src=(data); }
}

/// Returns a figure with a name and the text under it.
fn shot(class: Option<&str>, images: Markup, name: &str, under: Markup) -> Markup {
    html! { figure class=[class] { (images) figcaption { b { (name) } (under) } } }
}

/// Formats a PSNR for a cell of a table. A black picture has none.
pub(crate) fn decibels(psnr: Option<f64>, digits: usize) -> String {
    psnr.map_or("black".into(), |p| format!("{p:.digits$}"))
}

/// Formats a PSNR with its unit.
pub(crate) fn in_decibels(psnr: Option<f64>) -> String {
    psnr.map_or("black".into(), |p| format!("{p:.1}\u{a0}dB"))
}

/// Returns a ramp of colors with the labels of its ends.
pub(super) fn ramp(from: &str, to: &str) -> Markup {
    html! { div.ramp { span { (from) } i {} span { (to) } } }
}

/// Returns the results of a scene by method, at the largest number of sub-frames.
fn runs<'a>(results: &'a Results, scene: &SceneFigures) -> Vec<(Series, &'a Run)> {
    let of = |s: &Series| {
        results.runs.iter().find(|r| r.method == s.method && r.frames == s.frames && r.scene == scene.name)
    };
    results.leading().into_iter().filter_map(|s| of(&s).map(|run| (s, run))).collect()
}

/// Returns the style for a number of columns with which rows of at most six are about equally full.
pub(super) fn columns(count: usize) -> String {
    format!("--n:{}", count.max(1).div_ceil(count.max(1).div_ceil(6)))
}

/// Shows the images through the shown pupils. The target image is first, and each method follows with its error.
pub fn views(results: &Results, scene: &SceneFigures) -> Markup {
    let runs = runs(results, scene);
    let place = |group, index| {
        let row = runs.iter().find_map(|(_, r)| r.rows.iter().find(|r| r.group == group && r.index == index))?;
        let [x, y, d, z] = row.pupil_mm.map(|v| if v.abs() < 0.005 { 0.0 } else { v });
        let ceiling = results.ceiling_at(group, index).map_or(String::new(), |db| format!(", ceiling {db:.1} dB"));
        let focus = format!("{z:.2} mm ({:.3} D)", row.focus_dioptres);
        Some(format!("at ({x:.1}, {y:.1}) mm, {d:.1} mm wide, focused at {focus}{ceiling}"))
    };
    html! {
        @for (i, shown) in SHOWN.iter().enumerate() {
            @let about = shown.title.to_lowercase();
            p.case { b { (shown.title) } " " span.note { (place(shown.group, shown.index).unwrap_or_default()) } }
            div.shots style=(columns(runs.len() + 1)) {
                @if let Some(picture) = scene.pictures.views.get(i) {
                    (shot(
                        None,
                        img(picture, &format!("target image of {}, {about}", scene.name), None),
                        "Target image",
                        html! { br; span.note { "of the scene" } },
                    ))
                }
                @for (series, run) in &runs {
                    @if let (Some(view), Some(error)) = (run.pictures.views.get(i), run.pictures.errors.get(i)) {
                        @let (name, psnr) = (results.title(&series.method), format!(" {}", in_decibels(view.psnr)));
                        @let images = html! {
                            (img(view, &format!("{name}, {about},{psnr}"), None))
                            (img(error, &format!("error of {name}, {about}"), Some("error")))
                        };
                        (shot(None, images, &name, html! { (psnr) }))
                    }
                }
            }
        }
        p.note {
            (format!(
                "Each view has its error below it. The error is the mean absolute difference over colors, after 2 × 2 \
                 averaging, times {ERROR_GAIN:.0}."
            ))
        }
        (ramp("0", &format!("{:.2} of full scale", 1.0 / ERROR_GAIN)))
    }
}

/// Shows the images of an eye that focuses through the scene.
pub(crate) fn strips(results: &Results, scene: &SceneFigures) -> Markup {
    let count = scene.pictures.strip.len();
    let depth = |i: usize| {
        let at = |[far, near]: [f64; 2]| far + (near - far) * i as f64 / (count.max(2) - 1) as f64;
        format!("{:.2} mm ({:.3} D)", at(scene.depth_mm), at(scene.depth_dioptres))
    };
    let end = |i: usize| match i {
        0 => "far, ",
        i if i + 1 == count => "near, ",
        _ => "",
    };
    let seen = runs(results, scene).into_iter().map(|(s, r)| (results.title(&s.method), &r.pictures.strip));
    html! {
        div.strips tabindex="0" role="region" aria-label="Focal strips" {
            div.strip {
                span {}
                @for i in 0..count { span.col { (end(i)) (depth(i)) } }
            }
            @for (name, pictures) in std::iter::once(("Target image".to_string(), &scene.pictures.strip)).chain(seen) {
                div.strip {
                    span { (name) }
                    @for (i, picture) in pictures.iter().enumerate() {
                        (img(picture, &format!("{name}, {} focused at {}", scene.name, depth(i)), None))
                    }
                }
            }
        }
    }
}

/// Shows one row of the picture for an eye that sweeps sideways.
pub(crate) fn epipolar(results: &Results, scene: &SceneFigures) -> Markup {
    let slice = |picture: &Picture, name: &str, under: String, end: &str| {
        let alt = format!("epipolar slice of {}, {name}, {end} focus", scene.name);
        shot(Some("slice"), img(picture, &alt, None), name, html! { (under) })
    };
    html! {
        @for (i, (end, z)) in [("near", 1), ("far", 0)].into_iter().enumerate() {
            p.case { b { "Focused at the " (end) " end" } " " span.note { (format!("{:.2} mm ({:.3} D)", scene.depth_mm[z], scene.depth_dioptres[z])) } }
            div.pair {
                @if let Some(picture) = scene.pictures.epipolar.get(i) {
                    (slice(picture, "Target images", String::new(), end))
                }
                @for (series, run) in runs(results, scene) {
                    @if let Some(picture) = run.pictures.epipolar.get(i) {
                        @let psnr = mean(run.colors.iter().filter_map(|c| c.epipolar[i]));
                        (slice(picture, &results.title(&series.method), format!(" {}", in_decibels(psnr)), end))
                    }
                }
            }
        }
    }
}

/// Shows the energy over the pupil plane.
pub fn energy(results: &Results, scene: &SceneFigures) -> Markup {
    let runs = runs(results, scene);
    let ends = DECADES.map(|d| 10f64.powf(d));
    html! {
        div.shots style=(columns(runs.len())) {
            @for (series, run) in &runs {
                @if let Some(map) = &run.pictures.energy {
                    @let name = results.title(&series.method);
                    @let alt = format!("energy over the eyebox of {name}, {}, log scale", map.color);
                    @let variation = mean(run.colors.iter().map(|c| c.variation)).unwrap_or(0.0);
                    @let framed = html! {
                        div.frame style=(format!("--inset:{:.2}%", 50.0 * (1.0 - map.share))) {
                            (img(&map.picture, &alt, None))
                        }
                    };
                    @let under = format!("{}, variation {variation:.2}", map.color);
                    (shot(Some("map"), framed, &name, html! { br; span.note { (under) } }))
                }
            }
        }
        (ramp(&format!("{:.2} ×", ends[0]), &format!("{:.0} × an even eyebox", ends[1])))
    }
}
