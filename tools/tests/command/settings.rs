//! `--settings` and `--set`, in every command that takes them.

use crate::common::{done, folder, json, refusal, refused, text};

const SMALL: [&str; 8] = ["--size", "16x16", "--color", "green", "--steps", "2", "--frames", "2"];

/// The printed settings are a file that gives the same settings again. No hologram is computed.
#[test]
fn a_call_prints_its_settings_as_a_file() {
    let temp = folder();
    let at = temp.path();
    let set = ["--set", "optimizer=adam", "--set", "sequence=random", "--set", "refine.strategy.momentum=0.25"];
    let solve = [&["solve", "builtin:plane", "--engine", "cpu"], &SMALL[..]].concat();
    let printed = done(at, &[&solve[..], &set, &["--settings", "-"]].concat());
    std::fs::write(at.join("all.toml"), &printed).unwrap();
    assert!(!at.join("hologram.zarr").exists());
    let of = |more: &[&str]| json(at, &[&solve[..], more, &["--json", "-o", "h.zarr"]].concat())["settings"].clone();
    let (given, read) = (of(&set), of(&["--settings", "all.toml"]));
    assert_eq!(given["optimizer"]["kind"], "adam");
    assert_eq!(given, read);
    let table: toml::Table = printed.parse().unwrap();
    assert_eq!(table["refine"]["strategy"]["momentum"].as_float(), Some(0.25));
    let fast = done(at, &["solve", "builtin:plane", "--quality", "fast", "--settings", "-", "--engine", "cpu"]);
    assert_eq!(fast.parse::<toml::Table>().unwrap()["steps"].as_integer(), Some(40));
}

#[test]
fn every_command_with_settings_prints_them_and_writes_nothing() {
    let temp = folder();
    let at = temp.path();
    for command in [
        "solve builtin:plane --dry-run --engine cpu",
        "bench builtin:plane --engine cpu",
        "eval tune builtin:plane -o out",
        "refine h.zarr --pupil 0,0,4,0 -o out",
        "show h.zarr",
        "show h.zarr --tracker simulated",
        "eval gaze h.zarr -o out",
        "render h.zarr --path path.json -o out",
    ] {
        let words: Vec<&str> = command.split(' ').collect();
        let printed = done(at, &[&words[..], &["--set", "refine.pupils=5", "--settings", "-"]].concat());
        let table: toml::Table = printed.parse().unwrap_or_else(|e| panic!("{command}: {e}"));
        assert_eq!(table["refine"]["pupils"].as_integer(), Some(5), "{command}");
    }
    assert!(std::fs::read_dir(at).unwrap().next().is_none());
}

/// The tables that a command reads are printed with the defaults and with the given values.
#[test]
fn commands_print_their_tables() {
    let temp = folder();
    let at = temp.path();
    for (command, key, value) in [
        ("solve builtin:plane --dry-run --engine cpu", "tiles.passes", "2"),
        ("bench builtin:plane --engine cpu", "camera.settle", "0"),
        ("show h.zarr", "show.keep_phase", "true"),
        ("show h.zarr --tracker simulated", "camera.every", "5"),
        ("eval gaze h.zarr -o out", "gaze.fixation", "'250ms'"),
        ("eval tune builtin:plane -o out", "viewing.black", "1"),
        ("eval score h.zarr", "viewing.luminance", "100"),
        ("eval compare builtin:plane -o out", "compare.speckle", "false"),
        ("display calibrate small --camera true -o out.toml", "camera.pictures", "20"),
    ] {
        let words: Vec<&str> = command.split(' ').collect();
        let set = format!("{key}={value}");
        let printed = done(at, &[&words[..], &["--set", &set, "--settings", "-"]].concat());
        let printed: toml::Table = printed.parse().unwrap_or_else(|e| panic!("{command}: {e}"));
        let (table, key) = key.split_once('.').unwrap();
        let wanted: toml::Table = format!("{key} = {value}").parse().unwrap();
        assert_eq!(printed[table].get(key), wanted.get(key), "{command}: {printed}");
    }
    assert!(std::fs::read_dir(at).unwrap().next().is_none());
    let printed: toml::Table = done(at, &["eval", "gaze", "h.zarr", "-o", "out", "--settings", "-"]).parse().unwrap();
    assert_eq!(printed["gaze"]["tracker_delay"].as_integer(), Some(8));
}

#[test]
fn keys_of_tables_are_refused_by_name() {
    let temp = folder();
    let at = temp.path();
    for (command, set, code) in [
        ("eval gaze h.zarr -o x", "gaze.fixation=-1", "settings-value"),
        ("eval gaze h.zarr -o x", "gaze.fixation=3mm", "settings-value"),
        ("eval gaze h.zarr -o x", "gaze.content=flying", "settings-value"),
        ("eval gaze h.zarr -o x", "gaze.fixations=1", "no-such-setting"),
        ("show h.zarr", "show.keep_phase=1", "settings-value"),
        ("show h.zarr", "show.sync={ a = 1 }", "settings-value"),
        ("show h.zarr", "show.iris=0,0,6", "no-such-setting"),
        ("eval compare builtin:plane -o x", "compare.speckle=maybe", "settings-value"),
        ("eval compare builtin:plane -o x", "compare.etendue=5", "settings-value"),
        ("display calibrate small --camera true -o x.toml", "camera.iris=1,2", "settings-value"),
        ("solve builtin:plane --size 16x16 --engine cpu -o x.zarr", "tiles.passes=0", "settings-value"),
        ("solve builtin:plane --size 16x16 --engine cpu -o x.zarr", "viewing.luminance=-1", "settings-value"),
    ] {
        let words: Vec<&str> = command.split(' ').collect();
        let refusal = refusal(at, &[&words[..], &["--set", set]].concat());
        let (key, _) = set.split_once('=').unwrap();
        refusal.is(&format!("arguments/{code} {key}"));
        assert_eq!(refusal.fields["setting"], key, "{refusal:?}");
    }
    refused(at, &["show", "h.zarr", "--set", "show=1"], "x", "produce/job/value show");
    assert!(std::fs::read_dir(at).unwrap().next().is_none());
}

#[test]
fn options_come_before_single_settings_and_those_before_the_file() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("s.toml"), "steps = 5\nframes = 3\npupils = 7\ndiameter = ['2mm', '3mm']\n").unwrap();
    let solve = ["solve", "builtin:plane", "--size", "16", "--settings", "s.toml", "--set", "frames=4", "--steps", "6"];
    let settings = &json(at, &[&solve[..], &["--engine", "cpu", "--json", "-o", "h.zarr"]].concat())["settings"];
    assert_eq!([&settings["steps"], &settings["frames"], &settings["pupils"]], [6, 4, 7]);
    assert_eq!(settings["diameter"], serde_json::json!([2e-3, 3e-3]));
    refused(at, &[&solve[..], &["--set", "stpes=3"]].concat(), "x", "produce/job/no-such-setting stpes steps padding");
    refused(at, &[&solve[..], &["--set", "diameter=[2, '3s']"]].concat(), "x", "produce/job/other-dimension diameter");
}

/// An old script gets the new name.
#[test]
fn former_options_name_their_setting() {
    let temp = folder();
    let at = temp.path();
    for (words, setting) in [
        ("solve builtin:plane --optimizer adam", "optimizer"),
        ("-v solve builtin:plane --speckle=0.5", "contrast"),
        ("refine h.zarr --pupil 0,0,4,0 --settled-gain 2", "refine.strategy.settled"),
        ("show h.zarr --window 1", "refine.window"),
    ] {
        let words: Vec<&str> = words.split(' ').collect();
        refused(at, &words, "x", &format!("usage/unknown-argument --set {setting}=VALUE"));
    }
    let unknown = crate::common::eyebox(at, &["solve", "builtin:plane", "--nonsense"]);
    assert!(!text(&unknown.stderr).contains("--set"));
}
