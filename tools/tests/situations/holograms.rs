//! Situations with holograms that were moved, renamed, damaged or made by an old version.

use crate::common::done;
use crate::frame::{Case, Chapter, Outcome, Remedy, Situation, case, mended};
use crate::judge::Judge;
use crate::made::save;
use crate::write::file;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

const SOLVE: &str = "--size 48x64 --color green --frames 1 --steps 1 --engine cpu";

/// Checks that the hologram was scored against its own scene.
const SCORED: Judge = Judge::By(|outcome| scored(outcome, |own, found| (own - found).abs() < 1e-6));
/// Checks that the hologram was scored against another scene.
const OTHER: Judge = Judge::By(|outcome| scored(outcome, |own, found| (own - found).abs() > 0.1));
/// Checks that the command wrote the phases of one hologram.
const FIRST: Judge = Judge::By(|outcome| {
    let phases = eyebox::low_level::files::read_npy(&outcome.folder.join("p.npy")).map_err(|e| e.to_string())?;
    let right = phases.values.len() == 48 * 64 && phases.values.iter().any(|v| *v != 0.0);
    if right { Ok(()) } else { Err(format!("phases of shape {:?}", phases.shape)) }
});

/// Runs a command that must succeed.
fn run(at: &Path, words: &str) -> String {
    done(at, &words.split_whitespace().collect::<Vec<_>>())
}

/// Copies a folder of views and its hologram, which was solved in another folder.
fn solved(at: &Path) {
    copy(kept(), at);
}

/// Returns the folder that `solved` copies. It was renamed after the solve, so the paths of the solve no longer exist.
fn kept() -> &'static Path {
    static KEPT: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let make = || {
        let temp = crate::common::folder();
        let [first, kept] = ["first", "kept"].map(|name| temp.path().join(name));
        fs::create_dir(&first).expect("a folder");
        solved_here(&first);
        fs::rename(first, &kept).expect("a move");
        (temp, kept)
    };
    &KEPT.get_or_init(make).1
}

/// Saves a folder of views and solves a hologram next to it.
fn solved_here(at: &Path) {
    save(&at.join("a/scene"), |row, column| format!("v_{row}_{column}.png"));
    file(&at.join("pupils.json"), "[[4, -2, 4, 0.5]]");
    run(at, &format!("solve a/scene {SOLVE} -o a/h.zarr"));
}

/// Saves views of another scene under the same names. Their colors are inverted.
fn other(folder: &Path) {
    save(folder, |row, column| format!("v_{row}_{column}.png"));
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let mut view = image::open(entry.path()).expect("a view");
        view.invert();
        view.save(entry.path()).expect("a view");
    }
}

fn psnr(said: &str) -> Option<f64> {
    serde_json::from_str::<Value>(said).ok()?["psnr_db"]["mean"].as_f64()
}

/// Compares a score with the score of the usual hologram against its own scene.
fn scored(outcome: &Outcome, right: impl Fn(f64, f64) -> bool) -> Result<(), String> {
    static OWN: OnceLock<f64> = OnceLock::new();
    let own = *OWN.get_or_init(|| {
        let temp = crate::common::folder();
        solved(temp.path());
        psnr(&run(temp.path(), "eval score a/h.zarr --test-pupils pupils.json --jod none --engine cpu --json"))
            .expect("a score")
    });
    match psnr(&outcome.stdout) {
        Some(found) if right(own, found) => Ok(()),
        found => Err(format!("{found:?} dB, its own scene gives {own} dB")),
    }
}

/// A situation that scores the usual hologram after a change by `how`.
fn score(have: &str, words: &str, how: impl Fn(&Path) + Send + Sync + 'static) -> Case {
    from(solved, have, words, how)
}

fn from(make: fn(&Path), have: &str, words: &str, how: impl Fn(&Path) + Send + Sync + 'static) -> Case {
    case(have, format!("eval score {words} --test-pupils pupils.json --jod none --engine cpu --json"), move |at| {
        make(at);
        how(at);
    })
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder").flatten() {
        let to = to.join(entry.file_name());
        match entry.path().is_dir() {
            true => copy(&entry.path(), &to),
            false => drop(fs::copy(entry.path(), to).expect("a copy")),
        }
    }
}

const CHUNK: &str = "a/h.zarr/phases/c/0/0/0/0";

/// Replaces the hologram by a new copy.
fn again(at: &Path) {
    fs::remove_dir_all(at.join("a/h.zarr")).expect("a hologram");
    copy(&kept().join("a/h.zarr"), &at.join("a/h.zarr"));
}

/// Returns situations with holograms and scenes that were moved, renamed or changed.
fn moved() -> Vec<Situation> {
    vec![
        score("A hologram is next to its scene in another folder.", "a/h.zarr", |_| ()).right(SCORED),
        score("A hologram and its scene were moved together.", "b/h.zarr", |at| {
            fs::rename(at.join("a"), at.join("b")).expect("a move");
        })
        .right(SCORED),
        score("A hologram was renamed.", "'a/my hologram.zarr'", |at| {
            fs::rename(at.join("a/h.zarr"), at.join("a/my hologram.zarr")).expect("a move");
        })
        .right(SCORED),
        from(solved_here, "A hologram was copied away from its scene, which is still there.", "c/h.zarr", |at| {
            copy(&at.join("a/h.zarr"), &at.join("c/h.zarr"));
        })
        .right(SCORED),
        from(solved_here, "A hologram was copied next to another folder with its scene's name.", "c/h.zarr", |at| {
            copy(&at.join("a/h.zarr"), &at.join("c/h.zarr"));
            other(&at.join("c/scene"));
        })
        .right(SCORED),
        score("The command runs in a folder with another scene of that name.", "a/h.zarr", |at| {
            other(&at.join("scene"));
        })
        .right(SCORED),
        score("A hologram is named with dots and a slash at the end.", "./a/../a/h.zarr/", |_| ()).right(SCORED),
        score("The scene of a hologram was moved without the hologram.", "a/h.zarr", |at| {
            fs::rename(at.join("a/scene"), at.join("kept")).expect("a move");
        })
        .refused(
            "arguments/scene-not-found",
            Remedy::By("give the scene", "a/h.zarr", "a/h.zarr kept"),
            SCORED,
        ),
        score("The scene of a hologram was changed, and its pictures are still elsewhere.", "a/h.zarr", |at| {
            other(&at.join("a/scene"));
        })
        .refused(
            "arguments/changed-scene",
            mended("give the scene as it was", |at| {
                save(&at.join("a/scene"), |row, column| format!("v_{row}_{column}.png"));
            }),
            SCORED,
        ),
        score("The scene of a hologram was changed on purpose.", "a/h.zarr", |at| other(&at.join("a/scene"))).refused(
            "arguments/changed-scene",
            Remedy::Add("--force"),
            OTHER,
        ),
        score("A hologram is to be scored against a scene that it does not show.", "a/h.zarr builtin:plane", |_| ())
            .refused("arguments/other-scene", Remedy::Add("--force"), OTHER),
        score("The name of a hologram lacks its ending.", "a/h", |_| ()).refused(
            "hologram/not-a-hologram/nothing-there",
            Remedy::As("a/h.zarr", "a/h", "a/h.zarr"),
            SCORED,
        ),
        score("The command names a file inside a hologram.", "a/h.zarr/zarr.json", |_| ()).refused(
            "hologram/not-a-hologram/file-of-a-hologram",
            Remedy::As("a/h.zarr", "a/h.zarr/zarr.json", "a/h.zarr"),
            SCORED,
        ),
        score("The command names the folder around a hologram.", "c", |at| {
            copy(&at.join("a/h.zarr"), &at.join("c/h.zarr"));
        })
        .refused(
            "hologram/not-a-hologram/folder-of-a-hologram",
            Remedy::As("c/h.zarr", "score c ", "score c/h.zarr "),
            SCORED,
        ),
    ]
}

/// Returns situations with damaged holograms, and with other files instead of a hologram.
fn damaged() -> Vec<Situation> {
    vec![
        score("A file of phases was lost in a copy.", "a/h.zarr", |at| {
            fs::remove_file(at.join(CHUNK)).expect("a file");
        })
        .refused("hologram/damaged/missing", mended("copy it again", again), SCORED),
        score("A file of phases was cut off.", "a/h.zarr", |at| {
            let bytes = fs::read(at.join(CHUNK)).expect("a file");
            file(&at.join(CHUNK), &bytes[..100]);
        })
        .refused("hologram/damaged/length 100", mended("copy it again", again), SCORED),
        score("The document of a hologram was cut off.", "a/h.zarr", |at| {
            let bytes = fs::read(at.join("a/h.zarr/zarr.json")).expect("a file");
            file(&at.join("a/h.zarr/zarr.json"), &bytes[..200]);
        })
        .refused("hologram/damaged/not-json", mended("copy it again", again), SCORED),
        score("One byte of a hologram's phases was changed.", "a/h.zarr", |at| {
            let mut bytes = fs::read(at.join(CHUNK)).expect("a file");
            bytes[1234] ^= 4;
            file(&at.join(CHUNK), &bytes);
        })
        .refused("hologram/damaged/checksum", mended("copy it again", again), SCORED),
        case("You need one hologram of a sequence.", "convert s.zarr p.npy", |at| {
            run(at, &format!("solve builtin:plane builtin:plane?depth=0.5 {SOLVE} -o s.zarr"));
        })
        .refused("hologram/not-a-hologram/is-a-sequence", Remedy::Add("--at 0"), FIRST),
        case("The command requests a hologram beyond the end of a sequence.", "convert s.zarr p.npy --at 2", |at| {
            run(at, &format!("solve builtin:plane builtin:plane?depth=0.5 {SOLVE} -o s.zarr"));
        })
        .refused(
            "hologram/not-a-hologram/no-such-hologram",
            Remedy::By("its last is 1", "--at 2", "--at 1"),
            FIRST,
        ),
        score("Views of a scene are given for a hologram.", "a/scene", |_| ()).refused(
            "hologram/not-a-hologram/several-numbers",
            Remedy::By("solved first", "a/scene", "a/h.zarr"),
            SCORED,
        ),
        case("A hologram is given for a scene.", format!("solve a/h.zarr {SOLVE} -o p.npy"), solved).refused(
            "scene/corrupt/hologram-not-scene",
            Remedy::By("that is a folder of views", "a/h.zarr", "a/scene"),
            FIRST,
        ),
    ]
}

/// A situation with a hologram that version 0.1.0 wrote.
fn from_old(name: &'static str, have: &str, words: &str) -> Case {
    case(have, words, move |at| {
        copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/old_holograms").join(name), &at.join("old.zarr"));
    })
}

/// Checks that the phases equal the values in these chunks of the old file.
fn are_phases(outcome: &Outcome, chunks: &[&str]) -> Result<(), String> {
    let found = eyebox::low_level::files::read_npy(&outcome.folder.join("p.npy")).map_err(|e| e.to_string())?.values;
    let stored = |chunk: &&str| {
        let bytes = fs::read(outcome.folder.join("old.zarr/phases/c").join(chunk)).expect("a chunk");
        let values = bytes[..bytes.len() - 4].chunks_exact(4);
        values.map(|v| f32::from_le_bytes([v[0], v[1], v[2], v[3]])).collect::<Vec<_>>()
    };
    let right: Vec<f32> = chunks.iter().flat_map(stored).collect();
    if found == right { Ok(()) } else { Err(format!("{} phases, which differ", found.len())) }
}

/// Checks the PSNR of `tests/old_holograms/relay`, which is 15.7 dB against a scene that it does not show.
const OLD: Judge = Judge::By(|outcome| match psnr(&outcome.stdout) {
    Some(found) if (19.5..21.5).contains(&found) => Ok(()),
    found => Err(format!("{found:?} dB")),
});

/// Returns situations with holograms of version 0.1.0, sequences, and scenes with unusual numbers.
fn old() -> Vec<Situation> {
    let score = "eval score old.zarr --jod none --engine cpu --json";
    let unusual = "eval score u.zarr --jod none --engine cpu --json";
    vec![
        from_old("relay", "A hologram of version 0.1.0 is scored.", score).right(OLD),
        from_old("refined", "A refined hologram of version 0.1.0 is converted.", "convert old.zarr p.npy")
            .right(Judge::By(|outcome| are_phases(outcome, &["0/0/0/0", "0/1/0/0"]))),
        from_old("far-field", "A far field of version 0.1.0 is converted.", "convert old.zarr p.npy")
            .right(Judge::By(|outcome| are_phases(outcome, &["0/0/0/0", "1/0/0/0"]))),
        from_old("sequence", "A sequence of version 0.1.0 is converted.", "convert old.zarr p.npy").refused(
            "hologram/not-a-hologram/is-a-sequence",
            Remedy::Add("--at 0"),
            Judge::By(|outcome| are_phases(outcome, &["0/0/0/0/0"])),
        ),
        case("A hologram was solved with unusual depths and `--force`.", unusual, |at| {
            crate::made::all()[0].save(at.join("photo.png")).expect("a picture");
            image::GrayImage::from_fn(64, 48, |x, _| image::Luma([4 * x as u8])).save(at.join("d.png")).expect("a map");
            let scene = "photo.png --depth-map d.png --near bright --depth=-0.003..0.003 --views 3";
            run(at, &format!("solve {scene} --force {SOLVE} -o u.zarr"));
        })
        .right(Judge::By(|outcome| match psnr(&outcome.stdout) {
            Some(found) if found > 10.0 => Ok(()),
            found => Err(format!("{found:?} dB")),
        })),
        case("You study a sequence.", STUDY, |at| {
            run(at, &format!("solve builtin:plane builtin:plane?depth=0.5 {SOLVE} -o s.zarr"));
        })
        .refused(
            "arguments/sequence",
            Remedy::Add("--at 0"),
            Judge::By(|outcome| {
                let text = fs::read_to_string(outcome.folder.join("study/study.json")).map_err(|e| e.to_string())?;
                if text.contains("builtin:plane") { Ok(()) } else { Err(text) }
            }),
        ),
    ]
}

const STUDY: &str = "eval gaze s.zarr --duration 0.1 --set gaze.set_rate=20 --set gaze.step_time=10 --set gaze.encode_time=1 --jod none --engine cpu -o study";

pub fn chapter() -> Chapter {
    let mut situations = moved();
    situations.extend(damaged());
    situations.extend(old());
    if cfg!(unix) {
        situations.push(
            score("A link leads to a hologram.", "link.zarr", |at| link(&at.join("a/h.zarr"), &at.join("link.zarr")))
                .right(SCORED),
        );
    }
    Chapter {
        title: "Holograms",
        about: "The hologram `a/h.zarr` was solved from the folder `a/scene`, and is scored against it.",
        situations,
    }
}

#[cfg(unix)]
fn link(to: &Path, at: &Path) {
    std::os::unix::fs::symlink(to, at).expect("a link");
}

#[cfg(not(unix))]
fn link(_: &Path, _: &Path) {}
