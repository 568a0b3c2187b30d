//! Tests a visit's step against the ordinary one on the whole SLM, and the positions of pupils.

use super::*;
use crate::engine::cpu::CpuEngine;
use crate::optics::{Color, Display, Level, ModelOf, ModelTerms};
use crate::scene::Request;
use crate::solve::random_phases;
use proptest::prelude::*;

proptest! {
    /// Every pupil is inside its region. Within half a diameter of a pupil that touches an edge there are as many
    /// pupils as in the middle. At an edge of the SLM there are half as many again.
    #[test]
    fn edges_are_touched_as_often_as_the_middle_is_met(share in 0.05f64..0.4, low: bool, high: bool) {
        let (side, diameter, n) = (3e-3, share * 3e-3, 20_001);
        let places: Vec<f64> =
            (0..n).map(|i| place(2.0 * i as f64 / (n - 1) as f64 - 1.0, side, diameter, [low, high])).collect();
        let reach = (side - diameter) / 2.0;
        prop_assert!(places.iter().all(|x| x.abs() <= reach));
        let met = |at: f64| places.iter().filter(|x| (*x - at).abs() <= diameter / 2.0).count() as f64;
        for (outer, edge) in [(low, -reach), (high, reach)] {
            let expected = if outer { 1.5 } else { 1.0 };
            prop_assert!((met(edge) / met(0.0) - expected).abs() < 0.01, "{} of {}", met(edge), met(0.0));
        }
    }
}

#[test]
fn a_pupil_as_wide_as_its_region_stands_in_its_middle() {
    assert_eq!(place(0.7, 1e-3, 1e-3, [true, false]), 0.0);
}

const SIZE: [usize; 2] = [160, 192];

/// A far field with all possible terms and this lag.
fn display(lag: f64) -> Display {
    let terms = ModelTerms {
        level: Some(Level::Nodes([[0.95, 1.0, 1.05], [1.0, 1.04, 0.98], [1.1, 1.0, 0.9]])),
        bend: Some([0.12, -0.06]),
        lag: Some(lag),
        crosstalk: Some([[1.2, 2.03], [1.4, 2.8], [1.1, 2.6], [1.3, 2.4]].map(Into::into)),
        source: Some([0.1, -0.05, -0.3, 0.08, -0.2]),
        undiffracted: Some(vec![[0.15, 0.1, 0.4, -0.3, 0.2]]),
        wavefront: [(4, 0.15), (7, 0.05)].into(),
        iris: Some([0.05, -0.03, 1.02]),
        ..ModelTerms::default()
    };
    let far = Display::preset("far-field").unwrap();
    Display { height: SIZE[0], width: SIZE[1], model: [(ModelOf::Green, terms)].into(), ..far }
}

/// Steps of a visit to a region inside the SLM and to one at its corner move the region's phases like a step on the
/// whole SLM. The cases are several sub-frames that affect each other or not, and a single one.
#[test]
fn a_step_of_a_region_is_that_of_the_whole_display() {
    for (frames, lag) in [(1, 0.0), (3, 0.0), (3, 0.15)] {
        let display = display(lag);
        let whole = display.optics(Color::Green).unwrap();
        let model = ModelTables::of(&display, Color::Green, whole, whole).unwrap().for_steps();
        let request = Request::new(&display, &[Color::Green]);
        let views = Views::of_colors("builtin:still-life", &request, 64).unwrap().remove(0);
        let settings = Settings { diameter: [0.2e-3, 0.3e-3], ..Settings::default() };
        let size = RegionSize { rows: 64, columns: 96, bytes: 0 };
        let schedule = Schedule { visits: vec![[64, 32]] };
        let job = Job {
            color: 0,
            views: &views,
            model: Some(&model),
            settings: &settings,
            schedule: &schedule,
            size,
            before: 0,
        };
        // The visit is at a part in which crosstalk lets phases wrap, and at one in which it bounds them.
        for (at, in_visit) in [([64, 32], 0.0), ([96, 96], 0.9)] {
            let region = Region::new(
                &job,
                Planner::new(whole, frames, job.settings.window),
                [at, [64, 96]],
                [[false; 2]; 2],
                0.4,
            );
            let pupils: Vec<Pupil> = [[-0.1e-3, -0.05e-3, 0.25e-3], [0.05e-3, 0.02e-3, 0.22e-3]]
                .map(|[x, y, diameter]| {
                    let [cx, cy] = region.center;
                    region.asked(Pupil { x: cx + x, y: cy + y, diameter, depth: 0.0 })
                })
                .to_vec();
            let first = random_phases(frames * SIZE[0] * SIZE[1], 5);
            // The whole SLM uses the ordinary list.
            let Optimizer::Projection { gain, momentum, overlap_power } = settings.optimizer else { unreachable!() };
            let planner =
                Planner { model: Some(Arc::clone(&model)), grid: whole, slm: whole, frames, ..region.all.clone() };
            let (gain, momentum) = strides(&planner, gain, momentum);
            let (gain, momentum) = match frames == 1 || lag > 0.0 {
                true => (cosine(gain, 0.3), momentum),
                false => (cosine(gain, 0.3) / (1.0 - 0.5 * momentum), 0.0),
            };
            let update = Update::Projection { gain, momentum, overlap_power };
            let viewpoints: Vec<Viewpoint> = pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect();
            let mut step = update.step(&planner, update.pupil_passes(&planner, &viewpoints, 0.4), usize::MAX);
            release_early(&planner, in_visit, &mut step);
            let mut engine = CpuEngine::new();
            engine.load(&planner.shape(Purpose::Project), Some(Arc::clone(&region.pyramid))).unwrap();
            engine.write(Buffer::Phases, &first).unwrap();
            let want_loss = take(&mut engine, &step, slice::from_ref(&(0..step.list.len()))).unwrap();
            let want = engine.read(Buffer::Phases).unwrap();
            // The region starts from the same phases.
            let (from, held) = region.held;
            let row = |y: usize| (from[0] + y as i64).rem_euclid(SIZE[0] as i64) as usize;
            let column = |x: usize| (from[1] + x as i64).rem_euclid(SIZE[1] as i64) as usize;
            let cut = |all: &[f32]| -> Vec<f32> {
                let frame = |f: usize| (0..held[0] * held[1]).map(move |i| (f, row(i / held[1]), column(i % held[1])));
                (0..frames).flat_map(frame).map(|(f, y, x)| all[(f * SIZE[0] + y) * SIZE[1] + x]).collect()
            };
            let mut phases = cut(&first);
            engine.load(&region.one.shape(Purpose::Project), Some(Arc::clone(&region.pyramid))).unwrap();
            let loss = region.step(&pupils, 0.3, in_visit, &mut phases, &mut engine).unwrap();
            assert!((loss - want_loss).abs() < 1e-5 * want_loss, "{frames}, {lag}, loss {loss} instead of {want_loss}");
            let apart = |a: &[f32], b: &[f32]| {
                let waves = a.iter().zip(b).map(|(a, b)| 2.0 - 2.0 * f64::from(a - b).cos());
                waves.sum::<f64>() / a.len() as f64
            };
            let inner = |all: &[f32]| inside(all, held, [0, 1].map(|k| (at[k] as i64 - from[k]) as usize), [64, 96]);
            let (got, want, begun) = (inner(&phases), inner(&cut(&want)), inner(&cut(&first)));
            assert!(apart(&want, &begun) > 1e-3, "{frames}, {lag}, {at:?}: nothing moved");
            assert!(apart(&got, &want) < 1e-9, "{frames}, {lag}, {at:?}: {:.1e}", apart(&got, &want));
        }
    }
}
