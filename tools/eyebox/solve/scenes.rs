//! The scenes that a solve's arguments mean.

use crate::args::Solve;
use eyebox::scene;
use std::fs;
use std::path::Path;

/// One, or the frames of a sequence.
pub fn of(args: &Solve) -> Vec<String> {
    let first = &args.scene.scene;
    if !args.more.is_empty() {
        return [std::slice::from_ref(first), &args.more].concat();
    }
    folders(Path::new(first)).unwrap_or_else(|| vec![first.clone()])
}

/// The folders in a folder that has no pictures of its own, in the order of the numbers in their names.
fn folders(folder: &Path) -> Option<Vec<String>> {
    let entries: Vec<_> = fs::read_dir(folder).ok()?.flatten().collect();
    if scene::native_size(folder.to_str()?).is_ok() {
        return None;
    }
    let mut found: Vec<String> = (entries.iter())
        .filter(|e| e.path().is_dir() && !e.file_name().to_string_lossy().starts_with('.'))
        .filter_map(|e| e.path().to_str().map(str::to_owned))
        .collect();
    found.sort_by_cached_key(|name| natural(name));
    (!found.is_empty()).then_some(found)
}

/// A name as pieces of text and numbers: frame-9 comes before frame-10.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut pieces = vec![(String::new(), 0u64)];
    let mut in_number = false;
    for c in name.chars() {
        match (c.to_digit(10), pieces.last_mut()) {
            (Some(digit), Some(last)) => {
                last.1 = last.1.saturating_mul(10).saturating_add(u64::from(digit));
                in_number = true;
            }
            (None, Some(last)) if !in_number => last.0.push(c),
            _ => {
                pieces.push((c.to_string(), 0));
                in_number = false;
            }
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_in_the_order_of_their_numbers() {
        let mut names = ["f10", "f9", "a/2/f1", "f9b2", "f9b10", "f", "f99999999999999999999999"];
        names.sort_by_cached_key(|n| natural(n));
        assert_eq!(names, ["a/2/f1", "f", "f9", "f9b2", "f9b10", "f10", "f99999999999999999999999"]);
    }
}
