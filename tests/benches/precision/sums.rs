//! Long sums of sub-frames to an image, of pupils to a change, of pixels to a loss, and of steps to Adam's state.

use crate::errors::Errors;
use crate::reference::{error, error_of, noise};
use crate::{Engines, Failure};
use eyebox::low_level::engine::{Buffer, Dispatch, Kernel, Step, Storage};
use eyebox::low_level::optics::{Optics, Pupil, WindowFactor};
use eyebox::low_level::plan::{Comparison, Planner, Purpose};
use eyebox_kernels::{Complex32, ZERO, adam, compare, half, modulate, pupil_adjoint};
use std::f64::consts::TAU;

fn powers(most: usize) -> Vec<usize> {
    (0..).map(|k| 1 << k).take_while(|n| *n <= most).collect()
}

fn marks(counts: &[usize]) -> Vec<(f64, String)> {
    counts.iter().map(|n| (*n as f64, n.to_string())).collect()
}

/// Returns the step with this kernel only.
fn only(mut step: Step, kernel: Kernel) -> Step {
    let pupil_passes = step.list.iter().find(|d| d.kernel == kernel).map_or(0..0, |d| d.pupil_passes.clone());
    step.list = vec![Dispatch { kernel, pupil_passes }];
    step
}

/// Measures sums of the intensities of sub-frames, as the kernel adds them and in other ways.
pub fn frames(engines: &mut Engines, _: usize) -> Result<Errors, Failure> {
    let counts = powers(64);
    let mut plot = Errors::new("Mean intensity of F sub-frames", "F", marks(&counts));
    let optics = Optics::new(128, 128, 8e-6, 520e-9, 0.4)?;
    let pupil = Pupil { x: 0.0, y: 0.0, diameter: 0.02, depth: 0.0 };
    for count in counts {
        for storage in Storage::ALL {
            let planner = Planner { storage, ..Planner::new(optics, count, WindowFactor::Full) };
            let step =
                only(planner.view_step(vec![planner.pupil_pass(&pupil, &Comparison::default())]), Kernel::Intensity);
            let values = step.pupil_passes[0].count();
            // The values have the size that fields have in halves.
            let field: Vec<f32> = noise(2 * count * values, 3).iter().map(|v| *v as f32 * 16.0).collect();
            let gain = f64::from(step.pupil_passes[0].intensity.gain);
            let power = |f: usize, i: usize| {
                let at = 2 * (f * values + i);
                f64::from(field[at]).powi(2) + f64::from(field[at + 1]).powi(2)
            };
            let want: Vec<f64> = (0..values).map(|i| (0..count).map(|f| gain * power(f, i)).sum()).collect();
            for (name, engine) in engines.iter_mut() {
                engine.load(&planner.shape(Purpose::View), None)?;
                engine.write(Buffer::Window(0), &field)?;
                engine.run(&step)?;
                let name = format!("{name}{}", if storage == Storage::F16 { ", halves" } else { "" });
                plot.add(&name, false, count as f64, error_of(&engine.read(Buffer::Image(0))?, &want));
            }
            if storage == Storage::F32 {
                let terms = |i: usize| -> Vec<f32> {
                    let z = |f: usize| Complex32::new(field[2 * (f * values + i)], field[2 * (f * values + i) + 1]);
                    (0..count).map(|f| gain as f32 * z(f).norm_sqr()).collect()
                };
                let by = |sum: fn(&[f32]) -> f32| {
                    error((0..values).map(|i| f64::from(sum(&terms(i)))), want.iter().copied())
                };
                plot.add("pairwise", true, count as f64, by(pairwise));
                plot.add("compensated", true, count as f64, by(compensated));
            }
        }
    }
    Ok(plot)
}

fn pairwise(terms: &[f32]) -> f32 {
    match terms {
        [] => 0.0,
        [one] => *one,
        _ => {
            let (a, b) = terms.split_at(terms.len() / 2);
            pairwise(a) + pairwise(b)
        }
    }
}

/// Returns the sum by Kahan's algorithm.
fn compensated(terms: &[f32]) -> f32 {
    let (mut sum, mut lost) = (0.0f32, 0.0f32);
    for term in terms {
        let next = term - lost;
        let total = sum + next;
        lost = (total - sum) - next;
        sum = total;
    }
    sum
}

/// Measures the sum of the changes of pupils that overlap, added one after the other. With halves, every addition is
/// rounded.
pub fn pupils(engines: &mut Engines, _: usize) -> Result<Errors, Failure> {
    let counts = powers(64);
    let mut plot = Errors::new("Change of the spectrum, added up over B pupils that all overlap", "B", marks(&counts));
    let optics = Optics::new(128, 128, 8e-6, 520e-9, 0.4)?;
    let pupil = Pupil { x: 0.0, y: 0.0, diameter: 0.02, depth: 0.0 };
    for count in counts {
        for storage in Storage::ALL {
            let planner = Planner { storage, ..Planner::new(optics, 1, WindowFactor::Full) };
            let pupil_pass = planner.pupil_pass(&pupil, &Comparison::default());
            let (values, scale) = (pupil_pass.count(), f64::from(pupil_pass.back.scale));
            let windows: Vec<Vec<f32>> = (0..count)
                .map(|b| noise(2 * values, 11 + b as u64).iter().map(|v| (v * 512.0) as f32).collect())
                .collect();
            let step =
                only(planner.project_step(vec![pupil_pass; count], usize::MAX, 1.0, 1.0, 0.0), Kernel::PupilAdjoint);
            // K is 1 inside the pupil, and the grid has the bins of the window.
            let ones: Vec<f32> = (0..2 * values).map(|i| if i % 2 == 0 { 1.0 } else { 0.0 }).collect();
            let mut want = vec![0.0f64; 2 * values];
            step.pupil_passes[0].back.pieces(&step.pupil_passes[0].spans, |grid, at, length| {
                for i in 0..2 * length {
                    let sum: f64 = windows.iter().map(|w| f64::from(w[2 * at + i])).sum();
                    want[2 * grid + i] = scale * sum;
                }
            });
            for (name, engine) in engines.iter_mut() {
                engine.load(&planner.shape(Purpose::Project), None)?;
                for (slot, window) in windows.iter().enumerate() {
                    engine.write(Buffer::Window(slot), window)?;
                    engine.write(Buffer::Transfer(slot), &ones)?;
                }
                engine.run(&step)?;
                let name = format!("{name}{}", if storage == Storage::F16 { ", halves" } else { "" });
                plot.add(&name, false, count as f64, error_of(&engine.read(Buffer::Change)?, &want));
            }
            if storage == Storage::F16 {
                // This sum is rounded once, at its end.
                let mut sum = vec![ZERO; values];
                let transfer = vec![Complex32::new(1.0, 0.0); values];
                for window in &windows {
                    let mut window: Vec<Complex32> = pairs_of(window);
                    half::round(&mut window);
                    let pupil_pass = &step.pupil_passes[0];
                    pupil_adjoint::pupil_adjoint(&pupil_pass.back, &window, &transfer, &pupil_pass.spans, &mut sum);
                }
                half::round(&mut sum);
                let got = sum.iter().flat_map(|z| [f64::from(z.re), f64::from(z.im)]);
                plot.add("halves, rounded once", true, count as f64, error(got, want.iter().copied()));
            }
        }
    }
    Ok(plot)
}

fn pairs_of(numbers: &[f32]) -> Vec<Complex32> {
    numbers.chunks_exact(2).map(|z| Complex32::new(z[0], z[1])).collect()
}

/// Measures sums over all pixels of an image, which are the loss and the light of a patch of the spectrum over the
/// sub-frames.
pub fn losses(engines: &mut Engines, largest: usize) -> Result<Errors, Failure> {
    let sizes: Vec<usize> = (6..).map(|k| 1 << k).take_while(|n| *n <= largest.min(2048)).collect();
    let mut plot = Errors::new("Sums over N x N values, squared relative error", "N", marks(&sizes));
    for n in sizes {
        let optics = Optics::new(n, n, 8e-6, 520e-9, 0.4)?;
        let planner = Planner::new(optics, 2, WindowFactor::Full);
        let pupil = Pupil { x: 0.0, y: 0.0, diameter: 0.02, depth: 0.0 };
        let comparison = Comparison { mode: compare::INTENSITY, ..Comparison::default() };
        let base = planner.project_step(vec![planner.pupil_pass(&pupil, &comparison)], usize::MAX, 1.0, 1.0, 0.0);
        let step = only(base.clone(), Kernel::Compare);
        let image: Vec<f32> = noise(n * n, 5).iter().map(|v| (v + 1.0) as f32).collect();
        let target: Vec<f32> = noise(n * n, 6).iter().map(|v| (v + 1.0) as f32).collect();
        let pairs = || image.iter().zip(&target);
        let want: f64 = pairs().map(|(i, t)| (f64::from(*i) - f64::from(*t)).powi(2)).sum();
        let far = |got: f64| (got / want - 1.0).powi(2);
        let even = planner.with_equalised_eyebox(base, optics.eyebox(), 1, 0.5);
        let light = only(even, Kernel::Energy);
        let field: Vec<f32> = noise(4 * n * n, 8).iter().map(|v| *v as f32).collect();
        let whole: f64 = field.iter().map(|v| f64::from(*v).powi(2)).sum();
        for (name, engine) in engines.iter_mut() {
            engine.load(&planner.shape(Purpose::Project), None)?;
            engine.write(Buffer::Image(0), &image)?;
            engine.write(Buffer::Target(0), &target)?;
            let loss = engine.run(&step)?[0];
            plot.add(&format!("{name}, loss"), false, n as f64, far(loss));
            engine.load(&planner.shape(Purpose::Project), None)?;
            engine.write(Buffer::Field, &field)?;
            engine.run(&light)?;
            let got = f64::from(engine.read(Buffer::Energy)?[0]);
            plot.add(&format!("{name}, light"), false, n as f64, (got / whole - 1.0).powi(2));
        }
        let plain: f32 = pairs().map(|(i, t)| (i - t) * (i - t)).fold(0.0, |sum, v| sum + v);
        plot.add("one float32 sum", true, n as f64, far(f64::from(plain)));
    }
    Ok(plot)
}

/// Measures the phases and moments of Adam over its steps. The gradients are noise around a mean that differs from
/// pixel to pixel.
pub fn adam(_: &mut Engines, _: usize) -> Result<Errors, Failure> {
    let steps: Vec<usize> = (0..=8).map(|k| 1 << (2 * k)).collect();
    let mut plot = Errors::new("Adam after so many steps", "steps", marks(&steps));
    const PIXELS: usize = 256;
    let place =
        modulate::Args { height: 1, width: PIXELS as u32, grid_height: 1, grid_width: PIXELS as u32, top: 0, left: 0 };
    let zeros = vec![0.0f32; PIXELS];
    let mean = noise(PIXELS, 21);
    let start = noise(PIXELS, 22);
    for halves in [false, true] {
        let name = |what: &str| format!("{what}{}", if halves { ", halves" } else { "" });
        let (mut phases, mut first, mut second) =
            (start.iter().map(|p| *p as f32).collect::<Vec<_>>(), zeros.clone(), zeros.clone());
        let mut exact: Vec<[f64; 3]> = phases.iter().map(|p| [f64::from(*p), 0.0, 0.0]).collect();
        for t in 1..=*steps.last().unwrap_or(&1) {
            let correct = |beta: f64| 1.0 / (1.0 - beta.powi(t as i32));
            // The rate and the decays have the values of float32, so that only the errors of the steps count.
            let [rate, beta1, beta2] = [0.1f32, 0.9, 0.999].map(f64::from);
            let epsilon = 1e-11;
            let args = adam::Args {
                place,
                rate: rate as f32,
                beta1: beta1 as f32,
                beta2: beta2 as f32,
                correct1: correct(beta1) as f32,
                correct2: correct(beta2) as f32,
                epsilon: epsilon as f32,
            };
            // If the shown phases are zero, the gradient is twice the imaginary part.
            let noise = noise(PIXELS, 1000 + t as u64);
            let gradient: Vec<f64> = mean.iter().zip(&noise).map(|(m, n)| 0.2 * m + n).collect();
            let mut change: Vec<Complex32> = gradient.iter().map(|g| Complex32::new(0.0, 0.5 * *g as f32)).collect();
            for (state, change) in exact.iter_mut().zip(&change) {
                let g = 2.0 * f64::from(change.im);
                let [phase, m, v] = *state;
                let (m, v) = (beta1 * m + (1.0 - beta1) * g, beta2 * v + (1.0 - beta2) * g * g);
                let turn = rate * (m * correct(beta1)) / ((v * correct(beta2)).sqrt() + epsilon);
                *state = [phase - turn, m, v];
            }
            if halves {
                half::round(&mut change);
            }
            adam::adam(&args, &change, Some(&zeros), &mut phases, &mut first, &mut second);
            if steps.contains(&t) {
                // This is the error of the field that the phases make.
                let off = phases.iter().zip(&exact).map(|(p, e)| {
                    let off = f64::from(*p) - e[0];
                    off - TAU * (off / TAU).round()
                });
                let power = off.map(|o| o * o).sum::<f64>() / PIXELS as f64;
                plot.add(&name("phases"), false, t as f64, power);
                if !halves {
                    plot.add(
                        &name("first moment"),
                        false,
                        t as f64,
                        error_of(&first, &exact.iter().map(|e| e[1]).collect::<Vec<_>>()),
                    );
                    plot.add(
                        &name("second moment"),
                        false,
                        t as f64,
                        error_of(&second, &exact.iter().map(|e| e[2]).collect::<Vec<_>>()),
                    );
                }
            }
        }
    }
    Ok(plot)
}
