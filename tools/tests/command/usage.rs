//! Mistakes on the command line: one line that says what would be right.

use crate::common::{Refusal, done, eyebox, folder, text};

/// What is typed, what the line must say, and what it must not advise.
const MISTAKES: [(&[&str], &[&str]); 13] = [
    (&["view", "h.zarr", "--pupil", "1,2,3", "-o", "a.png"], &["3 values", "x,y,diameter,focus", "2,-1,4,1.5"]),
    (&["view", "h.zarr", "--pupil", "1,2,3,4,5", "-o", "a.png"], &["5 values", "x,y,diameter,focus"]),
    (&["view", "h.zarr", "--pupil", "4", "-o", "a.png"], &["one value", "x,y,diameter,focus"]),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--steps", "-1"], &["'-1'", "--steps", "whole number"]),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--frames", "-2"], &["'-2'", "--frames"]),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--seconds", "-2"], &["'-2'", "--seconds", "positive number"]),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--seed", "-2"], &["'-2'", "--seed", "whole number"]),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--steps=-1"], &["'-1'", "--steps", "whole number"]),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--steps", "many"], &["'many'", "--steps", "whole number"]),
    (&["solve", "builtin:plane", "--output", "x.zarr"], &["--output", "--out"]),
    (&["solve", "builtin:plane", "-o", "x.zarr", "--nonsense"], &["--nonsense"]),
    (
        &["solve", "builtin:plane", "-o", "x.zarr", "--stepss", "1"],
        &["--stepss", "; a similar argument exists: '--steps'"],
    ),
    (&["bogus"], &["bogus"]),
];

#[test]
fn each_mistake_is_one_line_with_what_would_be_right() {
    let here = folder();
    for (words, says) in MISTAKES {
        let answer = eyebox(here.path(), words);
        let said = text(&answer.stderr);
        assert_eq!((answer.status.code(), said.trim().lines().count()), (Some(2), 1), "{words:?}: {said}");
        assert!(says.iter().all(|part| said.contains(part)), "{words:?}: {said}");
        assert!(!said.contains("-- -"), "{words:?} advises what does not work: {said}");
    }
    // Negative values go where they are meant.
    let at = here.path();
    let plain = ["solve", "builtin:plane", "--size", "16x16", "--color", "green", "--frames", "1", "--engine", "cpu"];
    done(at, &[&plain[..], &["--steps", "1", "--psnr", "-5", "-o", "x.zarr"]].concat());
}

#[test]
fn errors_are_sentences_or_json() {
    let here = folder();
    let of = |args: &[&str]| eyebox(here.path(), args);
    let said = text(&of(&["inspect", "absent.zarr"]).stderr);
    assert!(said.starts_with("eyebox: ") && said.contains("absent.zarr"), "{said}");
    let asked = Refusal::of(&of(&["inspect", "absent.zarr", "--json"]));
    assert_eq!(format!("eyebox: {}\n", asked.message), said);
    asked.is("scene/not-found");
    let unknown = Refusal::of(&of(&["inspect", "absent.zarr", "--json", "--nonsense"]));
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
