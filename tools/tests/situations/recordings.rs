//! Situations with recordings of eye trackers.

use crate::frame::{Case, Chapter, Outcome, Remedy, Situation, case, change, convert, mended};
use crate::judge::Judge;
use crate::write::file;
use serde_json::{Value, json};
use std::path::Path;

const COUNT: usize = 20;

/// Returns the horizontal position of the pupil in a sample [mm] and the time of the sample [s].
fn place(i: usize) -> (f64, f64) {
    (3.0 + 0.01 * i as f64, 5.0 + 0.01 * i as f64)
}

/// Returns one line for each sample that `sample` makes.
fn lines(sample: impl Fn(usize) -> Value) -> String {
    (0..COUNT).map(|i| sample(i).to_string() + "\n").collect()
}

fn usual(i: usize) -> Value {
    let (x, t) = place(i);
    json!({ "t": t, "x": x, "y": -1.0, "diameter": 4.0 })
}

/// Returns the usual recording with times that `time` converts.
fn at_time(time: impl Fn(f64) -> f64) -> String {
    lines(|i| json!({ "t": time(place(i).1), "x": place(i).0, "y": -1.0, "diameter": 4.0 }))
}

const ALL: Judge = Judge::By(|outcome| moves(outcome, COUNT, &["combined"]));
const ALTERNATING: Judge = Judge::By(|outcome| moves(outcome, COUNT, &["left", "right"]));

/// Checks that the command prints `count` samples, 10 ms apart, with the right positions, of these eyes in turn.
fn moves(outcome: &Outcome, count: usize, eyes: &[&str]) -> Result<(), String> {
    let read = |line: &str| serde_json::from_str::<Value>(line).map_err(|e| e.to_string());
    let samples = outcome.stdout.lines().map(read).collect::<Result<Vec<_>, _>>()?;
    if samples.len() != count {
        return Err(format!("{} samples: {}", samples.len(), outcome.stderr));
    }
    let first = samples[0]["t"].as_f64().unwrap_or(f64::NAN);
    for (i, sample) in samples.iter().enumerate() {
        let (x, t) = place(i);
        let eye = &sample[eyes[i % eyes.len()]];
        let is = |value: &Value, right: f64, error: f64| value.as_f64().is_some_and(|v| (v - right).abs() < error);
        if !is(&eye["x"], x, 1e-6) || !is(&eye["y"], -1.0, 1e-6) || !is(&sample["t"], first + t - place(0).1, 1e-3) {
            return Err(format!("sample {i} is {sample}"));
        }
    }
    Ok(())
}

fn bytes(have: &str, bytes: impl Fn() -> Vec<u8> + Send + Sync + 'static) -> Case {
    case(have, "tracker watch r.jsonl --json", move |at| file(&at.join("r.jsonl"), bytes()))
}

fn recording(have: &str, text: impl Fn() -> String + Send + Sync + 'static) -> Case {
    bytes(have, move || text().into_bytes())
}

/// Writes the usual recording and replaces a wrong one.
fn repaired(at: &Path) {
    file(&at.join("r.jsonl"), lines(usual));
}

/// Returns situations with recordings that eyebox reads.
fn read() -> Vec<Situation> {
    vec![
        recording("Seconds and millimeters.", || lines(usual)).right(ALL),
        recording("The clock is negative, as Pupil Core's may be.", || at_time(|t| t - 323_801.0)).right(ALL),
        recording("The clock counts seconds since 1970.", || at_time(|t| t + 1.75e9)).right(ALL),
        recording("The clock counts milliseconds.", || at_time(|t| 1e3 * t)).right(ALL),
        recording("The clock counts microseconds.", || at_time(|t| 1e6 * t)).right(ALL),
        recording("The clock counts nanoseconds.", || at_time(|t| (1e9 * t).round())).right(ALL),
        recording("The clock was set back by two seconds.", || at_time(|t| if t > 5.095 { t - 2.0 } else { t }))
            .right(ALL),
        recording("Positions and diameters are in meters.", || {
            lines(|i| json!({ "t": place(i).1, "x": 1e-3 * place(i).0, "y": -1e-3, "diameter": 4e-3 }))
        })
        .right(ALL),
        recording("Positions and diameters are in micrometers.", || {
            lines(|i| json!({ "t": place(i).1, "x": 1e3 * place(i).0, "y": -1e3, "diameter": 4e3 }))
        })
        .right(ALL),
        recording("Diameters are NaN, as Python writes them.", || {
            lines(usual).replace("\"diameter\":4.0", "\"diameter\":NaN")
        })
        .right(ALL),
        recording("Diameters are null.", || lines(usual).replace("\"diameter\":4.0", "\"diameter\":null")).right(ALL),
        recording("Diameters are impossible.", || lines(usual).replace("\"diameter\":4.0", "\"diameter\":40.0"))
            .right(ALL),
        recording("Each line has keys that eyebox does not read.", || {
            lines(usual).replace("{", "{\"mood\":\"fine\",\"model\":[1,2],")
        })
        .right(ALL),
        recording("One eye per line in turn, under its name.", || {
            lines(|i| {
                let (x, t) = place(i);
                let eye = if i % 2 == 0 { "left" } else { "right" };
                json!({ "t": t, eye: { "x": x, "y": -1.0, "diameter": 4.0 } })
            })
        })
        .right(ALTERNATING),
        recording("One eye per line in turn, named by a key.", || {
            lines(|i| {
                let (x, t) = place(i);
                json!({ "t": t, "eye": if i % 2 == 0 { "left" } else { "right" }, "x": x, "y": -1.0 })
            })
        })
        .right(ALTERNATING),
        recording("One eye per line in turn, with Pupil Core's numbers.", || {
            lines(|i| {
                let (x, t) = place(i);
                json!({ "t": t, "eye": (i + 1) % 2, "x": x, "y": -1.0 })
            })
        })
        .right(ALTERNATING),
        recording("The last line was cut off.", || {
            let all = lines(usual);
            all[..all.len() - 20].into()
        })
        .right(Judge::By(|outcome| moves(outcome, COUNT - 1, &["combined"]))),
        recording("A recording of Windows.", || lines(usual).replace('\n', "\r\n")).right(ALL),
        recording("A recording with a byte order mark.", || format!("\u{feff}{}", lines(usual))).right(ALL),
        bytes("A recording in UTF-16.", || {
            [0xfeff].into_iter().chain(lines(usual).encode_utf16()).flat_map(u16::to_le_bytes).collect()
        })
        .right(ALL),
    ]
}

/// Returns situations with recordings that eyebox refuses.
fn refused() -> Vec<Situation> {
    vec![
        recording("A table of another tracker was renamed.", || {
            let row = |i| format!("{},{},-1,4\n", place(i).1, place(i).0);
            format!("timestamp,pupil_x,pupil_y,diameter\n{}", (0..COUNT).map(row).collect::<String>())
        })
        .refused("tracker/file/not-json", mended("each sample is a line such as {\"t\": 12.5", repaired), ALL),
        recording("All samples are in one JSON array.", || {
            let all: Vec<String> = (0..COUNT).map(|i| usual(i).to_string()).collect();
            format!("[{}]\n", all.join(", "))
        })
        .refused("tracker/file/not-json", mended("each sample is a line such as", repaired), ALL),
        recording("A recording is empty.", String::new).refused(
            "tracker/file/no-samples",
            mended("each sample is a line such as", repaired),
            ALL,
        ),
        recording("Positions have other names.", || lines(|i| json!({ "t": place(i).1, "pos_x": 3.0, "pos_y": 1.0 })))
            .refused("tracker/file/no-position", mended("expected x and y", repaired), ALL),
        recording("Samples have no time.", || lines(|i| json!({ "x": place(i).0, "y": -1.0, "diameter": 4.0 })))
            .refused("tracker/file/no-time", mended("add t", repaired), ALL),
        recording("The times are numbers of frames.", || {
            lines(|i| json!({ "t": i, "x": place(i).0, "y": -1.0, "diameter": 4.0 }))
        })
        .refused("tracker/time-unit r.jsonl", change("t_unit", repaired), ALL),
        recording("Positions are in meters, and no diameter shows it.", || {
            // The eye looks around for three seconds.
            let x = |i: usize| 3e-3 * (0.1 * i as f64).sin();
            (0..300).map(|i| json!({ "t": place(i).1, "x": x(i), "y": -1e-3 }).to_string() + "\n").collect()
        })
        .refused("tracker/position-unit r.jsonl", mended("unit", repaired), ALL),
        recording("An eye has an unknown name.", || {
            lines(|i| json!({ "t": place(i).1, "eye": "OD", "x": 3.0, "y": 1.0 }))
        })
        .refused("tracker/file", change("\"left\" \"right\"", repaired), ALL),
        case("A table of another tracker.", "tracker watch r.csv --json", |at| {
            file(&at.join("r.csv"), "timestamp,x,y\n5.0,3.0,-1.0\n");
        })
        .refused("tracker/spec", convert("FILE.jsonl", "r.csv", "r.jsonl", repaired), ALL),
        case("The name of a recording is misspelled.", "tracker watch s.jsonl --json", repaired).refused(
            "tracker/file",
            Remedy::As("s.jsonl", "s.jsonl", "r.jsonl"),
            ALL,
        ),
    ]
}

pub fn chapter() -> Chapter {
    let mut situations = read();
    situations.extend(refused());
    Chapter {
        title: "Recordings of eye trackers",
        about: "Twenty samples, 10 ms apart. `tracker watch` prints them as eyebox reads them.",
        situations,
    }
}
