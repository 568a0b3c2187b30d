//! Times encoding and the machine's memory in turn, so that other load on the machine slows both.

mod arguments;
mod clock;

use arguments::{OfCargo, start};
use clap::Parser;
use clap::builder::TypedValueParser;
use clock::{least, median, timed};
use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::engine::vulkan::VulkanEncoder;
use eyebox::low_level::gpu::{Gpu, Options};
use eyebox::low_level::optics::{Color, Display};
use rayon::prelude::*;
use std::hint::black_box;
use std::process::ExitCode;

/// Encodes sets of 3 colors x 8 sub-frames, in turn with reading and with copying as much memory on all threads. Prints
/// the median and the shortest time, and the rate of the shortest in GB/s (phases read and video frames written, per
/// second). The share is relative to the rate at which memory is read. The last two columns are the median processor
/// time over all threads and the share by this time, which does not include other programs.
#[derive(Parser)]
#[command(
    after_help = "Example: cargo bench -p eyebox-tests --bench encode -- planes24 grey8\n\n'checked' also checks every phase first, as for phases of any origin."
)]
struct Arguments {
    #[command(flatten)]
    of_cargo: OfCargo,
    /// Displays with 3 colors, as presets or files.
    #[arg(default_values = ["planes24", "grey8", "fields", "plm"])]
    displays: Vec<String>,
    /// Number of measurements for each row.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u16).range(1..).map(usize::from))]
    rounds: usize,
    /// Also measure a Vulkan device, which may be a software device. The kernel has a row alone and one with transfers.
    #[arg(long)]
    vulkan: bool,
}

fn main() -> ExitCode {
    start(run)
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    println!("{} threads, {}", rayon::current_num_threads(), eyebox_kernels::simd_name());
    let heads = ["median ms", "best ms", "GB/s", "share", "cpu ms", "share"];
    println!(
        "{:>9} {:>20} {:>9} {:>9} {:>8} {:>8} {:>9} {:>8}",
        "display", "what", heads[0], heads[1], heads[2], heads[3], heads[4], heads[5]
    );
    let gpu = match arguments.vulkan {
        true => Some(Gpu::open(&Options { allow_cpu: true, ..Options::default() })?),
        false => None,
    };
    for name in &arguments.displays {
        let display = Display::load(name)?;
        let colors = [Color::Red, Color::Green, Color::Blue];
        let encoder = Encoder::new(&display, &colors, 8)?;
        let count = 8 * display.height * display.width;
        let phases: Vec<Vec<f32>> = (0..3)
            .map(|c| (0..count).map(|i| ((i * 7919 + c) % 62_832) as f32 * 1e-4 - std::f32::consts::PI).collect())
            .collect();
        let slices: Vec<&[f32]> = phases.iter().map(|p| &p[..]).collect();
        let mut frames = encoder.frames();
        let mut copy: Vec<Vec<f32>> = phases.clone();
        let read = 4 * 3 * count;
        let bytes = read + frames.bytes().len();
        let mut device = gpu.as_ref().map(|gpu| VulkanEncoder::new(gpu, encoder.plan())).transpose()?;
        let names = ["memory: read", "memory: copy", "encode", "encode, checked", "kernel", "kernel and transfers"];
        let mut times: [Vec<f64>; 6] = Default::default();
        let mut work: [Vec<f64>; 6] = Default::default();
        for round in 0..=arguments.rounds {
            let (mut took, mut busy) = ([0.0; 6], [0.0; 6]);
            (took[0], busy[0]) = time(|| sum(&phases));
            (took[1], busy[1]) = time(|| {
                (copy.iter_mut().zip(&phases)).for_each(|(to, from)| {
                    (to.par_chunks_mut(1 << 17).zip(from.par_chunks(1 << 17))).for_each(|(t, f)| t.copy_from_slice(f));
                });
            });
            let trusted = PhaseSet::trusted(&slices);
            let mut done = Ok(());
            (took[2], busy[2]) = time(|| done = encoder.encode_into(&trusted, &mut frames));
            done?;
            let size = encoder.hologram_size();
            let mut done = Ok(());
            (took[3], busy[3]) =
                time(|| done = PhaseSet::new(&slices, size).and_then(|set| encoder.encode_into(&set, &mut frames)));
            done?;
            if let Some(device) = &mut device {
                let mut done = Ok(());
                let mut got = encoder.frames();
                (took[5], busy[5]) = time(|| done = device.encode(&slices, got.bytes_mut()));
                done?;
                let mut done = Ok(());
                (_, busy[4]) = time(|| done = device.encode_uploaded());
                done?;
                took[4] = device.seconds();
                if got != frames {
                    return Err(format!("{name}: the device's bytes differ from the CPU's").into());
                }
            }
            // The first round does not count, because it touches the memory for the first time.
            if round > 0 {
                times.iter_mut().zip(took).for_each(|(all, one)| all.push(one));
                work.iter_mut().zip(busy).for_each(|(all, one)| all.push(one));
            }
        }
        let moved = |what: usize| [read, 2 * read, bytes, bytes, bytes, bytes][what] as f64;
        let rate = |what: usize| moved(what) / least(&times[what]) / 1e9;
        let busy = |what: usize| median(&work[what]);
        for what in (0..6).filter(|w| least(&times[*w]) > 0.0) {
            let (median, best, share) = (median(&times[what]) * 1e3, least(&times[what]) * 1e3, rate(what) / rate(0));
            let (cpu, by_cpu) = (busy(what) * 1e3, moved(what) / busy(what) / (moved(0) / busy(0)));
            let (what, rate) = (names[what], rate(what));
            println!("{name:>9} {what:>20} {median:9.2} {best:9.2} {rate:8.2} {share:8.3} {cpu:9.2} {by_cpu:8.3}");
        }
    }
    Ok(())
}

/// Returns the seconds by the clock, and the seconds of the processor over all threads.
fn time(work: impl FnOnce()) -> (f64, f64) {
    let before = busy();
    let (seconds, ()) = timed(work);
    (seconds, busy() - before)
}

#[cfg(unix)]
fn busy() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Returns NaN, because this system does not report the processor time.
#[cfg(not(unix))]
fn busy() -> f64 {
    f64::NAN
}

/// Reads all phases at the rate of the memory.
fn sum(phases: &[Vec<f32>]) {
    let total: u64 = phases
        .iter()
        .map(|all| {
            all.par_chunks(1 << 17)
                .map(|part| {
                    eyebox_kernels::simd(
                        #[inline(always)]
                        || part.iter().fold(0u32, |sum, v| sum.wrapping_add(v.to_bits())),
                    )
                })
                .map(u64::from)
                .sum::<u64>()
        })
        .sum();
    black_box(total);
}
