//! Runs an application of OpenXR with the layer, through the loader of OpenXR, against a runtime without a display. The
//! frames pass through the host, or stay on the device.
#![cfg(target_os = "linux")]

mod common;

use common::{Ending, Plan, Setup, Shares, Wanted};
use eyebox_live_input::Latest;
use std::io::Write;
use std::process::Command;
use std::time::Duration;

/// The number of frames of a test. Nightly tests set EYEBOX_LINK=full.
fn many() -> u32 {
    if std::env::var("EYEBOX_LINK").is_ok_and(|length| length == "full") { 10_000 } else { 300 }
}

/// Checks that neither Vulkan's validation layer nor the runtime found a fault.
fn faultless(run: &Ending) {
    let Ending { output, errors, .. } = run;
    for word in ["VUID", "UNASSIGNED", "SYNC-HAZARD", "runtime:"] {
        assert!(!output.contains(word) && !errors.contains(word), "{output}{errors}");
    }
}

/// Checks whether the layer took the way of the setup, and that it has nothing to say otherwise.
fn on_its_way(setup: &Setup, run: &Ending, displays: u64) {
    let there = if setup.plan.shares == Shares::Memory { displays } else { 0 };
    assert_eq!(common::times(&run.errors, "pixels on the device"), there, "{}", run.errors);
    assert_eq!(common::times(&run.errors, "through the host"), 0, "{}", run.errors);
}

const DEPTH: [&str; 3] = ["depth=d16", "near=0.1", "far=inf"];

fn usual() -> Wanted {
    Wanted::new("color=srgb", ["near=0.1", "far=inf"])
}

/// Each frame that arrives is compared completely, and the numbers of frames add up.
#[test]
fn frames_arrive_with_colors_within_a_level_and_depths_within_16_bits() {
    let forms = [
        (["color=srgb", "depth=d16", "layout=array"], ["near=0.1", "far=inf"], "extensions=listed"),
        (["color=bgra", "depth=d32", "layout=wide"], ["near=inf", "far=0.1"], "vulkan=1.0"),
        (["color=unorm", "depth=d24", "layout=array"], ["near=0.25", "far=40"], "extensions=made"),
        (["color=half", "depth=d32", "layout=array"], ["near=40", "far=0.25"], "extensions=listed"),
        (["color=ten", "depth=d16", "layout=wide"], ["near=0.1", "far=inf"], "extensions=made"),
    ];
    for setup in Setup::each("forms") {
        for (form, distances, device) in forms {
            let count = if form[0] == "color=srgb" { many() } else { 60 };
            let mut wanted = Wanted::new(form[0], distances);
            let frames = format!("frames={count}");
            let arguments = [&form[..], &distances, &[&frames, device]].concat();
            let run = setup.run("pictures", &arguments, |frame| wanted.check(frame, 0));
            faultless(&run);
            on_its_way(&setup, &run, 1);
            let Ending { code, errors, last, .. } = run;
            assert_eq!(code, Some(0), "{form:?}: {errors}");
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
}

/// The right eye arrives under its own name, and a second thread submits to the queue meanwhile.
#[test]
fn the_right_eye_has_a_display_of_its_own() {
    for setup in Setup::each("right") {
        let mut wanted = usual();
        let run = setup.run("pictures-right", &[&["frames=120", "noise=1"], &DEPTH[..]].concat(), |frame| {
            wanted.check(frame, 1);
        });
        assert!(run.code == Some(0) && wanted.newest == 120, "{}", run.errors);
        faultless(&run);
        on_its_way(&setup, &run, 1);
    }
}

/// Each of three displays has its memory, or one of them has none. Then the host reads its frames from the device.
#[test]
fn two_eyes_and_a_second_display_of_the_left_one() {
    let Some(setup) = Setup::new("eyes") else { return };
    let names = ["pictures", "pictures-left", "pictures-right"];
    for of_second in [Shares::Memory, Shares::Nothing] {
        let all = [Shares::Memory, of_second, Shares::Memory];
        let displays: Vec<_> = names.into_iter().zip(all).collect();
        let mut wanted = [usual(), usual(), usual()];
        let arguments = [&["frames=120", "noise=1"], &DEPTH[..]].concat();
        let run = setup.run_all(&displays, &arguments, |display, frame| {
            wanted[display].check(frame, u32::from(display == 2));
        });
        assert_eq!(run.code, Some(0), "{}", run.errors);
        faultless(&run);
        assert!(wanted.iter().all(|wanted| wanted.newest == 120 && wanted.frames > 0), "{}", run.errors);
        let there = all.iter().filter(|shares| **shares == Shares::Memory).count() as u64;
        assert_eq!(common::times(&run.errors, "pixels on the device"), there, "{}", run.errors);
    }
}

/// If memory cannot be shared, one line states the reason, and frames pass through the host.
#[test]
fn frames_pass_through_the_host_if_memory_cannot_be_shared() {
    let Some(setup) = Setup::new("host") else { return };
    let cases = [
        (Shares::Elsewhere, "extensions=listed", "the display is on another device"),
        (Shares::TooLittle, "extensions=made", "has no memory left"),
        (Shares::OddMemory, "extensions=listed", "type 31 does not fit the device"),
        (Shares::Memory, "extensions=none", "the application's device does not share memory"),
    ];
    for (shares, extensions, reason) in cases {
        let mut wanted = usual();
        let arguments = [&["frames=60", extensions], &DEPTH[..]].concat();
        let setup = setup.planned(Plan { shares, is_refused: true, ..setup.plan });
        let run = setup.run("pictures", &arguments, |frame| wanted.check(frame, 0));
        assert!(run.code == Some(0) && wanted.newest == 60, "{}", run.errors);
        faultless(&run);
        assert_eq!(common::times(&run.errors, reason), 1, "{}", run.errors);
        assert_eq!(common::times(&run.errors, "through the host"), 1, "{}", run.errors);
        assert_eq!(common::times(&run.errors, "pixels on the device"), 0, "{}", run.errors);
    }
}

/// A display arrives in the middle, when a panel was released long before. The next display has other memory.
#[test]
fn displays_arrive_later_and_follow_each_other() {
    let Some(setup) = Setup::new("later") else { return };
    let arguments = [&["frames=600", "show=projection,quad", "panel=once"], &DEPTH[..]].concat();
    let forms =
        [(Shares::Memory, Shares::Nothing), (Shares::Nothing, Shares::Memory), (Shares::Memory, Shares::Elsewhere)];
    for (shares, then) in forms {
        let (mut newest, mut frames) = (0, 0);
        let delay = Duration::from_millis(700);
        let setup = setup.with("NULL_RUNTIME_PERIOD_US", "5000");
        let setup = setup.planned(Plan { shares, then: Some(then), delay, ..setup.plan });
        let run = setup.run("pictures", &arguments, |frame| {
            common::check_panel(frame, "projection,quad");
            assert!(common::number(frame) > newest);
            (newest, frames) = (common::number(frame), frames + 1);
        });
        assert!(run.code == Some(0) && newest == 600 && frames > 40, "{newest}, {frames}: {}", run.errors);
        faultless(&run);
        assert_eq!(common::times(&run.errors, "pixels on the device"), 1, "{}", run.errors);
        assert_eq!(common::times(&run.errors, "is gone"), 1, "{}", run.errors);
    }
}

/// A device reads a limited part of a buffer at once. The host composes larger images.
#[test]
fn the_host_continues_if_the_device_cannot_compose() {
    let Some(setup) = Setup::new("large") else { return };
    let setup = setup.planned(Plan { shares: Shares::Memory, is_refused: true, ..setup.plan });
    let mut seen = 0;
    let run = setup.run("pictures", &["frames=8", "color=half", "size=4096x4112"], |_| seen += 1);
    assert!(run.code == Some(0) && seen > 0, "{seen}: {}", run.errors);
    faultless(&run);
    assert_eq!(common::times(&run.errors, "the layer's device failed"), 1, "{}", run.errors);
}

/// The memory of the application does not grow with frames, sessions or sizes.
#[test]
fn nothing_leaks() {
    for setup in Setup::each("leaks") {
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
}

#[test]
fn a_view_without_depth_is_at_two_meters_and_is_reported_once() {
    for setup in Setup::each("flat") {
        let mut seen = 0;
        let run = setup.run("pictures", &["frames=60"], |frame| {
            seen += 1;
            assert!(frame.dioptres.iter().all(|d| *d == 0.5));
        });
        assert!(run.code == Some(0) && seen > 0, "{}", run.errors);
        assert_eq!(common::times(&run.errors, "no depth"), 1, "{}", run.errors);
    }
}

/// A display with a small picture shows near content at its limit, instead of no frame.
#[test]
fn content_that_is_too_near_for_the_display_is_moved_back() {
    for setup in Setup::each("near") {
        let (mut nearest, mut farthest) = (0.0f32, f32::MAX);
        let arguments = ["frames=60", "depth=d32", "near=0.02", "far=inf"];
        let run = setup.run("pictures", &arguments, |frame| {
            nearest = frame.dioptres.iter().copied().fold(nearest, f32::max);
            farthest = frame.dioptres.iter().copied().fold(farthest, f32::min);
        });
        // A quarter of 64 pixels of 0.01 rad, for an eye that is 5 mm from the center.
        assert!(run.code == Some(0) && nearest == 32.0 && farthest < 0.1, "{nearest}, {farthest}: {}", run.errors);
        assert_eq!(common::times(&run.errors, "0.03 m"), 1, "{}", run.errors);
        on_its_way(&setup, &run, 1);
    }
}

/// A quad in the local space, and one in the space of the head, are at the same place before the left eye. Without a
/// projection, the runtime locates the eye.
#[test]
fn quads_and_cylinders_are_at_their_places() {
    for setup in Setup::each("quads") {
        for shown in
            ["show=quad", "show=view-quad", "show=projection,quad", "show=cylinder", "show=projection,cylinder"]
        {
            let mut seen = 0;
            let run = setup.run("pictures", &[&[shown, "frames=60"], &DEPTH[..]].concat(), |frame| {
                seen += 1;
                common::check_panel(frame, shown);
            });
            assert!(run.code == Some(0) && seen > 0, "{shown}: {}", run.errors);
            let only = u64::from(!shown.contains("projection"));
            assert_eq!(common::times(&run.errors, "no projection"), only, "{shown}: {}", run.errors);
            faultless(&run);
            on_its_way(&setup, &run, 1);
        }
    }
}

/// Frames without layers, a new size, and an end in the middle: one message each, and the last picture stays.
#[test]
fn the_last_picture_stays_when_an_application_pauses_changes_or_dies() {
    for setup in Setup::each("ends") {
        let mut wanted = usual();
        let run = setup.run("pictures", &[&["frames=120", "pause=60-121"], &DEPTH[..]].concat(), |frame| {
            wanted.check(frame, 0);
        });
        assert!(run.code == Some(0) && wanted.newest == 59, "{}: {}", wanted.newest, run.errors);
        assert_eq!(common::times(&run.errors, "a frame without layers"), 1, "{}", run.errors);
        assert_eq!(common::counts(&run.errors)[5], 61, "{}", run.errors);

        let mut newest = 0;
        let run = setup.run("pictures", &["frames=120", "resize=60"], |frame| newest = common::number(frame));
        assert_eq!(run.code, Some(0), "{}", run.errors);
        assert_eq!(common::times(&run.errors, "pixels now"), 1, "{}", run.errors);
        assert!(newest > 0 && run.last == Latest::Gone);

        let mut wanted = usual();
        let run = setup.run("pictures", &[&["frames=120", "die=100"], &DEPTH[..]].concat(), |frame| {
            wanted.check(frame, 0);
        });
        assert!(run.code.is_none() && run.last == Latest::Gone, "{}", run.errors);
        assert!((1..100).contains(&wanted.newest), "{}", wanted.newest);
    }
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
    for setup in Setup::each("below") {
        for (depth, extensions) in [("0", "extensions=listed"), ("1", "extensions=made")] {
            let setup = setup.with("NULL_RUNTIME_DEPTH", depth).below("XR_APILAYER_LUNARG_core_validation");
            let mut seen = 0;
            let arguments = ["frames=40", "depth=d16", "show=projection,quad,cylinder", extensions];
            let run = setup.run("pictures", &arguments, |_| seen += 1);
            assert!(run.code == Some(0) && seen > 0, "{}", run.errors);
            faultless(&run);
            on_its_way(&setup, &run, 1);
        }
    }
}

/// Khronos's example renders cubes. One is 2 m in front of the head, before a gray background. It lists extensions, or
/// OpenXR makes its device.
#[test]
fn the_example_of_khronos_is_seen() {
    if Command::new("hello_xr").arg("--help").output().is_err() {
        assert!(std::env::var_os("CI").is_none(), "no hello_xr: run tools/setup.sh");
        return eprintln!("no hello_xr, so it is not run");
    }
    for setup in Setup::each("example") {
        for graphics in ["Vulkan", "Vulkan2"] {
            let mut command = Command::new("hello_xr");
            command.args(["-g", graphics, "-ff", "Hmd", "-vc", "Stereo"]);
            let mut seen = 0;
            let run = setup.run_program(&[("pictures", setup.plan.shares)], command, |_, frame, program| {
                seen += 1;
                // A line on its standard input ends the example.
                if seen == 30 {
                    drop(program.stdin.take().unwrap().write_all(b"\n"));
                }
                let pixel = |at: usize| [0, 1, 2].map(|channel: usize| frame.channels[channel][at]);
                let background = [0.184_313_73, 0.309_803_93, 0.309_803_93];
                let off = |found: [f32; 3]| (0..3).map(|i| (found[i] - background[i]).abs()).fold(0.0, f32::max);
                let [corner, cube] = [pixel(95), pixel(32 * 96 + 49)];
                assert!(off(corner) < 0.01 && off(cube) > 0.05, "corner {corner:?}, cube {cube:?}");
            });
            assert!(run.code == Some(0) && seen >= 30, "{seen}: {}", run.errors);
            assert!(common::times(&run.errors, "no depth") == 1, "{}", run.errors);
            on_its_way(&setup, &run, 1);
        }
    }
}

/// Prints the time that the layer takes on the threads of an application, and the time of its frames with the layer and
/// without a display: `cargo test --release -p eyebox-openxr --test frames -- --ignored --nocapture times_of`.
#[test]
#[ignore = "prints times, which no assertion depends on"]
fn times_of_frames_with_a_display_and_without() {
    let Some(setup) = Setup::new("times") else { return };
    let setup = setup.with("VK_INSTANCE_LAYERS", "").with("NULL_RUNTIME_PERIOD_US", "33333");
    let forms = [
        ("without a display", "nobody", Shares::Nothing),
        ("with a display", "pictures", Shares::Nothing),
        ("with a display on the device", "pictures", Shares::Memory),
    ];
    for round in 0..3 {
        for (what, name, shares) in forms {
            let run = setup.shares(shares).plain(name, &["frames=300", "depth=d32", "size=1024x1024"]);
            println!("{round}, {what}: {}{}", run.output, run.errors);
        }
    }
}
