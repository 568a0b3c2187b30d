//! The far field against direct sums in float64 (OPTICS 9). The tests compare views, the gradient, the projection and
//! the signs, and both engines with each other.

use eyebox::low_level::engine::{Buffer, Engine, Kernel, Purpose, cpu::CpuEngine};
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{Color, Display, Geometry, Optics, Padding, Pupil, WindowFactor};
use eyebox::low_level::plan::{Comparison, Planner, PupilPass, Step, ViewLayout};
use eyebox::low_level::scene::{self, Pyramid, Request, ViewGrid};
use eyebox::low_level::solve::{self, Flow, Problem, Settings};
use eyebox_kernels::compare;
use eyebox_tests::both::{Case, Noise, assert_silent, vulkan};
use eyebox_tests::gradient::{assert_derivative, gradient_of, intensity_loss};
use eyebox_tests::{error_power, loaded, noise, phases, step_with_targets};
use rustfft::num_complex::Complex64;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// The same bound as for views with a relay. It is far above the rounding of float32 and far below any fault.
const VIEW: f64 = 1e-12;

fn optics(h: usize, w: usize) -> Optics {
    Optics::new(h, w, 8e-6, 520e-9, 0.4).unwrap().in_geometry(Geometry::FarField)
}

/// Returns the pixels inside the pupil, each with its index, its position (y, x), and K at it. Pixel N/2 of N is on the
/// axis.
fn passed(o: &Optics, pupil: &Pupil) -> Vec<(usize, [f64; 2], Complex64)> {
    let place = |i: usize, n: usize| (i as f64 - (n / 2) as f64) * o.pitch;
    let one = |i: usize| {
        let (y, x) = (place(i / o.width, o.height), place(i % o.width, o.width));
        let inside = (x - pupil.x).hypot(y - pupil.y) < pupil.diameter / 2.0;
        let a = (x * x + y * y) / o.focal_length.powi(2);
        let phase = TAU * pupil.depth / o.wavelength * ((1.0 - a).sqrt() - 1.0);
        inside.then(|| (i, [y, x], Complex64::from_polar(1.0, phase)))
    };
    (0..o.height * o.width).filter_map(one).collect()
}

/// Returns the wave `u` at (y, x) of the focal plane, through the pupil, as a sum over its pixels.
fn field_at(o: &Optics, pupil: &Pupil, u: &[Complex64], [y, x]: [f64; 2]) -> Complex64 {
    let per = TAU / (o.wavelength * o.focal_length);
    let sum: Complex64 = (passed(o, pupil).into_iter())
        .map(|(i, r, k)| u[i] * k * Complex64::from_polar(1.0, per * (r[0] * y + r[1] * x)))
        .sum();
    sum / ((o.height * o.width) as f64).sqrt()
}

/// Returns the places of the whole image's samples, a square with its middle sample on the axis.
fn samples(o: &Optics) -> Vec<[f64; 2]> {
    let n = o.height.max(o.width);
    let step = o.wavelength * o.focal_length / (o.pitch * n as f64);
    let at = |i: usize| (i as f64 - (n / 2) as f64) * step;
    (0..n * n).map(|i| [at(i / n), at(i % n)]).collect()
}

/// Returns the intensity over the pupil's share of the SLM.
fn view(o: &Optics, pupil: &Pupil, phases: &[f64]) -> Vec<f64> {
    let pixels = o.height * o.width;
    let frames: Vec<Vec<Complex64>> =
        phases.chunks_exact(pixels).map(|f| f.iter().map(|p| Complex64::from_polar(1.0, *p)).collect()).collect();
    let share = PI / 4.0 * pupil.diameter.powi(2) / (pixels as f64 * o.pitch.powi(2));
    let mean = |r| frames.iter().map(|u| field_at(o, pupil, u, r).norm_sqr()).sum::<f64>() / frames.len() as f64;
    samples(o).into_iter().map(|r| mean(r) / share).collect()
}

#[test]
fn views_agree_with_direct_sums() {
    for (h, w) in [(1, 1), (12, 20), (21, 16), (25, 25), (32, 32)] {
        let planner = Planner::new(optics(h, w), 2, WindowFactor::Full);
        let (exact, rounded) = phases(2 * h * w, 1);
        let mut engine = loaded(&planner, Purpose::View, &rounded);
        for mm in [[0.0, 0.0, 0.1, 0.0], [0.03, -0.02, 0.08, 3.0], [-0.05, 0.05, 0.09, -150.0], [0.0, 0.0, 1.0, 900.0]]
        {
            let pupil = Pupil::from_mm(mm);
            let seen = evaluate::views(&mut engine, &planner, &[pupil]).unwrap();
            let error = error_power(&seen[0], &view(&planner.slm, &pupil, &exact));
            assert!(error < VIEW, "{h}x{w} through {mm:?}: error power {error:.1e} of signal");
        }
    }
}

/// An even field has the same brightness through each pupil, of any size, which is 1 on average over the image.
#[test]
fn light_is_even_over_the_eyebox() {
    let planner = Planner::new(optics(64, 64), 1, WindowFactor::Full);
    let mut engine = loaded(&planner, Purpose::View, &phases(64 * 64, 3).1);
    for mm in [[0.0, 0.0, 0.4, 0.0], [0.1, -0.05, 0.2, 5.0]] {
        let seen = &evaluate::views(&mut engine, &planner, &[Pupil::from_mm(mm)]).unwrap()[0];
        let mean = seen.iter().map(|v| f64::from(*v)).sum::<f64>() / seen.len() as f64;
        assert!((mean - 1.0).abs() < 0.03, "{mm:?}: {mean}");
    }
}

/// A point at depth z0 is sharp for z = z0, from each place of the pupil. Focused at z it is displaced by (z - z0) s /
/// f. The test covers both axes and an SLM that is not square, on the engine. At infinity (z0 = 0) the hologram of the
/// point is a blazed grating.
#[test]
fn a_point_moves_as_the_optics_say() {
    let o = optics(384, 512);
    let (f, n) = (o.focal_length, 512usize);
    let pixel = o.wavelength * f / (o.pitch * n as f64);
    let point = [40.0 * pixel, -25.0 * pixel];
    for z0 in [0.0, 300e-3] {
        // The wave of the point in the pupil plane.
        let phase = |i: usize| {
            let place = |i: usize, n: usize| (i as f64 - (n / 2) as f64) * o.pitch;
            let (y, x) = (place(i / 512, 384), place(i % 512, 512));
            let depth = PI * z0 * (x * x + y * y) / (o.wavelength * f * f);
            depth - TAU * (y * point[0] + x * point[1]) / (o.wavelength * f)
        };
        let planner = Planner::new(o, 1, WindowFactor::Full);
        let wrapped: Vec<f32> =
            (0..384 * 512).map(|i| eyebox::low_level::optics::wrap_phase(phase(i) as f32)).collect();
        if z0 == 0.0 {
            // In a grating, each pixel differs from the next by the same phase.
            let step = |i: usize| (f64::from(wrapped[i + 1]) - f64::from(wrapped[i])).rem_euclid(TAU);
            let want = (-TAU * o.pitch * point[1] / (o.wavelength * f)).rem_euclid(TAU);
            assert!((0..511).all(|i| (step(i) - want).abs() < 1e-3));
        }
        let mut engine = loaded(&planner, Purpose::View, &wrapped);
        for (x, y) in [(1e-3, 0.0), (0.0, 0.8e-3), (-1e-3, 0.7e-3)] {
            let mut sharpest = 0.0;
            for z in [z0, 0.0, 600e-3, -300e-3] {
                let pupil = Pupil { x, y, diameter: 1.2e-3, depth: z };
                let seen = &evaluate::views(&mut engine, &planner, &[pupil]).unwrap()[0];
                let total: f64 = seen.iter().map(|v| f64::from(*v)).sum();
                let middle = |axis: usize| {
                    let at = |i: usize| (if axis == 0 { i / n } else { i % n }) as f64 - (n / 2) as f64;
                    seen.iter().enumerate().map(|(i, v)| at(i) * f64::from(*v)).sum::<f64>() / total
                };
                for (axis, s) in [(0, y), (1, x)] {
                    let want = (point[axis] + (z - z0) * s / f) / pixel;
                    let got = middle(axis);
                    assert!((got - want).abs() < 1.0, "axis {axis} from ({x}, {y}), z0 {z0}, z {z}: {got}, not {want}");
                }
                let peak = seen.iter().copied().fold(0.0f32, f32::max);
                if z == z0 {
                    sharpest = peak;
                } else {
                    assert!(peak < 0.7 * sharpest, "from ({x}, {y}), z0 {z0}, z {z}: {peak} of {sharpest}");
                }
            }
        }
    }
}

/// Runs one step with targets that the test writes. In the far field it transforms no whole field.
fn far_step(
    planner: &Planner,
    engine: &mut CpuEngine,
    pupil_passes: Vec<PupilPass>,
    targets: &[Vec<f32>],
    adam: bool,
) -> (Step, Vec<f64>) {
    let (step, losses) = step_with_targets(planner, engine, pupil_passes, targets, adam);
    assert!(step.list.iter().all(|d| !matches!(d.kernel, Kernel::FieldForward | Kernel::ChangeInverse)));
    (step, losses)
}

/// Moves the axis from the middle of a picture to its first sample, as in windows.
fn axis_first<T: Copy>(image: &[T], n: usize) -> Vec<T> {
    (0..n * n).map(|i| image[(i / n + n / 2) % n * n + (i % n + n / 2) % n]).collect()
}

fn pupils() -> [Pupil; 2] {
    [Pupil::from_mm([0.02, -0.01, 0.1, 40.0]), Pupil::from_mm([-0.03, 0.01, 0.08, -90.0])]
}

fn targets(n: usize) -> Vec<Vec<f32>> {
    (0..2).map(|i| noise(n * n, 10 + i).iter().map(|x| (0.5 + 0.4 * x) as f32).collect()).collect()
}

#[test]
fn the_gradient_is_the_derivative_of_the_loss() {
    let (o, frames, n) = (optics(20, 16), 2, 20);
    let (exact, rounded) = phases(frames * 320, 4);
    let targets = targets(n);
    let planner = Planner::new(o, frames, WindowFactor::Full);
    let comparison = Comparison { mode: compare::INTENSITY, exposure: 0.7, batch: 2, ..Comparison::default() };
    let mut engine = loaded(&planner, Purpose::Adam, &rounded);
    let pupil_passes = pupils().iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
    let written: Vec<_> = targets.iter().map(|t| axis_first(t, n)).collect();
    let (step, losses) = far_step(&planner, &mut engine, pupil_passes, &written, true);
    let loss: f64 =
        losses.iter().zip(&step.pupil_passes).map(|(l, pupil_pass)| l / pupil_pass.count() as f64).sum::<f64>() / 2.0;
    let want = |phases: &[f64]| intensity_loss(&targets, 0.7, |i| view(&o, &pupils()[i], phases));
    assert!((loss / want(&exact) - 1.0).abs() < 1e-6, "loss {loss} {}", want(&exact));
    assert_derivative(&gradient_of(&mut engine), &exact, 3, 1e-5, "two pupils", want);
}

#[test]
fn the_projection_agrees_with_float64() {
    let (o, n) = (optics(16, 20), 20);
    let (exact, rounded) = phases(320, 6);
    let targets = targets(n);
    let planner = Planner::new(o, 1, WindowFactor::Full);
    let comparison = Comparison { exposure: 1.2, batch: 2, ..Comparison::default() };
    let mut engine = loaded(&planner, Purpose::Project, &rounded);
    let pupil_passes = pupils().iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
    let written: Vec<_> = targets.iter().map(|t| axis_first(t, n)).collect();
    far_step(&planner, &mut engine, pupil_passes, &written, false);

    let u: Vec<Complex64> = exact.iter().map(|p| Complex64::from_polar(1.0, *p)).collect();
    let (mut change, mut hits) = (vec![Complex64::default(); 320], vec![0.0f64; 320]);
    let per = TAU / (o.wavelength * o.focal_length);
    for (pupil, target) in pupils().iter().zip(&targets) {
        let seen = view(&o, pupil, &exact);
        let wanted: Vec<_> = (samples(&o).into_iter().zip(seen.iter().zip(target)))
            .map(|(r, (i, t))| {
                let ratio = ((f64::from(*t) + 1e-6) / (1.2 * i + 1e-6)).sqrt().min(3.0) - 1.0;
                (r, field_at(&o, pupil, &u, r) * ratio)
            })
            .collect();
        for (i, r, k) in passed(&o, pupil) {
            // This is the inverse of the sum over pixels. It changes the image by exactly this much, inside the disc.
            let back: Complex64 =
                wanted.iter().map(|(at, v)| v * Complex64::from_polar(1.0, -per * (r[0] * at[0] + r[1] * at[1]))).sum();
            change[i] += back * k.conj() * 320f64.sqrt() / (n * n) as f64;
            hits[i] += 1.0;
        }
    }
    let turns: Vec<f64> = change.iter().zip(&hits).zip(&u).map(|((c, h), u)| (u.conj() * c / h.max(1.0)).im).collect();
    let error = error_power(&engine.read(Buffer::Momentum).unwrap(), &turns);
    assert!(error < 1e-11, "error power {error:.1e} of signal");
}

/// Smaller windows show the same samples, and so does a piece of the SLM that contains the pupil.
#[test]
fn window_and_piece_agree() {
    let o = optics(200, 240);
    let (_, rounded) = phases(200 * 240, 5);
    let pupil = Pupil::from_mm([0.4, -0.3, 0.45, 70.0]);
    let image = |o: Optics, phases: &[f32], factor| {
        let planner = Planner::new(o, 1, factor);
        let pupil_pass = planner.pupil_pass(&pupil, &Comparison::default());
        let size = (pupil_pass.window.rows, pupil_pass.window.columns);
        let mut engine = loaded(&planner, Purpose::View, phases);
        engine.run(&planner.view_step(vec![pupil_pass])).unwrap();
        (engine.read(Buffer::Image(0)).unwrap(), size)
    };
    let (whole, _) = image(o, &rounded, WindowFactor::Full);
    let (small, (rows, columns)) = image(o, &rounded, WindowFactor::Two);
    assert_eq!((rows, columns), (120, 120));
    // The field of view is the same with 240 samples, so every second one is compared.
    let every: Vec<f64> = (0..120 * 120).map(|i| f64::from(whole[2 * (i / 120) * 240 + 2 * (i % 120)])).collect();
    let error = error_power(&small, &every);
    assert!(error < VIEW, "error power {error:.1e} of signal");

    let (corner, size) = ([22usize, 121usize], [90, 100]);
    let cut: Vec<f32> =
        (0..size[0]).flat_map(|y| rounded[(y + corner[0]) * 240 + corner[1]..][..size[1]].to_vec()).collect();
    let (piece, _) = image(o.piece(corner.map(|i| i as i64), size), &cut, WindowFactor::Two);
    let same: Vec<f64> = small.iter().map(|v| f64::from(*v)).collect();
    let error = if piece.len() == same.len() { error_power(&piece, &same) } else { f64::NAN };
    assert!(error < VIEW, "error power {error:.1e} of signal");
    let (one, _) = image(o, &rounded, WindowFactor::One);
    let (piece, _) = image(o.piece(corner.map(|i| i as i64), size), &cut, WindowFactor::One);
    let error = error_power(&piece, &one.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
    assert!(error < VIEW, "error power {error:.1e} of signal");
}

/// A solve for a point at infinity turns random phases into a blazed grating.
#[test]
fn a_point_at_infinity_is_a_blazed_grating() {
    let o = optics(64, 64);
    let mut point = vec![0.0f32; 64 * 64];
    let (y, x) = (32 + 9, 32 - 14);
    point[y * 64 + x] = 64.0 * 64.0;
    let views = ViewGrid { rows: 1, columns: 1, cell: o.eyebox() };
    let pyramid = Arc::new(Pyramid::new(&[point], 64, 64));
    let problem = Problem {
        optics: o,
        padding: Padding::default(),
        eyebox: o.eyebox(),
        views,
        center: [0.0; 2],
        pyramid,
        mean: 1.0,
        share: 1.0,
        model: None,
        eye: None,
        modes: [].into(),
        regions: [].into(),
        choice: None,
    };
    let settings = Settings {
        frames: 1,
        steps: 60,
        depth: [0.0, 0.0],
        diameter: [0.2e-3, 0.5e-3],
        efficiency: Some(1.0),
        window: WindowFactor::Full,
        ..Settings::default()
    };
    let solution = solve::solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
    // The wave of a point at X is exp(-i 2 pi r X / (lambda f)), with X in units of 1/64 of the field of view.
    let (mut count, mut sum) = (0, Complex64::default());
    for (i, p) in solution.phases.iter().enumerate() {
        let (r, c) = ((i / 64) as f64 - 32.0, (i % 64) as f64 - 32.0);
        // Pupils that stay within the SLM rarely reach its corners.
        if r.hypot(c) < 29.0 {
            let grating = -TAU * (r * (y as f64 - 32.0) + c * (x as f64 - 32.0)) / 64.0;
            sum += Complex64::from_polar(1.0, f64::from(*p) - grating);
            count += 1;
        }
    }
    let alike = sum.norm() / f64::from(count);
    assert!(alike > 0.95, "{alike} of a grating");
}

/// The same steps give the same results on Vulkan and on the CPU.
#[test]
fn both_engines_agree() {
    for (h, w) in [(96, 80), (64, 64)] {
        let slm = optics(h, w);
        let mut planner = Planner::new(slm, 2, WindowFactor::Two);
        let n = h.max(w);
        let mut noise = Noise::new(7);
        let views: Vec<Vec<f32>> = (0..9).map(|_| noise.between(n * n, 0.0, 1.0)).collect();
        let pyramid = Arc::new(Pyramid::new(&views, n, n));
        planner.views = Some(ViewLayout::new(ViewGrid { rows: 3, columns: 3, cell: slm.eyebox() / 3.0 }, &pyramid));
        let half = slm.eyebox() / 2.0;
        let pupil = |x: f64, y: f64, d: f64, depth| Pupil { x: x * half, y: y * half, diameter: d * half, depth };
        let pupils = vec![pupil(-0.7, 0.8, 0.4, 0.3), pupil(0.1, -0.05, 1.6, -0.02), pupil(0.3, 0.2, 0.7, 0.15)];
        let case = Case { planner, pyramid, pupils };
        let first = Noise::new(9).between(2 * h * w, -3.0, 3.0);
        for (purpose, mode) in [(Purpose::Project, compare::PROJECTION), (Purpose::Adam, compare::INTENSITY)] {
            let step = case.step(purpose, mode, 0.5, usize::MAX);
            let run = |engine: &mut dyn Engine| {
                case.load(engine, purpose);
                engine.write(Buffer::Phases, &first).unwrap();
                let losses = engine.run(&step).unwrap();
                (losses, engine.read(Buffer::Change).unwrap(), engine.read(Buffer::Image(0)).unwrap())
            };
            let mut gpu = vulkan();
            let (losses, change, image) = run(&mut gpu);
            assert_silent(gpu);
            let (want, want_change, want_image) = run(&mut CpuEngine::new());
            for (a, b) in losses.iter().zip(&want) {
                assert!((a - b).abs() < 1e-4 * b, "{losses:?} {want:?}");
            }
            let wide = |v: &[f32]| v.iter().map(|v| f64::from(*v)).collect::<Vec<_>>();
            assert!(error_power(&change, &wide(&want_change)) < 1e-9);
            assert!(error_power(&image, &wide(&want_image)) < 1e-9);
        }
    }
}

/// Colors differ in field of view. A scene appears at the same angles in all of them, and the rest is black.
#[test]
fn colours_show_the_same_angles() {
    let display = Display { height: 96, width: 96, ..Display::preset("far-field").unwrap() };
    let colors = [Color::Red, Color::Blue];
    let field = scene::load("builtin:chart", &Request { views: 3, ..Request::new(&display, &colors) }).unwrap();
    let (w, shortest) = (display.eyebox_min(), 440e-9);
    assert!((w - 96.0 * 8e-6).abs() < 1e-12);
    let pupil = Pupil { x: 0.1e-3, y: 0.0, diameter: 0.4e-3, depth: 0.0 };
    let photographs = colors.map(|color| {
        let problem = Problem::new(&field, color, &display, Padding::default()).unwrap();
        let planner = problem.planner(1, WindowFactor::Full);
        let mut engine = CpuEngine::new();
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid))).unwrap();
        let pupil_pass = planner.pupil_pass(&pupil, &Comparison::default());
        engine.run(&planner.photograph_step(vec![pupil_pass])).unwrap();
        let whole = evaluate::centered(&engine.read(Buffer::Target(0)).unwrap(), 96, 96);
        (evaluate::photographs(&mut engine, &planner, &[pupil]).unwrap().remove(0), whole)
    });
    let [(red, wide), (blue, _)] = &photographs;
    let apart = |red: &[f32]| red.iter().zip(blue).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / 9216.0;
    // The chart is gray, but with this small number of pixels its edges are less sharp in red.
    assert!(apart(red) < 0.07 && apart(wide) > 2.0 * apart(red), "{} and {}", apart(red), apart(wide));
    // Beyond the field of the shortest wavelength, red is dark.
    let reach = (48.0 * shortest / 660e-9) as i64 + 1;
    let outside = |i: usize| ((i / 96) as i64 - 48).abs().max(((i % 96) as i64 - 48).abs()) > reach;
    assert!(wide.iter().enumerate().filter(|(i, _)| outside(*i)).all(|(_, v)| *v == 0.0));
    assert!(wide.iter().enumerate().any(|(i, v)| !outside(i) && *v > 0.1));
}
