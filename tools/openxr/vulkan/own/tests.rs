//! Compares the kernels with the composition of the host, on random layers.

use super::memory::Use;
use super::*;
use crate::composition::{Alpha, Canvas, Cylinder, DepthRange, Format, Frustum, Pose, Quad, Sheet};
use crate::vulkan::sharing::{USAGE, entry, ids};
use ash::vk;
use eyebox_live_input::DeviceIds;
use std::process::Command;

/// Returns the UUIDs of the first device, or none without a device. In CI there must be one.
fn first_device() -> Option<DeviceIds> {
    let about = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_2);
    let info = vk::InstanceCreateInfo::default().application_info(&about);
    // SAFETY: the structures live as long as the call.
    let instance = entry().and_then(|entry| unsafe { entry.create_instance(&info, None) }.ok());
    let found = instance.and_then(|instance| {
        // SAFETY: the instance was made just now.
        let first = unsafe { instance.enumerate_physical_devices() }.ok()?.first().copied();
        // SAFETY: the instance has Vulkan 1.2, which has the function.
        let found = first.map(|first| unsafe { ids(instance.fp_v1_1().get_physical_device_properties2, first) });
        // SAFETY: nothing uses the instance any more.
        unsafe { instance.destroy_instance(None) };
        found
    });
    assert!(found.is_some() || std::env::var_os("CI").is_none(), "no Vulkan device: run tools/setup.sh");
    found
}

/// Runs another test in a process with Vulkan's validation layer, which prints what it finds.
fn validated(test: &str) {
    let mut child = Command::new(std::env::current_exe().unwrap());
    child.args(["--exact", &format!("vulkan::own::tests::{test}"), "--ignored", "--nocapture"]);
    child.env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation");
    child.env("VK_LAYER_ENABLES", "VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT");
    let output = child.output().unwrap();
    let text = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
    assert!(output.status.success() && text.contains("1 passed"), "{text}");
    // The newest layer also prints its settings.
    for word in ["VUID", "UNASSIGNED", "SYNC-HAZARD", "Validation Error"] {
        assert!(!text.contains(word), "{text}");
    }
}

#[test]
fn the_device_composes_what_the_host_composes() {
    validated("random_layers");
}

/// The texels of an image of a random layer.
struct Image {
    format: Format,
    size: [usize; 2],
    stride: usize,
    bytes: Vec<u8>,
}

impl Image {
    /// Makes an image whose rows are longer than its columns need.
    fn random(random: &mut fastrand::Rng, format: Format) -> Self {
        let size = [random.usize(1..40), random.usize(1..40)];
        let stride = (size[1] + random.usize(0..3)) * format.bytes();
        let mut bytes: Vec<u8> = (0..size[0] * stride).map(|_| random.u8(..)).collect();
        match format {
            Format::Rgba16Float => {
                // Mostly light to 4, and some of any value.
                for half in bytes.as_chunks_mut::<2>().0 {
                    if random.u32(0..20) != 0 {
                        *half = half::f16::from_f32(random.f32() * 4.0).to_le_bytes();
                    }
                }
            }
            Format::D32 => {
                for depth in bytes.as_chunks_mut::<4>().0 {
                    if random.u32(0..20) != 0 {
                        *depth = random.f32().to_le_bytes();
                    }
                }
            }
            _ => {}
        }
        Self { format, size, stride, bytes }
    }

    fn sheet(&self) -> Sheet<'_> {
        Sheet { raw: &self.bytes, format: self.format, stride: self.stride, size: self.size }
    }

    fn texels(&self) -> Texels<'_> {
        Texels { format: self.format, size: self.size, stride: self.stride, bytes: Bytes::Host(&self.bytes) }
    }
}

enum RandomPlace {
    View([f64; 4], Option<(Image, DepthRange)>, f32),
    Quad(Quad),
    Cylinder(Cylinder),
}

struct RandomLayer {
    color: Image,
    alpha: Alpha,
    place: RandomPlace,
}

impl RandomLayer {
    fn random(random: &mut fastrand::Rng, frustum: &Frustum, with_surfaces: bool) -> Self {
        let colors = [
            Format::Rgba8 { srgb: true },
            Format::Rgba8 { srgb: false },
            Format::Bgra8 { srgb: true },
            Format::Bgra8 { srgb: false },
            Format::Rgb10A2,
            Format::Rgba16Float,
        ];
        let format = colors[random.usize(0..colors.len())];
        let color = Image::random(random, format);
        let alpha = Alpha { blends: random.bool(), unpremultiplied: random.bool(), inverted: random.bool() };
        let some = |random: &mut fastrand::Rng, size: f32| (random.f32() * 2.0 - 1.0) * size;
        let pose = |random: &mut fastrand::Rng, forward: f32| {
            let rotation = [some(random, 0.4), some(random, 0.4), some(random, 0.4), 1.0];
            Pose::new(rotation, [some(random, 0.5), some(random, 0.5), some(random, 0.5) - forward])
        };
        let place = match random.u32(0..if with_surfaces { 3 } else { 1 }) {
            0 => {
                let depth = random.bool().then(|| {
                    let format = [Format::D16, Format::D24, Format::D32][random.usize(0..3)];
                    let all = [[0.1, f32::INFINITY], [f32::INFINITY, 0.05], [0.5, 40.0], [20.0, 0.004], [1e-40, 2.0]];
                    let depths = [[0.0, 1.0], [0.25, 0.5]][random.usize(0..2)];
                    let range = DepthRange { depths, distances: all[random.usize(0..all.len())] };
                    (Image::random(random, format), range)
                });
                let wide = random.f64() + 0.5;
                let mut edges = frustum.edges().map(|edge| edge * wide + f64::from(some(random, 0.1)));
                if random.bool() {
                    edges.swap(2, 3);
                }
                RandomPlace::View(edges, depth, random.f32())
            }
            1 => RandomPlace::Quad(Quad::new(&pose(random, 1.5), [0.2 + random.f32(), 0.2 + random.f32()])),
            _ => {
                let radius = [0.0, 1.0, 2.5, f32::INFINITY][random.usize(0..4)];
                RandomPlace::Cylinder(Cylinder::new(&pose(random, 0.0), radius, 0.1 + 6.0 * random.f32(), 1.0))
            }
        };
        Self { color, alpha, place }
    }

    fn draw(&self, canvas: &mut Canvas) {
        let color = self.color.sheet();
        match &self.place {
            RandomPlace::View(edges, depth, dioptres) => {
                let depth = depth.as_ref().map(|(image, range)| (image.sheet(), *range));
                canvas.project(color, *edges, self.alpha, depth, *dioptres);
            }
            RandomPlace::Quad(quad) => canvas.draw(quad, color, self.alpha),
            RandomPlace::Cylinder(cylinder) => canvas.draw(cylinder, color, self.alpha),
        }
    }

    fn seen(&self) -> Seen<'_> {
        let place = match &self.place {
            RandomPlace::View(edges, depth, dioptres) => {
                let depth = depth.as_ref().map(|(image, range)| (image.texels(), *range));
                SeenPlace::View { edges: *edges, depth, dioptres: *dioptres }
            }
            RandomPlace::Quad(quad) => SeenPlace::Quad(quad),
            RandomPlace::Cylinder(cylinder) => SeenPlace::Cylinder(cylinder),
        };
        Seen { color: self.color.texels(), alpha: self.alpha, place }
    }
}

/// Returns the share by which two values differ, of the larger one or of 1.
fn off(found: f32, wanted: f32) -> f32 {
    (found - wanted).abs() / found.abs().max(wanted.abs()).max(1.0)
}

#[test]
#[ignore = "another test runs it with the validation layer"]
fn random_layers() {
    let Some(wanted) = first_device() else { return };
    let own = Own::open(wanted).unwrap();
    let mut random = fastrand::Rng::with_seed(7);
    let (mut solid, mut apart, mut pixels, mut limited) = (0, 0, 0, 0);
    for round in 0..400 {
        let frustum = Frustum { size: [random.usize(1..50), random.usize(1..80)], angle: 0.005 + 0.03 * random.f64() };
        let bits = random.u32(1..8);
        let colors = [0, 1, 2].map(|color| bits >> color & 1 == 1);
        let nearest = [0.4, 1.5, 200.0][random.usize(0..3)];
        let shape = Shape { frustum, colors, nearest };
        let with_surfaces = round % 2 == 1;
        let layers: Vec<RandomLayer> =
            (0..random.usize(0..6)).map(|_| RandomLayer::random(&mut random, &frustum, with_surfaces)).collect();
        let mut canvas = Canvas::new(frustum);
        layers.iter().for_each(|layer| layer.draw(&mut canvas));
        let was_near = canvas.limit(nearest);
        let mut light = Vec::new();
        canvas.samples(colors, &mut light);
        let target = Target::host(&own, shape.bytes()[0]).unwrap();
        let mut composer = Composer::new(&own, shape, target).unwrap();
        let seen: Vec<Seen<'_>> = layers.iter().map(RandomLayer::seen).collect();
        let found_near = composer.compose(0, &seen).unwrap();
        let (found, dioptres) = composer.samples();
        assert_eq!((found.len(), dioptres.len()), (light.len(), canvas.dioptres().len()));
        let channels = colors.iter().filter(|color| **color).count();
        // A view has the same arithmetic. Places on surfaces differ by 1e-6 of an image, so that a few pixels are on
        // the other side of an edge.
        let bound = if with_surfaces { 2e-4 } else { 1e-6 };
        let mut here = 0;
        for (at, (found_d, wanted_d)) in dioptres.iter().zip(canvas.dioptres()).enumerate() {
            let values = channels * at..channels * (at + 1);
            let same = found[values.clone()].iter().zip(&light[values.clone()]).all(|(a, b)| off(*a, *b) < bound);
            here += usize::from(!same || off(*found_d, *wanted_d) > bound);
            assert!(found[values].iter().all(|v| (0.0..=65_504.0).contains(v)), "round {round}, {at}");
            assert!((0.0..=100.0).contains(found_d), "round {round}, {at}: {found_d}");
        }
        assert!(with_surfaces || here == 0, "round {round}: {here} pixels differ");
        assert!(found_near == was_near || here > 0, "round {round}: {found_near}");
        apart += here;
        pixels += dioptres.len();
        solid += canvas.dioptres().iter().filter(|d| **d > 0.0).count();
        limited += usize::from(was_near);
    }
    println!("{apart} of {pixels} pixels differ, {solid} have a distance, {limited} frames had near content");
    assert!(apart * 2000 < pixels && solid * 4 > pixels && limited > 50);
}

/// Layers without texels to see, and texels that a device cannot read, are no fault of the device.
#[test]
#[ignore = "another test runs it with the validation layer"]
fn odd_layers() {
    let Some(wanted) = first_device() else { return };
    let own = Own::open(wanted).unwrap();
    let frustum = Frustum { size: [3, 5], angle: 0.1 };
    let shape = Shape { frustum, colors: [true; 3], nearest: 1.0 };
    let target = Target::host(&own, shape.bytes()[0]).unwrap();
    let mut composer = Composer::new(&own, shape, target).unwrap();
    let white = Image { format: Format::Rgba8 { srgb: false }, size: [1, 1], stride: 4, bytes: vec![255; 4] };
    let alpha = Alpha { blends: false, unpremultiplied: false, inverted: false };
    let pose = Pose::new([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -2.0]);
    let (flat, nowhere) = (Quad::new(&pose, [0.0, 1.0]), Cylinder::new(&pose, 1.0, 0.0, 1.0));
    let none = [0.2; 4];
    let view = |edges| SeenPlace::View { edges, depth: None, dioptres: 0.5 };
    let places = [SeenPlace::Quad(&flat), SeenPlace::Cylinder(&nowhere), view(none), view([f64::NAN; 4])];
    let seen: Vec<Seen<'_>> =
        (0..40).map(|i| Seen { color: white.texels(), alpha, place: places[i % places.len()] }).collect();
    assert!(!composer.compose(0, &seen).unwrap());
    let (light, dioptres) = composer.samples();
    assert!(light.iter().chain(dioptres).all(|v| *v == 0.0));
    // The device has another UUID, or the display another slot.
    assert!(matches!(Own::open(DeviceIds { device: *b"no such device..", ..wanted }), Err(Fault::Device)));
    let memory = Memory::new(&own, shape.bytes()[0] + 300, Use::Readback).unwrap();
    let mut composer = Composer::new(&own, shape, Target::Slots { memory, stride: 300 }).unwrap();
    assert!(composer.samples().0.is_empty());
    assert!(matches!(composer.compose(2, &seen), Err(Fault::Size { .. })));
    assert!(matches!(composer.compose(usize::MAX, &seen), Err(Fault::Size { .. })));
    let rows = Shape { frustum: Frustum { size: [65_536, 1], angle: 0.1 }, ..shape };
    let target = Target::host(&own, rows.bytes()[0]).unwrap();
    assert!(matches!(Composer::new(&own, rows, target), Err(Fault::Rows { .. })));
    // The shared memory does not have the size that its layout states.
    let good = Layout { memory_bytes: 4096, buffer_bytes: 4096, memory_type: 0, usage: USAGE.as_raw() };
    let wrong = [
        Layout { memory_bytes: 4, ..good },
        Layout { buffer_bytes: 0, ..good },
        Layout { memory_type: 31, ..good },
        Layout { usage: 0, ..good },
    ];
    for layout in wrong {
        let memfd = rustix::fs::memfd_create("few", rustix::fs::MemfdFlags::CLOEXEC).unwrap();
        assert!(matches!(Memory::import(&own, memfd, &layout), Err(Fault::Memory { .. })), "{layout:?}");
    }
}

#[test]
fn odd_layers_are_no_fault() {
    validated("odd_layers");
}
