//! Target images from few views by Fourier disparity layers (OPTICS 14). They are compared with waves that have target
//! images in closed form.

use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::optics::{Color, Display, Pupil};
use eyebox::low_level::reconstruction::SceneSource;
use eyebox::low_level::scene::{self, Layers, LightField, Request, SceneError, ViewGrid, ViewSynthesis};
use std::f64::consts::TAU;

const SIZE: usize = 48;

fn display() -> Display {
    Display { height: SIZE, width: SIZE, ..Display::preset("small").unwrap() }
}

/// Returns waves without occlusion. Each has cycles per pixel along y and x, phase, amplitude, and pixels of movement
/// across the eyebox.
fn waves(ends: [f64; 2]) -> Vec<[f64; 5]> {
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let wave = |i: usize| {
        let (f, angle) = (0.02 + 0.4 * (i / 2) as f64 / 24.0, TAU * random());
        [f * angle.sin(), f * angle.cos(), TAU * random(), 0.03 * (0.02 / f).powf(0.5), ends[i % 2]]
    };
    (0..48).map(wave).collect()
}

/// Returns the mean of `exp(i t cos)` over a disc.
fn jinc(t: f64) -> f64 {
    let node = |i: usize| std::f64::consts::PI * f64::from(i as u32) / 65.0;
    (1..65).map(|i| 2.0 * node(i).sin().powi(2) / 65.0 * (t * node(i).cos()).cos()).sum()
}

/// Returns the view through a disc at `s` (x, y) with diameter `d`, in eyeboxes. The focus is at content that moves by
/// `focus` pixels.
fn seen(waves: &[[f64; 5]], s: [f64; 2], d: f64, focus: f64) -> Vec<f32> {
    let mut image = vec![0.5f64; SIZE * SIZE];
    for [fy, fx, phase, amplitude, moved] in waves {
        let apart = moved - focus;
        let amplitude = amplitude * jinc(TAU / 2.0 * fy.hypot(*fx) * apart.abs() * d);
        for (i, out) in image.iter_mut().enumerate() {
            let (y, x) = ((i / SIZE) as f64 + apart * s[1], (i % SIZE) as f64 + apart * s[0]);
            *out += amplitude * (TAU * (fy * y + fx * x) + phase).cos();
        }
    }
    image.into_iter().map(|v| v as f32).collect()
}

/// Returns `n` x `n` views of waves at two depths. The views are `pitch` eyeboxes apart.
fn field(n: usize, pitch: f64, ends: [f64; 2]) -> LightField {
    let (display, waves) = (display(), waves(ends));
    let (eyebox, per_pixel) = (display.eyebox_min(), display.focal_length * display.pitch / display.eyebox_min());
    let at = |i: usize| (i as f64 - (n - 1) as f64 / 2.0) * pitch;
    LightField {
        name: "waves".into(),
        grid: [n, n],
        height: SIZE,
        width: SIZE,
        colors: vec![Color::Green],
        planes: vec![(0..n * n).map(|v| seen(&waves, [at(v % n), at(v / n)], 0.0, 0.0)).collect()],
        view_pitch: Some(pitch * eyebox),
        disparity: None,
        depth: Some(ends.map(|moved| moved * per_pixel)),
        made: None,
    }
}

/// Returns dB of full scale away from the edges, because content from beyond the edges is unknown.
fn psnr(a: &[f32], b: &[f32], margin: usize) -> f64 {
    let inside = |i: &usize| [i / SIZE, i % SIZE].iter().all(|k| (margin..SIZE - margin).contains(k));
    let all: Vec<f64> = (0..a.len()).filter(inside).map(|i| f64::from(a[i] - b[i]).powi(2)).collect();
    -10.0 * (all.iter().sum::<f64>() / all.len() as f64).log10()
}

/// Returns the worst target image of pupils all over the eyebox.
fn worst(field: LightField, ends: [f64; 2], pupils: &[[f64; 4]]) -> f64 {
    let (display, waves) = (display(), waves(ends));
    let per_pixel = display.focal_length * display.pitch / display.eyebox_min();
    let source = SceneSource::new(field, &display).unwrap();
    let one = |&[x, y, d, focus]: &[f64; 4]| {
        let [x_m, y_m, diameter] = [x, y, d].map(|v| v * display.eyebox_min());
        let pupil = Pupil { x: x_m, y: y_m, diameter, depth: focus * per_pixel };
        let got = source.photograph(&pupil, &mut CpuEngine::new()).unwrap().remove(0).values;
        psnr(&got, &seen(&waves, [x, y], d, focus), 8)
    };
    pupils.iter().map(one).fold(f64::INFINITY, f64::min)
}

const PUPILS: [[f64; 4]; 4] =
    [[0.0, 0.0, 0.8, -3.0], [0.13, -0.1, 0.36, 4.0], [-0.2, 0.2, 0.27, 1.0], [0.3, 0.1, 0.15, -3.0]];

#[test]
fn layers_of_few_views_photograph_like_many_views() {
    let (ends, display) = ([-3.0, 4.0], display());
    let thin = || field(3, 4.0 / 9.0, ends);
    let made = thin().with_views_for(&display, ViewSynthesis::Auto).unwrap();
    let how = made.made.expect("layers show waves");
    assert_eq!((how.by, how.grid, made.grid), (ViewSynthesis::Layers, [3, 3], [9, 9]));
    assert_eq!(made.own_views(&display).0, [3, 3]);
    let (layers, cells, all) =
        (worst(made, ends, &PUPILS), worst(thin(), ends, &PUPILS), worst(field(9, 1.0 / 9.0, ends), ends, &PUPILS));
    assert!(layers > cells + 8.0 && layers > all - 4.0, "layers {layers:.1}, cells {cells:.1}, all views {all:.1} dB");
}

/// The layers predict the error of views between the given ones, before any target image is computed.
#[test]
fn the_residual_is_the_error_of_views_in_between() {
    let (ends, display) = ([-3.0, 4.0], display());
    let few = field(3, 4.0 / 9.0, ends);
    let layers = Layers::new(&few, &display, few.depth.unwrap()).unwrap();
    assert_eq!((layers.residual().len(), layers.count() > 8), (9, true));
    let grid = ViewGrid { rows: 9, columns: 9, cell: display.eyebox_min() / 9.0 };
    let between: Vec<usize> = (0..81)
        .filter(|v| (v / 9 % 4, v % 9 % 4) != (0, 0) && (2..7).contains(&(v / 9)) && (2..7).contains(&(v % 9)))
        .collect();
    let places: Vec<(f64, f64)> = between.iter().map(|v| grid.position(*v)).collect();
    let true_views = &field(9, 1.0 / 9.0, ends).planes[0];
    let errors = layers
        .views(0, &places)
        .into_iter()
        .zip(&between)
        .map(|(view, v)| 10f64.powf(-psnr(&view, &true_views[*v], 8) / 10.0));
    let measured = -10.0 * (errors.sum::<f64>() / between.len() as f64).log10();
    let told = layers.residual_between();
    assert!(told > 30.0 && measured > told - 1.0, "predicted {told:.1} dB, measured {measured:.1} dB");
}

#[test]
fn dense_views_and_layers_of_them_agree() {
    let (ends, display) = ([-0.3, 0.4], display());
    let dense = || field(5, 0.2, ends);
    let kept = dense().with_views_for(&display, ViewSynthesis::Auto).unwrap();
    assert_eq!(kept, dense(), "cells");
    let made = dense().with_views_for(&display, ViewSynthesis::Layers).unwrap();
    assert!(made.made.is_some());
    let (a, b) = (SceneSource::new(kept, &display).unwrap(), SceneSource::new(made, &display).unwrap());
    for [x, y, d, focus] in PUPILS {
        let [x, y, diameter] = [x, y, d].map(|v| v * display.eyebox_min());
        let depth = 0.1 * focus * display.focal_length * display.pitch / display.eyebox_min();
        let pupil = Pupil { x, y, diameter, depth };
        let shot = |source: &SceneSource| source.photograph(&pupil, &mut CpuEngine::new()).unwrap().remove(0).values;
        let db = psnr(&shot(&a), &shot(&b), 0);
        assert!(db > 45.0, "{db:.1} dB through {pupil:?}");
    }
}

/// No layers explain views that are unrelated. They stay unchanged, unless the caller requests a synthesis.
#[test]
fn what_layers_do_not_show_is_left_to_cells() {
    let (display, mut few) = (display(), field(3, 1.0 / 3.0, [-3.0, 4.0]));
    for (v, view) in few.planes[0].iter_mut().enumerate() {
        view.iter_mut().enumerate().for_each(|(i, p)| *p = ((i * (v + 3) * 2654435761) >> 16 & 255) as f32 / 255.0);
    }
    assert_eq!(few.clone().with_views_for(&display, ViewSynthesis::Auto).unwrap(), few);
    for asked in [ViewSynthesis::Layers, ViewSynthesis::Between] {
        let made = few.clone().with_views_for(&display, asked).unwrap();
        assert_eq!((made.made.map(|m| m.by), made.grid), (Some(asked), [7, 7]));
    }
}

/// A focal stack gives target images of other pupils by layers. Interpolation between its own pictures is much worse.
#[test]
fn a_focal_stack_is_photographed_through_other_pupils() {
    let (ends, display, temp) = ([-3.0, 4.0], display(), tempfile::tempdir().unwrap());
    let (waves, per_pixel) = (waves(ends), display.focal_length * display.pitch / display.eyebox_min());
    let focus: Vec<f64> = (0..6).map(|i| -3.4 + 1.56 * f64::from(i)).collect();
    let stack: Vec<Vec<f32>> = focus.iter().map(|f| seen(&waves, [0.0; 2], 0.8, *f)).collect();
    for (i, picture) in stack.iter().enumerate() {
        let pixel = |x: u32, y: u32| image::Rgb([picture[y as usize * SIZE + x as usize]; 3]);
        let file = temp.path().join(format!("focus-{}.exr", 9 + i));
        image::Rgb32FImage::from_fn(SIZE as u32, SIZE as u32, pixel).save(file).unwrap();
    }
    let state = |text: String| std::fs::write(temp.path().join("lightfield.toml"), text).unwrap();
    let mm: Vec<f64> = focus.iter().map(|f| f * per_pixel * 1e3).collect();
    let (source, colors) = (temp.path().to_str().unwrap(), [Color::Green]);
    let load = || scene::load(source, &Request::new(&display, &colors));
    let aperture = 0.8e3 * display.eyebox_min();
    for (text, code, holds) in [
        (format!("focus_mm = {mm:?}"), "focus-without-aperture", "aperture_mm"),
        (format!("aperture_mm = {aperture}"), "aperture-without-focus", "focus_mm"),
        (format!("aperture_mm = {aperture}\nfocus_mm = [0, 1]"), "focus-count", "6"),
        (format!("aperture_mm = {aperture}\nfocus_mm = [0, 0]"), "focus-same", "[0.0, 0.0]"),
        ("aperture_mm = -1".into(), "aperture", "-1"),
    ] {
        state(text);
        let error = load().map(|_| ()).unwrap_err();
        let SceneError::Settings { reason, .. } = &error else { panic!("{error}") };
        assert!(reason.code() == code && reason.text().contains(holds), "{error}");
    }
    state(format!("focus_mm = {mm:?}\naperture_mm = {aperture}"));
    let pupils = &PUPILS[1..];
    let made = worst(load().unwrap(), ends, pupils);
    // Interpolation uses the two pictures with the nearest focus.
    let between = |&[x, y, d, f]: &[f64; 4]| {
        let i = focus.iter().rposition(|g| *g <= f).unwrap().min(4);
        let t = ((f - focus[i]) / 1.56) as f32;
        let mixed: Vec<f32> = stack[i].iter().zip(&stack[i + 1]).map(|(a, b)| a + t * (b - a)).collect();
        psnr(&mixed, &seen(&waves, [x, y], d, f), 8)
    };
    let interpolated = pupils.iter().map(between).fold(f64::INFINITY, f64::min);
    assert!(made > 33.0 && made > interpolated + 8.0, "layers {made:.1} dB, between pictures {interpolated:.1} dB");
}

/// Layers blur content that hides other content. The views show this, and the synthesis interpolates them.
#[test]
fn what_hides_other_things_is_interpolated() {
    let display = Display { height: 64, width: 64, ..Display::preset("paper").unwrap() };
    let load = |views| {
        let request = Request { views, ..Request::new(&display, &[Color::Green]) };
        scene::load("builtin:still-life?span=2", &request).unwrap()
    };
    let (few, all) = (load(5), load(9));
    let made = few.clone().with_views_for(&display, ViewSynthesis::Auto).unwrap();
    let how = made.made.expect("closer views");
    let (_, [between, _]) = how.layers.unwrap();
    assert!(how.by == ViewSynthesis::Between && between < 36.0, "{how:?}");
    let [all, few, made] = [all, few, made].map(|field| SceneSource::new(field, &display).unwrap());
    let pupil = Pupil { x: 1e-3, y: -2e-3, diameter: 16e-3, depth: 1e-3 };
    let shot = |source: &SceneSource| source.photograph(&pupil, &mut CpuEngine::new()).unwrap().remove(0).values;
    let (wanted, few, made) = (shot(&all), shot(&few), shot(&made));
    let db = |a: &[f32]| {
        -10.0 * (a.iter().zip(&wanted).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / 4096.0).log10()
    };
    assert!(db(&made) > db(&few) + 3.0, "{:.1} dB, of cells {:.1}", db(&made), db(&few));
}

/// One view has another exposure, one is moved, and two are exchanged. An error names them in one line, unless the
/// synthesis is by cells.
#[test]
fn views_that_do_not_fit_the_others_are_named() {
    let (display, ends) = (display(), [-3.0, 4.0]);
    let spoiled = |spoil: &dyn Fn(&mut [Vec<f32>])| {
        let mut few = field(3, 1.0 / 3.0, ends);
        spoil(&mut few.planes[0]);
        assert_eq!(few.clone().with_views_for(&display, ViewSynthesis::Cells).unwrap(), few);
        let error = few.with_views_for(&display, ViewSynthesis::Auto).map(|_| ()).unwrap_err();
        assert!(error.to_string().contains("`photographs`"), "{error}");
        let SceneError::OddViews { views, cause, .. } = error else { panic!("{error}") };
        let numbers = |text: &str| -> Vec<f64> {
            let words = text.split(|c: char| !c.is_ascii_digit() && c != '.');
            words.filter_map(|word| word.trim_end_matches('.').parse().ok()).collect()
        };
        (numbers(&views), numbers(&cause))
    };
    let brighter = spoiled(&|views| views[2].iter_mut().for_each(|v| *v *= 1.3));
    assert!(brighter.0 == [1.0, 3.0] && matches!(brighter.1[..], [1.2..1.4]), "{brighter:?}");
    let moved = spoiled(&|views| views[7].rotate_right(5));
    assert_eq!(moved, (vec![3.0, 2.0], vec![]));
    let exchanged = spoiled(&|views| views.swap(0, 8));
    assert_eq!(exchanged, (vec![1.0, 1.0, 3.0, 3.0], vec![]));
}

/// Measures a folder of 9 x 9 views in `EYEBOX_LIGHT_FIELD`, in green at 256 x 256. It compares target images from
/// every second and every fourth view with those from all views.
#[test]
#[ignore = "measures a light field from EYEBOX_LIGHT_FIELD"]
fn a_light_field_thinned() {
    let source = std::env::var("EYEBOX_LIGHT_FIELD").expect("EYEBOX_LIGHT_FIELD=FOLDER");
    let size = std::env::var("EYEBOX_SIZE").map_or(256, |s| s.parse().unwrap());
    let display = Display { height: size, width: size, ..Display::preset("paper").unwrap() };
    let colors = [Color::Green];
    let request = Request { photographs: ViewSynthesis::Cells, ..Request::new(&display, &colors) };
    let all = scene::load(&source, &request).unwrap();
    let (cell, depth) = (all.cell(&display), all.depths(&display, None).unwrap());
    let shots = |field: LightField| {
        let source = SceneSource::new(field, &display).unwrap();
        let mut engine = CpuEngine::new();
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let one = |_| {
            let diameter = 2e-3 + 18e-3 * random();
            let mut place = || (random() - 0.5) * (display.eyebox_min() - diameter);
            let (x, y) = (place(), place());
            let pupil = Pupil { x, y, diameter, depth: depth[0] + (depth[1] - depth[0]) * random() };
            source.photograph(&pupil, &mut engine).unwrap().remove(0).values
        };
        (0..12).map(one).collect::<Vec<_>>()
    };
    let wanted = shots(all.clone());
    for every in [2, 4] {
        let kept: Vec<usize> = (0..81).filter(|v| v / 9 % every == 0 && v % 9 % every == 0).collect();
        let n = 8 / every + 1;
        let planes = vec![kept.iter().map(|v| all.planes[0][*v].clone()).collect()];
        let few = LightField {
            grid: [n, n],
            planes,
            view_pitch: Some(every as f64 * cell),
            disparity: None,
            depth: Some(depth),
            ..all.clone()
        };
        for asked in [ViewSynthesis::Cells, ViewSynthesis::Layers, ViewSynthesis::Between] {
            let start = std::time::Instant::now();
            let made = few.clone().with_views_for(&display, asked).unwrap();
            let seconds = start.elapsed().as_secs_f64();
            let told = made.made.as_ref().and_then(|m| m.layers);
            let each = shots(made).into_iter().zip(&wanted).map(|(a, b)| {
                let error: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
                -10.0 * (error / a.len() as f64).log10()
            });
            let each: Vec<f64> = each.collect();
            let (mean, worst) = (each.iter().sum::<f64>() / 12.0, each.iter().copied().fold(f64::INFINITY, f64::min));
            println!(
                "{n} x {n} views, {asked}: mean {mean:.1}, worst {worst:.1} dB; {seconds:.1} s; layers, residual {told:.1?}"
            );
        }
    }
}
