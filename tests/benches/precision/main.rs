//! Measures the errors of float32 arithmetic and of fields stored as halves, by their origin. The reference is float64,
//! and the measure is error power over signal power. `docs/precision.md` explains the numbers.

mod errors;
mod reference;
mod sums;
mod waves;

use clap::Parser;
use errors::Errors;
use eyebox::low_level::engine::{Choice, Engine, open};
use std::path::PathBuf;
use std::process::ExitCode;

/// Measures the error of every stage against float64, on the CPU and on Vulkan, stored as float32 and as halves. Prints
/// tables and draws plots.
#[derive(Parser)]
#[command(after_help = "Example: cargo bench -p eyebox-tests --bench precision -- --out docs/precision")]
struct Arguments {
    /// Cargo adds this argument.
    #[arg(long, hide = true)]
    bench: bool,
    /// Folder for the plots (SVG). Without it, no plots are drawn.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Largest size of transforms, in points along each axis.
    #[arg(long, default_value_t = 4096, value_parser = clap::value_parser!(u64).range(64..=8192))]
    largest: u64,
    /// Measure only some of transfer, transforms, views, frames, pupils, losses and adam.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
}

/// The engines that are compared, with their names.
pub type Engines = Vec<(&'static str, Box<dyn Engine>)>;

type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut engines: Engines = vec![("CPU", open(Choice::Cpu)?), ("Vulkan", open(Choice::Vulkan)?)];
    for (name, engine) in &engines {
        println!("{name}: {}", engine.describe());
    }
    let largest = arguments.largest as usize;
    type Measurement = fn(&mut Engines, usize) -> Result<Errors, Failure>;
    let all: [(&str, Measurement); 7] = [
        ("transfer", waves::transfer),
        ("transforms", waves::transforms),
        ("views", waves::views),
        ("frames", sums::frames),
        ("pupils", sums::pupils),
        ("losses", sums::losses),
        ("adam", sums::adam),
    ];
    if let Some(unknown) = arguments.only.iter().find(|o| !all.iter().any(|(name, _)| name == o)) {
        let names: Vec<&str> = all.iter().map(|a| a.0).collect();
        return Err(format!("'{unknown}' is no measurement. These exist: {}", names.join(", ")).into());
    }
    for (name, measure) in all {
        if !arguments.only.is_empty() && !arguments.only.iter().any(|o| o == name) {
            continue;
        }
        let plot = measure(&mut engines, largest)?;
        println!("\n{}", plot.table());
        if let Some(folder) = &arguments.out {
            std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
            eyebox::low_level::files::write_file(&folder.join(format!("{name}.svg")), |out| {
                writeln!(out, "{}", plot.draw())
            })?;
        }
    }
    Ok(())
}
