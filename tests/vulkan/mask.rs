//! A static mask with finer pixels on the device (OPTICS 12). The tests compare its kernels with their CPU twins, and
//! whole steps.

use super::steps::{assert_close, assert_same_views, solve, steps};
use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::engine::{Kernel, Purpose, Storage};
use eyebox::low_level::optics::{Color, Display, Padding, Pupil, WindowFactor};
use eyebox::low_level::plan::{ModelTables, Planner, ViewLayout};
use eyebox::low_level::scene::{Pyramid, ViewGrid};
use eyebox_kernels::compare::{AMPLITUDE, INTENSITY, PROJECTION};
use eyebox_tests::both::{Case, Noise, assert_silent, compare, vulkan};
use eyebox_tests::half_roundings;
use std::sync::Arc;

const BENCH: &str = "[model.green]\nfill = 0.8\nlevel = 1.04\nsource = [0.1, -0.05, -0.3, 0.08, -0.2]\n\
    undiffracted = [0.15, 0.1, 0.4, -0.3, 0.2]\ncrosstalk = [[1.2, 2.03], [1.2, 2.03], [1.2, 2.03], [1.2, 2.03]]\n";

/// Returns a case behind a mask, with pupils inside and outside the SLM's own eyebox.
fn masked(size: [usize; 2], padding: usize, factor: usize, distance_mm: f64, bench: &str, frames: usize) -> Case {
    let text = format!(
        "resolution = [{}, {}]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = {{ green = 520 }}\n\
         [mask]\nfactor = {factor}\nseed = 5\ndistance_mm = {distance_mm}\n{bench}",
        size[0], size[1]
    );
    let display = Display::from_toml(&text, "bench").unwrap();
    let plain = Planner::new(display.optics(Color::Green).unwrap(), frames, WindowFactor::Two);
    let mut planner = plain.with_padding(Padding { rows: padding, columns: padding });
    planner.model = ModelTables::of(&display, Color::Green, planner.slm, planner.grid);
    let (height, width) = (planner.grid.height, planner.grid.width);
    let mut noise = Noise::new(9);
    let views: Vec<Vec<f32>> = (0..9).map(|_| noise.between(height * width, 0.0, 1.0)).collect();
    let pyramid = Arc::new(Pyramid::new(&views, height, width));
    let half = planner.slm.eyebox() / 2.0;
    planner.views = Some(ViewLayout::new(ViewGrid { rows: 3, columns: 3, cell: 2.0 * half / 3.0 }, &pyramid));
    let pupil =
        |x: f64, y: f64, diameter: f64, depth| Pupil { x: x * half, y: y * half, diameter: diameter * half, depth };
    let pupils = vec![pupil(-0.7, 0.8, 0.4, 4e-3), pupil(0.1, -0.05, 1.6, -2e-4), pupil(0.3, 0.2, 0.7, 5e-3)];
    Case { planner, pyramid, pupils }
}

#[test]
fn kernels_before_and_behind_a_mask() {
    let (mut engine, mut twin) = (vulkan(), CpuEngine::new());
    for (size, padding, factor, frames) in
        [([1, 1], 0, 2, 1), ([7, 13], 0, 3, 3), ([31, 50], 3, 2, 2), ([5, 40], 6, 4, 1)]
    {
        for (distance_mm, bench) in [(0.0, ""), (1.5, BENCH)] {
            for storage in Storage::ALL {
                let mut case = masked(size, padding, factor, distance_mm, bench, frames);
                case.planner.storage = storage;
                let at_a_distance = [Kernel::ToMask, Kernel::FromMask].into_iter().filter(|_| distance_mm > 0.0);
                for kernel in [Kernel::ModulateMask, Kernel::PhaseGradientMask].into_iter().chain(at_a_distance) {
                    let step = case.single(Purpose::Project, PROJECTION, 1.0, kernel);
                    let worst = compare(&mut engine, &mut twin, &case, Purpose::Project, &step);
                    let transforms = matches!(kernel, Kernel::ToMask | Kernel::FromMask);
                    let bound = match (storage, transforms) {
                        (Storage::F32, _) => 1e-10,
                        (Storage::F16, true) => half_roundings(20),
                        (Storage::F16, false) => 2e-3 * half_roundings(1),
                    };
                    let name = kernel.name();
                    assert!(worst < bound, "{name} at {size:?} (+{padding}), factor {factor}, {storage:?}: {worst:e}");
                }
            }
        }
    }
    assert_silent(engine);
}

#[test]
fn both_engines_take_the_same_steps_behind_a_mask() {
    let mut engine = vulkan();
    for (size, padding, factor, distance_mm, bench) in
        [([22, 32], 0, 2, 0.0, ""), ([20, 18], 5, 2, 1.5, ""), ([12, 16], 0, 3, 0.0, BENCH)]
    {
        let case = masked(size, padding, factor, distance_mm, bench, 2);
        for (purpose, mode) in [(Purpose::Project, PROJECTION), (Purpose::Adam, INTENSITY), (Purpose::Adam, AMPLITUDE)]
        {
            for step in &steps(&case, purpose, mode) {
                let one = std::slice::from_ref(step);
                let got = solve(&mut engine, &case, purpose, one);
                let want = solve(&mut CpuEngine::new(), &case, purpose, one);
                assert_close(&got, &want, &format!("{size:?}, factor {factor}, {purpose:?}, mode {mode}"));
            }
        }
    }
    assert_silent(engine);
}

#[test]
fn both_engines_show_the_same_views_behind_a_mask() {
    let mut engine = vulkan();
    for (distance_mm, bench) in [(0.0, ""), (1.5, BENCH)] {
        assert_same_views(&mut engine, &masked([27, 35], 2, 2, distance_mm, bench, 3));
    }
    assert_silent(engine);
}
