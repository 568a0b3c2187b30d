//! Digests of results that must not change. The command computes these results on the CPU engine with fixed seeds. The
//! order of sums is part of the contract, so solves, views and encodings stay byte-identical. If one has to change, the
//! commit states the reason and the size of the change.
//!
//! The digests cover values (phases, intensities, pixels) and not files, because the metadata of files may grow.
//! `EYEBOX_GOLDEN=write` writes the digests again. `EYEBOX_BINARY=FILE` uses the command of another build.

#[path = "command/common/mod.rs"]
mod common;

use common::{command, folder, program};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The digests by instruction set. Transforms split sums by the width of its vectors. AVX-512 has the digests of AVX2.
const DIGESTS: [(&str, &str, &str); 2] = [
    ("AVX", "digests.txt", include_str!("golden/digests.txt")),
    ("NEON", "digests-neon.txt", include_str!("golden/digests-neon.txt")),
];

/// A far field that is small enough to solve in a second, also in tiles.
const FAR: &str = "name = \"far\"\nresolution = [192, 192]\npitch_um = 4.0\nfocal_length_mm = 400.0\n\
                   wavelengths_nm = { green = 520 }\ngeometry = \"far-field\"\n";

/// Runs lines of the command in one folder and digests their results.
struct Golden {
    temp: tempfile::TempDir,
    binary: PathBuf,
    found: BTreeMap<String, String>,
}

impl Golden {
    fn new() -> Self {
        let temp = folder();
        std::fs::write(temp.path().join("far.toml"), FAR).unwrap();
        Self { temp, binary: program().into(), found: BTreeMap::new() }
    }

    fn run(&self, line: &str) {
        let args: Vec<&str> = line.split_whitespace().collect();
        let mut command = Command::new(&self.binary);
        command.args(&args).current_dir(self.temp.path()).env("XDG_CACHE_HOME", self.temp.path().join("cache"));
        let answer = command.output().expect("the command starts");
        assert!(answer.status.success(), "eyebox {line}: {}", String::from_utf8_lossy(&answer.stderr));
    }

    /// Runs the command with the output `out` and stores the digest of this output under the name `out`.
    fn keep(&mut self, line: &str, out: &str) {
        self.run(&format!("{line} -o {out}"));
        self.digest(out);
    }

    /// Converts a hologram to its phases and stores their digest.
    fn convert(&mut self, hologram: &str, out: &str, more: &str) {
        self.run(&format!("convert {hologram} {out} {more}"));
        self.digest(out);
    }

    fn digest(&mut self, out: &str) {
        let digest = digest(&self.temp.path().join(out));
        self.found.insert(out.to_owned(), digest);
    }

    /// Solves a hologram and stores the digest of its phases.
    fn solve(&mut self, name: &str, line: &str) {
        self.run(&format!("solve {line} --engine cpu -o {name}.zarr"));
        self.convert(&format!("{name}.zarr"), &format!("{name}.npy"), "");
    }
}

/// Returns the digest of an array's bytes, of a picture's pixels, or of all files of a folder in the order of their
/// names.
fn digest(path: &Path) -> String {
    let mut hash = Sha256::new();
    add(path, &mut hash);
    hash.finalize()[..12].iter().map(|b| format!("{b:02x}")).collect()
}

fn add(path: &Path, hash: &mut Sha256) {
    if path.is_dir() {
        let mut files: Vec<_> = std::fs::read_dir(path).unwrap().map(|e| e.unwrap().path()).collect();
        files.sort();
        assert!(!files.is_empty(), "{} is empty", path.display());
        return files.iter().for_each(|file| add(file, hash));
    }
    match path.extension().and_then(|e| e.to_str()) {
        Some("png") => {
            let picture = image::open(path).unwrap();
            hash.update(format!("{:?} {} {}", picture.color(), picture.height(), picture.width()));
            hash.update(picture.as_bytes());
        }
        Some("npy" | "raw") => hash.update(std::fs::read(path).unwrap()),
        // The other files only describe the frames.
        _ => {}
    }
}

fn solves(g: &mut Golden) {
    let small = "builtin:still-life --size 40x48 --steps 3 --frames 2 --pupils 4";
    let one = format!("{small} --color green");
    for (name, more) in [
        ("projection", ""),
        ("adam", "--set optimizer=adam"),
        ("window-2", "--set window=2"),
        ("window-full", "--set window=full"),
        ("halves", "--set storage=fp16"),
        ("levels", "--set levels=4"),
        ("seed", "--seed 7 --set sequence=random --set diameters=reciprocal"),
        ("efficiency", "--set efficiency=0.4"),
        ("padding", "--set padding=always --depth=-3..3"),
        ("full", "--set full=all"),
        ("lf2fs", "--method lf2fs"),
        ("stft", "--method stft --set stft_samples=3"),
        ("stft-exact", "--method stft-exact"),
        ("stft-unfiltered", "--method stft-unfiltered"),
        ("smooth", "--method smooth"),
        ("dpac", "--method dpac"),
        ("pupil-aware", "--method pupil-aware"),
        ("pupil-aware-adam", "--method pupil-aware --set optimizer=adam"),
    ] {
        g.solve(name, &format!("{one} {more}"));
    }
    g.solve("colors", "builtin:still-life --size 40x48 --steps 3 --frames 8 --pupils 4");
    g.solve("plm", "builtin:still-life --size 36x44 --steps 2 --frames 8 --pupils 4 --display plm");
    g.solve("balanced", "builtin:still-life --size 40x48 --frames 2 --color blue --quality balanced --steps 6");
    g.solve("far", "builtin:still-life --display far.toml --color green --steps 3 --frames 2 --pupils 4");
    g.solve("points", "builtin:points --size 40x48 --color red --steps 3 --frames 2");
    g.solve("grass", "builtin:dense-grass --size 36x44 --color green --steps 3 --frames 2");
    g.run(
        "solve builtin:still-life --display far.toml --frames 2 --memory 200MiB --pupil-diameter 0.2..0.4 --set tiles.picture=64 \
         --set tiles.passes=1 --steps 2 --engine cpu -o tiles.zarr",
    );
    g.run("solve builtin:still-life builtin:still-life?camera=1 --size 24x32 --steps 3 --frames 8 --engine cpu -o moving.zarr");
    for at in [0, 1] {
        g.convert("moving.zarr", &format!("moving-{at}.npy"), &format!("--at {at}"));
    }
}

fn looks(g: &mut Golden) {
    let pupil = "--pupil=4,-2,4,1.5";
    for out in ["view.npy", "view.png"] {
        g.keep(&format!("render colors.zarr {pupil} --engine cpu"), out);
    }
    g.keep(&format!("render padding.zarr {pupil} --engine cpu"), "view-padded.npy");
    g.keep("render far.zarr --pupil=0.2,-0.1,0.3,0 --engine cpu", "view-far.npy");
    g.keep("render tiles.zarr --pupil=0.2,-0.1,0.3,0 --engine cpu", "view-tiles.npy");
    g.keep(&format!("render moving.zarr --at 1 {pupil} --engine cpu"), "view-moving.npy");
    let scene = "builtin:still-life --size 40x48 --engine cpu";
    for out in ["photograph.npy", "photograph.png"] {
        g.keep(&format!("render {scene} {pupil}"), out);
    }
    g.keep(&format!("render {scene} --views 3 --color green --pupil=0,0,18,-1"), "photograph-3.npy");
    for i in 0..9 {
        let (x, y) = ((i % 3 - 1) * 7, (i / 3 - 1) * 7);
        std::fs::create_dir_all(g.temp.path().join("views")).unwrap();
        g.run(&format!(
            "render builtin:still-life --size 40x48 --views 3 --engine cpu --pupil={x},{y},2,0 -o views/view_{i:02}.png"
        ));
    }
    g.solve("folder", "views --size 40x48 --color green --steps 3 --frames 2");
    g.run(&format!("refine colors.zarr builtin:still-life {pupil} --steps 3 --engine cpu -o refined.zarr"));
    g.convert("refined.zarr", "refined.npy", "");
    g.run("refine tiles.zarr builtin:still-life --pupil=0.2,-0.1,0.3,0 --steps 2 --engine cpu -o refined-tiles.zarr");
    g.keep("render refined-tiles.zarr --pupil=0.2,-0.1,0.3,0 --engine cpu", "view-refined-tiles.npy");
}

fn encodings(g: &mut Golden) {
    for (display, hologram, size) in [
        ("paper", "colors", "40x48"),
        ("plm", "plm", "36x44"),
        ("small", "colors", "40x48"),
        ("grey8", "colors", "40x48"),
        ("fields", "colors", "40x48"),
        ("planes8", "colors", "40x48"),
        ("planes24", "colors", "40x48"),
    ] {
        g.keep(
            &format!("encode {hologram}.zarr --display {display} --size {size} --engine cpu"),
            &format!("frames-{display}"),
        );
    }
    g.run("show moving.zarr --display planes24 --size 24x32 --record shown --clock simulated --duration 0.2");
    g.digest("shown");
}

/// Returns the file and the digests for the instruction set that the command uses, or `None` if none were recorded.
fn comparable(golden: &Golden) -> Option<(&'static str, &'static str)> {
    let line =
        "solve builtin:still-life --size 8x8 --frames 1 --steps 1 --color green --engine cpu --json -o small.zarr";
    let answer =
        command(golden.temp.path(), &line.split(' ').collect::<Vec<_>>()).output().expect("the command starts");
    let report: serde_json::Value = serde_json::from_slice(&answer.stdout).expect("JSON");
    let engine = report["engine"].as_str().expect("an engine");
    let found = DIGESTS.iter().find(|(instructions, ..)| engine.contains(instructions));
    if found.is_none() {
        eprintln!("not compared: no digests were recorded with the instruction set of {engine}");
    }
    found.map(|(_, file, digests)| (*file, *digests))
}

#[test]
fn what_is_computed_stays_the_same_bytes() {
    let mut golden = Golden::new();
    let Some((file, digests)) = comparable(&golden) else { return };
    solves(&mut golden);
    looks(&mut golden);
    encodings(&mut golden);
    let found: String = golden.found.iter().map(|(name, digest)| format!("{digest} {name}\n")).collect();
    if std::env::var_os("EYEBOX_GOLDEN").is_some_and(|v| v == "write") {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(file), &found).unwrap();
        return;
    }
    let changed: Vec<&str> = found.lines().filter(|line| !digests.lines().any(|l| l == *line)).collect();
    assert!(changed.is_empty(), "these results changed:\n{}", changed.join("\n"));
    assert_eq!(found.lines().count(), digests.lines().count(), "a result is missing");
}
