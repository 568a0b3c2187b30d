//! Tests of first phases from a table.

use super::made_by::Levels;
use super::made_by::MadeBy;
use super::{StartTable, Table};
use crate::engine::cpu::CpuEngine;
use crate::optics::{Color, Display, DisplayModel, Optics, Padding, Pupil, Spread};
use crate::plan::ModelTables;
use crate::scene::{self, Pyramid, Request, ViewGrid};
use crate::solve::{FirstPhases, Method, Problem, RefineSettings, Refiner, Settings, SolveError, random_phases};
use eyebox_kernels::pupil_light::pupil_light;
use eyebox_kernels::table_start::{LEVELS, level};
use std::sync::{Arc, LazyLock};

const FRAMES: usize = 8;

fn problem([height, width]: [usize; 2]) -> Problem {
    let display = Display { height, width, ..Display::preset("paper").unwrap() };
    let request = Request { views: 5, ..Request::new(&display, &[Color::Green]) };
    let field = scene::load("builtin:still-life", &request).unwrap();
    Problem::new(&field, Color::Green, &display, Padding::default()).unwrap()
}

static TABLE: LazyLock<(Problem, StartTable)> = LazyLock::new(|| {
    let problem = problem([96, 128]);
    let table = StartTable::quick(&problem, FRAMES);
    (problem, table)
});

fn refiner(problem: &Problem, phases: &[f32], exposure: f64) -> Refiner {
    Refiner::new(problem.clone(), phases, exposure, RefineSettings::default(), Box::new(CpuEngine::new())).unwrap()
}

fn pupils() -> Vec<Pupil> {
    [[0.0, 0.0, 4.0, 0.0], [4.0, -2.0, 4.0, 1.0], [-5.0, 3.0, 3.0, -1.0], [-2.0, -6.0, 5.0, 0.5], [0.5, 1.0, 12.0, 0.0]]
        .map(Pupil::from_mm)
        .to_vec()
}

/// An even picture of a brightness.
fn even(problem: &Problem, light: f32) -> Problem {
    let (height, width) = (problem.optics.height, problem.optics.width);
    let views = ViewGrid { rows: 1, columns: 1, cell: problem.eyebox };
    Problem { views, pyramid: Arc::new(Pyramid::new(&[vec![light; height * width]], height, width)), ..problem.clone() }
}

/// Every pupil sees an even picture in its brightness, also between two levels. Black stays black.
#[test]
fn even_pictures_are_seen_in_their_brightness_through_every_pupil() {
    let (problem, table) = &*TABLE;
    let seen = |light: f32| {
        let even = even(problem, light);
        let phases = table.phases(&even, 1.0).unwrap();
        let mut refiner = refiner(&even, &phases, 1.0);
        let mean = |picture: &[f32]| picture.iter().map(|v| f64::from(*v)).sum::<f64>() / picture.len() as f64;
        pupils().into_iter().map(|pupil| mean(&refiner.pictures(pupil).unwrap()[0])).collect::<Vec<f64>>()
    };
    for light in [0.1, 0.25, 0.35, 0.5, 0.9] {
        for mean in seen(light) {
            assert!((mean / f64::from(light) - 1.0).abs() < 0.2, "{light} is seen as {mean}");
        }
    }
    assert!(seen(0.0).iter().all(|mean| *mean < 0.02), "black is {:?}", seen(0.0));
}

/// A picture without any solve is visible at once. The worst pupil sees it better than after ten steps from random
/// phases.
#[test]
fn a_scene_is_seen_before_the_first_step() {
    let (problem, table) = &*TABLE;
    let exposure = 0.45;
    let after = |phases: &[f32], steps: usize| {
        let mut refiner = refiner(problem, phases, exposure);
        (0..steps).for_each(|_| assert!(refiner.step().unwrap().is_finite()));
        let sums = refiner.look(&pupils()).unwrap();
        let all: Vec<f64> = sums.iter().map(|s| s.psnr(exposure)).collect();
        [all.iter().sum::<f64>() / all.len() as f64, all.iter().copied().fold(f64::INFINITY, f64::min)]
    };
    let looked_up = table.phases(problem, exposure).unwrap();
    let random = random_phases(looked_up.len(), 1);
    let (at_once, one, ten) = (after(&looked_up, 0), after(&random, 1), after(&random, 10));
    println!("{at_once:.2?} at once, from random phases {one:.2?} after one step, {ten:.2?} after ten");
    assert!(at_once[0] > one[0] + 4.0 && at_once[1] > ten[1] + 1.0);
}

/// A solve begins by the display's table. Without a step its result is the table's phases.
#[test]
fn solves_begin_by_a_table_where_one_fits() {
    let (problem, _) = &*TABLE;
    let settings = Settings::default();
    assert!(!settings.may_begin_by_table(problem), "an SLM of fewer tiles");
    let large = Problem { optics: Optics { height: 256, width: 300, ..problem.optics }, ..problem.clone() };
    assert!(settings.may_begin_by_table(&large));
    for other in [
        Settings { first_phases: FirstPhases::Random, ..Settings::default() },
        Settings { method: Method::Smooth, ..Settings::default() },
    ] {
        assert!(!other.may_begin_by_table(&large), "{other:?}");
    }
    // The method `Table` works at any size.
    let alone = Settings { method: Method::Table, ..Settings::default() };
    let asked = alone.as_of_table(problem).unwrap();
    assert_eq!((asked.method, asked.steps), (Method::Slfh, 0));
    assert!(asked.may_begin_by_table(problem));
    let masked = Problem { optics: Optics { mask_factor: 2, ..large.optics }, ..large };
    assert!(!StartTable::fits(&masked));
    let refused = alone.as_of_table(&masked).unwrap_err();
    assert!(matches!(&refused, SolveError::Setting { value, .. } if value == Method::Table.name()), "{refused}");
}

/// An ended fit continues to the same table. A file is not used if it is damaged or of another display.
#[test]
fn a_fit_goes_on_where_it_was_ended_and_its_file_is_checked() {
    let problem = problem([48, 48]);
    let made_by = MadeBy::of(&problem, 2).sized(16, [4, 2]);
    let (mut whole, mut parts) = (Levels::default(), Levels::default());
    made_by.fit(&problem, &mut whole, &mut |_| true).unwrap();
    assert!(whole.are_all());
    for end in [0.0, 0.3, 0.7] {
        made_by.fit(&problem, &mut parts, &mut |share| share < end).unwrap();
        assert!(!parts.are_all());
        parts = made_by.parse(&made_by.bytes(&parts)).unwrap();
    }
    made_by.fit(&problem, &mut parts, &mut |_| true).unwrap();
    assert_eq!(parts, whole);
    let bytes = made_by.bytes(&whole);
    assert_eq!(made_by.parse(&bytes).as_ref(), Some(&whole));
    let other = MadeBy::of(&problem, 4).sized(16, [4, 2]);
    assert_eq!(other.parse(&bytes), None, "another number of sub-frames");
    assert_eq!(made_by.parse(&bytes[..bytes.len() - 2]), None, "cut short");
    let mut turned = bytes.clone();
    *turned.last_mut().unwrap() ^= 1;
    assert_eq!(made_by.parse(&turned), None, "damaged");
    assert_eq!(made_by.parse(b"no table"), None);
    let Table { angles, .. } = Table::made(&made_by, &whole);
    let at = |frame: usize, pixel: usize, level: usize| angles[(frame * 256 + pixel) * LEVELS + level];
    assert_eq!(at(1, 37, 5), whole.0[5].as_ref().unwrap()[256 + 37]);
    assert!((level(4) - 0.2).abs() < 1e-6);
}

/// Returns the light of the scene that decides the first phases of a problem.
fn light_of(problem: &Problem) -> Vec<f32> {
    let look_up = StartTable::even(1).look_up(problem, 1.0).expect("a table");
    let mut light = vec![0; problem.optics.height * problem.optics.width];
    pupil_light(&look_up.place, &problem.pyramid.levels[0].views, &look_up.shares, &mut light);
    let need = |i: usize| look_up.needs.as_ref().map_or(1.0, |needs| needs[i] as f32 / 65_536.0);
    let unit = problem.pyramid.scale / 65_535.0 / 65_536.0;
    light.iter().enumerate().map(|(i, sum)| *sum as f32 * unit * need(i)).collect()
}

/// The light comes from the middle views, on the SLM's pixels. It is increased if the source is weaker there.
#[test]
fn the_light_is_what_a_pupil_in_the_middle_sees() {
    let (height, width) = (48, 64);
    let display = Display { height, width, ..Display::preset("paper").unwrap() };
    let field =
        scene::load("builtin:still-life", &Request { views: 5, ..Request::new(&display, &[Color::Green]) }).unwrap();
    let of = |padding: Padding| Problem::new(&field, Color::Green, &display, padding).unwrap();
    let plain = of(Padding::default());
    let pupil = Pupil { diameter: 0.7 * plain.eyebox, ..Pupil::from_mm([0.0; 4]) };
    let seen = plain.views.coverage(&pupil);
    assert!((9..25).contains(&seen.len()), "{seen:?}");
    let model = DisplayModel { source: [0.3, 0.0, -0.5, 0.0, -0.2], ..DisplayModel::default() };
    let lit = model.source_amplitude([height, width]);
    let model = ModelTables::new(model, 10e-3, 256, plain.optics, plain.optics);
    let shaded = Problem { model, ..plain.clone() };
    let [plain, padded, shaded] =
        [plain, of(Padding { rows: 3, columns: 5 }), shaded].map(|problem| light_of(&problem));
    for at in [0, 700, height * width - 1] {
        let wanted: f64 = seen.iter().map(|(view, share)| share * f64::from(field.planes[0][*view][at])).sum();
        for light in [&plain, &padded] {
            assert!((f64::from(light[at]) - wanted).abs() < 1e-3, "{at}: {} {wanted}", light[at]);
        }
        assert!((f64::from(shaded[at]) * lit[at].powi(2) / wanted - 1.0).abs() < 1e-2, "{at}: {}", shaded[at]);
    }
}

/// A display with faults has its own table, which shows even pictures better than the table of an ideal display.
#[test]
fn a_table_is_fitted_through_the_faults_of_the_display() {
    let (plain, table) = &*TABLE;
    let crosstalk = [Spread { q: 1.3, sigma: 2.3 }; 4];
    let model = DisplayModel { crosstalk: Some(crosstalk), lag: 0.05, ..DisplayModel::default() };
    let model = ModelTables::new(model, 10e-3, 256, plain.optics, plain.optics);
    let problem = Problem { model, ..plain.clone() };
    assert_ne!(MadeBy::of(&problem, FRAMES).text(), MadeBy::of(plain, FRAMES).text());
    let left = |table: &StartTable| {
        let even = even(&problem, 0.5);
        let mut refiner = refiner(&even, &table.phases(&even, 1.0).unwrap(), 1.0);
        refiner.look(&pupils()).unwrap().iter().map(|sums| sums.psnr(1.0)).sum::<f64>()
    };
    let (own, plain) = (left(&StartTable::quick(&problem, FRAMES)), left(table));
    assert!(own > plain + 5.0, "{own:.2} dB of its own table over five pupils, {plain:.2} dB of the plain one");
}
