//! Far-field holograms that are solved region by region, as a user runs it: memory, ends by force, looking.

mod common;

use common::{command, done, folder, refused, text};
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
        "--picture",
        "96",
        "--passes",
        "2",
        "--engine",
        "cpu",
        "--json",
        "-o",
        out,
    ]
}

/// Every file of a folder.
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

/// Killed again and again, at any moment, it goes on, and the file is that of a solve that was left alone.
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
        // Not before something came of it, then at once, wherever it is.
        while run.try_wait().unwrap().is_none() && progress().is_none_or(|done| done < before + 2) {
            std::thread::sleep(Duration::from_millis(1 + 3 * (kills % 3)));
        }
        if run.try_wait().unwrap().is_some() {
            break;
        }
        run.kill().unwrap();
        run.wait().unwrap();
        kills += 1;
        if !looked && progress().is_some() {
            // What is there can be looked at; what was never reached shows its first phases.
            done(at, &["view", "cut.zarr", "--pupil=0,0,0.4,0", "-o", "cut.png", "--engine", "cpu"]);
            looked = true;
        }
    }
    assert!(kills >= 2 && looked, "{kills} kills");
    done(at, &solve("cut.zarr", "2").into_iter().collect::<Vec<_>>());
    assert_eq!(contents(&at.join("whole.zarr")), contents(&at.join("cut.zarr")));
}

/// The view comes out at what the pupil resolves, right, and without reading the rest of the file.
#[test]
fn a_view_reads_the_tiles_under_its_pupil() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let said: Value = serde_json::from_str(&done(at, &solve("h.zarr", "1"))).unwrap();
    assert!(said["psnr_mean_db"].as_f64().unwrap() > 17.0, "{said}");
    let view =
        |pupil: &str| command(at, &["view", "h.zarr", pupil, "-o", "v.npy", "--engine", "cpu"]).output().unwrap();
    let pupil = "--pupil=-0.4,-0.4,0.3,0";
    let first = view(pupil);
    assert!(first.status.success(), "{}", text(&first.stderr));
    let bytes = std::fs::read(at.join("v.npy")).unwrap();
    // A tile far away is damaged: nobody notices who does not look there.
    let far = at.join("h.zarr/phases/c/0/0/9/9");
    let mut tile = std::fs::read(&far).unwrap();
    tile[7] ^= 1;
    std::fs::write(&far, &tile).unwrap();
    assert!(view(pupil).status.success());
    assert_eq!(std::fs::read(at.join("v.npy")).unwrap(), bytes);
    refused(at, &["view", "h.zarr", "--pupil=0.5,0.5,0.25,0", "-o", "no.png"], "no.png", "9/9");
    // Scored as it was solved.
    tile[7] ^= 1;
    std::fs::write(&far, &tile).unwrap();
    let scored =
        done(at, &["score", "h.zarr", "builtin:still-life", "--pupils", "random:4", "--engine", "cpu", "--json"]);
    let scored: Value = serde_json::from_str(&scored).unwrap();
    assert!(scored["psnr_db"]["mean"].as_f64().unwrap() > 15.0, "{scored}");
}

#[test]
fn mistakes_are_one_line() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let with = |more: &[&'static str]| [&solve("x.zarr", "1")[..], more].concat();
    refused(at, &with(&["--method", "lf2fs"]), "x.zarr", "--method");
    refused(at, &with(&["--optimizer", "adam"]), "x.zarr", "adam");
    let little = ["solve", "builtin:still-life", "--display", "far-field-16k", "--memory", "300MiB", "-o", "x.zarr"];
    refused(at, &little, "x.zarr", "MiB");
    let relay = ["solve", "builtin:plane", "--size", "64x64", "--memory", "1GiB", "-o", "x.zarr"];
    refused(at, &relay, "x.zarr", "far-field");
    refused(at, &["solve", "builtin:plane", "--memory", "much", "-o", "x.zarr"], "x.zarr", "4GiB");
}

/// The same job on Vulkan: what it comes to is as good, and no further off than rounding takes a few steps.
#[test]
fn vulkan_solves_the_same() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let quality = |engine: &'static str| {
        let mut words = solve("h.zarr", "2");
        let passes = words.iter().position(|w| *w == "--passes").unwrap();
        words[passes + 1] = "1";
        let chosen = words.iter().position(|w| *w == "--engine").unwrap();
        words[chosen + 1] = engine;
        let said: Value = serde_json::from_str(&done(at, &words)).unwrap();
        said["psnr_mean_db"].as_f64().unwrap()
    };
    let (cpu, vulkan) = (quality("cpu"), quality("vulkan"));
    assert!((cpu - vulkan).abs() < 0.1, "{cpu} dB on the CPU, {vulkan} on Vulkan");
}
