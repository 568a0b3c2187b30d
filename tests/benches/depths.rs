//! Times the views of a picture with depths, as an application gives them, on the host and on a Vulkan device.

mod arguments;
mod clock;

use arguments::{OfCargo, start};
use clap::Parser;
use clock::{least, median, timed};
use eyebox::low_level::engine::vulkan::{DeviceRelief, StoredDepths, ViewDecoder};
use eyebox::low_level::gpu::{Gpu, Options};
use eyebox::low_level::scene::{Places, views_of_depths};
use eyebox_kernels::decode_views::F32;
use std::process::ExitCode;

/// Makes 3 x 3 views in one color of discs in front of a ground, in turn on the host and on the device. Prints the
/// median and the shortest time, and the difference of the views.
#[derive(Parser)]
#[command(after_help = "Example: cargo bench -p eyebox-tests --bench depths -- --size 1080 1920")]
struct Arguments {
    #[command(flatten)]
    of_cargo: OfCargo,
    /// Rows and columns of pixels.
    #[arg(long, num_args = 2, default_values_t = [1080, 1920])]
    size: Vec<usize>,
    /// Pixels by which the nearest content moves from one view to the next.
    #[arg(long, default_value_t = 12.0)]
    disparity: f64,
    /// Number of measurements on each.
    #[arg(long, default_value_t = 5)]
    rounds: usize,
}

/// Views along each axis.
const SIDE: usize = 3;
/// Distance of views (m).
const PITCH: f64 = 1e-3;

fn main() -> ExitCode {
    start(run)
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let size = [arguments.size[0], arguments.size[1]];
    let (colors, dioptres) = discs(size);
    let pixels = size[0] * size[1];
    let at = |i: usize| (i as f64 - 1.0) * PITCH;
    let places: Vec<[f64; 2]> = (0..SIDE * SIDE).map(|i| [at(i % SIDE), at(i / SIDE)]).collect();
    let in_mm: Vec<[f32; 2]> = places.iter().map(|place| place.map(|v| (v * 1e3) as f32)).collect();
    // A dioptre is taken as a meter of depth, so that the nearest content, at 1, has the disparity that was wanted.
    let from = Places { places: &places, per_metre: arguments.disparity / PITCH, size };
    let frame: Vec<u8> = colors.iter().chain(&dioptres).flat_map(|v| v.to_le_bytes()).collect();
    let per_dioptre = (from.per_metre * 1e-3) as f32;
    let stored = StoredDepths { sample: F32, coded: false, depths: 4 * colors.len() as u64, per_dioptre };
    let gpu = Gpu::open(&Options { allow_cpu: true, ..Options::default() })?;
    let mut decoder = ViewDecoder::new(&gpu, size, 1, &[0], (4 * SIDE * SIDE * pixels) as u64)?;
    let mut room = DeviceRelief::default();
    let (mut host, mut device, mut decibels) = (Vec::new(), Vec::new(), 0.0);
    for _ in 0..arguments.rounds.max(1) {
        let (seconds, wanted) = timed(|| views_of_depths(&[&colors], &dioptres, &from));
        let wanted = wanted.map_err(|reason| reason.to_string())?;
        host.push(seconds);
        let (seconds, made) = timed(|| -> Result<_, Box<dyn std::error::Error>> {
            decoder.upload_depths(&mut room, &frame)?;
            decoder.read_depths(&mut room, &stored)?.map_err(|_| "the picture has an invalid value")?;
            let views = decoder.draw_depths(&mut room, (&in_mm, from.reach() as f32 * 1e3), [SIDE; 2])?;
            let light = decoder.measure(&views)?.map_err(|_| "a view has an invalid value")?;
            Ok((decoder.decode(&views, &light)?, light))
        });
        device.push(seconds);
        let (pyramids, lights) = made?;
        let (mut error, mut power) = (0.0, 0.0);
        for ((pyramid, light), wanted) in pyramids.iter().zip(&lights).zip(&wanted) {
            let found = pyramid.on_device().ok_or("the views are not on the device")?.read()?;
            let scale = f64::from(light.brightest) / 65_535.0;
            for (found, wanted) in found[0].iter().zip(wanted.iter().flatten()) {
                error += (f64::from(*found) * scale - f64::from(*wanted)).powi(2);
                power += f64::from(*wanted).powi(2);
            }
        }
        decibels = 10.0 * (power / error).log10();
    }
    println!("{} threads, and {}", rayon::current_num_threads(), gpu.report().name);
    println!("{:>8} {:>12} {:>12}", "on", "median s", "best s");
    for (name, seconds) in [("host", &host), ("device", &device)] {
        println!("{name:>8} {:>12.3} {:>12.3}", median(seconds), least(seconds));
    }
    println!("the difference of the views is {decibels:.1} dB below them");
    Ok(())
}

/// Returns the light and the dioptres of discs in front of a ground.
fn discs([height, width]: [usize; 2]) -> (Vec<f32>, Vec<f32>) {
    let scale = height as f32 / 1080.0;
    let (mut colors, mut dioptres) = (Vec::new(), Vec::new());
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y as f32 / scale, x as f32 / scale))) {
        let texture = 0.5 + 0.3 * (x * 0.11).sin() * (y * 0.07).cos();
        let (mut color, mut depth) = (texture, 0.1 * y / 1080.0);
        for i in 0..12 {
            let (cx, cy) = (160.0 + 320.0 * (i % 6) as f32, 320.0 + 440.0 * (i / 6) as f32);
            if (x - cx).hypot(y - cy) < 90.0 + 5.0 * i as f32 {
                (color, depth) = (0.9 - 0.06 * i as f32, 0.4 + 0.05 * i as f32);
            }
        }
        colors.push(color);
        dioptres.push(depth.min(1.0));
    }
    (colors, dioptres)
}
