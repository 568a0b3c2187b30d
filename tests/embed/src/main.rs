//! Solves a scene, saves the hologram, refines it for the position of the pupil, and encodes the SLM's bytes.

use eyebox::engine::{self, Choice};
use eyebox::hologram::Hologram;
use eyebox::optics::{Display, Pupil, PupilDistribution};
use eyebox::produce::{SceneJob, solve_scene};
use eyebox::solve::{Flow, Settings, RefineSettings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::temp_dir().join(format!("embed-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let file = folder.join("still-life.zarr");
    // Solve the scene and save the hologram.
    let display = Display { height: 48, width: 64, ..Display::load("planes8")? };
    let settings = Settings { steps: 5, ..Settings::default() };
    let job = SceneJob { settings, ..SceneJob::new("builtin:still-life", &display) };
    let mut engine = engine::open(Choice::Cpu)?;
    solve_scene(&job, Some(&file), engine.as_mut(), &mut |_| Flow::Continue)?;
    // Refine the hologram for a pupil that moves to the right, and encode it for the display.
    let field = job.load(0)?;
    let mut refinement = Hologram::load(&file)?.refine(&field, RefineSettings::default(), || engine::open(Choice::Cpu))?;
    let mut before = Vec::new();
    for x in [-2e-3, 0.0, 2e-3] {
        refinement.set_pupil(PupilDistribution::around(&Pupil { x, y: 0.0, diameter: 4e-3, depth: 0.0 }, 0.25e-3))?;
        for _ in 0..4 {
            assert!(refinement.step()?.is_finite());
        }
        let frames = refinement.hologram()?.encode(&display)?;
        assert!(frames.bytes().len() == frames.count() * 48 * 64 * frames.channels && frames.bytes() != before);
        println!("pupil at {:4.1} mm: {} video frames of {} bytes", x * 1e3, frames.count(), frames.bytes().len());
        before = frames.bytes().to_vec();
    }
    Ok(std::fs::remove_dir_all(&folder)?)
}
