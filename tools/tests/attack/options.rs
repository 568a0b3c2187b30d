//! Gives odd values to every option of every command. The options come from the command's own help.

use crate::case::{Case, word};
use crate::ground::Ground;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// An option that takes a value, and the name of the value in the help.
#[derive(Clone)]
pub struct Opt {
    pub name: String,
    pub hint: String,
}

impl Opt {
    /// Returns whether the command writes to the value. The help uses the name `OUT...` for these values only.
    pub fn is_output(&self) -> bool {
        self.hint.starts_with("OUT")
    }
}

/// Short sound runs of every command. An attack changes one thing of a run.
pub const SOUND: [&str; 41] = [
    "demo --size 16 --engine cpu --out out/demo",
    "solve builtin:plane --size 16x16 --steps 1 --frames 1 --color green --engine cpu -o out/x.zarr --json",
    "solve base/views --size 16x16 --steps 1 --frames 1 --engine cpu -o out/x.npy --order as-named",
    "solve base/photo.png --depth-map base/depth.png --views 2 --size 16x16 --steps 1 --frames 1 --color green --engine cpu -o out/x.zarr",
    "solve base/photo.exr --depth-map base/depth.pfm --near large --views 2 --size 16x16 --steps 1 --frames 1 --engine cpu -o out/x.zarr",
    "solve builtin:plane --display base/far.toml --frames 1 --memory 600MiB --pupil-diameter 0.2..0.4 --set tiles.picture=32 --set tiles.passes=1 --steps 1 --engine cpu -o out/far.zarr",
    "solve builtin:plane builtin:points --size 16x16 --steps 1 --frames 1 --color green --engine cpu -o out/x.zarr",
    "solve builtin:plane --size 16x16 --steps 2 --frames 2 --set optimizer=adam --settings base/slm.toml --color green --engine cpu -o out/x.zarr",
    "solve builtin:plane --dry-run --size 16x16 --color green --engine cpu",
    "info base/views --size 16x16 -o out/views.png",
    "render base/h.zarr --pupil=0,0,1,0 --engine cpu -o out/seen.png",
    "render base/far.zarr --pupil=0,0,0.3,0 --engine cpu -o out/seen.npy",
    "render base/phases.npy --display small --size 16x16 --color green --pupil=0,0,1,0 --engine cpu -o out/seen.png",
    "render base/frames --pupil=0,0,1,0 --engine cpu -o out/seen.png",
    "render builtin:plane --size 16x16 --color green --pupil=0,0,1,0 --engine cpu -o out/wanted.png",
    "refine base/h.zarr builtin:plane --pupil=0,0,1,0 --steps 1 --engine cpu -o out/x.zarr",
    "show base/h.zarr --tracker simulated --display grey8 --size 16x16 --duration 0.05 --engine cpu --stats out/stats.json",
    "show base/h.zarr --display grey8 --size 16x16 --duration 0.05 --engine cpu --tracker base/eye.jsonl --trace out/trace.json",
    "eval gaze base/h.zarr --display grey8 --size 16x16 --duration 0.1 --engine cpu -o out/study",
    "eval gaze base/h.zarr --display grey8 --size 16x16 --set gaze.content=still --set gaze.sets=2 --engine cpu -o out/study",
    "eval score base/h.zarr builtin:plane --test-pupils base/pupils.json --engine cpu --json",
    "eval score base/rgb.zarr builtin:plane --test-pupils random:2 --engine cpu",
    "eval score base/h.zarr builtin:plane --test-pupils random:1 --settings base/tables.toml --set viewing.black=1 --engine cpu",
    "eval tune builtin:plane --size 16x16 --color green --frames 1 --duration 0.01 --no-store --engine cpu -o out/tune",
    "eval compare builtin:plane --size 16x16 --color green --frames 1 --steps 1 --methods dpac --views 2 --set compare.speckle=false --engine cpu -o out/compare",
    "convert base/moving.zarr out/phases.npy --at 1",
    "convert base/pictures out/x.zarr --display base/bench/bench.toml --color green",
    "encode base/rgb.zarr --display base/bench/bench.toml --engine cpu -o out/frames",
    "encode base/h.zarr --display base/planes.toml --engine cpu -o out/frames --json",
    "show base/moving.zarr --display grey8 --size 16x16 --output offscreen --clock simulated --engine cpu --stats out/played.json",
    "show base/h.zarr --display grey8 --size 16x16 --output offscreen --duration 0.05 --engine cpu --record out/shown --trace out/trace.json",
    "show base/h.zarr --display grey8 --size 16x16 --output raw:out/frames.raw --duration 0.05 --engine cpu",
    "show base/moving.zarr --display grey8 --size 16x16 --output offscreen --clock simulated --set show.sync=0.01 --set show.speed=3 --engine cpu",
    "preview base/h.zarr",
    "display monitors",
    "bench builtin:plane --size 16x16 --color green --frames 1 --steps 1 --rounds 1 --engine cpu",
    "display check base/bench/bench.toml",
    "tracker watch base/eye.jsonl --predict",
    "tracker record simulated:3 --duration 0.1 -o out/eye.jsonl --calibration base/ada.toml --predict 20",
    "tracker watch base/eye.hid --device-file base/device.toml",
    "tracker describe base/descriptor.txt --json",
];

/// Numbers, words and sizes that most options do not expect.
const ODD: [&str; 51] = [
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "-0",
    "0",
    "-1",
    "1",
    "2",
    "3",
    "1e-320",
    "1e-9",
    "1e9",
    "0.5",
    "1e400",
    "64",
    "1000",
    "100000",
    "65536",
    "2147483648",
    "4294967296",
    "9223372036854775808",
    "18446744073709551615",
    "18446744073709551616",
    "",
    " ",
    "\u{fc}",
    "\u{202e}\u{0}a",
    "0x10",
    "1/0",
    "1000000000/1",
    "0/1",
    "1,2",
    "..",
    "--",
    "cold",
    "full",
    "random:100000",
    "random:0",
    "0D",
    "1e308D",
    "nanGiB",
    "1e17",
    "0m",
    "-1mm",
    "1e308GiB",
    "1e400Hz",
    "-3..3mm",
    "-1mm,0,4mm,2m",
    "4k",
];

/// Keys of the tables of settings, with the form of their values in help texts and a good value. No value names an
/// output.
const KEYS: [(&str, &str, &str); 42] = [
    ("camera.every", "MINUTES", "1e-3"),
    ("camera.iris", "X,Y,DIAMETER", "0.6,-0.4,9"),
    ("camera.pictures", "N", "20"),
    ("camera.settle", "SECONDS", "0"),
    ("camera.timeout", "SECONDS", "500ms"),
    ("compare.coherence", "LIST", "0,0.5"),
    ("compare.etendue", "LIST", "1,2d"),
    ("compare.reference", "CSV", "base/numbers.csv"),
    ("compare.sources", "true|false", "true"),
    ("compare.speckle", "true|false", "true"),
    ("gaze.blinks", "N", "20"),
    ("gaze.content", "LIST", "still,moving"),
    ("gaze.encode_time", "MS", "1"),
    ("gaze.eye_seed", "S", "7"),
    ("gaze.fixation", "MS", "0.25s"),
    ("gaze.jumps_every", "N", "2"),
    ("gaze.jumps_from", "table|last|random", "last"),
    ("gaze.jumps_to", "SCENE,...", "builtin:points,builtin:plane"),
    ("gaze.moves", "PX", "8px"),
    ("gaze.pursuit", "SHARE", "0.5"),
    ("gaze.sets", "N", "3"),
    ("gaze.step_time", "MS", "2"),
    ("gaze.steps_per_set", "N", "1"),
    ("gaze.tracker_delay", "MS", "8ms"),
    ("gaze.tracker_noise", "MM", "0.02"),
    ("gaze.whole_sets", "true|false", "true"),
    ("show.ahead", "N", "2"),
    ("show.ask", "views|depth|layers", "depth"),
    ("show.display_latency", "MS", "5"),
    ("show.encode_time", "MS", "1"),
    ("show.keep_phase", "true|false", "true"),
    ("show.mark", "PX", "4"),
    ("show.moments", "on|off", "off"),
    ("show.speed", "FACTOR", "2"),
    ("show.step_time", "MS", "3"),
    ("show.sync", "S", "0.01"),
    ("show.whole_sets", "true|false", "true"),
    ("tiles.passes", "N", "1"),
    ("tiles.picture", "N", "32"),
    ("viewing.black", "CD/M2", "0.5"),
    ("viewing.luminance", "CD/M2", "100"),
    ("viewing.pixels_per_degree", "N", "20"),
];

/// The tables that each command reads. Other commands only store their values.
const TABLES: [(&str, &[&str]); 7] = [
    ("bench", &["camera.", "tiles.", "viewing."]),
    ("eval compare", &["compare.", "viewing."]),
    ("eval gaze", &["gaze.", "viewing."]),
    ("eval score", &["viewing."]),
    ("eval tune", &["viewing."]),
    ("show", &["show.", "camera."]),
    ("solve", &["camera.", "tiles.", "viewing."]),
];

/// TOML values that no key takes, and keys that do not exist.
const NO_SETTINGS: [&str; 14] = [
    "gaze=1",
    "gaze.fixation.ms=1",
    "gaze.fixations=1",
    "gaze.=1",
    ".fixation=1",
    "gaze",
    "show.speed",
    "show.speed=",
    "show.speed='2",
    "show.speed={ a = 1 }",
    "viewing.black=[]",
    "viewing.black=[[1], [2]]",
    "tiles.picture=1979-05-27",
    "camera.iris=[true, 'x', 1]",
];

/// Returns the options of every command that take a value, as its help lists them.
pub fn all() -> BTreeMap<String, Vec<Opt>> {
    let names: BTreeSet<String> = SOUND.iter().map(|line| command(&line.split(' ').collect::<Vec<_>>())).collect();
    names.into_iter().map(|name| (name.clone(), of(&name))).collect()
}

/// Returns the words of a run's command. A group and its command are two words.
fn command<T: AsRef<str>>(args: &[T]) -> String {
    let words = args.iter().map(AsRef::as_ref).collect::<Vec<_>>();
    let nested = ["device", "display", "eval", "tracker"].contains(&words[0]);
    words[..1 + usize::from(nested)].join(" ")
}

fn of(command: &str) -> Vec<Opt> {
    let words = ["help"].into_iter().chain(command.split(' '));
    let answer = Command::new(crate::case::program()).args(words).output().expect("the command starts");
    let text = String::from_utf8(answer.stdout).expect("text");
    let found = text.lines().filter_map(|line| {
        let line = line.trim_start();
        let line = line.strip_prefix("-o, ").unwrap_or(line);
        let end = line.find(|c: char| !(c.is_ascii_lowercase() || c == '-')).unwrap_or(line.len());
        let (name, rest) = line.split_at(end);
        let hint = rest.trim_start_matches(['=', ' ', '[']).strip_prefix('<')?.split('>').next()?;
        name.strip_prefix("--").map(|name| Opt { name: name.into(), hint: hint.into() })
    });
    // The value of this option would run as a shell command.
    let found: Vec<Opt> = found.filter(|opt| opt.name != "beside").collect();
    assert!(text.contains("-h, --help"), "{command} has no help: {text}");
    found
}

/// Returns the words of a random sound run.
pub fn sound(rng: &mut fastrand::Rng) -> Vec<&'static str> {
    SOUND[rng.usize(..SOUND.len())].split(' ').collect()
}

fn odd(rng: &mut fastrand::Rng) -> String {
    match rng.u8(..12) {
        0 => rng.f64().to_string(),
        1 => (f64::from_bits(rng.u64(..))).to_string(),
        2 => rng.i64(..).to_string(),
        3 => rng.i32(-20..20).to_string(),
        4 => std::iter::repeat_with(|| rng.char(..)).take(5).collect::<String>().replace('\0', " "),
        _ => ODD[rng.usize(..ODD.len())].replace('\0', " "),
    }
}

/// Returns a value with odd parts in the form that the help shows, or an odd value of any form.
pub fn value(hint: &str, rng: &mut fastrand::Rng) -> String {
    let parts = |rng: &mut fastrand::Rng, count: usize, between: &str| {
        (0..count).map(|_| odd(rng)).collect::<Vec<_>>().join(between)
    };
    let whole = rng.u8(..4) == 0;
    match hint {
        _ if whole => odd(rng),
        "X,Y,D,Z" => parts(rng, 4, ","),
        "X,Y;X,Y;..." => (0..3).map(|_| parts(rng, 2, ",")).collect::<Vec<_>>().join(";"),
        "MIN..MAX" => parts(rng, 2, ".."),
        "HxW" => parts(rng, 2, "x"),
        "AMOUNT" => odd(rng) + ["KiB", "MiB", "GiB", "TiB", "B"][rng.usize(..5)],
        "LIST" => parts(rng, 3, ","),
        "MM|D" => odd(rng) + "D",
        "NAME=FILE" => format!("mine=base/{}", ["h.zarr", "views", "eye.hid", "none"][rng.usize(..4)]),
        hint if hint.contains("SOURCE") => {
            let sources =
                ["simulated:", "udp://:", "udp://127.0.0.1:", "pupil://127.0.0.1:", "base/eye.jsonl", "hid", "mouse"];
            sources[rng.usize(..sources.len())].to_string() + &odd(rng)
        }
        // The value is often a wrong kind of file, but always a path in the case's folder.
        hint if ["FILE", "DIR", "FOLDER", "CSV", "PRESET"].iter().any(|word| hint.contains(word)) => {
            let files = [
                "base",
                "base/h.zarr",
                "base/eye.hid",
                "base/views",
                "base/photo.jpg",
                "base/phases.npy",
                "base/ada.toml",
                "base/none",
                "base/h.zarr/zarr.json",
                "base/bench/bench.toml",
                "base/frames",
                "base/depth.pfm",
                "paper",
                "-",
                ".",
            ];
            files[rng.usize(..files.len())].into()
        }
        hint if hint.contains("random:N") => format!("random:{}", odd(rng)),
        _ => odd(rng),
    }
}

/// Returns a key of a table with a good value, an odd value of its form or any odd value. The command reads most of
/// these keys.
fn setting(command: &str, rng: &mut fastrand::Rng) -> String {
    if rng.u8(..8) == 0 {
        return NO_SETTINGS[rng.usize(..NO_SETTINGS.len())].into();
    }
    let tables = TABLES.iter().find(|(name, _)| *name == command).filter(|_| rng.u8(..8) > 0);
    let is_read = |key: &str| tables.is_none_or(|(_, tables)| tables.iter().any(|table| key.starts_with(table)));
    let keys: Vec<_> = KEYS.into_iter().filter(|(key, ..)| is_read(key)).collect();
    let (key, hint, good) = keys[rng.usize(..keys.len())];
    match rng.u8(..4) {
        0 => format!("{key}={good}"),
        _ => format!("{key}={}", value(hint, rng)),
    }
}

/// Returns a sound run with odd values for one to three options, and sometimes with settings of tables.
pub fn case(ground: &Ground, rng: &mut fastrand::Rng) -> Case {
    let mut args = sound(rng).into_iter().map(String::from).collect::<Vec<_>>();
    let options = &ground.options[&command(&args)];
    if options.is_empty() {
        return Case::of(&["display", "monitors", "--json"]);
    }
    let mut set = BTreeMap::new();
    for _ in 0..[1, 1, 1, 2, 3][rng.usize(..5)] {
        let opt = &options[rng.usize(..options.len())];
        // Results stay in the case's folder `out`. Other kinds of cases write elsewhere.
        if !opt.is_output() {
            set.insert(opt.name.clone(), value(&opt.hint, rng));
        }
    }
    for (name, value) in &set {
        let flag = format!("--{name}");
        if let Some(at) = args.iter().position(|arg| *arg == flag || arg.starts_with(&format!("{flag}="))) {
            let own_value = args[at] == flag && args.get(at + 1).is_some_and(|next| !next.starts_with("--"));
            args.drain(at..=at + usize::from(own_value));
        }
        args.push(format!("{flag}={value}"));
    }
    if options.iter().any(|opt| opt.name == "set") && rng.u8(..3) == 0 {
        let name = command(&args);
        args.extend((0..rng.usize(1..3)).map(|_| format!("--set={}", setting(&name, rng))));
    }
    if rng.u8(..8) == 0 {
        args.push("--force".into());
    }
    let mut case = Case::of(&[]);
    case.args = args.iter().map(|arg| word(arg.as_bytes())).collect();
    if rng.u8(..100) == 0 {
        case.args.push(word(b"\xff\xfe"));
    }
    case
}
