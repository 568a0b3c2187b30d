//! Times the views of a file of splats, with the reading of the file apart.

mod arguments;
mod clock;

use arguments::{OfCargo, start};
use clap::Parser;
use clock::{least, median, timed};
use eyebox::low_level::engine::vulkan::VulkanSplats;
use eyebox::low_level::gpu::{Gpu, Options};
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::scene::{self, Request, SplatDrawer, SplatViews};
use eyebox_tests::both::Noise;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Reads splats and renders views of all three colors. Prints the median and the shortest time of the light field, and
/// of the reading alone.
#[derive(Parser)]
#[command(after_help = "Example: cargo bench -p eyebox-tests --bench splats -- --views 9 3 1")]
struct Arguments {
    #[command(flatten)]
    of_cargo: OfCargo,
    /// A file of splats with its options. Random splats of a room are written if there is none.
    #[arg(long)]
    file: Option<String>,
    /// Number of random splats.
    #[arg(long, default_value_t = 100_000)]
    splats: usize,
    /// Degree of the harmonics of random splats, 0 to 3.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    degree: u8,
    /// Views along each axis.
    #[arg(long, num_args = 1.., default_values_t = [9, 3])]
    views: Vec<usize>,
    /// Rows, and columns, of pixels.
    #[arg(long, default_value_t = 256)]
    size: usize,
    /// Number of measurements for each row.
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// Draw on a Vulkan device, which may be a software device.
    #[arg(long)]
    vulkan: bool,
}

fn main() -> ExitCode {
    start(run)
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let source = match &arguments.file {
        Some(file) => file.clone(),
        None => room(folder.path(), arguments.splats, arguments.degree.into())?.display().to_string(),
    };
    let display = Display { height: arguments.size, width: arguments.size, ..Display::load("small")? };
    let colors = [Color::Red, Color::Green, Color::Blue];
    let drawer: Option<Arc<dyn SplatDrawer>> = match arguments.vulkan {
        true => {
            let gpu = Gpu::open(&Options { allow_cpu: true, ..Options::default() })?;
            println!("{}", gpu.report().name);
            Some(Arc::new(VulkanSplats::new(&gpu)?))
        }
        false => None,
    };
    println!("{} threads, {}", rayon::current_num_threads(), eyebox_kernels::simd_name());
    println!("{}", SplatViews::new(&source, &Request::new(&display, &colors))?.read_as());
    println!("{:>8} {:>12} {:>12} {:>14} {:>14}", "views", "median s", "best s", "reading s", "per view ms");
    for &views in &arguments.views {
        let request = Request { views, drawer: drawer.as_ref(), ..Request::new(&display, &colors) };
        let (mut all, mut reading) = (Vec::new(), Vec::new());
        for _ in 0..arguments.rounds.max(1) {
            let (seconds, field) = timed(|| scene::load(&source, &request));
            field?;
            all.push(seconds);
            let (seconds, opened) = timed(|| SplatViews::new(&source, &request));
            opened?;
            reading.push(seconds);
        }
        let of_view = (median(&all) - median(&reading)) * 1e3 / (views * views) as f64;
        let (middle, best, read) = (median(&all), least(&all), median(&reading));
        println!("{:>8} {middle:>12.3} {best:>12.3} {read:>14.3} {of_view:>14.2}", views * views);
    }
    Ok(())
}

/// Writes random splats of a room. Most are small and on its walls, and the others are in the middle.
fn room(folder: &Path, count: usize, degree: usize) -> std::io::Result<PathBuf> {
    let mut noise = Noise::new(1);
    let mut signed = move || 2.0 * noise.draw() - 1.0;
    let rest = 3 * ((degree + 1) * (degree + 1) - 1);
    let names = ["x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
    let colors = (0..3).map(|i| format!("f_dc_{i}")).chain((0..rest).map(|i| format!("f_rest_{i}")));
    let properties: String =
        names.map(String::from).into_iter().chain(colors).map(|name| format!("property float {name}\n")).collect();
    let head = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n");
    let mut bytes = head.into_bytes();
    for i in 0..count {
        let (x, y, z) = (signed(), signed(), signed());
        let place = match i % 4 {
            0 => [1.6 * x, 1.6 * y, 2.5],
            1 => [1.6 * x, 1.0, 1.5 + y],
            2 => [1.6 * x.signum(), 1.2 * y, 1.5 + z],
            _ => [0.6 * x, 0.6 * y, 1.5 + 0.6 * z],
        };
        let mut values = place.to_vec();
        values.push(3.0 * signed() + 1.0);
        values.extend((0..3).map(|_| -4.6 + 0.7 * signed()));
        values.extend((0..4).map(|_| signed()));
        values.extend((0..3).map(|_| 1.5 * signed()));
        values.extend((0..rest).map(|_| 0.2 * signed()));
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    }
    let file = folder.join("room.ply");
    std::fs::write(&file, bytes)?;
    Ok(file)
}
