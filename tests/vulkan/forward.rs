//! The forward model for optimizers of other programs, on the device and on the CPU.

use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::engine::vulkan::VulkanEngine;
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox::low_level::optics::{Color, Display, Pupil};
use eyebox::low_level::reconstruction::ForwardModel;
use eyebox_tests::both::{Noise, assert_silent, watched};
use eyebox_tests::error_power;

/// Effects of a real display, and a source of several modes.
const BENCH: &str = "[model.green]\nlag = 0.1\ncrosstalk = [[1.2, 2.0], [1.2, 2.0], [1.2, 2.0], [1.2, 2.0]]\nfill = 0.9\n\
    undiffracted = [0.15, 0.1, 0.4, -0.3, 0.2]\nlevel = 1.04\n";
const SOURCE: &str = "[source.green]\nimage_mm = 1\nshape = \"square\"\nsamples = 2\n";

/// Any device computes the images and gradients of the CPU, by kernel and with the fused kernels of a GPU. The model is
/// a relay without and with faults, the same with several modes, and a far field.
#[test]
fn both_engines_give_the_same_images_and_gradients() {
    let relay = Display { height: 40, width: 64, ..Display::preset("small").unwrap() };
    let text = relay.to_toml();
    let with = |more: &str| Display::from_toml(&format!("{text}\n{more}"), "bench").unwrap();
    let far = Display { height: 40, width: 64, pitch: 100e-6, ..Display::preset("far-field").unwrap() };
    let displays =
        [("ideal", relay), ("bench", with(BENCH)), ("modes", with(&format!("{BENCH}{SOURCE}"))), ("far", far)];
    for plan_as in [DeviceKind::Cpu, DeviceKind::Discrete] {
        let options = Options { plan_as: Some(plan_as), ..watched() };
        let mut engine = VulkanEngine::new(&Gpu::open(&options).unwrap()).unwrap();
        for (name, display) in &displays {
            let shrink = if *name == "far" { 0.2 } else { 1.0 };
            let pupil =
                |[x, y, diameter]: [f64; 3], depth| Pupil::from_mm([x * shrink, y * shrink, diameter * shrink, depth]);
            let pupils = [pupil([3.0, -2.0, 9.0], 4.0), pupil([-5.0, 1.0, 6.0], -1.0)];
            let model = ForwardModel::new(display, Color::Green, 2).unwrap();
            let mut noise = Noise::new(3);
            let phases = noise.between(2 * 40 * 64, -3.1, 3.1);
            let mut cpu = CpuEngine::new();
            let images = model.images(&phases, &pupils, &mut cpu).unwrap();
            let weights = noise.between(images.len(), -1.0, 1.0);
            let gradient = model.adjoint(&phases, &pupils, &weights, &mut cpu).unwrap();
            let exact = |values: &[f32]| values.iter().map(|value| f64::from(*value)).collect::<Vec<_>>();
            let got = model.images(&phases, &pupils, &mut engine).unwrap();
            let far = error_power(&got, &exact(&images));
            assert!(far < 1e-10, "{name}, {plan_as:?}: the images differ by {far:e}");
            let got = model.adjoint(&phases, &pupils, &weights, &mut engine).unwrap();
            let far = error_power(&got, &exact(&gradient));
            assert!(far < 1e-10, "{name}, {plan_as:?}: the gradients differ by {far:e}");
        }
        assert_silent(engine);
    }
}
