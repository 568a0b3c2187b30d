//! Mistakes on the command line give one line with the right form.

use crate::common::{Printed, Refusal, done, eyebox, folder, refusal, text};

/// Arguments with the code of their error, and the options, values and numbers that the line must have.
const MISTAKES: [(&[&str], &str, &str); 16] = [
    (
        &["render", "h.zarr", "--pupil", "1,2,3", "-o", "a.png"],
        "value-validation",
        "--pupil 1,2,3 x,y,diameter,focus 2,-1,4,1.5",
    ),
    (
        &["render", "h.zarr", "--pupil", "1,2,3,4,5", "-o", "a.png"],
        "value-validation",
        "--pupil 1,2,3,4,5 5 x,y,diameter,focus",
    ),
    (&["render", "h.zarr", "--pupil", "4", "-o", "a.png"], "value-validation", "--pupil x,y,diameter,focus"),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--steps", "-1"], "value-validation", "-1 --steps 0"),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--frames", "-2"], "value-validation", "-2 --frames"),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--duration", "-2"], "value-validation", "-2 --duration"),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--seed", "-2"], "value-validation", "-2 --seed 0"),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--steps=-1"], "value-validation", "-1 --steps 0"),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--steps", "many"], "value-validation", "many --steps 0"),
    (&["solve", "builtin:plane", "--output", "x.zarr"], "value-validation", "--output --out"),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--nonsense"], "unknown-argument", "--nonsense"),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--stepss", "1"], "unknown-argument", "--stepss --steps"),
    (&["bogus"], "invalid-subcommand", "bogus"),
    (&["eval", "bogus"], "invalid-subcommand", "bogus"),
    (&["view", "h.zarr", "--pupil=0,0,4,0", "-o", "a.png"], "invalid-subcommand", "view render"),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--seconds", "2"], "unknown-argument", "--seconds --duration"),
];

#[test]
fn each_mistake_is_one_line_with_what_would_be_right() {
    let here = folder();
    for (words, code, says) in MISTAKES {
        let answer = eyebox(here.path(), words);
        let said = text(&answer.stderr);
        assert_eq!((answer.status.code(), said.trim().lines().count()), (Some(2), 1), "{words:?}: {said}");
        assert!(said.has(says), "{words:?}: {said}");
        assert_eq!(refusal(here.path(), words).code, format!("usage/{code}"), "{words:?}");
        assert!(!said.contains("-- -"), "{words:?} advises what does not work: {said}");
    }
    // Options that allow negative values accept them.
    let at = here.path();
    let plain = ["solve", "builtin:plane", "--size", "16x16", "--color", "green", "--frames", "1", "--engine", "cpu"];
    done(at, &[&plain[..], &["--steps", "1", "--psnr", "-5", "-o", "x.zarr"]].concat());
}

#[test]
fn errors_are_sentences_or_json() {
    let here = folder();
    let of = |args: &[&str]| eyebox(here.path(), args);
    let said = text(&of(&["info", "absent.png"]).stderr);
    assert!(said.starts_with("eyebox: ") && said.contains("absent.png"), "{said}");
    let asked = Refusal::of(&of(&["info", "absent.png", "--json"]));
    assert_eq!(format!("eyebox: {}\n", asked.message), said);
    asked.is("scene/not-found");
    let unknown = Refusal::of(&of(&["info", "absent.png", "--json", "--nonsense"]));
    unknown.is("usage/unknown-argument");
    assert_eq!(unknown.fields["argument"], "--nonsense");
}

#[test]
fn help_of_help_is_help() {
    let here = folder();
    let of = |words: &[&str]| done(here.path(), words);
    assert_eq!(of(&["help", "--help"]), of(&["help", "help"]));
    assert_eq!(of(&["help", "-h"]), of(&["help", "help"]));
    assert_eq!(of(&["help", "solve", "--help"]), of(&["help", "solve"]));
    assert!(of(&["help"]).contains("solve"));
}
