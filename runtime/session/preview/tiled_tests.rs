//! Tests the viewer of a hologram in tiles, both the picture and the small amount that is read for it.

use super::*;
use crate::engine::cpu::CpuEngine;
use crate::evaluate::Views;
use crate::hologram::{ColorHologram, Hologram, PhaseSource, Tiles};
use crate::optics::{Color, Display, Padding, Pupil};
use crate::reconstruction::SceneSource;
use crate::scene::Request;
use eyebox_base::error::ErrorData;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

const SIDE: usize = 512;

fn display() -> Display {
    Display { height: SIDE, width: SIDE, ..Display::preset("far-field").unwrap() }
}

/// Returns the content without the phases, which stay in their tiles.
fn showing(tiles: &Arc<Tiles>) -> PreviewContent {
    let shown = PreviewContent::new(tiles.about().clone(), Padding::default()).unwrap();
    PreviewContent { tiles: Some(Arc::clone(tiles)), ..shown }
}

/// Returns two colors of two sub-frames, in tiles that hold their first phases.
fn tiles(path: &Path) -> Arc<Tiles> {
    let display = display();
    let color = |color: Color| ColorHologram {
        color: Some(color),
        wavelength: display.optics(color).unwrap().wavelength,
        exposure: 0.5,
        efficiency: 0.4,
        phases: Vec::new(),
    };
    let about = Hologram {
        height: SIDE,
        width: SIDE,
        seed: 7,
        ..Hologram::on(&display, 2, [Color::Green, Color::Blue].map(color).to_vec())
    };
    let mut tiles = Tiles::create(path, &about, 32, serde_json::Value::Null, 4).unwrap();
    tiles.finish().unwrap();
    Arc::new(Tiles::open(path).unwrap())
}

fn cpu() -> Opener {
    Box::new(|| Ok(Box::new(CpuEngine::new())))
}

/// Returns a pupil whose size and center are given in pixels.
fn pupil(x: f64, y: f64, across: f64) -> Pupil {
    let pitch = display().pitch;
    Pupil { x: x * pitch, y: y * pitch, diameter: across * pitch, depth: 0.0 }
}

/// Returns the result of [`PhaseSource::look`] for all sub-frames or for one.
fn expected(tiles: &Arc<Tiles>, frame: Option<usize>, pupil: &Pupil) -> Vec<Vec<f32>> {
    let seen = PhaseSource::Tiled(Arc::clone(tiles)).look(frame, pupil, &mut CpuEngine::new()).unwrap();
    seen.into_iter().map(|plane| plane.values).collect()
}

#[test]
fn the_eye_sees_what_lies_under_the_pupil_and_reads_no_more() {
    let here = tempfile::tempdir().unwrap();
    let tiles = tiles(&here.path().join("h.zarr"));
    let showing = showing(&tiles);
    let mut eye = Eye::new(cpu());
    let all = 2 * 2 * 4 * (SIDE * SIDE) as u64;
    let mut read = Vec::new();
    for (across, most) in [(30.0, 0.03), (120.0, 0.15)] {
        let pupil = pupil(-100.0, 130.0, across);
        let before = tiles.moved()[0];
        let seen = eye.look(&showing, None, &pupil, Detail::Whole).unwrap();
        read.push(tiles.moved()[0] - before);
        let share = *read.last().unwrap() as f64 / all as f64;
        assert!(share > 0.0 && share < most, "{share} of the file for {across} pixels");
        let want = expected(&tiles, None, &pupil);
        assert!(seen.iter().zip(&want).all(|(s, w)| s.values == *w && s.rows * s.columns == w.len()));
        // One sub-frame alone has its own speckle.
        let one = eye.look(&showing, Some(1), &pupil, Detail::Whole).unwrap();
        assert_eq!(one[0].values, expected(&tiles, Some(1), &pupil)[0]);
        assert_ne!(one[0].values, seen[0].values);
        // The coarse picture shows the middle of the pupil, in fewer pixels, from fewer tiles, and equally bright.
        let before = tiles.moved()[0];
        let coarse = eye.look(&showing, None, &pupil, Detail::Coarse).unwrap();
        let less = tiles.moved()[0] - before;
        assert!(across < 100.0 || less < read[1] * 2 / 3, "{less} of {read:?}");
        let middle = Pupil { diameter: pupil.diameter / 2.0, ..pupil };
        assert_eq!(coarse[1].values, expected(&tiles, None, &middle)[1]);
        assert!(coarse[0].rows < seen[0].rows * 3 / 4);
    }
    assert!(read[1] > 3 * read[0], "{read:?}");
}

#[test]
fn the_viewer_shows_tiles_coarse_first_and_their_photograph() {
    let here = tempfile::tempdir().unwrap();
    let tiles = tiles(&here.path().join("h.zarr"));
    let display = display();
    let request = Request::new(&display, &[Color::Green, Color::Blue]);
    let views = || Views::of_colors("builtin:still-life", &request, 64).unwrap();
    let mut viewer = Viewer::start(cpu(), SceneSource::Around(views())).unwrap();
    let place = pupil(40.0, -20.0, 100.0);
    let look = Look { pupil: place, frame: None, side: Side::Seen, within: [100, 100] };
    viewer.look(look);
    viewer.show(Arc::new(showing(&tiles)));
    let wait = |viewer: &Viewer, look: &Look, whole: bool| {
        let since = Instant::now();
        while since.elapsed() < Duration::from_secs(60) {
            match viewer.newest().unwrap() {
                Some(seen) if seen.look == *look && (seen.whole || !whole) => return seen,
                _ => std::thread::sleep(Duration::from_millis(1)),
            }
        }
        panic!("no picture came");
    };
    let seen = wait(&viewer, &look, true);
    assert_eq!(viewer.looked(), 2, "a coarse picture came first");
    let want = expected(&tiles, None, &place);
    assert!(seen.planes.iter().zip(&want).all(|(s, w)| s.values == *w));
    assert_eq!(seen.seen.size, [100, 100]);
    // The target image from there is next to it.
    let both = Look { side: Side::Both, ..look };
    viewer.look(both);
    let seen = wait(&viewer, &both, true);
    let mut engine = CpuEngine::new();
    let wanted = SceneSource::Around(views()).photograph(&place, &mut engine).unwrap();
    assert!(wanted.len() == 2 && seen.wanted == wanted);
    assert!(seen.photograph.is_some_and(|p| p.size == [100, 100] && p.rgb.iter().any(|v| *v > 100)));
    assert!(seen.psnr_db.is_some_and(|db| db > 3.0 && db < 20.0), "{:?}: noise is no picture", seen.psnr_db);
    // Tiles are not compared with a scene of all views.
    let mut viewer = Viewer::start(cpu(), SceneSource::Around(views().into_iter().take(1).collect())).unwrap();
    viewer.look(both);
    viewer.show(Arc::new(showing(&tiles)));
    let since = Instant::now();
    let error = loop {
        match viewer.newest() {
            Err(error) => break error,
            Ok(seen) => assert!(seen.is_none() && since.elapsed() < Duration::from_secs(60)),
        }
    };
    assert_eq!(ErrorData::of(&error).code, "showing/other-optics", "{error}");
}
