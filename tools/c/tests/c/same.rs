//! Tests that the results of the C interface equal the results of the library.

use crate::common::{handle, made, refused};
use eyebox::engine::{self, Choice};
use eyebox::hologram::Hologram;
use eyebox::optics::{Color, Display, Pupil};
use eyebox::produce::{SceneJob, solve_scene};
use eyebox::solve::{Flow, Settings};
use eyebox_c::*;
use sha2::{Digest, Sha256};
use std::ffi::{CStr, CString, c_void};
use std::mem::MaybeUninit;
use std::ptr::null;

fn digest(phases: &[f32]) -> Vec<u8> {
    Sha256::digest(phases.iter().flat_map(|p| p.to_le_bytes()).collect::<Vec<u8>>()).to_vec()
}

struct Solved {
    display: Box<EyeboxDisplay>,
    engine: Box<EyeboxEngine>,
    scene: Box<EyeboxScene>,
    hologram: Box<EyeboxHologram>,
}

const SETTINGS: &CStr = c"steps = 3\nframes = 2\npupils = 4\nseed = 7";

fn solved() -> Solved {
    // SAFETY: Every text ends with a zero byte.
    unsafe {
        let small = handle(|out| eyebox_display_load(c"small".as_ptr(), Some(out))).unwrap();
        let display = handle(|out| eyebox_display_resized(Some(&small), 40, 48, Some(out))).unwrap();
        let engine = handle(|out| eyebox_engine_open(c"cpu".as_ptr(), Some(out))).unwrap();
        let source = c"builtin:still-life".as_ptr();
        let scene = handle(|out| eyebox_scene_load(source, Some(&display), EYEBOX_GREEN, 0, Some(out))).unwrap();
        let hologram = handle(|out| {
            let (scene, display, engine) = (Some(&*scene), Some(&*display), Some(&*engine));
            eyebox_solve(scene, display, SETTINGS.as_ptr(), engine, None, std::ptr::null_mut(), Some(out))
        });
        Solved { display, engine, scene, hologram: hologram.unwrap() }
    }
}

fn library() -> (Display, Hologram) {
    let display = Display { height: 40, width: 48, ..Display::load("small").unwrap() };
    let settings = Settings { steps: 3, frames: 2, pupils: 4, seed: 7, ..Settings::default() };
    let job = SceneJob { colors: vec![Color::Green], settings, ..SceneJob::new("builtin:still-life", &display) };
    let mut engine = engine::open(Choice::Cpu).unwrap();
    let solved = solve_scene(&job, None, engine.as_mut(), &mut |_| Flow::Continue).unwrap();
    (display.clone(), solved.into_hologram().unwrap())
}

fn phases(hologram: &EyeboxHologram) -> &[f32] {
    let mut count = MaybeUninit::uninit();
    let at = made(|at| eyebox_hologram_phases(Some(hologram), 0, Some(at), Some(&mut count))).unwrap();
    // SAFETY: The hologram has this number of phases in its memory.
    unsafe { std::slice::from_raw_parts(at, count.assume_init()) }
}

#[test]
fn solved_seen_and_encoded_as_by_the_library() {
    let Solved { display, engine, scene, hologram } = solved();
    let (own_display, own) = library();
    assert_eq!(digest(phases(&hologram)), digest(&own.colors[0].phases));

    let size = made(|out| eyebox_hologram_size(Some(&hologram), Some(out))).unwrap();
    assert_eq!((size.colors, size.color, size.frames), (1, [EYEBOX_GREEN, 0, 0], 2));
    assert_eq!((size.rows, size.columns, size.picture_rows, size.picture_columns), (40, 48, 40, 48));
    let pupil = EyeboxPupil { x_m: 2e-3, y_m: 0.0, diameter_m: 4e-3, depth_m: 1e-3 };
    let mut light = vec![0.0f32; 40 * 48];
    // SAFETY: The memory has the stated size.
    let status =
        unsafe { eyebox_view(Some(&hologram), Some(&pupil), null(), Some(&engine), light.as_mut_ptr(), light.len()) };
    assert_eq!(status, EyeboxStatus::Ok);
    let pupil = Pupil { x: 2e-3, y: 0.0, diameter: 4e-3, depth: 1e-3 };
    let planes = own.look(&pupil, engine::open(Choice::Cpu).unwrap().as_mut()).unwrap();
    let exposed: Vec<f32> = planes[0].values.iter().map(|v| v * own.colors[0].exposure as f32).collect();
    assert_eq!(light, exposed);

    let encoder = handle(|out| eyebox_encoder_new(Some(&display), EYEBOX_GREEN, 2, Some(out))).err();
    let frames = own.encode(&own_display);
    match frames {
        Err(error) => assert!(encoder.unwrap().message.contains(&error.to_string())),
        Ok(frames) => {
            let encoder = handle(|out| eyebox_encoder_new(Some(&display), EYEBOX_GREEN, 2, Some(out))).unwrap();
            let video = made(|out| eyebox_encoder_video(Some(&encoder), Some(out))).unwrap();
            let mut bytes = vec![1u8; video.bytes];
            let at = bytes.as_mut_ptr().cast::<c_void>();
            // SAFETY: The memory has the stated size.
            let status = unsafe { eyebox_encode(Some(&encoder), Some(&hologram), at, bytes.len()) };
            assert_eq!((status, &bytes[..]), (EyeboxStatus::Ok, frames.bytes()));
        }
    }

    let folder = tempfile::tempdir().unwrap();
    let path = CString::new(folder.path().join("x.zarr").to_str().unwrap()).unwrap();
    // SAFETY: Every text ends with a zero byte.
    unsafe {
        assert_eq!(eyebox_hologram_save(Some(&hologram), path.as_ptr()), EyeboxStatus::Ok);
        let opened = handle(|out| eyebox_hologram_open(path.as_ptr(), Some(out))).unwrap();
        assert_eq!(phases(&opened), phases(&hologram));
        let json = CStr::from_ptr(made(|out| eyebox_hologram_metadata(Some(&opened), Some(out))).unwrap());
        assert!(json.to_str().unwrap().contains("\"seed\":7"), "{json:?}");
    }
    drop(scene);
}

extern "C" fn after_one(step: *const EyeboxStep, user: *mut c_void) -> i32 {
    // SAFETY: The step is valid during the call, and `user` is the pointer that the test gave to `eyebox_solve`.
    let (step, told) = unsafe { (&*step, &mut *user.cast::<Vec<usize>>()) };
    told.push(step.step);
    i32::from(step.pilot_steps == 0)
}

#[test]
fn a_solve_is_ended_by_its_caller_and_views_may_be_the_caller_s() {
    let Solved { display, engine, .. } = solved();
    // There are four views of 20 x 24 pixels, which are scaled up.
    let views: Vec<f32> = (0..4 * 20 * 24).map(|i| (i % 24) as f32 / 24.0).collect();
    let own = EyeboxViews {
        name: c"ramp".as_ptr(),
        view_rows: 2,
        view_columns: 2,
        rows: 20,
        columns: 24,
        view_pitch_m: 1e-3,
        red: null(),
        green: views.as_ptr(),
        blue: null(),
        count: views.len(),
        order: null(),
    };
    // SAFETY: Arrays have the stated length, and texts end with a zero byte. The callback receives the pointer that it
    // expects.
    unsafe {
        let scene = handle(|out| eyebox_scene_from_views(Some(&own), Some(&display), Some(out))).unwrap();
        let mut told: Vec<usize> = Vec::new();
        let settings = c"steps = 5\nframes = 1\npupils = 2\ndepth = [0, 0]";
        let hologram = handle(|out| {
            let user = std::ptr::from_mut(&mut told).cast();
            let (scene, display, engine) = (Some(&*scene), Some(&*display), Some(&*engine));
            eyebox_solve(scene, display, settings.as_ptr(), engine, Some(after_one), user, Some(out))
        })
        .unwrap();
        assert_eq!(told.last(), Some(&1));
        assert_eq!(phases(&hologram).len(), 40 * 48);
        // The hologram stores its scene, and refuses another.
        let other =
            handle(|out| eyebox_scene_load(c"builtin:plane".as_ptr(), Some(&display), EYEBOX_GREEN, 3, Some(out)))
                .unwrap();
        let other = Some(&*other);
        let begun = handle(|out| eyebox_refiner_new(Some(&hologram), other, null(), Some(&engine), Some(out)));
        refused(begun, "hologram/other-scene ramp builtin:plane");
    }
}
