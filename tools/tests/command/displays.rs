//! `eyebox display list`, `show` and `new`, and display files that `new` makes.

use crate::common::{Printed, command, done, eyebox, folder, json, notes, refused, text};

#[test]
fn presets_are_listed_and_shown_with_their_sources() {
    let temp = folder();
    let at = temp.path();
    let listed = done(at, &["display", "list"]);
    for name in [
        "paper",
        "plm",
        "santec-slm-200",
        "meadowlark-e19x12",
        "holoeye-pluto-2.1",
        "thorlabs-exulus-4k1",
        "hamamatsu-x15213",
    ] {
        assert!(listed.lines().any(|line| line.starts_with(name)), "{name}: {listed}");
    }
    let report = json(at, &["display", "list", "--json"]);
    let all = report["displays"].as_array().expect("displays");
    let is_listed = |name: &str| listed.lines().any(|line| line.split(' ').next() == Some(name));
    assert!(all.iter().all(|display| is_listed(display["name"].as_str().expect("a name"))), "{listed}");
    let pluto = all.iter().find(|d| d["name"] == "holoeye-pluto-2.1").expect("it is there");
    assert_eq!(
        (&pluto["resolution"][1], &pluto["pitch_um"], &pluto["rate_hz"]),
        (&1920.into(), &8.0.into(), &serde_json::Value::Null)
    );
    let shown = done(at, &["display", "show", "holoeye-pluto-2.1"]);
    assert!(shown.lines().any(|line| line.starts_with('#') && line.contains("https://holoeye.com/")), "{shown}");
    let again = done(at, &["display", "show", "fields"]);
    std::fs::write(at.join("fields.toml"), &again).unwrap();
    assert!(again.ends_with(&done(at, &["display", "show", "fields.toml"])));
    refused(at, &["display", "show", "none"], "x", "optics/unknown-display holoeye-pluto-2.1");
}

#[test]
fn a_file_begun_from_a_preset_is_taken_as_a_display() {
    let temp = folder();
    let at = temp.path();
    done(at, &["display", "new", "holoeye-pluto-2.1", "-o", "bench.toml"]);
    let begun = std::fs::read_to_string(at.join("bench.toml")).unwrap();
    let measured = begun.replace("#two_pi_level", "two_pi_level").replace("green = 256", "green = 218");
    std::fs::write(at.join("bench.toml"), measured).unwrap();
    ::eyebox::low_level::files::write_npy(&at.join("p.npy"), &[1, 2, 3], &[0.0, 1.0, 2.0, 3.0, -1.0, -0.02]).unwrap();
    let encode =
        ["encode", "p.npy", "--display", "bench.toml", "--color", "green", "--size", "2x3", "-o", "x", "--json"];
    let report: serde_json::Value = serde_json::from_str(&done(at, &encode)).expect("JSON");
    assert_eq!(report["display"], "bench");
    let frame = image::open(at.join("x/frame-00000.png")).unwrap().into_luma8().into_raw();
    assert_eq!(frame, [0, 35, 69, 104, 183, 217]);
    refused(at, &["display", "new", "paper", "-o", "bench.toml"], "none", "arguments/exists");
    refused(at, &["display", "new", "none", "-o", "y.toml"], "y.toml", "arguments/no-such-preset");
    refused(at, &["display", "new", "paper", "-o", "y.txt"], "y.txt", "arguments/ending");
}

/// `display new` makes the first phases of a display, with one table per color. A solve of all colors reads the tables
/// and fits none. Tables in the cache are not fitted again, and a far field has none.
#[test]
fn a_file_begun_from_a_preset_brings_its_first_phases() {
    let temp = folder();
    let at = temp.path();
    let cached = |args: &[&str]| {
        let answer = command(at, args).env("XDG_CACHE_HOME", at.join("cache")).output().unwrap();
        assert!(answer.status.success(), "{args:?}: {}", text(&answer.stderr));
    };
    let tables = || {
        let Ok(entries) = std::fs::read_dir(at.join("cache/eyebox")) else { return Vec::new() };
        let entries = entries.map(|entry| entry.unwrap());
        let kept = entries.filter(|entry| entry.file_name().to_string_lossy().ends_with(".table"));
        let mut kept: Vec<_> = kept.map(|e| (e.file_name(), e.metadata().unwrap().modified().unwrap())).collect();
        kept.sort();
        kept
    };
    cached(&["display", "new", "far-field", "-o", "far.toml"]);
    assert_eq!(tables().len(), 0);
    cached(&["display", "new", "small", "-o", "bench.toml"]);
    let kept = tables();
    assert_eq!(kept.len(), 3);
    cached(&["display", "new", "small", "-o", "again.toml"]);
    cached(&["solve", "builtin:plane", "--display", "bench.toml", "--steps", "0", "--engine", "cpu", "-o", "h.zarr"]);
    assert_eq!(tables(), kept);
}

/// The preset spreads the ten bits of a pixel over three channels, as the maker's guide describes. They are R7 to R5,
/// G7 to G5 and B7 to B4.
#[test]
fn a_preset_puts_the_bits_of_a_level_where_its_slm_reads_them() {
    let temp = folder();
    let at = temp.path();
    // A phase of n / 255.75 turns is gray level 4 n of 1023.
    let levels = [0, 1, 37, 128, 255];
    let phases = levels.map(|n| (f64::from(n) / 255.75 * std::f64::consts::TAU) as f32);
    ::eyebox::low_level::files::write_npy(&at.join("p.npy"), &[1, 1, 5], &phases).unwrap();
    let encode = ["encode", "p.npy", "--display", "santec-slm-200", "--color", "green", "--size", "1x5", "-o", "x"];
    done(at, &encode);
    let frame = image::open(at.join("x/frame-00000.png")).unwrap().into_rgb8();
    let read =
        frame.pixels().map(|image::Rgb([r, g, b])| u32::from(r >> 5) << 7 | u32::from(g >> 5) << 4 | u32::from(b >> 4));
    assert_eq!(read.collect::<Vec<_>>(), levels.map(|n| 4 * n as u32));
    // The frames can be rendered again.
    done(at, &["render", "x", "--pupil=0,0,4,0", "--force", "--engine", "cpu", "-o", "seen.png"]);
}

/// A set of eight gray frames has an eighth of the 60 Hz of the display. Each command that makes such a set reports
/// this.
#[test]
fn a_set_that_flickers_is_said() {
    let temp = folder();
    let at = temp.path();
    ::eyebox::low_level::files::write_npy(&at.join("p.npy"), &[8, 4, 6], &[0.5; 192]).unwrap();
    let encode = |display| ["encode", "p.npy", "--display", display, "--color", "green", "--size", "4x6", "-o", "x"];
    let notes_of = |display| {
        let all = json(at, &[&encode(display)[..], &["--json"]].concat());
        assert_eq!(all["frames"].as_array().map(Vec::is_empty), Some(false), "{all}");
        all["notes"].clone()
    };
    // The report has the number of sets per second.
    assert!(notes(&notes_of("grey8"), "7.5 50 24"), "{}", notes_of("grey8"));
    // The text has it only with -v, because files may be shown at another rate.
    assert!(!text(&eyebox(at, &encode("grey8")).stderr).has("7.5"));
    assert!(text(&eyebox(at, &[&encode("grey8")[..], &["-v"]].concat()).stderr).has("7.5"));
    assert!(!notes(&notes_of("planes8"), "50"), "{}", notes_of("planes8"));
    // The rate in the display's file decides.
    let fast = done(at, &["display", "show", "grey8"]).replace("levels = 256", "levels = 256\nrate_hz = 480");
    std::fs::write(at.join("fast.toml"), fast).unwrap();
    assert!(!notes(&notes_of("fast.toml"), "50"), "{}", notes_of("fast.toml"));
    let plan = ["solve", "builtin:plane", "--dry-run", "--size", "32x32", "--color", "green", "--engine", "cpu"];
    let planned = json(at, &[&plan[..], &["--json"]].concat());
    assert!(planned["flicker"].as_str().is_some_and(|slow| slow.has("7.5")), "{planned}");
    assert!(done(at, &plan).has("7.5"));
    let solve = [
        "solve",
        "builtin:plane",
        "-o",
        "h.zarr",
        "--size",
        "32x32",
        "--steps",
        "1",
        "--color",
        "green",
        "--engine",
        "cpu",
    ];
    done(at, &solve);
    let show = ["show", "h.zarr", "--display", "grey8", "--size", "32x32", "--clock", "simulated", "--duration", "0.5"];
    let said = text(&eyebox(at, &show).stderr);
    // The eye sees flicker below 50 sets per second.
    assert!(said.lines_with("7.5 50") == 1, "{said}");
}
