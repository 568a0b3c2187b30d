//! Times transforms on a Vulkan device, of the CPU engine and of RustFFT in turn, so that other load slows all of them.
//!
//! The CPU engine transforms its columns in place, a few at a time. `textbook` is the usual code of a user of RustFFT.
//! It transforms rows, transposes, transforms rows and transposes. Both run on one thread.

mod arguments;
mod clock;

use arguments::{OfCargo, start};
use clap::Parser;
use clock::{least, median, timed};
use eyebox::low_level::engine::Storage;
use eyebox::low_level::engine::vulkan::Transforms;
use eyebox::low_level::gpu::{Gpu, Options};
use eyebox_kernels::Complex32;
use eyebox_kernels::fft::{Columns, Direction, Plans};
use rustfft::FftPlanner;
use std::collections::BTreeMap;
use std::process::ExitCode;

/// Times forward transforms in turn, on a Vulkan device, and on one thread by the CPU engine and by RustFFT with two
/// transposes. Prints the medians and the shortest times, which other load disturbs least, and their rate by 5 N log2 N
/// operations. Also prints the ratio of Vulkan's times to the others, and the power of the difference over the power of
/// the result.
#[derive(Parser)]
#[command(after_help = "Example: cargo bench -p eyebox-tests --bench fft -- 2048x2048 1080x1920")]
struct Arguments {
    #[command(flatten)]
    of_cargo: OfCargo,
    /// Sizes of the transforms as HEIGHTxWIDTH.
    #[arg(default_values = ["512x512", "1080x1920", "2048x2048"], value_parser = size)]
    sizes: Vec<(usize, usize)>,
    /// Number of the device, or a part of its name.
    #[arg(long)]
    device: Option<String>,
    /// Number of measurements for each row.
    #[arg(long, default_value_t = 11)]
    rounds: usize,
    /// Show plans and the time of every pass.
    #[arg(long)]
    passes: bool,
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let parts: Option<Vec<usize>> =
        text.split('x').map(|p| p.parse().ok().filter(|n| (1..=65_536).contains(n))).collect();
    match parts.as_deref() {
        Some(&[h, w]) if h * w <= 1 << 24 => Ok((h, w)),
        _ => Err("a size is HEIGHTxWIDTH, as 1080x1920, of at most 2^24 values".into()),
    }
}

fn main() -> ExitCode {
    start(run)
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let options = Options { device: arguments.device.clone(), allow_cpu: true, ..Options::default() };
    let gpu = Gpu::open(&options)?;
    let mut transforms = Transforms::new(&gpu)?;
    println!("{}", gpu.report().name);
    let twin = Plans::default();
    for &(h, w) in &arguments.sizes {
        let frame: Vec<Complex32> = (0..h * w).map(|i| Complex32::new((i % 17) as f32, (i % 23) as f32)).collect();
        let (mut device, mut blocked, mut plain) = (Vec::new(), Vec::new(), Vec::new());
        let mut passes = BTreeMap::<(usize, String), Vec<f64>>::new();
        let mut textbook = Textbook::new(h, w);
        let mut difference = 0.0;
        let plans = transforms.plans(h, w)?;
        for round in 0..=arguments.rounds {
            let mut data = frame.clone();
            let on_device = transforms.run(&mut data, (h, w), Direction::Forward, Columns::all(w), 0)?;
            let result = std::mem::replace(&mut data, frame.clone());
            let (seconds, ()) = timed(|| twin.fft(&mut data, h, w, Direction::Forward, Columns::all(w), |_| ()));
            let mut again = frame.clone();
            let (plain_seconds, ()) = timed(|| textbook.forward(&mut again));
            difference = result.iter().zip(&data).map(|(a, b)| f64::from((a - b).norm_sqr())).sum::<f64>()
                / data.iter().map(|z| f64::from(z.norm_sqr())).sum::<f64>();
            // The first round does not count, because it makes plans and compiles.
            if round > 0 {
                device.push(on_device.whole);
                blocked.push(seconds);
                plain.push(plain_seconds);
                for (i, (name, seconds)) in on_device.passes.into_iter().enumerate() {
                    passes.entry((i, name)).or_default().push(seconds);
                }
            }
        }
        println!("{h}x{w}: difference {difference:.1e}; of {} rounds, in turn:", arguments.rounds);
        println!("  {:34} {:>9} {:>9} {:>9}  Vulkan takes", "", "median ms", "best ms", "GFLOP/s");
        let operations = 5.0 * (h * w) as f64 * ((h * w) as f64).log2();
        let line = |name: &str, seconds: &[f64]| {
            let ratio =
                format!("{:.2} (best {:.2}) of it", median(&device) / median(seconds), least(&device) / least(seconds));
            let (middle, least) = (1e3 * median(seconds), 1e3 * least(seconds));
            let rate = 1e-6 * operations / least;
            println!(
                "  {name:34} {middle:>9.2} {least:>9.2} {rate:>9.1}  {}",
                if name == "Vulkan" { "" } else { &ratio }
            );
        };
        line("Vulkan", &device);
        line("CPU engine, one thread", &blocked);
        line("RustFFT, one thread, textbook", &plain);
        if arguments.passes {
            println!("  rows    {}\n  columns {}", plans[0], plans[1]);
            for ((_, name), seconds) in passes {
                println!("  {:>10.4} ms {name}", 1e3 * median(&seconds));
            }
            for (frames, storage) in [(1, Storage::F32), (8, Storage::F32), (8, Storage::F16)] {
                transforms.store(storage);
                for (name, seconds) in transforms.in_a_row((h, w, frames), 200 / frames)? {
                    let seconds = median(&seconds[seconds.len() / 2..]);
                    println!(
                        "  {:>10.4} ms a frame, one of {frames} in {storage:?}, awake: {name}",
                        1e3 * seconds / frames as f64
                    );
                }
            }
            transforms.store(Storage::F32);
        }
    }
    Ok(())
}

/// Transforms rows, transposes, transforms rows and transposes.
struct Textbook {
    rows: usize,
    columns: usize,
    planner: FftPlanner<f32>,
    turned: Vec<Complex32>,
}

impl Textbook {
    fn new(rows: usize, columns: usize) -> Self {
        Self { rows, columns, planner: FftPlanner::new(), turned: vec![Complex32::default(); rows * columns] }
    }

    fn forward(&mut self, data: &mut [Complex32]) {
        self.planner.plan_fft_forward(self.columns).process(data);
        transpose(data, &mut self.turned, self.rows, self.columns);
        self.planner.plan_fft_forward(self.rows).process(&mut self.turned);
        transpose(&self.turned, data, self.columns, self.rows);
    }
}

fn transpose(from: &[Complex32], to: &mut [Complex32], rows: usize, columns: usize) {
    for y in 0..rows {
        for x in 0..columns {
            to[x * rows + y] = from[y * columns + x];
        }
    }
}
