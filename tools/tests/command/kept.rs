//! Nothing that was made is lost: several writers of one name, drafts of the dead, disks that are full.

use crate::common::{command, done, eyebox, folder, text};
use std::path::Path;
use std::process::{Command, Output, Stdio};

const SMALL: [&str; 10] = ["--size", "40x48", "--steps", "2", "--color", "green", "--engine", "cpu", "--views", "3"];

const VIEW: [&str; 5] = ["view", "h.zarr", "--pupil=0,0,4,0", "-o", "x.png"];
const PLAY: [&str; 8] = ["play", "h.zarr", "--display", "planes8", "--size", "40x48", "--duration", "0.2"];

fn solve<'a>(scenes: &[&'a str], out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["solve"], scenes, &["-o", out], &SMALL, more].concat()
}

fn names(at: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(at).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// In a shell that has run `before`.
#[cfg(unix)]
fn after(at: &Path, before: &str, args: &[&str]) -> Output {
    let script = format!("{before}; exec \"$@\"");
    let mut shell = Command::new("bash");
    shell.args(["-c", &script, "bash", env!("CARGO_BIN_EXE_eyebox")]).args(args).current_dir(at);
    shell.env("XDG_CACHE_HOME", std::env::temp_dir().join("eyebox-tests")).output().expect("bash")
}

#[test]
fn four_solves_to_one_name_all_succeed_and_leave_one_hologram() {
    let temp = folder();
    let at = temp.path();
    let begin = |seed: &'static str| {
        let args = solve(&["builtin:plane"], "h.zarr", &["--seed", seed]);
        command(at, &args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    for child in ["1", "2", "3", "4"].map(begin) {
        let answer = child.wait_with_output().unwrap();
        assert!(answer.status.success(), "{}", text(&answer.stderr));
    }
    assert_eq!(names(at), ["h.zarr"]);
    done(at, &["view", "h.zarr", "--pupil=0,0,4,0", "-o", "seen.png"]);
}

#[cfg(unix)]
#[test]
fn drafts_of_a_program_that_was_killed_are_removed_by_the_next_that_writes_there() {
    let temp = folder();
    let at = temp.path();
    std::fs::create_dir_all(at.join(".eyebox-DEAD01.part/phases")).unwrap();
    std::fs::write(at.join(".eyebox-DEAD01.part/phases/zarr.json"), "{").unwrap();
    std::fs::write(at.join(".eyebox-DEAD02.part"), "").unwrap();
    std::fs::write(at.join("notes.part"), "mine").unwrap();
    done(at, &solve(&["builtin:plane"], "h.zarr", &[]));
    assert_eq!(names(at), ["h.zarr", "notes.part"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_costs_a_sequence_what_was_not_whole_yet_and_it_is_gone_on_with() {
    let temp = folder();
    let at = temp.path();
    let scenes = ["builtin:plane?depth=-1", "builtin:plane?depth=0", "builtin:plane?depth=1"];
    done(at, &solve(&scenes, "s.zarr", &[]));
    let chunk = |i: usize| std::fs::read(at.join(format!("s.zarr/phases/c/{i}/0/0/0/0"))).unwrap();
    let whole = [0, 1, 2].map(chunk);
    (1..3).for_each(|i| std::fs::remove_dir_all(at.join(format!("s.zarr/phases/c/{i}"))).unwrap());
    // Documents have room, holograms of 60 kB do not.
    let answer = after(at, "ulimit -f 16", &solve(&scenes, "s.zarr", &[]));
    assert_eq!(answer.status.code(), Some(2), "{}", text(&answer.stderr));
    assert!(text(&answer.stderr).contains("the disk is full"), "{}", text(&answer.stderr));
    done(at, &["view", "s.zarr", "--at", "0", "--pupil=0,0,4,0", "-o", "seen.png"]);
    done(at, &solve(&scenes, "s.zarr", &[]));
    assert!([0, 1, 2].map(chunk) == whole);
    assert_eq!(names(&at.join("s.zarr")), ["phases", "zarr.json"]);
}

/// A link in a hologram is not read through, whatever it leads to.
#[cfg(unix)]
#[test]
fn links_in_a_hologram_are_not_followed() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve(&["builtin:plane"], "h.zarr", &[]));
    for inside in ["zarr.json", "phases/zarr.json", "phases/c/0/0/0/0", "phases/c"] {
        let (file, kept) = (at.join("h.zarr").join(inside), at.join("kept"));
        std::fs::rename(&file, &kept).unwrap();
        std::os::unix::fs::symlink(&kept, &file).unwrap();
        for args in [&VIEW[..], &PLAY] {
            let answer = eyebox(at, args);
            assert_eq!(answer.status.code(), Some(2), "{inside}: {args:?}: {}", text(&answer.stderr));
            assert!(text(&answer.stderr).contains("link"), "{inside}: {}", text(&answer.stderr));
        }
        std::fs::remove_file(&file).unwrap();
        std::fs::rename(&kept, &file).unwrap();
    }
    done(at, &VIEW);
}

#[test]
fn a_hologram_that_lacks_a_chunk_is_not_played() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve(&["builtin:plane"], "h.zarr", &[]));
    let chunk = at.join("h.zarr/phases/c/0/3/0/0");
    let mut bytes = std::fs::read(&chunk).unwrap();
    bytes[100] ^= 1;
    std::fs::write(&chunk, bytes).unwrap();
    for what in ["its checksum is", "it is missing"] {
        let answer = eyebox(at, &PLAY);
        let said = text(&answer.stderr);
        assert_eq!(answer.status.code(), Some(2), "{said}");
        assert!(said.contains("phases/c/0/3/0/0") && said.contains(what), "{said}");
        let _ = std::fs::remove_file(&chunk);
    }
}
