//! Finished work stays when several programs write one name, when a killed program has left temporary files, and when
//! the disk is full.

use crate::common::{Printed, Refusal, command, document, done, eyebox, folder, refusal, refused, text, written};
use ::eyebox::low_level::hologram::{ColorHologram, Hologram, HologramError, SequenceWriter, Tiles};
use ::eyebox::low_level::optics::Display;
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const SMALL: [&str; 10] = ["--size", "40x48", "--steps", "2", "--color", "green", "--engine", "cpu", "--views", "3"];

const RENDER: [&str; 5] = ["render", "h.zarr", "--pupil=0,0,4,0", "-o", "x.png"];
const SHOW: [&str; 8] = ["show", "h.zarr", "--display", "planes8", "--size", "40x48", "--duration", "0.2"];

fn solve<'a>(scenes: &[&'a str], out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["solve"], scenes, &["-o", out], &SMALL, more].concat()
}

fn names(at: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(at).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Runs the command in a shell that has run `before`.
#[cfg(unix)]
fn after(at: &Path, before: &str, args: &[&str]) -> Output {
    let script = format!("{before}; exec \"$@\"");
    let mut shell = Command::new("bash");
    shell.args(["-c", &script, "bash", &crate::common::program()]).args(args).current_dir(at);
    shell.env("EYEBOX_JSON_ERRORS", "1");
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
    done(at, &["render", "h.zarr", "--pupil=0,0,4,0", "-o", "seen.png"]);
}

/// A sequence has one writer at a time. A second writer is refused, or finds the sequence complete.
#[test]
fn two_writers_of_a_sequence_do_not_mix() {
    let temp = folder();
    let at = temp.path();
    let scenes = ["builtin:plane?depth=-1", "builtin:plane?depth=0", "builtin:plane?depth=1"];
    done(at, &solve(&scenes, "alone.zarr", &[]));
    let begin = || {
        let args = solve(&scenes, "s.zarr", &[]);
        let mut command = command(at, &args);
        command.env("EYEBOX_JSON_ERRORS", "1").stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    for child in [begin(), begin(), begin()] {
        let answer = child.wait_with_output().unwrap();
        if !answer.status.success() {
            assert_eq!(answer.status.code(), Some(2));
            Refusal::of(&answer).is("hologram/busy");
        }
    }
    done(at, &solve(&scenes, "s.zarr", &[]));
    let chunk = |of: &str, i: usize| std::fs::read(at.join(of).join(format!("phases/c/{i}/0/0/0/0"))).unwrap();
    (0..3).for_each(|i| assert!(chunk("s.zarr", i) == chunk("alone.zarr", i), "hologram {i} is another one"));
    assert_eq!((names(at), names(&at.join("s.zarr")).len()), (vec!["alone.zarr".to_owned(), "s.zarr".to_owned()], 2));
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

/// Ctrl-C ends a command that does not catch it, in the middle of its file.
#[cfg(unix)]
#[test]
fn ctrl_c_leaves_no_draft() {
    use std::os::unix::process::ExitStatusExt;
    let temp = folder();
    let at = temp.path();
    let args = ["render", "builtin:plane", "--size", "800x800", "--views", "1", "--color", "green"];
    let (mut begun, mut ended) = (0, 0);
    for _ in 0..6 {
        let plain = command(at, &[&args[..], &["--pupil=0,0,1,0", "--engine", "cpu", "-o", "x.png"]].concat());
        let mut writer = Command::new("env");
        writer.arg("--default-signal=INT").arg(plain.get_program()).args(plain.get_args()).current_dir(at);
        let mut child = writer.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        while names(at).iter().all(|name| !name.ends_with(".part")) && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_micros(100));
        }
        begun += usize::from(child.try_wait().unwrap().is_none());
        let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
        ended += usize::from(child.wait().unwrap().signal() == Some(2));
        assert_eq!(names(at).iter().find(|name| name.ends_with(".part")), None);
    }
    assert!(ended > 0, "none of {begun} writers was ended by ctrl-C");
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
    // The limit has room for documents, but not for holograms of 60 kB.
    let answer = after(at, "ulimit -f 16", &solve(&scenes, "s.zarr", &[]));
    assert_eq!(answer.status.code(), Some(2), "{}", text(&answer.stderr));
    Refusal::of(&answer).is("file/full");
    done(at, &["render", "s.zarr", "--at", "0", "--pupil=0,0,4,0", "-o", "seen.png"]);
    done(at, &solve(&scenes, "s.zarr", &[]));
    assert!([0, 1, 2].map(chunk) == whole);
    assert_eq!(names(&at.join("s.zarr")), ["phases", "zarr.json"]);
}

/// The removal of a temporary folder needs open files as well.
#[cfg(target_os = "linux")]
#[test]
fn too_few_open_files_leave_no_draft() {
    let temp = folder();
    let at = temp.path();
    let mut refused = [0, 0];
    for (i, scenes) in [&["builtin:plane"][..], &["builtin:plane", "builtin:points"]].into_iter().enumerate() {
        for limit in 6..14 {
            let answer = after(at, &format!("ulimit -n {limit}"), &solve(scenes, "h.zarr", &[]));
            refused[i] += usize::from(answer.status.code() == Some(2));
            let here = [at.to_path_buf(), at.join("h.zarr")].map(|folder| std::fs::read_dir(folder).ok());
            let left = here.into_iter().flatten().flatten().map(|e| e.unwrap().file_name().into_string().unwrap());
            let said = text(&answer.stderr);
            assert_eq!(left.filter(|name| name.ends_with(".part")).collect::<Vec<_>>(), [""; 0], "{limit}: {said}");
            let _ = std::fs::remove_dir_all(at.join("h.zarr"));
        }
    }
    assert!(refused[0] >= 1 && refused[1] >= 2, "{refused:?} of 8 had too few");
}

/// A link in a hologram is refused for any target.
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
        for args in [&RENDER[..], &SHOW] {
            let refusal = refusal(at, args);
            let file = refusal.fields["file"].as_str().unwrap_or_default();
            assert!(file.starts_with(&format!("h.zarr/{inside}")), "{inside}: {args:?}: {refusal:?}");
        }
        std::fs::remove_file(&file).unwrap();
        std::fs::rename(&kept, &file).unwrap();
    }
    done(at, &RENDER);
}

#[test]
fn a_hologram_that_lacks_a_chunk_is_not_shown() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve(&["builtin:plane"], "h.zarr", &[]));
    let chunk = at.join("h.zarr/phases/c/0/3/0/0");
    let mut bytes = std::fs::read(&chunk).unwrap();
    bytes[100] ^= 1;
    std::fs::write(&chunk, bytes).unwrap();
    for what in ["checksum", "missing"] {
        refusal(at, &SHOW).is(&format!("hologram/damaged/{what} phases/c/0/3/0/0"));
        let _ = std::fs::remove_file(&chunk);
    }
}

const DISPLAY: &str = "name = \"far\"\nresolution = [320, 320]\npitch_um = 4.0\nfocal_length_mm = 400.0\n\
                       wavelengths_nm = { green = 520 }\ngeometry = \"far-field\"\n";

/// Returns a hologram for [`DISPLAY`] with pseudorandom phases.
fn random() -> Hologram {
    let display = Display::from_toml(DISPLAY, "far.toml").unwrap();
    let phases = (0..320 * 320).map(|i| (i % 6007 * i % 6007) as f32 / 1000.0 - 3.0).collect();
    let wavelength = display.wavelengths[0];
    let (color, wavelength) = (Some(wavelength.color), wavelength.wavelength);
    Hologram::on(&display, 1, vec![ColorHologram { color, wavelength, exposure: 0.5, efficiency: 0.5, phases }])
}

/// Runs a command that must succeed, and returns its standard output and standard error.
fn told(at: &Path, args: &[&str]) -> (String, String) {
    let answer = eyebox(at, args);
    assert!(answer.status.success(), "{args:?}: {}", text(&answer.stderr));
    (text(&answer.stdout), text(&answer.stderr))
}

/// A command that reads tiles reports that none of them is solved.
#[test]
fn every_look_at_unfinished_tiles_says_how_far_they_are() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    drop(Tiles::create(&at.join("h.zarr"), &random(), 32, Value::Null, 9).unwrap());
    let how_far = "h.zarr 0 9";
    let pupil = "--pupil=0,0,0.4,0";
    let (_, said) = told(at, &["render", "h.zarr", pupil, "-o", "x.png", "--engine", "cpu"]);
    assert_eq!(said.lines_with(how_far), 1, "{said}");
    let still = ["h.zarr", "builtin:still-life", "--json", "--engine", "cpu"];
    let some = ["--test-pupils", "random:1", "--pupil-diameter", "0.3..0.3"];
    for args in [
        &[&["eval", "score"], &still[..], &some].concat(),
        &[&["refine"], &still[..], &[pupil, "--steps", "1"]].concat(),
    ] {
        let (json, said) = told(at, args);
        assert_eq!(said.lines_with(how_far), 1, "{args:?}: {said}");
        let json: Value = serde_json::from_str(&json).unwrap();
        assert_eq!(json["unfinished"], json!({ "done": 0, "total": 9, "unit": "visits" }), "{args:?}: {json}");
    }
    let encode = ["encode", "h.zarr", "--display", "far.toml", "-o", "frames"];
    for (args, out) in [(&["convert", "h.zarr", "x.npy"][..], "x.npy"), (&encode, "frames")] {
        refused(at, args, out, "arguments/unfinished --unfinished");
        done(at, &[args, &["--unfinished"]].concat());
        assert!(at.join(out).exists());
    }
    let evaluated = ["eval", "compare", "builtin:still-life", "--hologram", "mine=h.zarr", "-o", "report"];
    refused(at, &evaluated, "report", "hologram/unfinished");
    assert!(matches!(Hologram::load(&at.join("h.zarr")), Err(HologramError::Unfinished { .. })));
}

#[test]
fn every_look_at_an_unfinished_sequence_says_how_far_it_is() {
    let temp = folder();
    let at = temp.path();
    std::fs::write(at.join("far.toml"), DISPLAY).unwrap();
    let mut writer = SequenceWriter::create(&at.join("s.zarr"), &random(), [30, 1], Some(2)).unwrap();
    writer.append(&random()).unwrap();
    let how_far = "arguments/unfinished s.zarr 1 2 --unfinished";
    let render = ["render", "s.zarr", "--at", "0", "--pupil=0,0,0.4,0", "-o", "x.png", "--engine", "cpu"];
    assert_eq!(told(at, &render).1.lines_with("s.zarr 1 2"), 1);
    let show = ["show", "s.zarr", "--display", "far.toml", "--clock", "simulated"];
    for (args, out) in [(&["convert", "s.zarr", "x.npy", "--at", "0"][..], "x.npy"), (&show, "none")] {
        refused(at, args, out, how_far);
        done(at, &[args, &["--unfinished"]].concat());
    }
    writer.append(&random()).unwrap();
    writer.finish().unwrap();
    assert_eq!(told(at, &render).1.lines_with("s.zarr"), 0);
    done(at, &show);
}

/// A recording that ends by force or with its terminal can be read. It has all samples up to the last second.
#[cfg(unix)]
#[test]
fn a_recording_survives_whatever_ends_it() {
    let temp = folder();
    let at = temp.path();
    for (signal, code) in [("-KILL", None), ("-HUP", Some(0))] {
        let args = ["tracker", "record", "simulated:3", "--tracker-rate", "200", "-o", "r.jsonl"];
        // The environment of the tests can ignore SIGHUP.
        let plain = command(at, &args);
        let mut recorder = Command::new("env");
        recorder.arg("--default-signal=HUP").arg(plain.get_program()).args(plain.get_args()).current_dir(at);
        let mut child = recorder.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let lines = || std::fs::read_to_string(at.join("r.jsonl")).unwrap_or_default().lines().count();
        let begun = Instant::now();
        while lines() < 50 && begun.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(20));
        }
        assert!(child.try_wait().unwrap().is_none(), "it still records");
        let there = lines();
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        assert_eq!(child.wait().unwrap().code(), code, "{signal}");
        assert_eq!(names(at), ["r.jsonl"], "{signal}");
        assert!(done(at, &["tracker", "watch", "r.jsonl"]).lines().count() >= there, "{signal}");
        std::fs::remove_file(at.join("r.jsonl")).unwrap();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_a_recording_and_nothing_else() {
    let temp = folder();
    let at = temp.path();
    let args = ["tracker", "record", "simulated:3", "--tracker-rate", "200", "--duration", "2", "-o", "r.jsonl"];
    let answer = after(at, "ulimit -f 8", &args);
    let said = text(&answer.stderr);
    assert_eq!((answer.status.code(), said.lines().count()), (Some(2), 1), "{said}");
    Refusal::of(&answer).is("file/full r.jsonl");
    assert!(text(&answer.stdout).lines().count() > 390, "it was watched to the end");
    let kept = std::fs::read_to_string(at.join("r.jsonl")).unwrap();
    assert!(kept.ends_with("}\n") && kept.len() > 7000, "{} bytes", kept.len());
    let read = done(at, &["tracker", "watch", "r.jsonl"]);
    assert_eq!(read.lines().count(), kept.lines().count());
    // A recording that is cut within a line, as by an incomplete copy, is read up to that line and reported.
    std::fs::write(at.join("cut.jsonl"), &kept[..kept.len() - 9]).unwrap();
    let (read, said) = told(at, &["tracker", "watch", "cut.jsonl"]);
    let count = kept.lines().count();
    assert_eq!((read.lines().count(), said.lines_with(&format!("{count}"))), (count - 1, 1), "{said}");
}

/// Pictures with the names of eyebox's own files can still belong to the user.
#[test]
fn video_frames_of_others_are_left_alone() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve(&["builtin:plane"], "h.zarr", &[]));
    let encode = ["encode", "h.zarr", "--display", "planes8", "--size", "40x48", "-o", "frames"];
    done(at, &encode);
    done(at, &encode);
    std::fs::create_dir(at.join("film")).unwrap();
    std::fs::write(at.join("film/frame-0000.png"), "mine").unwrap();
    std::fs::write(at.join("frames/frame-9999.png"), "mine").unwrap();
    for out in ["film", "frames"] {
        refused(at, &[&encode[..7], &[out]].concat(), "none", "file/taken/holds-something-else");
    }
    assert_eq!(std::fs::read(at.join("film/frame-0000.png")).unwrap(), b"mine");
}

#[test]
fn files_of_others_where_a_report_goes_are_left_alone() {
    let temp = folder();
    let at = temp.path();
    std::fs::create_dir_all(at.join("mine/figures")).unwrap();
    let commands: [(&[&str], &str); 6] = [
        (&["eval", "compare", "builtin:plane"], "report.html"),
        (&["eval", "compare", "builtin:plane"], "figures/drawing.svg"),
        (&["eval", "tune", "builtin:plane"], "index.html"),
        (&["eval", "gaze", "builtin:plane"], "study.json"),
        (&["demo"], "demo.png"),
        (&["demo"], "still-life.zarr"),
    ];
    for (args, file) in commands {
        std::fs::write(at.join("mine").join(file), "mine").unwrap();
        refused(at, &[args, &["--out", "mine"]].concat(), "none", &format!("file/taken/not-ours {file}"));
        assert_eq!(std::fs::read(at.join("mine").join(file)).unwrap(), b"mine");
        assert_eq!(names(&at.join("mine")).len(), if file.contains('/') { 1 } else { 2 }, "nothing else came");
        std::fs::remove_file(at.join("mine").join(file)).unwrap();
    }
    // A folder that eyebox wrote is written again. A file that has changed since is not overwritten.
    let demo = ["demo", "--out", "d", "--size", "32", "--engine", "cpu", "--quality", "fast"];
    done(at, &demo);
    done(at, &demo);
    std::fs::write(at.join("d/demo.png"), "mine").unwrap();
    refused(at, &demo, "none", "file/taken/not-ours demo.png");
    done(at, &[&demo[..], &["--overwrite"]].concat());
}

/// Without a home folder, the system's folder for the user has the cache. The speed of the machine is still measured
/// only once.
#[cfg(target_os = "linux")]
#[test]
fn without_a_home_the_machine_is_not_timed_again() {
    let temp = folder();
    let at = temp.path();
    let plan = ["solve", "builtin:plane", "--dry-run", "--size", "48x40", "--engine", "cpu", "--color", "green"];
    done(at, &plan);
    std::fs::create_dir(at.join("run")).unwrap();
    let cache = std::env::temp_dir().join("eyebox-tests/eyebox");
    let copied = Command::new("cp").arg("-r").arg(cache).arg(at.join("run")).status().unwrap();
    assert!(copied.success());
    let rates = || -> Vec<_> {
        let all = std::fs::read_dir(at.join("run/eyebox")).unwrap().map(|e| e.unwrap().path());
        all.filter(|file| file.to_string_lossy().contains("rates-")).map(|file| (written(&file), file)).collect()
    };
    let before = rates();
    let mut homeless = command(at, &plan);
    homeless.env_remove("HOME").env_remove("XDG_CACHE_HOME").env("XDG_RUNTIME_DIR", at.join("run"));
    let answer = homeless.output().unwrap();
    // A measurement would print a line and write a file.
    assert!(answer.status.success() && answer.stderr.is_empty(), "{}", text(&answer.stderr));
    assert!(!before.is_empty() && rates() == before);
}

/// A show that ends by force leaves its statistics and its trace up to the last second. A full disk ends neither the
/// show nor the parts that are written.
#[cfg(target_os = "linux")]
#[test]
fn statistics_and_traces_survive_whatever_ends_a_session() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve(&["builtin:plane"], "h.zarr", &[]));
    let show = ["show", "h.zarr", "--display", "planes8", "--size", "40x48", "--stats", "s.json", "--trace", "t.json"];
    let mut child = command(at, &show).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let stats = || serde_json::from_slice::<Value>(&std::fs::read(at.join("s.json")).ok()?).ok();
    let begun = Instant::now();
    let traced = || std::fs::read_to_string(at.join("t.json")).is_ok_and(|trace| trace.contains("decode"));
    let there = || traced() && stats().is_some_and(|s| s["sets"].as_u64() >= Some(1));
    while !there() && begun.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let stats = stats().expect("statistics");
    assert!(stats["seconds"].as_f64() > Some(0.5) && stats["ended_by"].is_null(), "{stats}");
    let trace = std::fs::read_to_string(at.join("t.json")).unwrap();
    let whole = &trace[..trace.rfind("},\n").unwrap() + 1];
    let events: Vec<Value> = serde_json::from_str(&format!("{whole}]")).unwrap();
    assert!(events.iter().any(|e| e["name"] == "decode"), "{trace}");

    let limited = [&show[..], &["--duration", "3", "--clock", "simulated"]].concat();
    let answer = after(at, "ulimit -f 8", &limited);
    let said = text(&answer.stderr);
    assert_eq!(answer.status.code(), Some(2), "{said}");
    assert_eq!(said.lines_with("t.json"), 1, "{said}");
    let ended = document(&at.join("s.json"));
    assert!(ended["ended_by"] == "the duration" && ended["seconds"].as_f64() >= Some(2.9), "{ended}");
    let trace = std::fs::read_to_string(at.join("t.json")).unwrap();
    assert!(serde_json::from_str::<Vec<Value>>(&format!("{}]", trace.trim_end().trim_end_matches(','))).is_ok());
}
