//! Impossible numbers are refused before any file is made, and the message has possible ones.

use crate::common::{done, folder, refusal, refused};

const SMALL: [&str; 8] = ["--size", "16x16", "--steps", "1", "--color", "green", "--engine", "cpu"];

#[test]
fn options_of_impossible_values_are_refused_with_what_is_possible() {
    let temp = folder();
    let at = temp.path();
    done(at, &[&["solve", "builtin:plane", "-o", "h.zarr"], &SMALL[..]].concat());
    let solve = [&["solve", "builtin:plane", "-o", "out.zarr"], &SMALL[..]].concat();
    let refine = ["refine", "h.zarr", "builtin:plane", "--pupil=0,0,1,0", "-o", "out.zarr"];
    let show =
        ["show", "h.zarr", "--display", "grey8", "--size", "16x16", "--engine", "cpu", "--output", "raw:out.zarr"];
    let steer =
        ["show", "h.zarr", "--tracker", "simulated", "--display", "grey8", "--size", "16x16", "--duration", "0.1"];
    let cases: [(&[&str], &str, &str); 23] = [
        (&solve, "--psnr=nan", "usage/value-validation -100 1000"),
        (&solve, "--psnr=inf", "usage/value-validation -100 1000"),
        (&solve, "--duration=1e308", "usage/value-validation 1e12"),
        (&solve, "--pupil-diameter=-5..5", "usage/value-validation"),
        (&solve, "--depth=-3e99..3", "usage/value-validation"),
        (&refine, "--pupil-diameter=-5..5", "usage/value-validation"),
        (&refine, "--set=refine.strategy.momentum=1e308", "solve/setting"),
        (&refine, "--set=refine.strategy.momentum=nan", "produce/job/not-finite"),
        (&refine, "--set=refine.strategy.gain=1e308", "solve/setting 1e6"),
        (&refine, "--set=refine.strategy.gain=1e10", "solve/setting 1e6"),
        (&refine, "--set=refine.strategy.overlap_power=100", "solve/setting 16"),
        (&steer, "--set=refine.strategy.momentum=2", "solve/setting"),
        (&refine, "--set=refine.elsewhere=1e9", "solve/setting 64"),
        (&show, "--start-at=1e308", "usage/value-validation 1e12"),
        (&show, "--start-at=1e11", "session/setting/start-at"),
        (&show, "--start-at=1", "session/setting/start-at"),
        (&show, "--at=9223372036854775808", "session/setting/first"),
        (&show, "--display-rate=0.1", "session/setting/display-rate 100000"),
        (&show, "--set=show.ahead=1000000", "session/setting/ahead 64"),
        (&show, "--set=show.ahead=-1", "arguments/settings-value show.ahead"),
        (&show, "--set=show.sync=nan", "produce/job/not-finite"),
        (&steer, "--set=show.display_latency=-1ms", "arguments/settings-value show.display_latency"),
        (&solve, "--set=viewing.luminance=1e308", "arguments/settings-value viewing.luminance 1e12"),
    ];
    for (command, option, what) in cases {
        refused(at, &[command, &[option]].concat(), "out.zarr", what);
    }
}

#[test]
fn display_files_of_impossible_values_are_refused_with_their_key() {
    let temp = folder();
    let at = temp.path();
    let good = "resolution = [16, 16]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n[encoding]\n\
                offset_px = [1, 2]\n[[encoding.grating]]\nperiod_px = 8\ndirection_deg = 0\n";
    std::fs::write(at.join("good.toml"), good).unwrap();
    done(at, &["display", "check", "good.toml"]);
    for (from, to, what) in [
        ("[16, 16]", "[16, 16, 16]", "optics/display-file"),
        ("[1, 2]", "[1, 2, 3]", "optics/display-file offset_px"),
        ("= 8\n", "= -8\n", "optics/display-file/grating"),
        ("= 8\n", "= nan\n", "optics/display-file/grating"),
    ] {
        std::fs::write(at.join("bad.toml"), good.replace(from, to)).unwrap();
        refused(at, &["solve", "builtin:plane", "--display", "bad.toml", "-o", "x.zarr"], "x.zarr", what);
    }
}

#[test]
fn a_command_that_fails_leaves_no_folder() {
    let temp = folder();
    let at = temp.path();
    let no_kernel = ["--engine", "vulkan-from:none"];
    refused(
        at,
        &[&["demo", "--size", "16", "--out", "out"], &no_kernel[..]].concat(),
        "out",
        "usage/value-validation modulate",
    );
    let far =
        ["--size", "16x16", "--view-pitch", "1e9", "--force", "--engine", "cpu", "--methods", "dpac", "-o", "out"];
    refusal(at, &[&["eval", "compare", "builtin:still-life"], &far[..]].concat()).is("optics/unusual");
    assert!(!at.join("out").exists());
}
