//! Tests simultaneous color against float64 and finite differences.

use super::drives::Drives;
use super::run::{Lit, fit_of};
use super::*;
use crate::engine::Buffer;
use crate::engine::cpu::CpuEngine;
use crate::optics::{Color, Display, Optics, Padding, Pupil, WindowFactor, phase_of, powers_in_sequence};
use crate::plan::{Comparison, Planner, Purpose, Viewpoint};
use crate::scene::{self, LightField, Request};
use crate::solve::step::{Turns, ask};
use crate::solve::{Method, random_phases};
use eyebox_kernels::{Complex64, compare};
use std::f64::consts::TAU;

const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];

fn display(height: usize, width: usize) -> Display {
    Display { height, width, ..Display::preset("small").unwrap() }
}

fn field_of(scene: &str, display: &Display) -> LightField {
    scene::load(scene, &Request { views: 3, ..Request::new(display, &ALL) }).unwrap()
}

fn problems(field: &LightField, display: &Display) -> Vec<Problem> {
    ALL.map(|color| Problem::new(field, color, display, Padding::default()).unwrap()).into()
}

/// Computes the discrete Fourier transform in float64, by its definition along each axis.
fn transform(field: &[Complex64], height: usize, width: usize, sign: f64) -> Vec<Complex64> {
    let along = |from: &[Complex64], lines: usize, n: usize, at: &dyn Fn(usize, usize) -> usize| {
        let mut out = vec![Complex64::default(); from.len()];
        for line in 0..lines {
            for k in 0..n {
                let term = |i: usize| {
                    from[at(line, i)] * Complex64::from_polar(1.0, sign * TAU * ((i * k) % n) as f64 / n as f64)
                };
                out[at(line, k)] = (0..n).map(term).sum();
            }
        }
        out
    };
    let rows = along(field, height, width, &|line, i| line * width + i);
    along(&rows, width, height, &|line, i| i * width + line)
}

/// Returns the part of a spectrum that a pupil passes (OPTICS 2), in the order of the DFT, in float64.
fn kernel_of(o: &Optics, pupil: &Pupil) -> Vec<Complex64> {
    let (h, w) = (o.height, o.width);
    let bin = |k: usize, n: usize| if k < n - n / 2 { k as f64 } else { k as f64 - n as f64 };
    let kernel = |i: usize| {
        let (fy, fx) = (bin(i / w, h) / (h as f64 * o.pitch), bin(i % w, w) / (w as f64 * o.pitch));
        let to_pupil = o.wavelength * o.focal_length;
        if (fx * to_pupil - pupil.x).powi(2) + (fy * to_pupil - pupil.y).powi(2) >= (pupil.diameter / 2.0).powi(2) {
            return Complex64::default();
        }
        let a = o.wavelength.powi(2) * (fx * fx + fy * fy);
        Complex64::from_polar(1.0, -TAU * pupil.depth / o.wavelength * a / (1.0 + (1.0 - a).sqrt()))
    };
    (0..h * w).map(kernel).collect()
}

/// Returns `F^-1 k F` of a field.
fn filtered(field: &[Complex64], kernel: impl Iterator<Item = Complex64>, o: &Optics) -> Vec<Complex64> {
    let (h, w) = (o.height, o.width);
    let passed: Vec<Complex64> = transform(field, h, w, -1.0).iter().zip(kernel).map(|(z, k)| z * k).collect();
    transform(&passed, h, w, 1.0).iter().map(|v| v / (h * w) as f64).collect()
}

/// Returns `v_cf` of every sub-frame through a pupil, by the equations of OPTICS 2 in float64.
fn fields_of(phases: &[f64], o: &Optics, pupil: &Pupil) -> Vec<Vec<Complex64>> {
    let kernel = kernel_of(o, pupil);
    let of_frame = |phases: &[f64]| {
        let u: Vec<Complex64> = phases.iter().map(|p| Complex64::from_polar(1.0, *p)).collect();
        filtered(&u, kernel.iter().copied(), o)
    };
    phases.chunks_exact(o.height * o.width).map(of_frame).collect()
}

/// Returns the light `|v_cf|^2` of every sub-frame.
fn light_of(phases: &[f64], o: &Optics, pupil: &Pupil) -> Vec<Vec<f64>> {
    fields_of(phases, o, pupil).iter().map(|field| field.iter().map(|v| v.norm_sqr()).collect()).collect()
}

/// Drive values in float64, with the powers and exposures of a small case.
struct Case {
    lit: Vec<(Optics, f64, Vec<f64>, f64)>,
    drives: Vec<f64>,
    pupils: Vec<Pupil>,
    /// Target images (color, pupil).
    targets: Vec<Vec<Vec<f32>>>,
}

const FRAMES: usize = 3;
const SIZE: [usize; 2] = [12, 16];

impl Case {
    fn new() -> Self {
        let display = display(SIZE[0], SIZE[1]);
        let noise =
            |seed: u64| random_phases(SIZE[0] * SIZE[1], seed).into_iter().map(|p| 0.5 + p / 7.0).collect::<Vec<f32>>();
        let powers = [[0.4, 1.9, 0.7], [1.0, 0.2, 1.8], [1.5, 1.5, 0.0]];
        let slopes = display.slopes(&ALL);
        let lit = ALL.iter().zip(slopes).zip(powers).zip([0.7, 0.9, 0.6]);
        let lit =
            lit.map(|(((c, slope), powers), s)| (display.optics(*c).unwrap(), slope, powers.to_vec(), s)).collect();
        let pupils = vec![Pupil::from_mm([2.0, -1.0, 8.0, 3.0]), Pupil::from_mm([-3.0, 1.0, 5.0, -1.0])];
        // These values are away from the wrap, which would disturb a difference.
        let drives = random_phases(FRAMES * SIZE[0] * SIZE[1], 5).iter().map(|p| 3.15 + 0.99 * f64::from(*p)).collect();
        Self { lit, drives, pupils, targets: (0..3).map(|c| (0..2).map(|i| noise(20 + 2 * c + i)).collect()).collect() }
    }

    fn phases(&self, color: usize) -> Vec<f64> {
        self.drives.iter().map(|d| self.lit[color].1 * d).collect()
    }

    /// Returns the loss of OPTICS 13.
    fn loss(&self) -> f64 {
        let mut loss = 0.0;
        for (color, (optics, _, powers, exposure)) in self.lit.iter().enumerate() {
            let phases = self.phases(color);
            for (pupil, target) in self.pupils.iter().zip(&self.targets[color]) {
                let light = light_of(&phases, optics, pupil);
                let gain = exposure / optics.share(pupil.diameter) / FRAMES as f64;
                let seen = |i: usize| gain * light.iter().zip(powers).map(|(l, p)| p * l[i]).sum::<f64>();
                let squares = (0..target.len()).map(|i| (seen(i) - f64::from(target[i])).powi(2));
                loss += squares.sum::<f64>() / (target.len() * self.pupils.len() * self.lit.len()) as f64;
            }
        }
        loss
    }

    /// Returns its derivative with respect to the drive values and, per color, the powers, as in OPTICS 13, in float64.
    fn gradient(&self) -> (Vec<f64>, Vec<Vec<f64>>) {
        let mut of_drives = vec![0.0; self.drives.len()];
        let mut of_powers = vec![vec![0.0; FRAMES]; self.lit.len()];
        for (color, (optics, slope, powers, exposure)) in self.lit.iter().enumerate() {
            let phases = self.phases(color);
            for (pupil, target) in self.pupils.iter().zip(&self.targets[color]) {
                let (count, kernel) = (target.len(), kernel_of(optics, pupil));
                let fields = fields_of(&phases, optics, pupil);
                let gain = exposure / optics.share(pupil.diameter) / FRAMES as f64;
                let seen = |i: usize| gain * fields.iter().zip(powers).map(|(v, p)| p * v[i].norm_sqr()).sum::<f64>();
                let scale = 2.0 * gain / (count * self.pupils.len() * self.lit.len()) as f64;
                let error: Vec<f64> = (0..count).map(|i| scale * (seen(i) - f64::from(target[i]))).collect();
                for (f, field) in fields.iter().enumerate() {
                    of_powers[color][f] += error.iter().zip(field).map(|(e, v)| e * v.norm_sqr()).sum::<f64>();
                    let weighted: Vec<Complex64> = error.iter().zip(field).map(|(e, v)| v * (e * powers[f])).collect();
                    let back = filtered(&weighted, kernel.iter().map(|k| k.conj()), optics);
                    let (own, at) = (&phases[f * count..][..count], f * count);
                    for (i, (g, phase)) in back.iter().zip(own).enumerate() {
                        of_drives[at + i] += slope * 2.0 * (g * Complex64::from_polar(1.0, -phase)).im;
                    }
                }
            }
        }
        (of_drives, of_powers)
    }

    fn planner(&self, color: usize) -> Planner {
        let (optics, _, powers, _) = &self.lit[color];
        Planner { powers: powers.clone().into(), ..Planner::new(*optics, FRAMES, WindowFactor::Full) }
    }

    /// Requests the gradient of one color, with these targets instead of target images.
    fn ask(&self, color: usize, engine: &mut CpuEngine, change: &mut [f32]) -> (f64, Turns) {
        let planner = self.planner(color);
        let comparison =
            Comparison { mode: compare::INTENSITY, exposure: self.lit[color].3, batch: 2, ..Comparison::default() };
        let passes: Vec<_> = self.pupils.iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
        let mut step = planner.adam_step(passes, usize::MAX, 1, 0.1);
        step.list.retain(|d| !matches!(d.kernel, crate::plan::Kernel::Photograph | crate::plan::Kernel::Resample));
        engine.load(&planner.shape(Purpose::Adam), None).unwrap();
        engine
            .write(Buffer::Phases, &self.phases(color).iter().map(|p| phase_of(*p, 1.0)).collect::<Vec<_>>())
            .unwrap();
        for (slot, target) in self.targets[color].iter().enumerate() {
            engine.write(Buffer::Target(slot), target).unwrap();
        }
        (ask(engine, &step, std::slice::from_ref(&(0..step.list.len())), change).unwrap(), Turns::of(&step))
    }
}

/// Views agree for powers and dispersion, with an error power below 1e-10 of the signal.
#[test]
fn views_agree_with_float64() {
    let case = Case::new();
    for color in 0..3 {
        let (planner, mut engine) = (case.planner(color), CpuEngine::new());
        let (optics, _, powers, _) = &case.lit[color];
        engine.load(&planner.shape(Purpose::View), None).unwrap();
        engine
            .write(Buffer::Phases, &case.phases(color).iter().map(|p| phase_of(*p, 1.0)).collect::<Vec<_>>())
            .unwrap();
        for pupil in &case.pupils {
            let seen = crate::evaluate::views(&mut engine, &planner, &[*pupil]).unwrap().remove(0);
            let light = light_of(&case.phases(color), optics, pupil);
            let gain = 1.0 / optics.share(pupil.diameter) / FRAMES as f64;
            let exact: Vec<f64> =
                (0..seen.len()).map(|i| gain * light.iter().zip(powers).map(|(l, p)| p * l[i]).sum::<f64>()).collect();
            let error = seen.iter().zip(&exact).map(|(a, b)| (f64::from(*a) - b).powi(2)).sum::<f64>();
            let error = error / exact.iter().map(|b| b * b).sum::<f64>();
            assert!(error < 1e-10, "color {color}: error power {error:.1e} of signal");
        }
    }
}

/// The loss and its derivatives with respect to the drive values and the powers agree with central differences of the
/// float64 loss.
#[test]
fn gradients_are_derivatives() {
    let case = Case::new();
    let mut drives = Drives::new(&case.drives.iter().map(|d| phase_of(*d, 1.0)).collect::<Vec<_>>(), SIZE);
    let (mut engine, mut loss) = (CpuEngine::new(), 0.0);
    let mut change = vec![0.0; 2 * FRAMES * SIZE[0] * SIZE[1]];
    for color in 0..3 {
        let (of_color, turns) = case.ask(color, &mut engine, &mut change);
        loss += of_color / 3.0;
        drives.ask(case.lit[color].1, &drives.phases(case.lit[color].1), &change, &[0.0; FRAMES], &turns);
    }
    assert!((loss / case.loss() - 1.0).abs() < 1e-5, "{loss} {}", case.loss());
    // The equations are compared as far as central differences of float64 allow, and the float32 engine is compared
    // with the equations.
    let (of_drives, of_powers) = case.gradient();
    for seed in 9..13 {
        let direction: Vec<f64> = random_phases(case.drives.len(), seed).into_iter().map(f64::from).collect();
        let moved = |by: f64| {
            let drives = case.drives.iter().zip(&direction).map(|(d, e)| d + by * e).collect();
            Case { drives, ..Case::new() }.loss()
        };
        let numeric = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        let exact = of_drives.iter().zip(&direction).map(|(g, e)| g * e).sum::<f64>();
        assert!((numeric / exact - 1.0).abs() < 1e-6, "in the drives: {numeric} {exact}");
    }
    for (color, (of_color, f)) in of_powers.iter().zip([0, 1, 2]).enumerate() {
        let moved = |by: f64| {
            let mut moved = Case::new();
            moved.lit[color].2[f] += by;
            moved.loss()
        };
        let (numeric, exact) = ((moved(1e-4) - moved(-1e-4)) / 2e-4, of_color[f]);
        assert!((numeric / exact - 1.0).abs() < 1e-6, "in power {f} of color {color}: {numeric} {exact}");
    }
    let asked = drives.asked.iter().map(|g| 2.0 / 3.0 * f64::from(*g));
    let error = asked.zip(&of_drives).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let error = error / of_drives.iter().map(|b| b * b).sum::<f64>();
    assert!(error < 1e-10, "the engine's gradient: error power {error:.1e}");
}

/// Fits of powers have the loss and the derivative that the engine's images give.
#[test]
fn fits_of_powers_are_of_the_same_loss() {
    let display = display(24, 32);
    let field = field_of("builtin:still-life", &display);
    let problems = problems(&field, &display);
    let settings = Settings { frames: 3, ..Settings::default() };
    let mut engine = CpuEngine::new();
    let joint =
        JointProblem { colors: &problems, slopes: &display.slopes(&ALL), exposures: Some(&[0.3; 3]), powers: None };
    let lit: Lit<'_> =
        prepare(&joint, 1, &problems[1], &settings, Instant::now(), &mut engine, &mut |_| Flow::Continue).unwrap();
    engine.write(Buffer::Phases, &random_phases(3 * 24 * 32, 4)).unwrap();
    let viewpoints = [[1.0, 0.0, 6.0, 1.0], [-3.0, 2.0, 9.0, 0.0]].map(|mm| Viewpoint::Pupil(Pupil::from_mm(mm)));
    let fit = fit_of(&mut engine, &lit, &viewpoints).unwrap();
    let mut loss_at = |powers: &[f64]| {
        let planner = Planner { powers: powers.to_vec().into(), ..lit.ready.planner.clone() };
        let comparison =
            Comparison { mode: compare::INTENSITY, exposure: lit.exposure, batch: 2, ..Comparison::default() };
        let passes: Vec<_> = viewpoints.iter().map(|v| planner.viewpoint(v, &comparison)).collect();
        let step = planner.adam_step(passes, usize::MAX, 1, 0.1);
        let losses = engine.run_part(&step, 0..step.before_update()).unwrap();
        step.mean_loss(&losses)
    };
    let powers = [0.5, 1.7, 0.8];
    let loss = loss_at(&powers);
    assert!((fit.loss(&powers) / loss - 1.0).abs() < 1e-4, "{} {loss}", fit.loss(&powers));
    for (f, slope) in fit.gradient(&powers).into_iter().enumerate() {
        let mut moved = |by: f64| {
            let mut powers = powers;
            powers[f] += by;
            loss_at(&powers)
        };
        let numeric = (moved(0.1) - moved(-0.1)) / 0.2;
        assert!((numeric / slope - 1.0).abs() < 1e-2, "power {f}: {numeric} {slope}");
    }
}

/// Powers of C and 0 are one color after another. The loss is then the mean of the separate losses.
#[test]
fn one_colour_after_another_is_a_case_of_it() {
    let mut case = Case::new();
    for (lit, powers) in case.lit.iter_mut().zip(powers_in_sequence(3, FRAMES)) {
        lit.2 = powers;
    }
    let mut apart = 0.0;
    for (color, (optics, _, _, exposure)) in case.lit.iter().enumerate() {
        let own = case.phases(color)[color * SIZE[0] * SIZE[1]..][..SIZE[0] * SIZE[1]].to_vec();
        for (pupil, target) in case.pupils.iter().zip(&case.targets[color]) {
            let light = light_of(&own, optics, pupil);
            let gain = exposure / optics.share(pupil.diameter);
            let squares = target.iter().zip(&light[0]).map(|(t, l)| (gain * l - f64::from(*t)).powi(2));
            apart += squares.sum::<f64>() / (target.len() * 6) as f64;
        }
    }
    assert!((case.loss() - apart).abs() < 1e-12, "{} {apart}", case.loss());
}

#[test]
fn solves_are_repeated_bit_for_bit_and_powers_stay_within() {
    let display = display(32, 48);
    let field = field_of("builtin:still-life", &display);
    let problems = problems(&field, &display);
    let slopes = display.slopes(&ALL);
    let problem = JointProblem { colors: &problems, slopes: &slopes, exposures: None, powers: None };
    for (brightness, most) in [(1.0, 3.0), (2.0, 1.5), (3.0, 1.0)] {
        let joint = Some(Joint { brightness });
        let settings = Settings { frames: 4, steps: 12, joint, diameter: [3e-3, 18e-3], ..Settings::default() };
        let go = || solve_joint(&problem, &settings, None, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
        let (one, two) = (go(), go());
        assert_eq!(one.powers, two.powers);
        for (c, (a, b)) in one.colors.iter().zip(&two.colors).enumerate() {
            assert!(a.phases == b.phases && a.steps == 12);
            let mean = one.powers[c].iter().sum::<f64>() / 4.0;
            assert!((mean - 1.0).abs() < 1e-9 && one.powers[c].iter().all(|p| (0.0..=most + 1e-6).contains(p)));
        }
        // The image became better than noise.
        assert!(
            one.colors.iter().all(|s| s.validation.mean() > 15.0),
            "{:?}",
            one.colors.iter().map(|s| s.validation.mean()).collect::<Vec<_>>()
        );
    }
}

/// Light that no phase turns falls on one place of the eyebox. Steps leave less than a third of the amount that even
/// drive values have at wavelengths other than their own.
#[test]
fn undiffracted_light_goes() {
    let display = display(32, 48);
    let field = field_of("builtin:still-life", &display);
    let problems = problems(&field, &display);
    let slopes = display.slopes(&ALL);
    let problem = JointProblem { colors: &problems, slopes: &slopes, exposures: None, powers: None };
    let joint = Some(Joint { brightness: 3.0 });
    let settings = Settings { frames: 3, steps: 20, joint, diameter: [3e-3, 18e-3], ..Settings::default() };
    let solved = solve_joint(&problem, &settings, None, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
    let share = |phases: &[f32]| {
        let mean =
            phases.iter().map(|p| Complex64::from_polar(1.0, f64::from(*p))).sum::<Complex64>() / phases.len() as f64;
        mean.norm_sqr()
    };
    for (color, solution) in solved.colors.iter().enumerate().skip(1) {
        let even = (0..1000).map(|i| phase_of(TAU * f64::from(i) / 1000.0, slopes[color])).collect::<Vec<_>>();
        let left = solution.phases.chunks_exact(32 * 48).map(share).sum::<f64>() / 3.0;
        assert!(share(&even) > 0.03 && left < share(&even) / 3.0, "color {color}: {left} of {}", share(&even));
    }
}

/// Returns the refused setting and its value. The sentence must be one line.
pub(super) fn setting(error: SolveError) -> (&'static str, String) {
    assert!(!error.to_string().contains('\n'), "{error}");
    match error {
        SolveError::Setting { what, value, .. } => (what, value),
        other => panic!("{other}"),
    }
}

#[test]
fn what_cannot_be_is_refused_in_a_line() {
    let display = display(24, 32);
    let field = field_of("builtin:plane", &display);
    let problems = problems(&field, &display);
    let slopes = display.slopes(&ALL);
    let refused = |settings: Settings, slopes: &[f64], powers: Option<&[Vec<f64>]>| {
        let problem = JointProblem { colors: &problems, slopes, exposures: None, powers };
        let settings = Settings { frames: 2, steps: 1, joint: settings.joint.or(Some(Joint::default())), ..settings };
        setting(solve_joint(&problem, &settings, None, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap_err())
    };
    let plain = Settings::default;
    let dark = vec![vec![-1.0, 3.0], vec![1.0; 2], vec![1.0; 2]];
    for brightness in [4.0, 0.5] {
        let (_, value) = refused(Settings { joint: Some(Joint { brightness }), ..plain() }, &slopes, None);
        assert_eq!(value, brightness.to_string());
    }
    assert_eq!(refused(Settings { method: Method::Dpac, ..plain() }, &slopes, None).1, Method::Dpac.name());
    assert_eq!(refused(plain(), &[1.0, -1.0, 1.5], None).0, check::DISPERSION);
    assert_eq!(refused(plain(), &slopes, Some(&dark)).0, check::POWERS);
    let lit = Display {
        source: Display::from_toml(&format!("{}\n[source.all]\nkind = \"led\"\n", display.to_toml()), "d")
            .unwrap()
            .source,
        ..display.clone()
    };
    let problems: Vec<Problem> = ALL.map(|c| Problem::new(&field, c, &lit, Padding::default()).unwrap()).into();
    let problem = JointProblem { colors: &problems, slopes: &slopes, exposures: None, powers: None };
    let settings = Settings { frames: 2, steps: 1, joint: Some(Joint::default()), ..plain() };
    let error = solve_joint(&problem, &settings, None, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap_err();
    assert_eq!(setting(error).0, check::SOURCE);
}
