//! The runtime's modules keep their order (ARCHITECTURE.md), no two files import each other in a circle, and no file is
//! too long. Code that is only for tests may import anything.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The order of modules in crates that have several. An entry has the folder of the crate, the module that contains the
/// ordered modules, and their names. A module imports only modules before it. Cargo keeps the order of crates.
const ORDER: [(&str, &[&str], &[&str]); 4] = [
    ("runtime/compute", &[], &["plan", "gpu", "engine"]),
    ("runtime/scene", &[], &["light_field", "formats", "splats", "builtin", "depth", "synthesis", "read"]),
    ("runtime/session", &["session"], &["frame_log", "playback", "refinement", "content", "feeds"]),
    (
        "runtime/solve",
        &[],
        &["encode", "evaluate", "solve", "hologram", "reconstruction", "encoded", "tiled", "quality", "produce"],
    ),
];

/// Maximum number of lines of a file.
const LINES: usize = 500;

/// Folders of the crates outside `runtime`. The test reads each of them separately.
const CRATES: [&str; 8] =
    ["kernels", "spirv", "tools/c", "tools/command", "tools/live-input", "tools/openxr", "tools/python", "tools/spirv"];

pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace")
}

/// Returns the folders of all crates. It lists `runtime`, so that it includes new crates.
fn crates() -> Vec<String> {
    let of_runtime = std::fs::read_dir(root().join("runtime")).expect("the folder of crates");
    let name = |entry: std::io::Result<std::fs::DirEntry>| {
        format!("runtime/{}", entry.expect("an entry").file_name().to_string_lossy())
    };
    let mut all: Vec<String> = of_runtime.map(name).chain(CRATES.map(String::from)).collect();
    all.retain(|folder| root().join(folder).is_dir());
    all.sort();
    all
}

pub(crate) fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name").to_string_lossy();
        if path.is_dir() && !name.starts_with("target") && !name.starts_with('.') {
            rust_files(&path, found);
        } else if name.ends_with(".rs") {
            found.push(path);
        }
    }
    found.sort();
}

/// Returns identifiers and punctuation, with `::` as one token, without comments, literals and lifetimes.
pub(crate) fn tokens(text: &str) -> Vec<&str> {
    let bytes = text.as_bytes();
    let word = |b: u8| b.is_ascii_alphanumeric() || b == b'_' || b >= 0x80;
    let find = |from: usize, what: &str| text[from..].find(what).map_or(bytes.len(), |at| from + at + what.len());
    let (mut out, mut i) = (Vec::new(), 0);
    while i < bytes.len() {
        let rest = &bytes[i..];
        if rest.starts_with(b"//") {
            i = find(i, "\n");
        } else if rest.starts_with(b"/*") {
            i = find(i, "*/");
        } else if rest[0] == b'"' {
            i += 1;
            while i < bytes.len() && bytes[i] != b'"' {
                i += if bytes[i] == b'\\' { 2 } else { 1 };
            }
            i += 1;
        } else if rest.starts_with(b"r\"") || rest.starts_with(b"r#\"") || rest.starts_with(b"br\"") {
            let quote = find(i, "\"");
            let hashes = text[i..quote].matches('#').count();
            i = find(quote, &format!("\"{}", "#".repeat(hashes)));
        } else if rest[0] == b'\'' {
            // This is a character or a lifetime.
            let escaped = rest.get(1) == Some(&b'\\');
            let length = text[i + 1..].chars().next().map_or(1, char::len_utf8);
            match escaped || rest.get(1 + length) == Some(&b'\'') {
                true => i = find(i + if escaped { 3 } else { 1 + length }, "'"),
                false => i += 1,
            }
        } else if word(rest[0]) {
            let length = rest.iter().take_while(|b| word(**b)).count();
            out.push(&text[i..i + length]);
            i += length;
        } else if rest.starts_with(b"::") {
            out.push("::");
            i += 2;
        } else {
            if !rest[0].is_ascii_whitespace() {
                out.push(&text[i..=i]);
            }
            i += 1;
        }
    }
    out
}

/// Returns the index after the bracket that closes the one at `at`.
fn closed(tokens: &[&str], at: usize) -> usize {
    let mut depth = 0;
    for (i, token) in tokens.iter().enumerate().skip(at) {
        match *token {
            "{" | "(" | "[" => depth += 1,
            "}" | ")" | "]" => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return i + 1;
        }
    }
    tokens.len()
}

/// Returns the tokens without items for tests.
fn without_tests<'a>(tokens: &[&'a str]) -> Vec<&'a str> {
    let (mut out, mut i) = (Vec::new(), 0);
    while i < tokens.len() {
        let attribute = tokens[i] == "#" && tokens.get(i + 1) == Some(&"[");
        let end = if attribute { closed(tokens, i + 1) } else { i + 1 };
        let within = &tokens[i..end];
        let tests = attribute && within[2] == "cfg" && within.contains(&"test") && !within.contains(&"not");
        i = end;
        if !tests {
            out.extend(within);
            continue;
        }
        while i < tokens.len() && tokens[i] != ";" && tokens[i] != "{" {
            i = if matches!(tokens[i], "(" | "[") { closed(tokens, i) } else { i + 1 };
        }
        i = if tokens.get(i) == Some(&"{") { closed(tokens, i) } else { i + 1 };
    }
    out
}

/// A name that a `use` imports ("*" for all names), and its path.
pub(crate) type Import = (String, Vec<String>);

/// Reads a use tree and returns the index after it.
pub(crate) fn use_tree(tokens: &[&str], mut at: usize, prefix: &[String], out: &mut Vec<Import>) -> usize {
    let mut path = prefix.to_vec();
    loop {
        match tokens[at] {
            "{" => {
                at += 1;
                while tokens[at] != "}" {
                    at = use_tree(tokens, at, &path, out);
                    at += usize::from(tokens[at] == ",");
                }
                return at + 1;
            }
            "*" => {
                out.push(("*".into(), path));
                return at + 1;
            }
            "::" => at += 1,
            name => {
                // `a::{self}` means `a`.
                if name != "self" || path.is_empty() {
                    path.push(name.into());
                }
                at += 1;
                if tokens.get(at) == Some(&"as") {
                    out.push((tokens[at + 1].into(), path));
                    return at + 2;
                }
                if tokens.get(at) != Some(&"::") {
                    out.push((path.last().cloned().unwrap_or_default(), path));
                    return at;
                }
            }
        }
    }
}

/// The names that a file defines, imports and uses.
#[derive(Default)]
struct Source {
    /// Module path from the root of the crate.
    module: Vec<String>,
    defined: BTreeSet<String>,
    imports: Vec<Import>,
    /// Paths that count as imports of this file, from `use` lines that are not re-exports and from its code.
    named: Vec<Vec<String>>,
}

impl Source {
    fn read(path: &Path, module: Vec<String>) -> Self {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let all = tokens(&text);
        let tokens = without_tests(&all);
        let mut source = Self { module, ..Self::default() };
        let (mut i, mut depth, mut children) = (0, 0, BTreeSet::new());
        while i < tokens.len() {
            let next = tokens.get(i + 1).copied().unwrap_or("");
            match tokens[i] {
                "{" => depth += 1,
                "}" => depth -= 1,
                "use" if next != "<" => {
                    let mut brought = Vec::new();
                    let public = i > 0 && (tokens[i - 1] == "pub" || tokens[i - 1] == ")");
                    i = use_tree(&tokens, i + 1, &[], &mut brought);
                    if !public {
                        source.named.extend(brought.iter().map(|(_, path)| path.clone()));
                    }
                    source.imports.extend(brought);
                    continue;
                }
                "mod" if depth == 0 && tokens.get(i + 2) == Some(&";") => {
                    children.insert(next);
                }
                "fn" | "struct" | "enum" | "trait" | "type" | "const" | "static" | "union" if depth == 0 => {
                    source.defined.insert(next.into());
                }
                "macro_rules" => {
                    source.defined.insert(tokens[i + 2].into());
                }
                "$" if next == "crate" => i += 1,
                first if next == "::" && i > 0 && tokens[i - 1] != "::" => {
                    let relative = matches!(first, "crate" | "super" | "self");
                    if relative || children.contains(first) {
                        let mut path = vec![first.to_string()];
                        while tokens.get(i + 1) == Some(&"::") && tokens[i + 2].starts_with(|c: char| c.is_alphabetic())
                        {
                            i += 2;
                            path.push(tokens[i].into());
                        }
                        source.named.push(path);
                    }
                }
                _ => {}
            }
            i += 1;
        }
        source
    }
}

/// The files of a crate, by module.
struct Crate {
    files: Vec<(String, Source)>,
    by_module: BTreeMap<Vec<String>, usize>,
}

impl Crate {
    fn read(folder: &str) -> Self {
        let mut paths = Vec::new();
        rust_files(&root().join(folder), &mut paths);
        let mut files = Vec::new();
        for path in paths {
            let inside = path.strip_prefix(root().join(folder)).expect("inside");
            let mut module: Vec<String> =
                inside.with_extension("").iter().map(|s| s.to_string_lossy().into_owned()).collect();
            let name = module.last().expect("a name").clone();
            if module.iter().any(|m| m == "tests" || m == "examples" || m == "benches") || name.ends_with("_tests") {
                continue;
            }
            if matches!(&name[..], "mod" | "lib" | "main") {
                module.pop();
            }
            files.push((format!("{folder}/{}", inside.display()), Source::read(&path, module)));
        }
        let by_module = files.iter().enumerate().map(|(i, (_, s))| (s.module.clone(), i)).collect();
        Self { files, by_module }
    }

    /// Returns the file that defines the item at `path`, as seen from `file`. Returns `None` for other crates.
    fn resolve(&self, file: usize, path: &[String], depth: usize) -> Option<usize> {
        let mut module = self.files[file].1.module.clone();
        let mut segments = path.iter().peekable();
        match path.first().map(String::as_str)? {
            "crate" => {
                module.clear();
                segments.next();
            }
            "self" => drop(segments.next()),
            "super" => {
                while segments.next_if(|s| *s == "super").is_some() {
                    module.pop();
                }
            }
            first => {
                module.push(first.into());
                let child = self.by_module.contains_key(&module);
                module.pop();
                if !child {
                    return None;
                }
            }
        }
        while let Some(name) = segments.next() {
            module.push(name.clone());
            if self.by_module.contains_key(&module) {
                continue;
            }
            module.pop();
            let at = *self.by_module.get(&module)?;
            let source = &self.files[at].1;
            if source.defined.contains(name) || depth == 0 {
                return Some(at);
            }
            let rest = || segments.clone().cloned();
            if let Some((_, brought)) = source.imports.iter().find(|(as_name, _)| as_name == name) {
                let full: Vec<String> = brought.iter().cloned().chain(rest()).collect();
                return self.resolve(at, &full, depth - 1);
            }
            for (_, brought) in source.imports.iter().filter(|(as_name, _)| as_name == "*") {
                let full: Vec<String> = brought.iter().cloned().chain([name.clone()]).chain(rest()).collect();
                if let Some(found) = self.resolve(at, &full, depth - 1) {
                    return Some(found);
                }
            }
            return Some(at);
        }
        self.by_module.get(&module).copied()
    }

    /// Returns the imports of each file.
    fn edges(&self) -> Vec<BTreeSet<usize>> {
        let of = |i: usize| {
            let found = self.files[i].1.named.iter().filter_map(|path| self.resolve(i, path, 8));
            found.filter(|to| *to != i).collect()
        };
        (0..self.files.len()).map(of).collect()
    }
}

/// Returns a shortest path from one file to another along imports.
fn way(edges: &[BTreeSet<usize>], from: usize, to: usize) -> Option<Vec<usize>> {
    let mut before = BTreeMap::from([(from, from)]);
    let mut queue = std::collections::VecDeque::from([from]);
    while let Some(at) = queue.pop_front() {
        if at == to {
            let mut way = vec![to];
            while way[way.len() - 1] != from {
                way.push(before[&way[way.len() - 1]]);
            }
            way.reverse();
            return Some(way);
        }
        for next in &edges[at] {
            if !before.contains_key(next) {
                before.insert(*next, at);
                queue.push_back(*next);
            }
        }
    }
    None
}

#[test]
fn modules_import_only_modules_before_them() {
    let mut wrong = Vec::new();
    for (folder, parent, order) in ORDER {
        let runtime = Crate::read(folder);
        // Files next to the ordered modules are above all of them.
        let place = |i: usize| {
            let inside = runtime.files[i]
                .1
                .module
                .strip_prefix(&parent.iter().map(|p| p.to_string()).collect::<Vec<_>>()[..])?;
            let name = inside.first()?;
            Some(order.iter().position(|module| module == name).unwrap_or(order.len()))
        };
        for name in order {
            let is_there = (0..runtime.files.len()).any(|i| place(i) == order.iter().position(|module| module == name));
            assert!(is_there, "{folder}: {name} is no module");
        }
        for (i, edges) in runtime.edges().iter().enumerate() {
            for to in edges {
                if let (Some(a), Some(b)) = (place(i), place(*to))
                    && a < b
                {
                    wrong.push(format!("{} imports {}", runtime.files[i].0, runtime.files[*to].0));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "imports against the order of the modules:\n{}", wrong.join("\n"));
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let mut circles = Vec::new();
    let folders = crates();
    assert!(folders.len() > 15, "{folders:?}");
    for folder in &folders {
        let all = Crate::read(folder);
        let edges = all.edges();
        let mut seen = BTreeSet::new();
        for (i, next) in edges.iter().enumerate() {
            let shortest = next.iter().filter_map(|n| way(&edges, *n, i)).min_by_key(Vec::len);
            let Some(circle) = shortest else { continue };
            let names: Vec<_> = circle.iter().map(|f| all.files[*f].0.as_str()).collect();
            if seen.insert(circle.iter().copied().collect::<BTreeSet<_>>()) {
                circles.push(names.join(" -> "));
            }
        }
    }
    assert!(circles.is_empty(), "files that import each other in a circle:\n{}", circles.join("\n"));
}

#[test]
fn no_file_is_too_long() {
    let mut paths = Vec::new();
    rust_files(root(), &mut paths);
    assert!(paths.len() > 100, "the workspace's files");
    let lines = |p: &PathBuf| std::fs::read_to_string(p).expect("a file").lines().count();
    let long: Vec<_> = paths.iter().map(|p| (p, lines(p))).filter(|(_, n)| *n > LINES).collect();
    assert!(long.is_empty(), "files of more than {LINES} lines: {long:?}");
}

/// A program that embeds the library has no options. The command adds them to the messages of the library.
#[test]
fn the_library_names_no_option_of_the_command() {
    let mut paths = Vec::new();
    rust_files(&root().join("runtime"), &mut paths);
    // This file has commands of xrandr.
    let of_others = root().join("runtime/present/interference.rs");
    let own = paths.iter().filter(|path| **path != of_others);
    for path in own.filter(|path| !path.display().to_string().contains("test")) {
        let text = std::fs::read_to_string(path).expect("a file");
        let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
        for line in code.lines().filter(|line| !line.trim_start().starts_with("//")) {
            // Variables of style sheets are names before a colon or a bracket.
            let option = line.split("--").skip(1).find(|rest| {
                let name = rest.trim_start_matches(|c: char| c.is_ascii_lowercase() || c == '-');
                name.len() + 1 < rest.len() && !name.starts_with([':', ')'])
            });
            assert!(option.is_none(), "{}: {line}", path.display());
        }
    }
}

/// `unsafe` is in code for Vulkan, for handles of windows, for memory shared with an application, for calls from C and
/// of OpenXR, and for phases that NumPy borrows. Clippy checks that each block has a comment with its reason. Only the shared memory
/// is mapped.
#[test]
fn unsafe_is_where_the_page_of_promises_says() {
    const SHARED: &str = "tools/live-input/region.rs";
    const AT: [&str; 12] = [
        "runtime/compute/gpu/",
        "runtime/compute/engine/vulkan/",
        "runtime/present/",
        "runtime/session/preview/window.rs",
        "runtime/eyebox/examples/own_vulkan_device.rs",
        SHARED,
        "tools/c/",
        "tools/openxr/layer/",
        "tools/openxr/tests/",
        "tools/openxr/vulkan/",
        "tools/python/hologram.rs",
        "tests/",
    ];
    let page = std::fs::read_to_string(root().join("docs/reliability.md")).expect("the page");
    let mut paths = Vec::new();
    rust_files(root(), &mut paths);
    for path in paths {
        let text = std::fs::read_to_string(&path).expect("a file");
        let name = path.strip_prefix(root()).expect("inside").display().to_string();
        if tokens(&text).contains(&"unsafe") {
            assert!(AT.iter().any(|at| name.starts_with(at)), "{name} has `unsafe`, but is not in the list");
        }
        assert!(
            !tokens(&text).iter().any(|word| ["mmap", "Mmap", "memmap2"].contains(word))
                || name.starts_with("tests/")
                || name == SHARED,
            "{name} maps files"
        );
    }
    let missing: Vec<_> = AT.iter().filter(|at| !at.starts_with("tests") && !page.contains(*at)).collect();
    assert!(missing.is_empty(), "docs/reliability.md does not name {missing:?}");
}
