//! Tests the forward model against its definition, and its slopes against differences.

use super::device::Set;
use super::map::CameraMap;
use super::parameters::{Parameter, Parameters, of_order};
use super::pattern;
use super::seen::Look;
use super::views::{PatternSet, Pictures, View};
use eyebox_kernels::Complex64;
use eyebox_optics::{DisplayModel, Iris, Optics, Pupil, SlmPart, Spread, transfer};
use std::f64::consts::TAU;

const SIZE: [usize; 2] = [20, 24];
const RADIUS: f64 = 13e-3;

fn everything() -> DisplayModel {
    DisplayModel {
        level: [[0.97, 1.0, 1.02], [1.0, 1.05, 1.0], [0.98, 1.0, 1.01]],
        bend: [0.2, -0.1],
        lag: 0.1,
        crosstalk: Some([[1.2, 2.0], [1.4, 1.6], [1.2, 2.0], [1.1, 2.4]].map(Spread::from)),
        subpixels: 1,
        fill: 0.95,
        source: [0.1, -0.05, -0.4, 0.1, -0.5],
        undiffracted: vec![[0.15, 0.1, 1.0, -2.0, 0.5], [-0.05, 0.1, -3.0, 1.0, 0.2]],
        wavefront: [(3, 0.05), (4, 0.2), (7, -0.1), (12, 0.05)].into(),
        iris: Iris { x: 2e-4, y: -1e-4, scale: 1.02 },
    }
}

fn pictures(at: &Parameters, pixels: Vec<[f64; 2]>) -> Pictures {
    let optics = Optics::new(SIZE[0], SIZE[1], 8e-6, 520e-9, 0.4).unwrap();
    let pattern = pattern::random(SIZE, 256.0, 3, 1);
    let slm = SlmPart::from(SIZE);
    let look = Look::new((slm, &optics), Pupil::from_mm([3.0, -2.0, 9.0, 4.0]), RADIUS, at, pixels);
    let parts = vec![Set { pattern: pattern.clone(), windows: vec![look.window.clone()] }];
    let n = look.pixels.len();
    let (counts, variance) = (vec![0.0; n], vec![1.0; n]);
    let view = View {
        set: 0,
        looks: vec![(look, 0)],
        counts,
        variance,
        signal: 1.0,
        exposure_ms: 1.0,
        full_scale: 1.0,
        file: "a".into(),
    };
    Pictures { optics, parts: vec![slm], sets: vec![PatternSet { pattern, parts }], views: vec![view], dark: 0.0 }
}

/// The same picture with the SLM in parts. `pixels` are in the middle of each part.
fn in_parts(at: &Parameters, slm: [usize; 2], parts: &[SlmPart], pixels: &[Vec<[f64; 2]>]) -> Pictures {
    let optics = Optics::new(slm[0], slm[1], 8e-6, 520e-9, 0.4).unwrap();
    let pattern = pattern::random(slm, 256.0, 2, 1);
    let iris = Pupil::from_mm([2.0, -1.0, 6.0, 1.0]);
    let look =
        |(part, pixels): (&SlmPart, &Vec<[f64; 2]>)| Look::new((*part, &optics), iris, RADIUS, at, pixels.clone());
    let looks: Vec<(Look, usize)> = parts.iter().zip(pixels).map(look).map(|look| (look, 0)).collect();
    let set = |(part, (look, _)): (&SlmPart, &(Look, usize))| Set {
        pattern: pattern.part(part),
        windows: vec![look.window.clone()],
    };
    let sets = vec![PatternSet { parts: parts.iter().zip(&looks).map(set).collect(), pattern }];
    let n = pixels.iter().map(Vec::len).sum();
    let (counts, variance, file) = (vec![0.0; n], vec![1.0; n], "a".into());
    let view = View { set: 0, looks, counts, variance, signal: 1.0, exposure_ms: 1.0, full_scale: 1.0, file };
    Pictures { optics, parts: parts.to_vec(), sets, views: vec![view], dark: 0.0 }
}

/// A camera on the SLM's own grid whose pixels are points.
fn plain(model: DisplayModel) -> Parameters {
    let map = CameraMap { numbers: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], slm: SIZE, camera: SIZE };
    Parameters { model, map, camera_pixel: 0.0, soft_edge: false }
}

#[test]
fn what_a_camera_sees_is_the_definitions_sum() {
    let at = plain(DisplayModel { crosstalk: None, ..everything() });
    let pixels = vec![[0.0, 0.0], [7.0, 3.0], [23.0, 19.0], [11.5, 8.25]];
    let pictures = pictures(&at, pixels.clone());
    let seen = &pictures.see(&at, 1, &[0], &[])[0];
    let (optics, model) = (pictures.optics, &at.model);
    let [height, width] = SIZE;
    let (level, source) = (model.level_map([height, width]), model.source_amplitude([height, width]));
    let rest = model.undiffracted_share([height, width]);
    let (shares, pattern) = (model.lag_shares(3), &pictures.sets[0].pattern);
    let pupil = model.true_pupil(&Pupil::from_mm([3.0, -2.0, 9.0, 4.0]));
    let bin = optics.bin_size();
    for (pixel, got) in pixels.iter().zip(&seen.intensity) {
        let mut want = 0.0;
        for t in 0..3usize {
            let mut v = Complex64::default();
            for (ky, kx) in (-10..10i64).flat_map(|y| (-12..12i64).map(move |x| (y, x))) {
                let (re, im) = transfer(&optics, &pupil, ky, kx);
                if (re, im) == (0.0, 0.0) {
                    continue;
                }
                let (fy, fx) = (ky as f64 / height as f64, kx as f64 / width as f64);
                let mut bin_value = Complex64::default();
                for i in 0..height * width {
                    let driven =
                        |k: usize| model.look_up(f64::from(pattern.frame((t + 3 - k) % 3)[i]), level[i]).0 * shares[k];
                    let phase: f64 = (0..3).map(driven).sum();
                    let u = source[i] * (model.modulated_share() * Complex64::cis(phase) + rest[i]);
                    bin_value += u * Complex64::cis(-TAU * (fy * (i / width) as f64 + fx * (i % width) as f64));
                }
                let aperture = model.pixel_aperture(fy, 1) * model.pixel_aperture(fx, 1);
                let turns = model.wavefront_turns(kx as f64 * bin.1, ky as f64 * bin.0, RADIUS);
                let on = Complex64::new(re, im) * Complex64::cis(TAU * (turns + fy * pixel[1] + fx * pixel[0]));
                v += bin_value * aperture * on / (height * width) as f64;
            }
            want += v.norm_sqr() / 3.0;
        }
        assert!((got / want - 1.0).abs() < 1e-3, "{pixel:?}: {got}, not {want}");
    }
    // With crosstalk of zero, sub-pixels change nothing.
    let none = [[1.2, 1e6]; 4].map(Spread::from);
    let fine = DisplayModel { crosstalk: Some(none), ..at.model.clone() };
    let most = seen.intensity.iter().copied().fold(0.0, f64::max);
    let seen_finely = &pictures.see(&plain(fine), 2, &[0], &[])[0];
    for (a, b) in seen.intensity.iter().zip(&seen_finely.intensity) {
        // The transfer is a sum of a limited number of orders, which limits the accuracy.
        assert!((a - b).abs() < 3e-3 * most, "{a}, {b}");
    }
}

/// Predictions and slopes of the whole SLM equal the ones of pieces with a margin, in the same order. The differences
/// are the light from beyond the pieces and the bins at the edge of the iris.
#[test]
fn pieces_predict_what_the_whole_slm_does() {
    let slm = [160, 176];
    let map = CameraMap { slm, camera: slm, ..plain(everything()).map };
    let at = Parameters { map, soft_edge: true, ..plain(everything()) };
    let parts = [[0, 80], [64, 0]].map(|first| SlmPart { slm, first, size: [96; 2] });
    let inside = |part: &SlmPart| -> Vec<[f64; 2]> {
        let at = |i: usize| [1, 0].map(|axis| (part.first[axis] + 32 + (i * [7, 5][axis]) % 32) as f64 + 0.25);
        (0..40).map(at).collect()
    };
    let pixels: Vec<Vec<[f64; 2]>> = parts.iter().map(inside).collect();
    let mut free: Vec<Parameter> = Parameter::all(2).into_iter().filter(|p| !matches!(p, Parameter::Iris(_))).collect();
    free.extend((2..=3).flat_map(of_order));
    let of_pieces = in_parts(&at, slm, &parts, &pixels).see(&at, 2, &[0], &free).remove(0);
    let whole = in_parts(&at, slm, &[slm.into()], &[pixels.concat()]).see(&at, 2, &[0], &free).remove(0);
    let power = |v: &mut dyn Iterator<Item = f64>| v.map(|v| v * v).sum::<f64>();
    let light = power(&mut whole.intensity.iter().copied());
    let apart = |a: &[f64], b: &[f64]| power(&mut a.iter().zip(b).map(|(a, b)| a - b));
    assert_eq!((of_pieces.intensity.len(), of_pieces.slopes.len()), (80, free.len()));
    let off = apart(&of_pieces.intensity, &whole.intensity) / light;
    assert!(off < 3e-3, "{off:e}");
    // Slopes are weighted by a usual step of the parameter, because a corner's level hardly shows in pieces elsewhere.
    for (p, (of_pieces, whole)) in free.iter().zip(of_pieces.slopes.iter().zip(&whole.slopes)) {
        let (off, all) = (apart(of_pieces, whole), power(&mut whole.iter().copied()));
        assert!(off < 2e-2 * all || off * p.usual().powi(2) < 1e-4 * light, "{p:?}: {off:e} of {all:e}");
    }
    let places: Vec<[f64; 2]> = pixels.concat();
    let anywhere = in_parts(&at, slm, &parts, &pixels).see_places(&at, 2, 0, &places);
    assert!(apart(&anywhere, &whole.intensity) < 1e-9 * light);
}

#[test]
fn slopes_agree_with_differences() {
    let numbers = [0.9, 0.03, 0.02, -0.03, 0.91, -0.05, 0.02, -0.01, 0.01, 0.0];
    let map = CameraMap { numbers, slm: SIZE, camera: [40, 44] };
    let at = Parameters { map, camera_pixel: 0.8, ..plain(everything()) };
    let pictures = pictures(&at, vec![[20.0, 20.0], [9.0, 12.0], [30.0, 25.0], [22.0, 8.0]]);
    // The iris's edge jumps from bin to bin. Its slope is smoothed and matches no difference.
    let mut free: Vec<Parameter> = Parameter::all(2).into_iter().filter(|p| !matches!(p, Parameter::Iris(_))).collect();
    free.extend((2..=4).flat_map(of_order));
    let seen = &pictures.see(&at, 2, &[0], &free)[0];
    for (p, slopes) in free.iter().zip(&seen.slopes) {
        let step = 1e-4;
        let [after, before] = [step, -step].map(|s| pictures.see(&at.moved(*p, s), 2, &[0], &[]).remove(0).intensity);
        let size = slopes.iter().map(|s| s.abs()).fold(0.0, f64::max);
        for ((a, b), slope) in after.iter().zip(&before).zip(slopes) {
            let want = (a - b) / (2.0 * step);
            assert!((slope - want).abs() < 3e-3 * size, "{p:?}: {slope}, not {want}");
        }
    }
}

#[test]
fn a_soft_edge_has_slopes_that_agree_with_differences() {
    let at = Parameters { soft_edge: true, ..plain(everything()) };
    let pictures = pictures(&at, vec![[2.0, 3.0], [9.0, 12.0], [17.0, 5.0]]);
    let free = [0, 1, 2].map(Parameter::Iris);
    let seen = &pictures.see(&at, 1, &[0], &free)[0];
    for (p, slopes) in free.iter().zip(&seen.slopes) {
        // The step is the model's own, a quarter of a bin, because coverage has bends.
        let (bin_y, bin_x) = pictures.optics.bin_size();
        let (far, reach) = (0.25e3 * bin_y.min(bin_x), 4.5 + 3f64.hypot(2.0));
        let step = if *p == Parameter::Iris(2) { far / reach } else { far };
        let [after, before] = [step, -step].map(|s| pictures.see(&at.moved(*p, s), 1, &[0], &[]).remove(0).intensity);
        let size = slopes.iter().map(|s| s.abs()).fold(0.0, f64::max);
        assert!(size > 0.0, "{p:?} has no slope");
        for ((a, b), slope) in after.iter().zip(&before).zip(slopes) {
            let want = (a - b) / (2.0 * step);
            assert!((slope - want).abs() < 0.3 * size, "{p:?}: {slope}, not {want}");
        }
    }
}

#[test]
fn each_picture_has_a_gain_and_an_offset_of_its_own() {
    let at = plain(DisplayModel { crosstalk: None, ..everything() });
    let pixels: Vec<[f64; 2]> = (0..40).map(|i| [f64::from(i % 8) * 2.5, f64::from(i / 8) * 3.5]).collect();
    let mut pictures = pictures(&at, pixels);
    let seen = pictures.see(&at, 1, &[0], &[]);
    let most = seen[0].intensity.iter().copied().fold(0.0, f64::max);
    pictures.views[0].counts = seen[0].intensity.iter().map(|i| 0.1 + 0.7 * i / most).collect();
    pictures.views[0].signal = 0.01;
    let exposure = pictures.exposure(0, &seen[0]);
    assert!((exposure.gain * most / 0.7 - 1.0).abs() < 1e-2 && (exposure.dark - 0.1).abs() < 1e-2, "{exposure:?}");
    assert!(pictures.left(&[0], &seen)[0][0] < 1e-4);
    // A picture without contrast keeps the camera's dark level.
    let even = super::seen::Prediction { intensity: vec![2.0; 40], slopes: Vec::new() };
    pictures.dark = 0.05;
    pictures.views[0].counts = vec![0.45; 40];
    let exposure = pictures.exposure(0, &even);
    assert!((exposure.dark - 0.05).abs() < 1e-6 && (exposure.gain - 0.2).abs() < 1e-6, "{exposure:?}");
}

#[test]
fn cameras_that_look_elsewhere_see_what_each_of_them_sees() {
    let numbers = [0.9, 0.03, 0.02, -0.03, 0.91, -0.05, 0.02, -0.01, 0.01, 0.0];
    let map = CameraMap { numbers, slm: SIZE, camera: [40, 44] };
    let at = Parameters { map, camera_pixel: 0.8, ..plain(everything()) };
    let pictures = pictures(&at, vec![[20.0, 20.0], [9.0, 12.0], [30.0, 25.0], [22.0, 8.0]]);
    let elsewhere = [at.clone(), at.moved(Parameter::Map(2), 0.1), at.moved(Parameter::Map(5), -0.07)];
    let together = pictures.see_from(&at, 2, &[0], &elsewhere.each_ref().map(|at| at.map));
    for (at, seen) in elsewhere.iter().zip(&together[0]) {
        assert_eq!(seen.intensity, pictures.see(at, 2, &[0], &[])[0].intensity);
    }
}
