//! Installs eyebox for C, and builds and runs the examples in C and C++, with all warnings and the compiler's
//! sanitizers. They find the shared and the static library through pkg-config and CMake.

use crate::printed::Printed;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Returns the prefix into which the libraries next to this test's program are installed, once.
fn installed() -> &'static Path {
    static PREFIX: OnceLock<PathBuf> = OnceLock::new();
    PREFIX.get_or_init(|| {
        let prefix = Path::new(env!("CARGO_TARGET_TMPDIR")).join("c-prefix");
        let built = std::env::current_exe().unwrap().parent().unwrap().to_owned();
        let mut install = Command::new("bash");
        install.arg(here("install.sh")).arg(&prefix).env("EYEBOX_BUILT", built);
        said(install.output().unwrap());
        prefix
    })
}

/// Returns the arguments of the compiler for a package of pkg-config.
fn flags(package: &str) -> Vec<String> {
    let mut command = Command::new("pkg-config");
    command.args(["--cflags", "--libs", package]).env("PKG_CONFIG_PATH", installed().join("lib/pkgconfig"));
    said(command.output().expect("pkg-config")).split_whitespace().map(str::to_owned).collect()
}

/// Sets the folder in which a program finds the shared library.
fn finds_library(command: &mut Command) -> &mut Command {
    command.env("LD_LIBRARY_PATH", installed().join("lib"))
}

fn said(output: Output) -> String {
    let [out, err] = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{:?}\n{out}\n{err}", output.status);
    out
}

/// Builds an example, and runs it on pictures of 32 x 32 pixels with two steps.
fn run(compiler: &str, example: &str, standard: &str, package: &str, more: &[&str]) -> String {
    let library = flags(package);
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("program");
    let build = |sanitizers: bool| {
        let mut command = Command::new(compiler);
        command.args([standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-g"]);
        if sanitizers {
            command.args(["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]);
        }
        command.arg(here(example)).arg("-o").arg(&program).args(&library).args(more);
        command.output().unwrap_or_else(|e| panic!("{compiler}: {e}"))
    };
    // If the libraries of the sanitizers are missing, the program is built without them.
    if !build(true).status.success() {
        said(build(false));
    }
    // A Vulkan driver keeps some of its memory. It is unloaded before the sanitizer determines the owner of the memory.
    let leaks = if more.contains(&"-lvulkan") { "detect_leaks=0" } else { "" };
    let mut command = Command::new(&program);
    finds_library(command.args(["32", "2"])).env("ASAN_OPTIONS", leaks);
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
    let out = run("cc", "examples/solve.c", "-std=c99", "eyebox", &[]);
    // The output has one line per step, one with the score, and one with the video frames.
    let lines: Vec<&str> = out.lines().collect();
    assert!(lines.len() == 4 && lines[1].has_sequence(&[2.0, 2.0]), "{out}");
    assert!(lines[2].number("dB") > 5.0 && lines[2].has("2"), "{out}");
    assert_eq!(lines[3].numbers(), [1.0, 32.0, 32.0, 1.0]);
}

#[test]
fn the_example_in_cpp_with_the_static_library() {
    let out = run("c++", "examples/refine.cpp", "-std=c++17", "eyebox-static", &[]);
    // At each of three pupils the score is higher after refinement.
    let better = |line: &str| matches!(line.numbers()[..], [_, before, after] if after > before);
    assert!(out.lines().count() == 3 && out.lines().all(better), "{out}");
}

#[test]
fn a_session_that_is_ticked_with_the_shared_library() {
    let out = run("cc", "examples/session.c", "-std=c99", "eyebox", &["-lm"]);
    is_refined(&out);
}

#[test]
fn a_device_of_the_programs_own_with_the_static_library() {
    if !Path::new("/usr/include/vulkan/vulkan.h").exists() {
        return println!("the headers of Vulkan (libvulkan-dev) are missing, so the example was not built");
    }
    let out = run("c++", "examples/vulkan_device.cpp", "-std=c++17", "eyebox-static", &["-lvulkan"]);
    // The output names the engine and has the score.
    assert!(out.lines().count() == 2 && out.number("dB") > 5.0, "{out}");
}

/// The loader finds the library by the name of its interface, which a later version keeps.
#[test]
fn the_shared_library_has_the_name_of_its_interface() {
    let lib = installed().join("lib");
    let version = env!("CARGO_PKG_VERSION");
    let interface = version.rsplit_once('.').unwrap().0;
    assert_eq!(
        lib.join("libeyebox.so").canonicalize().unwrap().file_name().unwrap(),
        &*format!("libeyebox.so.{version}")
    );
    let Ok(header) = Command::new("readelf").arg("-d").arg(lib.join("libeyebox.so")).output() else {
        return println!("readelf is missing, so the name in the library was not read");
    };
    assert!(said(header).contains(&format!("[libeyebox.so.{interface}]")));
}

#[test]
fn cmake_finds_both_libraries() {
    if !Command::new("cmake").arg("--version").output().is_ok_and(|has| has.status.success()) {
        return println!("cmake is missing, so find_package was not run");
    }
    let folder = tempfile::tempdir().unwrap();
    let interface = env!("CARGO_PKG_VERSION").rsplit_once('.').unwrap().0;
    let lists = format!(
        "cmake_minimum_required(VERSION 3.16)\nproject(uses C CXX)\nfind_package(eyebox {interface} REQUIRED)\n\
         add_executable(shared {solve})\ntarget_link_libraries(shared PRIVATE eyebox::eyebox)\n\
         add_executable(static {refine})\ntarget_compile_features(static PRIVATE cxx_std_17)\n\
         target_link_libraries(static PRIVATE eyebox::static)\n",
        solve = here("examples/solve.c").display(),
        refine = here("examples/refine.cpp").display(),
    );
    std::fs::write(folder.path().join("CMakeLists.txt"), lists).unwrap();
    let build = folder.path().join("build");
    let prefix = format!("-DCMAKE_PREFIX_PATH={}", installed().display());
    said(Command::new("cmake").args(["-S"]).arg(folder.path()).arg("-B").arg(&build).arg(&prefix).output().unwrap());
    said(Command::new("cmake").arg("--build").arg(&build).output().unwrap());
    for program in ["shared", "static"] {
        assert!(!said(Command::new(build.join(program)).args(["32", "2"]).output().unwrap()).is_empty());
    }
    let wanted = |version: &str| {
        let folder = tempfile::tempdir().unwrap();
        let lists =
            format!("cmake_minimum_required(VERSION 3.16)\nproject(uses C)\nfind_package(eyebox {version} REQUIRED)\n");
        std::fs::write(folder.path().join("CMakeLists.txt"), lists).unwrap();
        let made = Command::new("cmake").args(["-S", ".", "-B", "build"]).arg(&prefix).current_dir(&folder).output();
        made.unwrap().status.success()
    };
    assert!(wanted("") && !wanted("0.99") && !wanted("7"));
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
    build.args(["-std=c99", "-g"]).arg(here("examples/session.c")).arg("-o").arg(&program);
    build.args(flags("eyebox")).arg("-lm");
    said(build.output().unwrap());
    let mut command = Command::new("valgrind");
    command.args(["--error-exitcode=9", "--fair-sched=yes", "-q"]).arg(&program).args(["32", "2"]);
    let ran = finds_library(&mut command).env("RAYON_NUM_THREADS", "1").output().unwrap();
    is_refined(&said(ran));
}

/// If a child is forked after an engine was opened, its calls return an error and do not hang.
#[test]
fn a_forked_child_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (source, program) = (folder.path().join("forked.c"), folder.path().join("program"));
    std::fs::write(&source, FORKED).unwrap();
    let mut build = Command::new("cc");
    build.args(["-D_POSIX_C_SOURCE=200809L", "-std=c99", "-Wall", "-Werror"]).arg(&source);
    build.arg("-o").arg(&program).args(flags("eyebox"));
    said(build.output().unwrap());
    let ran = finds_library(Command::new("timeout").arg("60").arg(&program)).output().unwrap();
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
