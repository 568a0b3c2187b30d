//! Builds and runs the examples in C and C++, with all warnings and the compiler's sanitizers, against the shared and
//! the static library.

use crate::printed::Printed;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The libraries that a program needs in addition to the static library, as rustc prints them
/// (`--print native-static-libs`).
const SYSTEM: [&str; 5] = ["-lgcc_s", "-lutil", "-lpthread", "-lm", "-ldl"];

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Returns the folder of the libraries, which is also the folder of this test's program.
fn libraries() -> PathBuf {
    std::env::current_exe().unwrap().parent().unwrap().to_owned()
}

fn said(output: Output) -> String {
    let [out, err] = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{:?}\n{out}\n{err}", output.status);
    out
}

/// Builds an example, and runs it on pictures of 32 x 32 pixels with two steps.
fn run(compiler: &str, example: &str, standard: &str, library: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("program");
    let build = |sanitizers: bool| {
        let mut command = Command::new(compiler);
        command.args([standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-g", "-I"]).arg(here(""));
        if sanitizers {
            command.args(["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]);
        }
        command.arg(here(example)).arg("-o").arg(&program).args(library);
        command.output().unwrap_or_else(|e| panic!("{compiler}: {e}"))
    };
    // If the libraries of the sanitizers are missing, the program is built without them.
    if !build(true).status.success() {
        said(build(false));
    }
    // A Vulkan driver keeps some of its memory. It is unloaded before the sanitizer determines the owner of the memory.
    let leaks = if library.contains(&"-lvulkan") { "detect_leaks=0" } else { "" };
    let mut command = Command::new(&program);
    command.args(["32", "2"]).env("LD_LIBRARY_PATH", libraries()).env("ASAN_OPTIONS", leaks);
    said(command.output().unwrap())
}

/// Asserts that the output has the size of a video frame, and at least ten refined sets.
fn is_refined(out: &str) {
    assert!(
        out.has_sequence(&[32.0, 32.0, 1.0]) && out.numbers()[3..] >= [10.0][..] && out.lines().count() == 1,
        "{out}"
    );
}

#[test]
fn the_example_in_c_with_the_shared_library() {
    let at = format!("-L{}", libraries().display());
    let out = run("cc", "examples/solve.c", "-std=c99", &[&at, "-leyebox_c"]);
    // The output has one line per step, one with the score, and one with the video frames.
    let lines: Vec<&str> = out.lines().collect();
    assert!(lines.len() == 4 && lines[1].has_sequence(&[2.0, 2.0]), "{out}");
    assert!(lines[2].number("dB") > 5.0 && lines[2].has("2"), "{out}");
    assert_eq!(lines[3].numbers(), [1.0, 32.0, 32.0, 1.0]);
}

#[test]
fn the_example_in_cpp_with_the_static_library() {
    let archive = libraries().join("libeyebox_c.a");
    let library: Vec<&str> = [archive.to_str().unwrap()].into_iter().chain(SYSTEM).collect();
    let out = run("c++", "examples/refine.cpp", "-std=c++17", &library);
    // At each of three pupils the score is higher after refinement.
    let better = |line: &str| matches!(line.numbers()[..], [_, before, after] if after > before);
    assert!(out.lines().count() == 3 && out.lines().all(better), "{out}");
}

#[test]
fn a_session_that_is_ticked_with_the_shared_library() {
    let at = format!("-L{}", libraries().display());
    let out = run("cc", "examples/session.c", "-std=c99", &[&at, "-leyebox_c", "-lm"]);
    is_refined(&out);
}

#[test]
fn a_device_of_the_programs_own_with_the_static_library() {
    if !Path::new("/usr/include/vulkan/vulkan.h").exists() {
        return println!("the headers of Vulkan (libvulkan-dev) are missing, so the example was not built");
    }
    let archive = libraries().join("libeyebox_c.a");
    let library: Vec<&str> = [archive.to_str().unwrap(), "-lvulkan"].into_iter().chain(SYSTEM).collect();
    let out = run("c++", "examples/vulkan_device.cpp", "-std=c++17", &library);
    // The output names the engine and has the score.
    assert!(out.lines().count() == 2 && out.number("dB") > 5.0, "{out}");
}

/// valgrind hides the vDSO, and programs that embed eyebox must also run without it.
#[test]
fn a_session_under_valgrind() {
    if !Command::new("valgrind").arg("--version").output().is_ok_and(|has| has.status.success()) {
        return println!("valgrind is missing, so the example was not run");
    }
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("program");
    let mut build = Command::new("cc");
    build.args(["-std=c99", "-g", "-I"]).arg(here("")).arg(here("examples/session.c")).arg("-o").arg(&program);
    build.arg(format!("-L{}", libraries().display())).args(["-leyebox_c", "-lm"]);
    said(build.output().unwrap());
    let mut command = Command::new("valgrind");
    command.args(["--error-exitcode=9", "--fair-sched=yes", "-q"]).arg(&program).args(["32", "2"]);
    let ran = command.env("LD_LIBRARY_PATH", libraries()).env("RAYON_NUM_THREADS", "1").output().unwrap();
    is_refined(&said(ran));
}

/// If a child is forked after an engine was opened, its calls return an error and do not hang.
#[test]
fn a_forked_child_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (source, program) = (folder.path().join("forked.c"), folder.path().join("program"));
    std::fs::write(&source, FORKED).unwrap();
    let mut build = Command::new("cc");
    build.args(["-D_POSIX_C_SOURCE=200809L", "-std=c99", "-Wall", "-Werror", "-I"]).arg(here("")).arg(&source);
    build.arg("-o").arg(&program).arg(format!("-L{}", libraries().display())).arg("-leyebox_c");
    said(build.output().unwrap());
    let ran = Command::new("timeout").arg("60").arg(&program).env("LD_LIBRARY_PATH", libraries()).output().unwrap();
    assert_eq!(said(ran), "parent ok\n");
}

const FORKED: &str = r#"
#include "eyebox.h"
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

int main(void) {
    EyeboxDisplay *preset = NULL, *display = NULL;
    EyeboxEngine *engine = NULL;
    EyeboxScene *scene = NULL;
    if (eyebox_display_load("small", &preset) || eyebox_display_resized(preset, 32, 32, &display)) return 1;
    /* eyebox has not started threads yet, so a child may use it. */
    if (fork() == 0) {
        int made = eyebox_engine_open("cpu", &engine) || eyebox_scene_load("builtin:plane", display, EYEBOX_GREEN, 3, &scene);
        _exit(made);
    }
    int status = 0;
    if (wait(&status) < 0 || status != 0) return 2;
    if (eyebox_engine_open("cpu", &engine)) return 3;
    if (eyebox_scene_load("builtin:plane", display, EYEBOX_GREEN, 3, &scene)) return 4;
    if (fork() == 0) {
        EyeboxHologram *hologram = NULL;
        int code = eyebox_solve(scene, display, "steps = 2", engine, NULL, NULL, &hologram);
        int said = strcmp(eyebox_last_error_code(), "forked") == 0;
        eyebox_engine_free(engine);
        eyebox_scene_free(scene);
        _exit(code == EYEBOX_STATUS_ENGINE && said && hologram == NULL ? 0 : 5);
    }
    if (wait(&status) < 0 || status != 0) return 6;
    EyeboxHologram *hologram = NULL;
    if (eyebox_solve(scene, display, "steps = 2", engine, NULL, NULL, &hologram)) return 7;
    eyebox_hologram_free(hologram);
    eyebox_scene_free(scene);
    eyebox_engine_free(engine);
    eyebox_display_free(display);
    eyebox_display_free(preset);
    printf("parent ok\n");
    return 0;
}
"#;
