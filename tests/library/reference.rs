//! The CPU engine's lists against float64. The tests compare views, windows, the gradient, the projection, and the
//! signs of the optics.

use eyebox::low_level::engine::{Buffer, Engine, cpu::CpuEngine};
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{Optics, Padding, Pupil, Window, WindowFactor};
use eyebox::low_level::plan::{Comparison, Dispatch, Kernel, Planner, Purpose};
use eyebox::low_level::scene::{Pyramid, ViewGrid};
use eyebox::low_level::solve::{self, Flow, Optimizer, Problem, Settings};
use eyebox_kernels::compare;
use eyebox_tests::gradient::{assert_derivative, gradient_of, intensity_loss, random_targets};
use eyebox_tests::{Oracle, error_power, fft2, loaded, noise, phases, step_with_targets};
use rustfft::num_complex::Complex64;
use std::sync::Arc;

/// float32 rounds to 6e-8. A view has a few dozen roundings in a row, and its power error is near 1e-14. A larger error
/// is a fault.
const VIEW: f64 = 1e-12;

fn optics(h: usize, w: usize) -> Optics {
    Optics::new(h, w, 8e-6, 520e-9, 0.4).unwrap()
}

#[test]
fn views_agree_with_float64() {
    let sizes = [(1, 1), (1, 17), (7, 13), (45, 64), (64, 96), (53, 29)];
    for (h, w) in sizes {
        let planner = Planner::new(optics(h, w), 3, WindowFactor::Full);
        let (exact, rounded) = phases(3 * h * w, 1);
        let mut engine = loaded(&planner, Purpose::View, &rounded);
        for mm in [[0.0, 0.0, 6.0, 0.0], [2.0, -1.0, 5.0, 3.0], [-9.0, 11.0, 9.0, -15.0], [0.0, 3.0, 30.0, 1000.0]] {
            let pupil = Pupil::from_mm(mm);
            let want = Oracle { optics: planner.slm, frames: 3 }.view(&exact, &pupil);
            let seen = evaluate::views(&mut engine, &planner, &[pupil]).unwrap();
            let error = error_power(&seen[0], &want);
            assert!(error < VIEW, "{h}x{w} through {mm:?}: error power {error:.1e} of signal");
        }
    }
}

#[test]
fn a_full_hd_view_agrees_with_float64() {
    let planner = Planner::new(optics(1080, 1920), 1, WindowFactor::Full);
    let (exact, rounded) = phases(1080 * 1920, 2);
    let mut engine = loaded(&planner, Purpose::View, &rounded);
    let pupil = Pupil::from_mm([3.0, -2.0, 12.0, 15.0]);
    let want = Oracle { optics: planner.slm, frames: 1 }.view(&exact, &pupil);
    let error = error_power(&evaluate::views(&mut engine, &planner, &[pupil]).unwrap()[0], &want);
    assert!(error < VIEW, "error power {error:.1e} of signal");
}

/// In float64 the window is exact. Its samples are the full image, band-limited, on a coarser grid (OPTICS 5).
#[test]
fn the_window_is_exact() {
    let o = optics(256, 240);
    let oracle = Oracle { optics: o, frames: 2 };
    let (exact, rounded) = phases(2 * 256 * 240, 3);
    let pupil = Pupil::from_mm([3.0, -2.0, 4.0, 4.0]);
    let window = Window::new(&o, &pupil, WindowFactor::Two);
    assert!(window.rows < 128 && window.columns < 128);
    let (kernel, spectra) = (oracle.kernel(&pupil), oracle.spectra(&exact));
    let scale = (window.rows * window.columns) as f64 / (256.0 * 240.0);
    let mut small = vec![0.0; window.rows * window.columns];
    for spectrum in spectra {
        let mut cut: Vec<Complex64> = Vec::new();
        for (j, [first, end]) in window.spans(&o, &pupil).into_iter().enumerate() {
            for k in 0..window.columns {
                let y = (window.y0 + j as i64).rem_euclid(256) as usize;
                let x = (window.x0 + k as i64).rem_euclid(240) as usize;
                let inside = (first..end).contains(&(k as u32));
                cut.push(if inside { spectrum[y * 240 + x] * kernel[y * 240 + x] } else { Complex64::default() });
            }
        }
        fft2(&mut cut, window.rows, window.columns, true);
        let share = o.share(pupil.diameter);
        small.iter_mut().zip(cut).for_each(|(s, v)| *s += (v * scale).norm_sqr() / (2.0 * share));
    }
    // The full image is resampled by a cut of its spectrum.
    let full = oracle.view(&exact, &pupil);
    let most = full.iter().copied().fold(0.0, f64::max);
    let mut spectrum: Vec<_> = full.iter().map(|v| Complex64::new(*v, 0.0)).collect();
    fft2(&mut spectrum, 256, 240, false);
    let bin = |k: usize, n: usize, m: usize| if k < n - n / 2 { k } else { m + k - n };
    let mut resampled: Vec<Complex64> = (0..window.rows * window.columns)
        .map(|i| {
            spectrum[bin(i / window.columns, window.rows, 256) * 240 + bin(i % window.columns, window.columns, 240)]
                * scale
        })
        .collect();
    fft2(&mut resampled, window.rows, window.columns, true);
    let worst = resampled.iter().zip(&small).map(|(r, s)| (r.re - s).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-12 * most, "largest difference {:.1e} of the brightest", worst / most);

    // The engine has the same window in float32.
    let planner = Planner::new(o, 2, WindowFactor::Two);
    let mut engine = loaded(&planner, Purpose::View, &rounded);
    engine.run(&planner.view_step(vec![planner.pupil_pass(&pupil, &Comparison::default())])).unwrap();
    let error = error_power(&engine.read(Buffer::Image(0)).unwrap(), &small);
    assert!(error < VIEW, "error power {error:.1e} of signal");
}

/// Adam's first moment after one step is a tenth of the gradient. The test compares it with finite differences of the
/// float64 loss.
#[test]
fn the_gradient_is_the_derivative_of_the_loss() {
    let o = optics(20, 24);
    let frames = 3;
    let pupils = [Pupil::from_mm([3.0, -2.0, 9.0, 4.0]), Pupil::from_mm([-5.0, 1.0, 5.0, -1.0])];
    let oracle = Oracle { optics: o, frames };
    let (exact, rounded) = phases(frames * 480, 4);
    let targets = random_targets(2, 480);
    let planner = Planner::new(o, frames, WindowFactor::Full);
    let comparison = Comparison { mode: compare::INTENSITY, exposure: 0.7, batch: 2, ..Comparison::default() };
    let mut engine = loaded(&planner, Purpose::Adam, &rounded);
    // Full windows have the bins in their natural order, from -N/2 on. The image is the same, sample by sample.
    let pupil_passes = pupils.iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
    let (step, losses) = step_with_targets(&planner, &mut engine, pupil_passes, &targets, true);
    let loss: f64 =
        losses.iter().zip(&step.pupil_passes).map(|(l, pupil_pass)| l / pupil_pass.count() as f64).sum::<f64>() / 2.0;
    let want = |phases: &[f64]| intensity_loss(&targets, 0.7, |i| oracle.view(phases, &pupils[i]));
    assert!((loss / want(&exact) - 1.0).abs() < 1e-6, "loss {loss} {}", want(&exact));
    assert_derivative(&gradient_of(&mut engine), &exact, 3, 1e-5, "two pupils", want);
}

/// Compares the projection of the oracle, in float64 and on the whole spectrum, with the step of the engine.
#[test]
fn the_projection_agrees_with_float64() {
    let o = optics(30, 40);
    let (frames, n) = (2, 1200);
    let pupils = [Pupil::from_mm([2.0, 1.0, 8.0, 1.0]), Pupil::from_mm([-1.0, 3.0, 12.0, -2.0])];
    let (exact, rounded) = phases(frames * n, 6);
    let targets: Vec<Vec<f32>> =
        (0..2).map(|i| noise(n, 20 + i).iter().map(|x| (0.5 + 0.4 * x) as f32).collect()).collect();
    let planner = Planner::new(o, frames, WindowFactor::Full);
    let comparison = Comparison { exposure: 1.2, batch: 2, ..Comparison::default() };
    let mut engine = loaded(&planner, Purpose::Project, &rounded);
    let pupil_passes = pupils.iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
    step_with_targets(&planner, &mut engine, pupil_passes, &targets, false);

    let oracle = Oracle { optics: o, frames };
    let mut change = vec![vec![Complex64::default(); n]; frames];
    let mut hits = vec![0.0f64; n];
    for (pupil, target) in pupils.iter().zip(&targets) {
        let (seen, kernel) = (oracle.view(&exact, pupil), oracle.kernel(pupil));
        let ratio = |i: usize| ((f64::from(target[i]) + 1e-6) / (1.2 * seen[i] + 1e-6)).sqrt().min(3.0) - 1.0;
        for (field, change) in oracle.fields(&exact, pupil).into_iter().zip(&mut change) {
            let mut wanted: Vec<_> = field.iter().enumerate().map(|(i, v)| v * ratio(i)).collect();
            fft2(&mut wanted, 30, 40, false);
            change.iter_mut().zip(wanted).zip(&kernel).for_each(|((c, v), k)| *c += v * k.conj());
        }
        hits.iter_mut().zip(&kernel).for_each(|(h, k)| *h += f64::from(u8::from(k.norm() > 0.5)));
    }
    let mut turns = Vec::new();
    for (f, mut change) in change.into_iter().enumerate() {
        change.iter_mut().zip(&hits).for_each(|(c, h)| *c /= h.max(1.0));
        fft2(&mut change, 30, 40, true);
        turns.extend(change.iter().enumerate().map(|(i, du)| (Complex64::from_polar(1.0, -exact[f * n + i]) * du).im));
    }
    let error = error_power(&engine.read(Buffer::Momentum).unwrap(), &turns);
    assert!(error < 1e-11, "error power {error:.1e} of signal");
}

/// A point at depth z0 is sharp for z = z0, from each pupil position. Focused at z it is displaced by (z - z0) s / f.
/// The test covers both axes and a display that is not square.
#[test]
fn a_point_moves_as_the_optics_say() {
    let o = optics(192, 256);
    let (z0, f) = (12e-3, o.focal_length);
    let oracle = Oracle { optics: o, frames: 1 };
    let mut point = vec![Complex64::default(); 192 * 256];
    point[0] = Complex64::new(1.0, 0.0);
    fft2(&mut point, 192, 256, false);
    let back = oracle.kernel(&Pupil { x: 0.0, y: 0.0, diameter: 1.0, depth: -z0 });
    let spectrum: Vec<_> = point.iter().zip(&back).map(|(u, k)| u * k).collect();
    for (x, y) in [(6e-3, 0.0), (0.0, 6e-3), (-4e-3, 5e-3)] {
        for z in [z0, 0.0, 5e-3] {
            let kernel = oracle.kernel(&Pupil { x, y, diameter: 5e-3, depth: z });
            let mut field: Vec<_> = spectrum.iter().zip(&kernel).map(|(u, k)| u * k).collect();
            fft2(&mut field, 192, 256, true);
            let peak = (0..field.len()).max_by(|&a, &b| field[a].norm_sqr().total_cmp(&field[b].norm_sqr())).unwrap();
            let signed = |i: usize, n: usize| if i < n / 2 { i as f64 } else { i as f64 - n as f64 };
            let (got_y, got_x) = (signed(peak / 256, 192), signed(peak % 256, 256));
            let want = |s: f64| (z - z0) * s / f / o.pitch;
            assert!(
                (got_x - want(x)).abs() <= 1.0 && (got_y - want(y)).abs() <= 1.0,
                "({x}, {y}) at {z}: ({got_x}, {got_y})"
            );
        }
    }
}

/// Returns smooth noise in 0.1 .. 0.9.
fn texture(h: usize, w: usize) -> Vec<f32> {
    let raw = noise(h * w, 42);
    let at = |y: usize, x: usize| raw[(y / 6 % (h / 6)) * w + x / 6 % (w / 6)];
    (0..h * w).map(|i| (0.5 + 0.4 * at(i / w, i % w)) as f32).collect()
}

/// Returns views of one textured plane at depth z0.
fn plane(o: &Optics, z0: f64, n: usize) -> (ViewGrid, Arc<Pyramid>, Vec<f32>) {
    let cell = o.eyebox() / n as f64;
    let grid = ViewGrid { rows: n, columns: n, cell };
    let image = texture(o.height, o.width);
    let moved = |index: usize| {
        let (x, y) = grid.position(index);
        let shift = |s: f64| -z0 / o.focal_length * s / o.pitch;
        shifted(&image, o.height, o.width, shift(y), shift(x))
    };
    let views: Vec<Vec<f32>> = (0..n * n).map(moved).collect();
    (grid, Arc::new(Pyramid::new(&views, o.height, o.width)), image)
}

fn shifted(image: &[f32], h: usize, w: usize, dy: f64, dx: f64) -> Vec<f32> {
    let (iy, ix) = (dy.floor(), dx.floor());
    let (ay, ax) = ((dy - iy) as f32, (dx - ix) as f32);
    let at = |y: i64, x: i64| image[(y.rem_euclid(h as i64) * w as i64 + x.rem_euclid(w as i64)) as usize];
    let one = |i: usize| {
        let (y, x) = ((i / w) as i64 - iy as i64, (i % w) as i64 - ix as i64);
        (1.0 - ay) * ((1.0 - ax) * at(y, x) + ax * at(y, x - 1))
            + ay * ((1.0 - ax) * at(y - 1, x) + ax * at(y - 1, x - 1))
    };
    (0..h * w).map(one).collect()
}

fn correlation(a: &[f32], b: &[f32]) -> f64 {
    let mean = |v: &[f32]| v.iter().map(|x| f64::from(*x)).sum::<f64>() / v.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let dot = |a: &[f32], b: &[f32], ma: f64, mb: f64| {
        a.iter().zip(b).map(|(x, y)| (f64::from(*x) - ma) * (f64::from(*y) - mb)).sum::<f64>()
    };
    dot(a, b, ma, mb) / (dot(a, a, ma, ma) * dot(b, b, mb, mb)).sqrt()
}

#[test]
fn the_photograph_of_a_plane_is_sharp_at_its_depth_and_nowhere_else() {
    let o = optics(120, 160);
    let z0 = 12e-3;
    let (grid, pyramid, image) = plane(&o, z0, 5);
    let planner = Planner {
        views: Some(eyebox::low_level::plan::ViewLayout::new(grid, &pyramid)),
        ..Planner::new(o, 1, WindowFactor::Full)
    };
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::View), Some(pyramid)).unwrap();
    let at = |z: f64| Pupil { x: 1e-3, y: -2e-3, diameter: 15e-3, depth: z };
    let seen = evaluate::photographs(&mut engine, &planner, &[at(z0), at(0.0), at(-z0), at(2.0 * z0)]).unwrap();
    let match_with: Vec<f64> = seen.iter().map(|s| correlation(s, &image)).collect();
    assert!(match_with[0] > 0.95 && match_with[1..].iter().all(|c| *c < 0.7), "{match_with:?}");
}

fn problem(optics: Optics, views: ViewGrid, pyramid: Arc<Pyramid>) -> Problem {
    let (padding, eyebox) = (Padding::default(), optics.eyebox());
    let (model, eye, modes) = (None, None, [].into());
    let (regions, center, choice) = ([].into(), [0.0; 2], None);
    Problem {
        optics,
        padding,
        eyebox,
        regions,
        views,
        center,
        pyramid,
        mean: 0.5,
        share: 1.0,
        model,
        eye,
        modes,
        choice,
    }
}

/// A hologram solved for one textured plane shows that plane, displaced by (z - z0) s / f.
#[test]
fn light_field_and_wave_agree() {
    let o = optics(120, 160);
    let z0 = 4e-3;
    let (views, pyramid, image) = plane(&o, z0, 5);
    let problem = problem(o, views, pyramid);
    let settings = Settings { steps: 12, depth: [0.0, 2.0 * z0], diameter: [6e-3, 20e-3], ..Settings::default() };
    let mut engine = CpuEngine::new();
    let solution = solve::solve(&problem, &settings, &mut engine, &mut |_| Flow::Continue).unwrap();
    let planner = Planner::new(o, settings.frames, WindowFactor::Full);
    let mut engine = loaded(&planner, Purpose::View, &solution.phases);
    for (x, y, z) in [(5e-3, 0.0, 2e-3), (0.0, -5e-3, 6e-3), (4e-3, 4e-3, z0), (-5e-3, 3e-3, 2e-3)] {
        let pupil = Pupil { x, y, diameter: 8e-3, depth: z };
        let seen = &evaluate::views(&mut engine, &planner, &[pupil]).unwrap()[0];
        // This is the displacement with the best match of the shifted texture, over +-12 pixels.
        let all = (-12..=12i32).flat_map(|dy| (-12..=12i32).map(move |dx| (dy, dx)));
        let score = |(dy, dx): (i32, i32)| correlation(seen, &shifted(&image, 120, 160, f64::from(dy), f64::from(dx)));
        let best = all.max_by(|&a, &b| score(a).total_cmp(&score(b))).unwrap();
        let want = |s: f64| (z - z0) * s / o.focal_length / o.pitch;
        let (dy, dx) = (f64::from(best.0) - want(y), f64::from(best.1) - want(x));
        assert!(
            dy.abs() <= 1.0 && dx.abs() <= 1.0,
            "({x}, {y}) at {z}: {best:?}, not ({:.1}, {:.1})",
            want(y),
            want(x)
        );
    }
}

/// Padding keeps light from entering on the other side.
#[test]
fn padding_stops_the_wrap() {
    let o = optics(64, 64);
    // The pupil sees a bright stripe at the right edge, far out of focus, from the left. The stripe moves off the
    // display.
    let pupil = Pupil::from_mm([8.0, 0.0, 4.0, 8.0]);
    let padding = Padding::required(&o, 8e-3, 10e-3);
    assert!(padding.columns >= 25);
    // The number of sub-frames is large, because speckle would hide the share.
    let (_, rounded) = phases(64 * 64 * 64, 9);
    let bare = Planner::new(o, 64, WindowFactor::Full);
    let padded = bare.clone().with_padding(padding);
    let light = |planner: &Planner| -> (f64, Vec<f32>) {
        let mut engine = loaded(planner, Purpose::View, &rounded);
        let seen = evaluate::views(&mut engine, planner, &[pupil]).unwrap().remove(0);
        (seen.iter().map(|v| f64::from(*v)).sum(), seen)
    };
    let ((all, wrapped), (kept, clean)) = (light(&bare), light(&padded));
    // z s / f / p = 20 of 64 columns leave. Circular propagation keeps their light, and padding does not.
    assert!((0.6..0.72).contains(&(kept / all)), "{}", kept / all);
    let column = |v: &[f32], x: usize| (0..64).map(|y| f64::from(v[y * 64 + x])).sum::<f64>();
    // Light moves by +z s / f. The light of the first columns came from beyond the left edge, where padding has none.
    assert!(column(&clean, 5) < 0.2 * column(&wrapped, 5), "{} {}", column(&clean, 5), column(&wrapped, 5));
}

#[test]
fn the_same_seed_gives_the_same_bits_on_any_number_of_threads() {
    let o = optics(96, 80);
    let (views, pyramid, _) = plane(&o, 2e-3, 3);
    let problem = problem(o, views, pyramid);
    for optimizer in [Optimizer::projection(), Optimizer::adam()] {
        let settings = Settings { steps: 4, optimizer, seed: 11, ..Settings::default() };
        let with = |threads: usize, window_bytes: usize| {
            let settings = Settings { window_bytes, ..settings.clone() };
            let pool = eyebox_tests::pool(threads);
            pool.install(|| {
                solve::solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap().phases
            })
        };
        let one = with(1, 256 << 20);
        assert!(one.iter().all(|p| p.abs() <= 3.2), "phases are wrapped");
        assert!(one == with(2, 256 << 20) && one == with(16, 256 << 20), "threads");
        // If only a few pupils are in flight at a time, the sums and their order are the same.
        assert!(one == with(2, 1 << 16), "groups");
    }
}

/// The lists name each kernel of a step, in the order of the light.
#[test]
fn lists_are_in_the_order_of_light() {
    let planner = Planner::new(optics(32, 32), 2, WindowFactor::One);
    let pupil_passes = |n| {
        (0..n)
            .map(|_| planner.pupil_pass(&Pupil::from_mm([0.0, 0.0, 5.0, 0.0]), &Comparison::default()))
            .collect::<Vec<_>>()
    };
    let step = planner.project_step(pupil_passes(3), usize::MAX, 1.0, 1.0, 0.0);
    let names: Vec<_> = step.list.iter().map(|d: &Dispatch| d.kernel.name()).collect();
    let want = "modulate field_forward clear overlap transfer photograph resample pass_pupil window_inverse intensity compare apply_factor window_forward pupil_adjoint divide_by_overlap change_inverse project";
    assert_eq!(names.join(" "), want);
    // With one pupil pass at a time, its part of the list occurs three times.
    let step = planner.adam_step(pupil_passes(3), 1, 1, 0.1);
    assert_eq!(step.list.iter().filter(|d| d.kernel == Kernel::Compare).count(), 3);
    assert!(step.list.iter().all(|d| d.kernel != Kernel::DivideByOverlap));
}
