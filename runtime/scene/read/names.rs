//! Finds the views among the files of a folder, and their places in the grid.
//!
//! Names that differ only in their numbers are a *family*. Each number of its names may be the row, the column, a
//! running number or a coordinate. The meaning that fills a grid without gaps and duplicates counts. If two meanings
//! fit, or none, the refusal states what was found.

use crate::SceneError;
use crate::light_field::natural::{self, is_picture};
use crate::read::numbers::{self, Name};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::{cmp::Ordering, collections::BTreeMap, path::Path};

/// A file name and its size in bytes.
pub(crate) type Named = (String, u64);

/// The views of a folder, with their file names in row-major order.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Arrangement {
    pub grid: [usize; 2],
    pub files: Vec<String>,
    /// Description of how the views were found, for people.
    pub how: String,
    /// True if one running number gives the order. The pictures then also count.
    pub running: bool,
    /// Message for a running number that makes no square, if the pictures show no grid either.
    pub doubt: String,
    /// Distance of neighboring rows over the distance of neighboring columns, if the names have coordinates.
    pub proportion: Option<f64>,
}

pub(crate) fn is_auxiliary(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name.starts_with("gt_") || ["thumb", "depth", "disp", "mask", "normal", "preview"].iter().any(|w| name.contains(w))
}

/// Returns true if `name` matches `pattern`, in which `*` matches any text.
pub(crate) fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((start, rest)) => {
            let Some(end) = name.strip_prefix(start) else { return false };
            end.char_indices().map(|(i, _)| i).chain([end.len()]).any(|i| matches(rest, &end[i..]))
        }
    }
}

/// Names that differ only in their numbers.
struct Family<'a> {
    names: Vec<Name<'a>>,
    bytes: u64,
}

/// One interpretation of the numbers of a family.
struct Reading {
    /// The indices (from 0) of the numbers that are row and column, or of the running number alone.
    fields: Vec<usize>,
    /// The values of each of these numbers, one per line of the grid.
    lines: Vec<Vec<f64>>,
    /// For each name, the line of each of these numbers.
    at: Vec<Vec<usize>>,
    /// Smaller values are more likely: 0 consecutive numbers, 1 whole numbers, 2 coordinates.
    kind: u8,
}

/// Finds the views among `names`. A settings file may state a grid `stated` (rows, columns) and a pattern `files`.
///
/// # Errors
/// [`SceneError::Empty`], [`SceneError::NotAGrid`] or [`SceneError::MissingView`].
pub(crate) fn arrange(
    folder: &Path,
    names: &[Named],
    stated: Option<[usize; 2]>,
    files: Option<&str>,
) -> Result<Arrangement, SceneError> {
    let not_a_grid = |reason| SceneError::NotAGrid { folder: folder.display().to_string(), reason };
    let pictures = pictures(names, files);
    if pictures.is_empty() && files.is_some() {
        return Err(not_a_grid(reason!("no-such-pictures", "no picture is called {}", files.unwrap_or_default())));
    }
    // Numbers with sign and decimal point come first. If they make no grid, digits alone count.
    let mut first = None;
    for signed in [true, false] {
        match family(&pictures, signed).map(|family| family.map(|f| f.arrange(folder, stated))) {
            Ok(Some(Ok(found))) => return Ok(found),
            Ok(Some(Err(error))) => first = first.or(Some(error)),
            Ok(None) => {}
            Err(reason) => first = first.or(Some(not_a_grid(reason))),
        }
    }
    Err(first.unwrap_or(SceneError::Empty { folder: folder.display().to_string() }))
}

/// Returns the pictures that may be views.
fn pictures<'a>(names: &'a [Named], files: Option<&str>) -> Vec<&'a Named> {
    let wanted = |(name, _): &&Named| is_picture(name) && files.is_none_or(|pattern| matches(pattern, name));
    let mut pictures: Vec<&Named> = names.iter().filter(wanted).collect();
    if pictures.iter().any(|(name, _)| !is_auxiliary(name)) && files.is_none() {
        pictures.retain(|(name, _)| !is_auxiliary(name));
    }
    pictures
}

/// Returns the pictures among `names` in the order of the numbers in their names. There must be `count` of them.
///
/// # Errors
/// [`SceneError::NotAGrid`] for another number of pictures.
pub(crate) fn in_order(
    folder: &Path,
    names: &[Named],
    count: usize,
    files: Option<&str>,
) -> Result<Arrangement, SceneError> {
    let mut files: Vec<String> = pictures(names, files).into_iter().map(|(name, _)| name.clone()).collect();
    if files.len() != count {
        let reason = reason!(
            "positions-count",
            "positions_mm has {count} positions, but there are {} pictures, so give one for each, in the order of the \
             numbers in their names",
            files.len()
        );
        return Err(SceneError::NotAGrid { folder: folder.display().to_string(), reason });
    }
    files.sort_by_cached_key(|name| natural::natural(name));
    // Numbers below zero come first, and the largest magnitude at the very front.
    let mut read: Vec<Name> = files.iter().filter_map(|name| Name::read(name, true)).collect();
    numbers::take_signs(&mut read);
    let are_alike = read.len() == count && read.iter().all(|name| name.texts == read[0].texts);
    if are_alike && read.iter().any(|name| name.numbers.iter().any(|n| n.value < 0.0)) {
        let values = |name: &Name| name.numbers.iter().map(|n| n.value).collect::<Vec<_>>();
        read.sort_by(|a, b| values(a).partial_cmp(&values(b)).unwrap_or(Ordering::Equal));
        files = read.iter().map(|name| name.name.to_owned()).collect();
    }
    Ok(Arrangement {
        grid: [1, count],
        files,
        how: "pictures in the order of their numbers".into(),
        ..Arrangement::default()
    })
}

/// Returns the largest family. It is refused if most pictures belong to other families or to none.
fn family<'a>(pictures: &[&'a Named], signed: bool) -> Result<Option<Family<'a>>, Reason> {
    let mut families: BTreeMap<String, BTreeMap<String, Family>> = BTreeMap::new();
    let (mut read, bytes): (Vec<Name>, Vec<u64>) =
        pictures.iter().filter_map(|(name, bytes)| Some((Name::read(name, signed)?, *bytes))).unzip();
    if signed {
        numbers::take_signs(&mut read);
    }
    for (read, bytes) in read.into_iter().zip(bytes) {
        let ends = families.entry(read.texts.join("\0")).or_default();
        let family = ends.entry(read.end.clone()).or_insert(Family { names: Vec::new(), bytes: 0 });
        family.names.push(read);
        family.bytes = family.bytes.saturating_add(bytes);
    }
    // If the same views exist as PNG and as JPEG, the larger files are better.
    let best = |ends: BTreeMap<String, Family<'a>>| ends.into_values().max_by_key(|f| (f.names.len(), f.bytes));
    let mut families: Vec<Family> = families.into_values().filter_map(best).collect();
    families.sort_by_key(|f| std::cmp::Reverse(f.names.len()));
    let others: usize = families.iter().skip(1).map(|f| f.names.len()).sum();
    let mut families = families.into_iter();
    let Some(first) = families.next() else { return Ok(None) };
    if 2 * others > first.names.len() {
        let second = families.next().map_or("", |f| f.names[0].name);
        let (count, one) = (first.names.len(), first.names[0].name);
        let start = &first.names[0].texts[0];
        let pattern = if start.is_empty() { "PATTERN*".into() } else { format!("{start}*") };
        return Err(reason!(
            "several-names",
            "{} pictures are named in several ways, {count} like {one}, others like {second}. Select the views by \
             `files = \"{pattern}\"` in lightfield.toml. If all are views, rename them, as in view_0_0.png",
            count + others
        ));
    }
    Ok(Some(first))
}

impl Family<'_> {
    fn arrange(&self, folder: &Path, stated: Option<[usize; 2]>) -> Result<Arrangement, SceneError> {
        let not_a_grid = |reason| SceneError::NotAGrid { folder: folder.display().to_string(), reason };
        let count = self.names.len();
        let changing: Vec<usize> = (0..self.names[0].numbers.len())
            .filter(|&k| self.names.iter().any(|n| n.numbers[k].value != self.names[0].numbers[k].value))
            .collect();
        let mut pairs = self.pairs(&changing);
        // The order is the fullest grid without duplicates, then the most likely kind of numbers, then the first
        // numbers.
        pairs.sort_by(|a, b| b.fill(count).total_cmp(&a.fill(count)).then(a.kind.cmp(&b.kind)));
        let fits = |r: &&Reading| r.fill(count) == 1.0 && stated.is_none_or(|g| g == r.grid());
        if let Some(pair) = pairs.iter().find(fits) {
            return self.grid(folder, pair, stated, &changing);
        }
        if let Some(running) = self.running(&changing) {
            return self.row_major(folder, &running, stated);
        }
        if let [only] = changing[..]
            && let Some(row) = self.reading(vec![only])
        {
            return self.row(folder, &row, stated);
        }
        let holes = pairs.iter().find(|r| r.fill(count) >= 0.5);
        if let Some(pair) = holes {
            let grid = pair.grid();
            if let (Some([rows, columns]), true) = (stated, pair.fill(count) == 1.0) {
                let found = format!("the names make {} x {}", grid[0], grid[1]);
                return Err(not_a_grid(reason!("grid-count", "{found}, but a grid of {rows} x {columns} is stated")));
            }
            let is_there = |r, c| pair.at.iter().any(|at| at[..] == [r, c]);
            let places = (0..grid[0]).flat_map(|r| (0..grid[1]).map(move |c| [r, c]));
            let missing: Vec<_> = places.filter(|&[r, c]| !is_there(r, c)).collect();
            let values = [0, 1].map(|k| pair.lines[k][missing[0][k]]);
            return Err(self.missing(folder, &pair.fields, &values, missing.len(), grid));
        }
        if changing.is_empty() && count == 1 {
            let files = vec![self.names[0].name.to_owned()];
            return Ok(Arrangement { grid: [1, 1], files, how: "one picture".into(), ..Arrangement::default() });
        }
        Err(not_a_grid(self.why_not(&changing)))
    }

    /// Returns the reason why numbers without an interpretation make no grid.
    fn why_not(&self, changing: &[usize]) -> Reason {
        let count = self.names.len();
        let [first, last] = [&self.names[0], &self.names[count - 1]].map(|n| n.name);
        let says = |pattern: &str| format!("Select the views by `files = \"{pattern}\"` in lightfield.toml");
        for (i, one) in self.names.iter().enumerate() {
            if let Some(other) = self.names[..i].iter().find(|other| one.same(other)) {
                return reason!("same-number", "{} and {} have the same number", other.name, one.name);
            }
        }
        // The folder may have several light fields.
        let sets = |&k: &usize| {
            let mut sets: BTreeMap<u64, usize> = BTreeMap::new();
            self.names.iter().for_each(|n| *sets.entry(n.numbers[k].value.to_bits()).or_default() += 1);
            let size = sets.values().next().copied().unwrap_or(0);
            (size > 1 && sets.values().all(|n| *n == size)).then_some((sets.len(), size))
        };
        if let Some((k, (sets, size))) = changing.iter().find_map(|k| Some((*k, sets(k)?))) {
            let says = says(&self.names[0].with_same(k, changing));
            return reason!("several-sets", "{count} pictures ({first} to {last}) are {sets} sets of {size}. {says}");
        }
        reason!(
            "no-grid",
            "the numbers in the names of {count} pictures ({first} to {last}) fill no grid, neither as row and column \
             nor as a running number. {}, and state their rows and columns by `grid`",
            says("PATTERN*")
        )
    }

    /// Returns the interpretations as row and column without duplicates, in the order of the numbers.
    fn pairs(&self, changing: &[usize]) -> Vec<Reading> {
        let mut found = Vec::new();
        for (i, &row) in changing.iter().enumerate() {
            for &column in &changing[i + 1..] {
                let fields = if numbers::is_column_first(&self.names[0], row, column) {
                    vec![column, row]
                } else {
                    vec![row, column]
                };
                found.extend(self.reading(fields));
            }
        }
        // This is one row or one column, with a number that never changes next to one that changes.
        if let [only] = changing[..] {
            let same = |k: usize| {
                let (a, b) = (&self.names[0].numbers[k], &self.names[0].numbers[only]);
                matches!(a.value, 0.0 | 1.0) && a.digits == b.digits && k.abs_diff(only) == 1
            };
            let beside = (0..self.names[0].numbers.len()).find(|&k| k != only && same(k));
            let fields = beside.map(|k| if k < only { vec![k, only] } else { vec![only, k] });
            found.extend(fields.and_then(|fields| self.reading(fields)));
        }
        found
    }

    fn running(&self, changing: &[usize]) -> Option<Reading> {
        let mut found: Vec<Reading> = changing.iter().filter_map(|&k| self.reading(vec![k])).collect();
        found.retain(|r| r.kind < 2);
        found.sort_by_key(|r| r.kind);
        found.into_iter().next()
    }

    /// Returns the lines of these numbers. It returns `None` if two names would have the same place.
    fn reading(&self, fields: Vec<usize>) -> Option<Reading> {
        let values = |&k: &usize| self.names.iter().map(|n| n.numbers[k].value).collect::<Vec<_>>();
        let whole = fields.iter().all(|&k| self.names.iter().all(|n| n.numbers[k].whole));
        // Coordinates scatter around the lines of a grid, but not along a row.
        let exact = whole || fields.len() == 1;
        let (lines, places): (Vec<_>, Vec<_>) = fields.iter().map(|k| numbers::lines(&values(k), exact)).unzip();
        let at: Vec<Vec<usize>> =
            (0..self.names.len()).map(|i| places.iter().map(|p: &Vec<usize>| p[i]).collect()).collect();
        let mut seen: Vec<&Vec<usize>> = at.iter().collect();
        seen.sort();
        if seen.windows(2).any(|w| w[0] == w[1]) {
            return None;
        }
        let consecutive = |l: &Vec<f64>| l.windows(2).all(|w| w[1] - w[0] == 1.0);
        let kind = if lines.iter().all(consecutive) { 0 } else { 2 - u8::from(whole) };
        Some(Reading { fields, lines, at, kind })
    }

    fn missing(
        &self,
        folder: &Path,
        fields: &[usize],
        values: &[f64],
        count: usize,
        [rows, columns]: [usize; 2],
    ) -> SceneError {
        let name = folder.join(self.names[0].with(fields, values, &self.names)).display().to_string();
        let file = if count > 1 { format!("{name} (and {} more)", count - 1) } else { name };
        SceneError::MissingView { file, rows, columns }
    }

    /// Makes a grid by row and column. Its lines may skip numbers, but only evenly.
    fn grid(
        &self,
        folder: &Path,
        pair: &Reading,
        stated: Option<[usize; 2]>,
        changing: &[usize],
    ) -> Result<Arrangement, SceneError> {
        let grid = pair.grid();
        // A stated grid takes the lines as evenly spaced, whatever their numbers are.
        for k in 0..if stated.is_some() { 0 } else { 2 } {
            if numbers::is_uneven(&pair.lines[k], pair.kind < 2) {
                let [y, x] = [0, 1].map(|k| pair.lines[k].clone());
                return Err(SceneError::Uneven { folder: folder.display().to_string(), x, y });
            }
            if let Some(gap) = numbers::gap(&pair.lines[k], pair.kind < 2) {
                let mut values = [pair.lines[0][0], pair.lines[1][0]];
                values[k] = gap;
                return Err(self.missing(folder, &pair.fields, &values, 1, grid));
            }
        }
        let [few, many] = [grid[0].min(grid[1]), grid[0].max(grid[1])];
        let square = square(many).filter(|side| stated.is_none() && few > 1 && *side > 3 && few < *side);
        if let Some(side) = square {
            return Err(SceneError::NotAGrid {
                folder: folder.display().to_string(),
                reason: reason!(
                    "grid-or-sequence",
                    "{} x {} views, or {few} light fields of {side} x {side}. State `grid` in lightfield.toml for the \
                     views, or `files = \"PATTERN*\"` for one of the light fields",
                    grid[0],
                    grid[1]
                ),
            });
        }
        let ordinal = |k: usize| ["1st", "2nd", "3rd"].get(k).map_or(format!("{}th", k + 1), |s| (*s).to_owned());
        let what = if pair.kind == 2 { "coordinates" } else { "numbers" };
        let how = format!(
            "{what}: the {} of the names is the row, the {} the column",
            ordinal(pair.fields[0]),
            ordinal(pair.fields[1])
        );
        let proportion = self.proportion(pair, changing);
        Ok(Arrangement { grid, files: self.in_order(pair), how, proportion, ..Arrangement::default() })
    }

    /// Returns the names in the order of their places.
    fn in_order(&self, reading: &Reading) -> Vec<String> {
        let mut order: Vec<usize> = (0..self.names.len()).collect();
        order.sort_by_key(|&i| &reading.at[i]);
        order.into_iter().map(|i| self.names[i].name.to_owned()).collect()
    }

    /// Returns the distance of rows over the distance of columns, by the coordinates in the names. One number must
    /// change with the row alone and another with the column alone, and neither may be whole everywhere.
    fn proportion(&self, pair: &Reading, changing: &[usize]) -> Option<f64> {
        let pitch = |axis: usize, k: usize| {
            let values: Vec<f64> = self.names.iter().map(|n| n.numbers[k].value).collect();
            let (lines, at) = numbers::lines(&values, false);
            let follows = lines.len() == pair.lines[axis].len()
                && lines.len() > 1
                && (at.iter().zip(&pair.at).all(|(a, b)| *a == b[axis])
                    || at.iter().zip(&pair.at).all(|(a, b)| lines.len() - 1 - a == b[axis]));
            follows.then(|| (lines[lines.len() - 1] - lines[0]) / (lines.len() - 1) as f64)
        };
        let decimal: Vec<usize> =
            changing.iter().copied().filter(|&k| !self.names.iter().all(|n| n.numbers[k].whole)).collect();
        let [rows, columns] = [0, 1].map(|axis| decimal.iter().find_map(|&k| pitch(axis, k)));
        Some(rows? / columns?)
    }

    /// Makes one row of cameras by the coordinates in the names.
    fn row(&self, folder: &Path, row: &Reading, stated: Option<[usize; 2]>) -> Result<Arrangement, SceneError> {
        let files = self.in_order(row);
        let (count, numbers) = (files.len(), &row.lines[0]);
        let grid = stated.unwrap_or([1, count]);
        let not_a_grid = |reason| Err(SceneError::NotAGrid { folder: folder.display().to_string(), reason });
        if grid[0].checked_mul(grid[1]) != Some(count) {
            return not_a_grid(reason!(
                "grid-count",
                "{count} views, but a grid of {} x {} is stated",
                grid[0],
                grid[1]
            ));
        }
        if stated.is_none() && (numbers::is_uneven(numbers, false) || numbers::gap(numbers, false).is_some()) {
            return not_a_grid(uneven(count, &format!("{} to {}", files[0], files[count - 1]), numbers));
        }
        let how = format!("coordinates, {} to {}", numbers[0], numbers[count - 1]);
        Ok(Arrangement { grid, files, how, ..Arrangement::default() })
    }

    fn row_major(
        &self,
        folder: &Path,
        running: &Reading,
        stated: Option<[usize; 2]>,
    ) -> Result<Arrangement, SceneError> {
        let not_a_grid = |reason| SceneError::NotAGrid { folder: folder.display().to_string(), reason };
        let files = self.in_order(running);
        let (count, numbers) = (files.len(), &running.lines[0]);
        let [first, last] = [numbers[0], numbers[count - 1]];
        let ends = format!("{} to {}", files[0], files[count - 1]);
        let stride = numbers::stride(numbers);
        let how = match stride {
            Some(n) if n > 1.0 => format!("a running number, {first} to {last} by {n}, row by row"),
            _ => format!("a running number, {first} to {last}, row by row"),
        };
        if let Some([rows, columns]) = stated {
            if rows.checked_mul(columns) == Some(count) {
                return Ok(Arrangement { grid: [rows, columns], files, how, running: true, ..Arrangement::default() });
            }
            return Err(not_a_grid(reason!(
                "grid-count",
                "{count} views ({ends}), but a grid of {rows} x {columns} is stated"
            )));
        }
        let (step, uneven) = (stride.unwrap_or(1.0), numbers::is_uneven(numbers, true));
        if uneven {
            return Err(not_a_grid(self::uneven(count, &ends, numbers)));
        }
        if let Some(gap) = numbers.windows(2).find(|w| w[1] != w[0] + step) {
            let all = (last - first) / step + 1.0;
            let side = square(all as usize).map_or([1, count], |n| [n, n]);
            let lacking = if all < 1e6 { (all as usize).saturating_sub(count) } else { 1 };
            return Err(self.missing(folder, &running.fields, &[gap[0] + step], lacking, side));
        }
        let side = (count as f64).sqrt().ceil() as usize;
        let name = |n: f64| self.names[0].with(&running.fields, &[n], &self.names);
        let before = if first >= step { format!("{} or ", name(first - step)) } else { String::new() };
        let doubt = format!(
            "{count} views ({ends}) are not a square, and {side} x {side} would be {}. If {before}{} is missing, add \
             it. Otherwise state `grid = [rows, columns]` in lightfield.toml, or `focus_mm` and `aperture_mm` of a \
             focal stack",
            side * side,
            name(last + step)
        );
        let (grid, doubt) = square(count).map_or(([1, count], doubt), |n| ([n, n], String::new()));
        Ok(Arrangement { grid, files, how, running: true, doubt, proportion: None })
    }
}

impl Reading {
    fn grid(&self) -> [usize; 2] {
        [self.lines[0].len(), self.lines[1].len()]
    }

    /// Returns the share of the places in the grid that have a view.
    fn fill(&self, count: usize) -> f64 {
        count as f64 / self.lines.iter().map(|l| l.len() as f64).product::<f64>()
    }
}

/// Refuses views in a row whose numbers are not evenly spaced.
fn uneven(count: usize, ends: &str, numbers: &[f64]) -> Reason {
    reason!(
        "uneven",
        "the numbers of {count} views ({ends}) are not evenly spaced. State `grid = [rows, columns]` in \
         lightfield.toml if the views are, or `positions_mm = {numbers:?}` if the numbers are positions in \
         millimeters of cameras in a row"
    )
}

pub(crate) fn square(count: usize) -> Option<usize> {
    let side = (count as f64).sqrt().round() as usize;
    (side.checked_mul(side) == Some(count) && count > 0).then_some(side)
}

#[cfg(test)]
#[path = "names_tests.rs"]
mod tests;
