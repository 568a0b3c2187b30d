//! The examples in C and C++, built with every warning and the compiler's sanitizers, against the shared and the static library.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// What a program needs beside the static library, as rustc prints it (`--print native-static-libs`).
const SYSTEM: [&str; 5] = ["-lgcc_s", "-lutil", "-lpthread", "-lm", "-ldl"];

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Beside this test's program.
fn libraries() -> PathBuf {
    std::env::current_exe().unwrap().parent().unwrap().to_owned()
}

fn said(output: Output) -> String {
    let [out, err] = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{:?}\n{out}\n{err}", output.status);
    out
}

/// Builds an example, and runs it on pictures of 32 x 32 with two steps.
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
    // Without the sanitizers' libraries, the program as it is.
    if !build(true).status.success() {
        said(build(false));
    }
    // A Vulkan driver keeps some of its memory, and is unloaded before the sanitizer looks whose it is.
    let leaks = if library.contains(&"-lvulkan") { "detect_leaks=0" } else { "" };
    let mut command = Command::new(&program);
    command.args(["32", "2"]).env("LD_LIBRARY_PATH", libraries()).env("ASAN_OPTIONS", leaks);
    said(command.output().unwrap())
}

#[test]
fn the_example_in_c_with_the_shared_library() {
    let at = format!("-L{}", libraries().display());
    let out = run("cc", "examples/solve.c", "-std=c99", &[&at, "-leyebox_c"]);
    assert!(out.contains("step 2 of 2") && out.contains("dB after 2 steps"), "{out}");
    assert!(out.ends_with("1 video frames of 32 x 32 x 1 bytes\n"), "{out}");
}

#[test]
fn the_example_in_cpp_with_the_static_library() {
    let archive = libraries().join("libeyebox_c.a");
    let library: Vec<&str> = [archive.to_str().unwrap()].into_iter().chain(SYSTEM).collect();
    let out = run("c++", "examples/refine.cpp", "-std=c++17", &library);
    assert_eq!(out.matches("refined").count(), 3, "{out}");
}

#[test]
fn a_session_that_is_ticked_with_the_shared_library() {
    let at = format!("-L{}", libraries().display());
    let out = run("cc", "examples/session.c", "-std=c99", &[&at, "-leyebox_c", "-lm"]);
    assert_eq!(out, "32 x 32 x 1 bytes a video frame; ten sets: refined\n");
}

#[test]
fn a_device_of_the_programs_own_with_the_static_library() {
    if !Path::new("/usr/include/vulkan/vulkan.h").exists() {
        return println!("no headers of Vulkan's (libvulkan-dev): the example was not built");
    }
    let archive = libraries().join("libeyebox_c.a");
    let library: Vec<&str> = [archive.to_str().unwrap(), "-lvulkan"].into_iter().chain(SYSTEM).collect();
    let out = run("c++", "examples/vulkan_device.cpp", "-std=c++17", &library);
    assert!(out.contains("the program's own device") && out.contains("dB in the middle"), "{out}");
}
