//! All colours at once, from the command line to the picture, the video frames and the report.

use crate::common::{done, eyebox, figures_of, folder, refused, text};
use eyebox::files::read_npy;

const SCENE: &str = "builtin:still-life";

/// A hologram keeps its lasers, is seen by them, and is encoded as drives with a table of their powers, from which it is seen again.
#[test]
fn a_hologram_of_all_colours_at_once() {
    let dir = folder();
    let at = dir.path();
    let display = ["--display", "small", "--size", "48x64"];
    let solve = ["solve", SCENE, "--views", "3", "--steps", "9", "--frames", "6", "--engine", "cpu", "--json"];
    let all = |more: &[&str]| done(at, &[&solve[..], &display, more].concat());
    let said: serde_json::Value = serde_json::from_str(&all(&["--joint-color", "-o", "joint.zarr"])).unwrap();
    let powers = said["joint_color"]["lasers"]["blue"]["powers"].as_array().unwrap();
    assert!(powers.len() == 6 && powers.iter().any(|p| (p.as_f64().unwrap() - 1.0).abs() > 0.01), "{powers:?}");
    let bright: serde_json::Value = serde_json::from_str(&all(&["--joint-color=3", "-o", "bright.zarr"])).unwrap();
    assert!((bright["brightness"].as_f64().unwrap() - 3.0).abs() < 1e-9, "{bright}");

    let pupil = ["--pupil", "1,-1,6,0", "--engine", "cpu", "-o"];
    let view = |hologram: &str, out: &str, more: &[&str]| {
        done(at, &[&["view", hologram][..], &pupil, &[out], more].concat());
        read_npy(&at.join(out)).unwrap().values
    };
    let whole = view("joint.zarr", "whole.npy", &[]);
    let score = ["score", "joint.zarr", SCENE, "--views", "3", "--json", "--no-jod", "--engine", "cpu"];
    let scored: serde_json::Value = serde_json::from_str(&done(at, &score)).unwrap();
    assert!(scored["psnr_db"]["mean"].as_f64().unwrap() > 14.0, "{scored}");

    // One grey picture a sub-frame for all colours, and a line of powers.
    done(at, &[&["encode", "joint.zarr", "-o", "frames", "--engine", "cpu"][..], &display].concat());
    let table = std::fs::read_to_string(at.join("frames/powers.csv")).unwrap();
    assert!(table.starts_with("sub_frame,red,green,blue\n0,") && table.lines().count() == 7, "{table}");
    assert_eq!(
        std::fs::read_dir(at.join("frames"))
            .unwrap()
            .filter(|e| e.as_ref().unwrap().file_name().to_string_lossy().ends_with(".png"))
            .count(),
        6
    );
    let again = view("frames", "again.npy", &[]);
    let error = whole.iter().zip(&again).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
    let signal = whole.iter().map(|a| f64::from(*a).powi(2)).sum::<f64>();
    // A drive of nearly a turn becomes level 0, by half a level in 256: the other colours of those pixels jump.
    assert!(again.len() == whole.len() && error < 2e-2 * signal, "256 levels leave {error} of {signal}");

    // What would move its phases colour by colour refuses it.
    let refine = ["refine", "joint.zarr", SCENE, "--views", "3", "--pupil=1,-1,4,0", "--steps", "2", "--engine", "cpu"];
    refused(at, &[&refine[..], &["-o", "refined.zarr"]].concat(), "refined.zarr", "it shows all colours at once");
}

#[test]
fn what_cannot_be_is_refused_in_a_line() {
    let dir = folder();
    let at = dir.path();
    let solve = ["solve", SCENE, "--views", "3", "--steps", "1", "--frames", "3", "--engine", "cpu", "-o", "out.zarr"];
    let small = ["--display", "small", "--size", "48x64"];
    for (more, says) in [
        (&["--joint-color=4"][..], "the brightness of joint colours is 4"),
        (&["--joint-color=0.5"], "the brightness of joint colours is 0.5"),
        (&["--joint-color", "--method", "dpac"], "the method is dpac"),
        (&["--joint-color", "--levels", "2"], "the choice of phase levels"),
    ] {
        refused(at, &[&solve[..], &small, more].concat(), "out.zarr", says);
    }
    let bench = "resolution = [48, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { red = 660, green = 520, blue = 440 }\n";
    for (more, says) in [
        ("dispersion = { blue = -1.5 }\n", "dispersion of blue is -1.5"),
        ("dispersion = { red = 1.5 }\n", "dispersion of red is 1.5"),
    ] {
        std::fs::write(at.join("bad.toml"), format!("{bench}{more}")).unwrap();
        refused(at, &[&solve[..], &["--joint-color", "--display", "bad.toml"]].concat(), "out.zarr", says);
    }
    // A file whose powers cannot be: no picture of it.
    done(at, &[&solve[..11], &["joint.zarr", "--joint-color"], &small[..]].concat());
    let file = at.join("joint.zarr/zarr.json");
    let mut document: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    document["attributes"].as_object_mut().unwrap().remove("document_crc32c");
    document["attributes"]["eyebox"].as_object_mut().unwrap().remove("version");
    document["attributes"]["eyebox"]["settings"]["joint_color"]["lasers"]["red"]["powers"][0] = (-1.0).into();
    std::fs::write(&file, document.to_string()).unwrap();
    let answer = eyebox(at, &["view", "joint.zarr", "--pupil=0,0,6,0", "--engine", "cpu", "-o", "out.npy"]);
    let said = text(&answer.stderr);
    assert!(
        !answer.status.success() && said.trim().lines().count() == 1 && said.contains("the power -1 of red"),
        "{said}"
    );
}

/// The same number of sub-frames, the same lasers: a section of the report with its picture, and a table.
#[test]
fn the_report_compares_it_with_one_colour_after_another() {
    let dir = folder();
    let at = dir.path();
    let line = [
        "evaluate",
        "builtin:plane",
        "--joint-color=1,3",
        "--frames",
        "3,6",
        "--views",
        "3",
        "--steps",
        "4",
        "--display",
        "small",
        "--size",
        "48x64",
        "--no-speckle",
        "--no-jod",
        "--engine",
        "cpu",
        "-o",
        "report",
    ];
    let said = done(at, &line);
    assert!(said.contains("6 sub-frames, all at once, 3 times as bright"), "{said}");
    let page = std::fs::read_to_string(at.join("report/report.html")).unwrap();
    assert!(page.contains("All colours at once") && page.contains("data:image/jpeg"), "{page}");
    figures_of(&at.join("report"), "report.html");
    let table = std::fs::read_to_string(at.join("report/joint-color.csv")).unwrap();
    assert!(table.lines().count() == 9 && table.contains("one colour after another,1.0000"), "{table}");
    // Nothing is solved again.
    assert_eq!(done(at, &line), said);
    refused(
        at,
        &["evaluate", "builtin:plane", "--joint-color=4", "-o", "other"],
        "other/report.html",
        "--joint-color 4",
    );
}
