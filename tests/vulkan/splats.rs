//! The kernel `draw_splats` on the device against its CPU twin, and scenes of splats that the device draws. The
//! validation layer has no messages.

use super::views::silent;
use eyebox::low_level::engine::vulkan::{VulkanEngine, VulkanSplats};
use eyebox::low_level::engine::{Engine, EngineError};
use eyebox::low_level::hologram::{Hologram, SceneRecord};
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::reconstruction::{InputOptions, SolveInput, drawer_for};
use eyebox::low_level::scene::{self, Request, SplatDrawer, TiledSplats};
use eyebox_kernels::draw_splats::{Args, SIDE, Splat, VALUES, draw_splats};
use eyebox_tests::both::{Noise, gpu};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Returns random splats of a picture with the nearest first, and their tiles. The first row of tiles is
/// empty if there are several rows.
fn random(args: &Args, count: usize, opacity: f32, seed: u64) -> TiledSplats {
    let mut noise = Noise::new(seed);
    let [height, width] = [args.height, args.width].map(|n| n as f32);
    let top = if args.height > SIDE { SIDE } else { 0 };
    let mut one = |i: usize| {
        let mut between = |low: f32, high: f32| low + (high - low) * noise.draw();
        let (x, y) = (between(-3.0, width + 3.0), between(-3.0, height + 3.0));
        let (wide, high) = (between(0.6, 5.0), between(0.6, 5.0));
        let slant = between(-0.8, 0.8) * wide * high;
        let area = wide * wide * high * high - slant * slant;
        // Beyond 3.4 deviations, the opacity is below 1 / 255.
        let span = |center: f32, reach: f32, low: u32, most: u32| {
            let [first, end] = [(center - reach).floor(), (center + reach).floor() + 2.0].map(|v| v.max(0.0) as u32);
            first.clamp(low, most) | end.clamp(low, most) << 16
        };
        Splat {
            x,
            y,
            conic: [high * high / area, -slant / area, wide * wide / area],
            opacity: opacity * between(0.0, 1.0),
            color: [between(0.0, 1.0), between(0.0, 1.0), between(0.0, 1.0)],
            inverse: 1.0 / (1.0 + i as f32),
            columns: span(x, 3.4 * wide, 0, args.width),
            rows: span(y, 3.4 * high, top, args.height),
        }
    };
    let splats: Vec<Splat> = (0..count).map(&mut one).collect();
    let mut lists = vec![Vec::new(); args.tiles()];
    for (i, splat) in splats.iter().enumerate() {
        splat.tiles(args.across).for_each(|tile| lists[tile].push(i as u32));
    }
    let entries = lists.concat();
    let mut first = vec![0];
    lists.iter().for_each(|list| first.push(first[first.len() - 1] + list.len() as u32));
    TiledSplats { splats, first, entries }
}

/// Returns the power of the difference in proportion to the power of the second picture.
fn apart(one: &[f32], other: &[f32]) -> f64 {
    let power = |v: f32| f64::from(v).powi(2);
    let difference: f64 = one.iter().zip(other).map(|(a, b)| power(a - b)).sum();
    difference / other.iter().map(|v| power(*v)).sum::<f64>().max(1e-30)
}

#[test]
fn pictures_of_splats_are_those_of_the_twin() {
    let gpu = gpu();
    let device = VulkanSplats::new(&gpu).expect("a drawer");
    for (height, width, count, opacity) in [
        (1, 1, 5, 1.0),
        (7, 13, 40, 0.7),
        (48, 31, 0, 1.0),
        (45, 67, 300, 0.9),
        // More splats than a batch in every tile, with pixels that are closed by the first of them.
        (64, 80, 6000, 1.0),
        // Faint ones, so that no pixel is closed.
        (33, 50, 900, 0.05),
        (160, 130, 20_000, 0.6),
    ] {
        let args = Args::new(height, width);
        let tiled = random(&args, count, opacity, 7 + count as u64);
        assert!(tiled.first[args.across as usize] == 0 || height <= SIDE as usize, "the first row of tiles is empty");
        let mut wanted = vec![9.0; VALUES * height * width];
        draw_splats(&args, &tiled.splats, &tiled.first, &tiled.entries, &mut wanted);
        let mut found = vec![5.0; wanted.len()];
        device.picture(&args, &tiled, &mut found).expect("a picture");
        let error = apart(&found, &wanted);
        assert!(error < 1e-9, "{count} splats in {height} x {width}: {error:e}");
        assert!(
            count == 0 || height <= SIDE as usize || wanted.iter().any(|v| *v > 0.1),
            "{height} x {width} is empty"
        );
    }
    drop(device);
    silent(gpu);
}

#[test]
fn lists_that_do_not_belong_together_are_refused() {
    let gpu = gpu();
    let device = VulkanSplats::new(&gpu).expect("a drawer");
    let args = Args::new(20, 20);
    let good = random(&args, 50, 1.0, 3);
    let mut picture = vec![0.0; VALUES * 400];
    let short = TiledSplats { first: good.first[1..].to_vec(), ..good.clone() };
    let outside = TiledSplats { splats: good.splats[..1].to_vec(), ..good.clone() };
    let mut turned = good.clone();
    turned.first.reverse();
    for wrong in [&short, &outside, &turned] {
        assert!(matches!(device.picture(&args, wrong, &mut picture), Err(EngineError::Mismatch { .. })));
    }
    assert!(matches!(device.picture(&args, &good, &mut picture[1..]), Err(EngineError::Mismatch { .. })));
    device.picture(&args, &good, &mut picture).expect("a picture");
    drop(device);
    silent(gpu);
}

/// Counts the pictures that another drawer draws.
#[derive(Debug)]
struct Counted(Arc<dyn SplatDrawer>, AtomicUsize);

impl SplatDrawer for Counted {
    fn draw(&self, args: &Args, tiled: &TiledSplats, picture: &mut [f32]) -> bool {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.draw(args, tiled, picture)
    }
}

/// The light field of a scene is drawn on the device of an engine, and equals the CPU's above 90 dB.
#[test]
fn a_scene_of_splats_is_drawn_on_the_device() {
    const SOURCE: &str = "builtin:still-life-splats";
    let gpu = gpu();
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
