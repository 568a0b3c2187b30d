//! `eyebox preview` on a virtual desktop. Its window shows the picture that `eyebox render` writes, and the mouse and
//! keys change it.

use crate::common;
use crate::common::desk::Desk;
use crate::common::xvfb::Part;
use crate::common::{Printed, done, made, refused, text};
use eyebox::low_level::hologram::{Hologram, SequenceWriter, save_phases};
use eyebox::low_level::optics::Display;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

const ESCAPE: u32 = 0xff1b;

/// Makes a hologram with two sub-frames of 36 x 64 pixels in three colors.
fn hologram(salt: usize) -> Hologram {
    made::hologram(&Display::preset("paper").expect("a preset"), 2, salt)
}

fn start(folder: &Path, desk: &Desk, args: &[&str]) -> Child {
    common::command(folder, &[&["preview"], args].concat())
        .env("DISPLAY", desk.name())
        .env_remove("WAYLAND_DISPLAY")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts")
}

/// Reads a picture that a command wrote.
fn written(file: &Path) -> Part {
    let image = image::open(file).expect("a picture").into_rgb8();
    Part { size: [image.height() as usize, image.width() as usize], rgb: image.into_raw() }
}

/// Returns the picture that `eyebox render` writes for this pupil.
fn view(folder: &Path, file: &str, more: &[&str], pupil: &str) -> Part {
    let pupil = format!("--pupil={pupil}");
    done(folder, &[&["render", file, &pupil, "-o", "view.png"], more].concat());
    written(&folder.join("view.png"))
}

/// Returns the columns `left .. left + width`.
fn columns(part: &Part, left: usize, width: usize) -> Part {
    let rows = part.rgb.chunks_exact(3 * part.size[1]);
    Part { size: [part.size[0], width], rgb: rows.flat_map(|r| r[3 * left..3 * (left + width)].to_vec()).collect() }
}

/// Returns whether two parts differ by one level at most. The decimals of the command line can round differently from
/// the place of a pixel.
fn near(a: &Part, b: &Part) -> bool {
    a.size == b.size && a.rgb.iter().zip(&b.rgb).all(|(a, b)| a.abs_diff(*b) <= 1)
}

/// Waits for a minute at most until `so` returns true.
fn until(what: &str, child: &mut Child, mut so: impl FnMut() -> bool) {
    let since = Instant::now();
    while !so() {
        assert!(since.elapsed() < Duration::from_secs(60), "not after a minute: {what}");
        assert!(child.try_wait().expect("its state").is_none(), "it ended before {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Asserts that the preview ends with exit code 0 and without messages of validation. Returns its standard error.
fn ends(child: Child) -> String {
    let answer = child.wait_with_output().expect("it ends");
    let said = text(&answer.stderr);
    assert_eq!(answer.status.code(), Some(0), "{said}");
    assert!(!said.contains("validation:"), "{said}");
    said
}

#[test]
fn the_window_shows_what_render_writes_and_mouse_and_keys_change_it() {
    let here = common::folder();
    let folder = here.path();
    hologram(0).save(&folder.join("x.zarr")).expect("saved");
    let desk = Desk::new(folder, [200, 320]);
    let scene = ["--scene", "builtin:still-life"];
    let args = ["x.zarr", "--pupil=1,-2,4,0", "--window", "36x132", "--validation", "--engine", "cpu"];
    let mut child = start(folder, &desk, &[&args[..], &scene].concat());
    let window = desk.window("x.zarr");
    // One picture is in the middle, pixel by pixel.
    let alone = |desk: &Desk| columns(&desk.part(window), 34, 64);
    let first = view(folder, "x.zarr", &[], "1,-2,4,0");
    until("the first picture", &mut child, || alone(&desk) == first);
    let around = desk.part(window);
    assert!(columns(&around, 0, 34).rgb.iter().chain(&columns(&around, 98, 34).rgb).all(|v| *v == 0));
    until("the title", &mut child, || desk.title(window).has_sequence(&[1.0, -2.0, 4.0, 0.0]));
    // The hologram has two sub-frames.
    assert!(desk.title(window).has("x.zarr mm 2 dB"), "{}", desk.title(window));

    // The mouse is a quarter of the eyebox of 22 mm to the right and a quarter down.
    desk.point(window, [27, 34 + 48]);
    let moved = view(folder, "x.zarr", &[], "5.5,5.5,4,0");
    until("the mouse's pupil", &mut child, || near(&alone(&desk), &moved));
    assert!(!near(&moved, &first));
    // The wheel makes two turns up and one down. A wheel without an axis, as on this desktop, counts when it is pressed
    // and when it is released. The sum is two notches of 0.2 mm.
    [true, true, false].into_iter().for_each(|up| desk.turn(up));
    let focused = view(folder, "x.zarr", &[], "5.5,5.5,4,0.4");
    until("the wheel's focus", &mut child, || near(&alone(&desk), &focused));
    assert!(!near(&moved, &focused));
    desk.press(window, '='.into());
    let wider = view(folder, "x.zarr", &[], "5.5,5.5,4.5,0.4");
    until("the wider pupil", &mut child, || near(&alone(&desk), &wider));

    desk.press(window, 'a'.into());
    until("one sub-frame", &mut child, || desk.title(window).has_sequence(&[1.0, 2.0]));
    let mut one = hologram(0);
    one.frames = 1;
    one.colors.iter_mut().for_each(|c| c.phases.truncate(36 * 64));
    one.save(&folder.join("one.zarr")).expect("saved");
    let grain = view(folder, "one.zarr", &[], "5.5,5.5,4.5,0.4");
    until("its grain", &mut child, || near(&alone(&desk), &grain));
    desk.press(window, 'a'.into());
    until("all sub-frames again", &mut child, || near(&alone(&desk), &wider));

    desk.press(window, 's'.into());
    let saved = folder.join("x-seen-1.png");
    until("the PNG", &mut child, || saved.exists());
    assert!(near(&written(&saved), &wider));

    desk.press(window, 'h'.into());
    until("the help", &mut child, || !near(&alone(&desk), &wider));
    desk.press(window, 'h'.into());
    until("no help", &mut child, || near(&alone(&desk), &wider));

    // The target image is next to the view, and then alone.
    desk.press(window, 'p'.into());
    let target = ["render", "builtin:still-life", "--size", "36x64", "--pupil=5.5,5.5,4.5,0.4", "-o", "p.png"];
    done(folder, &target);
    let target = written(&folder.join("p.png"));
    until("both", &mut child, || near(&columns(&desk.part(window), 0, 64), &wider));
    until("the target image", &mut child, || near(&columns(&desk.part(window), 68, 64), &target));
    desk.press(window, 'p'.into());
    until("the target image alone", &mut child, || near(&alone(&desk), &target));
    desk.press(window, 'p'.into());
    until("the eye alone", &mut child, || near(&alone(&desk), &wider));

    // The window changes its size and changes it back, so that the swapchain is made again.
    desk.resize(window, [72, 200]);
    until("a larger window", &mut child, || {
        let part = desk.part(window);
        part.size == [72, 200] && columns(&part, 40, 8).rgb.iter().any(|v| *v > 0)
    });
    desk.resize(window, [36, 132]);
    until("the old size", &mut child, || near(&alone(&desk), &wider));

    desk.press(window, ESCAPE);
    assert!(ends(child).has("x-seen-1.png"));
}

#[test]
fn a_sequence_is_played_and_stepped_through_and_ctrl_c_ends_it() {
    let here = common::folder();
    let folder = here.path();
    let file = folder.join("moving.zarr");
    let mut writer = SequenceWriter::create(&file, &hologram(0), [30, 1], Some(3)).expect("begun");
    (0..3).for_each(|i| writer.append(&hologram(i)).expect("written"));
    writer.finish().expect("finished");
    let desk = Desk::new(folder, [100, 200]);
    let mut child = start(folder, &desk, &["moving.zarr", "--zoom", "1", "--validation"]);
    let window = desk.window("moving.zarr");
    for i in [1.0, 2.0, 3.0, 1.0] {
        until(&format!("{i} of 3"), &mut child, || desk.title(window).has_sequence(&[i, 3.0]));
    }
    // The sequence pauses, and each key shows the next hologram. The picture must match the number in the title.
    desk.press(window, '.'.into());
    for _ in 0..3 {
        let before = desk.title(window);
        desk.press(window, '.'.into());
        until("the next", &mut child, || desk.title(window) != before);
        std::thread::sleep(Duration::from_millis(200));
        let title = desk.title(window);
        let index = (0..3).find(|i| title.has_sequence(&[f64::from(i + 1), 3.0])).expect("its number");
        let expected = view(folder, "moving.zarr", &["--at", &index.to_string()], "0,0,4,0");
        until("its picture", &mut child, || desk.part(window) == expected);
    }
    let killed = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    assert!(killed.success());
    ends(child);
    // One hologram of the sequence is shown alone.
    let mut child = start(folder, &desk, &["moving.zarr", "--at", "2", "--pupil=0,0,4,0", "--zoom", "1"]);
    let window = desk.window("moving.zarr");
    let expected = view(folder, "moving.zarr", &["--at", "2"], "0,0,4,0");
    until("the third", &mut child, || desk.part(window) == expected);
    desk.press(window, 'q'.into());
    ends(child);
}

#[test]
fn bare_phases_are_shown_as_render_shows_them() {
    let here = common::folder();
    let folder = here.path();
    let one = hologram(5);
    save_phases(&one, &folder.join("phases.npy")).expect("saved");
    let optics = ["--pitch", "8", "--wavelength", "660,520,440", "--focal-length", "400"];
    let desk = Desk::new(folder, [100, 200]);
    let mut child = start(folder, &desk, &[&["phases.npy", "--pupil=0,1,6,0", "--zoom", "1"], &optics[..]].concat());
    let window = desk.window("phases.npy");
    let expected = view(folder, "phases.npy", &optics, "0,1,6,0");
    until("the picture", &mut child, || desk.part(window) == expected);
    desk.press(window, 'q'.into());
    ends(child);
}

/// The hologram is a far field in tiles. The window shows the picture that `eyebox render` writes, from any place. Only
/// the tiles under the pupil are read.
#[test]
fn a_far_field_in_tiles_is_shown_without_the_rest_of_it() {
    let here = common::folder();
    let folder = here.path();
    let display = "name = \"far\"\nresolution = [256, 256]\npitch_um = 4.0\nfocal_length_mm = 400.0\n\
                   wavelengths_nm = { green = 520, blue = 440 }\ngeometry = \"far-field\"\n";
    std::fs::write(folder.join("far.toml"), display).expect("written");
    let solve = ["solve", "builtin:still-life", "--display", "far.toml", "--frames", "2", "--memory", "600MiB"];
    let few = [
        "--pupil-diameter",
        "0.2..0.4",
        "--set",
        "tiles.picture=96",
        "--set",
        "tiles.passes=1",
        "--engine",
        "cpu",
        "-o",
        "h.zarr",
    ];
    done(folder, &[&solve[..], &few].concat());
    // One tile is damaged. A pupil that does not cover it is not affected.
    let far = folder.join("h.zarr/phases/c/1/0/7/7");
    let mut tile = std::fs::read(&far).expect("a tile");
    tile[9] ^= 1;
    std::fs::write(&far, &tile).expect("written");
    let first = view(folder, "h.zarr", &[], "-0.1,-0.2,0.3,0");
    let [n, wide] = first.size;
    assert!(n == wide && n > 60 && n < 100, "the pupil resolves {n} pixels");
    let desk = Desk::new(folder, [200, 320]);
    let window = format!("{n}x{}", 2 * n + 4);
    let args = ["h.zarr", "--pupil=-0.1,-0.2,0.3,0", "--window", &window, "--engine", "cpu", "--validation"];
    let mut child = start(folder, &desk, &[&args[..], &["--scene", "builtin:still-life"]].concat());
    let window = desk.window("h.zarr");
    let left = (n + 4) / 2;
    let alone = |desk: &Desk| columns(&desk.part(window), left, n);
    until("the first picture", &mut child, || alone(&desk) == first);
    until("the title", &mut child, || desk.title(window).has("dB"));
    // The mouse moves the pupil. The picture represents the eyebox of 1.024 mm.
    let at = [n / 4, left + n / 8];
    desk.point(window, at.map(|v| v as i16));
    let place = |at: usize, from: usize| ((at - from) as f64 / n as f64 - 0.5) * 1.024;
    let moved = view(folder, "h.zarr", &[], &format!("{},{},0.3,0", place(at[1], left), place(at[0], 0)));
    until("the mouse's pupil", &mut child, || near(&alone(&desk), &moved));
    assert!(!near(&moved, &first));
    // The saved file is the picture that `render` writes, at the resolution of the pupil.
    desk.press(window, 's'.into());
    let saved = folder.join("h-seen-1.png");
    until("the PNG", &mut child, || saved.exists());
    assert!(near(&written(&saved), &moved));
    desk.press(window, 'p'.into());
    until("the target image next to it", &mut child, || {
        let part = desk.part(window);
        let target = columns(&part, n + 4, n);
        near(&columns(&part, 0, n), &moved) && target.rgb.iter().any(|v| *v > 120) && !near(&target, &moved)
    });
    // At the damaged tile, the preview ends with an error.
    desk.point(window, [n - 3, n - 3].map(|v| v as i16));
    let answer = child.wait_with_output().expect("it ends");
    let said = text(&answer.stderr);
    assert!(answer.status.code() == Some(2) && said.contains("7/7") && !said.contains("validation:"), "{said}");
}

#[test]
fn what_cannot_be_shown_is_refused_in_a_line() {
    let here = common::folder();
    let folder = here.path();
    hologram(0).save(&folder.join("x.zarr")).expect("saved");
    let file = folder.join("moving.zarr");
    let mut writer = SequenceWriter::create(&file, &hologram(0), [30, 1], Some(2)).expect("begun");
    (0..2).for_each(|i| writer.append(&hologram(i)).expect("written"));
    writer.finish().expect("finished");
    for (args, what) in [
        (&["none.zarr"][..], "file/read none.zarr"),
        (&["x.zarr", "--pupil=30,0,4,0"], "arguments/outside-eyebox"),
        (&["x.zarr", "--pitch", "8"], "arguments/own-optics"),
        (&["x.zarr", "--window", "0x9"], "usage/value-validation 65536"),
        (&["x.zarr", "--window", "9x9", "--zoom", "2"], "usage/argument-conflict"),
        (&["phases.npy"], "file/read phases.npy"),
    ] {
        refused(folder, &[&["preview"], args].concat(), "x-seen-1.png", what);
    }
    let desk = Desk::new(folder, [60, 80]);
    let answer =
        start(folder, &desk, &["moving.zarr", "--scene", "builtin:plane"]).wait_with_output().expect("it ends");
    assert!(answer.status.code() == Some(2) && text(&answer.stderr).contains("--at"), "{}", text(&answer.stderr));
    let nowhere = common::command(folder, &["preview", "x.zarr"])
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .expect("it runs");
    let said = text(&nowhere.stderr);
    assert_eq!((nowhere.status.code(), said.trim().lines().count()), (Some(2), 1), "{said}");
    assert!(said.contains("DISPLAY"), "{said}");
}

/// A scene is solved first and has its target image. A solved hologram has the target image of the scene that it was
/// solved from, without `--scene`.
#[test]
fn a_scene_is_solved_first_and_has_its_target_image() {
    let here = common::folder();
    let folder = here.path();
    let size = ["--size", "36x64", "--views", "3", "--engine", "cpu"];
    let desk = Desk::new(folder, [200, 320]);
    let eye = "1,-2,4,0.2";
    let target = ["render", "builtin:still-life", "--pupil=1,-2,4,0.2", "-o", "p.png"];
    done(folder, &[&target, &size[..]].concat());
    let target = written(&folder.join("p.png"));
    let steps = ["--set", "steps=2", "--set", "frames=2", "--set", "seed=7"];
    done(folder, &[&["solve", "builtin:still-life", "-o", "x.zarr"], &steps[..], &size].concat());
    let of_scene = [&["builtin:still-life"], &steps[..], &size].concat();
    for (what, name) in [(&of_scene[..], "builtin:still-life"), (&["x.zarr", "--engine", "cpu"], "x.zarr")] {
        let pupil = format!("--pupil={eye}");
        let mut child = start(folder, &desk, &[what, &[&pupil, "--window", "36x132"]].concat());
        let window = desk.window(name);
        desk.press(window, 'p'.into());
        until("the target image", &mut child, || near(&columns(&desk.part(window), 68, 64), &target));
        let image = columns(&desk.part(window), 0, 64);
        assert!(image.rgb.iter().any(|v| *v > 60) && !near(&image, &target));
        desk.press(window, ESCAPE);
        ends(child);
    }
    for (args, what) in [
        (&["builtin:still-life", "--at", "1"][..], "arguments/of-holograms --at"),
        (&["builtin:still-life", "--rate", "9"], "arguments/of-holograms --rate"),
        (&["builtin:still-life", "--scene", "builtin:plane"], "arguments/scene-of-scene"),
        (&["x.zarr", "--quality", "fast"], "arguments/quality-of-phases --quality"),
    ] {
        let answer = start(folder, &desk, args).wait_with_output().expect("it ends");
        let said = text(&answer.stderr);
        assert_eq!(answer.status.code(), Some(2), "{said}");
        let option = what.split(' ').nth(1).unwrap_or("--scene");
        assert!(said.contains(option), "{what}: {said}");
    }
}
