//! Tests that a hologram finds its scene and display again, and refuses others.

use crate::common::{Refusal, handle, made, refused};
use eyebox::engine::{self, Choice};
use eyebox::hologram::PhaseSource;
use eyebox::optics::{Color, Display, Obstruction, Pupil};
use eyebox::reconstruction::SceneSource;
use eyebox::scene::Request;
use eyebox_c::*;
use std::ffi::{CStr, CString};
use std::mem::MaybeUninit;
use std::ptr::null;

const PUPIL: EyeboxPupil = EyeboxPupil { x_m: 2e-3, y_m: 0.0, diameter_m: 4e-3, depth_m: 0.0 };

struct Bench {
    display: Box<EyeboxDisplay>,
    engine: Box<EyeboxEngine>,
}

impl Bench {
    fn new() -> Self {
        // SAFETY: Every text ends with a zero byte.
        unsafe {
            let small = handle(|out| eyebox_display_load(c"small".as_ptr(), Some(out))).unwrap();
            let display = handle(|out| eyebox_display_resized(Some(&small), 40, 48, Some(out))).unwrap();
            let engine = handle(|out| eyebox_engine_open(c"cpu".as_ptr(), Some(out))).unwrap();
            Self { display, engine }
        }
    }

    fn scene(&self, source: &CStr, views: usize) -> Box<EyeboxScene> {
        // SAFETY: The text ends with a zero byte.
        unsafe {
            handle(|out| eyebox_scene_load(source.as_ptr(), Some(&self.display), EYEBOX_GREEN, views, Some(out)))
                .unwrap()
        }
    }

    /// Makes a scene from 2 x 2 views of the caller. Their light depends on `salt`.
    fn views(&self, salt: usize) -> Box<EyeboxScene> {
        let light: Vec<f32> = (0..4 * 40 * 48).map(|i| ((i * 37 + salt) % 97) as f32 / 97.0).collect();
        let views = EyeboxViews {
            name: null(),
            view_rows: 2,
            view_columns: 2,
            rows: 40,
            columns: 48,
            view_pitch_m: 2e-3,
            red: null(),
            green: light.as_ptr(),
            blue: null(),
            count: light.len(),
            // The views are noise, which shows no order.
            order: c"as-named".as_ptr(),
        };
        // SAFETY: The array has the stated length.
        unsafe { handle(|out| eyebox_scene_from_views(Some(&views), Some(&self.display), Some(out))).unwrap() }
    }

    /// Returns a hologram that was solved, saved and opened again.
    fn solved(&self, scene: &EyeboxScene, file: &CStr) -> Box<EyeboxHologram> {
        let settings = c"steps = 3\nframes = 2\npupils = 4\ndepth = [0.0, 0.0]";
        // SAFETY: Every text ends with a zero byte.
        unsafe {
            let solved = handle(|out| {
                let (display, engine) = (Some(&*self.display), Some(&*self.engine));
                let none = std::ptr::null_mut();
                eyebox_solve(Some(scene), display, settings.as_ptr(), engine, None, none, Some(out))
            });
            let saved = eyebox_hologram_save(Some(&solved.unwrap()), file.as_ptr());
            assert!(matches!(saved, EyeboxStatus::Ok));
            handle(|out| eyebox_hologram_open(file.as_ptr(), Some(out))).unwrap()
        }
    }

    fn psnr(&self, hologram: &EyeboxHologram, scene: Option<&EyeboxScene>) -> Result<f64, Refusal> {
        Ok(self.score(hologram, scene, None)?.psnr_db)
    }

    fn score(
        &self,
        hologram: &EyeboxHologram,
        scene: Option<&EyeboxScene>,
        obstruction: Option<&CStr>,
    ) -> Result<EyeboxScore, Refusal> {
        let obstruction = obstruction.map_or(null(), CStr::as_ptr);
        // SAFETY: There is one pupil, a text that is null or ends with a zero byte, and memory for one score.
        made(|score: &mut MaybeUninit<EyeboxScore>| unsafe {
            eyebox_score(Some(hologram), scene, &PUPIL, 1, obstruction, Some(&self.engine), score.as_mut_ptr())
        })
    }

    /// Returns the image through the pupil, in linear light.
    fn view(&self, hologram: &EyeboxHologram, obstruction: Option<&CStr>) -> Result<Vec<f32>, Refusal> {
        let obstruction = obstruction.map_or(null(), CStr::as_ptr);
        // SAFETY: The text is null or ends with a zero byte, and the memory has the stated size.
        let light = made(|light: &mut MaybeUninit<[f32; 40 * 48]>| unsafe {
            eyebox_view(
                Some(hologram),
                Some(&PUPIL),
                obstruction,
                Some(&self.engine),
                light.as_mut_ptr().cast(),
                40 * 48,
            )
        })?;
        Ok(light.to_vec())
    }
}

fn scene_of(hologram: &EyeboxHologram, source: Option<&CStr>, other: i32) -> Result<Box<EyeboxScene>, Refusal> {
    let source = source.map_or(null(), CStr::as_ptr);
    // SAFETY: The text is null or ends with a zero byte.
    handle(|out| unsafe { eyebox_scene_of_hologram(Some(hologram), source, other, Some(out)) })
}

#[test]
fn a_scene_is_read_as_it_was_solved() {
    let (bench, here) = (Bench::new(), tempfile::tempdir().unwrap());
    let file = CString::new(here.path().join("h.zarr").to_str().unwrap()).unwrap();
    let scene = bench.scene(c"builtin:still-life", 5);
    let hologram = bench.solved(&scene, &file);
    let right = bench.psnr(&hologram, Some(&scene)).unwrap();
    assert!((bench.psnr(&hologram, None).unwrap() - right).abs() < 1e-6);
    let again = scene_of(&hologram, Some(c"builtin:still-life"), 0).unwrap();
    assert!((bench.psnr(&hologram, Some(&again)).unwrap() - right).abs() < 1e-6);
    refused(
        scene_of(&hologram, Some(c"builtin:plane"), 0),
        "hologram/other-scene builtin:plane builtin:still-life other_scene",
    );
    assert!(bench.psnr(&hologram, Some(&bench.scene(c"builtin:plane", 0))).is_err());
    let other = scene_of(&hologram, Some(c"builtin:plane"), 1).unwrap();
    assert!(bench.psnr(&hologram, Some(&other)).unwrap() < right - 1.0);
    // The display of the hologram is cut to its size.
    // SAFETY: The hologram exists, null is allowed for the name, and `out` receives the handle.
    let own = handle(|out| unsafe { eyebox_hologram_display(Some(&hologram), null(), Some(out)) }).unwrap();
    let encoder = handle(|out| eyebox_encoder_new(Some(&own), EYEBOX_GREEN, 2, Some(out))).unwrap();
    let video = made(|out| eyebox_encoder_video(Some(&encoder), Some(out))).unwrap();
    assert_eq!((video.rows, video.columns), (40, 48));
    // The best state of a refinement has a higher score than the hologram.
    // SAFETY: Hologram and engine exist, null is allowed for the settings, and `out` receives the handle.
    let refiner =
        handle(|out| unsafe { eyebox_refiner_new(Some(&hologram), None, null(), Some(&bench.engine), Some(out)) });
    let refiner = refiner.unwrap();
    let aimed = eyebox_refiner_aim(Some(&refiner), Some(&PUPIL), 0.2e-3);
    assert!(matches!(aimed, EyeboxStatus::Ok));
    let best = handle(|out| eyebox_refiner_best(Some(&refiner), 6, Some(out))).unwrap();
    assert!(bench.psnr(&best, Some(&again)).unwrap() > right);
}

/// The picture and the score with an obstruction equal the results of the library. The error for an unknown name has
/// its own code and lists the valid names.
#[test]
fn an_obstruction_in_the_pupil_is_the_library_s() {
    let (bench, here) = (Bench::new(), tempfile::tempdir().unwrap());
    let file = here.path().join("h.zarr");
    let scene = bench.scene(c"builtin:still-life", 5);
    let hologram = bench.solved(&scene, &CString::new(file.to_str().unwrap()).unwrap());
    let own = PhaseSource::open(&file).unwrap().obstructed(Some(Obstruction::Opacity));
    let mut cpu = engine::open(Choice::Cpu).unwrap();
    let pupil = Pupil { x: PUPIL.x_m, y: PUPIL.y_m, diameter: PUPIL.diameter_m, depth: PUPIL.depth_m };
    let seen = own.about().seen(&pupil, cpu.as_mut()).unwrap();
    // `assert_eq` would print all pixels.
    assert!(bench.view(&hologram, Some(c"opacity")).unwrap() == seen[0].values);
    let [clear, obstructed] =
        [None, Some(c"opacity")].map(|marks| bench.score(&hologram, Some(&scene), marks).unwrap());
    assert!(bench.view(&hologram, None).unwrap() != seen[0].values && clear.against_clear_db.is_nan());
    let display = Display { height: 40, width: 48, ..Display::preset("small").unwrap() };
    let request = Request { views: 5, ..Request::new(&display, &[Color::Green]) };
    let field = eyebox::scene::load("builtin:still-life", &request).unwrap();
    let wanted = SceneSource::from(own.about().problems(&field).unwrap());
    let scores = own.score(&wanted, &[pupil], cpu.as_mut()).unwrap();
    let [psnr, against_clear] = [scores.pupils[0].psnr, scores.pupils[0].against_clear].map(Option::unwrap);
    let found = [obstructed.psnr_db, obstructed.against_clear_db];
    assert!((found[0] - psnr).abs() < 1e-6 && (found[1] - against_clear).abs() < 1e-6, "{found:?}");
    assert!(found[1].is_finite() && (found[0] - clear.psnr_db).abs() > 0.01, "{found:?}, clear {}", clear.psnr_db);
    let unknown = bench.score(&hologram, Some(&scene), Some(c"nose")).err().unwrap();
    assert_eq!(unknown.status, EyeboxStatus::Display);
    unknown.is("optics/unknown-obstruction nose lashes floaters opacity scratches");
    assert_eq!(bench.view(&hologram, Some(c"nose")).unwrap_err().status, EyeboxStatus::Display);
}

#[test]
fn views_of_the_caller_s_are_known_by_their_light() {
    let (bench, here) = (Bench::new(), tempfile::tempdir().unwrap());
    let file = CString::new(here.path().join("h.zarr").to_str().unwrap()).unwrap();
    let hologram = bench.solved(&bench.views(0), &file);
    let right = bench.psnr(&hologram, Some(&bench.views(0))).unwrap();
    assert!(right.is_finite());
    refused(bench.psnr(&hologram, Some(&bench.views(1))), "hologram/other-scene");
    refused(bench.psnr(&hologram, None), "hologram/no-scene");
}

/// The same rule holds for views in files and for arrays of Python.
#[test]
fn views_that_are_no_neighbors_are_refused_unless_a_grid_is_stated() {
    let bench = Bench::new();
    let mut random = 1u32;
    let mut light = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (random >> 8) as f32 / (1 << 24) as f32
    };
    let light: Vec<f32> = (0..9 * 40 * 48).map(|_| light()).collect();
    let scene = |order: Option<&CStr>| {
        let views = EyeboxViews {
            name: null(),
            view_rows: 3,
            view_columns: 3,
            rows: 40,
            columns: 48,
            view_pitch_m: 0.0,
            red: null(),
            green: light.as_ptr(),
            blue: null(),
            count: light.len(),
            order: order.map_or(null(), CStr::as_ptr),
        };
        // SAFETY: The array has the stated length, and the text is null or ends with a zero byte.
        handle(|out| unsafe { eyebox_scene_from_views(Some(&views), Some(&bench.display), Some(out)) })
    };
    refused(scene(None), "scene/cameras");
    refused(scene(Some(c"flip-rows")), "scene/cameras");
    refused(scene(Some(c"backwards")), "argument views.order backwards");
    scene(Some(c"as-named")).unwrap();
}

/// A refinement reports the display as its cause of failure if the scene lacks a color of the hologram.
#[test]
fn a_refinement_that_cannot_begin_names_its_cause() {
    let bench = Bench::new();
    let folder = tempfile::tempdir().unwrap();
    let file = CString::new(folder.path().join("both.zarr").to_str().unwrap()).unwrap();
    // SAFETY: C string literals end with a zero byte.
    unsafe {
        let name = c"builtin:plane".as_ptr();
        let both = EYEBOX_RED | EYEBOX_GREEN;
        let both = handle(|out| eyebox_scene_load(name, Some(&bench.display), both, 3, Some(out))).unwrap();
        let hologram = bench.solved(&both, &file);
        let green = bench.scene(c"builtin:plane", 3);
        let begin = |settings: *const std::ffi::c_char, scene| {
            let mut refiner = MaybeUninit::uninit();
            eyebox_refiner_new(Some(&hologram), Some(scene), settings, Some(&bench.engine), Some(&mut refiner))
        };
        assert!(matches!(begin(null(), &green), EyeboxStatus::Display));
        assert!(matches!(begin(c"pupils = 0".as_ptr(), &both), EyeboxStatus::Solve));
    }
}
