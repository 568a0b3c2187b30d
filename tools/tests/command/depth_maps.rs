//! Pictures with depth maps. The tests cover the near end of a map and the map of each picture in a sequence.

use crate::common::{Printed, attributes, done, eyebox, folder, json, refused, text};
use std::path::Path;

const SMALL: [&str; 12] =
    ["--size", "40x48", "--views", "3", "--steps", "2", "--frames", "1", "--color", "green", "--engine", "cpu"];

/// Renders `a.png` and `b.png`, and the same two in green as their depth maps.
fn pictures(at: &Path) {
    for (name, scene) in [("a", "builtin:still-life"), ("b", "builtin:still-life?camera=5")] {
        let render = ["render", scene, "--size", "40x48", "--views", "3", "--pupil=0,0,2,0"];
        std::fs::create_dir_all(at.join("maps")).unwrap();
        done(at, &[&render[..], &["-o", &format!("{name}.png")]].concat());
        done(at, &[&render[..], &["--color", "green", "-o", &format!("maps/{name}.png")]].concat());
    }
}

#[test]
fn what_is_near_is_said_and_remembered() {
    let temp = folder();
    let at = temp.path();
    pictures(at);
    let solve = |out, more: &[&'static str]| [&["solve", "a.png", "-o", out][..], &SMALL, more].concat();
    let answer = eyebox(at, &solve("bright.zarr", &["--depth-map", "maps/a.png"]));
    let said = text(&answer.stderr);
    assert!(answer.status.success() && said.lines_with("maps/a.png bright") == 1, "{said}");
    done(at, &solve("dark.zarr", &["--depth-map", "maps/a.png", "--near", "dark"]));
    let score = |hologram, more: &[&'static str]| {
        let words =
            ["eval", "score", hologram, "a.png", "--depth-map", "maps/a.png", "--test-pupils", "random:4", "--json"];
        done(at, &[&words[..], more].concat())
    };
    let remembered = score("dark.zarr", &[]);
    assert_eq!(remembered, score("dark.zarr", &["--near", "dark"]));
    assert_ne!(remembered, score("dark.zarr", &["--near", "bright"]));
    assert_eq!(score("bright.zarr", &[]), score("bright.zarr", &["--near", "bright"]));

    let header = "{'descr': '|u1', 'fortran_order': False, 'shape': (40, 48), }";
    let mut npy = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    npy.extend(format!("{header:<117}\n").bytes());
    npy.extend((0..40 * 48).map(|i| (i % 48) as u8 + 1));
    // An array of 8 bits can be a picture from a network, or hold distances.
    for name in ["map.npy", "depth.npy"] {
        std::fs::write(at.join(name), &npy).unwrap();
        refused(at, &solve("x.zarr", &["--depth-map", name]), "x.zarr", "scene/ambiguous/values --near");
    }
}

#[test]
fn each_picture_of_a_sequence_has_its_own_map() {
    let temp = folder();
    let at = temp.path();
    pictures(at);
    let solve = |out, maps: &[&'static str]| {
        let mut words = [&["solve", "a.png", "b.png", "-o", out][..], &SMALL].concat();
        maps.iter().for_each(|map| words.extend(["--depth-map", *map]));
        words
    };
    refused(at, &solve("x.zarr", &["maps/a.png"]), "x.zarr", "scene/maps maps/a.png");
    refused(at, &solve("x.zarr", &["maps/a.png"; 3]), "x.zarr", "scene/maps");
    done(at, &solve("folder.zarr", &["maps"]));
    done(at, &solve("each.zarr", &["maps/a.png", "maps/b.png"]));
    done(at, &solve("same.zarr", &["maps/a.png", "maps/a.png"]));
    let second = |sequence: &str| {
        done(at, &["convert", sequence, "phases.npy", "--at", "1"]);
        std::fs::read(at.join("phases.npy")).unwrap()
    };
    let wanted = second("each.zarr");
    assert_eq!(second("folder.zarr"), wanted);
    assert_ne!(second("same.zarr"), wanted);
    // Different maps have the same ends, which each hologram stores, so the sequence is found complete again.
    let ends = |sequence: &str| {
        let settings = attributes(&at.join(sequence))["settings"].take();
        [0, 1].map(|i| settings["scenes"][i]["depth_map"]["options"].as_str().map(str::to_owned))
    };
    let [first, other] = ends("folder.zarr");
    assert!(first.as_ref().is_some_and(|ends| ends.starts_with("range=")) && first == other, "{first:?} {other:?}");
    assert_eq!(ends("each.zarr"), [first.clone(), first]);
    assert_eq!(ends("same.zarr"), [None, None]);
    done(at, &solve("folder.zarr", &["maps"]));
    let compare = |maps| {
        let words = [
            "eval",
            "compare",
            "a.png",
            "b.png",
            "-o",
            "report",
            "--depth-map",
            maps,
            "--methods",
            "dpac",
            "--set",
            "compare.speckle=false",
        ];
        [&words[..], &["--size", "40x48", "--views", "3", "--frames", "1", "--color", "green", "--engine", "cpu"]]
            .concat()
    };
    refused(at, &compare("maps/a.png"), "report/report.html", "scene/maps maps/a.png");
    done(at, &compare("maps"));
    std::fs::remove_file(at.join("maps/b.png")).unwrap();
    refused(at, &solve("x.zarr", &["maps"]), "x.zarr", "scene/maps b.png");
}

/// A deep picture gets enough views to show no dots out of focus, unless an option states another number.
#[test]
fn a_deep_map_gets_as_many_views_as_it_needs() {
    let temp = folder();
    let at = temp.path();
    pictures(at);
    let solve = |more: &[&'static str]| {
        let words =
            ["solve", "a.png", "--depth-map", "maps/a.png", "--near", "bright", "-o", "x.zarr", "--size", "40x48"];
        let short = ["--steps", "1", "--frames", "1", "--color", "green", "--engine", "cpu"];
        let answer = eyebox(at, &[&words[..], &short, more].concat());
        assert!(answer.status.success(), "{}", text(&answer.stderr));
        let views = attributes(&at.join("x.zarr"))["settings"]["views"].clone();
        (views, text(&answer.stderr))
    };
    let plan = |more: &[&'static str]| {
        let words = ["solve", "a.png", "--depth-map", "maps/a.png", "--near", "bright", "--size", "40x48", "--json"];
        json(at, &[&words[..], &["--dry-run", "--color", "green", "--engine", "cpu"], more].concat())["choices"].clone()
    };
    // The eyebox is 22 mm, and 1 mm of depth moves content by 6.9 pixels over it.
    let (views, said) = solve(&["--depth=-1..1"]);
    assert!(views == serde_json::json!([14, 14]) && said.has_sequence(&[14.0, 14.0]), "{views}: {said}");
    let (views, said) = solve(&["--depth=-0.5..0.5"]);
    assert!(views == serde_json::json!([9, 9]) && !said.has_sequence(&[14.0, 14.0]), "{views}: {said}");
    // The text has the number of views that would be enough.
    let remedy = |choices: &serde_json::Value| {
        let of = choices.as_array().expect("a list").iter().find(|c| c["what"] == "aliasing");
        of.is_some_and(|c| c["why"].as_str().expect("a text").has_sequence(&[13.0, 13.0]))
    };
    let few = ["--depth=-1..1", "--views", "5"];
    assert!(solve(&few).1.has_sequence(&[13.0, 13.0]) && remedy(&plan(&few)), "{}", plan(&few));
    assert!(!remedy(&plan(&["--depth=-1..1"])));
    // A narrow pupil covers few views and separates them little.
    let narrow = [&few[..], &["--pupil-diameter", "2..4"]].concat();
    assert!(!solve(&narrow).1.has_sequence(&[13.0, 13.0]) && !remedy(&plan(&narrow)), "{}", plan(&narrow));
}
