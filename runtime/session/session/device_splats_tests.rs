//! Compares views of splats that stay on the device with views of the CPU.

use crate::engine::Backend;
use crate::gpu::test_options::watched;
use crate::gpu::{DeviceKind, Gpu, Options};
use crate::optics::{Color, Display, PupilDistribution};
use crate::scene::{MovingSplats, Request};
use crate::session::{Due, Newest, SceneFrame, Scenes, SplatWalk};
use std::sync::PoisonError;

const COLORS: [Color; 2] = [Color::Red, Color::Blue];

fn due(light_ms: i64, tracked: bool) -> Due {
    let pupil =
        PupilDistribution { centre: [0.4e-3, 0.0], spread: 1e-4, diameter: [3e-3; 2], focus: [0.0; 2], elsewhere: 0.0 };
    let light_ns = light_ms * 1_000_000;
    Due {
        now_ns: light_ns - 20_000_000,
        light_ns,
        light_monotonic_ns: light_ns as u64,
        period_ns: 16_000_000,
        pupil,
        velocity: [0.0; 2],
        tracked,
        patient: true,
    }
}

fn frame(walk: &mut SplatWalk, due: &Due) -> SceneFrame {
    match walk.next(due).expect("views") {
        Newest::New(frame) => frame,
        Newest::Refused(reason) => panic!("{reason}"),
        _ => panic!("no new views"),
    }
}

/// The camera moves, and a session without a tracker wants more views. No view is read back, except a small one.
#[test]
fn views_of_splats_stay_on_the_device() {
    let gpu = Gpu::open(&watched()).expect("a device");
    let display = Display { height: 90, width: 120, ..Display::preset("small").expect("a preset") };
    let walk = || {
        let request = Request::new(&display, &COLORS);
        let splats = MovingSplats::new("builtin:still-life-splats", &request).expect("splats");
        SplatWalk::new(splats, &display, &COLORS, None)
    };
    let (mut there, mut here) = (walk(), walk());
    there.draw_on(&gpu).expect("room");
    for (step, tracked) in [(1, true), (2, true), (3, false), (4, true)] {
        let due = due(100 * step, tracked);
        let before = gpu.counts();
        let [found, wanted] = [&mut there, &mut here].map(|walk| frame(walk, &due));
        let moved = gpu.counts().since(before);
        // The splats are uploaded once, and later only their order. One view of one color is read.
        assert!((step == 1) == (moved.uploaded > 500_000), "{moved:?}");
        assert!(moved.read_back < 4 * 90 * 120, "{moved:?}");
        for (found, wanted) in found.colors.iter().zip(wanted.colors.iter()) {
            let (problem, of_cpu) = (&found.problem, &wanted.problem);
            assert_eq!((problem.views, problem.center), (of_cpu.views, of_cpu.center));
            assert!((problem.mean / of_cpu.mean - 1.0).abs() < 1e-4, "{} {}", problem.mean, of_cpu.mean);
            assert!((found.exposure / wanted.exposure - 1.0).abs() < 1e-3, "{} {}", found.exposure, wanted.exposure);
            let pyramids = [&problem.pyramid, &of_cpu.pyramid].map(|pyramid| pyramid.on_host().expect("read"));
            assert_eq!(pyramids[0].levels.len(), pyramids[1].levels.len());
            for (a, b) in pyramids[0].levels.iter().zip(&pyramids[1].levels) {
                let light = |pyramid: usize, v: u16| f64::from(v) * f64::from(pyramids[pyramid].scale);
                let pairs = a.views.iter().zip(&b.views).map(|(a, b)| (light(0, *a), light(1, *b)));
                let (error, power) =
                    pairs.fold((0.0, 0.0), |(error, power), (a, b)| (error + (a - b) * (a - b), power + b * b));
                assert!(power > 0.0 && error < 1e-8 * power, "{:e} of {power}", error / power);
            }
        }
        let shot = found.colors[0].problem.pyramid.on_device().is_some();
        assert!(shot && wanted.colors[0].problem.pyramid.on_device().is_none());
        [&there, &here].iter().for_each(|walk| walk.handle().step([0.05, 0.0, 0.02]));
    }
    drop(there);
    silent(gpu);
}

/// The device is lost while it draws. The CPU draws the same views, and all later ones.
#[test]
fn the_cpu_draws_when_the_device_is_lost() {
    let gpu = Gpu::open(&watched()).expect("a device");
    let display = Display { height: 40, width: 56, ..Display::preset("small").expect("a preset") };
    let request = Request::new(&display, &COLORS);
    let splats = MovingSplats::new("builtin:still-life-splats", &request).expect("splats");
    let mut walk = SplatWalk::new(splats, &display, &COLORS, None);
    walk.draw_on(&gpu).expect("room");
    let is_there = |frame: SceneFrame| frame.colors[0].problem.pyramid.on_device().is_some();
    assert!(is_there(frame(&mut walk, &due(100, true))));
    walk.device().expect("it draws").views.decoder.pretend_lost_after(2);
    for step in 2..4 {
        walk.handle().step([0.05, 0.0, 0.02]);
        assert!(!is_there(frame(&mut walk, &due(100 * step, true))), "step {step}");
    }
    drop(walk);
    silent(gpu);
}

fn silent(gpu: Gpu) {
    let messages = gpu.messages();
    drop(gpu);
    assert_eq!(*messages.lock().unwrap_or_else(PoisonError::into_inner), Vec::<String>::new());
}

#[test]
fn the_cpu_draws_for_a_software_device() {
    let display = Display { height: 40, width: 56, ..Display::preset("small").expect("a preset") };
    for (plan_as, draws) in [(DeviceKind::Discrete, true), (DeviceKind::Cpu, false)] {
        let gpu = Gpu::open(&Options { plan_as: Some(plan_as), ..watched() }).expect("a device");
        let engines = Backend::on_device(gpu.clone()).expect("engines");
        let splats = MovingSplats::new("builtin:still-life-splats", &Request::new(&display, &COLORS)).expect("splats");
        let mut walk = SplatWalk::new(splats, &display, &COLORS, None);
        assert_eq!(walk.draw_with(&engines).expect("a device").is_none(), draws);
        let seen = frame(&mut walk, &due(100, true));
        assert_eq!(seen.colors[0].problem.pyramid.on_device().is_some(), draws, "{plan_as}");
        drop((seen, walk, engines));
        let messages = gpu.messages();
        drop(gpu);
        assert!(messages.lock().unwrap_or_else(PoisonError::into_inner).is_empty());
    }
}
