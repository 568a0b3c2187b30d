//! Vulkan transforms beside RustFFT on one thread, measured in turn, so that a busy machine slows both.

use clap::Parser;
use eyebox::engine::vulkan::{Options, Transforms};
use eyebox_kernels::Complex32;
use eyebox_kernels::fft::{Columns, Direction, Plans};
use std::collections::BTreeMap;
use std::process::ExitCode;
use std::time::Instant;

/// Times forward transforms on a Vulkan device and with RustFFT on one thread, in turn; prints the medians,
/// their ratio, the ratio of the shortest times (which a busy machine disturbs least),
/// and the power of the difference over that of the result.
#[derive(Parser)]
#[command(after_help = "Example: cargo run --release -p eyebox-tools --bin fft-bench -- 2048x2048 1080x1920")]
struct Arguments {
    /// Sizes as HEIGHTxWIDTH.
    #[arg(default_values = ["512x512", "1080x1920", "2048x2048"], value_parser = size)]
    sizes: Vec<(usize, usize)>,
    /// Device, by number or part of its name.
    #[arg(long)]
    device: Option<String>,
    /// Measurements of each.
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
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let mut transforms =
        Transforms::open(&Options { device: arguments.device.clone(), allow_cpu: true, ..Options::default() })?;
    println!("{}", transforms.device());
    println!("{:>11} {:>10} {:>11} {:>6} {:>6}  difference", "size", "Vulkan ms", "RustFFT ms", "ratio", "best");
    let twin = Plans::default();
    for &(h, w) in &arguments.sizes {
        let frame: Vec<Complex32> = (0..h * w).map(|i| Complex32::new((i % 17) as f32, (i % 23) as f32)).collect();
        let (mut device, mut host, mut passes) = (Vec::new(), Vec::new(), BTreeMap::<(usize, String), Vec<f64>>::new());
        let mut difference = 0.0;
        let plans = transforms.plans(h, w)?;
        for round in 0..=arguments.rounds {
            let mut data = frame.clone();
            let timed = transforms.run(&mut data, (h, w), Direction::Forward, Columns::all(w), 0)?;
            let result = std::mem::replace(&mut data, frame.clone());
            let start = Instant::now();
            twin.fft(&mut data, h, w, Direction::Forward, Columns::all(w));
            let seconds = start.elapsed().as_secs_f64();
            difference = result.iter().zip(&data).map(|(a, b)| f64::from((a - b).norm_sqr())).sum::<f64>()
                / data.iter().map(|z| f64::from(z.norm_sqr())).sum::<f64>();
            // The first round makes plans and compiles.
            if round > 0 {
                device.push(timed.whole);
                host.push(seconds);
                for (i, (name, seconds)) in timed.passes.into_iter().enumerate() {
                    passes.entry((i, name)).or_default().push(seconds);
                }
            }
        }
        let best = least(&device) / least(&host);
        let (device, host) = (1e3 * median(device), 1e3 * median(host));
        println!(
            "{:>11} {device:>10.2} {host:>11.2} {:>6.2} {best:>6.2}  {difference:.1e}",
            format!("{h}x{w}"),
            device / host
        );
        if arguments.passes {
            println!("  rows    {}\n  columns {}", plans[0], plans[1]);
            for ((_, name), seconds) in passes {
                println!("  {:>8.2} ms {name}", 1e3 * median(seconds));
            }
        }
    }
    Ok(())
}

fn median(mut seconds: Vec<f64>) -> f64 {
    seconds.sort_by(f64::total_cmp);
    seconds.get(seconds.len() / 2).copied().unwrap_or(0.0)
}

fn least(seconds: &[f64]) -> f64 {
    seconds.iter().copied().fold(f64::INFINITY, f64::min)
}
