//! The kernels `decode_views` and `halve_views` on the device against their CPU twins and the host's pyramid, and
//! engines that use the resulting views on the device. The validation layer has no messages.

use eyebox::low_level::engine::EngineError;
use eyebox::low_level::engine::vulkan::{NoLight, StoredViews, ViewDecoder, VulkanEngine};
use eyebox::low_level::gpu::Gpu;
use eyebox::low_level::optics::{Color, Display, Padding, Pupil};
use eyebox::low_level::scene::{Pyramid, ViewGrid};
use eyebox::low_level::solve::{Problem, RefineSettings, Refiner};
use eyebox_kernels::decode_views::{self, Args, F16, F32, U8, U16, decode_views};
use eyebox_kernels::halve_views::{self, halve_views};
use eyebox_tests::both::{Noise, gpu};
use std::sync::{Arc, PoisonError};

const GRID: [usize; 2] = [2, 3];

/// Returns this number of samples, filled to whole words.
fn samples(count: usize, sample: u32, seed: u64) -> Vec<u8> {
    let mut noise = Noise::new(seed);
    let one = |_| match sample {
        U8 => vec![(noise.draw() * 255.9) as u8],
        U16 => ((noise.draw() * 65_535.9) as u16).to_le_bytes().to_vec(),
        // Halves from 0 to 2, with subnormal ones.
        F16 => ((noise.draw() * 16_384.0) as u16).to_le_bytes().to_vec(),
        _ => (noise.draw() * 7.0).to_le_bytes().to_vec(),
    };
    let mut bytes: Vec<u8> = (0..count).flat_map(one).collect();
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

pub(crate) fn silent(gpu: Gpu) {
    let messages = gpu.messages();
    drop(gpu);
    let heard = messages.lock().unwrap_or_else(PoisonError::into_inner);
    assert!(heard.is_empty(), "messages of the validation layer:\n{}", heard.join("\n"));
}

/// Returns the largest difference of whole numbers, and the share of them that differ.
fn apart(one: &[u16], other: &[u16]) -> (u16, f64) {
    assert_eq!(one.len(), other.len());
    let off = one.iter().zip(other).map(|(a, b)| a.abs_diff(*b));
    (off.clone().max().unwrap_or(0), off.filter(|d| *d > 0).count() as f64 / one.len() as f64)
}

#[test]
fn views_are_decoded_as_the_twins_and_the_host_do() {
    let gpu = gpu();
    let kinds = [(U8, false), (U8, true), (U16, false), (U16, true), (F16, false), (F32, false)];
    let curve = decode_views::curve();
    for [height, width] in [[1, 1], [7, 13], [45, 64], [130, 101]] {
        for (stored, channels) in [(1, &[0][..]), (3, &[0, 2][..])] {
            let (pixels, count) = (height * width, GRID[0] * GRID[1]);
            let most = (4 * pixels * count * stored) as u64;
            let mut decoder = ViewDecoder::new(&gpu, [height, width], stored, channels, most).expect("a decoder");
            for (sample, coded) in kinds {
                let what = format!("{height} x {width}, {stored} colors, sample {sample}, {coded}");
                let bytes = samples(pixels * count * stored, sample, 7 + u64::from(sample));
                let views = StoredViews { grid: GRID, sample, coded, planar: false };
                decoder.upload(&bytes).expect("room");
                let lights = decoder.measure(&views).expect("measured").expect("all of it is light");
                let pyramids = decoder.decode(&views, &lights).expect("decoded");
                for ((channel, light), pyramid) in channels.iter().zip(&lights).zip(&pyramids) {
                    let mut args = Args {
                        pixels: pixels as u32,
                        channels: stored as u32,
                        channel: *channel as u32,
                        sample,
                        coded: u32::from(coded),
                        first: 0,
                        stride: 0,
                        scale: 0.0,
                    };
                    let floats = |view| -> Vec<f32> {
                        let light = |pixel| decode_views::light(&args, &bytes, &curve, view, pixel).expect("light");
                        (0..pixels).map(light).collect()
                    };
                    let all: Vec<Vec<f32>> = (0..count).map(floats).collect();
                    let exact = |power: i32, views: &[Vec<f32>]| {
                        let sum = views.iter().flatten().map(|v| f64::from(*v).powi(power)).sum::<f64>();
                        sum / (pixels * views.len()) as f64
                    };
                    let near = |found: f64, exact: f64| (found - exact).abs() <= 2e-6 * exact;
                    assert!(near(light.mean, exact(1, &all)), "{what}: {light:?}");
                    let middle = &all[count / 2..][..1];
                    assert!((0..3).all(|i| near(light.middle[i], exact(i as i32 + 1, middle))), "{what}: {light:?}");
                    args.scale = light.brightest;
                    let wanted = Pyramid::new(&all, height, width);
                    assert!(near(f64::from(light.brightest), f64::from(wanted.scale)), "{what}");
                    let found = pyramid.on_host().expect("read");
                    assert_eq!((found.scale, found.count), (light.brightest, count));
                    for (at, (found, wanted)) in found.levels.iter().zip(&wanted.levels).enumerate() {
                        let (most, share) = apart(&found.views, &wanted.views);
                        // These are rounded twice, so ties of a half, a quarter or an eighth may round either way.
                        assert!(most <= 1 && share < 0.3, "{what}, level {at}: {most}, {share}");
                    }
                    let mut twin = vec![0; pixels * count];
                    for (view, values) in twin.chunks_exact_mut(pixels).enumerate() {
                        decode_views(&args, &bytes, &curve, view, values, &mut [0; decode_views::SUMS]);
                    }
                    let (most, share) = apart(&found.levels[0].views, &twin);
                    assert!(most <= 1 && share < 1e-3, "{what}, the twin: {most}, {share}");
                    for pair in found.levels.windows(2) {
                        let [finer, coarser] = [0, 1].map(|i| (pair[i].height, pair[i].width));
                        let (args, [rows, columns]) = halve_views::Args::between(finer, coarser, 0);
                        let sizes = [0, 1].map(|i| pair[i].height * pair[i].width);
                        let mut twin = vec![0; sizes[1]];
                        for (from, to) in pair[0].views.chunks_exact(sizes[0]).zip(pair[1].views.chunks_exact(sizes[1]))
                        {
                            halve_views(&args, from, &rows, &columns, &mut twin);
                            let (most, share) = apart(to, &twin);
                            assert!(most <= 1 && share < 1e-3, "{what}, halved: {most}, {share}");
                        }
                    }
                }
            }
        }
    }
    silent(gpu);
}

#[test]
fn what_is_no_light_is_found() {
    let gpu = gpu();
    let (pixels, count, stored) = (7 * 13, 6, 3);
    let mut decoder =
        ViewDecoder::new(&gpu, [7, 13], stored, &[0, 1, 2], (4 * pixels * count * stored) as u64).unwrap();
    let mut found = |sample: u32, at: usize, bits: u32| {
        let mut bytes = samples(pixels * count * stored, sample, 3);
        let size = if sample == F32 { 4 } else { 2 };
        bytes[at * size..][..size].copy_from_slice(&bits.to_le_bytes()[..size]);
        decoder.upload(&bytes).unwrap();
        decoder.measure(&StoredViews { grid: GRID, sample, coded: false, planar: false }).unwrap()
    };
    let (view, pixel, channel) = (4, 50, 1);
    let at = (view * pixels + pixel) * stored + channel;
    for (sample, bits, value) in [
        (F32, f32::NAN.to_bits(), f32::NAN),
        (F32, 0xff80_0000, f32::NEG_INFINITY),
        (F32, 0x8000_0001, -f32::from_bits(1)),
        (F32, 65_505.0f32.to_bits(), 65_505.0),
        (F16, 0x7c00, f32::INFINITY),
        (F16, 0x8001, -5.960_464_5e-8),
    ] {
        let NoLight { channel: of, index, found } = found(sample, at, bits).unwrap_err();
        assert_eq!((of, index), (channel, view * pixels + pixel), "{sample} {bits:x}");
        assert!(found.to_bits() == value.to_bits() || found.is_nan() && value.is_nan(), "{found} {value}");
    }
    assert!(found(F32, at, 0x8000_0000).is_ok() && found(F16, at, 0x8000).is_ok(), "zero is light, with any sign");
    // These requests are beyond the samples.
    let all = StoredViews { grid: [3, 3], sample: F32, coded: false, planar: false };
    assert!(matches!(decoder.measure(&all), Err(EngineError::Mismatch { .. })));
    assert!(decoder.upload(&vec![0; 4 * pixels * count * stored + 4]).is_err() && decoder.upload(&[0; 5]).is_err());
    drop(decoder);
    silent(gpu);
}

/// A refinement follows views that were never on the host in the same way as views from the host, and uploads nothing
/// for them.
#[test]
fn engines_look_at_views_where_they_are() {
    let gpu = gpu();
    let display = Display { height: 48, width: 64, ..Display::preset("paper").expect("a preset") };
    let views = ViewGrid { rows: GRID[0], columns: GRID[1], cell: display.eyebox_min() / 3.0 };
    let outline = Problem::outline(&display, Color::Green, Padding::default(), views).expect("a problem");
    let (pixels, count) = (48 * 64, 6);
    let mut decoder = ViewDecoder::new(&gpu, [48, 64], 1, &[0], (4 * pixels * count) as u64).expect("a decoder");
    let stored = StoredViews { grid: GRID, sample: U8, coded: true, planar: false };
    let mut frame = |seed: u64| {
        decoder.upload(&samples(pixels * count, U8, seed)).expect("room");
        let lights = decoder.measure(&stored).expect("measured").expect("light");
        let pyramid = decoder.decode(&stored, &lights).expect("decoded").remove(0);
        Problem { pyramid, mean: lights[0].mean, ..outline.clone() }
    };
    let first = frame(1);
    let phases: Vec<f32> = (0..8 * pixels).map(|i| (i * 37 % 101) as f32 * 0.06).collect();
    let refiner = |problem: &Problem| {
        let engine = Box::new(VulkanEngine::new(&gpu).expect("an engine"));
        Refiner::new(problem.clone(), &phases, 0.4, RefineSettings::default(), engine).expect("a refinement")
    };
    let host = |problem: &Problem| Problem { pyramid: problem.pyramid.on_host().expect("read"), ..problem.clone() };
    let (mut one, mut other) = (refiner(&first), refiner(&host(&first)));
    let pupil = Pupil { x: 0.5e-3, y: 0.0, diameter: 4e-3, depth: 0.0 };
    let mut made = Vec::new();
    for seed in 2..8 {
        let before = gpu.counts();
        let problem = frame(seed);
        let decoded = gpu.counts().since(before);
        let before = gpu.counts();
        one.follow(problem.clone(), 0.4).expect("followed");
        let followed = gpu.counts().since(before);
        assert_eq!((followed.uploaded, followed.read_back, followed.blocks), (0, 0, 0));
        // The upload is the frame itself. The host reads back sums, and at most the middle view.
        assert_eq!(decoded.uploaded, (pixels * count) as u64);
        assert!(decoded.read_back < (2 * pixels + 4096) as u64, "{decoded:?}");
        made.push(decoded.blocks);
        other.follow(host(&problem), 0.4).expect("followed");
        let (seen, wanted) = (one.look(&[pupil]).expect("looked"), other.look(&[pupil]).expect("looked"));
        assert_eq!(format!("{seen:?}"), format!("{wanted:?}"));
        let (a, b) = (one.step().expect("a step"), other.step().expect("a step"));
        assert!(a.is_finite() && a == b, "{a} {b}");
    }
    // One set of views is in use while the next is made. After that, the same two sets are used again.
    assert_eq!(made[2..], [0; 4], "{made:?}");
    let _ = Arc::clone(&first.pyramid);
    drop((one, other, decoder));
    silent(gpu);
}
