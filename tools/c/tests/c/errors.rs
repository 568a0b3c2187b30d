//! Tests how long the text of the last failure stays valid, and which samples are refused.

use eyebox_c::*;
use std::ffi::{CStr, CString, c_char};
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};

/// Makes a call fail with a text that names `choice`.
fn fail(choice: &str) {
    let choice = CString::new(choice).unwrap();
    let mut engine = MaybeUninit::uninit();
    // SAFETY: The text ends with a zero byte.
    assert_eq!(unsafe { eyebox_engine_open(choice.as_ptr(), Some(&mut engine)) }, EyeboxStatus::Argument);
}

fn read(text: *const c_char) -> String {
    // SAFETY: The test checks the rule by which the text is still valid.
    unsafe { CStr::from_ptr(text) }.to_str().unwrap().to_owned()
}

#[test]
fn a_text_stays_until_its_thread_asks_for_the_next() {
    let other = "o".repeat(300);
    // The next text is longer, equally long, shorter, or much longer. It may use the memory of the previous failure,
    // but not the memory of the first text.
    for (first, next) in
        [("a", "much longer than a"), ("abc", "xyz"), ("a long one indeed", "b"), ("e", "\u{e9}"), ("f", &other)]
    {
        fail(first);
        let text = eyebox_last_error();
        assert_eq!(text, eyebox_last_error(), "two calls return the same text");
        (0..64).for_each(|_| fail(next));
        let theirs = next.to_owned();
        let theirs = std::thread::spawn(move || {
            let before = read(eyebox_last_error());
            fail(&theirs);
            [before, read(eyebox_last_error())]
        });
        let theirs = theirs.join().unwrap();
        assert!(theirs[0].is_empty() && theirs[1].contains(next), "each thread has its own texts, {theirs:?}");
        // The sentence contains the refused value as a word.
        let words: Vec<String> =
            read(text).split(|c: char| !c.is_alphanumeric() && c != ' ').map(str::to_owned).collect();
        assert!(words.iter().any(|word| word.trim() == first || word.ends_with(&format!(" {first}"))), "{words:?}");
        assert_eq!(read(eyebox_last_error_code()), "argument");
        assert_eq!(eyebox_interface(), EYEBOX_INTERFACE);
        assert!(read(eyebox_last_error()).contains(next), "a success does not change it");
    }
}

/// Starts a session that follows the samples of its caller.
fn session() -> Box<EyeboxSession> {
    use crate::common::handle;
    // SAFETY: Every text ends with a zero byte.
    unsafe {
        let preset = handle(|out| eyebox_display_load(c"planes8".as_ptr(), Some(out))).unwrap();
        let display = handle(|out| eyebox_display_resized(Some(&preset), 32, 32, Some(out))).unwrap();
        let engine = handle(|out| eyebox_engine_open(c"cpu".as_ptr(), Some(out))).unwrap();
        let source = c"builtin:plane".as_ptr();
        let scene = handle(|out| eyebox_scene_load(source, Some(&display), EYEBOX_GREEN, 3, Some(out))).unwrap();
        let (scene, display, engine) = (Some(&*scene), Some(&*display), Some(&*engine));
        let settings = c"steps = 1\nframes = 8\npupils = 2".as_ptr();
        let hologram =
            handle(|out| eyebox_solve(scene, display, settings, engine, None, null_mut(), Some(out))).unwrap();
        let hologram = Some(&*hologram);
        handle(|out| eyebox_session_follow(hologram, scene, display, null(), engine, 60.0, Some(out))).unwrap()
    }
}

#[test]
fn samples_in_another_unit_are_refused() {
    let session = session();
    let nan = f64::NAN;
    // Each row has x, y and diameter in meters, the age in seconds, and true if the sample is accepted.
    for (x_m, y_m, diameter_m, age_s, taken) in [
        (0.0, 0.0, 4e-3, 0.01, true),
        (-3e-3, 2e-3, 0.0, 0.0, true),
        (nan, nan, nan, 0.0, true),
        (nan, 0.0, 3e-3, 0.0, true),
        (f64::INFINITY, 0.0, 3e-3, 0.0, true),
        (2.0, 0.0, 4e-3, 0.0, false),
        (0.0, -3.0, 4e-3, 0.0, false),
        (0.0, 0.0, 4.0, 0.0, false),
        (0.0, 0.0, -4e-3, 0.0, false),
        (0.0, 0.0, f64::INFINITY, 0.0, false),
        (0.0, 0.0, 4e-3, nan, false),
        (0.0, 0.0, 4e-3, -1.0, false),
        (0.0, 0.0, 4e-3, 8.0e6, false),
    ] {
        let sample = EyeboxSample { x_m, y_m, diameter_m, age_s };
        let want = if taken { EyeboxStatus::Ok } else { EyeboxStatus::Argument };
        assert_eq!(eyebox_session_look(Some(&session), Some(&sample)), want, "{sample:?}");
        assert_eq!(eyebox_session_look_moving(Some(&session), Some(&sample), nan, nan), want, "{sample:?}");
    }
}
