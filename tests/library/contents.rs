//! Tables and figures of the documents that are generated from the code. ARCHITECTURE.md lists crates and modules with
//! the first sentences of their documentation. The front page of the facade lists its modules, and `docs/crates.svg`
//! shows the dependencies that `cargo metadata` prints.
//!
//! `EYEBOX_WRITE=1 cargo test -p eyebox-tests --test library contents` writes them again.

use crate::architecture::root;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A crate of `runtime/`, from its manifest and its front page.
struct Room {
    name: String,
    folder: PathBuf,
    description: String,
    /// Crates of `runtime/` that it uses.
    uses: BTreeSet<String>,
    /// Public modules, each with its first sentence. The list is empty if the items are at the root.
    modules: Vec<(String, String)>,
}

/// Returns the first sentence of a module's documentation.
fn first_sentence(file: &Path) -> String {
    let text = fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let lines = text.lines().map_while(|line| line.strip_prefix("//!")).map(str::trim);
    let paragraph: Vec<&str> = lines.take_while(|line| !line.is_empty()).collect();
    let paragraph = paragraph.join(" ");
    assert!(!paragraph.is_empty(), "{}: it has no documentation", file.display());
    let is_end = |at: &usize| paragraph[at + 2..].starts_with(|c: char| c.is_uppercase() || c == '[');
    let stops = paragraph.match_indices(". ").map(|(at, _)| at);
    let end = { stops }.find(is_end).unwrap_or(paragraph.trim_end_matches('.').len());
    paragraph[..end].to_owned()
}

/// Returns the public modules of a crate in the order of its front page.
fn modules(folder: &Path) -> Vec<(String, String)> {
    let front = fs::read_to_string(folder.join("lib.rs")).expect("a front page");
    let names = front.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';'));
    let file = |name: &str| {
        let one = folder.join(format!("{name}.rs"));
        if one.is_file() { one } else { folder.join(name).join("mod.rs") }
    };
    names.map(|name| (name.to_owned(), first_sentence(&file(name)))).collect()
}

/// Returns the crates of `runtime/`, each after the crates that it uses.
fn rooms() -> Vec<Room> {
    let mut cargo = Command::new(env!("CARGO"));
    let cargo = cargo.args(["metadata", "--no-deps", "--format-version", "1", "--offline"]).current_dir(root());
    let metadata: Value = serde_json::from_slice(&cargo.output().expect("cargo").stdout).expect("metadata");
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let mut left: BTreeMap<String, Room> = BTreeMap::new();
    for package in metadata["packages"].as_array().expect("packages") {
        let folder = PathBuf::from(text(&package["manifest_path"])).parent().expect("a folder").to_owned();
        if folder.parent() != Some(&root().join("runtime")) {
            continue;
        }
        let dependencies = package["dependencies"].as_array().expect("dependencies");
        let uses = dependencies.iter().filter(|d| d["kind"].is_null()).map(|d| text(&d["name"])).collect();
        let (name, description) = (text(&package["name"]), text(&package["description"]));
        let modules = modules(&folder);
        left.insert(name.clone(), Room { name, folder, description, uses, modules });
    }
    let names: BTreeSet<String> = left.keys().cloned().collect();
    left.values_mut().for_each(|room| room.uses = room.uses.intersection(&names).cloned().collect());
    let mut sorted: Vec<Room> = Vec::new();
    while !left.is_empty() {
        let is_ready = |room: &Room| room.uses.iter().all(|used| sorted.iter().any(|before| before.name == *used));
        let next = left.values().find(|room| is_ready(room)).expect("no crates that use each other").name.clone();
        sorted.extend(left.remove(&next));
    }
    sorted
}

/// Returns the direct dependencies of a crate that are not also dependencies of another of them.
fn direct_uses<'a>(rooms: &'a [Room], room: &'a Room) -> Vec<&'a str> {
    let find = |name: &str| rooms.iter().find(|room| room.name == name).expect("a crate");
    fn reaches(rooms: &[Room], from: &Room, to: &str) -> bool {
        let used = |name: &String| rooms.iter().find(|room| room.name == *name).expect("a crate");
        from.uses.iter().any(|name| name == to || reaches(rooms, used(name), to))
    }
    let uses = room.uses.iter().map(String::as_str);
    uses.filter(|name| !room.uses.iter().any(|other| reaches(rooms, find(other), name))).collect()
}

fn short(name: &str) -> &str {
    name.strip_prefix("eyebox-").unwrap_or(name)
}

/// Returns the tables of crates and modules for ARCHITECTURE.md.
fn tables(rooms: &[Room]) -> String {
    let mut out = String::from("| crate | what belongs in it | uses |\n|---|---|---|\n");
    for room in rooms {
        let uses: Vec<String> = direct_uses(rooms, room).iter().map(|name| format!("`{}`", short(name))).collect();
        let folder = room.folder.file_name().expect("a name").to_string_lossy();
        let about = room.description.trim_end_matches(", for eyebox");
        writeln!(out, "| `{}` (`runtime/{folder}`) | {about} | {} |", room.name, uses.join(", ")).unwrap();
    }
    for room in rooms.iter().filter(|room| !room.modules.is_empty()) {
        writeln!(out, "\n| module of `{}` | what belongs in it |\n|---|---|", room.name).unwrap();
        for (name, about) in &room.modules {
            writeln!(out, "| `{name}` | {} |", plain(about)).unwrap();
        }
    }
    out
}

/// Replaces links of the documentation by their text.
fn plain(sentence: &str) -> String {
    let mut out = String::new();
    let mut rest = sentence;
    while let Some(open) = rest.find('[') {
        out.push_str(&rest[..open]);
        let inner = &rest[open + 1..];
        let close = inner.find(']').expect("a link that ends");
        out.push_str(&inner[..close]);
        rest = &inner[close + 1..];
        if let Some(target) = rest.strip_prefix('(') {
            rest = &target[target.find(')').expect("a target that ends") + 1..];
        }
    }
    out + rest
}

/// Returns the rows of the facade's front page.
fn facade(rooms: &[Room]) -> String {
    let front = fs::read_to_string(root().join("runtime/eyebox/lib.rs")).expect("the facade");
    let mut out = String::from("//! | module | what belongs in it |\n//! |---|---|\n");
    let is_public = |name: &str| front.contains(&format!("pub mod {name} {{"));
    for room in rooms.iter().filter(|room| room.name != "eyebox" && room.name != "eyebox-lab") {
        let one = [(short(&room.name).to_owned(), first_sentence(&room.folder.join("lib.rs")))];
        let is_one =
            room.modules.is_empty() || is_public(&one[0].0) && room.modules.iter().all(|(name, _)| *name != one[0].0);
        let modules = if is_one { &one[..] } else { &room.modules };
        for (name, about) in modules.iter().filter(|(name, _)| is_public(name)) {
            writeln!(out, "//! | [`{name}`] | {} |", plain(about)).unwrap();
        }
    }
    out
}

/// Draws the crates in rows, with the lowest first, and an arrow from each crate to its direct dependencies.
fn figure(rooms: &[Room]) -> String {
    const WIDTH: usize = 124;
    const HEIGHT: usize = 36;
    const GAP_X: usize = 24;
    const GAP_Y: usize = 46;
    let mut rows: BTreeMap<&str, usize> = BTreeMap::new();
    for room in rooms {
        let row = room.uses.iter().map(|used| rows[used.as_str()] + 1).max().unwrap_or(0);
        rows.insert(&room.name, row);
    }
    let count = rows.values().max().map_or(0, |row| row + 1);
    let in_row = |row: usize| rooms.iter().filter(|room| rows[room.name.as_str()] == row).collect::<Vec<_>>();
    let widest = (0..count).map(|row| in_row(row).len()).max().unwrap_or(0);
    let width = widest * (WIDTH + GAP_X) + GAP_X;
    let height = count * (HEIGHT + GAP_Y);
    let place = |name: &str| {
        let row = rows[name];
        let all = in_row(row);
        let at = all.iter().position(|room| room.name == name).expect("a crate");
        let left = (width - all.len() * (WIDTH + GAP_X) + GAP_X) / 2;
        [left + at * (WIDTH + GAP_X), row * (HEIGHT + GAP_Y) + GAP_Y / 2]
    };
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"14\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    for room in rooms {
        let [x, y] = place(&room.name);
        for used in direct_uses(rooms, room) {
            let [to_x, to_y] = place(used);
            let (x, to_x, to_y) = (x + WIDTH / 2, to_x + WIDTH / 2, to_y + HEIGHT);
            writeln!(out, "<path d=\"M{x} {y}L{to_x} {to_y}\" stroke=\"#8a8f98\" fill=\"none\"/>").unwrap();
            writeln!(out, "<circle cx=\"{to_x}\" cy=\"{to_y}\" r=\"3.5\" fill=\"#8a8f98\"/>").unwrap();
        }
    }
    for room in rooms {
        let [x, y] = place(&room.name);
        writeln!(out, "<rect x=\"{x}\" y=\"{y}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" rx=\"6\" fill=\"#eef3fb\" stroke=\"#3b6fb5\"/>")
            .unwrap();
        let (x, y) = (x + WIDTH / 2, y + HEIGHT / 2 + 5);
        writeln!(out, "<text x=\"{x}\" y=\"{y}\" text-anchor=\"middle\" fill=\"#1b2733\">{}</text>", short(&room.name))
            .unwrap();
    }
    out + "</svg>\n"
}

/// Compares the text between two marks of a file, or writes it.
fn check_between(file: &Path, [begin, end]: [&str; 2], wanted: &str) {
    let text = fs::read_to_string(file).expect("a text");
    let from = text.find(begin).unwrap_or_else(|| panic!("{}: no {begin}", file.display())) + begin.len();
    let to = from + text[from..].find(end).unwrap_or_else(|| panic!("{}: no {end}", file.display()));
    check(file, &text, &format!("{}{wanted}{}", &text[..from], &text[to..]));
}

fn check(file: &Path, found: &str, wanted: &str) {
    if std::env::var_os("EYEBOX_WRITE").is_some() {
        fs::write(file, wanted).expect("a file that can be written");
        return;
    }
    let differing = found.lines().zip(wanted.lines()).find(|(found, wanted)| found != wanted);
    assert!(
        found == wanted,
        "{}: differs from the code (first: {differing:?}). EYEBOX_WRITE=1 writes it",
        file.display()
    );
}

#[test]
fn documents_name_the_crates_and_modules_that_there_are() {
    let rooms = rooms();
    let marks = ["<!-- crates: made by tests/library/contents.rs -->\n\n", "\n<!-- end of the crates -->"];
    check_between(&root().join("ARCHITECTURE.md"), marks, &tables(&rooms));
    let marks = ["//! # Modules\n//!\n", "//!\n"];
    check_between(&root().join("runtime/eyebox/lib.rs"), marks, &facade(&rooms));
}

#[test]
fn the_figure_of_the_crates_is_what_cargo_says() {
    let file = root().join("docs/crates.svg");
    check(&file, &fs::read_to_string(&file).unwrap_or_default(), &figure(&rooms()));
}
