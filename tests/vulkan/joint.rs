//! Refinement in simultaneous color takes the same steps on the device and on the CPU. The validation layer has no
//! messages.

use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::engine::vulkan::VulkanEngine;
use eyebox::low_level::optics::{Color, Display, Laser, Padding, Pupil, PupilDistribution};
use eyebox::low_level::scene::{self, Request};
use eyebox::low_level::solve::{
    JointPart, JointRefiner, Motion, Problem, Refinable, RefineSettings, Strategy, random_phases,
};
use eyebox_tests::both::gpu;
use std::sync::PoisonError;

const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];

#[test]
fn all_colours_at_once_are_refined_as_on_the_cpu() {
    let gpu = gpu();
    let display = Display { height: 48, width: 64, ..Display::preset("small").expect("a preset") };
    let field =
        scene::load("builtin:still-life", &Request { views: 3, ..Request::new(&display, &ALL) }).expect("views");
    let powers = [vec![0.4, 1.9, 0.7], vec![1.0, 0.2, 1.8], vec![1.5, 1.5, 0.0]];
    let part = |((color, slope), powers): ((Color, f64), Vec<f64>)| JointPart {
        problem: Problem::new(&field, color, &display, Padding::default()).expect("a problem"),
        exposure: 0.35,
        laser: Laser { slope, powers },
    };
    let parts: Vec<JointPart> = ALL.into_iter().zip(display.slopes(&ALL)).zip(powers).map(part).collect();
    let drives = random_phases(3 * 48 * 64, 2);
    let aim = PupilDistribution::around(&Pupil::from_mm([2.0, -1.0, 4.0, 0.2]), 3e-4);
    for strategy in [RefineSettings::default().strategy, Strategy::Adam { rate: 0.05 }] {
        let steering = RefineSettings { strategy, repeats: 2, ..RefineSettings::default() };
        let cpu = JointRefiner::new(parts.clone(), &drives, steering, || Ok(Box::new(CpuEngine::new())));
        let device = JointRefiner::new(parts.clone(), &drives, steering, || Ok(Box::new(VulkanEngine::new(&gpu)?)));
        let mut both = [cpu.expect("a refinement"), device.expect("a refinement")];
        for (step, content) in [[0.0; 2], [0.0; 2], [2.0, 0.0], [2.0, 0.0]].into_iter().enumerate() {
            let loss = both.each_mut().map(|refiner| {
                refiner.aim(aim).expect("an aim");
                refiner.moves(Motion { content, ..Motion::default() }).expect("a motion");
                refiner.step().expect("a step")
            });
            assert!((loss[1] / loss[0] - 1.0).abs() < 2e-3, "{strategy:?}, step {step}: {loss:?}");
        }
        for (color, name) in ALL.into_iter().enumerate() {
            let pupils = [Pupil::from_mm([2.0, -1.0, 4.0, 0.2]), Pupil::from_mm([-3.0, 2.0, 6.0, 0.0])];
            let seen = both.each_mut().map(|refiner| refiner.look(color, &pupils).expect("a look"));
            for (cpu, device) in seen[0].iter().zip(&seen[1]) {
                let [cpu, device] = [cpu.psnr(0.35), device.psnr(0.35)];
                assert!((cpu - device).abs() < 0.02, "{strategy:?}, {name}: {cpu} {device} dB");
            }
        }
    }
    let messages = gpu.messages();
    drop(gpu);
    let heard = messages.lock().unwrap_or_else(PoisonError::into_inner);
    assert!(heard.is_empty(), "messages of the validation layer:\n{}", heard.join("\n"));
}
