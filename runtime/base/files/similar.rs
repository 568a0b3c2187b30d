//! Finds the existing file name that is most like a misspelled one.

use super::atomic::parent;
use std::path::Path;

/// Number of letters in which names may differ.
const MOST: usize = 2;

/// Returns the file or folder with the most similar name, in the folder of a path that does not exist. The text after a
/// question mark stays.
pub fn similar(path: &str) -> Option<String> {
    let (file, query) = path.split_once('?').map_or((path, String::new()), |(file, query)| (file, format!("?{query}")));
    let file = Path::new(file);
    let name = file.file_name()?.to_str()?.to_lowercase();
    let entries = std::fs::read_dir(parent(file)).ok()?;
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let likely =
        names.map(|other| (apart(&name, &other.to_lowercase()), other)).filter(|(letters, _)| *letters <= MOST);
    // Short names are often similar by accident.
    let (_, other) = likely.filter(|(letters, _)| 3 * letters < name.chars().count()).min()?;
    Some(format!("{}{query}", file.with_file_name(other).display()))
}

/// Returns the number of letters to insert, remove or exchange until both are the same. Two swapped letters count as
/// one.
fn apart(a: &str, b: &str) -> usize {
    let [a, b] = [a, b].map(|text| text.chars().collect::<Vec<_>>());
    let mut rows = vec![(0..=b.len()).collect::<Vec<_>>()];
    for i in 0..a.len() {
        let mut row = vec![i + 1];
        for j in 0..b.len() {
            let mut least = (rows[i][j] + usize::from(a[i] != b[j])).min(rows[i][j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && a[i] == b[j - 1] && a[i - 1] == b[j] {
                least = least.min(rows[i - 1][j - 1] + 1);
            }
            row.push(least);
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelled_name_is_found() {
        let here = tempfile::tempdir().unwrap();
        let at = |name: &str| here.path().join(name).display().to_string();
        for name in ["depth.png", "views", "a.png"] {
            std::fs::write(at(name), "").unwrap();
        }
        for (wrong, right) in [
            ("depht.png", Some("depth.png")),
            ("Depth.png", Some("depth.png")),
            ("view", Some("views")),
            ("veiws?grid=3x3", Some("views?grid=3x3")),
            ("something", None),
            ("none/depth.png", None),
        ] {
            assert_eq!(similar(&at(wrong)), right.map(at), "{wrong}");
        }
    }
}
