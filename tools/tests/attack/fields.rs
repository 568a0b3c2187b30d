//! Changes every field of every document. A document with a checksum receives the new checksum.

use crate::case::{Case, Put, word};
use crate::ground::Ground;
use serde_json::{Value, json};

/// A document and the runs that read it. `{}` is the file or the folder that contains it.
struct Subject {
    /// The file or folder that is copied from `base`.
    whole: &'static str,
    /// The document in the folder. It is empty if `whole` is the document.
    inside: &'static str,
    runs: &'static [&'static str],
}

pub const HOLOGRAM: &[&str] = &[
    "render {} --pupil=0,0,1,0 --engine cpu -o out/seen.png",
    "render {} --at 1 --pupil=0,0,0.3,0 --engine cpu -o out/seen.png",
    "eval score {} builtin:plane --test-pupils random:1 --engine cpu",
    "refine {} builtin:plane --pupil=0,0,1,0 --steps 1 --engine cpu -o out/x.zarr",
    "convert {} out/x.npy",
    "encode {} --display grey8 --size 16x16 --engine cpu -o out/frames",
    "show {} --display grey8 --size 16x16 --output offscreen --clock simulated --duration 0.1 --engine cpu",
    "show {} --tracker simulated --display grey8 --size 16x16 --duration 0.05 --engine cpu",
    "eval compare builtin:plane --hologram mine={} --force --size 16x16 --color green --frames 1 --steps 1 --methods dpac --views 2 \
     --set compare.speckle=false --engine cpu -o out/evaluate",
];
const SCENE: &[&str] = &[
    "info {} --size 16x16 -o out/views.png --json",
    "solve {} --size 16x16 --steps 1 --frames 1 --color green --engine cpu -o out/x.zarr",
];
const DISPLAY: &[&str] = &[
    "encode base/h.zarr --display {} --engine cpu -o out/frames --json",
    "show base/h.zarr --display {} --output offscreen --clock simulated --duration 0.1 --engine cpu",
    "display check {}",
    "solve builtin:plane --display {} --steps 1 --frames 1 --engine cpu -o out/x.zarr",
    "convert base/phases.npy out/x.zarr --display {} --color green",
];
const FAR: &[&str] = &[
    "solve builtin:plane --display {} --frames 1 --memory 600MiB --pupil-diameter 0.2..0.4 --set tiles.picture=32 --set tiles.passes=1 --steps 1 --engine cpu -o out/x.zarr",
    "display check {}",
];
const CALIBRATION: &[&str] = &[
    "tracker watch base/eye.jsonl --predict --calibration {}",
    "show base/h.zarr --tracker simulated --display grey8 --size 16x16 --duration 0.05 --engine cpu --calibration {}",
];

const SUBJECTS: [Subject; 22] = [
    Subject { whole: "h.zarr", inside: "zarr.json", runs: HOLOGRAM },
    Subject { whole: "h.zarr", inside: "phases/zarr.json", runs: HOLOGRAM },
    Subject { whole: "rgb.zarr", inside: "zarr.json", runs: HOLOGRAM },
    Subject { whole: "moving.zarr", inside: "zarr.json", runs: HOLOGRAM },
    Subject { whole: "moving.zarr", inside: "phases/zarr.json", runs: HOLOGRAM },
    Subject { whole: "far.zarr", inside: "zarr.json", runs: HOLOGRAM },
    Subject { whole: "far.zarr", inside: "phases/zarr.json", runs: HOLOGRAM },
    Subject { whole: "frames", inside: "frames.json", runs: &["render {} --pupil=0,0,1,0 --engine cpu -o out/x.png"] },
    Subject { whole: "frames", inside: "display.toml", runs: &["render {} --pupil=0,0,1,0 --engine cpu -o out/x.png"] },
    Subject { whole: "views", inside: "lightfield.toml", runs: SCENE },
    Subject { whole: "bench", inside: "bench.toml", runs: DISPLAY },
    Subject {
        whole: "bench",
        inside: "green.csv",
        runs: &["encode base/h.zarr --display in/bench/bench.toml --engine cpu -o out/frames"],
    },
    Subject { whole: "planes.toml", inside: "", runs: DISPLAY },
    Subject { whole: "far.toml", inside: "", runs: FAR },
    Subject { whole: "device.toml", inside: "", runs: &["tracker watch base/eye.hid --device-file {}"] },
    Subject { whole: "ada.toml", inside: "", runs: CALIBRATION },
    Subject {
        whole: "pupils.json",
        inside: "",
        runs: &["eval score base/h.zarr builtin:plane --test-pupils {} --engine cpu --json"],
    },
    Subject {
        whole: "slm.toml",
        inside: "",
        runs: &[
            "solve builtin:plane --settings {} --size 16x16 --steps 1 --frames 1 --color green --engine cpu -o out/x.zarr",
        ],
    },
    Subject {
        whole: "tables.toml",
        inside: "",
        runs: &[
            "eval gaze base/h.zarr --settings {} --display grey8 --size 16x16 --duration 0.1 --engine cpu -o out/study",
            "eval compare builtin:plane --settings {} --size 16x16 --color green --frames 1 --steps 1 --methods dpac --views 2 --engine cpu \
             -o out/compare",
            "eval score base/h.zarr builtin:plane --settings {} --test-pupils random:1 --engine cpu --json",
            "show base/h.zarr --settings {} --display grey8 --size 16x16 --output offscreen --clock simulated --duration 0.1 --engine cpu",
            "solve builtin:plane --settings {} --display base/far.toml --frames 1 --memory 600MiB --pupil-diameter 0.2..0.4 --steps 1 \
             --engine cpu -o out/x.zarr",
        ],
    },
    Subject {
        whole: "eye.jsonl",
        inside: "",
        runs: &["tracker watch {} --predict", "tracker record {} --json -o out/eye.jsonl"],
    },
    Subject { whole: "eye.hid", inside: "", runs: &["tracker record {} -o out/eye.hid", "tracker describe {} --json"] },
    Subject { whole: "descriptor.txt", inside: "", runs: &["tracker describe {} --json"] },
];

/// Returns an odd value for a field.
fn odd(rng: &mut fastrand::Rng) -> Value {
    let numbers = [
        0.0,
        -0.0,
        -1.0,
        1.0,
        2.0,
        3.0,
        0.5,
        1e-320,
        1e-9,
        1e9,
        1e18,
        1e19,
        1e308,
        -1e308,
        64.0,
        65536.0,
        4294967296.0,
    ];
    match rng.u8(..12) {
        0..=4 => json!(numbers[rng.usize(..numbers.len())]),
        5 => json!([0i64, 1, 2, -1, 1 << 20, 1 << 40, i64::MAX, i64::MIN, 255][rng.usize(..9)]),
        6 => json!(u64::MAX),
        7 => json!(["", "red", "none", "\u{fc}", "nan", "../../x", "/dev/zero", "builtin:plane", "1"][rng.usize(..9)]),
        8 => json!([1, 2, 3]),
        9 => json!({ "a": 1 }),
        10 => json!(rng.bool()),
        _ => json!(Vec::<Value>::new()),
    }
}

/// Returns the number of values in a document. The document itself counts as one.
fn count(value: &Value) -> usize {
    1 + match value {
        Value::Object(map) => map.values().map(count).sum(),
        Value::Array(list) => list.iter().map(count).sum(),
        _ => 0,
    }
}

/// Changes the value with the number `at`, in the order of `count`.
fn change(value: &mut Value, at: &mut usize, rng: &mut fastrand::Rng) -> bool {
    if *at == 0 {
        match value {
            Value::Object(map) if rng.bool() && !map.is_empty() => {
                let key = map.keys().nth(rng.usize(..map.len())).cloned().unwrap_or_default();
                let gone = map.remove(&key);
                if rng.bool() {
                    map.insert(key + "x", gone.unwrap_or_default());
                }
            }
            Value::Array(list) if rng.bool() => match rng.u8(..3) {
                0 => drop(list.pop()),
                1 => list.extend(list.last().cloned()),
                _ => list.resize(rng.usize(..300), list.first().cloned().unwrap_or_default()),
            },
            Value::Number(number) if rng.bool() => {
                let is = number.as_f64().unwrap_or(0.0);
                *value = json!([is + 1.0, -is, is * 1e3, is * 1e-3, is * 0.5, is + 0.5][rng.usize(..6)]);
            }
            _ => *value = odd(rng),
        }
        return true;
    }
    *at -= 1;
    match value {
        Value::Object(map) => map.values_mut().any(|value| change(value, at, rng)),
        Value::Array(list) => list.iter_mut().any(|value| change(value, at, rng)),
        _ => false,
    }
}

fn changed(document: &mut Value, rng: &mut fastrand::Rng) {
    for _ in 0..[1, 1, 1, 2, 4][rng.usize(..5)] {
        // Value 0 is the document itself. The change is for its fields.
        let mut at = rng.usize(..count(document)).max(1);
        change(document, &mut at, rng);
    }
}

/// Returns the document as JSON. If it has a field for its checksum, the field holds the new checksum.
pub fn sealed(document: &Value) -> Vec<u8> {
    let mut bytes = serde_json::to_vec_pretty(document).expect("JSON");
    bytes.push(b'\n');
    let mark = b"\"document_crc32c\": \"";
    let Some(at) = bytes.windows(mark.len()).rposition(|w| w == mark).map(|at| at + mark.len()) else { return bytes };
    if at + 8 <= bytes.len() {
        bytes[at..at + 8].copy_from_slice(b"00000000");
        let sum = crc32c::crc32c(&bytes);
        bytes[at..at + 8].copy_from_slice(format!("{sum:08x}").as_bytes());
    }
    bytes
}

/// Returns a text with changes to some of its numbers, words or lines.
fn text(bytes: &[u8], rng: &mut fastrand::Rng) -> Vec<u8> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines: Vec<String> = text.lines().map(String::from).collect();
    for _ in 0..rng.usize(1..4) {
        let at = rng.usize(..lines.len().max(1));
        let Some(line) = lines.get_mut(at) else { break };
        match rng.u8(..6) {
            0 => drop(lines.remove(at)),
            1 => *line = line.repeat(rng.usize(2..5)),
            2 => *line = format!("{line}{}", odd(rng)),
            _ => {
                let starts: Vec<usize> =
                    line.char_indices().filter(|(_, c)| c.is_ascii_digit()).map(|(i, _)| i).collect();
                if let Some(&start) = starts.get(rng.usize(..starts.len().max(1))) {
                    let end = line[start..]
                        .find(|c: char| !(c.is_ascii_alphanumeric() || c == '.'))
                        .map_or(line.len(), |n| start + n);
                    let by = [
                        "nan",
                        "inf",
                        "-1",
                        "1e308",
                        "1e-320",
                        "0",
                        "18446744073709551616",
                        "1e400",
                        "255",
                        "-0.0",
                        "x",
                    ];
                    line.replace_range(start..end, by[rng.usize(..by.len())]);
                }
            }
        }
    }
    lines.join("\n").into_bytes()
}

/// Returns the bytes after some were changed, removed or inserted.
fn bytes(mut bytes: Vec<u8>, rng: &mut fastrand::Rng) -> Vec<u8> {
    for _ in 0..rng.usize(1..5) {
        let at = rng.usize(..bytes.len().max(1));
        match rng.u8(..4) {
            _ if bytes.is_empty() => bytes.push(rng.u8(..)),
            0 => bytes[at] = rng.u8(..),
            1 => bytes.truncate(at),
            2 => bytes.insert(at, rng.u8(..)),
            _ => bytes[at] ^= 1 << rng.u8(..8),
        }
    }
    bytes
}

/// Returns the document after a change that suits its format.
fn mutated(name: &str, of: &[u8], rng: &mut fastrand::Rng) -> Vec<u8> {
    match rng.u8(..10) {
        0 => bytes(of.to_vec(), rng),
        1 => text(of, rng),
        _ if name.ends_with(".json") => {
            let mut document = serde_json::from_slice(of).expect("JSON");
            changed(&mut document, rng);
            sealed(&document)
        }
        _ if name.ends_with(".toml") => {
            let table: toml::Value = toml::from_str(&String::from_utf8_lossy(of)).expect("TOML");
            let mut document = serde_json::to_value(table).expect("TOML fits JSON");
            changed(&mut document, rng);
            match toml::Value::try_from(&document) {
                Ok(table) => toml::to_string(&table).unwrap_or_default().into_bytes(),
                Err(_) => text(of, rng),
            }
        }
        _ => text(of, rng),
    }
}

/// Returns a run that reads a changed document, or a file of numbers or a picture with changed bytes.
pub fn case(ground: &Ground, rng: &mut fastrand::Rng) -> Case {
    let subject = &SUBJECTS[rng.usize(..SUBJECTS.len())];
    let (whole, run) = (subject.whole, subject.runs[rng.usize(..subject.runs.len())]);
    let mut inside = subject.inside.to_string();
    if rng.u8(..6) == 0 && !inside.is_empty() {
        // Sometimes the change is in any other file of the folder, such as a chunk, a picture or a table.
        let start = format!("base/{whole}/");
        let of: Vec<&str> = ground.files.keys().filter_map(|name| name.strip_prefix(&start)).collect();
        inside = of[rng.usize(..of.len())].into();
    }
    let (from, to) = match inside.is_empty() {
        true => (format!("base/{whole}"), format!("in/{whole}")),
        false => (format!("base/{whole}/{inside}"), format!("in/{whole}/{inside}")),
    };
    // A run with a display file names the file. The other runs name the folder.
    let named = if whole == "bench" { "in/bench/bench.toml".into() } else { format!("in/{whole}") };
    let is = mutated(&from, &ground.files[&from], rng);
    let mut case =
        Case::default().put(&format!("in/{whole}"), Put::Copy(format!("base/{whole}"))).put(&to, Put::Bytes(is));
    case.args =
        run.split(' ').filter(|w| !w.is_empty()).map(|arg| word(arg.replace("{}", &named).as_bytes())).collect();
    if rng.u8(..8) == 0 && ["encode", "solve", "display", "convert"].iter().any(|name| case.args[0] == *name) {
        case.args.push(word(b"--force"));
    }
    case
}
