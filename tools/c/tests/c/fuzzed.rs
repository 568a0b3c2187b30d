//! Makes ten thousand calls with random arguments, such as null, wrong lengths, values that are not numbers, and huge
//! counts. No status is a fault of eyebox, and each failure has a sentence. Freed handles are left out, because their
//! use is undefined in C.

use crate::common::{handle, said};
use eyebox_c::EyeboxStatus::{Internal, Ok as Done};
use eyebox_c::*;
use fastrand::Rng;
use std::ffi::{CStr, c_char, c_void};
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};

const CALLS: usize = 10_000;
const SIDE: usize = 8;
/// Number of values in the memory of all arrays.
const VALUES: usize = 4096;

const NUMBERS: [f64; 14] =
    [0.0, -0.0, 1e-3, -2e-3, 4e-3, 1.0, -1.0, 1e9, 1e300, -1e300, 1e-300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
const COUNTS: [usize; 14] =
    [0, 1, 2, 3, SIDE, 64, 65, 128, 256, 1 << 16, 1 << 32, usize::MAX / 4 + 1, usize::MAX - 1, usize::MAX];
const TEXTS: [&CStr; 23] = [
    c"",
    c"small",
    c"planes8",
    c"builtin:plane",
    c"builtin:nothing",
    c"/",
    c"/dev/null",
    c"nowhere.zarr",
    c"cpu",
    c"CPU",
    c"\xff\xfe",
    c"resolution = [8, 8]",
    c"steps = 1\nframes = 1\npupils = 1",
    c"steps = -1",
    c"frames = 4097",
    c"frames = 1000000000000",
    c"depth = [nan, 1.0]",
    c"depth = [-1e300, 1e300]\nsteps = 1\nframes = 1\npupils = 1",
    c"pupils = 0",
    c"depth = [-1e3, 1e3]\nsteps = 1\nframes = 1\npupils = 1",
    c"strategy = { kind = \"adam\", rate = 1e300 }",
    c"storage = \"f64\"",
    c"levels = [[",
];

struct Given {
    displays: [Box<EyeboxDisplay>; 2],
    engine: Box<EyeboxEngine>,
    scenes: [Box<EyeboxScene>; 2],
    hologram: Box<EyeboxHologram>,
    refiner: Box<EyeboxRefiner>,
    encoder: Box<EyeboxEncoder>,
    session: Box<EyeboxSession>,
}

fn given() -> Given {
    // SAFETY: Every text ends with a zero byte.
    unsafe {
        let preset = handle(|out| eyebox_display_load(c"planes8".as_ptr(), Some(out))).unwrap();
        let sized = |side| handle(|out| eyebox_display_resized(Some(&preset), side, side, Some(out))).unwrap();
        let displays = [sized(SIDE), sized(2 * SIDE)];
        let engine = handle(|out| eyebox_engine_open(c"cpu".as_ptr(), Some(out))).unwrap();
        let plane = c"builtin:plane".as_ptr();
        let scene =
            |display, color| handle(|out| eyebox_scene_load(plane, Some(display), color, 2, Some(out))).unwrap();
        let scenes = [scene(&*displays[0], EYEBOX_GREEN), scene(&*displays[1], EYEBOX_RED)];
        let settings = c"steps = 1\nframes = 8\npupils = 1".as_ptr();
        let hologram = handle(|out| {
            let (scene, display, engine) = (Some(&*scenes[0]), Some(&*displays[0]), Some(&*engine));
            eyebox_solve(scene, display, settings, engine, None, null_mut(), Some(out))
        })
        .unwrap();
        let refiner =
            handle(|out| eyebox_refiner_new(Some(&hologram), Some(&scenes[0]), null(), Some(&engine), Some(out)))
                .unwrap();
        let encoder = handle(|out| eyebox_encoder_new(Some(&displays[0]), EYEBOX_GREEN, 8, Some(out))).unwrap();
        let session = handle(|out| {
            let (display, engine) = (Some(&*displays[0]), Some(&*engine));
            eyebox_session_follow(Some(&hologram), Some(&scenes[0]), display, null(), engine, 60.0, Some(out))
        })
        .unwrap();
        Given { displays, engine, scenes, hologram, refiner, encoder, session }
    }
}

/// The source of random arguments, most of which are plausible.
struct Chance(Rng);

impl Chance {
    fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.0.usize(..of.len())]
    }

    fn maybe<'a, T>(&mut self, handle: &'a T) -> Option<&'a T> {
        (self.0.u8(..8) > 0).then_some(handle)
    }

    fn of<'a, T>(&mut self, handles: &'a [Box<T>]) -> Option<&'a T> {
        let which = self.0.usize(..handles.len());
        self.maybe(&*handles[which])
    }

    fn obstruction(&mut self, text: *const c_char) -> *const c_char {
        match self.0.u8(..4) {
            0 => text,
            1 => c"opacity".as_ptr(),
            _ => null(),
        }
    }

    fn text(&mut self) -> *const c_char {
        if self.0.u8(..10) == 0 { null() } else { self.one(&TEXTS).as_ptr() }
    }

    fn pupil(&mut self) -> EyeboxPupil {
        let mut number = |usual: f64| if self.0.bool() { usual } else { NUMBERS[self.0.usize(..NUMBERS.len())] };
        EyeboxPupil { x_m: number(1e-3), y_m: number(0.0), diameter_m: number(4e-3), depth_m: number(1e-3) }
    }

    /// Returns a pointer into memory and a stated number of values. The number is true, or larger than any function
    /// accepts.
    fn array(&mut self, memory: &mut [f32]) -> (*mut f32, usize) {
        let count = if self.0.bool() { SIDE * SIDE } else { self.one(&COUNTS) };
        let at = memory.as_mut_ptr();
        match self.0.u8(..8) {
            0 => (null_mut(), count),
            1 => (at.cast::<u8>().wrapping_add(1).cast(), count),
            _ => (at, count),
        }
    }
}

/// Makes a call with memory for a handle, or sometimes with null, and frees the handle.
fn freed<T>(chance: &mut Chance, call: impl FnOnce(Option<&mut MaybeUninit<*mut T>>) -> EyeboxStatus) -> EyeboxStatus {
    let mut place = MaybeUninit::new(null_mut());
    let there = chance.0.u8(..10) > 0;
    let status = call(there.then_some(&mut place));
    // SAFETY: The handle is null, or a box that the function made.
    unsafe {
        let handle = place.assume_init();
        assert_eq!(status == Done, !handle.is_null());
        drop((!handle.is_null()).then(|| Box::from_raw(handle)));
    }
    status
}

/// Makes one call of a random function.
///
/// # Safety
/// Texts and arrays are as stated, or null, or of a length that no function accepts.
unsafe fn call(given: &Given, chance: &mut Chance, memory: &mut [f32]) -> EyeboxStatus {
    let Given { displays, engine, scenes, hologram, refiner, encoder, session } = given;
    let (text, count, bits) = (chance.text(), chance.one(&COUNTS), chance.0.u32(..10));
    let (display, scene) = (chance.of(displays), chance.of(scenes));
    let (engine, hologram) = (chance.maybe(&**engine), chance.maybe(&**hologram));
    let (refiner, encoder) = (chance.maybe(&**refiner), chance.maybe(&**encoder));
    let session = chance.maybe(&**session);
    let pupil = chance.pupil();
    let pupil = chance.maybe(&pupil).copied();
    let (at, length) = chance.array(memory);
    // SAFETY: This function requires the same of its texts and arrays.
    unsafe {
        match chance.0.u8(..19) {
            0 => freed(chance, |out| eyebox_display_load(text, out)),
            1 => freed(chance, |out| eyebox_display_from_toml(text, out)),
            2 => {
                let columns = chance.one(&COUNTS);
                freed(chance, |out| eyebox_display_resized(display, count, columns, out))
            }
            3 if text.is_null() || *text != 0 => freed(chance, |out| eyebox_engine_open(text, out)),
            4 => freed(chance, |out| eyebox_scene_load(text, display, bits, count, out)),
            5 | 6 => {
                let sizes: [usize; 4] = [(); 4].map(|()| if chance.0.u8(..4) > 0 { 2 } else { chance.one(&COUNTS) });
                let product = sizes.iter().try_fold(1usize, |n, s| n.checked_mul(*s)).unwrap_or(0);
                // The stated length is at most the true one, unless it is one that no function accepts.
                let lie = product > VALUES;
                let views = EyeboxViews {
                    name: text,
                    view_rows: sizes[0],
                    view_columns: sizes[1],
                    rows: sizes[2],
                    columns: sizes[3],
                    view_pitch_m: chance.one(&NUMBERS),
                    red: if chance.0.bool() { null() } else { at },
                    green: if chance.0.u8(..4) == 0 { null() } else { at },
                    blue: null(),
                    count: if lie || chance.0.u8(..4) == 0 { length.min(VALUES - 1) } else { product },
                    order: if chance.0.bool() {
                        null()
                    } else {
                        chance.maybe(&c"as-named").map_or(text, |order| order.as_ptr())
                    },
                };
                let views = chance.maybe(&views);
                freed(chance, |out| eyebox_scene_from_views(views, display, out))
            }
            7 => {
                // A solve with the default settings takes long.
                let text = if text.is_null() || *text == 0 { TEXTS[12].as_ptr() } else { text };
                freed(chance, |out| eyebox_solve(scene, display, text, engine, None, null_mut(), out))
            }
            8 => freed(chance, |out| eyebox_hologram_open(text, out)),
            9 => {
                let (mut phases, mut number) = (MaybeUninit::uninit(), MaybeUninit::uninit());
                eyebox_hologram_phases(hologram, count, Some(&mut phases), chance.0.bool().then_some(&mut number))
            }
            10 => eyebox_view(hologram, pupil.as_ref(), chance.obstruction(text), engine, at, length),
            11 => {
                let mut scores = [MaybeUninit::<EyeboxScore>::uninit(); 3];
                let pupils = [(); 3].map(|()| chance.pupil());
                let pupils = if chance.0.u8(..8) == 0 { null() } else { pupils.as_ptr() };
                let count = if count > 3 { usize::MAX - 3 } else { count };
                let obstruction = chance.obstruction(text);
                eyebox_score(hologram, scene, pupils, count, obstruction, engine, scores.as_mut_ptr().cast())
            }
            12 => freed(chance, |out| eyebox_refiner_new(hologram, scene, text, engine, out)),
            13 => eyebox_refiner_aim(refiner, pupil.as_ref(), chance.one(&NUMBERS)),
            14 => {
                let steps = if count > 2 { usize::MAX } else { count };
                eyebox_refiner_step(refiner, steps, None)
            }
            15 => {
                let rate = chance.one(&NUMBERS);
                // Most of these calls fail early, because each session starts threads.
                let hologram = hologram.filter(|_| rate.is_nan() || chance.0.u8(..10) == 0);
                freed(chance, |out| eyebox_session_play(hologram, display, rate, out))
            }
            16 => {
                let [x_m, y_m, diameter_m, age_s] = [(); 4].map(|()| chance.one(&NUMBERS));
                let sample = EyeboxSample { x_m, y_m, diameter_m, age_s };
                let sample = chance.maybe(&sample);
                match chance.0.bool() {
                    true => eyebox_session_look(session, sample),
                    false => eyebox_session_look_moving(session, sample, chance.one(&NUMBERS), chance.one(&NUMBERS)),
                }
            }
            17 => {
                let (lit_in_s, mut frame) = (chance.one(&NUMBERS), MaybeUninit::uninit());
                eyebox_session_tick(session, lit_in_s, at.cast::<c_void>(), length, Some(&mut frame))
            }
            _ if chance.0.bool() => freed(chance, |out| eyebox_encoder_new(display, bits, count, out)),
            _ => eyebox_encode(encoder, hologram, at.cast::<c_void>(), length),
        }
    }
}

#[test]
fn whatever_is_called_with_ends_with_a_code() {
    let given = given();
    let mut chance = Chance(Rng::with_seed(21));
    let mut memory = vec![0.5f32; VALUES + 1];
    let mut codes = [0usize; 11];
    for i in 0..CALLS {
        // Some of the light values are NaN.
        memory[(i * 7) % 64] = if i % 3 == 0 { f32::NAN } else { 0.5 };
        // SAFETY: The texts and arrays are as `call` requires.
        let status = unsafe { call(&given, &mut chance, &mut memory) };
        codes[status as usize] += 1;
        assert!(status != Internal, "call {i}: {}", said());
        assert!(status == Done || !said().is_empty(), "call {i}");
    }
    println!("{codes:?}");
    // Every status occurred, except that faults of devices and of eyebox, and errors of sessions, need not occur.
    assert!(codes[..8].iter().all(|count| *count > 0), "{codes:?}");
}
