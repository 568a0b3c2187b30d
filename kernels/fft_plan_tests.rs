//! Checks that plans stay within their limits, and that their passes compute the transform, without a device.

use super::*;
use rustfft::num_complex::Complex32;

const SOFTWARE: PlanLimits = PlanLimits { shared_bytes: 32768, invocations: 1024 };
const LARGE: PlanLimits = PlanLimits { shared_bytes: 49152, invocations: 1024 };
const SMALL: PlanLimits = PlanLimits { shared_bytes: 16384, invocations: 128 };

fn check(plan: &Plan, axis: Axis, limits: &PlanLimits) {
    let columns = axis == Axis::ColumnPairs;
    let product = |radices: &[Radix]| radices.iter().map(|r| r.size()).product::<u32>();
    match &plan.method {
        Method::Nothing => assert_eq!(plan.n, 1),
        Method::Shared(Shared { radices, counts, pair, threads, lines, slots }) => {
            assert_eq!(product(radices), plan.n, "{plan}");
            let units = plan.n / if *pair && !columns { 2 } else { 1 };
            assert!(*slots > (units - 1) + (units - 1) / 16, "{plan}");
            for (r, c) in radices.iter().zip(counts) {
                assert!(threads * c >= units / r.size(), "{plan}");
                assert!(c * r.size() <= 32, "{plan}: too many registers");
                assert!(columns || !pair || (plan.n / r.size()).is_multiple_of(2), "{plan}");
            }
            assert!(columns || !pair || radices[0].size().is_multiple_of(2), "{plan}");
            assert!(!columns || (*pair && lines.is_power_of_two()), "{plan}");
            assert!(*lines > 0 && threads * lines <= limits.invocations, "{plan}");
            assert!(plan.method_bytes() <= limits.shared_bytes, "{plan}");
        }
        Method::Passes { radices, .. } => assert_eq!(product(radices), plan.n, "{plan}"),
        Method::Bluestein { inner } => {
            assert!(inner.n >= 2 * plan.n - 1 && inner.n <= 4 * plan.n, "{plan}");
            assert!(!matches!(inner.method, Method::Bluestein { .. }), "{plan}");
            check(inner, axis, limits);
        }
    }
}

impl Plan {
    fn method_bytes(&self) -> u32 {
        if let Method::Shared(shared) = &self.method { shared.bytes() } else { 0 }
    }
}

/// Returns the largest prime factor.
fn prime(mut n: u32) -> u32 {
    let mut largest = 1;
    for p in 2.. {
        while n.is_multiple_of(p) {
            (n, largest) = (n / p, p);
        }
        if n == 1 {
            return largest;
        }
    }
    largest
}

#[test]
fn plans_make_up_their_length_within_the_limits() {
    for limits in [SOFTWARE, LARGE, SMALL] {
        for n in
            (1..700).chain([1080, 1920, 2048, 2160, 2464, 3125, 3840, 4095, 4096, 4160, 8192, 10_007, 32_749, LONGEST])
        {
            for axis in [Axis::Rows, Axis::Columns, Axis::ColumnPairs] {
                let plan = Plan::new(n, axis, &limits).unwrap();
                check(&plan, axis, &limits);
                assert_eq!(prime(n) > 13, matches!(plan.method, Method::Bluestein { .. }), "{plan}");
            }
        }
    }
    assert_eq!(Plan::new(0, Axis::Rows, &LARGE), None);
    assert_eq!(Plan::new(LONGEST + 1, Axis::Rows, &LARGE), None);
}

/// Returns the fewest factors up to 16, found by trying all.
fn fewest(n: u32) -> Option<u32> {
    if n == 1 {
        return Some(0);
    }
    (2..=LARGEST_RADIX).filter(|r| n.is_multiple_of(*r)).filter_map(|r| fewest(n / r)).min().map(|f| f + 1)
}

#[test]
fn no_plan_has_more_passes_than_it_must() {
    for n in (2..400).chain([1080, 1920, 2048, 2160, 2464, 3840, 4096, 4160]) {
        let plan = Plan::new(n, Axis::Columns, &SOFTWARE).unwrap();
        if let Method::Passes { radices, .. } = &plan.method {
            assert_eq!(Some(radices.len() as u32), fewest(n), "{plan}");
        }
    }
    for n in [1080, 1920, 2048, 2160, 2464] {
        assert_eq!(Plan::new(n, Axis::Rows, &SOFTWARE).unwrap().radices().len(), 3);
        assert!(matches!(
            Plan::new(n, Axis::Rows, &SOFTWARE).unwrap().method,
            Method::Shared(Shared { pair: true, .. })
        ));
    }
    assert!(matches!(Plan::new(4160, Axis::Rows, &SOFTWARE).unwrap().method, Method::Passes { .. }));
    assert!(matches!(Plan::new(4160, Axis::Rows, &LARGE).unwrap().method, Method::Shared(_)));
}

#[test]
fn plans_can_be_read() {
    let text = |n, axis| Plan::new(n, axis, &SOFTWARE).unwrap().to_string();
    assert_eq!(text(1, Axis::Columns), "1: nothing to do");
    assert_eq!(text(1080, Axis::Columns), "1080: 12 10 9 through global memory");
    assert_eq!(text(97, Axis::Columns), "97: a convolution of length 196: 14 14 through global memory");
    assert_eq!(
        text(256, Axis::Rows),
        "256: 16 16 in shared memory, two by two, 8 invocations a line, 8 lines and 17544 bytes a workgroup"
    );
}

fn dft(x: &[Complex64], sign: f64) -> Vec<Complex64> {
    let n = x.len();
    (0..n).map(|k| (0..n).map(|j| x[j] * Complex64::cis(sign * TAU * (j * k % n) as f64 / n as f64)).sum()).collect()
}

/// Runs the passes of the shaders, one butterfly after the other.
fn emulate(plan: &Plan, x: &mut Vec<Complex32>) {
    if let (Method::Bluestein { inner }, Some([chirp, filter])) = (&plan.method, plan.chirp()) {
        let value = |z: &[f32; 2]| Complex32::new(z[0], z[1]);
        let mut work: Vec<Complex32> = x.iter().zip(&chirp).map(|(x, c)| x * value(c)).collect();
        work.resize(inner.n as usize, Complex32::default());
        emulate(inner, &mut work);
        for (w, f) in work.iter_mut().zip(&filter) {
            *w = (*w * value(f)).conj();
        }
        emulate(inner, &mut work);
        for ((x, w), c) in x.iter_mut().zip(&work).zip(&chirp) {
            *x = w.conj() * value(c);
        }
        return;
    }
    let (table, starts) = plan.twiddles();
    let (n, mut s) = (plan.n as usize, 1);
    for (radix, start) in plan.radices().iter().zip(starts) {
        let (r, power) = (radix.size() as usize, radix.table_power() as usize);
        let mut to = vec![Complex32::new(f32::NAN, 0.0); n];
        for j in 0..n / r {
            let (block, rest) = (j / s, j % s);
            // This is the division of the shader.
            assert_eq!(((j as f32 + 0.5) * (1.0 / s as f32)) as usize, block, "{j} / {s}");
            let mut v: Vec<Complex32> = (0..r).map(|k| x[j + k * n / r]).collect();
            if s > 1 {
                let [a, b, c, d] = table[start as usize + rest];
                let (w, wp) = (Complex32::new(a, b), Complex32::new(c, d));
                for (k, v) in v.iter_mut().enumerate() {
                    *v *= wp.powu((k / power) as u32) * w.powu((k % power) as u32);
                }
            }
            let wide: Vec<Complex64> = v.iter().map(|z| Complex64::new(z.re.into(), z.im.into())).collect();
            for (k, z) in dft(&wide, -1.0).iter().enumerate() {
                to[block * s * r + rest + k * s] = Complex32::new(z.re as f32, z.im as f32);
            }
        }
        *x = to;
        s *= r;
    }
}

#[test]
fn the_passes_are_the_transform() {
    for n in [1, 2, 6, 7, 13, 16, 17, 26, 45, 64, 96, 97, 101, 121, 169, 225, 243, 360, 509, 625, 1080] {
        for axis in [Axis::Rows, Axis::Columns, Axis::ColumnPairs] {
            let plan = Plan::new(n, axis, &SOFTWARE).unwrap();
            let value = |i: u32, by: u32| ((i * by) % 1009) as f32 / 504.0 - 1.0;
            let mut x: Vec<Complex32> = (0..n).map(|i| Complex32::new(value(i + 1, 577), value(i + 3, 811))).collect();
            let wide: Vec<Complex64> = x.iter().map(|z| Complex64::new(z.re.into(), z.im.into())).collect();
            let want = dft(&wide, -1.0);
            emulate(&plan, &mut x);
            let error: f64 =
                x.iter().zip(&want).map(|(g, w)| (Complex64::new(g.re.into(), g.im.into()) - w).norm_sqr()).sum();
            let power: f64 = want.iter().map(|w| w.norm_sqr()).sum();
            assert!(error < 1e-13 * power, "{plan}: {:.1e}", error / power);
        }
    }
}

/// In the last pass every invocation writes the elements that it read, so the pass can run in place.
#[test]
fn last_passes_stay_in_place() {
    for n in [12, 96, 1080, 4160] {
        let radices: Vec<u32> =
            Plan::new(n, Axis::Columns, &SMALL).unwrap().radices().iter().map(|r| r.size()).collect();
        let r = *radices.last().unwrap();
        let s = n / r;
        for j in 0..n / r {
            assert_eq!(j / s * s * r + j % s, j);
            assert_eq!(s, n / r);
        }
    }
}

/// For any length, the rows of several sub-frames leave an invocation enough registers for its other values.
#[test]
fn rows_of_several_sub_frames_hold_little_each() {
    for n in (64..2200).step_by(2).filter(|n| prime(*n) <= 5) {
        let plan = Plan::new(n, Axis::Rows, &LARGE).unwrap();
        let Method::Shared(shared) = &plan.method else { continue };
        let Some(together) = shared.together(n, 8, &LARGE) else { continue };
        let Shared { radices, counts, threads, lines, .. } = &together.shared;
        let held = radices.iter().zip(counts).map(|(radix, count)| radix.size() * count);
        assert!(held.clone().max().unwrap() <= HELD, "{plan}: {together:?}");
        assert!(held.sum::<u32>() <= HELD_IN_ALL, "{plan}: {together:?}");
        assert!(counts.iter().filter(|count| **count > 1).count() <= 1, "{plan}: {together:?}");
        let units = if shared.pair { n / 2 } else { n };
        assert!(radices.iter().zip(counts).all(|(radix, count)| count * threads * radix.size() >= units), "{plan}");
        assert!(threads * lines <= TOGETHER, "{plan}");
    }
}
