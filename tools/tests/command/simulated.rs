//! A bench without hardware, computed from the definitions of OPTICS 10 and without code of eyebox. It has sums over 5
//! x 5 sub-pixels, an iris, and a turned and mirrored camera with noise. The environment sets its faults.

use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};
use std::io::{BufRead, Write};

pub const N: usize = 64;
const P: usize = 5;
const CAMERA: usize = 88;
/// Size of the pupil plane in mm per nm of wavelength, for 400 mm and 8 um.
const EYEBOX_PER_NM: f64 = 0.05;
/// Size of the eyebox of the shortest wavelength, in mm.
const EYEBOX: f64 = 520.0 * EYEBOX_PER_NM;

type Complex = [f64; 2];

fn times(a: Complex, b: Complex) -> Complex {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

fn cis(phase: f64) -> Complex {
    [phase.cos(), phase.sin()]
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

/// Display and its camera. `Bench::faulty` has all faults of the model.
#[derive(Clone)]
pub struct Bench {
    pub level: [[f64; 3]; 3],
    /// Sign of the phase, which is -1 if higher levels advance the light.
    pub sign: f64,
    pub bend: [f64; 2],
    pub lag: f64,
    pub crosstalk: Option<[[f64; 2]; 4]>,
    pub fill: f64,
    pub source: [f64; 5],
    pub undiffracted: Vec<[f64; 5]>,
    pub zernike_4: f64,
    pub zernike_8: f64,
    pub iris: [f64; 3],
    /// Share of a second picture, moved by some pixels, that no term describes.
    pub ghost: f64,
    /// Lens of the camera as its magnification relative to the usual one, k1 and k2.
    pub lens: [f64; 3],
    /// Place and diameter of a fixed iris in mm, or `None` for an iris that moves.
    pub still: Option<[f64; 3]>,
    /// Memory shared with a display that shows the patterns. Without it, the patterns come in files.
    pub shared: Option<std::path::PathBuf>,
    /// Wavelength of the light that is on, in nm.
    pub nm: f64,
    /// Factor of the light. At 1, an intensity of 1 reaches full scale in 1 ms. At 0, the bench is dark.
    pub light: f64,
}

impl Bench {
    pub fn ideal() -> Self {
        Self {
            level: [[1.0; 3]; 3],
            sign: 1.0,
            bend: [0.0; 2],
            lag: 0.0,
            crosstalk: None,
            fill: 0.0,
            source: [0.0; 5],
            undiffracted: Vec::new(),
            zernike_4: 0.0,
            zernike_8: 0.0,
            iris: [0.0, 0.0, 1.0],
            ghost: 0.0,
            lens: [1.0, -0.006, 0.0],
            still: None,
            shared: None,
            nm: 520.0,
            light: 1.0,
        }
    }

    pub fn faulty() -> Self {
        Self {
            level: [[1.02, 1.05, 1.01], [0.99, 1.04, 1.03], [1.0, 1.06, 1.02]],
            bend: [0.1, -0.04],
            lag: 0.05,
            crosstalk: Some([[1.2, 2.2], [1.3, 2.0], [1.25, 2.4], [1.2, 1.9]]),
            fill: 0.95,
            source: [0.05, -0.03, -0.3, 0.02, -0.2],
            undiffracted: vec![[0.1, 0.15, 0.5, -0.5, 0.2], [0.05, -0.06, 4.0, -7.0, 0.4]],
            zernike_4: 0.03,
            zernike_8: -0.04,
            iris: [0.1, -0.08, 1.003],
            ..Self::ideal()
        }
    }

    /// Reads the bench from the environment.
    fn of_environment() -> Self {
        let named = |name: &str| std::env::var(name).ok();
        let mut bench = if named("BENCH_IDEAL").is_some() { Self::ideal() } else { Self::faulty() };
        let number = |name: &str| named(name).map(|v| v.parse::<f64>().expect("a number"));
        bench.ghost = number("BENCH_GHOST").unwrap_or(bench.ghost);
        bench.light = number("BENCH_LIGHT").unwrap_or(bench.light);
        bench.iris[0] = number("BENCH_IRIS_X").unwrap_or(bench.iris[0]);
        bench.sign = number("BENCH_SIGN").unwrap_or(bench.sign);
        let three = |name: &str| {
            let values: Vec<f64> = named(name)?.split(',').map(|v| v.parse().expect("a number")).collect();
            Some([values[0], values[1], values[2]])
        };
        bench.lens = three("BENCH_LENS").unwrap_or(bench.lens);
        bench.still = three("BENCH_STILL");
        bench.shared = named("BENCH_SHARED").map(Into::into);
        bench
    }

    /// Returns the crosstalk along an axis as (sub-pixel, pixel).
    fn blur(&self, below: usize, above: usize) -> Vec<Vec<f64>> {
        let count = N * P;
        let Some(sides) = self.crosstalk else {
            return (0..count).map(|i| (0..N).map(|j| f64::from(u8::from(i / P == j))).collect()).collect();
        };
        let line = |[q, sigma]: [f64; 2]| -> Vec<f64> {
            let transfer = |m: i64| {
                let k = m as f64 / N as f64;
                let order = |l: i64| {
                    sinc(k / P as f64 + l as f64).powi(2) * (-((k + (l * P as i64) as f64).abs() / sigma).powf(q)).exp()
                };
                (-12..=12).map(order).sum::<f64>()
            };
            let half = count as i64 / 2;
            let all: Vec<(i64, f64)> = (-half..half).map(|m| (m, transfer(m))).collect();
            let cosine: Vec<f64> = (0..count).map(|i| (TAU * i as f64 / count as f64).cos()).collect();
            let at =
                |n: usize| all.iter().map(|(m, t)| t * cosine[(m.rem_euclid(count as i64) as usize * n) % count]).sum();
            (0..count).map(at).collect()
        };
        let (below, above) = (line(sides[below]), line(sides[above]));
        let value = |n: usize| match n {
            0 => (below[0] + above[0]) / 2.0,
            n if n < count / 2 => above[n],
            n => below[n],
        };
        let kernel: Vec<f64> = (0..count).map(value).collect();
        let sum: f64 = kernel.iter().sum();
        let share = |i: usize, j: usize| (0..P).map(|s| kernel[(i + count - j * P - s) % count]).sum::<f64>() / sum;
        (0..count).map(|i| (0..N).map(|j| share(i, j)).collect()).collect()
    }

    /// Returns the phases that the pixels have reached, by sub-frame.
    fn settled(&self, levels: &[f32], frames: usize) -> Vec<Vec<f64>> {
        let place = |i: usize| (2 * i + 1) as f64 / N as f64 - 1.0;
        let hat = |x: f64, node: usize| (1.0 - (x - node as f64 + 1.0).abs()).max(0.0);
        let level = |i: usize| {
            let (y, x) = (place(i / N), place(i % N));
            (0..9).map(|j| self.level[j / 3][j % 3] * hat(y, j / 3) * hat(x, j % 3)).sum::<f64>()
        };
        let driven = |i: usize| {
            let w = self.sign * f64::from(levels[i]) * TAU / 256.0;
            level(i % (N * N)) * w + self.bend[0] * w.sin() + self.bend[1] * (1.0 - w.cos())
        };
        let all: Vec<f64> = (0..levels.len()).map(driven).collect();
        let norm = if self.lag == 0.0 { 1.0 } else { (1.0 - self.lag) / (1.0 - self.lag.powi(frames as i32)) };
        let at = |t: usize, i: usize| {
            let share = |k: usize| norm * self.lag.powi(k as i32) * all[(t + frames - k) % frames * N * N + i];
            (0..frames).map(share).sum()
        };
        (0..frames).map(|t| (0..N * N).map(|i| at(t, i)).collect()).collect()
    }

    /// Returns the light of the bins around the iris, row by row. It is 0 in bins that the iris blocks.
    fn passed(&self, phases: &[f64], blurs: &[Vec<Vec<f64>>; 2], iris: [f64; 3]) -> Vec<Vec<Complex>> {
        let bin = self.nm * EYEBOX_PER_NM / N as f64;
        let scale = self.iris[2];
        let [x, y, d] = [iris[0] * scale + self.iris[0], iris[1] * scale + self.iris[1], iris[2] * scale];
        let place = |i: usize| (2 * i + 1) as f64 / N as f64 - 1.0;
        let s = self.source;
        let amplitude = |i: usize| {
            let (y, x) = (place(i / N), place(i % N));
            (s[0] * x + s[1] * y + s[2] * x * x + s[3] * x * y + s[4] * y * y).exp()
        };
        let a: Vec<f64> = (0..N * N).map(amplitude).collect();
        let rms = (a.iter().map(|a| a * a).sum::<f64>() / a.len() as f64).sqrt();
        let still = |[py, px]: [f64; 2]| {
            let of = |u: &[f64; 5]| times([u[0], u[1]], cis(u[2] * px + u[3] * py + u[4] * (px * px + py * py)));
            self.undiffracted.iter().map(of).fold([0.0; 2], |sum, v| [sum[0] + v[0], sum[1] + v[1]])
        };
        let share = (1.0 - self.undiffracted.iter().map(|u| u[0] * u[0] + u[1] * u[1]).sum::<f64>()).sqrt();
        let side = N * P;
        // The sum along x is first, with the result (pixel row, sub-pixel column).
        let wide: Vec<Vec<f64>> = phases
            .chunks_exact(N)
            .map(|row| blurs[1].iter().map(|b| b.iter().zip(row).map(|(b, v)| b * v).sum()).collect())
            .collect();
        let half = N as i64 / 2;
        let range = |centre: f64| {
            let reach = |v: f64| (v / bin).round() as i64;
            (reach(centre - d / 2.0).max(-half), reach(centre + d / 2.0).min(half - 1))
        };
        let ((low_y, high_y), (low_x, high_x)) = (range(y), range(x));
        let waves: Vec<Complex> = (0..side).map(|i| cis(-TAU * i as f64 / side as f64)).collect();
        let wave = |k: i64, i: usize| waves[(k.rem_euclid(side as i64) as usize * i) % side];
        let mut rows = vec![vec![[0.0; 2]; side]; (high_y - low_y + 1) as usize];
        for (i, blur) in blurs[0].iter().enumerate() {
            let field: Vec<Complex> = (0..side)
                .map(|j| {
                    let w: f64 = blur.iter().zip(&wide).map(|(b, row)| b * row[j]).sum();
                    let pixel = i / P * N + j / P;
                    let rest = still([i, j].map(|at| place(at / P)));
                    let on = cis(w);
                    [0, 1].map(|c| a[pixel] / rms * (share * on[c] + rest[c]))
                })
                .collect();
            for (row, ky) in rows.iter_mut().zip(low_y..) {
                let turn = wave(ky, i);
                row.iter_mut().zip(&field).for_each(|(sum, v)| {
                    let v = times(*v, turn);
                    *sum = [sum[0] + v[0], sum[1] + v[1]];
                });
            }
        }
        let aperture = |k: i64| {
            let k = k as f64 / N as f64;
            let have = if k == 0.0 { 1.0 } else { (PI * k).sin() / (P as f64 * (PI * k / P as f64).sin()) };
            let value = sinc(self.fill * k) / have;
            let turn = cis(PI * k * (P - 1) as f64 / P as f64);
            [value * turn[0], value * turn[1]]
        };
        rows.iter()
            .zip(low_y..)
            .map(|(row, ky)| {
                let value = |kx: i64| {
                    let (py, px) = (ky as f64 * bin, kx as f64 * bin);
                    if (py - y).powi(2) + (px - x).powi(2) >= d * d / 4.0 {
                        return [0.0; 2];
                    }
                    let sum = row.iter().enumerate().fold([0.0; 2], |s, (j, v)| {
                        let v = times(*v, wave(kx, j));
                        [s[0] + v[0], s[1] + v[1]]
                    });
                    let (ry, rx) = (2.0 * py / EYEBOX, 2.0 * px / EYEBOX);
                    let rho2 = ry * ry + rx * rx;
                    let waves = self.zernike_4 * 3f64.sqrt() * (2.0 * rho2 - 1.0)
                        + self.zernike_8 * 8f64.sqrt() * (3.0 * rho2 - 2.0) * rx;
                    let value = times(times(sum, cis(TAU * waves)), times(aperture(ky), aperture(kx)));
                    value.map(|v| v / (P * P * N) as f64)
                };
                (low_x..=high_x).map(value).collect()
            })
            .collect()
    }

    /// Returns the intensity at the camera's pixels.
    fn seen(&self, levels: &[f32], frames: usize, iris: [f64; 3]) -> Vec<f64> {
        if self.light == 0.0 {
            return vec![0.0; CAMERA * CAMERA];
        }
        let blurs = [self.blur(0, 1), self.blur(2, 3)];
        let settled = self.settled(levels, frames);
        let passed: Vec<_> = settled.iter().map(|phases| self.passed(phases, &blurs, iris)).collect();
        let light = |[x, y]: [f64; 2]| {
            let mut sum = 0.0;
            for rows in &passed {
                // The first bin changes only the phase.
                let (step_x, step_y) = (cis(TAU * x / N as f64), cis(TAU * y / N as f64));
                let mut v = [0.0; 2];
                for row in rows.iter().rev() {
                    let line = row.iter().rev().fold([0.0; 2], |s, bin| {
                        let s = times(s, step_x);
                        [s[0] + bin[0], s[1] + bin[1]]
                    });
                    v = times(v, step_y);
                    v = [v[0] + line[0], v[1] + line[1]];
                }
                sum += (v[0] * v[0] + v[1] * v[1]) / frames as f64;
            }
            sum
        };
        let pixel = |i: usize| {
            let mut sum = 0.0;
            for (dy, dx) in [(-0.25, -0.25), (-0.25, 0.25), (0.25, -0.25), (0.25, 0.25)] {
                let at = self.looks_at((i % CAMERA) as f64 + dx, (i / CAMERA) as f64 + dy);
                if at.iter().all(|v| (-0.5..N as f64 - 0.5).contains(v)) {
                    sum += light(at) / 4.0;
                    if self.ghost > 0.0 {
                        sum += self.ghost * light([at[0] - 3.3, at[1] + 2.1]) / 4.0;
                    }
                }
            }
            sum
        };
        (0..CAMERA * CAMERA).map(pixel).collect()
    }

    /// Inverts the camera's map. Returns the place on the SLM of a camera pixel, in pixels.
    fn looks_at(&self, x: f64, y: f64) -> [f64; 2] {
        let side = CAMERA as f64;
        let [u, v] = [x, y].map(|p| (2.0 * p + 1.0 - side) / side);
        // The map mirrors, turns and bends the picture, and adds perspective. Newton steps with a constant slope invert
        // it.
        let forth = |[x, y]: [f64; 2]| {
            let [zoom, k1, k2] = self.lens;
            let w = 0.01 * x - 0.006 * y + 1.0;
            let (u, v) = (zoom * (-0.9 * x + 0.02 * y + 0.01) / w, zoom * (0.02 * x + 0.9 * y - 0.008) / w);
            let r2 = u * u + v * v;
            let bent = 1.0 + k1 * r2 + k2 * r2 * r2;
            [u * bent, v * bent]
        };
        let mut at = [-u / 0.9, v / 0.9];
        for _ in 0..20 {
            let [a, b] = forth(at);
            at = [at[0] + (a - u) / 0.9, at[1] - (b - v) / 0.9];
        }
        at.map(|p| (p * N as f64 + N as f64 - 1.0) / 2.0)
    }
}

/// Serves a bench on standard input and output, and writes each requested picture to `asked.txt`.
pub fn serve() {
    let mut bench = Bench::of_environment();
    let wrong = std::env::var("BENCH_WRONG_PUPIL").ok();
    let mut random = fastrand::Rng::with_seed(7);
    let mut out = std::io::stdout();
    // This ends the line that the test harness has begun.
    writeln!(out).expect("written");
    for line in std::io::stdin().lock().lines() {
        let ask: Value = serde_json::from_str(&line.expect("a line")).expect("JSON");
        let id = ask["id"].clone();
        let answer = match ask["do"].as_str() {
            Some("hello") => {
                let mut hello = json!({"id": id, "protocol": 1, "name": "simulated", "colors": {"green": 520.0, "red": 638.0}, "focus_mm": [-5, 5],
                "slm": {"resolution": [N, N], "pitch_um": 8.0, "levels": 256, "sub_frames": 3},
                "camera": {"resolution": [CAMERA, CAMERA], "bits": 12, "auto_exposure": true, "dark": true}});
                if bench.still.is_none() {
                    hello["iris"] = json!({"x_mm": [-13, 13], "y_mm": [-13, 13], "diameter_mm": [0.5, 40]});
                }
                hello
            }
            Some("capture") => {
                bench.nm = ask["wavelength_nm"].as_f64().unwrap_or(bench.nm);
                capture(&bench, &ask, wrong.as_deref(), &mut random)
            }
            _ => json!({"id": id}),
        };
        writeln!(out, "{answer}").and_then(|()| out.flush()).expect("written");
        if ask["do"] == "bye" {
            return;
        }
    }
}

fn capture(bench: &Bench, ask: &Value, wrong: Option<&str>, random: &mut fastrand::Rng) -> Value {
    let asked = ask["out"].as_str().expect("a place");
    let log = std::fs::OpenOptions::new().create(true).append(true).open("asked.txt");
    writeln!(log.expect("a file"), "{asked}").expect("written");
    let mut iris = bench.still.unwrap_or([0, 1, 2].map(|i| ask["iris_mm"][i].as_f64().unwrap_or(0.0)));
    if wrong.is_some_and(|w| asked.ends_with(w)) {
        iris[0] += 2.5;
    }
    let intensity = match (ask["show"]["file"].as_str(), &bench.shared) {
        (None, Some(shared)) if !ask["color"].is_null() => {
            let bytes = std::fs::read(shared).expect("shared memory");
            let levels: Vec<f32> = bytes[64..].iter().map(|level| f32::from(*level)).collect();
            bench.seen(&levels, 1, iris)
        }
        (Some(file), None) if !ask["color"].is_null() => {
            let npy = eyebox::low_level::files::read_npy(std::path::Path::new(file)).expect("a pattern");
            bench.seen(&npy.values, npy.shape[0], iris)
        }
        _ => vec![0.0; CAMERA * CAMERA],
    };
    let mut sorted = intensity.clone();
    sorted.sort_by(f64::total_cmp);
    let bright = sorted[sorted.len() * 999 / 1000].max(1e-9);
    let exposure = ask["exposure_ms"].as_f64().unwrap_or(0.8 / bright);
    let average = ask["average"].as_f64().unwrap_or(1.0);
    let mut normal = || (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
    let count = |i: &f64| {
        // The camera has 12 bits, 10000 electrons at full scale and 60 counts in the dark.
        let electrons = 1e4 * i * exposure * bench.light;
        let noise = (electrons / average).sqrt().hypot(4.0 / average.sqrt()) * normal();
        ((electrons + noise) / 1e4 * 4095.0 + 60.0).clamp(0.0, 4095.0).round() as f32
    };
    let picture: Vec<f32> = intensity.iter().map(count).collect();
    let file = format!("{asked}.npy");
    eyebox::low_level::files::write_npy(std::path::Path::new(&file), &[CAMERA, CAMERA], &picture).expect("a picture");
    json!({"id": ask["id"], "file": file, "full_scale": 4095.0, "exposure_ms": exposure, "iris_mm": ask["iris_mm"], "focus_mm": 0.0})
}
