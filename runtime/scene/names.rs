//! Which files of a folder are the views, and where each stands in the grid.
//!
//! A family is a set of names that differ in one number (a running number, row-major) or in two (row and column).
//! The largest family wins; names that say they are something else (ground truth, depth, thumbnails) come last.

use super::SceneError;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

/// Numbers looked at in a name, from its end.
const NUMBERS: usize = 4;

/// A file name and its size in bytes.
pub(super) type Named = (String, u64);

/// The views of a folder: file names in row-major order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Arrangement {
    pub grid: [usize; 2],
    pub files: Vec<String>,
}

/// One name that belongs to a family: its numbers (row and column, or zero and the running number), as written.
struct Member<'a> {
    at: [u64; 2],
    name: &'a str,
    bytes: u64,
}

#[derive(Default)]
struct Family<'a> {
    running: bool,
    members: Vec<Member<'a>>,
    /// Parts of the name around the numbers, and how many digits these have at least.
    parts: Vec<String>,
    digits: Vec<usize>,
}

/// Ends of names that can be views.
pub(super) fn is_picture(name: &str) -> bool {
    let end = name.rsplit_once('.').map_or(String::new(), |(_, e)| e.to_ascii_lowercase());
    matches!(end.as_str(), "png" | "jpg" | "jpeg" | "exr")
}

fn is_auxiliary(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name.starts_with("gt_") || ["thumb", "depth", "disp", "mask", "normal", "preview"].iter().any(|w| name.contains(w))
}

/// Finds the views among `names`; `stated` is a grid (rows, columns) that a file beside them states.
///
/// # Errors
/// [`SceneError::Empty`], [`SceneError::NotAGrid`], [`SceneError::MissingView`].
pub(super) fn arrange(folder: &Path, names: &[Named], stated: Option<[usize; 2]>) -> Result<Arrangement, SceneError> {
    let families = families(names);
    let best = families.values().max_by_key(|f| f.rank());
    let best = best.ok_or_else(|| SceneError::Empty { folder: folder.display().to_string() })?;
    best.arrange(folder, stated)
}

/// Splits a name into the text around its numbers and the numbers themselves, as written.
fn split(stem: &str) -> (Vec<&str>, Vec<&str>) {
    let (mut texts, mut numbers) = (Vec::new(), Vec::new());
    let mut rest = stem;
    loop {
        let Some(start) = rest.find(|c: char| c.is_ascii_digit()) else {
            texts.push(rest);
            return (texts, numbers);
        };
        let end = rest[start..].find(|c: char| !c.is_ascii_digit()).map_or(rest.len(), |n| start + n);
        texts.push(&rest[..start]);
        numbers.push(&rest[start..end]);
        rest = &rest[end..];
    }
}

fn families(names: &[Named]) -> BTreeMap<String, Family<'_>> {
    let mut families: BTreeMap<String, Family> = BTreeMap::new();
    for (name, bytes) in names.iter().filter(|(name, _)| is_picture(name)) {
        let Some((stem, end)) = name.rsplit_once('.') else { continue };
        let (texts, numbers) = split(stem);
        let first = numbers.len().saturating_sub(NUMBERS);
        for i in first..numbers.len() {
            for j in (i..numbers.len()).rev() {
                // i == j: one number runs. Else: i is the row, j the column.
                let varying = if i == j { vec![i] } else { vec![i, j] };
                let Ok(values) = varying.iter().map(|&k| numbers[k].parse::<u64>()).collect::<Result<Vec<_>, _>>()
                else {
                    continue;
                };
                let mut parts = vec![String::new()];
                for k in 0..numbers.len() {
                    parts.last_mut().expect("there is one").push_str(texts[k]);
                    if varying.contains(&k) {
                        parts.push(String::new());
                    } else {
                        parts.last_mut().expect("there is one").push_str(numbers[k]);
                    }
                }
                let last = parts.last_mut().expect("there is one");
                last.push_str(texts[numbers.len()]);
                last.push('.');
                last.push_str(&end.to_ascii_lowercase());
                let family = families.entry(parts.join("\0")).or_default();
                let at = if i == j { [0, values[0]] } else { [values[0], values[1]] };
                let digits = varying.iter().map(|&k| numbers[k].len());
                family.digits = if family.members.is_empty() {
                    digits.collect()
                } else {
                    family.digits.iter().zip(digits).map(|(&a, b)| a.min(b)).collect()
                };
                family.running = i == j;
                family.parts = parts;
                family.members.push(Member { at, name, bytes: *bytes });
            }
        }
    }
    families
}

impl Family<'_> {
    fn axis(&self, k: usize) -> BTreeSet<u64> {
        self.members.iter().map(|m| m.at[k]).collect()
    }

    /// Larger is better.
    fn rank(&self) -> (bool, usize, u8, u64) {
        let views = !self.members.iter().all(|m| is_auxiliary(m.name));
        let kind = if self.running {
            // A running number needs a square.
            if square(self.members.len()).is_some() { 2 } else { 1 }
        } else {
            // A single row or column: either that, or a fixed number in front of a running one.
            let lines = [self.axis(0), self.axis(1)];
            let fixed = lines.iter().find(|l| l.len() == 1).and_then(|l| l.first());
            match fixed {
                None => 3,
                Some(0 | 1) if self.digits[0] == self.digits[1] => 3,
                Some(_) if square(self.members.len()).is_none() => 1,
                Some(_) => 0,
            }
        };
        (views, self.members.len(), kind, self.members.iter().map(|m| m.bytes).fold(0, u64::saturating_add))
    }

    /// The name that a view at `at` would have.
    fn name(&self, at: [u64; 2]) -> String {
        let values = if self.running { &at[1..] } else { &at[..] };
        let mut name = self.parts[0].clone();
        for ((value, digits), part) in values.iter().zip(&self.digits).zip(&self.parts[1..]) {
            name.push_str(&format!("{value:0digits$}{part}"));
        }
        name
    }

    fn arrange(&self, folder: &Path, stated: Option<[usize; 2]>) -> Result<Arrangement, SceneError> {
        let not_a_grid = |reason| SceneError::NotAGrid { folder: folder.display().to_string(), reason };
        let mut at = BTreeMap::new();
        for member in &self.members {
            if let Some(other) = at.insert(member.at, member.name) {
                return Err(not_a_grid(format!("{other} and {} have the same number", member.name)));
            }
        }
        let missing = |place: [u64; 2], [rows, columns]: [usize; 2]| SceneError::MissingView {
            file: folder.join(self.name(place)).display().to_string(),
            rows,
            columns,
        };
        let files = at.values().map(|name| name.to_string()).collect::<Vec<_>>();
        let count = files.len();
        if self.running {
            let numbers: Vec<u64> = at.keys().map(|k| k[1]).collect();
            if let Some(gap) = numbers.windows(2).find(|w| w[1] != w[0] + 1) {
                let all = (numbers[count - 1] - numbers[0]).saturating_add(1);
                let side = square(usize::try_from(all).unwrap_or(usize::MAX)).map_or([1, count], |n| [n, n]);
                return Err(missing([0, gap[0] + 1], stated.unwrap_or(side)));
            }
            let ends = format!("{} to {}", files[0], files[count - 1]);
            if let Some([rows, columns]) = stated {
                if rows.checked_mul(columns) == Some(count) {
                    return Ok(Arrangement { grid: [rows, columns], files });
                }
                return Err(not_a_grid(format!("{count} views ({ends}), but a grid of {rows} x {columns} is stated")));
            }
            return match square(count) {
                Some(n) => Ok(Arrangement { grid: [n, n], files }),
                None => {
                    let side = (count as f64).sqrt().ceil() as usize;
                    let next = self.name([0, numbers[count - 1].saturating_add(1)]);
                    let before =
                        numbers[0].checked_sub(1).map_or(String::new(), |n| format!("{} or ", self.name([0, n])));
                    Err(not_a_grid(format!(
                        "{count} views ({ends}) are not a square; {side} x {side} would be {}: is {before}{next} missing? \
                         (a lightfield.toml can state `grid = [rows, columns]`)",
                        side * side
                    )))
                }
            };
        }
        let lines = [0, 1].map(|k| self.axis(k).into_iter().collect::<Vec<_>>());
        let grid = [lines[0].len(), lines[1].len()];
        // Rows and columns may skip numbers, but evenly.
        for (k, line) in lines.iter().enumerate() {
            let step = line.windows(2).map(|w| w[1] - w[0]).min().unwrap_or(1);
            if let Some(gap) = line.windows(2).find(|w| w[1] - w[0] != step) {
                let mut place = [lines[0][0], lines[1][0]];
                place[k] = gap[0] + step;
                return Err(missing(place, grid));
            }
        }
        if let Some([rows, columns]) = stated
            && grid != [rows, columns]
        {
            let found = format!("the names make {} x {}", grid[0], grid[1]);
            return Err(not_a_grid(format!("{found}, but a grid of {rows} x {columns} is stated")));
        }
        for &row in &lines[0] {
            for &column in &lines[1] {
                if !at.contains_key(&[row, column]) {
                    return Err(missing([row, column], grid));
                }
            }
        }
        Ok(Arrangement { grid, files })
    }
}

fn square(count: usize) -> Option<usize> {
    let side = (count as f64).sqrt().round() as usize;
    (side.checked_mul(side) == Some(count) && count > 0).then_some(side)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn found(names: &[String]) -> Result<Arrangement, SceneError> {
        let mut names: Vec<Named> = names.iter().map(|n| (n.clone(), 10)).collect();
        names.reverse();
        arrange(Path::new("folder"), &names, None)
    }

    fn grid_of(rows: usize, columns: usize, name: impl Fn(usize, usize) -> String) -> Vec<String> {
        (0..rows * columns).map(|i| name(i / columns, i % columns)).collect()
    }

    #[test]
    fn rows_and_columns_are_found_in_every_style() {
        let styles: [&dyn Fn(usize, usize) -> String; 4] = [
            &|r, c| format!("2067_{r:02}_{c:02}.png"),
            &|r, c| format!("LF_{r}_{c}.png"),
            &|r, c| format!("view-{}-{}.jpg", r + 1, c + 1),
            &|r, c| format!("cam7_2023-11-05_{r}_{c}.EXR"),
        ];
        for style in styles {
            let names = grid_of(5, 12, style);
            assert_eq!(found(&names).unwrap(), Arrangement { grid: [5, 12], files: names });
        }
        assert_eq!(found(&grid_of(1, 9, |r, c| format!("view-{r}-{c}.png"))).unwrap().grid, [1, 9]);
    }

    #[test]
    fn running_numbers_make_a_square_whatever_stands_in_front() {
        for prefix in ["input_Cam", "scene1_", "2023_", ""] {
            let mut names = grid_of(9, 9, |r, c| format!("{prefix}{:03}.png", r * 9 + c));
            let right = Arrangement { grid: [9, 9], files: names.clone() };
            names.extend((0..81).map(|i| format!("gt_disp_{i:03}.png")));
            names.extend(["thumbnail1.png", "objectids.png", "notes.txt", "gt_disp_lowres.pfm"].map(String::from));
            assert_eq!(found(&names).unwrap(), right, "{prefix}");
        }
        // Without leading zeros, 10 still comes after 9.
        let names = grid_of(4, 4, |r, c| format!("v{}.png", r * 4 + c));
        assert_eq!(found(&names).unwrap().files, names);
    }

    #[test]
    fn what_is_missing_is_named() {
        let mut names = grid_of(9, 9, |r, c| format!("input_Cam{:03}.png", r * 9 + c));
        names.remove(34);
        assert!(found(&names).unwrap_err().to_string().contains("folder/input_Cam034.png"));
        let mut names = grid_of(9, 9, |r, c| format!("input_Cam{:03}.png", r * 9 + c));
        names.pop();
        let text = found(&names).unwrap_err().to_string();
        assert!(text.contains("80 views") && text.contains("input_Cam080.png missing"), "{text}");
        let mut names = grid_of(4, 5, |r, c| format!("LF_{r}_{c}.png"));
        names.remove(7);
        assert_eq!(
            found(&names).unwrap_err(),
            SceneError::MissingView { file: "folder/LF_1_2.png".into(), rows: 4, columns: 5 }
        );
        let names: Vec<_> =
            grid_of(4, 5, |r, c| format!("LF_{r}_{c}.png")).drain(..).filter(|n| !n.contains("_2_")).collect();
        assert!(found(&names).unwrap_err().to_string().contains("LF_2_0.png"));
        assert!(matches!(found(&[]).unwrap_err(), SceneError::Empty { .. }));
        assert!(matches!(found(&["a.png".into()]).unwrap_err(), SceneError::Empty { .. }));
        let twice = ["v0.png", "v1.png", "v01.png", "v2.png"].map(String::from);
        assert!(found(&twice).unwrap_err().to_string().contains("same number"));
    }

    #[test]
    fn a_stated_grid_decides() {
        let names: Vec<Named> = (0..6).map(|i| (format!("v{i}.png"), 1)).collect();
        assert_eq!(arrange(Path::new("f"), &names, Some([2, 3])).unwrap().grid, [2, 3]);
        assert!(arrange(Path::new("f"), &names, Some([2, 4])).is_err());
        assert!(arrange(Path::new("f"), &names, Some([usize::MAX, 4])).is_err());
    }

    proptest! {
        #[test]
        fn any_names_are_arranged_or_refused(names in prop::collection::vec("[a-z0-9_.éß-]{0,12}\\.(png|JPG|exr)", 0..20)) {
            let unique: BTreeSet<String> = names.into_iter().collect();
            let count = unique.len();
            if let Ok(found) = found(&unique.into_iter().collect::<Vec<_>>()) {
                prop_assert_eq!(found.files.len(), found.grid[0] * found.grid[1]);
                prop_assert!(found.files.len() <= count);
            }
        }

        #[test]
        fn long_numbers_do_no_harm(numbers in prop::collection::vec("[0-9]{1,30}", 1..9)) {
            let names: BTreeSet<String> = numbers.iter().map(|n| format!("v{n}.png")).collect();
            let _ = found(&names.into_iter().collect::<Vec<_>>());
        }

        #[test]
        fn grids_come_back_in_order(rows in 2usize..7, columns in 2usize..7, first in 0usize..3, prefix in "[a-z]{0,3}[0-9]{0,4}_") {
            let names = grid_of(rows, columns, |r, c| format!("{prefix}{}_{}.png", r + first, c + first));
            let right = Arrangement { grid: [rows, columns], files: names.clone() };
            prop_assert_eq!(found(&names).unwrap(), right);
        }
    }
}
