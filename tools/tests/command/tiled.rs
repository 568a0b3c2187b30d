//! Far-field holograms that are solved region by region, as a user runs them, with their memory, kills and views.

use crate::common::{Printed, command, done, folder, refused, text};
use eyebox::low_level::files::write_png;
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::scene::{self, Request};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

const DISPLAY: &str = "name = \"far\"\nresolution = [320, 320]\npitch_um = 4.0\nfocal_length_mm = 400.0\n\
                       wavelengths_nm = { green = 520 }\ngeometry = \"far-field\"\n";

fn solve<'a>(out: &'a str, frames: &'a str) -> Vec<&'a str> {
    vec![
        "solve",
        "builtin:still-life",
        "--display",
        "far.toml",
        "--frames",
        frames,
        "--memory",
        "600MiB",
        "--pupil-diameter",
        "0.2..0.4",
        "--set",
        "tiles.picture=96",
        "--set",
        "tiles.passes=2",
        "--engine",
        "cpu",
        "--json",
        "-o",
        out,
    ]
}

/// Returns the name and the bytes of every file in a folder.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut left = vec![folder.to_path_buf()];
    while let Some(next) = left.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                left.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().display().to_string();
                found.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    found
}

/// A solve continues after each of several kills at any moment. Its file is the same as without a kill.
#[test]
fn killed_at_any_moment_it_ends_with_the_same_file() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let said: Value = serde_json::from_str(&done(at, &solve("whole.zarr", "2"))).unwrap();
    let visits = said["visits"].as_u64().unwrap();
    assert!(visits > 8, "{said}");
    let progress = || {
        let text = std::fs::read(at.join("cut.zarr/progress.json")).ok()?;
        serde_json::from_slice::<Value>(&text).ok()?["done"].as_u64()
    };
    let (mut kills, mut looked) = (0, false);
    loop {
        let before = progress().unwrap_or(0);
        let mut run = command(at, &solve("cut.zarr", "2")).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // The kill comes after some progress, at any place of the work.
        while run.try_wait().unwrap().is_none() && progress().is_none_or(|done| done < before + 2) {
            std::thread::sleep(Duration::from_millis(1 + 3 * (kills % 3)));
        }
        if run.try_wait().unwrap().is_some() {
            break;
        }
        // The file can be rendered during the solve and afterwards, which does not change it. Places that were never
        // reached show their first phases.
        let look = || done(at, &["render", "cut.zarr", "--pupil=0,0,0.4,0", "-o", "cut.png", "--engine", "cpu"]);
        if kills < 2 {
            look();
        }
        run.kill().unwrap();
        run.wait().unwrap();
        kills += 1;
        if !looked && progress().is_some() {
            look();
            looked = true;
        }
    }
    assert!(kills >= 2 && looked, "{kills} kills");
    done(at, &solve("cut.zarr", "2").into_iter().collect::<Vec<_>>());
    assert_eq!(contents(&at.join("whole.zarr")), contents(&at.join("cut.zarr")));
}

/// A plan reports the values that the solve then uses, and writes no file.
#[test]
fn what_is_solved_region_by_region_is_planned_so() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let solve = solve("h.zarr", "1");
    let plan = [&solve[..], &["--dry-run"]].concat();
    let planned: Value = serde_json::from_str(&done(at, &plan)).unwrap();
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 1);
    let solved: Value = serde_json::from_str(&done(at, &solve)).unwrap();
    for what in ["visits", "region", "views", "settings", "depth_mm"] {
        assert!(!planned[what].is_null() && planned[what] == solved[what], "{what}: {planned} {solved}");
    }
    let held = &planned["memory_bytes"];
    let mib = (held["region"].as_u64().unwrap() + held["views"].as_u64().unwrap()) >> 20;
    assert_eq!(Some(mib), solved["planned_memory_mib"].as_u64());
    let words = done(at, &plan.iter().copied().filter(|word| *word != "--json").collect::<Vec<_>>());
    // The text has the region, the diameters of pupils, the steps, the limit of 600 MiB and the space on disk.
    let region = [0, 1].map(|i| planned["region"][i].as_f64().unwrap());
    let diameters = [0, 1].map(|i| planned["settings"]["diameter"][i].as_f64().unwrap() * 1e3);
    assert!(
        words.has_sequence(&region) && words.has_sequence(&diameters.map(|mm| (mm * 100.0).round() / 100.0)),
        "{words}"
    );
    let disk = planned["disk_bytes"].as_u64().unwrap().div_ceil(1 << 20);
    let [steps, visits] = [&planned["settings"]["steps"], &planned["visits"]].map(|n| n.as_u64().unwrap());
    assert!(words.has(&format!("green {visits} {steps} 600 {disk} MiB")), "{words}");
    assert!(words.contains(planned["views"].as_str().unwrap()), "{words}");
}

/// The view is right and has the resolution of the pupil. The rest of the file is not read.
#[test]
fn a_view_reads_the_tiles_under_its_pupil() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let said: Value = serde_json::from_str(&done(at, &solve("h.zarr", "1"))).unwrap();
    assert!(said["psnr_mean_db"].as_f64().unwrap() > 17.0, "{said}");
    let view =
        |pupil: &str| command(at, &["render", "h.zarr", pupil, "-o", "v.npy", "--engine", "cpu"]).output().unwrap();
    let pupil = "--pupil=-0.4,-0.4,0.3,0";
    let first = view(pupil);
    assert!(first.status.success(), "{}", text(&first.stderr));
    let bytes = std::fs::read(at.join("v.npy")).unwrap();
    // A tile far away is damaged. A pupil that does not cover it is not affected.
    let far = at.join("h.zarr/phases/c/0/0/9/9");
    let mut tile = std::fs::read(&far).unwrap();
    tile[7] ^= 1;
    std::fs::write(&far, &tile).unwrap();
    assert!(view(pupil).status.success());
    assert_eq!(std::fs::read(at.join("v.npy")).unwrap(), bytes);
    refused(
        at,
        &["render", "h.zarr", "--pupil=0.5,0.5,0.25,0", "-o", "no.png"],
        "no.png",
        "hologram/damaged/checksum 9/9",
    );
    // The repaired hologram is scored as it was solved.
    tile[7] ^= 1;
    std::fs::write(&far, &tile).unwrap();
    let scored = done(
        at,
        &["eval", "score", "h.zarr", "builtin:still-life", "--test-pupils", "random:4", "--engine", "cpu", "--json"],
    );
    let scored: Value = serde_json::from_str(&scored).unwrap();
    assert!(scored["psnr_db"]["mean"].as_f64().unwrap() > 15.0, "{scored}");
}

/// The model of the display is in the solve, in the view and in the refinement. A hologram that is solved for it
/// regains most of the loss of an unaware hologram. `--ideal` leaves out the model.
#[test]
fn a_display_as_it_is_is_solved_for_in_tiles() {
    let temp = folder();
    let at = temp.path();
    let terms = "level = [[1.0, 1.1, 1.0], [0.9, 1.05, 1.1], [1.0, 0.95, 1.0]]\nbend = [0.1, -0.05]\n\
                 crosstalk = [[1.2, 2.03], [1.2, 1.6], [1.3, 2.2], [1.2, 1.9]]\nsource = [0.1, 0, -0.3, 0, -0.4]\n\
                 undiffracted = [0.15, 0.1, 0.4, -0.3, 0.2]\nwavefront = { 4 = 0.2, 7 = 0.1 }\niris = [0.03, -0.02, 1.02]\n";
    for (model, lag) in [("far", ""), ("bench", "lag = 0.0\n"), ("lags", "lag = 0.1\n")] {
        let section = if model == "far" { String::new() } else { format!("[model.green]\n{terms}{lag}") };
        std::fs::write(at.join(format!("{model}.toml")), format!("{DISPLAY}{section}")).unwrap();
    }
    let solved = |display: &str, out: &str| -> Value {
        let display = format!("{display}.toml");
        let mut words = solve(out, "2");
        words[3] = &display;
        serde_json::from_str(&done(at, &words)).unwrap()
    };
    let score = |file: &str, more: &[&str]| -> f64 {
        let words =
            ["eval", "score", file, "builtin:still-life", "--test-pupils", "random:6", "--engine", "cpu", "--json"];
        let said: Value = serde_json::from_str(&done(at, &[&words, more].concat())).unwrap();
        said["psnr_db"]["mean"].as_f64().unwrap()
    };
    solved("far", "plain.zarr");
    let ideal = score("plain.zarr", &[]);
    done(at, &["convert", "plain.zarr", "plain.npy"]);
    for display in ["bench", "lags"] {
        let (out, file) = (format!("{display}.zarr"), format!("{display}.toml"));
        let said = solved(display, &out);
        assert!(said["peak_memory_mib"].as_f64().unwrap() < 600.0, "{said}");
        done(at, &["convert", "plain.npy", "unaware.zarr", "--display", &file]);
        let (aware, unaware) = (score(&out, &[]), score("unaware.zarr", &[]));
        println!(
            "{display}: ideal {ideal:.2}, unaware {unaware:.2}, aware {aware:.2}, past the model {:.2}",
            score(&out, &["--ideal"])
        );
        assert!(aware > unaware + 3.0 && aware > ideal - 3.5, "{display}: {unaware}, {aware} of {ideal} dB");
        assert!(score(&out, &["--ideal"]) < aware - 1.0, "{display}");
        let refine = ["refine", &out, "builtin:still-life", "--pupil=-0.3,0.25,0.3,0", "--steps", "4", "--json"];
        let said: Value = serde_json::from_str(&done(at, &refine)).unwrap();
        let eye = |i: usize| said["rows"][i]["eye_db"].as_f64().unwrap();
        // Four steps gain as little as on the ideal display for this pupil, which is 0.2 dB.
        assert!(eye(3) > eye(0) + 0.1, "{said}");
    }
    let wrong = format!("{DISPLAY}[model.green]\nfill = 0.9\n");
    std::fs::write(at.join("far.toml"), wrong).unwrap();
    refused(at, &solve("x.zarr", "1"), "x.zarr", "optics/display-file/model-far-field");
}

/// Writes three by three views of a built-in scene, 160 pixels wide, into a folder. Content moves by two pixels from
/// one view to the next.
fn light_field(at: &Path) {
    let display = Display { height: 160, width: 160, ..Display::preset("far-field").unwrap() };
    let request = Request { views: 3, ..Request::new(&display, &[Color::Green]) };
    let field = scene::load("builtin:still-life", &request).unwrap();
    std::fs::create_dir(at).unwrap();
    for (i, view) in field.planes[0].iter().enumerate() {
        write_png(&at.join(format!("view_{i}.png")), 160, 160, &[view]).unwrap();
    }
    let [low, high] = field.disparity.unwrap();
    assert!(high > 1.6, "{high}");
    std::fs::write(at.join("lightfield.toml"), format!("disparity = [{low}, {high}]\n")).unwrap();
}

/// A light field of few views is solved from the views between them. A killed solve continues to the same bytes. The
/// hologram is as good for its scene as for the light field.
#[test]
fn a_sparse_light_field_is_solved_from_between_its_views() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    light_field(&at.join("views"));
    let words = |out: &'static str| -> Vec<&'static str> {
        let mut words = solve(out, "2");
        words[1] = "views";
        let picture = words.iter().position(|w| w.starts_with("tiles.picture=")).unwrap();
        words[picture] = "tiles.picture=160";
        words
    };
    let said: Value = serde_json::from_str(&done(at, &words("whole.zarr"))).unwrap();
    assert!(said["psnr_mean_db"].as_f64().unwrap() > 17.0, "{said}");
    let progress = || {
        let text = std::fs::read(at.join("cut.zarr/progress.json")).ok()?;
        serde_json::from_slice::<Value>(&text).ok()?["done"].as_u64()
    };
    let quiet = |words: &[&str]| command(at, words).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let mut run = quiet(&words("cut.zarr"));
    while run.try_wait().unwrap().is_none() && progress().is_none_or(|done| done < 3) {
        std::thread::sleep(Duration::from_millis(2));
    }
    run.kill().unwrap();
    run.wait().unwrap();
    assert!(progress().is_some(), "it ended before it was killed");
    done(at, &words("cut.zarr"));
    assert_eq!(contents(&at.join("whole.zarr")), contents(&at.join("cut.zarr")));
    let score = |scene: &str| -> f64 {
        let words =
            ["eval", "score", "whole.zarr", scene, "--force", "--test-pupils", "random:6", "--engine", "cpu", "--json"];
        let said: Value = serde_json::from_str(&done(at, &words)).unwrap();
        said["psnr_db"]["mean"].as_f64().unwrap()
    };
    let (own, exact) = (score("views"), score("builtin:still-life"));
    assert!(own > 20.0 && exact > own - 1.0, "{own} dB against the views, {exact} against the scene");
}

/// The scene is a picture with a depth map, whose views are made around each region.
#[test]
fn a_picture_with_depths_is_solved() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let light = |i: usize| 0.3 + 0.3 * ((i % 120) as f32 * 0.2).sin() * ((i / 120) as f32 * 0.15).cos();
    let picture: Vec<f32> = (0..120 * 120).map(light).collect();
    let depth: Vec<f32> = (0..120 * 120).map(|i| (i / 120) as f32 / 120.0).collect();
    write_png(&at.join("picture.png"), 120, 120, &[&picture, &picture, &picture]).unwrap();
    write_png(&at.join("depth.png"), 120, 120, &[&depth]).unwrap();
    let mut words = solve("h.zarr", "1");
    words[1] = "picture.png";
    refused(at, &words, "h.zarr", "scene/no-depth-map");
    words.extend(["--depth-map", "depth.png"]);
    let said: Value = serde_json::from_str(&done(at, &words)).unwrap();
    assert!(said["psnr_mean_db"].as_f64().unwrap() > 14.0, "{said}");
    let score =
        ["eval", "score", "h.zarr", "picture.png", "--depth-map", "depth.png", "--test-pupils", "random:4", "--json"];
    let scored: Value = serde_json::from_str(&done(at, &score)).unwrap();
    assert!(scored["psnr_db"]["mean"].as_f64().unwrap() > 13.0, "{scored}");
}

#[test]
fn mistakes_are_one_line() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let with = |more: &[&'static str]| [&solve("x.zarr", "1")[..], more].concat();
    refused(at, &with(&["--method", "lf2fs"]), "x.zarr", "arguments/in-tiles --method");
    refused(at, &with(&["--set", "optimizer=adam"]), "x.zarr", "arguments/in-tiles");
    let little = ["solve", "builtin:still-life", "--display", "far-field-16k", "--memory", "300MiB", "-o", "x.zarr"];
    refused(at, &little, "x.zarr", "tiled/memory");
    // For a display with a relay, `--memory` is only a limit.
    let relay = |memory| {
        ["solve", "builtin:plane", "--size", "256x256", "--color", "green", "--memory", memory, "-o", "x.zarr"]
    };
    refused(at, &relay("40MiB"), "x.zarr", "scene/memory");
    refused(
        at,
        &["solve", "builtin:plane", "--memory", "much", "-o", "x.zarr"],
        "x.zarr",
        "usage/value-validation 4GiB",
    );
}

/// The same job on Vulkan gives the same quality, with no more difference than rounding makes in a few steps.
#[test]
fn vulkan_solves_the_same() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let quality = |engine: &'static str| {
        let mut words = solve("h.zarr", "2");
        let passes = words.iter().position(|w| w.starts_with("tiles.passes=")).unwrap();
        words[passes] = "tiles.passes=1";
        let chosen = words.iter().position(|w| *w == "--engine").unwrap();
        words[chosen + 1] = engine;
        let said: Value = serde_json::from_str(&done(at, &words)).unwrap();
        said["psnr_mean_db"].as_f64().unwrap()
    };
    let (cpu, vulkan) = (quality("cpu"), quality("vulkan"));
    assert!((cpu - vulkan).abs() < 0.1, "{cpu} dB on the CPU, {vulkan} on Vulkan");
}
