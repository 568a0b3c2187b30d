//! Dioptres and degrees next to millimeters, the diffraction limit of scores, and mistakes that are refused.

use crate::common::{Printed, done, folder, refused};
use eyebox::low_level::hologram::Hologram;
use serde_json::Value;
use std::path::Path;

fn json(at: &Path, args: &[&str]) -> Value {
    serde_json::from_str(&done(at, args)).expect("one JSON object")
}

/// Returns both ends of a range.
fn ends(of: &Value) -> [f64; 2] {
    [0, 1].map(|i| of[i].as_f64().expect("a number"))
}

#[test]
fn depths_and_displays_are_said_in_people_s_units() {
    let temp = folder();
    let at = temp.path();
    // No option states the depth of the still life.
    let solve = ["solve", "builtin:still-life", "--size", "512x512", "--color", "green", "--views", "3"];
    let plan = json(at, &[&solve[..], &["--dry-run", "--json"]].concat());
    let ([far, near], [least, most]) = (ends(&plan["depth_mm"]), ends(&plan["depth_dioptres"]));
    assert!((0.035..0.045).contains(&(most - least)), "{least} to {most} D");
    assert!((least - far / 160.0).abs() < 1e-9 && (most - near / 160.0).abs() < 1e-9, "f is 400 mm");
    assert!((plan["reach"]["pixels_per_degree"].as_f64().unwrap() - 872.66).abs() < 0.01, "{plan}");
    let reach = &json(at, &["display", "check", "paper", "--json"])["reach"];
    let degrees = ends(&reach["field_of_view_degrees"]);
    assert!((degrees[0] - 1.2377).abs() < 1e-3 && (degrees[1] - 2.2003).abs() < 1e-3, "{degrees:?}");
    assert!((reach["eyebox_mm"].as_f64().unwrap() - 22.0).abs() < 1e-9);
    assert!((reach["eyebox_mm_by_color"]["red"].as_f64().unwrap() - 33.0).abs() < 1e-9);
    let said = done(at, &["display", "check", "paper"]);
    let line = said.lines().find(|l| l.has("paper")).expect("a line on the display");
    assert!(line.has("1080 1920 2.2 873 22 mm -157.1 157.1 -0.98 0.98 D"), "{line}");
    let devices = json(at, &["display", "check", "far-field", "--json"]);
    assert!((devices["reach"]["eyebox_mm"].as_f64().unwrap() - 4.096).abs() < 1e-9);
}

#[test]
fn dioptres_are_taken_where_millimetres_are() {
    let temp = folder();
    let at = temp.path();
    let small = ["--size", "48x48", "--color", "green", "--views", "3"];
    let solve = |depth: &str, out: &str| {
        let args = ["solve", "builtin:plane", depth, "--frames", "1", "--steps", "2", "--json", "-o", out];
        json(at, &[&args[..], &small].concat())
    };
    // f^2 is 160 mm per dioptre.
    let solved = solve("--depth=-0.01D..0.02D", "d.zarr");
    solve("--depth=-1.6..3.2", "mm.zarr");
    let phases = |name: &str| Hologram::load(&at.join(name)).unwrap().colors.remove(0).phases;
    assert_eq!(phases("d.zarr"), phases("mm.zarr"));
    let (mm, dioptres) = (ends(&solved["depth_mm"]), ends(&solved["depth_dioptres"]));
    assert!((mm[0] + 1.6).abs() < 1e-9 && (mm[1] - 3.2).abs() < 1e-9, "{mm:?}");
    assert!((dioptres[0] + 0.01).abs() < 1e-12 && (dioptres[1] - 0.02).abs() < 1e-12, "{dioptres:?}");
    let picture = |command: &[&str], pupil: &str, out: &str| {
        done(at, &[command, &[pupil, "-o", out]].concat());
        std::fs::read(at.join(out)).unwrap()
    };
    let target = [&["render", "builtin:plane"][..], &small].concat();
    for command in [&["render", "d.zarr"][..], &target] {
        let in_mm = picture(command, "--pupil=1,2,4,1.6", "mm.npy");
        assert_eq!(in_mm, picture(command, "--pupil=1,2,4,0.01D", "d.npy"));
        assert_ne!(in_mm, picture(command, "--pupil=1,2,4,0", "0.npy"));
    }
    std::fs::write(at.join("pupils.json"), r#"[[1, 2, 4, 1.6], [1, 2, 4, "0.01D"]]"#).unwrap();
    let scored = json(at, &["eval", "score", "d.zarr", "builtin:plane", "--test-pupils", "pupils.json", "--json"]);
    let [first, second] = [&scored["pupils"][0], &scored["pupils"][1]];
    assert_eq!(first["psnr_db"], second["psnr_db"]);
    assert!((first["focus_dioptres"].as_f64().unwrap() - 0.01).abs() < 1e-9);
    let judged = ["refine", "d.zarr", "builtin:plane", "--pupil=1,2,4,0.01D", "--steps", "1", "--json"];
    let refined = json(at, &judged);
    assert!((refined["focus_mm"].as_f64().unwrap() - 1.6).abs() < 1e-9);
    assert!((refined["focus_dioptres"].as_f64().unwrap() - 0.01).abs() < 1e-9);
    refused(
        at,
        &["render", "d.zarr", "--pupil=1,2,4,1.6 s", "-o", "x.png"],
        "x.png",
        "usage/value-validation/other-dimension 0.5D",
    );
    let in_meters = picture(&["render", "d.zarr"], "--pupil=1mm,0.2cm,4,100m", "m.npy");
    assert_eq!(in_meters, picture(&["render", "d.zarr"], "--pupil=1,2,4,0.01D", "d.npy"));
}

#[test]
fn scores_stand_beside_what_diffraction_leaves() {
    let temp = folder();
    let at = temp.path();
    let small = ["--size", "64x64", "--color", "green", "--frames", "2", "--steps", "4", "--views", "3"];
    done(at, &[&["solve", "builtin:chart", "-o", "c.zarr"][..], &small].concat());
    std::fs::write(at.join("pupils.json"), "[[0, 0, 2, 0], [3, -2, 4, 0], [0, 0, 20, 0]]").unwrap();
    let scored = json(at, &["eval", "score", "c.zarr", "builtin:chart", "--test-pupils", "pupils.json", "--json"]);
    let pupils = scored["pupils"].as_array().unwrap();
    let number = |i: usize, key: &str| pupils[i][key].as_f64();
    let (narrow, usual) = (number(0, "ceiling_db").unwrap(), number(1, "ceiling_db").unwrap());
    assert!(narrow < usual, "a wider pupil shows more: {narrow}, {usual}");
    assert!((0..2).all(|i| number(i, "psnr_db") <= number(i, "ceiling_db")), "{pupils:?}");
    // The widest pupil passes the difference of any two frequencies, so that diffraction has no effect.
    assert!(pupils[2]["ceiling_db"].is_null(), "{pupils:?}");
    assert!((number(1, "finest_cycles_per_degree").unwrap() - 134.26).abs() < 0.1, "4 mm of green");
    let table = done(at, &["eval", "score", "c.zarr", "builtin:chart", "--test-pupils", "pupils.json"]);
    // The row of the widest pupil has one number fewer.
    let rows: Vec<&str> = table.lines().filter(|l| l.numbers().len() > 6 && !l.contains(':')).collect();
    assert!(rows.len() == 3 && rows[0].has(&format!("{narrow:.2}")) && rows[1].has(&format!("{usual:.2}")), "{table}");
    assert_eq!(rows[2].numbers().len() + 1, rows[0].numbers().len(), "{table}");
}

#[test]
fn what_is_most_likely_a_mistake_is_refused_and_taken_with_force() {
    let temp = folder();
    let at = temp.path();
    let render = |more: &[&'static str]| {
        [&["render", "builtin:plane", "--color", "green", "--views", "1", "-o", "x.png"][..], more].concat()
    };
    let small = ["--size", "40x48"];
    let file = |name: &str, size: &str, pitch: &str, focal_length: &str, colors: &str| {
        let rest = format!("pitch_um = {pitch}\nfocal_length_mm = {focal_length}\nwavelengths_nm = {{ {colors} }}\n");
        std::fs::write(at.join(name), format!("resolution = {size}\n{rest}")).unwrap();
    };
    file("upright.toml", "[60, 40]", "8.0", "400", "green = 520");
    file("pitch.toml", "[40, 60]", "0.008", "400", "green = 520");
    file("focal.toml", "[40, 60]", "8.0", "0.4", "green = 520");
    file("nm.toml", "[40, 60]", "8.0", "400", "green = 52000");
    file("um.toml", "[40, 60]", "8.0", "400", "green = 0.52");
    file("colors.toml", "[40, 60]", "8.0", "400", "red = 440, green = 520, blue = 660");
    let pupil = ["--pupil=0,0,4,0"];
    let with = |parts: &[&[&'static str]]| render(&parts.concat());
    let mistakes = [
        (with(&[&small, &["--pupil=0,0,0.004,0"]]), "arguments/unusual 0.004 4 --force"),
        (with(&[&small, &["--pupil=0,0,30,0"]]), "arguments/unusual 30 26.00 --force"),
        (with(&[&small, &["--pupil=14,0,4,0"]]), "arguments/outside-eyebox 13.00 --force"),
        (with(&[&["--size", "60x40"], &pupil]), "arguments/unusual 60 40x60 --force"),
        (with(&[&["--display", "upright.toml"], &pupil]), "arguments/unusual 60 portrait --force"),
        (with(&[&["--display", "pitch.toml"], &pupil]), "arguments/unusual 0.008 8 --force"),
        (with(&[&["--display", "focal.toml"], &pupil]), "arguments/unusual 0.4 400 --force"),
        (with(&[&["--display", "nm.toml"], &pupil]), "arguments/unusual 52000 380 1100 --force"),
        (with(&[&["--display", "colors.toml"], &pupil]), "arguments/unusual 440 520 --force"),
    ];
    for (i, (args, what)) in mistakes.iter().enumerate() {
        refused(at, args, "x.png", what);
        // Some optics are unlike any display and show nothing. For those, the check is enough.
        if i < 5 || i == 8 {
            done(at, &[&args[..], &["--force"]].concat());
            std::fs::remove_file(at.join("x.png")).unwrap();
        }
    }
    // Impossible numbers are refused even with `--force`, and the line has the probable value.
    refused(
        at,
        &with(&[&["--display", "um.toml", "--force"], &pupil]),
        "x.png",
        "optics/display-file/out-of-range 520",
    );
    // A file with `portrait = true` is accepted.
    let upright = std::fs::read_to_string(at.join("upright.toml")).unwrap();
    std::fs::write(at.join("upright.toml"), format!("portrait = true\n{upright}")).unwrap();
    done(at, &with(&[&["--display", "upright.toml"], &pupil]));
    // Every command that computes makes the same check.
    let scene = "builtin:plane";
    let out = &["-o", "y.zarr"][..];
    for (command, more) in [
        (&["solve"][..], out),
        (&["solve"], &["--dry-run"]),
        (&["eval", "tune"], out),
        (&["eval", "compare"], out),
        (&["eval", "gaze"], out),
        (&["bench"], &[]),
        (&["show"], &[]),
        (&["show"], &["--tracker", "simulated"]),
    ] {
        refused(at, &[command, &[scene, "--size", "60x40"], more].concat(), "y.zarr", "arguments/unusual 40x60");
    }
    refused(at, &["solve", scene, "--pupil-diameter", "0.002..0.02", "-o", "y.zarr"], "y.zarr", "arguments/unusual");
    refused(at, &["solve", scene, "--pupil-diameter", "2..60", "-o", "y.zarr"], "y.zarr", "arguments/unusual 60");
    refused(at, &["display", "check", "pitch.toml"], "x", "arguments/unusual");
    let phases = ["convert", "h.zarr", "h.npy"];
    done(at, &["solve", scene, "--size", "40x48", "--color", "green", "--views", "1", "--steps", "1", "-o", "h.zarr"]);
    done(at, &phases);
    for (pitch, wavelength, focal_length, what) in [
        ("0.008", "520", "400", "arguments/unusual 8"),
        ("8", "520", "0.4", "arguments/unusual 400"),
        ("8", "52000", "400", "arguments/unusual"),
    ] {
        let optics = ["--pitch", pitch, "--wavelength", wavelength, "--focal-length", focal_length];
        refused(at, &[&["render", "h.npy", "--pupil=0,0,4,0", "-o", "v.png"][..], &optics].concat(), "v.png", what);
    }
    for args in [
        &["render", "h.zarr", "--pupil=0,0,0.004,0", "-o", "v.png"][..],
        &["refine", "h.zarr", scene, "--pupil=0,0,0.004,0"],
    ] {
        refused(at, args, "v.png", "arguments/unusual");
    }
    std::fs::write(at.join("p.json"), "[[0, 0, 0.004, 0]]").unwrap();
    refused(at, &["eval", "score", "h.zarr", scene, "--test-pupils", "p.json"], "x", "arguments/unusual");
    refused(
        at,
        &["encode", "h.npy", "--display", "paper", "--size", "60x40", "--color", "green", "-o", "f"],
        "f",
        "arguments/unusual 40x60",
    );
    refused(at, &["show", "h.zarr", "--size", "60x40"], "x", "arguments/unusual 40x60");
}
