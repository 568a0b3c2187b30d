//! All input is validated, and finished work stays. The tests use special files, sizes beyond the memory of any
//! machine, and readers that close their end.

use crate::common::{Printed, Refusal, command, done, eyebox, folder, refusal, refused, text};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const SMALL: [&str; 8] = ["--size", "40x48", "--steps", "2", "--color", "green", "--engine", "cpu"];

fn solve<'a>(scenes: &[&'a str], out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["solve"], scenes, &["-o", out], &SMALL, more].concat()
}

fn mkfifo(file: &Path) {
    assert!(Command::new("mkfifo").arg(file).status().expect("mkfifo").success());
}

#[test]
fn sizes_that_no_machine_holds_are_refused_with_what_they_take() {
    let temp = folder();
    let at = temp.path();
    let huge = ["--size", "65536x65536"];
    let commands: [&[&str]; 4] = [
        &["solve", "builtin:still-life", "-o", "x.zarr"],
        &["render", "builtin:still-life", "--pupil=0,0,4,0", "-o", "x.png"],
        &["eval", "tune", "builtin:still-life", "-o", "y"],
        &["solve", "builtin:still-life", "--views", "1", "-o", "x.zarr"],
    ];
    for args in commands {
        let refusal = refusal(at, &[args, &huge].concat());
        assert!(refusal.fields["bytes"].as_u64() > Some(1 << 30), "{args:?}: {refusal:?}");
        assert!(refusal.message.contains("--size"), "{args:?}: {refusal:?}");
        assert!(!at.join("x.zarr").exists() && !at.join("x.png").exists());
    }
}

#[cfg(unix)]
#[test]
fn files_that_are_no_files_are_refused_at_once() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve(&["builtin:plane"], "h.zarr", &[]));
    mkfifo(&at.join("pipe"));
    std::fs::create_dir(at.join("views")).unwrap();
    mkfifo(&at.join("views/lightfield.toml"));
    for file in ["pipe", "/dev/zero"] {
        refused(at, &["solve", "builtin:plane", "--display", file, "-o", "x"], "x", "optics/unknown-display");
        refused(at, &["eval", "score", "h.zarr", "builtin:plane", "--test-pupils", file], "x", "arguments/pupils");
        refused(at, &solve(&["builtin:plane"], "x.zarr", &["--settings", file]), "x.zarr", "produce/job/unreadable");
    }
    #[cfg(target_os = "linux")]
    {
        std::fs::create_dir(at.join("session")).unwrap();
        mkfifo(&at.join("session/decisions.jsonl"));
        let show = ["show", "live:x", "--display", "planes8", "--size", "32x32", "--color", "green", "--engine", "cpu"];
        refusal(at, &[&show[..], &["--replay", "session"]].concat()).is("file/read session/decisions.jsonl");
    }
    for inside in ["zarr.json", "phases/zarr.json", "phases/c/0/0/0/0"] {
        let (file, kept) = (at.join("h.zarr").join(inside), at.join("kept"));
        std::fs::rename(&file, &kept).unwrap();
        mkfifo(&file);
        let begun = Instant::now();
        for args in
            [&["render", "h.zarr", "--pupil=0,0,4,0", "-o", "x.png"][..], &["show", "h.zarr", "--output", "offscreen"]]
        {
            let answer = eyebox(at, args);
            assert_eq!(answer.status.code(), Some(2), "{inside}: {args:?}: {}", text(&answer.stderr));
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "{inside} was waited for");
        std::fs::remove_file(&file).unwrap();
        std::fs::rename(&kept, &file).unwrap();
    }
    // The file has a length of 3 GB without any data.
    std::fs::File::create(at.join("sparse.toml")).unwrap().set_len(3 << 30).unwrap();
    refused(
        at,
        &["solve", "builtin:plane", "--display", "sparse.toml", "-o", "x"],
        "x",
        "optics/unknown-display 3221225472",
    );
}

/// The first bytes of a PNG have its size. A picture that is too large is refused before it is decoded.
#[test]
fn a_picture_that_is_too_large_is_refused_by_its_header() {
    let temp = folder();
    let at = temp.path();
    std::fs::create_dir(at.join("views")).unwrap();
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let body = [kind, data].concat();
        let sum = body.iter().fold(u32::MAX, |sum, byte| {
            (0..8).fold(sum ^ u32::from(*byte), |s, _| (s >> 1) ^ (0xedb8_8320 & 0u32.wrapping_sub(s & 1)))
        });
        [&(data.len() as u32).to_be_bytes()[..], &body, &(!sum).to_be_bytes()].concat()
    };
    let header = [&16000u32.to_be_bytes()[..], &16000u32.to_be_bytes(), &[8, 0, 0, 0, 0]].concat();
    png.extend([chunk(b"IHDR", &header), chunk(b"IDAT", &[]), chunk(b"IEND", &[])].concat());
    (0..9).for_each(|i| std::fs::write(at.join(format!("views/view_{i:02}.png")), &png).unwrap());
    refused(at, &solve(&["views"], "x.zarr", &[]), "x.zarr", "scene/corrupt/too-many-pixels 16000");
}

#[cfg(unix)]
#[test]
fn a_reader_that_goes_away_ends_talking_and_not_the_work() {
    let temp = folder();
    let at = temp.path();
    let scenes = ["builtin:plane?depth=-1", "builtin:plane?depth=0", "builtin:plane?depth=1"];
    for (streams, out) in [("| true", "a.zarr"), ("2>&1 | true", "b.zarr"), (">&- 2>&-", "c.zarr")] {
        let args = solve(&scenes, out, &[]);
        let words: Vec<String> = args.iter().map(|a| format!("'{a}'")).collect();
        let script =
            format!("(sleep 0.2; '{}' {}; echo $? > code) {streams}", crate::common::program(), words.join(" "));
        assert!(Command::new("sh").args(["-c", &script]).current_dir(at).status().unwrap().success());
        assert_eq!(std::fs::read_to_string(at.join("code")).unwrap().trim(), "0", "{streams}");
        let said = done(at, &["render", out, "--at", "2", "--pupil=0,0,4,0", "-o", "seen.png"]);
        assert!(at.join("seen.png").exists(), "{streams}: {said}");
        std::fs::remove_file(at.join("seen.png")).unwrap();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn what_a_full_disk_keeps_from_being_said_is_a_loss_and_is_told() {
    let temp = folder();
    let at = temp.path();
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let answer = command(at, &solve(&["builtin:plane"], "h.zarr", &["--json"])).stdout(full).output().unwrap();
    assert_eq!(answer.status.code(), Some(2));
    Refusal::of(&answer).is("output/standard");
    done(at, &["render", "h.zarr", "--pupil=0,0,4,0", "-o", "seen.png"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_terminal_that_goes_away_asks_to_stop_and_under_nohup_it_does_not() {
    use std::io::{BufRead, BufReader, Read};
    let temp = folder();
    let at = temp.path();
    // The many steps are not finished when the signal comes, and the duration is a limit if no signal comes. The
    // environment of the tests can ignore the signal.
    for (before, stops) in [("exec env --default-signal=HUP", true), ("trap '' HUP; exec", false)] {
        let steps = if stops { "100000" } else { "60" };
        let args = ["solve", "builtin:plane", "-o", "h.zarr", "--size", "64x64", "--color", "green", "--engine", "cpu"];
        let script =
            format!("{before} '{}' {} --steps {steps} --duration 60", crate::common::program(), args.join(" "));
        let mut child =
            Command::new("sh").args(["-c", &script]).current_dir(at).stderr(Stdio::piped()).spawn().unwrap();
        // The first line appears when the command can be stopped.
        let (mut stderr, mut said) = (BufReader::new(child.stderr.take().unwrap()), String::new());
        stderr.read_line(&mut said).unwrap();
        let _ = Command::new("kill").args(["-HUP", &child.id().to_string()]).status();
        stderr.read_to_string(&mut said).unwrap();
        let status = child.wait().unwrap();
        assert!(status.success(), "{before}: {status:?}: {said}");
        done(at, &["render", "h.zarr", "--pupil=0,0,4,0", "-o", "seen.png"]);
        std::fs::remove_dir_all(at.join("h.zarr")).unwrap();
    }
}

#[test]
fn places_that_cannot_be_written_are_found_before_the_work() {
    let temp = folder();
    let at = temp.path();
    done(at, &solve(&["builtin:plane"], "h.zarr", &[]));
    let show =
        ["show", "h.zarr", "--display", "planes8", "--size", "40x48", "--output", "offscreen", "--duration", "60"];
    for flag in ["--stats", "--trace"] {
        let begun = Instant::now();
        refused(at, &[&show[..], &[flag, "none/x.json"]].concat(), "none", "file/taken/no-such-folder");
        assert!(begun.elapsed() < Duration::from_secs(30), "{flag}: it was noticed when the run was over");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn absurd_numbers_of_threads_are_clamped_and_names_need_not_be_text() {
    use std::os::unix::ffi::OsStrExt;
    let temp = folder();
    let at = temp.path();
    let mut many = command(at, &solve(&["builtin:plane"], "h.zarr", &["--json"]));
    let answer = many.env("RAYON_NUM_THREADS", "100000").output().unwrap();
    let said = text(&answer.stderr);
    let fewer = |line: &str| line.has("100000") && line.numbers().iter().any(|n| *n >= 1.0 && *n < 100_000.0);
    assert!(answer.status.success() && said.lines().any(fewer), "{said}");
    let name = std::ffi::OsStr::from_bytes(b"\xff.zarr");
    let args = solve(&["builtin:plane"], "OUT", &["--json"]);
    let mut odd = command(at, &args[..2]);
    let answer = odd.arg("-o").arg(name).args(&args[4..]).output().unwrap();
    assert!(answer.status.success() && at.join(name).exists(), "{}", text(&answer.stderr));
}

/// The address space is small. The program fits into it, and the stacks of eight threads do not.
#[cfg(target_os = "linux")]
#[test]
fn where_the_system_gives_fewer_threads_fewer_compute() {
    let temp = folder();
    let at = temp.path();
    let args = [
        "solve",
        "builtin:plane",
        "-o",
        "h.zarr",
        "--size",
        "16x16",
        "--steps",
        "1",
        "--frames",
        "1",
        "--engine",
        "cpu",
    ];
    // With enough memory, no line mentions threads.
    let many = eyebox(at, &args);
    assert!(many.status.success(), "{}", text(&many.stderr));
    let usual = text(&many.stderr).lines().count();
    std::fs::remove_dir_all(at.join("h.zarr")).unwrap();
    let fewer = (24..160).any(|mib| {
        let script = format!("ulimit -v {}; exec '{}' {}", mib << 10, crate::common::program(), args.join(" "));
        let mut command = Command::new("sh");
        command.args(["-c", &script]).current_dir(at).env("RAYON_NUM_THREADS", "8").env("MALLOC_ARENA_MAX", "1");
        let answer = command.output().unwrap();
        // The program then uses a half, a quarter or an eighth of the threads.
        let said = text(&answer.stderr);
        let tried = said.lines().any(|line| ["4", "2", "1"].iter().any(|n| line.has(n)) && line.numbers().len() == 1);
        answer.status.success() && said.lines().count() > usual && tried && at.join("h.zarr").exists()
    });
    assert!(fewer, "with little address space it ran with all threads or not at all");
}

/// A command waits for the reader of a pipe, but not after a signal to end.
#[cfg(target_os = "linux")]
#[test]
fn an_unread_pipe_does_not_keep_what_was_asked_to_end() {
    use std::io::Write;
    use std::os::unix::fs::OpenOptionsExt;
    let temp = folder();
    let at = temp.path();
    done(at, &solve(&["builtin:plane"], "h.zarr", &[]));
    mkfifo(&at.join("pipe"));
    let mut options = std::fs::File::options();
    // O_NONBLOCK makes the loop end when the pipe takes no more.
    let mut pipe = options.read(true).write(true).custom_flags(0o4000).open(at.join("pipe")).unwrap();
    while pipe.write(&[0; 4096]).is_ok() {}
    let show = ["show", "h.zarr", "--display", "planes8", "--size", "40x48", "--output", "raw:pipe"];
    let mut child = command(at, &[&show[..], &["--trace", "trace.json"]].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The show has begun when its trace exists.
    while !at.join("trace.json").exists() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(300));
    let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    let answer = child.wait_with_output().unwrap();
    // The command waits for one second.
    let line = |line: &str| line.has("pipe s") && line.number("s") == 1.0;
    assert!(text(&answer.stderr).lines().any(line), "{}", text(&answer.stderr));
}

/// The first command that runs on a new device tests it once, and `device list` shows the test.
#[test]
fn devices_show_when_they_were_tried() {
    let temp = tempfile::tempdir().unwrap();
    let at = temp.path();
    let run = |args: &[&str]| {
        let answer = command(at, args).env("XDG_CACHE_HOME", at.join("cache")).output().expect("the command starts");
        assert!(answer.status.success(), "{}", text(&answer.stderr));
        text(&answer.stdout)
    };
    let all =
        || serde_json::from_str::<serde_json::Value>(&run(&["device", "list", "--json"])).unwrap()["vulkan"].clone();
    assert!(all().as_array().unwrap().iter().all(|device| device["tested"].is_null()), "{}", all());
    let before = run(&["device", "list"]);
    let solve = ["solve", "builtin:plane", "-o", "x.zarr", "--engine", "vulkan", "--size", "40x48", "--steps", "1"];
    run(&[&solve[..], &["--frames", "1", "--color", "green"]].concat());
    let all = all();
    let tested = all.as_array().unwrap().iter().find(|d| !d["tested"].is_null()).unwrap();
    // The text has the age and the deviation.
    let worst =
        ["transfer", "transform"].map(|of| tested["tested"][of].as_f64().unwrap()).into_iter().fold(0.0, f64::max);
    let after = run(&["device", "list"]);
    assert!(after != before && after.lines_with(&format!("0 {worst:.0e}")) == 1, "{after}");
    for of in ["transfer", "transform"] {
        assert!(tested["tested"][of].as_f64().unwrap() < 1e-12, "{tested}");
    }
    assert!(tested["tested"]["at_unix_s"].as_u64().unwrap() > 1_700_000_000, "{tested}");
}
