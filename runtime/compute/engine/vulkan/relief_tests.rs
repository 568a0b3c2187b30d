//! Compares the kernels of reliefs on the device with their twins.

use super::decode::{NoLight, ViewDecoder};
use super::relief::{DeviceRelief, StoredDepths};
use crate::engine::EngineError;
use crate::gpu::Gpu;
use crate::gpu::test_options::watched;
use eyebox_kernels::decode_views::{self, F16, F32, U8, U16, curve};
use eyebox_kernels::relief::{Args, COLORS};
use eyebox_kernels::relief_close::relief_close;
use eyebox_kernels::relief_decode::{self, START, of_ordered, relief_decode};
use eyebox_kernels::relief_draw::{pieces, relief_draw};
use eyebox_kernels::relief_levels::{Levels, WORDS, blocks, relief_levels};
use eyebox_kernels::relief_surfaces::Surfaces;
use eyebox_kernels::relief_unmix::VALUES as FRINGE;
use std::sync::PoisonError;

/// A frame of an application.
struct Frame {
    size: [usize; 2],
    channels: usize,
    samples: Vec<u8>,
    stored: StoredDepths,
}

/// Makes random numbers from 0 to 1.
fn random(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}

impl Frame {
    /// Returns discs at several depths before a slanted ground. Outlines are mixed in the colors, and soft in the
    /// depths.
    fn discs(size: [usize; 2], channels: usize, sample: u32, seed: u64) -> Self {
        let [height, width] = size;
        let mut any = random(seed);
        let discs: Vec<[f32; 7]> = (0..5)
            .map(|i| {
                let [x, y] = [any() * width as f32, any() * height as f32];
                [x, y, 3.0 + any() * height as f32 / 4.0, 0.3 * i as f32, any(), any(), any()]
            })
            .collect();
        let (mut colors, mut depths) = (Vec::new(), Vec::new());
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let wave = 0.5 + 0.3 * (x as f32 * 0.7).sin() * (y as f32 * 0.4).cos();
            let (mut color, mut depth) = ([wave, 0.8 * wave, 1.0 - wave], -0.4 + 0.2 * x as f32 / width as f32);
            for [cx, cy, radius, dioptres, r, g, b] in &discs {
                let share = (radius - (x as f32 - cx).hypot(y as f32 - cy) + 0.5).clamp(0.0, 1.0);
                color.iter_mut().zip([r, g, b]).for_each(|(c, of)| *c += share * (of - *c));
                depth += share * (dioptres - depth);
            }
            colors.extend_from_slice(&color[..channels]);
            depths.push(depth);
        }
        Self::of(size, channels, sample, &colors, &depths)
    }

    fn of(size: [usize; 2], channels: usize, sample: u32, colors: &[f32], depths: &[f32]) -> Self {
        let mut samples: Vec<u8> = match sample {
            U8 => colors.iter().map(|v| (v * 255.0) as u8).collect(),
            U16 => colors.iter().flat_map(|v| ((v * 65_535.0) as u16).to_le_bytes()).collect(),
            F16 => eyebox_kernels::half::pack(colors).iter().flat_map(|bits| bits.to_le_bytes()).collect(),
            _ => colors.iter().flat_map(|v| v.to_le_bytes()).collect(),
        };
        samples.resize(samples.len().next_multiple_of(64), 0);
        let place = samples.len() as u64;
        samples.extend(depths.iter().flat_map(|v| v.to_le_bytes()));
        let stored = StoredDepths { sample, coded: sample == U8, depths: place, per_dioptre: 3.0 };
        Self { size, channels, samples, stored }
    }

    /// Returns the picture by the twin, and the ends of its disparities.
    fn picture(&self, wanted: &[usize]) -> (Vec<f32>, [f32; 2]) {
        let pixels = self.size[0] * self.size[1];
        let args = relief_decode::Args {
            pixels: pixels as u32,
            channels: self.channels as u32,
            wanted: std::array::from_fn(|k| wanted[k.min(wanted.len() - 1)] as u32),
            sample: self.stored.sample,
            coded: u32::from(self.stored.coded),
            depths: (self.stored.depths / 4) as u32,
            per_dioptre: self.stored.per_dioptre,
        };
        let (mut picture, mut state) = (vec![9.0; (1 + COLORS) * pixels], START);
        relief_decode(&args, &self.samples, &curve(), &mut picture, &mut state);
        (picture, [state[2], state[3]].map(of_ordered))
    }
}

/// Returns the surfaces of a picture by the twins.
fn surfaces(size: [usize; 2], picture: &[f32], ends: [f32; 2], reach: f32) -> Surfaces {
    let (disparity, colors) = picture.split_at(size[0] * size[1]);
    Surfaces::of(size, colors, disparity, ends, reach)
}

fn silent(gpu: Gpu) {
    let messages = gpu.messages();
    drop(gpu);
    assert_eq!(*messages.lock().unwrap_or_else(PoisonError::into_inner), Vec::<String>::new());
}

/// Returns the share of values that differ by more than rounding, or that are no number.
fn different(one: &[f32], other: &[f32]) -> f64 {
    let is_same = |a: f32, b: f32| (a - b).abs() <= 1e-5 * b.abs().max(1.0);
    let count = one.iter().zip(other).filter(|(a, b)| !is_same(**a, **b)).count();
    count as f64 / one.len() as f64
}

/// Returns the values of all pixels in a block, which has planes of scalars and then the colors. Values after the last
/// pixel are arbitrary.
fn parts<'a>(args: &Args, scalars: usize, block: &'a [f32]) -> Vec<&'a [f32]> {
    let (plane, pixels) = (args.plane as usize, args.pixels());
    let planes = (0..scalars).map(|i| &block[i * plane..][..pixels]);
    planes.chain([&block[scalars * plane..][..3 * pixels]]).collect()
}

/// Returns the power of the difference in proportion to the power of the second picture.
fn apart(one: &[f32], other: &[f32]) -> f64 {
    let power = |v: f32| f64::from(v).powi(2);
    let difference: f64 = one.iter().zip(other).map(|(a, b)| power(a - b)).sum();
    difference / other.iter().map(|v| power(*v)).sum::<f64>().max(1e-30)
}

/// Reads the blocks of a relief, the levels last.
fn fetched_surfaces(decoder: &mut ViewDecoder, room: &DeviceRelief, args: &Args) -> [Vec<f32>; 4] {
    let [down, across] = blocks(args);
    let lengths = [args.values(), FRINGE * args.plane as usize, args.values(), WORDS * down * across];
    let [a, b, c, d] = room.surfaces();
    [(a, 0), (b, 1), (c, 2), (d, 3)].map(|(block, i)| {
        let mut found = vec![0.0f32; lengths[i]];
        let bytes = 4 * found.len() as u64;
        decoder.gpu.fetch(block, bytemuck::cast_slice_mut(&mut found), [(0, 0, bytes)]).unwrap();
        found
    })
}

const PLACES: [[f32; 2]; 6] = [[0.0, 0.0], [1.5, 0.0], [0.0, -1.5], [1.0, 1.5], [-1.5, 0.7], [-0.3, -1.2]];

/// Sizes, stored colors, types of samples, and the indices of the display's colors.
const CASES: [([usize; 2], usize, u32, &[usize]); 6] = [
    ([1, 1], 1, F32, &[0]),
    ([3, 40], 3, U16, &[0, 1, 2]),
    ([61, 45], 3, U8, &[2, 0, 1]),
    ([64, 96], 1, F16, &[0]),
    ([90, 130], 2, F32, &[1, 0]),
    ([200, 310], 3, F32, &[0, 1, 2]),
];

#[test]
fn surfaces_and_views_are_those_of_the_twins() {
    let gpu = Gpu::open(&watched()).unwrap();
    for (i, (size, channels, sample, wanted)) in CASES.into_iter().enumerate() {
        let frame = Frame::discs(size, channels, sample, 3 + i as u64);
        let (picture, ends) = frame.picture(wanted);
        let reach = 1.5;
        let twin = surfaces(size, &picture, ends, reach);
        let (pixels, count) = (size[0] * size[1], PLACES.len());
        let mut decoder =
            ViewDecoder::new(&gpu, size, channels, wanted, (4 * channels * count * pixels) as u64).unwrap();
        let mut room = DeviceRelief::default();
        decoder.upload_depths(&mut room, &frame.samples).unwrap();
        assert_eq!(decoder.read_depths(&mut room, &frame.stored).unwrap(), Ok(ends), "{size:?}");
        let views = decoder.draw_depths(&mut room, (&PLACES, reach), [2, 3]).unwrap();
        let fetched = fetched_surfaces(&mut decoder, &room, &twin.args);
        let blocks = [&twin.front, &twin.fringe, &twin.hidden];
        for ((found, wanted), scalars) in fetched.iter().zip(blocks).zip([1, 2, 1]) {
            // A pixel whose color is at the limit of a mixture may be on its other side, and a mirror image may be at
            // the next pixel.
            let parts = parts(&twin.args, scalars, found).into_iter().zip(parts(&twin.args, scalars, wanted));
            for (i, (found, wanted)) in parts.enumerate() {
                let share = different(found, wanted);
                assert!(share < 2e-3, "{share} of part {i} in {size:?}");
            }
        }
        let mut marks = vec![9; fetched[3].len()];
        relief_levels(&twin.args, &Levels::new(ends, reach), &fetched[0], &fetched[1], &fetched[2], &mut marks);
        let found: Vec<u32> = fetched[3].iter().map(|word| word.to_bits()).collect();
        assert!(marks == found, "levels of blocks in {size:?}");
        let drawn = pieces(&twin);
        let mut found = vec![0.0f32; channels * count * pixels];
        let bytes = 4 * found.len() as u64;
        decoder.gpu.fetch(&decoder.samples, bytemuck::cast_slice_mut(&mut found), [(0, 0, bytes)]).unwrap();
        for (view, place) in PLACES.iter().enumerate() {
            let seen = relief_close(size, &relief_draw(&twin.args, &drawn, *place), *place);
            for (color, channel) in wanted.iter().enumerate() {
                let found = &found[(channel * count + view) * pixels..][..pixels];
                let error = apart(found, &seen[color]);
                assert!(error < 1e-5, "view {view}, color {color} in {size:?}: {error:e}");
            }
        }
        let lights = decoder.measure(&views).unwrap().unwrap();
        assert!(lights.iter().all(|light| light.mean > 0.1 || pixels < 200), "{lights:?}");
    }
    silent(gpu);
}

/// Noise has many pieces in every pixel, and most pixels are on both sides of tears.
#[test]
fn a_map_of_noise_is_drawn_as_by_the_twin() {
    let gpu = Gpu::open(&watched()).unwrap();
    let size = [40, 56];
    let mut any = random(11);
    let depths: Vec<f32> = (0..40 * 56).map(|_| 1.6 * any() - 0.8).collect();
    let colors: Vec<f32> = (0..3 * 40 * 56).map(|_| any()).collect();
    let frame = Frame::of(size, 3, F32, &colors, &depths);
    let (picture, ends) = frame.picture(&[0, 1, 2]);
    let twin = surfaces(size, &picture, ends, 1.5);
    let mut decoder = ViewDecoder::new(&gpu, size, 3, &[0, 1, 2], (4 * 3 * 6 * 40 * 56) as u64).unwrap();
    let mut room = DeviceRelief::default();
    decoder.upload_depths(&mut room, &frame.samples).unwrap();
    decoder.read_depths(&mut room, &frame.stored).unwrap().unwrap();
    decoder.draw_depths(&mut room, (&PLACES, 1.5), [2, 3]).unwrap();
    let mut found = vec![0.0f32; 3 * 6 * 40 * 56];
    let bytes = 4 * found.len() as u64;
    decoder.gpu.fetch(&decoder.samples, bytemuck::cast_slice_mut(&mut found), [(0, 0, bytes)]).unwrap();
    let drawn = pieces(&twin);
    for (view, place) in PLACES.iter().enumerate() {
        let seen = relief_close(size, &relief_draw(&twin.args, &drawn, *place), *place);
        let error = apart(&found[view * 40 * 56..][..40 * 56], &seen[0]);
        assert!(error < 1e-4, "view {view}: {error:e}");
    }
    drop((room, decoder));
    silent(gpu);
}

#[test]
fn invalid_values_are_found() {
    let gpu = Gpu::open(&watched()).unwrap();
    let size = [20, 30];
    let mut decoder = ViewDecoder::new(&gpu, size, 2, &[0, 1], 4 * 2 * 600).unwrap();
    let mut room = DeviceRelief::default();
    let stored = StoredDepths { sample: F32, coded: false, depths: 4800, per_dioptre: 1.0 };
    assert!(matches!(decoder.read_depths(&mut room, &stored), Err(EngineError::Mismatch { .. })), "nothing was stored");
    for (wrong_color, wrong_depth) in
        [(Some((77, -1.0f32)), None), (Some((903, f32::NAN)), Some((5, 200.0f32))), (None, Some((411, f32::NAN)))]
    {
        let (mut colors, mut depths) = (vec![0.5; 1200], vec![0.1; 600]);
        wrong_color.into_iter().for_each(|(at, value): (usize, f32)| colors[at] = value);
        wrong_depth.into_iter().for_each(|(at, value): (usize, f32)| depths[at] = value);
        for sample in [F32, F16] {
            let frame = Frame::of(size, 2, sample, &colors, &depths);
            decoder.upload_depths(&mut room, &frame.samples).unwrap();
            let NoLight { channel, index, found } = decoder.read_depths(&mut room, &frame.stored).unwrap().unwrap_err();
            let (at, value) = match wrong_color {
                Some((at, value)) => ((at % 2, at / 2), value),
                None => wrong_depth.map(|(at, value)| ((2, at), value)).unwrap(),
            };
            assert_eq!((channel, index), at);
            assert!(found == value || found.is_nan() && value.is_nan(), "{found} {value}");
            assert!(matches!(
                decoder.draw_depths(&mut room, (&PLACES, 1.5), [2, 3]),
                Err(EngineError::Mismatch { .. })
            ));
        }
    }
    // The depths would be behind the end of the frame.
    let far = StoredDepths { depths: 1 << 20, ..stored };
    assert!(matches!(decoder.read_depths(&mut room, &far), Err(EngineError::Mismatch { .. })));
    let whole = Frame::discs(size, 2, decode_views::U8, 1);
    decoder.upload_depths(&mut room, &whole.samples).unwrap();
    decoder.read_depths(&mut room, &whole.stored).unwrap().unwrap();
    // More views than the decoder was made for, and places that are no grid.
    assert!(matches!(decoder.draw_depths(&mut room, (&PLACES, 1.5), [2, 3]), Err(EngineError::Mismatch { .. })));
    assert!(matches!(decoder.draw_depths(&mut room, (&PLACES[..1], 1.5), [1, 2]), Err(EngineError::Mismatch { .. })));
    decoder.draw_depths(&mut room, (&PLACES[..1], 1.5), [1, 1]).unwrap();
    drop((room, decoder));
    silent(gpu);
}
