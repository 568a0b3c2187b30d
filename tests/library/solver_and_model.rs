//! The solver uses the model of a display. A term that it knows does not make the result worse, and neither do more
//! steps.

use super::model::seen_on;
use eyebox::low_level::engine::cpu::CpuEngine;
use eyebox::low_level::optics::{Color, Display, Level, ModelOf, ModelTerms, Padding};
use eyebox::low_level::scene::{self, LightField};
use eyebox::low_level::solve::{self, Flow, Optimizer, Problem, Settings, Solution};

/// Returns every term of a real setup, with crosstalk towards each side of this sigma (pixels^-1).
fn terms(sigma: Option<f64>) -> ModelTerms {
    ModelTerms {
        level: Some(Level::Nodes([[1.0, 1.06, 1.0], [0.98, 1.07, 1.05], [1.03, 1.04, 1.06]])),
        bend: Some([0.0, -0.03]),
        lag: Some(0.04),
        crosstalk: sigma.map(|sigma| [[1.2, sigma].into(); 4]),
        fill: Some(0.94),
        source: Some([0.0, 0.06, -0.34, -0.03, -0.24]),
        undiffracted: Some(vec![[0.09, 0.2, 0.53, 0.0, 0.28]]),
        wavefront: [(3, 0.02), (8, 0.05), (10, -0.06)].into(),
        iris: Some([0.12, 0.04, 1.0]),
        ..ModelTerms::default()
    }
}

struct Bench {
    field: LightField,
    settings: Settings,
}

impl Bench {
    fn new(steps: usize) -> Self {
        let field =
            scene::load("builtin:still-life", &scene::Request::new(&Self::display(None), &[Color::Green])).unwrap();
        let settings = Settings { pupils: 8, steps, ..Settings::default() };
        Self { field, settings: Settings { diameter: [4e-3, 16e-3], depth: [0.0, 1e-3], ..settings } }
    }

    fn display(terms: Option<ModelTerms>) -> Display {
        let small = Display { height: 48, width: 48, ..Display::preset("small").unwrap() };
        Display { model: terms.into_iter().map(|terms| (ModelOf::Green, terms)).collect(), ..small }
    }

    fn problem(&self, terms: ModelTerms) -> Problem {
        Problem::new(&self.field, Color::Green, &Self::display(Some(terms)), Padding::default()).unwrap()
    }

    fn solve(&self, terms: ModelTerms, settings: &Settings) -> Solution {
        let mut engine = CpuEngine::new();
        solve::solve(&self.problem(terms), settings, &mut engine, &mut |_| Flow::Continue).unwrap()
    }
}

/// Crosstalk is weak here compared to uneven light and zero-order light. Long steps under a bound would diverge and
/// lose 5 dB.
#[test]
fn knowing_weak_crosstalk_is_not_worse_than_leaving_it_out() {
    let bench = Bench::new(40);
    for sigma in [50.0, 10.0] {
        let aware = bench.solve(terms(Some(sigma)), &bench.settings);
        let unaware = bench.solve(terms(None), &bench.settings);
        let [aware, unaware] =
            [aware, unaware].map(|solved| seen_on(&bench.problem(terms(Some(sigma))), &solved.phases));
        eprintln!("sigma {sigma}: {aware:.2} dB with crosstalk, {unaware:.2} without");
        assert!(aware > unaware - 0.1, "sigma {sigma}: {aware:.2} dB with crosstalk, {unaware:.2} without");
    }
}

/// This is true at each strength of crosstalk, and with either optimizer.
#[test]
fn more_steps_never_end_lower() {
    let bench = Bench::new(0);
    for optimizer in [Optimizer::projection(), Optimizer::adam()] {
        for sigma in [Some(1.0), Some(2.0), Some(4.0), Some(10.0), Some(50.0), None] {
            let solved = |steps| {
                let settings = Settings { optimizer, steps, ..bench.settings.clone() };
                bench.solve(terms(sigma), &settings).validation.mean()
            };
            let psnr = [10, 20, 40].map(solved);
            eprintln!("{optimizer:?}, sigma {sigma:?}: {psnr:.2?} dB after 10, 20 and 40 steps");
            assert!(psnr.windows(2).all(|pair| pair[1] > pair[0] - 0.1), "{optimizer:?}, sigma {sigma:?}: {psnr:.2?}");
        }
    }
}

/// Steps become shorter if a validation finds no better state, and the best phases replace phases that are much worse.
/// A descent with steps that are too long therefore still ends well, whether its score falls or stays the same.
#[test]
fn a_descent_that_diverges_continues_from_its_best_state() {
    let bench = Bench::new(60);
    let solved = |gain, seed| {
        let optimizer = Optimizer::Projection { gain, momentum: 0.7, overlap_power: 0.5 };
        // No state reaches this quality, so phases are validated ten times.
        let settings = Settings { optimizer, psnr: Some(99.0), seed, ..bench.settings.clone() };
        bench.solve(terms(None), &settings).validation.mean()
    };
    let usual = solved([2.5, 0.3], 0);
    for (gain, seed) in [(8.0, 0), (16.0, 0), (24.0, 0), (16.0, 1), (12.0, 2)] {
        let diverging = solved([gain; 2], seed);
        eprintln!("{usual:.2} dB with the usual strides, {diverging:.2} with gain {gain} and seed {seed}");
        assert!(diverging > usual - 3.0, "{diverging:.2} dB with gain {gain} and seed {seed}, usual {usual:.2}");
    }
}
