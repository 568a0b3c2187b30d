//! Compares the kernels of splats on the device with their twins.

use super::decode::ViewDecoder;
use super::splats::{DeviceSplats, Pictures, VulkanSplats};
use crate::engine::EngineError;
use crate::gpu::test_options::watched;
use crate::gpu::{Commands, Gpu};
use crate::scene::StoredSplats;
use eyebox_kernels::draw_splats::{self, Splat, VALUES, WORDS, draw_splats};
use eyebox_kernels::project_splats::{ANTIALIASED, Args, Gaussian, ORDERED, project};
use eyebox_kernels::splat_colors::count;
use eyebox_kernels::{half, mark_splats};
use std::ops::Range;
use std::sync::PoisonError;

/// Random splats with their harmonics.
struct Cloud {
    id: u64,
    gaussians: Vec<Gaussian>,
    /// The halves of each splat.
    rest: Vec<Vec<u16>>,
}

impl StoredSplats for Cloud {
    fn id(&self) -> u64 {
        self.id
    }

    fn count(&self) -> usize {
        self.gaussians.len()
    }

    fn words(&self, range: Range<usize>) -> Vec<u32> {
        let mut words = Vec::new();
        range.for_each(|at| self.gaussians[at].store(&self.rest[at], &mut words));
        words
    }
}

impl Cloud {
    /// Returns splats within 2 units of a point 3 units in front of the camera.
    fn random(number: usize, degree: usize, camera: &Args, seed: u64) -> Self {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut signed = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 23) as f32 - 1.0
        };
        let turns = camera.kind & ORDERED == 0;
        let one = |_| {
            let seen = [2.0 * signed(), 2.0 * signed(), 3.0 + 2.0 * signed()];
            let along = |i: usize| camera.place[i] + (0..3).map(|k| camera.axes[k][i] * seen[k]).sum::<f32>();
            let place = if turns { [0, 1, 2].map(along) } else { seen };
            // The product of a matrix and its transpose is a covariance.
            let rows = [0; 3].map(|_| [0; 3].map(|_| 0.06 * signed()));
            let dot = |a: usize, b: usize| (0..3).map(|k| rows[a][k] * rows[b][k]).sum::<f32>();
            let spread = [dot(0, 0), dot(0, 1), dot(0, 2), dot(1, 1), dot(1, 2), dot(2, 2)];
            let color = [0; 3].map(|_| 0.5 + 0.7 * signed());
            Gaussian { place, spread, opacity: 0.5 + 0.5 * signed(), color }
        };
        let mut gaussians: Vec<Gaussian> = (0..number).map(one).collect();
        if !turns {
            gaussians.sort_by(|a, b| a.place[2].total_cmp(&b.place[2]));
        }
        let mut rest =
            |_| (0..3 * count(degree)).map(|i| [0x2c00, 0xa800, 0x3000][i % 3] + (signed() * 99.0) as u16).collect();
        Self { id: seed, rest: (0..number).map(&mut rest).collect(), gaussians }
    }

    /// Returns the splats of a view by the twin. Those outside have no rows and columns.
    fn projected(&self, order: &[u32], camera: &Args) -> Vec<Splat> {
        let one = |i: usize| {
            let at = if camera.kind & ORDERED == 0 { order[i] as usize } else { i };
            let rest: Vec<f32> = self.rest[at].iter().map(|bits| half::value(*bits)).collect();
            project(camera, &self.gaussians[at], || &rest).unwrap_or_default()
        };
        (0..camera.count as usize).map(one).collect()
    }

    /// Returns the indices with the nearest first.
    fn order(&self, camera: &Args) -> Vec<u32> {
        let forward = |at: &u32| {
            let place = self.gaussians[*at as usize].place;
            (0..3).map(|i| camera.axes[2][i] * (place[i] - camera.place[i])).sum::<f32>()
        };
        let mut order: Vec<u32> = (0..self.gaussians.len() as u32).filter(|at| forward(at) > 0.9).collect();
        order.sort_by(|a, b| forward(a).total_cmp(&forward(b)));
        order
    }
}

/// Draws projected splats on the host.
fn drawn(camera: &Args, splats: &[Splat]) -> Vec<f32> {
    let args = draw_splats::Args::new(camera.height as usize, camera.width as usize);
    let mut lists = vec![Vec::new(); args.tiles()];
    for (i, splat) in splats.iter().enumerate() {
        splat.tiles(args.across).for_each(|tile| lists[tile].push(i as u32));
    }
    let mut first = vec![0];
    lists.iter().for_each(|list| first.push(first[first.len() - 1] + list.len() as u32));
    let mut picture = vec![9.0; VALUES * (camera.height * camera.width) as usize];
    draw_splats(&args, splats, &first, &lists.concat(), &mut picture);
    picture
}

fn camera([height, width]: [u32; 2], kind: u32) -> Args {
    Args {
        axes: [[0.6, 0.0, -0.8], [0.0, 1.0, 0.0], [0.8, 0.0, 0.6]],
        place: [5.0, -3.0, 7.0],
        place_rest: [1e-7, 0.0, -1e-7],
        by: [0.02, -0.01],
        moved: [0.4, 1.3],
        focal: height.min(width) as f32,
        height,
        width,
        count: 0,
        kind,
    }
}

/// Returns the power of the difference in proportion to the power of the second picture.
fn apart(one: &[f32], other: &[f32]) -> f64 {
    let power = |v: f32| f64::from(v).powi(2);
    let difference: f64 = one.iter().zip(other).map(|(a, b)| power(a - b)).sum();
    difference / other.iter().map(|v| power(*v)).sum::<f64>().max(1e-30)
}

fn silent(gpu: Gpu) {
    let messages = gpu.messages();
    drop(gpu);
    assert_eq!(*messages.lock().unwrap_or_else(PoisonError::into_inner), Vec::<String>::new());
}

/// The size, number of splats and kind of some scenes. The last ones have more splats than a workgroup marks at once.
const CASES: [([u32; 2], usize, u32); 8] = [
    ([1, 1], 5, 0),
    ([7, 13], 40, 3),
    ([48, 31], 0, 0),
    ([45, 67], 300, 1 | ANTIALIASED),
    ([33, 50], 900, 2 | ORDERED),
    ([64, 80], 5000, ORDERED),
    ([150, 210], 3000, 3 | ANTIALIASED | ORDERED),
    ([150, 210], 20_000, 3),
];

#[test]
fn splats_and_their_marks_are_those_of_the_twins() {
    let gpu = Gpu::open(&watched()).unwrap();
    let mut commands = Commands::new(&gpu).unwrap();
    for (size, number, kind) in CASES {
        let mut camera = camera(size, kind);
        let some = Cloud::random(number, (kind & 3) as usize, &camera, 3 + number as u64);
        let order = if kind & ORDERED == 0 { some.order(&camera) } else { Vec::new() };
        camera.count = if kind & ORDERED == 0 { order.len() as u32 } else { number as u32 };
        let mut room = DeviceSplats::default();
        room.store(&mut commands, &some, &order).unwrap();
        let picture = commands.block(4 * (VALUES as u64) * u64::from(size[0] * size[1]), "a picture").unwrap();
        let pictures = Pictures { to: picture.all(), next: 0, stride: size[0] * size[1], light: false };
        commands.recorder.begin(0).unwrap();
        room.record(&mut commands, &[camera], &pictures).unwrap();
        commands.recorder.submit("splats").unwrap();
        let mut splats = vec![Splat::default(); camera.count as usize];
        let marking = mark_splats::Args::new(splats.len(), size[0] as usize, size[1] as usize);
        let mut marks = vec![0u32; (marking.bins * marking.words) as usize];
        let [at_splats, at_marks] = room.projected();
        let whole = |bytes: usize| [(0, 0, bytes as u64)];
        let bytes = 4 * WORDS * splats.len();
        commands.fetch(at_splats, bytemuck::cast_slice_mut(&mut splats), whole(bytes)).unwrap();
        let bytes = 4 * marks.len();
        commands.fetch(at_marks, bytemuck::cast_slice_mut(&mut marks), whole(bytes)).unwrap();
        let wanted = some.projected(&order, &camera);
        // A logarithm may be rounded differently, which moves an edge that is at a pixel. Its opacity there is the
        // faintest.
        let same = |a: u32, b: u32| a.abs_diff(b) & 0xffff <= 1 && (a >> 16).abs_diff(b >> 16) <= 1;
        let near = |a: f32, b: f32| (a - b).abs() <= 2e-5 * b.abs().max(1.0);
        let mut moved = 0;
        for (i, (a, b)) in splats.iter().zip(&wanted).enumerate() {
            moved += usize::from((a.columns, a.rows) != (b.columns, b.rows));
            if b.columns == 0 || a.columns == 0 {
                assert!(a.columns == b.columns || b.opacity < 0.005, "{i} of {number}: {a:?} {b:?}");
                continue;
            }
            assert!(same(a.columns, b.columns) && same(a.rows, b.rows), "{i} of {number}: {a:?} {b:?}");
            let values = |s: &Splat| [s.x, s.y, s.opacity, s.color[0], s.color[1], s.color[2], s.inverse];
            assert!(values(a).iter().zip(values(b)).all(|(a, b)| near(*a, b)), "{i} of {number}: {a:?} {b:?}");
            assert!(a.conic.iter().zip(b.conic).all(|(a, b)| (a - b).abs() < 1e-4 * b.abs().max(0.1)), "{a:?} {b:?}");
        }
        assert!(moved <= 1 + number / 500, "{moved} of {number} have other edges");
        assert!(number < 100 || wanted.iter().filter(|s| s.columns > 0).count() > number / 4, "few are seen");
        let mut wanted = vec![7; marks.len()];
        mark_splats::mark_splats(&marking, &splats, &mut wanted);
        assert!(marks == wanted, "marks of {number} splats in {size:?}");
    }
    drop(commands);
    silent(gpu);
}

#[test]
fn pictures_of_splats_are_those_of_the_twins() {
    let gpu = Gpu::open(&watched()).unwrap();
    let device = VulkanSplats::new(&gpu).unwrap();
    for (size, number, kind) in CASES {
        let mut camera = camera(size, kind);
        let some = Cloud::random(number, (kind & 3) as usize, &camera, 3 + number as u64);
        let order = if kind & ORDERED == 0 { some.order(&camera) } else { Vec::new() };
        camera.count = if kind & ORDERED == 0 { order.len() as u32 } else { number as u32 };
        let wanted = drawn(&camera, &some.projected(&order, &camera));
        let mut found = vec![5.0; wanted.len()];
        device.picture(&some, &order, &camera, &mut found).unwrap();
        let error = apart(&found, &wanted);
        assert!(error < 1e-9, "{number} splats in {size:?}: {error:e}");
        assert!(number < 100 || wanted.iter().any(|v| *v > 0.1), "{number} splats in {size:?} are dark");
    }
    drop(device);
    silent(gpu);
}

/// Views that stay on the device are the light of the twin's pictures.
#[test]
fn views_are_drawn_and_decoded_on_the_device() {
    let gpu = Gpu::open(&watched()).unwrap();
    let size = [70, 90];
    let camera = Args { count: 700, ..camera(size, 2 | ORDERED) };
    let some = Cloud::random(700, 2, &camera, 5);
    let cameras: Vec<Args> = (0..6).map(|i| Args { by: [0.05 * i as f32, 0.01], ..camera }).collect();
    let [height, width] = size.map(|n| n as usize);
    let pixels = height * width;
    let mut decoder = ViewDecoder::new(&gpu, [height, width], 3, &[2, 0], (4 * 3 * 6 * pixels) as u64).unwrap();
    let mut room = DeviceSplats::default();
    let views = decoder.draw(&mut room, (&some, &[]), &cameras, [2, 3]).unwrap();
    let lights = decoder.measure(&views).unwrap().unwrap();
    let pyramids = decoder.decode(&views, &lights).unwrap();
    let linear = |v: f32| {
        let v = f64::from(v.clamp(0.0, 1.0));
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
    for ((pyramid, light), channel) in pyramids.iter().zip(&lights).zip([2, 0]) {
        let light_of = |camera: &Args| -> Vec<f64> {
            let picture = drawn(camera, &some.projected(&[], camera));
            picture[channel * pixels..][..pixels].iter().map(|v| linear(*v)).collect()
        };
        let wanted: Vec<Vec<f64>> = cameras.iter().map(light_of).collect();
        let mean = wanted.iter().flatten().sum::<f64>() / (6 * pixels) as f64;
        assert!(mean > 0.01 && (light.mean / mean - 1.0).abs() < 1e-5, "{} {mean}", light.mean);
        let middle = wanted[3].iter().sum::<f64>() / pixels as f64;
        assert!((light.middle[0] / middle - 1.0).abs() < 1e-5, "{:?} {middle}", light.middle);
        let brightest = wanted.iter().flatten().fold(0.0, |most: f64, v| most.max(*v));
        assert!((f64::from(light.brightest) - brightest).abs() < 1e-4, "{} {brightest}", light.brightest);
        let found = pyramid.on_device().expect("light on the device").read().unwrap().swap_remove(0);
        let error = |i: usize, v: f64| f64::from(found[i]) / 65_535.0 * f64::from(light.brightest) - v;
        let power: f64 = wanted.iter().flatten().enumerate().map(|(i, v)| error(i, *v).powi(2)).sum();
        assert!(power < 1e-9 * (6 * pixels) as f64, "{power}");
    }
    let wrong = [Args { height: 69, ..camera }; 6];
    assert!(matches!(decoder.draw(&mut room, (&some, &[]), &wrong, [2, 3]), Err(EngineError::Mismatch { .. })));
    assert!(matches!(decoder.draw(&mut room, (&some, &[]), &cameras[1..], [2, 3]), Err(EngineError::Mismatch { .. })));
    drop((pyramids, room, decoder));
    silent(gpu);
}

#[test]
fn splats_that_do_not_belong_to_a_camera_are_refused() {
    let gpu = Gpu::open(&watched()).unwrap();
    let device = VulkanSplats::new(&gpu).unwrap();
    let camera = Args { count: 50, ..camera([20, 20], 0) };
    let some = Cloud::random(50, 0, &camera, 3);
    let order: Vec<u32> = (0..50).collect();
    let mut picture = vec![0.0; VALUES * 400];
    device.picture(&some, &order, &camera, &mut picture).unwrap();
    let outside: Vec<u32> = (1..51).collect();
    let more = Args { count: 300, ..camera };
    for (order, camera, first) in [(&outside, &camera, 0), (&order, &more, 0), (&order, &camera, 1)] {
        let refused = device.picture(&some, order, camera, &mut picture[first..]);
        assert!(matches!(refused, Err(EngineError::Mismatch { .. })));
    }
    drop(device);
    silent(gpu);
}
