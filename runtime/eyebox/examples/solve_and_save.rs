//! Solves a scene in all colors of a display, saves the hologram, and measures it.
//!
//! `cargo run --release -p eyebox --example solve_and_save [SCENE] [FILE.zarr]`

use eyebox::engine::{self, Choice};
use eyebox::hologram::Hologram;
use eyebox::optics::{Display, Pupil};
use eyebox::produce::{SceneEvent, SceneJob, solve_scene};
use eyebox::reconstruction::SceneSource;
use eyebox::solve::Flow;
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let scene = args.next().unwrap_or_else(|| "builtin:still-life".into());
    let file = args.next().unwrap_or_else(|| "hologram.zarr".into());
    // 128 x 128 pixels keep the run to seconds.
    let display = Display { height: 128, width: 128, ..Display::load("paper")? };
    let job = SceneJob::new(&scene, &display);
    let mut engine = engine::open(Choice::Auto)?;
    println!("{scene} for the display '{}', on {}", display.name, engine.describe());
    solve_scene(&job, Some(Path::new(&file)), engine.as_mut(), &mut |event| {
        match event {
            SceneEvent::Step { color, progress, .. } if progress.step % 20 == 0 => {
                println!("{color}: step {} of {}, loss {:.2e}", progress.step, progress.steps, progress.loss);
            }
            SceneEvent::Solved { color, solution, .. } => {
                println!("{color}: {:.1} dB over validation pupils", solution.validation.mean());
            }
            _ => {}
        }
        Flow::Continue
    })?;
    // The file has everything that is needed to simulate the hologram again.
    let hologram = Hologram::load(Path::new(&file))?;
    let scene = SceneSource::new(job.load(0)?, &display)?;
    let pupils = [-4e-3, 0.0, 4e-3].map(|x| Pupil { x, y: 0.0, diameter: 5e-3, depth: 0.0 });
    let scores = hologram.score(&scene, &pupils, engine.as_mut())?;
    for score in &scores.pupils {
        // A black target has no PSNR.
        if let Some(psnr) = score.psnr {
            println!("pupil at {:4.1} mm: {psnr:.1} dB", score.pupil.x * 1e3);
        }
    }
    println!("saved {file}");
    Ok(())
}
