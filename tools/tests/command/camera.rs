//! `eyebox solve --camera` with a simulated bench whose faults no model has, and with cameras that fail during the
//! solve.

use crate::common::{self, Printed, Refusal, eyebox, folder, refused, text};
use eyebox::low_level::files::{read_npy, write_npy};
use eyebox::low_level::hologram::Hologram;
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::fs;
use std::io::BufRead;
use std::path::Path;
use std::process::Output;

const N: usize = 64;
/// Side of the camera, which has two pixels per pixel of the SLM.
const CAMERA: usize = 2 * N;
const DISPLAY: &str =
    "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
/// Environment variable with the words that configure the bench, see [`serve`].
const BENCH: &str = "EYEBOX_TEST_BENCH";
/// Shift of a creeping picture from one picture to the next, in camera pixels.
const CREEP: f64 = 0.04;

/// Bench that tests start as the camera command. Its SLM has a source that falls off at the edges, each picture has a
/// ghost, and the pupil plane has an iris.
///
/// Words in its environment variable change it. With `fixed` the iris does not move. With `single` the SLM shows one
/// sub-frame at a time, with the requested exposure. With `creeps` the picture moves over the camera. The words
/// `noise`, `dies`, `small`, `black`, `full` and `nonsense` begin at picture 12. The word `lies` gives noise in every
/// picture except the dots.
#[test]
#[ignore = "the camera of other tests"]
fn serve() {
    let Ok(words) = std::env::var(BENCH) else { return };
    let is = |word: &str| words.split(' ').any(|w| w == word);
    for line in std::io::stdin().lock().lines() {
        let ask: Value = serde_json::from_str(&line.expect("a line")).expect("a question");
        let mut answer = match ask["do"].as_str().expect("what to do") {
            "hello" => hello(is("fixed"), is("single")),
            "capture" => {
                let out = ask["out"].as_str().expect("a place");
                let number: usize = out[out.len() - 3..].parse().expect("a number");
                let late = |word: &str| is(word) && number >= 12;
                if late("dies") {
                    std::process::exit(7);
                }
                if late("nonsense") {
                    println!("{{what?");
                }
                let crept = if is("creeps") { CREEP * number as f64 } else { 0.0 };
                let mut light =
                    if ask["color"].is_null() { vec![0.0; CAMERA * CAMERA] } else { light(&ask, is("fixed"), crept) };
                let mut random = fastrand::Rng::with_seed(number as u64);
                if late("noise") || is("lies") && ask["show"]["file"].as_str().is_some_and(|f| !f.contains("dots")) {
                    light.iter_mut().for_each(|v| *v = 0.5 * random.f64());
                }
                if late("black") {
                    light.fill(0.0);
                }
                let mut sorted = light.clone();
                sorted.sort_by(f64::total_cmp);
                let best = 0.8 / sorted[sorted.len() * 999 / 1000].max(1e-9);
                let exposure = ask["exposure_ms"].as_f64().unwrap_or(best);
                let count = |v: &f64| {
                    let share = if late("full") { 2.0 } else { v * exposure + 0.01 + 0.002 * (random.f64() - 0.5) };
                    (share * 4095.0).round().clamp(0.0, 4095.0) as f32
                };
                let side = if late("small") { CAMERA - 1 } else { CAMERA };
                let counts: Vec<f32> = light.iter().take(side * side).map(count).collect();
                let file = format!("{out}.npy");
                write_npy(Path::new(&file), &[side, side], &counts).expect("a picture");
                let iris = if is("fixed") { json!([0.0, 0.0, 6.0]) } else { ask["iris_mm"].clone() };
                json!({"file": file, "full_scale": 4095, "exposure_ms": exposure, "iris_mm": iris})
            }
            _ => json!({}),
        };
        answer["id"] = ask["id"].clone();
        println!("{answer}");
        if ask["do"] == "bye" {
            return;
        }
    }
}

fn hello(fixed: bool, single: bool) -> Value {
    let mut hello = json!({
        "protocol": 1, "colors": {"green": 520.0},
        "slm": {"resolution": [N, N], "takes": ["levels"], "sub_frames": if single { 1 } else { 8 }},
        "camera": {"resolution": [CAMERA, CAMERA], "bits": 12, "auto_exposure": !single, "dark": true, "exposure_ms": [1e-6, 1e6]},
    });
    if !fixed {
        hello["iris"] = json!({"x_mm": [-12, 12], "y_mm": [-12, 12], "diameter_mm": [1, 22]});
    }
    hello
}

/// Complex number with its real and imaginary parts.
type Field = [f64; 2];

fn times(a: Field, b: Field) -> Field {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

fn cis(turns: f64) -> Field {
    [(TAU * turns).cos(), (TAU * turns).sin()]
}

/// Sums over columns and then over rows, to `out` x `out` values. The function `turns` returns the phase of a term in
/// turns, from the index of the output and the index of the input.
fn summed(from: &[Field], out: usize, turns: impl Fn(usize, usize) -> f64) -> Vec<Field> {
    let n = from.len().isqrt();
    let table: Vec<Field> = (0..out * n).map(|i| cis(turns(i / n, i % n))).collect();
    let along = |lines: &[Field]| -> Vec<Field> {
        // The result is transposed to (output, line).
        let count = lines.len() / n;
        let value = |i: usize| {
            let (k, line) = (i / count, &lines[i % count * n..][..n]);
            line.iter().zip(&table[k * n..]).fold([0.0; 2], |s, (v, t)| {
                let [re, im] = times(*v, *t);
                [s[0] + re, s[1] + im]
            })
        };
        (0..out * count).map(value).collect()
    };
    along(&along(from))
}

/// Returns the light at the camera's pixels for the set of a request, moved by `crept` pixels right and down.
fn light(ask: &Value, fixed: bool, crept: f64) -> Vec<f64> {
    let shown = read_npy(Path::new(ask["show"]["file"].as_str().expect("a pattern"))).expect("a pattern").values;
    let iris: Vec<f64> = match fixed {
        true => vec![0.0, 0.0, 6.0],
        false => ask["iris_mm"].as_array().expect("an iris").iter().map(|v| v.as_f64().expect("a number")).collect(),
    };
    let bin = |k: usize| (k as f64) - (N / 2) as f64;
    // Size of a bin in the pupil plane, in mm.
    let unit = 520e-6 * 400.0 / (0.008 * N as f64);
    let mut light = vec![0.0; CAMERA * CAMERA];
    let frames = shown.len() / (N * N);
    for frame in shown.chunks_exact(N * N) {
        let source = |i: usize| {
            let [y, x] = [i / N, i % N].map(|v| (2 * v + 1) as f64 / N as f64 - 1.0);
            (-0.25 * (x * x + y * y)).exp()
        };
        let field: Vec<Field> =
            frame.iter().enumerate().map(|(i, level)| cis(f64::from(*level) / 256.0).map(|v| v * source(i))).collect();
        let mut spectrum = summed(&field, N, |k, i| -bin(k) * i as f64 / N as f64);
        for (i, v) in spectrum.iter_mut().enumerate() {
            let (ky, kx) = (bin(i / N), bin(i % N));
            let inside = (kx * unit - iris[0]).hypot(ky * unit - iris[1]) < iris[2] / 2.0;
            let ghost = cis(-5.0 * (kx + ky) / N as f64);
            *v = if inside { times(*v, [1.0 + 0.25 * ghost[0], 0.25 * ghost[1]]) } else { [0.0; 2] };
        }
        let seen = summed(&spectrum, CAMERA, |i, k| bin(k) * (i as f64 - crept) / CAMERA as f64);
        let share = 1.0 / (frames * N * N * N * N) as f64;
        light.iter_mut().zip(seen).for_each(|(sum, [re, im])| *sum += share * (re * re + im * im));
    }
    light
}

/// Solves into `out` with this bench as the camera. Without words there is no camera.
fn solve(at: &Path, words: &str, out: &str, more: &[&str]) -> Output {
    fs::write(at.join("bench.toml"), DISPLAY).expect("a display");
    let program = std::env::current_exe().expect("this program").display().to_string();
    let camera = format!("env '{BENCH}={words}' '{program}' camera::serve --exact --ignored --nocapture");
    let plain =
        ["solve", "builtin:still-life", "--display", "bench.toml", "--frames", "2", "--engine", "cpu", "-o", out];
    let with: &[&str] = if words.is_empty() { &[] } else { &["--camera", &camera] };
    common::with_json_errors(&mut common::command(at, &[&plain[..], with, more].concat())).output().expect("it starts")
}

fn phases(at: &Path, name: &str) -> Vec<f32> {
    Hologram::load(&at.join(name)).expect("a hologram").colors[0].phases.clone()
}

fn mean(values: &Value) -> f64 {
    let values = values.as_array().expect("values");
    values.iter().map(|v| v.as_f64().expect("a number")).sum::<f64>() / values.len() as f64
}

/// The bench has a ghost and a source that its display file does not describe. Pictures through pupils that no step
/// used show that the hologram became better on it. The hologram records how it was made, and its pictures serve a
/// second run.
#[test]
fn what_no_model_has_is_corrected_by_what_the_camera_sees() {
    let here = folder();
    let at = here.path();
    let steps = ["--steps", "20", "--json", "--camera-steps", "8", "--keep", "kept"];
    let answer = solve(at, "ghost", "h.zarr", &steps);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let said: Value = serde_json::from_str(&text(&answer.stdout)).expect("an object");
    let camera = &said["camera"][0];
    let (before, after) = (mean(&camera["psnr_before_db"]), mean(&camera["psnr_after_db"]));
    assert!(after > before + 0.3, "{before} dB, then {after} dB");
    assert!(camera["kept_steps"].as_u64() > Some(0) && camera["trouble"].is_null(), "{camera}");
    let record = Hologram::load(&at.join("h.zarr")).expect("a hologram").metadata.camera[0];
    assert_eq!(record.pictures as u64, camera["pictures"].as_u64().unwrap());
    assert!((record.psnr_db.unwrap()[1] - after).abs() < 1e-9, "{record:?}");
    let kept = || {
        let text = fs::read_to_string(at.join("kept/captures.json")).expect("the captures");
        serde_json::from_str::<Value>(&text).expect("JSON")["captures"].as_array().expect("a list").clone()
    };
    let first = kept();
    // The folder has the dots, the dark picture and the pictures of the steps.
    assert_eq!(first.len() as u64, 2 + camera["pictures"].as_u64().unwrap());
    let again = ["--steps", "2", "--camera-steps", "1", "--keep", "kept"];
    let answer = solve(at, "ghost", "i.zarr", &again);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let both = kept();
    assert!(both[..first.len()] == first && both.len() > first.len(), "{} and {}", first.len(), both.len());
    assert!(both[first.len()..].iter().all(|c| !c["request"]["show"]["file"].as_str().unwrap().contains("dots")));
}

/// At the end, the picture is more than three camera pixels from the place of the dots.
#[test]
fn a_picture_that_creeps_over_the_camera_is_followed() {
    let here = folder();
    let steps = ["--steps", "20", "--json", "--camera-steps", "8"];
    let answer = solve(here.path(), "ghost creeps", "h.zarr", &steps);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let said: Value = serde_json::from_str(&text(&answer.stdout)).expect("an object");
    let camera = &said["camera"][0];
    let (before, after) = (mean(&camera["psnr_before_db"]), mean(&camera["psnr_after_db"]));
    assert!(after > before + 0.3, "{before} dB, then {after} dB");
}

#[test]
fn a_camera_that_lies_leaves_the_hologram_as_it_was() {
    let here = folder();
    let at = here.path();
    let plain = solve(at, "", "plain.zarr", &["--steps", "3"]);
    assert!(plain.status.success(), "{}", text(&plain.stderr));
    for words in ["ghost lies", "ghost noise"] {
        let answer = solve(at, words, "h.zarr", &["--steps", "3", "--camera-steps", "2", "--json"]);
        let said = text(&answer.stderr) + &text(&answer.stdout);
        assert!(phases(at, "h.zarr") == phases(at, "plain.zarr"), "{words}: {said}");
        let lies = words.contains("lies");
        assert_eq!(answer.status.code(), Some(if lies { 2 } else { 0 }), "{said}");
        let report: Value = serde_json::from_slice(&answer.stdout).expect("an object");
        let camera = &report["camera"][0];
        assert_eq!((&camera["kept_steps"], camera["trouble"].is_null()), (&0.into(), !lies), "{words}: {camera}");
        if lies {
            Refusal::of(&answer).is("calibrate/pictures/other-pictures");
        }
    }
}

#[test]
fn a_camera_that_fails_on_the_way_ends_in_one_line_and_the_best_so_far() {
    let here = folder();
    let at = here.path();
    for (word, code, what) in [
        ("dies", 3, "calibrate/lost 3 7"),
        ("small", 3, "calibrate/lost/picture-size 127x127 128x128"),
        ("nonsense", 3, "calibrate/lost/not-json"),
        ("black", 2, "calibrate/captures/black 012.npy"),
        ("full", 3, "calibrate/refused"),
    ] {
        let answer = solve(at, word, "h.zarr", &["--steps", "2", "--camera-steps", "2"]);
        let said = text(&answer.stderr);
        assert_eq!(answer.status.code(), Some(code), "{word}: {said}");
        Refusal::of(&answer).is(what);
        // The hologram is named before the error.
        assert!(said.lines().rev().skip(1).any(|line| line.has("h.zarr")), "{word}: {said}");
        assert_eq!(phases(at, "h.zarr").len(), 2 * N * N);
        fs::remove_dir_all(at.join("h.zarr")).expect("a folder");
    }
}

/// The iris is fixed, and the SLM shows one sub-frame at a time. The camera receives its exposure time in each request.
#[test]
fn a_simple_bench_takes_steps_too() {
    let here = folder();
    let answer = solve(here.path(), "fixed single", "h.zarr", &["--steps", "4", "--camera-steps", "2", "--json"]);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let report: Value = serde_json::from_slice(&answer.stdout).expect("an object");
    let camera = &report["camera"][0];
    assert!(camera["steps"] == 2 && mean(&camera["psnr_before_db"]).is_finite(), "{camera}");
}

#[test]
fn ctrl_c_leaves_the_best_so_far() {
    let here = folder();
    let at = here.path();
    fs::write(at.join("bench.toml"), DISPLAY).expect("a display");
    let program = std::env::current_exe().expect("this program").display().to_string();
    let camera = format!("env '{BENCH}=ghost' '{program}' camera::serve --exact --ignored --nocapture");
    let solve =
        ["solve", "builtin:still-life", "--display", "bench.toml", "--frames", "2", "--steps", "2", "--engine", "cpu"];
    let with = ["--camera", &camera, "--camera-steps", "60000", "--keep", "kept", "-o", "h.zarr"];
    let mut command = common::command(at, &[&solve[..], &with].concat());
    let mut child = command.stderr(std::process::Stdio::piped()).spawn().expect("it starts");
    while !at.join("kept/010.npy").exists() {
        assert!(child.try_wait().expect("a process").is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let sent = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(sent.expect("kill").success());
    let answer = child.wait_with_output().expect("an end");
    let said = text(&answer.stderr);
    assert!(answer.status.success() && said.has("h.zarr"), "{said}");
    assert_eq!(phases(at, "h.zarr").len(), 2 * N * N);
}

#[test]
fn what_cannot_be_asked_of_a_camera_is_one_line() {
    let here = folder();
    let at = here.path();
    fs::write(at.join("bench.toml"), DISPLAY).expect("a display");
    fs::write(at.join("red.toml"), DISPLAY.replace("green = 520", "red = 660")).expect("a display");
    let base = ["solve", "builtin:plane", "-o", "h.zarr", "--engine", "cpu"];
    let camera = ["--camera", "no-such-program-here", "--camera-steps", "2"];
    let run = |display: &str, more: &[&str], what: &str| {
        refused(at, &[&base[..], &["--display", display], more].concat(), "h.zarr", what);
    };
    run("bench.toml", &camera, "calibrate/start");
    run("bench.toml", &[&camera[..], &["builtin:still-life"]].concat(), "arguments/camera-of-many --camera");
    let hello = hello(false, false).to_string().replacen('{', "{\"id\": 0, ", 1);
    fs::write(at.join("hello"), format!("{hello}\n")).expect("an answer");
    let camera = ["--camera", "sh -c 'read line; cat hello; read line'", "--camera-steps", "2"];
    run("red.toml", &camera, "calibrate/bench/bench-color");
    run("bench.toml", &[&camera[..], &["--prescription=-0.1 0 0"]].concat(), "calibrate/bench/prescription");
    let answer = eyebox(at, &[&base[..], &["--display", "bench.toml", "--camera", "x"]].concat());
    assert!(text(&answer.stderr).contains("--camera-steps"), "{}", text(&answer.stderr));
}

/// The program of docs/calibrate.md answers each request of a calibration. A few lines replace its libraries, and its
/// camera sees only darkness.
#[test]
fn the_documents_program_answers() {
    let here = folder();
    let at = here.path();
    let page = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/calibrate.md")).expect("the page");
    let program = page.split("```python\n").nth(1).and_then(|p| p.split("```").next()).expect("the program");
    let numpy = "class Rows(list):\n    shape = (64, 64)\n\
                 def load(file):\n    assert open(file, 'rb').read(6) == b'\\x93NUMPY'\n    return [Rows()]\n\
                 def save(file, counts):\n    head = str({'descr': '<u2', 'fortran_order': False, 'shape': (80, 90)}).ljust(117) + '\\n'\n    \
                 open(file, 'wb').write(b'\\x93NUMPY\\x01\\x00' + bytes([118, 0]) + head.encode() + counts)\n";
    let bench = "def log(*what): print(*what, file=open('log', 'a'))\n\
                 class Slm:\n    shape = (64, 64)\n    def set_phase(self, phase, settle): log('shows', phase.shape, settle)\n\
                 class Cam:\n    shape, bitdepth = (80, 90), 12\n    def set_exposure(self, s): log('exposes', s)\n    \
                 def get_image(self, averaging): log('adds', averaging); return bytes(2 * 80 * 90)\n\
                 class Stage:\n    def move(self, to): log('moves', to); print('a motor says hello')\n\
                 slm, cam, iris, stage = Slm(), Cam(), Stage(), Stage()\n";
    for (name, text) in
        [("bench.toml", DISPLAY), ("my_camera.py", program), ("numpy.py", numpy), ("my_bench.py", bench)]
    {
        fs::write(at.join(name), text).expect("a file");
    }
    let calibrate = ["display", "calibrate", "bench.toml", "--camera", "python3 -B my_camera.py", "-o", "out.toml"];
    let answer = common::failed(&mut common::command(at, &calibrate));
    // The program's own line is printed. The missing dots are the only error, so that every request was answered.
    assert!(text(&answer.stderr).contains("a motor says hello"), "{}", text(&answer.stderr));
    Refusal::of(&answer).is("calibrate/pictures/dots 000.npy");
    let log = fs::read_to_string(at.join("log")).expect("what was done");
    for done in ["moves [0.0, 0.0, ", "moves 0", "exposes 0.01", "shows (64, 64) True", "adds 4"] {
        assert!(log.contains(done), "{done}: {log}");
    }
}
