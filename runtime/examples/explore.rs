//! Scratch.
use eyebox::engine::{Buffer, Engine, cpu::CpuEngine};
use eyebox::optics::*;
use eyebox::plan::*;
use eyebox::scene::*;
use eyebox::solve::*;
use std::sync::Arc;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let get = |k: &str, d: f64| a.iter().position(|x| x == k).map_or(d, |i| a[i + 1].parse().unwrap());
    let size = get("--size", 512.0) as usize;
    let power = get("--bright", 1.0);
    let optics = Optics::new(size, size, 8e-6, 520e-9, 0.4).unwrap();
    let mut views = Vec::new();
    for i in 0..81 {
        let im = image::open(format!("/work/shared/data/antinous/input_Cam{i:03}.png")).unwrap().to_rgb8();
        let v: Vec<f32> = im
            .pixels()
            .map(|p| {
                let v = f32::from(p.0[1]) / 255.0;
                (if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }).powf(power as f32)
            })
            .collect();
        let v = if size == 512 {
            v
        } else {
            let k = 512 / size;
            (0..size * size)
                .map(|i| {
                    let (y, x) = (i / size, i % size);
                    let mut s = 0.0;
                    for dy in 0..k {
                        for dx in 0..k {
                            s += v[(y * k + dy) * 512 + x * k + dx];
                        }
                    }
                    s / (k * k) as f32
                })
                .collect()
        };
        views.push(v);
    }
    let mean = views.iter().flatten().map(|v| *v as f64).sum::<f64>() / (81 * size * size) as f64;
    let cell = get("--cell", 440e-9 * 0.4 / 8e-6 / 8.0);
    let grid = ViewGrid { rows: 9, columns: 9, cell };
    let t = std::time::Instant::now();
    let pyramid = Arc::new(Pyramid::new(&views, size, size));
    println!("pyramid {:.2} s, {} MB, mean {mean:.3}", t.elapsed().as_secs_f64(), pyramid.bytes() >> 20);
    let problem = Problem { optics, padding: Padding::default(), eyebox: 22e-3, views: grid, pyramid, mean };
    let scale = size as f64 / 512.0;
    let adam = a.iter().any(|x| x == "--adam");
    let mut s = Settings { depth: [-3e-3 * scale, 3.5e-3 * scale], ..Settings::default() };
    s.steps = get("--steps", 10.0) as usize;
    s.pupils = get("--pupils", 16.0) as usize;
    s.seed = get("--seed", 0.0) as u64;
    s.diameter = [get("--dmin", 2.0) * 1e-3, get("--dmax", 20.0) * 1e-3];
    if a.iter().any(|x| x == "--uniform") {
        s.diameters = Diameters::Uniform;
    }
    if a.iter().any(|x| x == "--recip") {
        s.diameters = Diameters::Reciprocal;
    }
    if a.iter().any(|x| x == "--random") {
        s.sequence = Sequence::Random;
    }
    let e = get("--exposure", 0.0);
    if e > 0.0 {
        s.efficiency = Some(mean / e);
    }
    s.window = match get("--window", 1.0) as i32 {
        1 => WindowFactor::One,
        2 => WindowFactor::Two,
        _ => WindowFactor::Full,
    };
    s.optimizer = if adam {
        Optimizer::Adam {
            rate: [get("--rate", 0.1), get("--rate", 0.1) * 0.05],
            amplitude: a.iter().any(|x| x == "--amplitude"),
        }
    } else {
        Optimizer::Projection {
            gain: [get("--gain", 3.0), get("--gain-end", 0.2)],
            momentum: get("--momentum", 0.5),
            overlap_power: get("--power", 0.5),
        }
    };
    let mut engine = CpuEngine::new();
    println!("{}", engine.describe());
    let t = std::time::Instant::now();
    let mut losses = Vec::new();
    let solution = solve(&problem, &s, &mut engine, &mut |p| {
        losses.push((p.seconds, p.loss));
        Flow::Continue
    })
    .unwrap();
    let n = losses.len();
    println!("solve {:.2} s; median step {:.1} ms", t.elapsed().as_secs_f64(), {
        let mut d: Vec<f64> = losses.windows(2).map(|w| w[1].0 - w[0].0).collect();
        d.sort_by(f64::total_cmp);
        d.get(d.len() / 2).copied().unwrap_or(0.0) * 1e3
    });
    if a.iter().any(|x| x == "--times") {
        for t in engine.timings() {
            println!("  {:15} {:6} {:9.2} ms/step", t.kernel.name(), t.calls, t.seconds * 1e3 / n as f64);
        }
    }
    // The peer's 16 pupils, from a file: x y d z in metres a line.
    let pupils: Vec<Pupil> = std::fs::read_to_string(format!("/tmp/pupils{size}.txt"))
        .unwrap()
        .lines()
        .map(|l| {
            let v: Vec<f64> = l.split_whitespace().map(|v| v.parse().unwrap()).collect();
            Pupil { x: v[0], y: v[1], diameter: v[2], depth: v[3] }
        })
        .collect();
    let planner = Planner {
        views: Some(Views::new(grid, &problem.pyramid)),
        ..Planner::new(optics, s.frames, WindowFactor::Full)
    };
    engine.write(Buffer::Phases, &solution.phases).unwrap();
    let judge = Judge::new(&mut engine, &planner, pupils).unwrap();
    let v = judge.judge(&mut engine, &planner).unwrap();
    println!(
        "held out {:.2}/{:.2} dB; peer's 16: mean {:.2} worst {:.2}; fitted exposure {:.3} solved {:.3}",
        solution.verdict.mean(),
        solution.verdict.worst(),
        v.mean(),
        v.worst(),
        v.exposure,
        solution.exposure
    );
}
