//! The Vulkan engine's transforms against RustFFT in float64. The tests require a Vulkan device (a software device is
//! sufficient) and the validation layer. `tools/setup.sh` installs both.

use eyebox::low_level::engine::Storage;
use eyebox::low_level::engine::vulkan::Transforms;
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox_kernels::Complex32;
use eyebox_kernels::fft::{Columns, Direction, transform_f64};
use eyebox_tests::both::{gpu, watched};
use eyebox_tests::half_roundings;
use rustfft::num_complex::Complex64;
use std::sync::PoisonError;

/// Largest allowed error power over signal power.
const ALLOWED: f64 = 2e-13;

/// Returns the bound for a storage. Passes that store halves round at most four times along each axis of the sizes
/// below, after the rounding of the input.
fn allowed(storage: Storage) -> f64 {
    match storage {
        Storage::F32 => ALLOWED,
        Storage::F16 => half_roundings(9),
    }
}

fn open() -> Transforms {
    Transforms::new(&gpu()).unwrap_or_else(|e| panic!("{e}"))
}

fn noise(n: usize, mut seed: u64) -> Vec<Complex32> {
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    };
    (0..n).map(|_| Complex32::new(next(), next())).collect()
}

/// Transforms all rows and all columns of one frame in float64.
fn reference(frame: &[Complex32], (h, w): (usize, usize), direction: Direction) -> Vec<Complex64> {
    let mut data: Vec<Complex64> = frame.iter().map(|z| Complex64::new(z.re.into(), z.im.into())).collect();
    transform_f64(&mut data, w, direction);
    let mut turned: Vec<Complex64> = (0..h * w).map(|i| data[i % h * w + i / h]).collect();
    transform_f64(&mut turned, h, direction);
    (0..h * w).map(|i| turned[i % w * h + i / w]).collect()
}

struct Case {
    size: (usize, usize),
    frames: usize,
    columns: Columns,
    before: u64,
}

/// Compares both directions of one case.
fn compare(transforms: &mut Transforms, case: &Case) {
    let &Case { size: (h, w), frames, columns, before } = case;
    let in_use = |x: usize| (x + w - columns.first) % w < columns.count;
    let both = [Direction::Forward, Direction::Inverse].map(|d| Storage::ALL.map(|s| (d, s)));
    for (direction, storage) in both.into_iter().flatten() {
        transforms.store(storage);
        let mut data = noise(frames * h * w, (h * 7919 + w) as u64);
        if direction == Direction::Inverse {
            for (_, z) in data.iter_mut().enumerate().filter(|(i, _)| !in_use(i % w)) {
                *z = Complex32::new(0.0, 0.0);
            }
        }
        let given = data.clone();
        transforms.run(&mut data, (h, w), direction, columns, before).unwrap();
        for frame in 0..frames {
            let part = frame * h * w..(frame + 1) * h * w;
            let want = reference(&given[part.clone()], (h, w), direction);
            let (mut error, mut power) = (0.0, 1e-30);
            for (i, (got, want)) in data[part].iter().zip(&want).enumerate() {
                if direction == Direction::Forward && !in_use(i % w) {
                    continue;
                }
                error += (Complex64::new(got.re.into(), got.im.into()) - want).norm_sqr();
                power += want.norm_sqr();
            }
            let ratio = error / power;
            assert!(
                ratio < allowed(storage),
                "{h} x {w} {direction:?} frame {frame}, {storage:?}: error power {ratio:.1e} of signal power"
            );
            // The error of halves is larger than the error of float32, so this shows that halves were used.
            assert!(
                storage == Storage::F32 || h * w < 20 || columns.count == 0 || ratio > 1e-9,
                "{h} x {w}: {ratio:.1e}"
            );
        }
    }
    let messages = transforms.gpu().messages();
    let messages = messages.lock().unwrap_or_else(PoisonError::into_inner);
    assert!(messages.is_empty(), "{h} x {w}: messages of the validation layer:\n{}", messages.join("\n"));
}

fn whole(h: usize, w: usize) -> Case {
    Case { size: (h, w), frames: 1, columns: Columns::all(w), before: 0 }
}

#[test]
fn sizes_of_all_kinds() {
    let mut transforms = open();
    let sizes = [(1, 1), (1, 17), (17, 1), (7, 13), (45, 64), (64, 96), (121, 26), (97, 101), (1, 1021), (509, 3)];
    for (h, w) in sizes {
        compare(&mut transforms, &whole(h, w));
    }
}

#[test]
fn every_radix() {
    let mut transforms = open();
    for n in 2..=37 {
        compare(&mut transforms, &whole(n, 39 - n));
    }
}

#[test]
fn displays() {
    let mut transforms = open();
    for (h, w) in [(1080, 1920), (4160, 8), (8, 4160), (3, 8192), (2160, 24), (24, 3840), (2464, 10)] {
        compare(&mut transforms, &whole(h, w));
    }
}

#[test]
fn columns_in_use_may_wrap_and_frames_may_lie_anywhere() {
    let mut transforms = open();
    for (size, first, count) in [
        ((64, 96), 80, 30),
        ((45, 64), 10, 17),
        ((48, 50), 49, 2),
        ((30, 36), 5, 0),
        ((40, 40), 39, 40),
        ((97, 12), 7, 9),
    ] {
        let columns = Columns { first, count };
        compare(&mut transforms, &Case { size, frames: 3, columns, before: 4 * 1000 });
    }
}

/// The transform takes even columns, and up to one more on either side than are in use. Scratch for these columns alone
/// must have room for them.
#[test]
fn a_convolution_has_scratch_for_the_columns_beside() {
    let columns = Columns { first: 7, count: 8 };
    compare(&mut open(), &Case { size: (97, 12), frames: 3, columns, before: 0 });
}

/// Columns use shared memory, as on GPUs.
#[test]
fn columns_in_one_trip() {
    let options = Options { plan_as: Some(DeviceKind::Discrete), ..watched() };
    let mut transforms = Transforms::new(&Gpu::open(&options).unwrap_or_else(|e| panic!("{e}"))).unwrap();
    assert!(transforms.plans(1080, 96).unwrap()[1].contains("shared memory"));
    assert!(transforms.plans(1080, 95).unwrap()[1].contains("global memory"));
    for (h, w) in [(1, 16), (2, 6), (45, 64), (64, 96), (121, 26), (13, 10), (97, 12), (1080, 24), (2160, 8), (4160, 8)]
    {
        compare(&mut transforms, &whole(h, w));
    }
    for (size, first, count) in [((64, 96), 81, 30), ((45, 64), 11, 17), ((48, 50), 49, 2), ((40, 40), 39, 40)] {
        let columns = Columns { first, count };
        compare(&mut transforms, &Case { size, frames: 3, columns, before: 4 * 1000 });
    }
}

#[test]
fn transforms_recorded_on_a_grown_scratch_stay_right() {
    let mut transforms = open();
    for (frames, h, w) in [(1, 32, 32), (5, 96, 50), (2, 64, 64), (17, 128, 90)] {
        let columns = Columns { first: w / 2, count: w - 3 };
        compare(&mut transforms, &Case { size: (h, w), frames, columns, before: 256 });
    }
}

/// Convolutions take lines and frames in chunks that fit their scratch.
#[test]
fn large_primes_go_in_chunks() {
    let mut transforms = open();
    compare(&mut transforms, &whole(1030, 1021));
    let columns = Columns { first: 390, count: 120 };
    compare(&mut transforms, &Case { size: (4159, 400), frames: 2, columns, before: 0 });
}
