//! Runs an application of OpenXR with the layer, through the loader of OpenXR, against a runtime without a display.
#![cfg(target_os = "linux")]

mod common;

use common::{Ending, Setup, Wanted};
use eyebox_live_input::Latest;
use std::io::Write;
use std::process::Command;

/// The number of frames of a test. Nightly tests set EYEBOX_LINK=full.
fn many() -> u32 {
    if std::env::var("EYEBOX_LINK").is_ok_and(|length| length == "full") { 10_000 } else { 300 }
}

/// Each frame that arrives is compared completely, and the numbers of frames add up.
#[test]
fn frames_arrive_with_colors_within_a_level_and_depths_within_16_bits() {
    let forms = [
        (["color=srgb", "depth=d16", "layout=array"], ["near=0.1", "far=inf"]),
        (["color=bgra", "depth=d32", "layout=wide"], ["near=inf", "far=0.1"]),
        (["color=unorm", "depth=d24", "layout=array"], ["near=0.25", "far=40"]),
        (["color=half", "depth=d32", "layout=array"], ["near=40", "far=0.25"]),
        (["color=ten", "depth=d16", "layout=wide"], ["near=0.1", "far=inf"]),
    ];
    let Some(setup) = Setup::new("forms") else { return };
    for (form, distances) in forms {
        let count = if form[0] == "color=srgb" { many() } else { 60 };
        let mut wanted = Wanted::new(form[0], distances);
        let frames = format!("frames={count}");
        let run = setup.run("pictures", &[&form[..], &distances, &[&frames]].concat(), |frame| wanted.check(frame, 0));
        let Ending { code, output, errors, last } = run;
        assert_eq!(code, Some(0), "{form:?}: {errors}");
        assert!(!output.contains("VUID") && !errors.contains("VUID"), "{output}{errors}");
        assert!(!errors.contains("runtime:"), "{errors}");
        let [frames, sent, replaced, unsent, not_copied, empty, left_out, ..] = common::counts(&errors);
        assert_eq!(frames, sent + replaced + not_copied, "{errors}");
        // The images of the first frames may be released before the display is there.
        assert!(unsent == 0 && empty == 0 && left_out == 0 && not_copied <= 3, "{errors}");
        // Frames before the display arrived are not in the counts.
        assert!(frames <= u64::from(count) && wanted.frames > 0 && wanted.frames <= sent, "{errors}");
        assert_eq!((last, wanted.newest), (Latest::Gone, count), "{form:?}: the last frame arrives: {errors}");
        assert!(!errors.contains("the view has no depth"), "{errors}");
    }
}

/// The right eye arrives under its own name, and a second thread submits to the queue meanwhile.
#[test]
fn the_right_eye_has_a_display_of_its_own() {
    let Some(setup) = Setup::new("right") else { return };
    let mut wanted = Wanted::new("color=srgb", ["near=0.1", "far=inf"]);
    let arguments = ["frames=120", "depth=d16", "near=0.1", "far=inf", "noise=1"];
    let run = setup.run("pictures-right", &arguments, |frame| wanted.check(frame, 1));
    assert!(run.code == Some(0) && wanted.newest == 120, "{}", run.errors);
    assert!(!run.output.contains("VUID") && !run.errors.contains("VUID"), "{}{}", run.output, run.errors);
}

/// The memory of the application does not grow with frames, sessions or sizes.
#[test]
fn nothing_leaks() {
    let Some(setup) = Setup::new("leaks") else { return };
    let frames = format!("frames={}", many());
    let run = setup.plain("pictures", &[&frames, "depth=d16", "sessions=4", "resize=40", "size=128x128"]);
    assert_eq!(run.code, Some(0), "{}", run.errors);
    let memory: Vec<[u64; 2]> = run.output.lines().map(common::memory).collect();
    assert_eq!(memory.len(), 4, "{}", run.output);
    // Allocators keep some pages. A copy of the images that stays would be 128 KiB or more per frame.
    for pair in memory.iter().map(|[early, late]| (*early, *late)).chain([(memory[1][1], memory[3][1])]) {
        assert!(pair.1 < pair.0 + 4096, "{memory:?} KiB");
    }
}

#[test]
fn a_view_without_depth_is_at_two_meters_and_is_reported_once() {
    let Some(setup) = Setup::new("flat") else { return };
    let mut seen = 0;
    let run = setup.run("pictures", &["frames=60"], |frame| {
        seen += 1;
        assert!(frame.dioptres().iter().all(|d| *d == 0.5));
    });
    assert!(run.code == Some(0) && seen > 0, "{}", run.errors);
    assert_eq!(common::times(&run.errors, "no depth"), 1, "{}", run.errors);
}

/// A display with a small picture shows near content at its limit, instead of no frame.
#[test]
fn content_that_is_too_near_for_the_display_is_moved_back() {
    let Some(setup) = Setup::new("near") else { return };
    let (mut nearest, mut farthest) = (0.0f32, f32::MAX);
    let arguments = ["frames=60", "depth=d32", "near=0.02", "far=inf"];
    let run = setup.run("pictures", &arguments, |frame| {
        nearest = frame.dioptres().iter().copied().fold(nearest, f32::max);
        farthest = frame.dioptres().iter().copied().fold(farthest, f32::min);
    });
    // A quarter of 64 pixels of 0.01 rad, for an eye that is 5 mm from the center.
    assert!(run.code == Some(0) && nearest == 32.0 && farthest < 0.1, "{nearest}, {farthest}: {}", run.errors);
    assert_eq!(common::times(&run.errors, "0.03 m"), 1, "{}", run.errors);
}

/// A quad in the local space, and one in the space of the head, are at the same place before the left eye. Without a
/// projection, the runtime locates the eye.
#[test]
fn quads_and_cylinders_are_at_their_places() {
    let Some(setup) = Setup::new("quads") else { return };
    for shown in ["show=quad", "show=view-quad", "show=projection,quad", "show=cylinder", "show=projection,cylinder"] {
        let mut seen = 0;
        let run = setup.run("pictures", &[shown, "frames=60", "depth=d16", "near=0.1", "far=inf"], |frame| {
            seen += 1;
            common::check_panel(frame, shown);
        });
        assert!(run.code == Some(0) && seen > 0, "{shown}: {}", run.errors);
        let only = u64::from(!shown.contains("projection"));
        assert_eq!(common::times(&run.errors, "no projection"), only, "{shown}: {}", run.errors);
        assert!(!run.output.contains("VUID") && !run.errors.contains("runtime:"), "{}{}", run.output, run.errors);
    }
}

/// Frames without layers, a new size, and an end in the middle: one message each, and the last picture stays.
#[test]
fn the_last_picture_stays_when_an_application_pauses_changes_or_dies() {
    let Some(setup) = Setup::new("ends") else { return };
    let mut wanted = Wanted::new("color=srgb", ["near=0.1", "far=inf"]);
    let arguments = ["frames=120", "depth=d16", "near=0.1", "far=inf", "pause=60-121"];
    let run = setup.run("pictures", &arguments, |frame| wanted.check(frame, 0));
    assert!(run.code == Some(0) && wanted.newest == 59, "{}: {}", wanted.newest, run.errors);
    assert_eq!(common::times(&run.errors, "a frame without layers"), 1, "{}", run.errors);
    assert_eq!(common::counts(&run.errors)[5], 61, "{}", run.errors);

    let mut newest = 0;
    let run = setup.run("pictures", &["frames=120", "resize=60"], |frame| newest = common::number(frame));
    assert_eq!(run.code, Some(0), "{}", run.errors);
    assert_eq!(common::times(&run.errors, "pixels now"), 1, "{}", run.errors);
    assert!(newest > 0 && run.last == Latest::Gone);

    let mut wanted = Wanted::new("color=srgb", ["near=0.1", "far=inf"]);
    let arguments = ["frames=120", "depth=d16", "near=0.1", "far=inf", "die=100"];
    let run = setup.run("pictures", &arguments, |frame| wanted.check(frame, 0));
    assert!(run.code.is_none() && run.last == Latest::Gone, "{}", run.errors);
    assert!((1..100).contains(&wanted.newest), "{}", wanted.newest);
}

#[test]
fn what_the_layer_cannot_read_is_named_once_and_the_application_continues() {
    let Some(setup) = Setup::new("refused") else { return };
    let run = setup.plain("pictures", &["graphics=gl"]);
    assert!(run.code == Some(0) && common::times(&run.errors, "OpenGL") == 1, "{}", run.errors);
    let run = setup.plain("pictures", &["samples=4", "frames=40"]);
    assert!(run.code == Some(0) && common::times(&run.errors, "4 samples") == 1, "{}", run.errors);
    let run = setup.with("NULL_RUNTIME_NO_TRANSFER", "1").plain("pictures", &["frames=40"]);
    assert!(run.code == Some(0) && common::times(&run.errors, "cannot be read") == 1, "{}", run.errors);
}

/// A runtime that has depth receives it, and one that does not have it receives none (it checks this itself). The
/// core validation layer of OpenXR checks the calls of the layer below it.
#[test]
fn the_runtime_receives_what_it_has() {
    let Some(setup) = Setup::new("below") else { return };
    for depth in ["0", "1"] {
        let setup = setup.with("NULL_RUNTIME_DEPTH", depth).below("XR_APILAYER_LUNARG_core_validation");
        let mut seen = 0;
        let arguments = ["frames=40", "depth=d16", "show=projection,quad,cylinder"];
        let run = setup.run("pictures", &arguments, |_| seen += 1);
        assert!(run.code == Some(0) && seen > 0, "{}", run.errors);
        assert!(!run.errors.contains("runtime:"), "{}", run.errors);
        assert!(!run.output.contains("VUID") && !run.errors.contains("VUID"), "{}{}", run.output, run.errors);
    }
}

/// Khronos's example renders cubes. One is 2 m in front of the head, before a gray background.
#[test]
fn the_example_of_khronos_is_seen() {
    let Some(setup) = Setup::new("example") else { return };
    if Command::new("hello_xr").arg("--help").output().is_err() {
        assert!(std::env::var_os("CI").is_none(), "no hello_xr: run tools/setup.sh");
        return eprintln!("no hello_xr, so it is not run");
    }
    let mut command = Command::new("hello_xr");
    command.args(["-g", "Vulkan", "-ff", "Hmd", "-vc", "Stereo"]);
    let mut seen = 0;
    let run = setup.run_program("pictures", command, |frame, program| {
        seen += 1;
        // A line on its standard input ends the example.
        if seen == 30 {
            drop(program.stdin.take().unwrap().write_all(b"\n"));
        }
        let pixel = |at: usize| [0, 1, 2].map(|channel| frame.channel(channel)[at]);
        let background = [0.184_313_73, 0.309_803_93, 0.309_803_93];
        let off = |found: [f32; 3]| (0..3).map(|i| (found[i] - background[i]).abs()).fold(0.0, f32::max);
        let [corner, cube] = [pixel(95), pixel(32 * 96 + 49)];
        assert!(off(corner) < 0.01 && off(cube) > 0.05, "corner {corner:?}, cube {cube:?}");
    });
    assert!(run.code == Some(0) && seen >= 30, "{seen}: {}", run.errors);
    assert!(common::times(&run.errors, "no depth") == 1, "{}", run.errors);
}

/// Prints the time that the layer takes on the threads of an application, and the time of its frames with the layer and
/// without a display: `cargo test --release -p eyebox-openxr --test frames -- --ignored --nocapture times_of`.
#[test]
#[ignore = "prints times, which no assertion depends on"]
fn times_of_frames_with_a_display_and_without() {
    let Some(setup) = Setup::new("times") else { return };
    let setup = setup.with("VK_INSTANCE_LAYERS", "").with("NULL_RUNTIME_PERIOD_US", "33333");
    for round in 0..3 {
        for (what, name) in [("without a display", "nobody"), ("with a display", "pictures")] {
            let run = setup.plain(name, &["frames=300", "depth=d32", "size=1024x1024"]);
            println!("{round}, {what}: {}{}", run.output, run.errors);
        }
    }
}
