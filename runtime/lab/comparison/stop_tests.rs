//! Tests that no list runs after a stop and that earlier results are saved.

use super::*;
use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::scene::{self, Request};
use std::sync::atomic::{AtomicUsize, Ordering};

const COLORS: [Color; 2] = [Color::Red, Color::Green];

fn job() -> Comparison {
    let display = Display { height: 24, width: 24, ..Display::preset("small").unwrap() };
    Comparison {
        scenes: vec!["plane".into()],
        candidates: candidates(&[Method::Slfh], Vec::new()).unwrap(),
        frames: vec![2],
        display,
        colors: COLORS.to_vec(),
        settings: Settings { steps: 2, pupils: 2, diameter: [2e-3, 4e-3], ..Settings::default() },
        speckle: true,
        joint: vec![1.0],
        coherence: vec![0.0],
        masks: vec!["2".parse().unwrap()],
        sources: false,
        judged: 1,
    }
}

/// Runs the job until `most` lists ran. Returns the number of lists that ran and the results.
fn run(folder: &Path, most: usize) -> (usize, Results) {
    let (job, ran) = (job(), AtomicUsize::new(0));
    let request = Request { views: 3, ..Request::new(&job.display, &COLORS) };
    let mut load =
        |_| -> Result<_, QualityError> { Ok((scene::load("builtin:plane", &request).unwrap(), [-1e-3, 1e-3])) };
    let counts = || {
        ran.fetch_add(1, Ordering::SeqCst);
        false
    };
    let mut engine = Stoppable { engine: &mut CpuEngine::new(), stops: &counts };
    let mut observe = |_: &str, _: f64| if ran.load(Ordering::SeqCst) >= most { Flow::Stop } else { Flow::Continue };
    let results = job.run(folder, &mut load, &mut engine, &mut observe).unwrap();
    (ran.load(Ordering::SeqCst), results)
}

#[test]
fn no_list_runs_after_a_stop_and_the_results_until_then_are_kept() {
    let here = tempfile::tempdir().unwrap();
    let (all, whole) = run(&here.path().join("whole"), usize::MAX);
    assert!(whole.missing == 0 && whole.runs.len() == 1 && whole.joint.len() == 3, "{}", whole.missing);
    let parts = 12;
    let again = here.path().join("parts");
    let (mut missing, mut sum) = (usize::MAX, 0);
    for part in 1..=parts {
        // Most stops are within the target images, the solve or the images of the hologram.
        let most = all * part / (3 * parts);
        let (ran, results) = run(&again, most);
        assert!(ran <= most, "{ran} lists ran, and {most} until the stop");
        assert!(results.missing <= missing, "a result was lost");
        (missing, sum) = (results.missing, sum + ran);
    }
    assert!(missing > 0);
    let (ran, results) = run(&again, usize::MAX);
    assert!(results.missing == 0 && ran < all, "{ran} of {all} lists ran though {sum} had run before");
    assert_eq!(results.runs[0].rows.len(), whole.runs[0].rows.len());
}
