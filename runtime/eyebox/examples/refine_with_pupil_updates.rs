//! Refines a hologram while a pupil moves over the eyebox, and prints the gain at each place.
//!
//! `cargo run --release -p eyebox --example refine_with_pupil_updates`

use eyebox::engine::{self, Choice};
use eyebox::optics::{Display, Pupil, PupilDistribution};
use eyebox::produce::{SceneJob, solve_scene};
use eyebox::reconstruction::SceneSource;
use eyebox::solve::{Flow, RefineSettings, Settings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let display = Display { height: 96, width: 96, ..Display::load("paper")? };
    let settings = Settings { steps: 30, frames: 4, ..Settings::default() };
    let job = SceneJob { settings, ..SceneJob::new("builtin:still-life", &display) };
    let mut engine = engine::open(Choice::Cpu)?;
    // Without a file, the hologram stays in memory.
    let solved = solve_scene(&job, None, engine.as_mut(), &mut |_| Flow::Continue)?;
    let whole = solved.into_hologram().ok_or("one scene makes one hologram")?;
    let field = job.load(0)?;
    let scene = SceneSource::new(field.clone(), &display)?;
    let mut refinement = whole.clone().refine(&field, RefineSettings::default(), || engine::open(Choice::Cpu))?;
    for degrees in (0..360).step_by(45) {
        let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
        let pupil = Pupil { x: 5e-3 * cos, y: 5e-3 * sin, diameter: 4e-3, depth: 0.0 };
        // A real tracker also reports the position of the pupil and its accuracy.
        refinement.set_pupil(PupilDistribution::around(&pupil, 0.25e-3))?;
        for _ in 0..8 {
            refinement.step()?;
        }
        let refined = refinement.hologram()?.score(&scene, &[pupil], engine.as_mut())?.pupils[0].psnr;
        let before = whole.score(&scene, &[pupil], engine.as_mut())?.pupils[0].psnr;
        // A black target has no PSNR.
        if let (Some(before), Some(refined)) = (before, refined) {
            println!("pupil at {degrees:3} degrees: {before:.1} dB for the whole eyebox, {refined:.1} dB refined");
        }
    }
    Ok(())
}
