//! `eyebox display calibrate` with a simulated bench, from the patterns to the display file, and with other kinds of
//! benches.

use crate::common::{self, Printed, Refusal, notes, refusal_of, text, with_json_errors};
use crate::simulated;
use eyebox::low_level::optics::{Color, Display, Picture, PictureWarp};
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const DISPLAY: &str =
    "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";

/// Serves as the camera command of the other tests, in a process of its own. It is not a test itself.
#[test]
#[ignore = "the camera command of other tests"]
fn camera() {
    simulated::serve();
}

/// Returns the calibration of a bench in `at`. `bench` sets its faults in the environment.
fn calibrate(at: &Path, more: &[&str], bench: &[(&str, &str)]) -> Command {
    fs::write(at.join("bench.toml"), DISPLAY).expect("a display");
    calibrate_display(at, "bench.toml", more, bench)
}

/// Returns the calibration of this display file.
fn calibrate_display(at: &Path, display: &str, more: &[&str], bench: &[(&str, &str)]) -> Command {
    let exe = std::env::current_exe().expect("this program");
    let camera = format!("'{}' --exact calibrated::camera --ignored", exe.display());
    let mut args = vec!["display", "calibrate", display, "--json"];
    if !more.contains(&"--captures") {
        args.extend(["--camera", &camera]);
    }
    let mut command = common::command(at, &[&args, more].concat());
    command.envs(bench.iter().copied());
    command
}

/// Runs a command that must succeed, and returns its report and its standard error.
fn report(command: &mut Command) -> (Value, String) {
    let answer = command.output().expect("it starts");
    let said = text(&answer.stderr);
    assert!(answer.status.success(), "{said}");
    (serde_json::from_slice(&answer.stdout).expect("JSON"), said)
}

fn asked(at: &Path) -> Vec<String> {
    fs::read_to_string(at.join("asked.txt")).unwrap_or_default().lines().map(str::to_owned).collect()
}

const KEEP: [&str; 2] = ["--keep", "kept"];

#[test]
fn a_bench_is_calibrated_over_an_interruption_and_again_from_its_pictures() {
    let here = common::folder();
    let at = here.path();
    let args = [&KEEP[..], &["--report", "page.html", "-o", "out.toml"]].concat();
    let bench = [("BENCH_WRONG_PUPIL", "/009")];
    // Ctrl-C gives exit code 3, writes no display and keeps the pictures.
    let mut child = calibrate(at, &args, &bench).stderr(std::process::Stdio::null()).spawn().expect("it starts");
    let since = Instant::now();
    while asked(at).len() < 5 && since.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(20));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    assert!(killed.success());
    assert_eq!(child.wait().expect("it ends").code(), Some(3));
    assert!(!at.join("out.toml").exists());
    let kept: Value = serde_json::from_slice(&fs::read(at.join("kept/captures.json")).expect("kept")).expect("JSON");
    let answered = kept["captures"].as_array().expect("a list").iter().filter(|c| c["answer"].is_object()).count();
    assert!(answered >= 4, "{answered}");
    // The same command continues from these pictures.
    let before = asked(at).len();
    let (report_, said) = report(&mut calibrate(at, &args, &bench));
    let captures = report_["captures"].as_u64().expect("a number") as usize;
    assert_eq!(asked(at).len() - before, captures - answered, "{said}");
    let number = |key: &str| report_[key].as_f64().expect("a number");
    assert!(number("before") > 0.3, "{}", number("before"));
    assert!(number("unexplained") < 0.6 * number("noise"), "{} of {}", number("unexplained"), number("noise"));
    assert_eq!(report_["calibrated"], true);
    // The picture through another pupil is excluded and named.
    assert!(notes(&report_["warnings"], "009.npy") && said.has("009.npy"), "{said}");
    // Every number is within five of its standard errors, or within the errors that such small pictures allow.
    let truth = simulated::Bench::faulty();
    let near = |name: &str, want: f64, least: f64| {
        let all = report_["parameters"].as_array().expect("a list");
        let one = all.iter().find(|p| p["name"] == name).unwrap_or_else(|| panic!("{name} was not fitted: {all:?}"));
        let (value, error) = (one["value"].as_f64().expect("a value"), one["error"].as_f64().expect("an error"));
        assert!((value - want).abs() < (5.0 * error).max(least), "{name}: {value} +- {error}, not {want}");
    };
    near("lag", truth.lag, 1e-3);
    near("fill", truth.fill, 3e-3);
    near("bend b1", truth.bend[0], 3e-3);
    near("level 1 1", truth.level[1][1], 3e-3);
    near("source xx", truth.source[2], 3e-3);
    near("undiffracted re", truth.undiffracted[0][0], 3e-3);
    near("undiffracted im", truth.undiffracted[0][1], 3e-3);
    near("undiffracted 2 im", truth.undiffracted[1][1], 3e-3);
    near("undiffracted 2 y", truth.undiffracted[1][3], 0.02);
    near("wavefront 4", truth.zernike_4, 1e-3);
    near("wavefront 8", truth.zernike_8, 1e-3);
    near("iris x", truth.iris[0], 5e-3);
    near("iris scale", truth.iris[2], 1e-3);
    near("crosstalk sigma +x", 1.9, 0.1);
    directions_and_figures_are_the_bench_s(&report_, &truth);
    let page = fs::read_to_string(at.join("page.html")).expect("a page");
    assert!(page.matches("data:image/png").count() >= 6 && page.contains("wavefront 8"), "{}", page.len());
    // The plots are decibels, aberrations, beam, table, pupil plane and crosstalk.
    assert_eq!(page.matches("<svg").count(), 6);
    let read = |name: &str| fs::read_to_string(at.join(name)).expect("a display");
    // The iris has moved since the calibration. Four pictures are enough to find this.
    let drifted = [("BENCH_IRIS_X", "0.3")];
    let args = ["--quick", "--temperature", "24.5", "-o", "quick.toml"];
    let (quick, said) = report(&mut calibrate_display(at, "out.toml", &args, &drifted));
    // The age of the model is reported. The new file keeps the date of the calibration next to the date of the drift
    // correction.
    let before = &quick["model_before"];
    assert!(before["days"].is_i64() && before["updated"].is_null(), "{before}");
    assert!(said.contains(before["date"].as_str().expect("a date")), "{said}");
    let kept = Display::load(&at.join("quick.toml").display().to_string()).expect("a display");
    let terms = &kept.model[&Color::Green.into()];
    assert!(
        terms.date == before["date"] && !terms.updated.is_empty() && terms.temperature_c == Some(24.5),
        "{terms:?}"
    );
    assert!(!terms.from.is_empty() && terms.from == from_of(&at.join("out.toml")), "{}", terms.from);
    // Terms that did not drift keep their errors.
    assert!(terms.errors.as_ref().is_some_and(|e| e.lag.is_some() && e.wavefront.contains_key(&8)), "{terms:?}");
    let iris =
        quick["parameters"].as_array().expect("a list").iter().find(|p| p["name"] == "iris x").expect("the iris");
    assert!((iris["value"].as_f64().expect("a value") - 0.3).abs() < 0.02, "{iris}");
    assert!(quick["captures"].as_u64() <= Some(5) && read("quick.toml").contains("lag"), "{quick}");
    assert_eq!(quick["calibrated"], true, "{quick}");
}

/// Returns the origin of the model in a file.
fn from_of(file: &Path) -> String {
    Display::load(&file.display().to_string()).expect("a display").model[&Color::Green.into()].from.clone()
}

fn directions_and_figures_are_the_bench_s(report: &Value, truth: &simulated::Bench) {
    let directions = &report["directions"];
    assert!(directions["phase"] == "as-requested" && directions["mirrored"] == true, "{directions}");
    let turned = directions["turned_deg"].as_f64().expect("degrees");
    assert!((turned - (-0.02f64).atan2(0.9).to_degrees()).abs() < 0.1, "{turned}");
    let at = |pointer: &str| {
        report.pointer(&format!("/figures/{pointer}")).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer}"))
    };
    let near = |pointer: &str, want: f64, off: f64| {
        assert!((at(pointer) - want).abs() < off, "{pointer}: {}, not {want}", at(pointer));
    };
    for (i, [re, im, px, ..]) in truth.undiffracted.iter().enumerate() {
        near(&format!("zero_orders/{i}/share"), re * re + im * im, 2e-3);
        near(&format!("zero_orders/{i}/at_mm/0"), px / std::f64::consts::PI * 26.0 / 64.0, 0.02);
    }
    near("iris/at_mm/1", truth.iris[1], 5e-3);
    near("wavefront/rms_waves", truth.zernike_4.hypot(truth.zernike_8), 3e-3);
    near("table/level/0/2", truth.level[0][2], 0.01);
    assert!(at("crosstalk/variance_left") < 0.9 && at("beam/values/0") < 1.0);
    let mend = report["gain"]["mend"].as_array().expect("a list");
    let costs: Vec<f64> = mend.iter().map(|m| m["costs_db"].as_f64().expect("decibels")).collect();
    assert!(costs.iter().all(|db| *db >= 0.2) && costs.is_sorted_by(|a, b| a >= b), "{mend:?}");
}

#[test]
fn a_perfect_bench_stays_as_it_is() {
    let here = common::folder();
    let at = here.path();
    let args = [&KEEP[..], &["--set", "camera.pictures=20", "-o", "out.toml"]].concat();
    let (first, _) = report(&mut calibrate(at, &args, &[("BENCH_IDEAL", "1")]));
    let read = |name: &str| fs::read_to_string(at.join(name)).expect("a display");
    assert!(!read("out.toml").contains("[model"), "{first}");
    assert_eq!((&first["calibrated"], &first["warnings"]), (&true.into(), &Value::Array(Vec::new())));
    // The folder of pictures alone gives the same bytes.
    let (mut first, mut second) =
        (first, report(&mut calibrate(at, &["--captures", "kept", "-o", "again.toml"], &[])).0);
    assert_eq!(read("out.toml"), read("again.toml"));
    for report in [&mut first, &mut second] {
        report.as_object_mut().expect("an object").remove("seconds");
    }
    assert_eq!(first, second);
    // The text has the orientation of the bench as well.
    let directions = &first["directions"];
    assert!(directions["phase"] == "as-requested" && directions["mirrored"] == true, "{directions}");
    let args = ["display", "calibrate", "bench.toml", "--captures", "kept", "-o", "words.toml"];
    let words = text(&common::eyebox(at, &args).stdout);
    let turned = directions["turned_deg"].as_f64().expect("degrees").abs();
    assert!(words.has(&format!("{turned:.1}")), "{words}");
}

#[test]
fn a_fault_that_no_term_describes_is_named_with_its_size_and_place() {
    let here = common::folder();
    let at = here.path();
    let bench = [("BENCH_IDEAL", "1"), ("BENCH_GHOST", "0.1")];
    let (report, said) = report(&mut calibrate(at, &["--set", "camera.pictures=20", "-o", "out.toml"], &bench));
    assert_eq!(report["verdict"], "with-faults", "{said}");
    let tiles = report["map"]["squares"].as_array().expect("a map");
    let most = tiles.iter().filter_map(Value::as_f64).fold(0.0, f64::max);
    assert!(most > 3.0, "{tiles:?}");
    // A warning has the size of the fault at its largest place.
    assert!(notes(&report["warnings"], &format!("{most:.1}")) && said.has(&format!("{most:.1}")), "{most}: {said}");
}

#[test]
fn a_phase_of_the_other_sign_is_named_and_no_calibration() {
    for more in [&["--quick"][..], &["--set", "camera.pictures=20"]] {
        let here = common::folder();
        let at = here.path();
        let bench = [("BENCH_IDEAL", "1"), ("BENCH_SIGN", "-1")];
        let (report, said) = report(&mut calibrate(at, &[more, &["-o", "out.toml"]].concat(), &bench));
        assert_eq!(report["calibrated"], false, "{more:?}: {said}");
        assert_eq!(report["verdict"], "not-calibrated", "{more:?}: {said}");
        assert_eq!(report["directions"]["phase"], "opposite", "{more:?}: {said}");
        assert_eq!(report["gain"]["mend"].as_array().map(Vec::len), Some(0), "{more:?}");
        assert!(report["unexplained"].as_f64().is_some_and(|share| share > 0.1), "{more:?}: {report}");
        // The file must not look like a calibration.
        let written = fs::read_to_string(here.path().join("out.toml")).expect("a display");
        assert!(!written.contains("[model"), "{more:?}: {written}");
        assert!(report["warnings"].as_array().is_some_and(|all| !all.is_empty()), "{more:?}: {said}");
    }
}

#[test]
fn pictures_that_are_black_or_stay_saturated_end_it_with_a_line() {
    for (light, codes) in
        [("0", &["calibrate/pictures/only-noise", "calibrate/pictures/dots"][..]), ("1e6", &["calibrate/refused"])]
    {
        let here = common::folder();
        let at = here.path();
        let args = [&KEEP[..], &["--set", "camera.pictures=20", "-o", "out.toml"]].concat();
        let mut command = calibrate(at, &args, &[("BENCH_LIGHT", light)]);
        let answer = with_json_errors(&mut command).output().expect("it starts");
        let said = text(&answer.stderr);
        assert!(matches!(answer.status.code(), Some(2 | 3)), "{said}");
        assert!(codes.contains(&&Refusal::of(&answer).code[..]), "{said}");
        assert!(!at.join("out.toml").exists() && at.join("kept/captures.json").exists(), "{said}");
    }
}

/// The iris is fixed, and the camera command does not report its place. The user has to state the place. The light
/// through the iris then determines a part of the model.
#[test]
fn a_bench_whose_iris_stands_still_is_calibrated_as_far_as_it_tells() {
    let here = common::folder();
    let at = here.path();
    let bench = [("BENCH_STILL", "0.6,-0.4,9")];
    let asks = [&KEEP[..], &["--set", "camera.pictures=20", "-o", "out.toml"]].concat();
    refusal_of(&mut calibrate(at, &asks, &bench)).is("calibrate/bench/no-iris camera.iris");
    assert!(!at.join("out.toml").exists());
    let args = [&KEEP[..], &["--set=camera.iris=0.6,-0.4,9", "--set", "camera.pictures=20", "-o", "out.toml"]].concat();
    let (report, said) = report(&mut calibrate(at, &args, &bench));
    let number = |key: &str| report[key].as_f64().expect("a number");
    assert!(number("before") > 0.1, "{}", number("before"));
    assert!(number("unexplained") < 2.0 * number("noise"), "{} of {}", number("unexplained"), number("noise"));
    // Terms that cannot be observed are listed, with a warning.
    let warnings = report["warnings"].as_array().expect("a list");
    let are_said = warnings.iter().all(|warning| said.contains(warning.as_str().expect("a text")));
    assert!(report["untold"].is_array() && !warnings.is_empty() && are_said, "{report}");
    let gain = |key: &str| report["gain"][key][0].as_f64().expect("decibels");
    assert!(gain("after_db") > gain("before_db") + 1.0, "{}", report["gain"]);
}

/// The lens bends and magnifies each color differently, and the camera is tilted. The calibration finds this map and
/// the places of both colors.
#[test]
fn a_picture_is_registered_colour_by_colour() {
    let here = common::folder();
    let at = here.path();
    let lenses = [("green", [1.0, 0.02, 0.012]), ("red", [0.985, 0.03, 0.008])];
    fs::write(at.join("rgb.toml"), DISPLAY.replace("green = 520", "green = 520, red = 638")).expect("a display");
    let mut from = "rgb.toml".to_string();
    for (color, lens) in lenses {
        let out = format!("{color}.toml");
        let args = ["--color", color, "--register", "--set", "camera.pictures=20", "-o", &out];
        let lens = lens.map(|v| v.to_string()).join(",");
        let (_, said) =
            report(&mut calibrate_display(at, &from, &args, &[("BENCH_IDEAL", "1"), ("BENCH_LENS", &lens)]));
        assert!(
            said.lines().any(|line| line.has(color) && line.has("pixels") && line.number("pixels") > 0.1),
            "{said}"
        );
        from = out;
    }
    let display = Display::load(&at.join(from).display().to_string()).expect("a display");
    for ((name, lens), color) in lenses.iter().zip([Color::Green, Color::Red]) {
        let [zoom, k1, k2] = *lens;
        let homography = [-0.9, 0.02, 0.01, 0.02, 0.9, -0.008].map(|v| v * zoom);
        let [a, b, c, d, e, f] = homography;
        let truth = PictureWarp { homography: [a, b, c, d, e, f, 0.01, -0.006], distortion: [k1, k2] };
        let map = |seen| {
            let mut picture = Picture::default();
            picture.straight = true;
            picture.set(Color::Green, seen);
            picture.map(Color::Green, [64, 64]).expect("a map")
        };
        let [found, truth] = [display.picture.seen(color).expect("it was seen"), truth].map(map);
        for i in 0..81 {
            let place = [i % 9, i / 9].map(|v| f64::from(v) / 4.0 - 1.0);
            let (got, want) = (found.forth(place), truth.forth(place));
            let off = 32.0 * (got[0] - want[0]).hypot(got[1] - want[1]);
            assert!(off < 0.05, "{name}: {off:.3} pixels off at {place:?}");
        }
    }
}

/// eyebox shows the patterns on an output of its own, and the camera sees the content of that output.
#[test]
fn patterns_are_shown_on_an_output_of_eyebox_s_own() {
    let here = common::folder();
    let at = here.path();
    let shows = ["--output", "shared:video", "--set", "camera.settle=0"];
    let args = [&KEEP[..], &shows, &["--set", "camera.pictures=20", "-o", "out.toml"]].concat();
    let (first, _) = report(&mut calibrate(at, &args, &[("BENCH_IDEAL", "1"), ("BENCH_SHARED", "video")]));
    assert_eq!(first["calibrated"], true);
    assert!(first["unexplained"].as_f64() < first["noise"].as_f64(), "{first}");
    let kept: Value = serde_json::from_slice(&fs::read(at.join("kept/captures.json")).expect("kept")).expect("JSON");
    let captures = kept["captures"].as_array().expect("a list");
    assert!(captures.iter().all(|c| c["request"]["show"].is_null()), "{captures:?}");
    assert!(captures.iter().any(|c| c["shown"]["file"] == "random-0.npy"), "{captures:?}");
    let (second, _) = report(&mut calibrate(at, &["--captures", "kept", "-o", "again.toml"], &[]));
    assert_eq!(first["unexplained"], second["unexplained"]);
    let wrong = ["--output", "shared", "-o", "no.toml"];
    refusal_of(&mut calibrate(at, &wrong, &[])).is("usage/value-validation --output shared:FILE");
}

/// The same output shows the hologram of a solve with a camera. The camera command does not report the place of its
/// fixed iris.
#[test]
fn a_solve_s_camera_sees_an_output_through_an_iris_that_stands_still() {
    let here = common::folder();
    let at = here.path();
    fs::write(at.join("bench.toml"), DISPLAY).expect("a display");
    let exe = std::env::current_exe().expect("this program");
    let camera = format!("'{}' --exact calibrated::camera --ignored", exe.display());
    let run = |more: &[&str]| {
        let solve = ["solve", "builtin:still-life", "--display", "bench.toml", "--frames", "2", "--steps", "6"];
        let with = ["--camera", &camera, "--camera-steps", "1", "--engine", "cpu", "--json", "-o", "h.zarr"];
        let shows = ["--output", "shared:video", "--set", "camera.settle=0"];
        let mut command = common::command(at, &[&solve[..], &with, &shows, more].concat());
        command.envs([("BENCH_IDEAL", "1"), ("BENCH_STILL", "0.6,-0.4,9"), ("BENCH_SHARED", "video")]);
        command
    };
    refusal_of(&mut run(&[])).is("calibrate/captures/no-iris camera.iris");
    let answer = run(&["--set=camera.iris=0.6,-0.4,9", "--keep", "kept"]).output().expect("it starts");
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let said: Value = serde_json::from_slice(&answer.stdout).expect("JSON");
    let camera = &said["camera"][0];
    // The display shows one sub-frame at a time, so that two sub-frames take two pictures. A step has six pupils, and
    // the six held-out pupils are captured twice.
    assert!(camera["steps"] == 1 && camera["pictures"].as_u64() >= Some(36), "{camera}");
    assert!(camera["psnr_before_db"][0].as_f64().expect("decibels") > 5.0, "{camera}");
    let kept: Value = serde_json::from_slice(&fs::read(at.join("kept/captures.json")).expect("kept")).expect("JSON");
    let captures = kept["captures"].as_array().expect("a list");
    assert!(captures.iter().all(|c| c["request"]["show"].is_null() && c["request"]["iris_mm"].is_null()));
    assert!(captures.iter().any(|c| c["shown"]["kind"] == "phases"), "{captures:?}");
}

/// The camera sees the output on a bench whose iris has moved. The model follows the bench, and the scene is solved
/// again for it.
#[test]
fn a_show_follows_the_bench_that_its_camera_sees() {
    let here = common::folder();
    let at = here.path();
    fs::write(at.join("bench.toml"), DISPLAY).expect("a display");
    let exe = std::env::current_exe().expect("this program");
    let camera = format!("'{}' --exact calibrated::camera --ignored", exe.display());
    let show = ["show", "builtin:still-life", "--display", "bench.toml", "--frames", "1", "--engine", "cpu"];
    let shows = ["--output", "shared:video", "--set", "camera.settle=0", "--keep", "kept"];
    let follows = ["--camera", &camera, "--set", "camera.every=1e-6", "--camera-model", "followed.toml"];
    let mut command = common::command(at, &[&show[..], &shows, &follows].concat());
    command.envs([("BENCH_IDEAL", "1"), ("BENCH_IRIS_X", "0.3"), ("BENCH_SHARED", "video")]);
    command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::piped());
    let mut child = command.spawn().expect("it starts");
    let mut lines = BufReader::new(child.stderr.take().expect("its errors")).lines().map(|line| line.expect("a line"));
    let mut said = Vec::new();
    // Each fit prints the share that it leaves unexplained.
    let mut until_fitted = || {
        // Errors begin with the name of the program.
        let ends = |line: &String| line.has("%") || line.starts_with("eyebox: ");
        let seen = lines.by_ref().inspect(|line| said.push(line.clone())).find(ends);
        assert!(seen.is_some_and(|line| !line.starts_with("eyebox: ")), "{said:#?}");
    };
    let iris = || {
        let followed = Display::load(&at.join("followed.toml").display().to_string()).expect("a display");
        followed.model(Color::Green).iris
    };
    until_fitted();
    assert!((iris().x * 1e3 - 0.3).abs() < 0.1, "the model did not follow: {:?}", iris());
    // The scene is solved again for the new model. The next fit has the first picture of the new hologram.
    until_fitted();
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    assert!(killed.success());
    said.extend(lines);
    assert!(child.wait().expect("it ends").success(), "{said:#?}");
    let iris = iris();
    assert!((iris.x * 1e3 - 0.3).abs() < 0.05 && (iris.y * 1e3).abs() < 0.05, "{iris:?}: {said:#?}");
    // No request has a pattern for the camera to show.
    let kept: Value = serde_json::from_slice(&fs::read(at.join("kept/captures.json")).expect("kept")).expect("JSON");
    let captures = kept["captures"].as_array().expect("a list");
    assert!(captures.iter().all(|c| c["request"]["show"].is_null()), "{captures:?}");
    let shown = |k: usize| {
        let name = format!("shown-{k}.npy");
        assert!(captures.iter().any(|c| c["shown"]["file"] == name && c["answer"].is_object()), "{captures:?}");
        eyebox::low_level::files::read_npy(&at.join("kept").join(name)).expect("phases").values
    };
    // The first three pictures show the first hologram. The pictures after the fit show another one.
    assert!(shown(0) == shown(2) && shown(0) != shown(3));
    let wrongs =
        [&["--tracker", "hid"][..], &["--clock", "simulated"], &["--record", "r"], &["--camera-model", "out.txt"]];
    for wrong in wrongs {
        let answer = common::eyebox(at, &[&show[..], &["--camera", "true"], wrong].concat());
        assert!(answer.status.code() == Some(2), "{wrong:?}: {}", text(&answer.stderr));
    }
}
