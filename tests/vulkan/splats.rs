//! Scenes of splats that the device draws. The validation layer has no messages.

use super::views::silent;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::engine::vulkan::VulkanEngine;
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox::low_level::hologram::{Hologram, SceneRecord};
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::reconstruction::{InputOptions, SolveInput, drawer_for};
use eyebox::low_level::scene::{self, Request, SplatDrawer, StoredSplats};
use eyebox_kernels::project_splats::Args;
use eyebox_tests::both::{gpu, watched};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Returns the power of the difference in proportion to the power of the second picture.
fn apart(one: &[f32], other: &[f32]) -> f64 {
    let power = |v: f32| f64::from(v).powi(2);
    let difference: f64 = one.iter().zip(other).map(|(a, b)| power(a - b)).sum();
    difference / other.iter().map(|v| power(*v)).sum::<f64>().max(1e-30)
}

/// Counts the pictures that another drawer draws.
#[derive(Debug)]
struct Counted(Arc<dyn SplatDrawer>, AtomicUsize);

impl SplatDrawer for Counted {
    fn draw(&self, splats: &dyn StoredSplats, camera: &Args, picture: &mut [f32]) -> bool {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.draw(splats, camera, picture)
    }
}

/// The light field of a scene is drawn on the device of an engine, and equals the CPU's above 90 dB. The CPU draws for a
/// software device.
#[test]
fn a_scene_of_splats_is_drawn_on_the_device() {
    const SOURCE: &str = "builtin:still-life-splats";
    let software = VulkanEngine::new(&gpu()).expect("an engine");
    assert_eq!(drawer_for(SOURCE, &software).is_some(), software.gpu().draws_views());
    drop(software);
    let gpu = Gpu::open(&Options { plan_as: Some(DeviceKind::Discrete), ..watched() }).expect("a device");
    let engine = VulkanEngine::new(&gpu).expect("an engine");
    let display = Display { height: 60, width: 76, ..Display::preset("small").expect("a preset") };
    let request = Request { views: 3, ..Request::new(&display, &[Color::Red, Color::Blue]) };
    let wanted = scene::load(SOURCE, &request).expect("views of the CPU");
    let counted = Arc::new(Counted(drawer_for(SOURCE, &engine).expect("a drawer"), AtomicUsize::new(0)));
    let drawer: Arc<dyn SplatDrawer> = counted.clone();
    let found = scene::load(SOURCE, &Request { drawer: Some(&drawer), ..request }).expect("views of the device");
    assert_eq!(counted.1.load(Ordering::Relaxed), 9);
    for (found, wanted) in found.planes.iter().flatten().zip(wanted.planes.iter().flatten()) {
        let error = apart(found, wanted);
        assert!(error < 1e-9, "{error:e}");
    }
    assert!(drawer_for("builtin:still-life", &engine).is_none());
    let mut hologram = Hologram::on(&display, 1, Vec::new());
    hologram.set_scene(SOURCE, SceneRecord::of_source(SOURCE, None).expect("a record"));
    let input = SolveInput::open(&hologram, &InputOptions::default()).expect("its scene");
    assert!(input.request().drawer.is_none());
    let input = input.drawn_by(&engine);
    assert!(input.request().drawer.is_some());
    drop(input);
    assert!(engine.splat_drawer().expect("a drawer").is_some());
    drop((engine, counted, drawer));
    silent(gpu);
}
