//! `eyebox completions` and `eyebox man` as a user runs them, and the help from which they are made.

use crate::common::{done, folder, refused};

#[test]
fn every_shell_completes_commands_and_their_options() {
    let folder = folder();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let text = done(folder.path(), &["completions", shell]);
        let option = if shell == "fish" { "-l depth-map" } else { "--depth-map" };
        assert!(text.contains("render") && text.contains(option), "{shell}: {text}");
    }
    refused(folder.path(), &["completions", "tcl"], "x", "usage/invalid-value bash");
}

#[test]
fn there_is_a_page_of_the_manual_for_every_command() {
    let folder = folder();
    done(folder.path(), &["man", "-o", "man1"]);
    let pages = folder.path().join("man1");
    let read = |words: &[&str]| std::fs::read_to_string(pages.join(format!("{}.1", words.join("-")))).unwrap();
    // The groups are the program itself and each group of commands.
    for group in
        [&["eyebox"][..], &["eyebox", "eval"], &["eyebox", "display"], &["eyebox", "device"], &["eyebox", "tracker"]]
    {
        let help = done(folder.path(), &[&["help"], &group[1..]].concat());
        let listed = help.lines().skip_while(|l| *l != "Commands:").skip(1).take_while(|l| !l.is_empty());
        // A line with a deeper indent continues the description of a command.
        let names =
            listed.filter_map(|l| l.strip_prefix("  ")?.split(' ').next().filter(|n| !["", "help"].contains(n)));
        let names: Vec<_> = names.collect();
        assert!(names.len() >= 2, "{group:?}: {help}");
        for name in names {
            let words = [group, &[name]].concat();
            // Pages have a backslash before a hyphen.
            let page = read(&words).replace("\\-", "-");
            assert!(page.contains(".SH SYNOPSIS") && page.contains(&words.join(" ")), "{name}: {page}");
            assert!(read(group).replace("\\-", "-").contains(name), "{name}");
        }
    }
    std::fs::write(folder.path().join("file"), "").unwrap();
    refused(folder.path(), &["man", "-o", "file/man1"], "file/man1", "file/taken/no-such-folder");
}

#[test]
fn forty_options_stand_under_headings() {
    let folder = folder();
    let help = done(folder.path(), &["help", "solve"]);
    let options = ["--depth-map", "--size", "--duration", "--json"];
    let heading_of = |option: &&str| {
        let lines: Vec<&str> = help.lines().collect();
        let at = lines.iter().position(|line| line.trim_start().starts_with(option)).expect("the option");
        lines[..at].iter().rev().find(|line| line.ends_with(':') && !line.starts_with(' ')).copied().expect("a heading")
    };
    let headings: std::collections::BTreeSet<&str> = options.iter().map(heading_of).collect();
    assert_eq!(headings.len(), options.len(), "{headings:?}");
    // The short help has the usual options in one list.
    let short = done(folder.path(), &["solve", "--help"]);
    assert!(short.contains("--steps") && !short.contains("--near"), "{short}");
    assert_eq!(done(folder.path(), &["solve", "--help=all"]), help);
}
