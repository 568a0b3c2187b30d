//! Lists the files of a folder in the order of the numbers in their names.

use crate::SceneError;
use eyebox_base::reason;
use std::{fs, path::Path};

/// Returns the names of a folder's files, in the order of their numbers.
pub(crate) fn files(folder: &Path) -> Result<Vec<String>, SceneError> {
    let unreadable = |e: std::io::Error| SceneError::unreadable(folder, &e);
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        if let Some(name) = name(&entry)?.filter(|_| entry.path().is_file()) {
            found.push(name);
        }
    }
    found.sort_by_cached_key(|name| natural(name));
    Ok(found)
}

/// Returns true if the extension of a name is one that views can have.
pub(crate) fn is_picture(name: &str) -> bool {
    let end = name.rsplit_once('.').map_or(String::new(), |(_, e)| e.to_ascii_lowercase());
    ["png", "jpg", "jpeg", "exr", "tif", "tiff", "bmp", "ppm", "pgm", "pnm"].contains(&end.as_str())
}

/// Returns the name of an entry. It returns `None` for hidden files, such as the ones that macOS leaves next to
/// pictures (`._view.png`).
///
/// # Errors
/// [`SceneError::Unreadable`] for a picture whose name is not UTF-8. Other files with such names return `None`.
pub(crate) fn name(entry: &fs::DirEntry) -> Result<Option<String>, SceneError> {
    let name = entry.file_name();
    match name.to_str() {
        Some(name) => Ok((!name.starts_with('.')).then(|| name.to_owned())),
        None if is_picture(&name.to_string_lossy()) => Err(SceneError::Unreadable {
            path: entry.path().display().to_string(),
            reason: reason!("name-not-utf8", "its name is not UTF-8, so rename it"),
        }),
        None => Ok(None),
    }
}

/// Splits a name into pieces of text and numbers, so that frame-9 comes before frame-10.
pub fn natural(name: &str) -> Vec<(String, u64)> {
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
