//! Errors of propagation, of transforms, and of the complete computation from phases to the image that the eye sees.

use crate::errors::Errors;
use crate::reference::{error, error_of, fft2, kernel, noise, parts, view};
use crate::{Engines, Failure};
use eyebox::low_level::engine::vulkan::Transforms;
use eyebox::low_level::engine::{Buffer, Dispatch, Kernel, Storage};
use eyebox::low_level::evaluate;
use eyebox::low_level::gpu::{Gpu, Options};
use eyebox::low_level::optics::{Optics, Pupil, WindowFactor};
use eyebox::low_level::plan::{Comparison, Planner, Purpose};
use eyebox_kernels::Complex32;
use eyebox_kernels::fft::{Columns, Direction, Plans};
use eyebox_kernels::half;
use rustfft::num_complex::Complex64;
use std::f64::consts::{PI, TAU};

const DEPTHS: [f64; 8] = [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0];

/// Returns a depth in a unit that suits it.
fn metres(depth: f64) -> String {
    match depth {
        d if d < 9.9e-4 => format!("{:.0} um", d * 1e6),
        d if d < 0.99 => format!("{:.0} mm", d * 1e3),
        d => format!("{d:.0} m"),
    }
}

fn names(sizes: &[usize]) -> Vec<(f64, String)> {
    sizes.iter().map(|n| (*n as f64, n.to_string())).collect()
}

fn sizes(largest: usize) -> Vec<usize> {
    (6..).map(|k| 1 << k).take_while(|n| *n <= largest).collect()
}

/// Returns a pupil as wide as the eyebox.
fn everything(optics: &Optics, depth: f64) -> Pupil {
    Pupil { x: 0.0, y: 0.0, diameter: optics.eyebox(), depth }
}

/// Measures the propagation kernel over depth, and the same kernel in plain float32.
pub fn transfer(engines: &mut Engines, _: usize) -> Result<Errors, Failure> {
    let mut plot = Errors::new("Propagation kernel, 512 x 512 bins", "depth", DEPTHS.map(|d| (d, metres(d))));
    let optics = Optics::new(512, 512, 8e-6, 520e-9, 0.4)?;
    let planner = Planner::new(optics, 1, WindowFactor::Full);
    for depth in DEPTHS {
        let pupil = everything(&optics, depth);
        let exact = kernel(&optics, &pupil);
        let pupil_pass = planner.pupil_pass(&pupil, &Comparison::default());
        let window = pupil_pass.window;
        // Engines store the kernel in the order of the window.
        let order = |j: usize, k: usize| {
            let at = |first: i64, i: usize, n: usize| (first + i as i64).rem_euclid(n as i64) as usize;
            at(window.y0, j, 512) * 512 + at(window.x0, k, 512)
        };
        let in_order: Vec<usize> =
            (0..512).flat_map(|j| (0..512).map(move |k| (j, k))).map(|(j, k)| order(j, k)).collect();
        let want: Vec<Complex64> = in_order.iter().map(|i| exact[*i]).collect();
        let want = parts(&want);
        let mut step = planner.view_step(vec![pupil_pass]);
        step.list = vec![Dispatch { kernel: Kernel::Transfer, pupil_passes: 0..1 }];
        for (name, engine) in engines.iter_mut() {
            engine.load(&planner.shape(Purpose::View), None)?;
            engine.run(&step)?;
            let got = engine.read(Buffer::Transfer(0))?;
            plot.add(name, false, depth, error_of(&got, &want));
            if *name == "CPU" {
                let halves: Vec<f32> = got.iter().map(|v| half::rounded(*v)).collect();
                plot.add("if it were halves", true, depth, error_of(&halves, &want));
            }
        }
        // In float32, one form is the formula as printed, and the other has its difference rewritten.
        for (name, rewritten) in [("float32, as printed", false), ("float32, rewritten", true)] {
            let bin = |k: usize| if k < 256 { k as f32 } else { k as f32 - 512.0 };
            let slope = ((optics.wavelength / (512.0 * optics.pitch)).powi(2)) as f32;
            let plain = |i: usize| {
                let a = slope * (bin(i / 512).powi(2) + bin(i % 512).powi(2));
                let root = (1.0 - a).sqrt();
                let part = if rewritten { -a / (1.0 + root) } else { root - 1.0 };
                let (sin, cos) = (TAU as f32 * ((depth / optics.wavelength) as f32) * part).sin_cos();
                [f64::from(cos), f64::from(sin)]
            };
            let passes = |i: usize| exact[i].norm_sqr() > 0.0;
            let got = in_order.iter().flat_map(|i| if passes(*i) { plain(*i) } else { [0.0; 2] });
            plot.add(name, true, depth, error(got, want.iter().copied()));
        }
    }
    Ok(plot)
}

/// Measures transforms of a field of random phase over their size.
pub fn transforms(_: &mut Engines, largest: usize) -> Result<Errors, Failure> {
    let sizes = sizes(largest);
    let mut plot = Errors::new("Transform of a field of random phase, N x N", "N", names(&sizes));
    let mut device = Transforms::new(&Gpu::open(&Options { allow_cpu: true, ..Options::default() })?)?;
    let twin = Plans::default();
    for n in sizes {
        let scale = Storage::F16.field_scale(n * n);
        let mut want: Vec<Complex64> =
            noise(n * n, n as u64).iter().map(|x| Complex64::from_polar(scale, x * PI)).collect();
        let given: Vec<Complex32> = want.iter().map(|z| Complex32::new(z.re as f32, z.im as f32)).collect();
        want.iter_mut().zip(&given).for_each(|(w, g)| *w = Complex64::new(g.re.into(), g.im.into()));
        fft2(&mut want, n, n, false);
        let far = |got: &[Complex32]| {
            let numbers = got.iter().flat_map(|z| [f64::from(z.re), f64::from(z.im)]);
            error(numbers, want.iter().flat_map(|z| [z.re, z.im]))
        };
        for storage in Storage::ALL {
            let name = |on: &str| format!("{on}{}", if storage == Storage::F16 { ", halves" } else { "" });
            let mut data = given.clone();
            if storage == Storage::F16 {
                half::round(&mut data);
            }
            let store = if storage == Storage::F16 { half::round } else { |_: &mut [Complex32]| () };
            twin.fft(&mut data, n, n, Direction::Forward, Columns::all(n), store);
            plot.add(&name("CPU"), false, n as f64, far(&data));
            data.copy_from_slice(&given);
            device.store(storage);
            device.run(&mut data, (n, n), Direction::Forward, Columns::all(n), 0)?;
            plot.add(&name("Vulkan"), false, n as f64, far(&data));
        }
    }
    Ok(plot)
}

/// Measures the image on the retina over the size, at a depth of 15 mm. Also measures it at all depths for one size.
pub fn views(engines: &mut Engines, largest: usize) -> Result<Errors, Failure> {
    let sizes = sizes(largest.min(2048));
    let mut plot = Errors::new("Image of random phases through a 10 mm pupil, 15 mm deep, N x N", "N", names(&sizes));
    let mut depths = Errors::new("The same, 512 x 512", "depth", DEPTHS.map(|d| (d, metres(d))));
    for n in sizes {
        measure_view(engines, n, 15e-3, n as f64, &mut plot)?;
    }
    for depth in DEPTHS {
        measure_view(engines, 512, depth, depth, &mut depths)?;
    }
    println!("\n{}", depths.table());
    Ok(plot)
}

fn measure_view(engines: &mut Engines, n: usize, depth: f64, x: f64, plot: &mut Errors) -> Result<(), Failure> {
    let optics = Optics::new(n, n, 8e-6, 520e-9, 0.4)?;
    let phases: Vec<f32> = noise(n * n, 7).iter().map(|x| (x * PI) as f32).collect();
    let exact: Vec<f64> = phases.iter().map(|p| f64::from(*p)).collect();
    let pupil = Pupil { x: 2e-3, y: -1e-3, diameter: 10e-3, depth };
    let want = view(&optics, &exact, &pupil);
    for storage in Storage::ALL {
        let planner = Planner { storage, ..Planner::new(optics, 1, WindowFactor::Full) };
        for (name, engine) in engines.iter_mut() {
            engine.load(&planner.shape(Purpose::View), None)?;
            engine.write(Buffer::Phases, &phases)?;
            let seen = evaluate::views(engine.as_mut(), &planner, &[pupil])?;
            let name = format!("{name}{}", if storage == Storage::F16 { ", halves" } else { "" });
            plot.add(&name, false, x, error_of(&seen[0], &want));
        }
    }
    Ok(())
}
