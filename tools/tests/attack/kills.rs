//! Ends jobs by force at random moments. Other commands can open the remaining files, and the same command continues
//! from them. Files that follow from a seed then have the same bytes.
//!
//! `EYEBOX_KILLS=200 cargo test --workspace --test attack -- kills --nocapture` ends each job at 200 moments.
//! `EYEBOX_ATTACK_ONLY=tiles` selects one job.

use crate::case::program;
use crate::stated;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const FAR: &str = "name = \"far\"\nresolution = [192, 192]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n\
                   geometry = \"far-field\"\n";
const SMALL: [&str; 10] = ["--size", "40x48", "--color", "green", "--engine", "cpu", "--views", "3", "--frames", "2"];

/// A command that the test ends by force.
struct Job {
    name: &'static str,
    args: Vec<&'static str>,
    /// The file or folder that the job writes.
    out: &'static str,
    /// The arguments of a command that opens the remaining files of the job.
    opens: Vec<&'static str>,
    /// The job runs until the test ends it.
    endless: bool,
    /// Returns whether a file of the job follows from its seed.
    same: fn(&str) -> bool,
}

fn jobs() -> Vec<Job> {
    let look = ["render", "out.zarr", "--pupil=0,0,0.5,0", "--engine", "cpu", "-o", "seen.png"];
    let scenes = ["solve", "builtin:plane?depth=-1", "builtin:plane?depth=0", "builtin:plane?depth=1"];
    let tiles = [
        "solve",
        "builtin:plane",
        "--display",
        "far.toml",
        "--memory",
        "600MiB",
        "--pupil-diameter",
        "0.2..0.4",
        "--set",
        "tiles.picture=64",
        "--set",
        "tiles.passes=1",
        "--frames",
        "1",
        "--engine",
        "cpu",
        "-o",
        "out.zarr",
    ];
    let compare = [
        "eval",
        "compare",
        "builtin:plane",
        "--methods",
        "slfh,dpac",
        "--set",
        "compare.speckle=false",
        "--steps",
        "2",
        "-o",
        "out",
    ];
    let tune = ["eval", "tune", "builtin:plane", "--duration", "1", "--no-store", "-o", "out"];
    let record = ["tracker", "record", "simulated:3", "--tracker-rate", "500", "-o", "out.jsonl"];
    let all: fn(&str) -> bool = |_| true;
    let job = |name, args: &[&[&'static str]], out, opens: &[&'static str]| Job {
        name,
        args: args.concat(),
        out,
        opens: opens.to_vec(),
        endless: false,
        same: all,
    };
    vec![
        job("whole", &[&scenes[..2], &SMALL, &["--steps", "4", "-o", "out.zarr"]], "out.zarr", &look),
        job(
            "sequence",
            &[&scenes, &SMALL, &["--steps", "2", "-o", "out.zarr"]],
            "out.zarr",
            &[&look[..], &["--at", "0"]].concat(),
        ),
        job("tiles", &[&tiles], "out.zarr", &look),
        job(
            "encode",
            &[&["encode", "kept.zarr", "--display", "planes8", "--size", "40x48", "-o", "out"]],
            "out",
            &[&["render", "out", "--encoded"], &look[2..]].concat(),
        ),
        Job {
            same: |name| name.starts_with("holograms/") && !name.ends_with(".json") || name == "scores.csv",
            ..job("compare", &[&compare, &SMALL[..6]], "out", &[])
        },
        Job { same: |_| false, ..job("tune", &[&tune, &SMALL[..6]], "out", &[]) },
        Job { endless: true, ..job("record", &[&record], "out.jsonl", &["tracker", "watch", "out.jsonl"]) },
    ]
}

fn command(at: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(program());
    command.args(args).current_dir(at).env("XDG_CACHE_HOME", at.join("cache"));
    command.stdin(Stdio::null());
    command
}

fn done(at: &Path, args: &[&str]) -> Output {
    let answer = command(at, args).output().expect("the command starts");
    assert!(answer.status.success(), "{args:?}: {}", String::from_utf8_lossy(&answer.stderr));
    answer
}

/// Returns the files below `out` for which `same` is true, by their names.
fn contents(out: &Path, same: fn(&str) -> bool) -> BTreeMap<String, Vec<u8>> {
    let (mut found, mut left) = (BTreeMap::new(), vec![out.to_path_buf()]);
    while let Some(next) = left.pop() {
        if next.is_file() {
            let name = next.strip_prefix(out).expect("inside").display().to_string();
            if same(&name) {
                found.insert(name, fs::read(&next).expect("read"));
            }
            continue;
        }
        left.extend(fs::read_dir(next).expect("a folder").map(|e| e.expect("an entry").path()));
    }
    found
}

impl Job {
    /// Makes a folder with the inputs of the job.
    fn place(&self) -> tempfile::TempDir {
        let here = tempfile::tempdir().expect("a folder");
        fs::write(here.path().join("far.toml"), FAR).expect("written");
        if self.name == "encode" {
            let args =
                [&["solve", "builtin:plane", "--steps", "2", "-o", "kept.zarr"], &SMALL[..8], &["--frames", "8"]];
            done(here.path(), &args.concat());
        }
        here
    }

    /// Ends the job by force after a time, opens the remaining files, and runs the job again to its end.
    fn end_at(&self, at: &Path, after: Duration, whole: &BTreeMap<String, Vec<u8>>) {
        let mut child =
            command(at, &self.args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the command starts");
        std::thread::sleep(after);
        // This sends SIGKILL, so the command cannot clean up.
        child.kill().expect("killed");
        child.wait().expect("ended");
        let case = || format!("{} ended after {after:?}", self.name);
        let out = at.join(self.out);
        if out.exists() && !self.opens.is_empty() {
            let answer = command(at, &self.opens).output().expect("the command starts");
            let said = String::from_utf8_lossy(&answer.stderr);
            // A sequence without its first hologram has no view to render.
            let none = self.name == "sequence" && said.contains("it has no hologram 0");
            assert!(answer.status.success() || (none && answer.status.code() == Some(2)), "{}: {said}", case());
        }
        if self.endless {
            let _ = fs::remove_file(&out);
            return;
        }
        done(at, &self.args);
        let now = contents(&out, self.same);
        let names = |all: &BTreeMap<String, Vec<u8>>| all.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&now), names(whole), "{}", case());
        for (name, bytes) in &now {
            assert!(*bytes == whole[name], "{}: {name} differs", case());
        }
        let drafts = contents(at, |name| name.ends_with(".part"));
        assert!(drafts.is_empty(), "{}: {:?} remain", case(), names(&drafts));
        let _ = if out.is_dir() { fs::remove_dir_all(out) } else { fs::remove_file(out) };
    }
}

#[test]
fn kills_at_random_moments_lose_nothing_that_was_whole() {
    let (moments, seed) = (stated("EYEBOX_KILLS").unwrap_or(2), stated("EYEBOX_ATTACK_SEED").unwrap_or(1));
    let only = std::env::var("EYEBOX_ATTACK_ONLY").ok();
    let meant = |job: &(usize, Job)| only.as_deref().is_none_or(|only| only == job.1.name);
    for (i, job) in jobs().into_iter().enumerate().filter(meant) {
        let here = job.place();
        let at = here.path();
        let begun = Instant::now();
        let whole = if job.endless {
            BTreeMap::new()
        } else {
            done(at, &job.args);
            contents(&at.join(job.out), job.same)
        };
        let took = if job.endless { Duration::from_secs(3) } else { begun.elapsed() };
        let out = at.join(job.out);
        let _ = if out.is_dir() { fs::remove_dir_all(out) } else { fs::remove_file(out) };
        let mut rng = fastrand::Rng::with_seed(seed ^ (i as u64 + 1) << 32);
        for _ in 0..moments {
            job.end_at(at, took.mul_f64(rng.f64() * 1.05), &whole);
        }
        println!("{}: {moments} moments of {took:.1?}", job.name);
    }
}
