//! A static mask with finer pixels in front of the SLM (OPTICS 12). The tests compare images through it, and the
//! gradient, with float64.

use eyebox::low_level::evaluate;
use eyebox::low_level::files::write_npy;
use eyebox::low_level::optics::{Color, Display, Optics, Pupil, WindowFactor, transfer};
use eyebox::low_level::plan::{Comparison, ModelTables, Planner, Purpose};
use eyebox_kernels::{Complex64, compare};
use eyebox_tests::gradient::{assert_derivative, gradient_of, intensity_loss, random_targets, unwrapped_phases};
use eyebox_tests::{error_power, fft2, loaded, noise, phases, step_with_targets};
use std::f64::consts::TAU;

/// Other effects of the display on its light.
const BENCH: &str = "[model.green]\nfill = 0.8\nlevel = 1.04\nbend = [0.1, -0.05]\nsource = [0.1, -0.05, -0.3, 0.08, -0.2]\n\
    undiffracted = [0.15, 0.1, 0.4, -0.3, 0.2]\niris = [0.2, -0.3, 1.02]\n";

/// The equations in float64.
struct Masked {
    display: Display,
    /// Turns of the light by the mask, row by row.
    turns: Vec<f64>,
    factor: usize,
    distance: f64,
    frames: usize,
}

impl Masked {
    fn new(size: [usize; 2], factor: usize, distance_mm: f64, bench: &str, frames: usize) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let fine = size.map(|n| n * factor);
        let turns: Vec<f64> =
            noise(fine[0] * fine[1], 77).iter().map(|x| ((x + 1.0) * 2047.0).floor() / 4096.0).collect();
        let radians: Vec<f32> = turns.iter().map(|t| (t * TAU) as f32).collect();
        write_npy(&dir.path().join("mask.npy"), &fine, &radians).unwrap();
        let text = format!(
            "resolution = [{}, {}]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = {{ green = 520 }}\n\
             [mask]\nfactor = {factor}\nfile = \"mask.npy\"\ndistance_mm = {distance_mm}\nwavelength_nm = 650\n{bench}",
            size[0], size[1]
        );
        let display = Display::from_toml(&text, dir.path().join("b.toml").to_str().unwrap()).unwrap();
        // The mask is designed for 650 nm, and its path is the same for all colors.
        let turns = turns.into_iter().map(|t| t * 650.0 / 520.0).collect();
        Self { display, turns, factor, distance: distance_mm * 1e-3, frames }
    }

    fn planner(&self) -> Planner {
        let plain = Planner::new(self.display.optics(Color::Green).unwrap(), self.frames, WindowFactor::Full);
        Planner { model: ModelTables::of(&self.display, Color::Green, plain.slm, plain.grid), ..plain }
    }

    /// Returns the optics with the mask's pixels.
    fn fine(&self) -> Optics {
        let k = self.factor;
        Optics::new(k * self.display.height, k * self.display.width, 8e-6 / k as f64, 520e-9, 0.4).unwrap()
    }

    /// Returns the intensity on the mask's pixels.
    fn view(&self, phases: &[f64], asked: &Pupil) -> Vec<f64> {
        let (model, o, k) = (self.display.model(Color::Green), self.fine(), self.factor);
        let (h, w, rows, columns) = (self.display.height, self.display.width, o.height, o.width);
        let (level, source, rest) =
            (model.level_map([h, w]), model.source_amplitude([h, w]), model.undiffracted_share([h, w]));
        let pupil = model.true_pupil(asked);
        let bin = |at: usize, n: usize| if at < n - n / 2 { at as i64 } else { at as i64 - n as i64 };
        let propagate = |field: &mut Vec<Complex64>, kernel: &dyn Fn(i64, i64) -> Complex64| {
            fft2(field, rows, columns, false);
            for (i, z) in field.iter_mut().enumerate() {
                *z *= kernel(bin(i / columns, rows), bin(i % columns, columns));
            }
            fft2(field, rows, columns, true);
        };
        // A pixel of the SLM covers its middle. This is its share of each mask pixel.
        let fill = if model.fill > 0.0 { model.fill } else { 1.0 };
        let cover = |i: usize| {
            let edge = |at: f64| at.clamp(0.5 - fill / 2.0, 0.5 + fill / 2.0);
            k as f64 / fill * (edge((i + 1) as f64 / k as f64) - edge(i as f64 / k as f64))
        };
        let sinc = |x: f64| if x == 0.0 { 1.0 } else { (TAU / 2.0 * x).sin() / (TAU / 2.0 * x) };
        let everything = Pupil { x: 0.0, y: 0.0, diameter: 3.0 * o.eyebox(), depth: self.distance };
        let share = o.share(pupil.diameter) * self.frames as f64;
        let mut seen = vec![0.0; rows * columns];
        for phases in phases.chunks_exact(h * w) {
            let at = |i: usize| {
                let (y, x) = (i / columns, i % columns);
                let pixel = y / k * w + x / k;
                let wave = model.look_up(phases[pixel].rem_euclid(TAU), level[pixel]).0;
                let u = source[pixel] * (model.modulated_share() * Complex64::cis(wave) + rest[pixel]);
                u * cover(y % k) * cover(x % k)
            };
            let mut field: Vec<Complex64> = (0..rows * columns).map(at).collect();
            if self.distance > 0.0 {
                propagate(&mut field, &|ky, kx| {
                    let (re, im) = transfer(&o, &everything, ky, kx);
                    Complex64::new(re, im)
                });
            }
            field.iter_mut().zip(&self.turns).for_each(|(z, turn)| *z *= Complex64::cis(TAU * turn));
            let left = Pupil { depth: pupil.depth - self.distance, ..pupil };
            propagate(&mut field, &|ky, kx| {
                let (re, im) = transfer(&o, &left, ky, kx);
                let full = if model.fill > 0.0 {
                    sinc(ky as f64 / rows as f64) * sinc(kx as f64 / columns as f64)
                } else {
                    1.0
                };
                Complex64::new(re, im) * full
            });
            seen.iter_mut().zip(field).for_each(|(s, v)| *s += v.norm_sqr() / share);
        }
        seen
    }

    /// Returns the mean over the mask pixels of each pixel of the SLM.
    fn averaged(&self, seen: &[f64]) -> Vec<f64> {
        let (k, h, w) = (self.factor, self.display.height, self.display.width);
        let own = |i: usize| {
            let places = (0..k * k).map(|j| (i / w * k + j / k) * k * w + i % w * k + j % k);
            places.map(|at| seen[at]).sum::<f64>() / (k * k) as f64
        };
        (0..h * w).map(own).collect()
    }
}

fn cases() -> Vec<Masked> {
    vec![
        Masked::new([30, 41], 2, 0.0, "", 3),
        Masked::new([24, 16], 3, 0.0, BENCH, 2),
        Masked::new([7, 13], 4, 2.5, "", 1),
        Masked::new([24, 32], 2, 1.5, BENCH, 2),
        Masked::new([20, 20], 1, 0.7, "", 1),
    ]
}

/// The comparison covers sizes that are not square, a mask at the SLM and behind it, and pupils inside and outside the
/// SLM's own eyebox.
#[test]
fn views_through_a_mask_agree_with_float64() {
    for masked in cases() {
        let (planner, k) = (masked.planner(), masked.factor);
        let (exact, rounded) = phases(masked.frames * masked.display.height * masked.display.width, 1);
        let mut engine = loaded(&planner, Purpose::View, &rounded);
        for mm in [[1.0, -2.0, 6.0, 3.0], [-9.0 * k as f64, 4.0, 9.0, -15.0]] {
            let pupil = Pupil::from_mm(mm);
            let seen = evaluate::views(&mut engine, &planner, &[pupil]).unwrap().remove(0);
            let error = error_power(&seen, &masked.averaged(&masked.view(&exact, &pupil)));
            let distance = masked.distance;
            assert!(error < 1e-10, "factor {k}, {distance} m, {mm:?}: error power {error:.1e} of signal");
        }
    }
}

/// Adam's first moment after one step is a tenth of the gradient. Central differences of the float64 loss agree with
/// it.
#[test]
fn the_gradient_through_a_mask_is_the_derivative() {
    for masked in cases() {
        let (planner, o, k) = (masked.planner(), masked.fine(), masked.factor as f64);
        let pixels = masked.display.height * masked.display.width;
        let pupils = [Pupil::from_mm([3.0, -2.0, 9.0, 4.0]), Pupil::from_mm([-9.0 * k, 1.0, 6.0, -1.0])];
        let (exact, rounded) = unwrapped_phases(masked.frames * pixels, 4);
        let targets = random_targets(2, o.height * o.width);
        let comparison = Comparison { mode: compare::INTENSITY, exposure: 0.7, batch: 2, ..Comparison::default() };
        let mut engine = loaded(&planner, Purpose::Adam, &rounded);
        let passes = pupils.iter().map(|p| planner.pupil_pass(p, &comparison)).collect();
        step_with_targets(&planner, &mut engine, passes, &targets, true);
        let want = |phases: &[f64]| intensity_loss(&targets, 0.7, |i| masked.view(phases, &pupils[i]));
        assert_derivative(&gradient_of(&mut engine), &exact, 1, 2e-5, &format!("factor {k}"), want);
    }
}
