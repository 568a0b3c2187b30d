//! Tests the viewer against `evaluate`.

use super::*;
use crate::engine::cpu::CpuEngine;
use crate::engine::{Buffer, Engine, Purpose};
use crate::evaluate::{self, Plane};
use crate::hologram::{ColorHologram, Hologram, PhaseSource};
use crate::optics::{Color, Display, Geometry, Obstruction, Padding, Pupil, WindowFactor};
use crate::plan::Planner;
use crate::preview::picture::develop;
use crate::scene;
use crate::solve::{Motion, Problem};
use eyebox_base::error::ErrorData;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

const COLORS: [Color; 2] = [Color::Green, Color::Blue];

fn display() -> Display {
    Display { height: 24, width: 40, ..Display::preset("paper").unwrap() }
}

fn hologram(salt: usize) -> Hologram {
    let display = display();
    let color = |(i, color): (usize, Color)| ColorHologram {
        color: Some(color),
        wavelength: display.optics(color).unwrap().wavelength,
        exposure: 0.4 + 0.1 * i as f64,
        efficiency: 0.4,
        phases: (0..3 * 24 * 40).map(|k| ((k * 7919 + salt * 101 + i * 31) % 6283) as f32 * 1e-3 - 3.1).collect(),
    };
    Hologram {
        height: 24,
        width: 40,
        geometry: Geometry::Relay,
        ..Hologram::on(&display, 3, COLORS.into_iter().enumerate().map(color).collect())
    }
}

/// Returns the image of an eye by `evaluate`.
fn expected(hologram: &Hologram, frames: &[usize], pupil: &Pupil, padding: Padding) -> Vec<Vec<f32>> {
    let one = |i: usize| {
        let optics = hologram.optics(i).unwrap();
        let plain = Planner::new(optics, frames.len(), WindowFactor::Full).with_padding(padding);
        let planner = Planner { share: hologram.picture_share(i), ..plain };
        let mut engine = CpuEngine::new();
        engine.load(&planner.shape(Purpose::View), None).unwrap();
        let phases: Vec<f32> = frames.iter().flat_map(|f| hologram.frame(i, *f)).copied().collect();
        engine.write(Buffer::Phases, &phases).unwrap();
        evaluate::views(&mut engine, &planner, &[*pupil]).unwrap().remove(0)
    };
    (0..hologram.colors.len()).map(one).collect()
}

fn cpu() -> Opener {
    Box::new(|| Ok(Box::new(CpuEngine::new())))
}

fn values(planes: &[Plane]) -> Vec<Vec<f32>> {
    planes.iter().map(|p| p.values.clone()).collect()
}

fn pupils() -> [Pupil; 4] {
    [[0.0, 0.0, 4.0, 0.0], [5.0, -3.0, 2.0, 2.5], [-11.0, 11.0, 3.0, -4.0], [1.0, 2.0, 22.0, 0.5]].map(Pupil::from_mm)
}

fn look(pupil: Pupil) -> Look {
    Look { pupil, frame: None, side: Side::Seen, within: [24, 40] }
}

/// Waits for the whole picture of this view and content.
fn wait(viewer: &Viewer, look: &Look, content: u64) -> Result<RenderedView, PreviewError> {
    let since = Instant::now();
    while since.elapsed() < Duration::from_secs(60) {
        match viewer.newest()? {
            Some(seen) if seen.whole && seen.look == *look && seen.content == content => return Ok(seen),
            _ => std::thread::sleep(Duration::from_millis(1)),
        }
    }
    panic!("no picture came");
}

#[test]
fn an_eye_that_keeps_the_spectrum_sees_what_evaluate_sees() {
    let both = hologram(1);
    for padding in [Padding::default(), Padding { rows: 8, columns: 6 }] {
        let showing = PreviewContent::new(both.clone(), padding).unwrap();
        let mut eye = Eye::new(cpu());
        for (frame, frames) in [(None, vec![0, 1, 2]), (Some(2), vec![2]), (Some(1), vec![1])] {
            for pupil in pupils() {
                let seen = eye.look(&showing, frame, &pupil, Detail::Whole).unwrap();
                assert_eq!(values(&seen), expected(&both, &frames, &pupil, padding), "{pupil:?} {frame:?}");
            }
        }
    }
}

/// The obstruction moves with the pupil although the spectrum is kept, and it is removed again.
#[test]
fn an_obstructed_eye_that_keeps_the_spectrum_sees_what_the_hologram_shows_it() {
    let clear = hologram(1);
    let source = PhaseSource::from(clear.clone()).obstructed(Some(Obstruction::Lashes));
    let obstructed = PreviewContent::new(source.about().clone(), Padding::default()).unwrap();
    let clear = PreviewContent::new(clear, Padding::default()).unwrap();
    let mut eye = Eye::new(cpu());
    for pupil in pupils().into_iter().chain(pupils()) {
        let seen = eye.look(&obstructed, None, &pupil, Detail::Whole).unwrap();
        assert_eq!(values(&seen), values(&source.look(None, &pupil, &mut CpuEngine::new()).unwrap()), "{pupil:?}");
        let without = eye.look(&clear, None, &pupil, Detail::Whole).unwrap();
        assert_ne!(values(&seen), values(&without), "{pupil:?}");
    }
}

#[test]
fn a_picture_that_is_bent_is_shown_as_it_is_seen() {
    let mut bent = hologram(1);
    let seen = crate::optics::PictureWarp {
        homography: [0.9, 0.01, 0.0, -0.01, 0.9, 0.0, 0.0, 0.0],
        distortion: [0.08, 0.01],
    };
    bent.metadata.picture.set(Color::Green, seen);
    let showing = Arc::new(PreviewContent::new(bent.clone(), Padding::default()).unwrap());
    let (mut viewer, look) = (Viewer::start(cpu(), Vec::new()).unwrap(), look(pupils()[0]));
    viewer.show(showing);
    viewer.look(look);
    let got = wait(&viewer, &look, 1).unwrap();
    let plain = expected(&bent, &[0, 1, 2], &look.pupil, Padding::default());
    let plane = |values| Plane { rows: 24, columns: 40, values };
    let want = bent.as_seen(plain.iter().cloned().map(plane).collect());
    assert_eq!(values(&got.planes), values(&want));
    assert_ne!(values(&want), plain, "nothing is bent");
}

#[test]
fn a_far_field_is_seen_as_evaluate_sees_it() {
    let far = Hologram { geometry: Geometry::FarField, ..hologram(1) };
    let showing = PreviewContent::new(far.clone(), Padding::default()).unwrap();
    assert_eq!(showing.size(), [40, 40], "as far up as to the side");
    let mut eye = Eye::new(cpu());
    for pupil in [[0.0, 0.0, 0.1, 0.0], [0.05, -0.04, 0.06, 2.5]].map(Pupil::from_mm) {
        for detail in [Detail::Coarse, Detail::Whole] {
            let seen = eye.look(&showing, None, &pupil, detail).unwrap();
            assert_eq!(values(&seen), expected(&far, &[0, 1, 2], &pupil, Padding::default()), "{pupil:?} {detail:?}");
            assert!(seen.iter().all(|p| [p.rows, p.columns] == [40, 40] && p.values.len() == 1600));
        }
    }
}

#[test]
fn a_coarse_picture_is_the_whole_one_on_fewer_pixels() {
    let showing = PreviewContent::new(hologram(1), Padding::default()).unwrap();
    let mut eye = Eye::new(cpu());
    let pupil = Pupil::from_mm([3.0, -2.0, 3.0, 1.0]);
    let coarse = eye.look(&showing, None, &pupil, Detail::Coarse).unwrap();
    let whole = eye.look(&showing, None, &pupil, Detail::Whole).unwrap();
    for (c, w) in coarse.iter().zip(&whole) {
        assert!(c.rows < 24 && c.columns < 40, "{} x {}", c.rows, c.columns);
        // The samples have the same intensity, because trigonometric interpolation converts one to the other. Some
        // samples fall on a pixel of both.
        let (down, across) = (gcd(c.rows, 24), gcd(c.columns, 40));
        for i in 0..down {
            for j in 0..across {
                let (a, b) = (
                    c.values[i * c.rows / down * c.columns + j * c.columns / across],
                    w.values[i * 24 / down * 40 + j * 40 / across],
                );
                assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{i} {j}: {a} {b}");
            }
        }
    }
    assert!(coarse.iter().any(|c| gcd(c.rows, 24) * gcd(c.columns, 40) > 1));
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[test]
fn the_viewer_shows_the_newest_pupil_and_the_newest_hologram() {
    let (first, second) = (hologram(1), hologram(2));
    let mut viewer = Viewer::start(cpu(), Vec::new()).unwrap();
    let [a, b, ..] = pupils();
    viewer.look(look(a));
    viewer.show(Arc::new(PreviewContent::new(first.clone(), Padding::default()).unwrap()));
    let seen = wait(&viewer, &look(a), 1).unwrap();
    assert_eq!(values(&seen.planes), expected(&first, &[0, 1, 2], &a, Padding::default()));
    // The picture is developed from these planes, and without a scene there is no target image.
    let colors = COLORS.map(Some);
    assert_eq!(seen.seen, develop(&seen.planes, &colors, &[0.4, 0.5], [24, 40], [24, 40]));
    assert!(seen.photograph.is_none() && seen.psnr_db.is_none());
    viewer.look(look(b));
    let seen = wait(&viewer, &look(b), 1).unwrap();
    assert_eq!(values(&seen.planes), expected(&first, &[0, 1, 2], &b, Padding::default()));
    viewer.show(Arc::new(PreviewContent::new(second.clone(), Padding::default()).unwrap()));
    let seen = wait(&viewer, &look(b), 2).unwrap();
    assert_eq!(values(&seen.planes), expected(&second, &[0, 1, 2], &b, Padding::default()));
}

#[test]
fn what_came_in_between_is_never_computed() {
    // The engine opens when the test allows it. The first look is running until then.
    let (go, gate) = mpsc::channel::<()>();
    let (asked, began) = mpsc::channel::<()>();
    let opener: Opener = Box::new(move || {
        let _ = asked.send(());
        let _ = gate.recv();
        Ok(Box::new(CpuEngine::new()))
    });
    let mut viewer = Viewer::start(opener, Vec::new()).unwrap();
    viewer.show(Arc::new(PreviewContent::new(hologram(1), Padding::default()).unwrap()));
    let at = |i: usize| look(Pupil::from_mm([0.01 * i as f64, 0.0, 4.0, 0.0]));
    viewer.look(at(0));
    began.recv().unwrap();
    for i in 1..=500 {
        viewer.look(at(i));
    }
    drop(go);
    let seen = wait(&viewer, &at(500), 1).unwrap();
    assert_eq!(seen.look, at(500));
    // These are the first and the last picture. Each may have come twice, coarse and whole, on a slow machine.
    assert!(viewer.looked() <= 4, "{} pictures", viewer.looked());
}

#[test]
fn what_cannot_be_looked_at_is_said_and_the_next_is_looked_at() {
    let whole = PreviewContent::new(hologram(1), Padding::default()).unwrap();
    let mut cut = whole.clone();
    cut.colors[1].phases = Arc::new(vec![0.0; 7]);
    let mut viewer = Viewer::start(cpu(), Vec::new()).unwrap();
    viewer.look(look(pupils()[0]));
    viewer.show(Arc::new(cut));
    let error = wait(&viewer, &look(pupils()[0]), 1).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "showing/phases-count", "{error}");
    viewer.show(Arc::new(whole));
    assert!(wait(&viewer, &look(pupils()[0]), 2).is_ok());
}

#[test]
fn a_scene_is_photographed_through_the_same_pupil() {
    let display = display();
    let field =
        scene::load("builtin:still-life", &scene::Request { views: 3, ..scene::Request::new(&display, &COLORS) });
    let field = field.unwrap();
    let problems: Vec<Problem> =
        COLORS.iter().map(|c| Problem::new(&field, *c, &display, Padding::default()).unwrap()).collect();
    let mut viewer = Viewer::start(cpu(), problems.clone()).unwrap();
    viewer.show(Arc::new(PreviewContent::new(hologram(1), Padding::default()).unwrap()));
    let pupil = Pupil::from_mm([2.0, 1.0, 5.0, 0.5]);
    let both = Look { side: Side::Both, ..look(pupil) };
    viewer.look(both);
    let seen = wait(&viewer, &both, 1).unwrap();
    let photographs: Vec<Plane> = problems
        .iter()
        .map(|problem| {
            let planner = problem.planner(1, WindowFactor::Full);
            let mut engine = CpuEngine::new();
            engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid))).unwrap();
            let values = evaluate::photographs(&mut engine, &planner, &[pupil]).unwrap().remove(0);
            Plane { rows: 24, columns: 40, values }
        })
        .collect();
    let picture = develop(&photographs, &COLORS.map(Some), &[1.0, 1.0], [24, 40], [24, 40]);
    assert_eq!(seen.photograph, Some(picture));
    // The same number is computed by hand.
    let mut error = 0.0;
    for (i, (s, t)) in seen.planes.iter().zip(&photographs).enumerate() {
        let (s, t) = (evaluate::pool2(&s.values, 24, 40), evaluate::pool2(&t.values, 24, 40));
        error += s
            .iter()
            .zip(&t)
            .map(|(s, t)| (f64::from(*s) * (0.4 + 0.1 * i as f64) - f64::from(*t)).powi(2))
            .sum::<f64>();
    }
    let db = -10.0 * (error / (2.0 * 12.0 * 20.0)).log10();
    assert!((seen.psnr_db.unwrap() - db).abs() < 1e-3, "{:?} {db}", seen.psnr_db);
    let alone = Look { side: Side::Photograph, ..look(pupil) };
    viewer.look(alone);
    let seen = wait(&viewer, &alone, 1).unwrap();
    assert!(seen.planes.is_empty() && seen.photograph.is_some());
    // A hologram in other colors has no target image.
    let mut one = PreviewContent::new(hologram(1), Padding::default()).unwrap();
    one.colors.pop();
    viewer.show(Arc::new(one));
    assert_eq!(ErrorData::of(&wait(&viewer, &alone, 2).unwrap_err()).code, "showing/other-optics");
}

/// Content that follows an eye changes from set to set. On a slow machine nothing ever rests, but the PSNR is still
/// computed.
#[test]
fn what_never_rests_is_compared_now_and_then() {
    let display = display();
    let request = scene::Request { views: 3, ..scene::Request::new(&display, &COLORS[..1]) };
    let field = scene::load("builtin:still-life", &request).unwrap();
    let problem = Problem::new(&field, COLORS[0], &display, Padding::default()).unwrap();
    // It takes so long that no picture is quick.
    let slow = || {
        std::thread::sleep(Duration::from_millis(45));
        Ok(())
    };
    let engine = move || Ok(Box::new(CpuEngine::watched(slow)) as _);
    let mut viewer = Viewer::start(Box::new(engine), vec![problem]).unwrap();
    let showing = |salt| {
        let mut one = hologram(salt);
        one.colors.truncate(1);
        Arc::new(PreviewContent::new(one, Padding::default()).unwrap())
    };
    let (both, since) = ([showing(1), showing(2)], Instant::now());
    let (mut coarse, mut compared) = (0, Vec::new());
    for i in 0.. {
        viewer.show(Arc::clone(&both[i % 2]));
        viewer.look(look(Pupil::from_mm([0.001 * i as f64, 0.0, 4.0, 0.0])));
        if let Some(seen) = viewer.newest().unwrap() {
            assert_eq!(seen.whole, seen.psnr_db.is_some());
            coarse += u64::from(!seen.whole);
            compared.extend(seen.psnr_db.map(|_| seen.look.pupil.x));
        }
        if compared.len() == 3 {
            break;
        }
        assert!(since.elapsed() < Duration::from_secs(60), "{compared:?} of {coarse}");
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(coarse >= 2 && compared.is_sorted(), "{compared:?} of {coarse}");
}

#[test]
fn a_reader_reads_what_is_wanted_last() {
    use crate::hologram::Sequence;
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("one.zarr");
    hologram(3).save(&file).unwrap();
    let reader = Reader::start(Sequence::open(&file).unwrap()).unwrap();
    reader.want(0);
    let since = Instant::now();
    let (index, read) = loop {
        match reader.newest().unwrap() {
            Some(read) => break read,
            None => assert!(since.elapsed() < Duration::from_secs(60)),
        }
    };
    assert!(index == 0 && read.unwrap() == Hologram::load(&file).unwrap());
}

/// With changing content, each picture is compared with its own scene and not with another one.
#[test]
fn what_changes_is_compared_with_its_own_scene() {
    let display = display();
    let problems = |name: &str| -> Vec<Problem> {
        let request = scene::Request { views: 3, ..scene::Request::new(&display, &COLORS) };
        let field = scene::load(name, &request).unwrap();
        COLORS.iter().map(|c| Problem::new(&field, *c, &display, Padding::default()).unwrap()).collect()
    };
    let (one, other) = (problems("builtin:still-life"), problems("builtin:plane"));
    let shown = PreviewContent::new(hologram(1), Padding::default()).unwrap();
    let both = Look { side: Side::Both, ..look(Pupil::from_mm([2.0, 1.0, 5.0, 0.5])) };
    let judged = |viewer: &Viewer, content| {
        let seen = wait(viewer, &both, content).unwrap();
        (seen.psnr_db, values(&seen.wanted))
    };
    let alone = |scene: &Vec<Problem>| {
        let mut viewer = Viewer::start(cpu(), scene.clone()).unwrap();
        viewer.show(Arc::new(shown.clone()));
        viewer.look(both);
        judged(&viewer, 1)
    };
    assert_ne!(alone(&one), alone(&other));
    let mut viewer = Viewer::start(cpu(), one.clone()).unwrap();
    viewer.look(both);
    for (content, scene) in [&one, &other, &one, &other].into_iter().enumerate() {
        viewer.show(Arc::new(PreviewContent { scene: Some(Arc::new(scene.clone())), ..shown.clone() }));
        assert_eq!(judged(&viewer, content as u64 + 1), alone(scene), "{content}");
    }
}

/// With moving content, the image and the target image are integrated over the motion. For an eye that follows, the
/// target image is still.
#[test]
fn what_moves_is_integrated_over_the_motion() {
    let display = display();
    let request = scene::Request { views: 3, ..scene::Request::new(&display, &COLORS) };
    let field = scene::load("builtin:still-life", &request).unwrap();
    let problem = |c: &Color| Problem::new(&field, *c, &display, Padding::default()).unwrap();
    let problems: Vec<Problem> = COLORS.iter().map(problem).collect();
    let pupil = Pupil::from_mm([2.0, 1.0, 5.0, 0.5]);
    let both = Look { side: Side::Both, ..look(pupil) };
    let content = [6.0, 0.0];
    let seen = |eye: [f64; 2]| {
        let motion = Motion { content, eye: Some(eye), ..Motion::default() };
        let shown = PreviewContent::new(hologram(1), Padding::default()).unwrap();
        let mut viewer = Viewer::start(cpu(), problems.clone()).unwrap();
        viewer.show(Arc::new(PreviewContent { motion: vec![motion; 2], ..shown.clone() }));
        viewer.look(both);
        let seen = wait(&viewer, &both, 1).unwrap();
        // The function `evaluate` gives the same result.
        let planner = Planner::new(shown.colors[0].optics, 3, WindowFactor::Full);
        let mut engine = CpuEngine::new();
        engine.load(&planner.shape(Purpose::View), None).unwrap();
        engine.write(Buffer::Phases, &shown.colors[0].phases).unwrap();
        let pass = planner.viewpoint(&motion.seen_through(pupil, 3), &Default::default());
        engine.run(&planner.view_step(vec![pass])).unwrap();
        assert_eq!(seen.planes[0].values, engine.read(Buffer::Image(0)).unwrap(), "{eye:?}");
        values(&seen.wanted)
    };
    let still = {
        let mut viewer = Viewer::start(cpu(), problems.clone()).unwrap();
        viewer.show(Arc::new(PreviewContent::new(hologram(1), Padding::default()).unwrap()));
        viewer.look(both);
        values(&wait(&viewer, &both, 1).unwrap().wanted)
    };
    assert_eq!(seen(content), still, "who follows");
    assert_ne!(seen([0.0; 2]), still, "who rests");
}
