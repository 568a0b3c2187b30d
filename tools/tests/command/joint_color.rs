//! Simultaneous color, from the command line to the picture, the video frames and the report.

use crate::common::{Printed, document, done, figures_of, folder, refused};
use eyebox::low_level::files::read_npy;
use std::path::Path;

const SCENE: &str = "builtin:still-life";

/// A hologram stores the powers of its lasers, and its views use them. Its video frames are drive values with a table
/// of the powers, and the frames can be viewed with this table.
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
        done(at, &[&["render", hologram][..], &pupil, &[out], more].concat());
        read_npy(&at.join(out)).unwrap().values
    };
    let whole = view("joint.zarr", "whole.npy", &[]);
    let score = ["eval", "score", "joint.zarr", SCENE, "--views", "3", "--json", "--jod", "none", "--engine", "cpu"];
    let scored: serde_json::Value = serde_json::from_str(&done(at, &score)).unwrap();
    assert!(scored["psnr_db"]["mean"].as_f64().unwrap() > 14.0, "{scored}");

    // Each sub-frame has one gray picture for all colors and one line of powers.
    done(at, &[&["encode", "joint.zarr", "-o", "frames", "--engine", "cpu"][..], &display].concat());
    let table = std::fs::read_to_string(at.join("frames/powers.csv")).unwrap();
    assert!(table.starts_with("sub_frame,red,green,blue\n0,") && table.lines().count() == 7, "{table}");
    let column =
        |i: usize| table.lines().skip(1).map(move |line| line.split(',').nth(i).unwrap().parse::<f64>().unwrap());
    let power =
        |i: usize, f: usize| said["joint_color"]["lasers"][["red", "green", "blue"][i]]["powers"][f].as_f64().unwrap();
    let largest = (0..18).map(|k| power(k / 6, k % 6)).fold(0.0, f64::max);
    for (i, told) in (0..3).flat_map(|i| column(i + 1).enumerate().map(move |(f, told)| ((i, f), told))) {
        assert!((told - power(i.0, i.1) / largest).abs() < 1e-5, "{i:?}: {told}, {table}");
    }
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
    // A drive value of nearly one turn becomes level 0, with an error of half a level in 256. The other colors of those
    // pixels jump.
    assert!(again.len() == whole.len() && error < 2e-2 * signal, "256 levels leave {error} of {signal}");
}

/// Solves the still life in simultaneous color.
fn solved(at: &Path, frames: &str) {
    let solve =
        ["solve", SCENE, "--views", "3", "--steps", "12", "--frames", frames, "--engine", "cpu", "--joint-color"];
    done(at, &[&solve[..], &["--display", "grey8", "--size", "48x64", "-o", "joint.zarr"]].concat());
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).expect("one JSON object")
}

/// All colors are refined together for the tracked pupil in the light of the same lasers. The file is like a file of
/// `solve`.
#[test]
fn it_is_refined_for_where_the_eye_is() {
    let dir = folder();
    let at = dir.path();
    solved(at, "6");
    let refine = |file: &str, more: &[&str]| {
        let fixed = ["refine", file, SCENE, "--views", "3", "--pupil=3,-2,4,0", "--engine", "cpu", "--json"];
        json(&done(at, &[&fixed[..], more].concat()))
    };
    let said = refine("joint.zarr", &["--steps", "9", "-o", "there.zarr"]);
    let rows = said["rows"].as_array().unwrap();
    let steps: Vec<u64> = rows.iter().map(|r| r["steps"].as_u64().unwrap()).collect();
    assert_eq!(steps, [0, 1, 2, 4, 8, 9]);
    let db = |i: usize, what: &str| rows[i][what].as_f64().unwrap();
    assert!(db(5, "eye_db") > db(0, "eye_db") + 1.0 && db(5, "eyebox_db") > db(0, "eyebox_db") - 1.0, "{said}");
    // The file has the refined hologram, and its exposure is fitted again.
    let again = refine("there.zarr", &["--steps", "1"])["rows"][0]["eye_db"].as_f64().unwrap();
    assert!((again - db(5, "eye_db")).abs() < 0.7, "{again} dB, {} before it was written", db(5, "eye_db"));
    // The lasers stay as they are, and the drive values change.
    for name in ["joint", "there"] {
        let encode = ["encode", &format!("{name}.zarr"), "-o", name, "--display", "grey8", "--size", "48x64"];
        done(at, &[&encode[..], &["--engine", "cpu"]].concat());
    }
    let powers = |name: &str| std::fs::read_to_string(at.join(name).join("powers.csv")).unwrap();
    assert_eq!(powers("joint"), powers("there"));
    let adam = refine("joint.zarr", &["--steps", "4", "--set", "refine.strategy=adam"]);
    assert_eq!(adam["steering"]["strategy"]["kind"], "adam");
    let eye = &["refine", "joint.zarr", SCENE, "--views", "3", "--pupil=3,-2,4,0", "--engine", "cpu", "-o", "x.zarr"];
    refused(at, &[&eye[..], &["--set", "refine.storage=fp16"]].concat(), "x.zarr", "solve/setting fp32");
}

/// The hologram is shown as it was solved, and it is refined for a simulated eye in whole sets or with the rolling
/// update. The recordings have the video frames of the drive values and the powers of the lasers. A second run is
/// identical.
#[test]
fn it_is_shown_and_follows_the_eye() {
    let dir = folder();
    let at = dir.path();
    solved(at, "6");
    let display = ["--display", "grey8", "--size", "48x64", "--engine", "cpu"];
    done(at, &[&["encode", "joint.zarr", "-o", "frames"][..], &display].concat());
    let powers = |folder: &str| std::fs::read_to_string(at.join(folder).join("powers.csv")).unwrap();
    let picture = |folder: &str, set: u32, frame: u32| {
        std::fs::read(at.join(format!("{folder}/set-{set:06}-{frame:02}.png"))).expect("a picture")
    };
    let brief = ["--clock", "simulated", "--duration", "0.4", "--record"];
    done(at, &[&["show", "joint.zarr", "--stats", "played.json"][..], &brief, &["played"], &display].concat());
    let played = json(&std::fs::read_to_string(at.join("played.json")).unwrap());
    assert!(powers("played") == powers("frames") && played["joint_color"]["lasers"]["blue"].is_object(), "{played}");
    let eye = ["--tracker", "simulated", "--set", "show.step_time=1", "--views", "3"];
    for (name, more) in
        [("rolls", &[][..]), ("again", &[]), ("whole", &["--set", "show.whole_sets=true"]), ("still", &["--unsteered"])]
    {
        let stats = format!("{name}.json");
        let show = ["show", "joint.zarr", "--stats", &stats];
        done(at, &[&show[..], &brief, &[name], &eye, &display, more].concat());
        let said = json(&std::fs::read_to_string(at.join(&stats)).unwrap());
        let steps = said["steps"].as_u64().unwrap();
        assert_eq!((steps > 20, steps % 3), (name != "still", 0), "a step is one step of each color: {said}");
        assert_eq!(powers(name), powers("frames"), "{name}");
    }
    let all = |folder: &str| {
        let mut files: Vec<_> = std::fs::read_dir(at.join(folder))
            .unwrap()
            .map(|e| e.unwrap().path())
            .map(|file| (file.file_name().unwrap().to_owned(), std::fs::read(&file).unwrap()))
            .collect();
        files.sort();
        files
    };
    assert!(all("rolls") == all("again"));
    // The static show has the hologram for the whole eyebox, with one picture per sub-frame. The refined show has other
    // pictures.
    let differs =
        |folder: &str, set: u32| (0..6).filter(|f| picture(folder, set, *f) != picture("played", 0, *f)).count();
    assert_eq!((differs("still", 1), differs("whole", 3)), (0, 6));
    assert!(all("rolls").len() > 20);
}

/// The study has the gain of the refinement for a simulated eye and for content that moves.
#[test]
fn a_study_says_what_steering_gains() {
    let dir = folder();
    let at = dir.path();
    solved(at, "6");
    let study = ["eval", "gaze", "joint.zarr", "--display", "grey8", "--views", "3", "--engine", "cpu", "--json"];
    let eye = ["--duration", "1", "--set", "gaze.step_time=1", "--jod", "none", "-o", "out"];
    let said = json(&done(at, &[&study[..], &eye].concat()));
    let gain = said["summary"]["end_of_fixation_db"]["mean"].as_f64().unwrap();
    let steps = said["summary"]["steps"].as_u64().unwrap();
    assert!(gain > 0.5 && steps.is_multiple_of(3), "{said}");
    let content = [
        "--set",
        "gaze.content=still,moving",
        "--set",
        "gaze.sets=12",
        "--set",
        "gaze.steps_per_set=2",
        "--set",
        "gaze.moves=4",
    ];
    let eye = ["--set", "gaze.fixation=100000", "--set", "gaze.tracker_noise=0.02", "-o", "moving"];
    let said = json(&done(at, &[&study[..], &content, &eye].concat()));
    let mean = |content: &str, eye: &str, steered: bool| {
        let is = |run: &&serde_json::Value| {
            run["content"] == content && run["eye"] == eye && run["steered"] == steered && run["moments"] == true
        };
        said["summary"].as_array().unwrap().iter().find(is).unwrap()["mean_db"].as_f64().unwrap()
    };
    let gain = |content: &str, eye: &str| mean(content, eye, true) - mean(content, eye, false);
    assert!(gain("still", "rests") > 2.0 && gain("moving", "follows") > 2.0, "{said}");
    let jumps = [
        "--set",
        "gaze.content=jumping",
        "--set",
        "gaze.sets=4",
        "--set",
        "gaze.jumps_every=2",
        "--set",
        "gaze.steps_per_set=1",
    ];
    let second = |from: &str| {
        let said =
            json(&done(at, &[&study[..], &jumps, &["--set", &format!("gaze.jumps_from={from}"), "-o", from]].concat()));
        said["summary"][2]["after_jumps_db"][1].as_f64().unwrap()
    };
    // This SLM is too small for a table, so that the solve continues from the last drive values.
    let [last, random] = ["table", "random"].map(second);
    assert!(last > random + 2.0, "{last} {random}");
}

#[test]
fn what_cannot_be_is_refused_in_a_line() {
    let dir = folder();
    let at = dir.path();
    let solve = ["solve", SCENE, "--views", "3", "--steps", "1", "--frames", "3", "--engine", "cpu", "-o", "out.zarr"];
    let small = ["--display", "small", "--size", "48x64"];
    for (more, says) in [
        (&["--joint-color=4"][..], "produce/job/brightness"),
        (&["--joint-color=0.5"], "solve/setting 0.5"),
        (&["--joint-color", "--method", "dpac"], "solve/setting"),
        (&["--joint-color", "--set", "levels=2"], "solve/setting"),
    ] {
        refused(at, &[&solve[..], &small, more].concat(), "out.zarr", says);
    }
    let bench = "resolution = [48, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { red = 660, green = 520, blue = 440 }\n";
    for (more, says) in [
        ("dispersion = { blue = -1.5 }\n", "optics/display-file/dispersion -1.5"),
        ("dispersion = { red = 1.5 }\n", "optics/display-file/dispersion-whole 1.5"),
    ] {
        std::fs::write(at.join("bad.toml"), format!("{bench}{more}")).unwrap();
        refused(at, &[&solve[..], &["--joint-color", "--display", "bad.toml"]].concat(), "out.zarr", says);
    }
    // A file with impossible powers gives no picture.
    done(at, &[&solve[..11], &["joint.zarr", "--joint-color"], &small[..]].concat());
    let file = at.join("joint.zarr/zarr.json");
    let mut document: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    document["attributes"].as_object_mut().unwrap().remove("document_crc32c");
    document["attributes"]["eyebox"].as_object_mut().unwrap().remove("version");
    document["attributes"]["eyebox"]["settings"]["joint_color"]["lasers"]["red"]["powers"][0] = (-1.0).into();
    std::fs::write(&file, document.to_string()).unwrap();
    let render = ["render", "joint.zarr", "--pupil=0,0,6,0", "--engine", "cpu", "-o", "out.npy"];
    refused(at, &render, "out.npy", "hologram/not-a-hologram/power -1 red");
}

/// The report compares simultaneous color with one color after another, at the same number of sub-frames with the same
/// lasers. It has a section with a picture, and a table.
#[test]
fn the_report_compares_it_with_one_colour_after_another() {
    let dir = folder();
    let at = dir.path();
    let line = [
        "eval",
        "compare",
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
        "--set",
        "compare.speckle=false",
        "--jod",
        "none",
        "--engine",
        "cpu",
        "-o",
        "report",
    ];
    let said = done(at, &line);
    // The ways are one color after another, simultaneous color at one and three times the brightness, and undimmed
    // lasers. Each way has three and six sub-frames.
    let rows = document(&at.join("report/report.json"))["joint"].clone();
    let rows: Vec<[f64; 2]> = rows
        .as_array()
        .unwrap()
        .iter()
        .map(|r| [&r["frames"], &r["brightness"]].map(|v| v.as_f64().unwrap()))
        .collect();
    assert_eq!(rows.len(), 8, "{rows:?}");
    for [frames, brightness] in [[3.0, 1.0], [3.0, 3.0], [6.0, 1.0], [6.0, 3.0]] {
        let of = |row: &&[f64; 2]| row[0] == frames && (row[1] - brightness).abs() < 1e-3;
        assert!(rows.iter().any(|row| of(&row)), "{frames} {brightness}: {rows:?}");
        assert!(said.lines_with(&format!("{frames} {brightness}")) > 0, "{frames} {brightness}: {said}");
    }
    let page = std::fs::read_to_string(at.join("report/report.html")).unwrap();
    assert!(page.contains("id=\"joint\"") && page.contains("data:image/jpeg"), "{page}");
    figures_of(&at.join("report"), "report.html");
    let table = std::fs::read_to_string(at.join("report/joint-color.csv")).unwrap();
    let brightness = table.lines().skip(1).map(|line| line.split(',').nth(3).unwrap().parse::<f64>().unwrap());
    assert!(table.lines().count() == 9 && brightness.into_iter().any(|b| b == 1.0), "{table}");
    // The second run solves no hologram again.
    assert_eq!(done(at, &line), said);
    refused(
        at,
        &["eval", "compare", "builtin:plane", "--joint-color=4", "-o", "other"],
        "other/report.html",
        "arguments/joint-color --joint-color",
    );
}
