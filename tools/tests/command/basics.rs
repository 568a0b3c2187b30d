//! The command as a user runs it. Mistakes give one line, and the command does what its help describes.

use crate::common::{
    Printed, Refusal, attributes, command, done, eyebox, folder, json, refusal, refused, text, with_json_errors,
};
use std::path::{Path, PathBuf};
use std::process::Command;

const SMALL: [&str; 8] = ["--size", "40x48", "--steps", "3", "--color", "green", "--engine", "cpu"];

fn solve<'a>(scene: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["solve", scene, "-o", out][..], &SMALL, more].concat()
}

/// Writes nine target images of the built-in scene as a folder of views.
fn views(folder: &Path) -> PathBuf {
    let views = folder.join("views");
    std::fs::create_dir(&views).unwrap();
    for i in 0..9 {
        let (x, y) = ((i % 3 - 1) * 7, (i / 3 - 1) * 7);
        let (pupil, out) = (format!("--pupil={x},{y},2,0"), format!("views/view_{i:02}.png"));
        done(folder, &["render", "builtin:still-life", "--size", "40x48", "--views", "3", &pupil, "-o", &out]);
    }
    views
}

#[test]
fn mistakes_in_arguments_are_one_line() {
    let temp = folder();
    let at = temp.path();
    refused(at, &solve("none", "x.zarr", &[]), "x.zarr", "scene/not-found");
    refused(at, &solve("builtin:none", "x.zarr", &[]), "x.zarr", "scene/builtin/no-such-scene still-life");
    refused(at, &solve("builtin:plane", "x.tiff", &[]), "x.tiff", "arguments/ending");
    refused(at, &solve("builtin:plane", "none/x.zarr", &[]), "none", "arguments/no-such-folder");
    refused(at, &solve("builtin:plane", "x.zarr", &["--set", "efficiency=0"]), "x.zarr", "solve/setting efficiency");
    refused(at, &solve("builtin:plane", "x.zarr", &["--set", "efficiency=2"]), "x.zarr", "solve/setting efficiency");
    refused(at, &solve("builtin:plane", "x.zarr", &["--frames", "0"]), "x.zarr", "solve/setting sub-frames");
    refused(at, &solve("builtin:plane", "x.zarr", &["--pupils", "0"]), "x.zarr", "solve/setting pupils");
    refused(at, &solve("builtin:plane", "x.zarr", &["--pupil-diameter", "0..2"]), "x.zarr", "usage/value-validation");
    let from_none = ["solve", "builtin:plane", "-o", "x.zarr", "--size", "8x8", "--engine", "vulkan-from:none"];
    refused(at, &from_none, "x.zarr", "usage/value-validation modulate");
    refused(at, &solve("builtin:plane", "x.zarr", &["--device", "0"]), "x.zarr", "arguments/device-of-cpu --engine");
    let nowhere = ["solve", "builtin:plane", "-o", "x.zarr", "--size", "8x8", "--device", "nowhere"];
    refused(at, &nowhere, "x.zarr", "engine/no-device");
    refused(at, &["solve", "builtin:plane", "-o", "x.zarr", "--size", "0x8"], "x.zarr", "usage/value-validation 65536");
    refused(at, &["solve", "builtin:plane", "-o", "x.zarr", "--display", "none"], "x.zarr", "optics/unknown-display");
    let render = |pupil| ["render", "builtin:plane", "--size", "40x48", pupil, "-o", "x.png"];
    refused(at, &render("--pupil=0,0,0,0"), "x.png", "usage/value-validation diameter");
    refused(at, &render("--pupil=0,0,-3,0"), "x.png", "usage/value-validation diameter");
    refused(at, &render("--pupil=0,0,3"), "x.png", "usage/value-validation");
    refused(at, &render("--pupil=12,0,3,0"), "x.png", "arguments/outside-eyebox");
}

/// If there is no driver or no loader, `--engine vulkan` is refused in one line with a remedy, and nothing is written.
/// Everything else continues on the CPU.
#[test]
#[cfg(target_os = "linux")]
fn a_machine_without_vulkan_is_said_in_one_line() {
    let temp = folder();
    let at = temp.path();
    // The loader looks for its drivers in a file that does not exist.
    let nowhere = at.join("none.json");
    let no_driver = [("VK_DRIVER_FILES", &nowhere), ("VK_ICD_FILENAMES", &nowhere)];
    // A file that is no library comes before the loader in the search path.
    let libraries = at.join("libraries");
    std::fs::create_dir(&libraries).unwrap();
    for name in ["libvulkan.so.1", "libvulkan.so"] {
        std::fs::write(libraries.join(name), "no library").unwrap();
    }
    let no_loader = [("LD_LIBRARY_PATH", &libraries)];
    let mut reasons = Vec::new();
    for environment in [&no_driver[..], &no_loader[..]] {
        let run = |args: &[&str]| {
            let mut command = command(at, args);
            command.envs(environment.iter().copied());
            with_json_errors(&mut command).output().expect("the command starts")
        };
        let vulkan = ["--engine", "vulkan", "--size", "40x48", "--steps", "1", "--color", "green"];
        let answer = run(&[&["solve", "builtin:plane", "-o", "x.zarr"][..], &vulkan].concat());
        assert_eq!(answer.status.code(), Some(2), "{}", text(&answer.stderr));
        assert_eq!(text(&answer.stderr).trim().lines().count(), 1, "{}", text(&answer.stderr));
        let refusal = Refusal::of(&answer);
        refusal.is("engine/no-device tools/setup.sh");
        assert!(!at.join("x.zarr").exists());
        // The printed list has the same reason.
        let report = |args: &[&str]| -> serde_json::Value {
            let answer = run(args);
            assert_eq!(answer.status.code(), Some(0), "{}", text(&answer.stderr));
            serde_json::from_slice(&answer.stdout).expect("JSON")
        };
        let devices = report(&["device", "list", "--json"]);
        assert_eq!(
            (&devices["no_vulkan"], &devices["vulkan"]),
            (&refusal.message.clone().into(), &serde_json::json!([]))
        );
        let said = text(&run(&["device", "list"]).stdout);
        assert!(said.lines().any(|l| l.starts_with("vulkan") && l.contains(&refusal.message)), "{said}");
        let auto = ["solve", "builtin:plane", "-o", "a.npy", "--size", "40x48", "--steps", "1", "--color", "green"];
        assert_eq!(report(&[&auto[..], &["--json"]].concat())["engine"], devices["cpu"]);
        std::fs::remove_file(at.join("a.npy")).unwrap();
        reasons.push(refusal.message);
    }
    assert_ne!(reasons[0], reasons[1]);
}

#[test]
fn mistakes_in_display_files_are_one_line() {
    let temp = folder();
    let at = temp.path();
    let right = "resolution = [40, 48]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
    for (wrong, what) in [
        (format!("{right}levles = 16\n"), "optics/display-file/toml levles"),
        (right.replace("520", "0"), "optics/display-file/not-positive wavelength"),
        (right.replace("40, 48", "0, 48"), "optics/display-file/size 0x48"),
        (right.replace("pitch_um = 8.0\n", ""), "optics/display-file/toml pitch_um"),
        ("[".into(), "optics/display-file/toml"),
    ] {
        std::fs::write(at.join("bench.toml"), wrong).unwrap();
        refused(
            at,
            &["solve", "builtin:plane", "-o", "x.zarr", "--display", "bench.toml", "--color", "green"],
            "x.zarr",
            what,
        );
    }
    std::fs::write(at.join("bench.toml"), right).unwrap();
    refused(
        at,
        &["solve", "builtin:plane", "-o", "x.zarr", "--display", "bench.toml", "--color", "red"],
        "x.zarr",
        "optics/no-color",
    );
    done(at, &["solve", "builtin:plane", "-o", "x.zarr", "--display", "bench.toml", "--steps", "2", "--engine", "cpu"]);
}

#[test]
fn faults_in_folders_of_views_are_one_line() {
    let temp = folder();
    let at = temp.path();
    let views = views(at);
    done(at, &solve("views", "whole.zarr", &[]));
    let (last, kept) = (views.join("view_08.png"), std::fs::read(views.join("view_08.png")).unwrap());
    std::fs::write(&last, &kept[..kept.len() / 2]).unwrap();
    refused(at, &solve("views", "x.zarr", &[]), "x.zarr", "scene/corrupt/damaged view_08.png");
    std::fs::remove_file(&last).unwrap();
    refused(at, &solve("views", "x.zarr", &[]), "x.zarr", "scene/not-a-grid/grid-doubtful");
    std::fs::write(&last, &kept).unwrap();
    std::fs::remove_file(views.join("view_04.png")).unwrap();
    refused(at, &solve("views", "x.zarr", &[]), "x.zarr", "scene/missing-view view_04.png");
}

#[test]
fn damaged_holograms_are_one_line() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve("builtin:plane", "h.zarr", &[]));
    let render = ["render", "h.zarr", "--pupil=0,0,5,0", "-o", "x.png"];
    let mut files = vec![at.join("h.zarr")];
    while let Some(folder) = files.iter().position(|f| f.is_dir()) {
        let folder = files.swap_remove(folder);
        files.extend(std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()));
    }
    assert!(files.len() > 8, "documents and chunks");
    for file in files {
        let whole = std::fs::read(&file).unwrap();
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let mut flipped = whole.clone();
        flipped[whole.len() / 2] ^= 1;
        for damaged in [&flipped[..], &whole[..whole.len() - 5]] {
            std::fs::write(&file, damaged).unwrap();
            let refusal = refusal(at, &render);
            assert!(refusal.message.contains(&name) && !at.join("x.png").exists(), "{refusal:?}");
        }
        std::fs::write(&file, whole).unwrap();
    }
    done(at, &render);
    refused(at, &["render", "none.zarr", "--pupil=0,0,5,0", "-o", "y.png"], "y.png", "file/read none.zarr");
    refused(
        at,
        &["render", "h.zarr", "--pupil=0,0,5,0", "--pitch", "8", "-o", "y.png"],
        "y.png",
        "arguments/own-optics",
    );
}

#[test]
fn bare_phases_need_sound_optics() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve("builtin:plane", "p.npy", &[]));
    let render = |wavelength, out| {
        [
            "render",
            "p.npy",
            "--pupil=0,0,5,0",
            "--pitch",
            "8",
            "--wavelength",
            wavelength,
            "--focal-length",
            "400",
            "-o",
            out,
        ]
    };
    done(at, &render("520", "v.npy"));
    refused(at, &render("0", "x.npy"), "x.npy", "optics/not-positive wavelength");
    refused(at, &render("520,440", "x.npy"), "x.npy", "hologram/not-a-hologram/wavelengths-count");
    refused(at, &["render", "p.npy", "--pupil=0,0,5,0", "-o", "x.npy"], "x.npy", "hologram/no-optics --pitch");
    // One of the phases is NaN.
    let mut bytes = std::fs::read(at.join("p.npy")).unwrap();
    let end = bytes.len();
    bytes[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(at.join("p.npy"), bytes).unwrap();
    refused(at, &render("520", "x.npy"), "x.npy", "file/content/not-finite p.npy");
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_one_line_and_leaves_nothing() {
    let temp = folder();
    let at = temp.path();
    // A limit on the size of files replaces a full disk. Writing fails in the middle.
    let script = format!(
        "trap '' XFSZ; ulimit -f 2; exec {} {}",
        crate::common::program(),
        solve("builtin:plane", "x.zarr", &[]).join(" ")
    );
    let mut shell = Command::new("bash");
    let answer = with_json_errors(shell.args(["-c", &script]).current_dir(at)).output().unwrap();
    assert_eq!(answer.status.code(), Some(2), "{}", text(&answer.stderr));
    Refusal::of(&answer).is("file/full");
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 0, "something was left behind");
}

#[test]
fn the_same_seed_gives_the_same_file_and_another_another() {
    let temp = folder();
    let at = temp.path();
    for (out, seed) in [("a.npy", "5"), ("b.npy", "5"), ("c.npy", "6")] {
        done(at, &solve("builtin:still-life", out, &["--seed", seed]));
    }
    let read = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(read("a.npy") == read("b.npy") && read("a.npy") != read("c.npy"));
}

#[test]
fn from_a_scene_to_a_score_in_three_colours() {
    let temp = folder();
    let at = temp.path();
    let said = done(
        at,
        &[
            "solve",
            "builtin:still-life",
            "-o",
            "h.zarr",
            "--size",
            "40x48",
            "--steps",
            "3",
            "--frames",
            "2",
            "--set",
            "efficiency=0.5",
            "--engine",
            "cpu",
            "--json",
        ],
    );
    let report: serde_json::Value = serde_json::from_str(&said).expect("one JSON object");
    assert_eq!(report["colors"].as_array().map(Vec::len), Some(3));
    assert!(
        report["colors"].as_array().unwrap().iter().all(|c| (c["efficiency"].as_f64().unwrap() - 0.5).abs() < 1e-9)
    );
    done(at, &["render", "h.zarr", "--pupil=2,1,5,0.3", "-o", "v.png"]);
    done(at, &["render", "h.zarr", "--pupil=2,1,5,0.3", "-o", "v.npy"]);
    let array = std::fs::read(at.join("v.npy")).unwrap();
    assert!(text(&array[..128]).contains("(3, 40, 48)") && array.len() == 128 + 3 * 40 * 48 * 4);
    done(at, &["render", "builtin:still-life", "--size", "40x48", "--pupil=2,1,5,0.3", "-o", "t.npy"]);
    let score: serde_json::Value = serde_json::from_str(&done(
        at,
        &["eval", "score", "h.zarr", "builtin:still-life", "--test-pupils", "random:3", "--json"],
    ))
    .unwrap();
    assert!(score["psnr_db"]["mean"].as_f64().unwrap() > 10.0 && score["pupils"].as_array().unwrap().len() == 3);
    std::fs::write(at.join("pupils.json"), "[[0, 0, 4, 0], [2, -1, 6, 0.2]]").unwrap();
    let score = ["eval", "score", "h.zarr", "builtin:still-life", "--test-pupils", "pupils.json"];
    assert_eq!(json(at, &[&score[..], &["--json"]].concat())["pupils"].as_array().map(Vec::len), Some(2));
    assert!(done(at, &score).has("2"));
    std::fs::write(at.join("pupils.json"), "[[0, 0, 4]]").unwrap();
    refused(
        at,
        &["eval", "score", "h.zarr", "builtin:still-life", "--test-pupils", "pupils.json"],
        "x",
        "arguments/pupils pupils.json",
    );
    done(at, &["convert", "h.zarr", "p.npy"]);
    done(at, &["convert", "h.zarr", "frames"]);
    assert_eq!(std::fs::read_dir(at.join("frames")).unwrap().count(), 6 + 1, "the pictures and their list");
    done(
        at,
        &[
            "render",
            "frames",
            "--pupil=0,0,5,0",
            "--pitch",
            "8",
            "--wavelength",
            "660,520,440",
            "--focal-length",
            "400",
            "-o",
            "f.png",
        ],
    );
}

#[test]
fn a_score_takes_depths_as_they_were_solved() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve("builtin:still-life", "h.zarr", &["--depth=-0.05..0.1"]));
    let said = done(at, &["eval", "score", "h.zarr", "builtin:still-life", "--json"]);
    let score: serde_json::Value = serde_json::from_str(&said).unwrap();
    let focus = |p: &serde_json::Value| p["pupil_mm"][3].as_f64().unwrap();
    let pupils = score["pupils"].as_array().unwrap();
    assert!(pupils.len() == 16 && pupils.iter().all(|p| (-0.0501..=0.1001).contains(&focus(p))), "{said}");
}

/// The scene is made again from its name and the settings in the hologram. The result is the same with all options
/// repeated.
#[test]
fn a_score_makes_the_scene_as_it_was_solved() {
    let temp = folder();
    let at = temp.path();
    let score = |hologram: &str, scene: &[&str], more: &[&str]| {
        done(at, &[&["eval", "score", hologram][..], scene, &["--test-pupils", "random:4", "--json"], more].concat())
    };
    let still_life = ["builtin:still-life"];
    done(at, &solve("builtin:still-life", "h.zarr", &["--views", "4"]));
    let remembered = score("h.zarr", &still_life, &[]);
    assert_eq!(remembered, score("h.zarr", &still_life, &["--views", "4"]));
    assert_ne!(remembered, score("h.zarr", &still_life, &["--views", "9"]));
    // For a picture with a depth map, the hologram also has the meaning and the order of the map's values.
    let render = ["render", "builtin:still-life", "--size", "40x48", "--pupil=0,0,2,0"];
    done(at, &[&render[..], &["-o", "photo.png"]].concat());
    done(at, &[&render[..], &["--color", "green", "-o", "depth.png"]].concat());
    let picture = ["photo.png", "--depth-map", "depth.png"];
    done(at, &solve("photo.png", "p.zarr", &["--depth-map", "depth.png", "--views", "3", "--depth=0.1..-0.05"]));
    let remembered = score("p.zarr", &picture, &[]);
    assert_eq!(remembered, score("p.zarr", &picture, &["--views", "3", "--depth=0.1..-0.05"]));
    assert_ne!(remembered, score("p.zarr", &picture, &["--depth=-0.05..0.1"]));
}

#[test]
fn the_smallest_displays_work() {
    let temp = folder();
    let at = temp.path();
    for size in ["1x1", "1x9", "7x13"] {
        let args = [
            "solve",
            "builtin:plane",
            "-o",
            "s.npy",
            "--size",
            size,
            "--steps",
            "2",
            "--color",
            "green",
            "--engine",
            "cpu",
        ];
        let answer = eyebox(at, &args);
        let said = text(&answer.stderr);
        assert!(matches!(answer.status.code(), Some(0 | 2)) && !said.contains("panicked"), "{size}: {said}");
    }
}

#[test]
fn padding_is_said() {
    let temp = folder();
    let at = temp.path();
    let padded = solve("builtin:plane", "p.zarr", &["--set", "padding=always", "--depth=-9..9"]);
    let answer = eyebox(at, &padded);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let report = json(at, &[&padded[..], &["--json"]].concat());
    let [rows, columns] = [0, 1].map(|i| report["padding"][i].as_u64().unwrap());
    assert!(rows > 0 && columns > 0 && text(&answer.stderr).has(&format!("{rows} {columns}")), "{report}");
    done(temp.path(), &["render", "p.zarr", "--pupil=0,0,5,0", "-o", "v.png"]);
}

#[test]
fn time_is_a_limit_too() {
    let temp = folder();
    let args = [
        "solve",
        "builtin:plane",
        "-o",
        "h.npy",
        "--size",
        "40x48",
        "--steps",
        "1000000",
        "--duration",
        "1",
        "--color",
        "green",
        "--engine",
        "cpu",
        "--json",
    ];
    let report: serde_json::Value = serde_json::from_str(&done(temp.path(), &args)).unwrap();
    assert_eq!(report["colors"][0]["stopped_by"], "seconds");
}

#[test]
fn help_and_devices_answer() {
    let temp = folder();
    for command in ["demo", "solve", "render", "eval score", "eval compare", "convert", "bench", "device list"] {
        // The help has the usage, and examples on lines of their own.
        let words: Vec<_> = command.split(' ').chain(["--help"]).collect();
        let help = done(temp.path(), &words);
        assert!(help.lines().any(|line| line.starts_with(&format!("  eyebox {command} "))), "{help}");
    }
    assert!(done(temp.path(), &["device", "list"]).has("cpu auto"));
    assert!(json(temp.path(), &["device", "list", "--json"]).is_object());
}

#[test]
fn storage_is_chosen_kept_and_refused() {
    let temp = folder();
    let at = temp.path();
    let run = |storage: &str| {
        let out = format!("{storage}.zarr");
        let report = done(at, &solve("builtin:still-life", &out, &["--set", &format!("storage={storage}"), "--json"]));
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        assert_eq!(report["settings"]["storage"], storage);
        // The hologram records how it was made.
        assert_eq!(attributes(&at.join(&out))["settings"]["solve"]["storage"], storage);
        let timed = |kernel| report["timings"].as_array().unwrap().iter().any(|t| t["kernel"] == kernel);
        assert_eq!(timed("check_finite"), storage == "fp16", "{report}");
        report["colors"][0]["psnr_mean_db"].as_f64().unwrap()
    };
    let (full, half) = (run("fp32"), run("fp16"));
    assert!((full - half).abs() < 0.05 && full != half, "{full} and {half} dB");
    refused(
        at,
        &solve("builtin:still-life", "x.zarr", &["--set", "storage=fp8"]),
        "x.zarr",
        "produce/job/value storage",
    );
}

#[test]
fn every_method_solves_from_the_command_line() {
    let temp = folder();
    let at = temp.path();
    for method in ["lf2fs", "stft", "stft-unfiltered", "stft-exact", "smooth", "dpac", "pupil-aware"] {
        let report = done(at, &solve("builtin:still-life", "m.npy", &["--method", method, "--json"]));
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        assert_eq!(report["settings"]["method"], method);
        assert!(report["colors"][0]["psnr_mean_db"].as_f64().is_some(), "{report}");
    }
    let refused = |more: &[&str], what: &str| refused(at, &solve("builtin:still-life", "n.npy", more), "n.npy", what);
    refused(&["--method", "hogel"], "usage/value-validation stft-exact");
    refused(&["--method", "stft", "--set", "stft_filter=0"], "solve/setting filter");
    refused(&["--method", "stft", "--set", "stft_samples=0"], "solve/setting");
    refused(&["--method", "pupil-aware", "--set", "evenness=-1"], "solve/setting evenness");
    refused(&["--method", "pupil-aware", "--set", "patches=17"], "solve/setting patches");
    refused(&["--set", "levels=0"], "solve/setting");
    refused(&["--set", "levels=measured"], "produce/job/value levels");
    refused(&["--settings", "none.toml"], "produce/job/unreadable none.toml");
    std::fs::write(at.join("slm.toml"), "levels = [0, 1.5, 3.2, 'four']\n").unwrap();
    refused(&["--settings", "slm.toml"], "produce/job/value levels");
    std::fs::write(at.join("slm.toml"), "levels = [0, 1.5, 3.2, 4.7] # measured\nrefine.pupils = 3\n").unwrap();
    for given in [["--settings", "slm.toml"], ["--set", "levels=16"]] {
        done(at, &solve("builtin:still-life", "l.npy", &given));
    }
}

#[test]
fn what_the_library_says_is_shown_when_asked_for() {
    let here = folder();
    let render = ["render", "builtin:plane", "--size", "16x16", "--color", "green", "--pupil=0,0,4,0", "-o", "p.npy"];
    let said = |args: &[&str], log: Option<&str>| {
        let mut command = command(here.path(), args);
        command.env_remove("RUST_LOG").envs(log.map(|l| ("RUST_LOG", l)));
        text(&command.output().expect("the command starts").stderr)
    };
    // The library logs the scene that it loads.
    let loads = |said: &str| said.has("builtin:plane");
    assert!(!loads(&said(&render, None)));
    assert!(loads(&said(&[&["-v"], &render[..]].concat(), None)));
    assert!(loads(&said(&render, Some("eyebox=debug"))));
    let wrong = said(&render, Some("eyebox=loudly"));
    assert!(wrong.has("RUST_LOG") && !loads(&wrong), "{wrong}");
}
