//! A far field in tiles on a display with faults (OPTICS 9, 10). Views and refinement of one piece at a time equal the
//! result of the whole SLM, on both engines.

use eyebox::low_level::engine::{Buffer, Engine, cpu::CpuEngine};
use eyebox::low_level::evaluate::Views;
use eyebox::low_level::hologram::{ColorHologram, Hologram, Metadata, PhaseSource, Tiles};
use eyebox::low_level::optics::{
    Color, Display, DisplayModel, Geometry, Level, ModelOf, ModelTerms, Obstruction, Optics, Pupil, PupilDistribution,
    WindowFactor,
};
use eyebox::low_level::plan::{Comparison, ModelTables, Planner, Purpose};
use eyebox::low_level::reconstruction::Sampling;
use eyebox::low_level::scene::Request;
use eyebox::low_level::solve::{Problem, RefineSettings, Refiner};
use eyebox::low_level::tiled::problem_around;
use eyebox_tests::both::{every_fault, vulkan};
use eyebox_tests::error_power;
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;

const SIZE: [usize; 2] = [224, 288];
const FRAMES: usize = 3;

/// Returns every term that a far field has. Its pixels are points, and crosstalk is computed at one value per pixel.
fn model() -> DisplayModel {
    let mut model = every_fault();
    (model.fill, model.subpixels) = (0.0, 1);
    model
}

/// Returns the display with this model, in the terms of a file.
fn display(model: &DisplayModel) -> Display {
    let terms = ModelTerms {
        level: Some(Level::Nodes(model.level)),
        bend: Some(model.bend),
        lag: Some(model.lag),
        crosstalk: model.crosstalk,
        source: Some(model.source),
        undiffracted: Some(model.undiffracted.clone()),
        wavefront: model.wavefront.clone(),
        iris: Some([model.iris.x * 1e3, model.iris.y * 1e3, model.iris.scale]),
        ..ModelTerms::default()
    };
    // Green alone is as wide as the picture, so none of it is cut off.
    let mut far = Display::preset("far-field").unwrap();
    far.wavelengths.retain(|w| w.color == Color::Green);
    Display { height: SIZE[0], width: SIZE[1], model: [(ModelOf::Green, terms)].into(), ..far }
}

/// Returns a hologram of first phases on that display, in tiles of 32 pixels.
fn tiles(at: &Path, display: &Display) -> Tiles {
    let optics = display.optics(Color::Green).unwrap();
    let (wavelength, color) = (optics.wavelength, Some(Color::Green));
    let green = ColorHologram { color, wavelength, exposure: 0.4, efficiency: 0.5, phases: Vec::new() };
    let metadata = Metadata { model: display.model.clone(), ..Metadata::default() };
    let about = Hologram { metadata, seed: 3, ..Hologram::on(display, FRAMES, vec![green]) };
    Tiles::create(at, &about, 32, Value::Null, 1).unwrap()
}

fn whole(tiles: &Tiles) -> Vec<f32> {
    tiles.read(0, [0, 0], SIZE).unwrap()
}

/// Returns the view of the whole SLM, through the exact model.
fn seen_whole(
    optics: Optics,
    model: Option<&Arc<ModelTables>>,
    frames: usize,
    phases: &[f32],
    pupil: &Pupil,
) -> Vec<f32> {
    let planner = Planner { model: model.cloned(), ..Planner::new(optics, frames, WindowFactor::One) };
    let mut engine = CpuEngine::new();
    engine.load(&planner.shape(Purpose::View), None).unwrap();
    engine.write(Buffer::Phases, phases).unwrap();
    engine.run(&planner.view_step(vec![planner.pupil_pass(pupil, &Comparison::default())])).unwrap();
    let image = engine.read(Buffer::Image(0)).unwrap();
    let n = (image.len() as f64).sqrt() as usize;
    eyebox::low_level::evaluate::centered(&image, n, n)
}

/// Pupils are in the middle, at a side and over a corner. Terms are alone and all together, with whole sets and with
/// one sub-frame.
#[test]
fn views_are_those_of_one_piece() {
    let all = model();
    let terms = ["level", "bend", "lag", "crosstalk", "source", "undiffracted", "wavefront", "iris"];
    let models = terms.map(|term| (term, all.only(term))).into_iter().chain([("all", all.clone())]);
    let mut gpu: Box<dyn Engine> = Box::new(vulkan());
    for (name, model) in models {
        let (here, display) = (tempfile::tempdir().unwrap(), display(&model));
        let tiles = Arc::new(tiles(&here.path().join("h.zarr"), &display));
        let optics = display.optics(Color::Green).unwrap();
        let tables = ModelTables::of(&display, Color::Green, optics, optics);
        assert!(tables.is_some(), "{name}");
        let phases = whole(&tiles);
        let source = PhaseSource::Tiled(Arc::clone(&tiles));
        // These are the true positions of the iris. A pupil over an edge has a different window in a piece.
        for mm in [[0.1, -0.1, 0.5, 30.0], [-0.94, 0.2, 0.4, 0.0], [0.84, 0.58, 0.6, -20.0]] {
            let pupil = model.asked_pupil(&Pupil::from_mm(mm));
            let both: [&mut dyn Engine; 2] = [&mut CpuEngine::new(), gpu.as_mut()];
            for (engine, on) in both.into_iter().zip(["CPU", "Vulkan"]) {
                let mut look =
                    |frame| source.look_through(0, frame, &[pupil], Sampling::Pupil, engine).unwrap().remove(0).values;
                // Crosstalk is left out if less than 1e-8 of the field's power comes from beyond its distance.
                let most = if model.crosstalk.is_some() { 3e-8 } else { 1e-11 };
                let want = seen_whole(optics, tables.as_ref(), FRAMES, &phases, &pupil);
                let error = error_power(&look(None), &want.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
                assert!(error < most, "{name} through {mm:?} on {on}: error power {error:.1e}");
                let second = &phases[SIZE[0] * SIZE[1]..2 * SIZE[0] * SIZE[1]];
                let want = seen_whole(optics, tables.as_ref(), 1, second, &pupil);
                let error = error_power(&look(Some(1)), &want.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
                assert!(error < most, "{name}, one sub-frame, through {mm:?} on {on}: error power {error:.1e}");
            }
        }
        let pupil = Pupil::from_mm([0.1, -0.1, 0.5, 30.0]);
        // This view has lashes in the pupil.
        let planner = Planner { model: tables.clone(), ..Planner::new(optics, FRAMES, WindowFactor::One) };
        let lashes = planner.obstructed(Obstruction::Lashes, &pupil).model;
        let obstructed = source.clone().obstructed(Some(Obstruction::Lashes));
        let seen =
            obstructed.look_through(0, None, &[pupil], Sampling::Pupil, &mut CpuEngine::new()).unwrap().remove(0);
        let want = seen_whole(optics, lashes.as_ref(), FRAMES, &phases, &pupil);
        assert_ne!(want, seen_whole(optics, tables.as_ref(), FRAMES, &phases, &pupil), "{name}: no lash is visible");
        let error = error_power(&seen.values, &want.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
        let most = if model.crosstalk.is_some() { 3e-8 } else { 1e-11 };
        assert!(error < most, "{name}, lashes: error power {error:.1e}");
        // This view ignores the model and shows an ideal display.
        let ideal = source.on_ideal_display();
        let seen = ideal.look_through(0, None, &[pupil], Sampling::Pupil, &mut CpuEngine::new()).unwrap().remove(0);
        let want = seen_whole(optics, None, FRAMES, &phases, &pupil);
        let error = error_power(&seen.values, &want.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
        assert!(error < 1e-11, "{name}, ideal: error power {error:.1e}");
    }
}

/// Compares steps of a refinement around the eye, with the tiles around it and with the whole SLM.
#[test]
fn a_steered_piece_is_refined_as_the_whole_is() {
    let (here, display) = (tempfile::tempdir().unwrap(), display(&model()));
    let tiles = tiles(&here.path().join("h.zarr"), &display);
    let optics = display.optics(Color::Green).unwrap();
    assert_eq!(optics.geometry, Geometry::FarField);
    let request = Request::new(&display, &[Color::Green]);
    let views = Views::of_colors("builtin:still-life", &request, 64).unwrap().remove(0);
    let aim = PupilDistribution {
        centre: [-0.25e-3, 0.3e-3],
        spread: 0.02e-3,
        diameter: [0.3e-3, 0.4e-3],
        focus: [0.0; 2],
        elsewhere: 0.0,
    };
    let (piece, _) = problem_around(&tiles, 0, &views, &aim).unwrap();
    let ([top, left], [rows, columns]) = (piece.at, piece.size);
    assert!(rows < SIZE[0] && columns < SIZE[1], "{rows} x {columns}: all of the SLM");
    let model = ModelTables::of(&display, Color::Green, optics, optics).unwrap().for_steps();
    let whole_problem = || {
        let (_, piece) = problem_around(&tiles, 0, &views, &aim).unwrap();
        Problem { optics, eyebox: optics.eyebox(), model: Some(Arc::clone(&model)), ..piece }
    };
    let steering = RefineSettings { elsewhere: 0.0, ..RefineSettings::default() };
    let refined = |problem: Problem, phases: &[f32], engine: Box<dyn Engine>| {
        let mut refiner = Refiner::new(problem, phases, 0.4, steering, engine).unwrap();
        refiner.aim(aim).unwrap();
        let losses = [refiner.step().unwrap(), refiner.step().unwrap()];
        (losses, refiner.phases().unwrap())
    };
    let first = whole(&tiles);
    let (want, all) = refined(whole_problem(), &first, Box::new(CpuEngine::new()));
    let cut: Vec<f64> = (all.chunks_exact(SIZE[0] * SIZE[1]))
        .flat_map(|frame| frame.chunks_exact(SIZE[1]).skip(top).take(rows))
        .flat_map(|row| row[left..left + columns].iter().map(|p| f64::from(*p)))
        .collect();
    let begun = tiles.read(0, piece.at, piece.size).unwrap();
    let moved = begun.iter().zip(&cut).filter(|(a, b)| (f64::from(**a) - **b).abs() > 0.01).count();
    assert!(moved > 1000, "{moved} phases moved");
    let engines: [Box<dyn Engine>; 2] = [Box::new(CpuEngine::new()), Box::new(vulkan())];
    for engine in engines {
        let (_, problem) = problem_around(&tiles, 0, &views, &aim).unwrap();
        let on = engine.describe();
        let (losses, phases) = refined(problem, &begun, engine);
        for (got, want) in losses.iter().zip(want) {
            assert!((got - want).abs() < 1e-3 * want, "{on}: losses {losses:?}, not {want:?}");
        }
        // The comparison is of waves, because a phase at one end of the range may appear at the other end.
        let apart: f64 = phases.iter().zip(&cut).map(|(a, b)| 2.0 - 2.0 * (f64::from(*a) - b).cos()).sum();
        let share = apart / cut.len() as f64;
        assert!(share < 1e-5, "{on}: phases differ by {share:.1e} of the waves' power");
    }
}
