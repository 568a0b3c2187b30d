//! Reads the phase of every level from a table in the usual forms of laboratories.

use super::EncodeError;
use crate::files::{FileError, FileKind, Wanted, decode_text, read};
use eyebox_base::{Reason, reason};
use std::path::Path;

/// Smallest and largest range in turns of a calibrated SLM. A table with a named unit must be within it.
const REACH: [f64; 2] = [1.0 / 6.0, 8.0];
/// The same range if no unit is named. It is narrower, so that few numbers fit two units.
const USUAL_REACH: [f64; 2] = [0.75, 2.5];
const FORMS: &str = "A table has two columns, level and phase, in either order. Commas, semicolons, tabs or blanks \
                     separate them, and only tables without commas between columns have decimal commas. Write a first \
                     line such as 'level,phase_rad', 'Gray level;Phase [pi]' or 'Phase (deg), Gray level'. Units are \
                     rad, pi, turns and deg. Lines that begin with # or % are comments";

/// The unit of phases.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Unit {
    Radians,
    Pi,
    Turns,
    Degrees,
}

impl Unit {
    const ALL: [Self; 4] = [Self::Radians, Self::Pi, Self::Turns, Self::Degrees];

    /// Returns the size of the unit in turns, its name, and the words in a column's name that mean it.
    fn row(self) -> (f64, &'static str, &'static [&'static str]) {
        match self {
            Self::Radians => (0.5 / std::f64::consts::PI, "radians", &["rad", "rads", "radian", "radians"]),
            Self::Pi => (0.5, "units of pi", &["pi", "\u{3c0}"]),
            Self::Turns => {
                let words =
                    &["turn", "turns", "wave", "waves", "cycle", "cycles", "2pi", "2\u{3c0}", "\u{3bb}", "lambda"];
                (1.0, "turns", words)
            }
            Self::Degrees => (1.0 / 360.0, "degrees", &["deg", "degs", "degree", "degrees", "\u{b0}"]),
        }
    }

    /// Returns the turns of one unit.
    fn turns(self) -> f64 {
        self.row().0
    }

    fn name(self) -> &'static str {
        self.row().1
    }

    /// Returns the unit of a word in a column's name.
    fn of(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| unit.row().2.contains(&word))
    }
}

/// The meaning of a column's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Column {
    Level,
    Phase(Option<Unit>),
}

/// The indices of the columns, and the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Head {
    level: usize,
    phase: usize,
    unit: Option<Unit>,
}

/// The separator of columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Separator {
    Char(char),
    Blanks,
}

impl Separator {
    const ALL: [Self; 4] = [Self::Char('\t'), Self::Char(';'), Self::Char(','), Self::Blanks];

    fn split(self, row: &str) -> Vec<&str> {
        match self {
            Self::Char(c) => row.split(c).map(|cell| cell.trim().trim_matches('"').trim()).collect(),
            Self::Blanks => row.split_whitespace().map(|cell| cell.trim_matches('"')).collect(),
        }
    }

    /// Parses a number. It may have a decimal comma, unless commas separate columns.
    fn number(self, cell: &str) -> Option<f64> {
        match self != Self::Char(',') && cell.matches(',').count() == 1 && !cell.contains('.') {
            true => cell.replace(',', ".").parse().ok(),
            false => cell.parse().ok(),
        }
    }

    /// Returns the separator that splits this row into columns of numbers.
    fn of(row: &str) -> Option<Self> {
        let numbers = |s: &Self| {
            let cells = s.split(row);
            cells.len() > 1 && cells.iter().all(|cell| s.number(cell).is_some())
        };
        Self::ALL.into_iter().find(numbers)
    }
}

/// Reads (level, turns) from a table with one level and its phase per line, in the usual forms of laboratories.
///
/// A first line, which may be a comment, names the columns and the unit of phase. If it names no unit, phases are
/// radians, but only if no other unit fits. Empty lines and comments (# or %) are skipped. Levels may have any order,
/// and phases need not increase.
///
/// # Errors
/// Returns [`EncodeError::File`]. Returns [`EncodeError::Table`] with the wrong line, and for phases that fit no unit
/// or two units.
pub(super) fn read_table(file: &Path, levels: u32) -> Result<Vec<(u16, f64)>, EncodeError> {
    let bytes = read::bytes(file, read::TABLE).map_err(|e| FileError::read(file, e))?;
    let kind = FileKind::of_bytes(&bytes[..bytes.len().min(4096)]);
    let text = decode_text(bytes).or_else(latin1).map_err(|()| FileError::of_kind(file, kind, Wanted::Table))?;
    parse(&text, levels).map_err(|(line, reason)| EncodeError::Table { file: file.display().to_string(), line, reason })
}

/// Decodes text of older programs, in which a degree sign is one byte.
fn latin1(bytes: Vec<u8>) -> Result<String, ()> {
    let text = bytes.iter().all(|b| *b >= 0xa0 || (0x20..0x7f).contains(b) || b"\t\r\n".contains(b));
    if text { Ok(bytes.into_iter().map(char::from).collect()) } else { Err(()) }
}

fn parse(text: &str, levels: u32) -> Result<Vec<(u16, f64)>, (usize, Reason)> {
    let (mut head, mut separator) = (None, None);
    let mut rows: Vec<(usize, Vec<&str>)> = Vec::new();
    let data = text.lines().map(str::trim).find_map(|row| if is_comment(row) { None } else { Separator::of(row) });
    for (line, row) in (1..).zip(text.lines()) {
        // A tab at the end of a line does not separate columns.
        let row = row.trim();
        if row.is_empty() {
            continue;
        }
        if is_comment(row) {
            // A line that names both columns is the first line, even if it is a comment.
            let named = row.trim_start_matches(['#', '%', '/', ' ', '\t']);
            if rows.is_empty() {
                head = head.or_else(|| header(named, data).ok());
            }
            continue;
        }
        if rows.is_empty() && head.is_none() && has_no_number(row) {
            head = Some(header(row, data).map_err(|reason| (line, reason))?);
            continue;
        }
        let by: Separator =
            *separator.get_or_insert(data.or_else(|| Separator::of(row)).unwrap_or(Separator::Char(',')));
        rows.push((line, by.split(row)));
    }
    let last = text.lines().count().max(1);
    if rows.len() < 2 {
        return Err((
            last,
            reason!("levels-count", "the table ends with {} levels, but at least two are wanted. {FORMS}", rows.len()),
        ));
    }
    let columns = rows[0].1.len();
    if let Some((line, cells)) = rows.iter().find(|r| r.1.len() != columns || r.1.len() < 2) {
        return Err((
            *line,
            reason!("columns-count", "has {} columns, but level and phase are needed. {FORMS}", cells.len()),
        ));
    }
    let separator = separator.unwrap_or(Separator::Char(','));
    let head = match head {
        Some(head) => head,
        None => unnamed(&rows, separator, levels)?,
    };
    let unit_of = head.unit.unwrap_or(Unit::Radians);
    let found = values(&rows, separator, head, levels, unit_of)?;
    check_unit(&found, head.unit, unit_of).map_err(|reason| (last, reason))?;
    Ok(found)
}

fn is_comment(row: &str) -> bool {
    row.starts_with(['#', '%']) || row.starts_with("//")
}

fn has_no_number(row: &str) -> bool {
    let no_number = |s: Separator| s.split(row).iter().all(|cell| s.number(cell).is_none());
    Separator::ALL[..3].iter().all(|s| no_number(*s)) && !row.starts_with(|c: char| c.is_ascii_digit())
}

/// Returns (level, turns) of every row.
fn values(
    rows: &[(usize, Vec<&str>)],
    separator: Separator,
    head: Head,
    levels: u32,
    unit: Unit,
) -> Result<Vec<(u16, f64)>, (usize, Reason)> {
    let mut found: Vec<(u16, f64)> = Vec::new();
    let mut is_known = vec![false; 65536];
    for (line, cells) in rows {
        let (line, count) = (*line, cells.len());
        if count <= head.level.max(head.phase) {
            return Err((line, reason!("columns-count", "has {count} columns, but level and phase are needed")));
        }
        let (level, phase) = (cells[head.level], cells[head.phase]);
        let level = level_of(separator, level, levels).ok_or_else(|| {
            (line, reason!("level", "has the level '{level}', not a number from 0 to {}", levels.min(65536) - 1))
        })?;
        let turns = separator.number(phase).map(|p| p * unit.turns()).filter(|t| t.abs() <= 1000.0);
        let turns = turns.ok_or_else(|| {
            (line, reason!("phase", "has the phase '{phase}', not a finite number of at most 1000 turns"))
        })?;
        if std::mem::replace(&mut is_known[usize::from(level)], true) {
            return Err((line, reason!("level-twice", "has level {level} a second time")));
        }
        found.push((level, turns));
    }
    Ok(found)
}

/// Parses a level, which some programs write as 1.8e1.
fn level_of(separator: Separator, cell: &str, levels: u32) -> Option<u16> {
    let level = separator.number(cell)?;
    (level.fract() == 0.0 && (0.0..f64::from(levels.min(65536))).contains(&level)).then_some(level as u16)
}

/// Returns the columns if no line names them. Levels are the column of whole numbers.
fn unnamed(rows: &[(usize, Vec<&str>)], separator: Separator, levels: u32) -> Result<Head, (usize, Reason)> {
    let (line, columns) = (rows[0].0, rows[0].1.len());
    if columns != 2 {
        return Err((
            line,
            reason!("columns-not-named", "has {columns} columns, but no line before it names them. {FORMS}"),
        ));
    }
    let whole = |column: usize| {
        let level =
            |cells: &Vec<&str>| cells.get(column).is_none_or(|cell| level_of(separator, cell, levels).is_some());
        rows.iter().all(|(_, cells)| level(cells))
    };
    // This is more than two and a half turns in degrees, a phase that no SLM of one turn reaches.
    let driver = |column: usize| {
        let values = rows.iter().map(|(_, cells)| cells.get(column).and_then(|cell| separator.number(cell)));
        let values: Option<Vec<f64>> = values.collect();
        values.is_some_and(|v| v.iter().all(|v| v.fract() == 0.0) && v.iter().any(|v| *v > 900.0))
    };
    if (whole(0) && driver(1)) || (whole(1) && driver(0)) {
        let reason = "and those after it hold levels and other whole numbers, like the values of an SLM's driver \
                      (voltages). Give the measured phase of each level, under a first line such as 'level,phase_rad'";
        return Err((line, Reason::new("driver-values", reason)));
    }
    match (whole(0), whole(1)) {
        (true, true) => Err((
            line,
            reason!("levels-in-either", "and those after it could be levels in either column. Name them. {FORMS}"),
        )),
        (false, true) => Ok(Head { level: 1, phase: 0, unit: None }),
        _ => Ok(Head { level: 0, phase: 1, unit: None }),
    }
}

/// Returns the columns that a first line names.
fn header(row: &str, data: Option<Separator>) -> Result<Head, Reason> {
    let between = [data, Some(Separator::Char('\t')), Some(Separator::Char(';')), Some(Separator::Char(','))];
    let between = between.into_iter().flatten().filter(|s| *s != Separator::Blanks);
    let cells = between.map(|s| s.split(row)).find(|cells| cells.len() > 1).unwrap_or_else(|| two_names(row));
    let mut named = Vec::new();
    for (i, cell) in cells.iter().enumerate() {
        if let Some(column) = column_of(cell)? {
            named.push((i, column));
        }
    }
    let levels: Vec<usize> = named.iter().filter(|c| c.1 == Column::Level).map(|c| c.0).collect();
    let phases: Vec<_> =
        named.iter().filter_map(|&(i, c)| if let Column::Phase(unit) = c { Some((i, unit)) } else { None }).collect();
    match (&levels[..], &phases[..]) {
        (&[level], &[(phase, unit)]) => Ok(Head { level, phase, unit }),
        _ => Err(reason!("columns", "'{row}' does not name one column of levels and one of phases. {FORMS}")),
    }
}

/// Splits two names of several words with blanks between all of them. The second name begins at its own word.
fn two_names(row: &str) -> Vec<&str> {
    let starts = |is: fn(&str) -> bool| {
        let words = row.split(|c: char| !c.is_alphanumeric()).filter(|w| !w.is_empty());
        words.filter(|w| is(&w.to_lowercase())).map(|w| w.as_ptr() as usize - row.as_ptr() as usize).next()
    };
    match (starts(is_level), starts(is_phase)) {
        (Some(level), Some(phase)) => {
            let (first, second) = row.split_at(level.max(phase));
            vec![first, second]
        }
        _ => vec![row],
    }
}

fn is_level(word: &str) -> bool {
    ["level", "levels", "gray", "grey", "graylevel", "greylevel", "gl"].contains(&word)
}

fn is_phase(word: &str) -> bool {
    ["phase", "phases", "phi", "\u{3c6}", "\u{3d5}", "retardance", "retardation"].contains(&word)
}

/// Returns the meaning of a name, if it names one of the two columns.
fn column_of(name: &str) -> Result<Option<Column>, Reason> {
    let name = name.to_lowercase();
    let words: Vec<&str> =
        name.split(|c: char| !c.is_alphanumeric() && c != '\u{b0}').filter(|w| !w.is_empty()).collect();
    if words.iter().any(|w| is_level(w)) && !words.iter().any(|w| is_phase(w)) {
        return Ok(Some(Column::Level));
    }
    if !words.iter().any(|w| is_phase(w)) && (words.is_empty() || words.iter().any(|w| Unit::of(w).is_none())) {
        return Ok(None);
    }
    // The unit is in brackets, or after the name.
    let bracketed = name.split_once(['(', '[']).and_then(|(_, rest)| rest.split_once([')', ']'])).map(|(unit, _)| unit);
    let unit: Vec<&str> = match bracketed {
        Some(unit) => unit.split(|c: char| !c.is_alphanumeric() && c != '\u{b0}').filter(|w| !w.is_empty()).collect(),
        None => words.into_iter().filter(|w| !is_phase(w)).collect(),
    };
    let plain = ["in", "of", "x", "unit", "units", "shift", "modulation", "delay"];
    let mut found: Vec<Unit> = Vec::new();
    for word in unit.iter().filter(|w| !plain.contains(w)) {
        // The words "2 pi" are a turn.
        let known = if *word == "2" && unit.iter().any(|w| Unit::of(w) == Some(Unit::Pi)) {
            Some(Unit::Turns)
        } else {
            Unit::of(word)
        };
        let known = known
            .ok_or_else(|| reason!("unit", "names a column '{name}', but '{word}' is not a unit of phase. {FORMS}"))?;
        found.push(known);
    }
    // The words "pi rad" mean pi, and "2 pi" and "2 pi rad" mean a turn.
    let strongest = [Unit::Turns, Unit::Pi].into_iter().find(|u| found.contains(u));
    if found.contains(&Unit::Degrees) && found.iter().any(|u| *u != Unit::Degrees) {
        return Err(reason!("two-units", "names a column '{name}', which has two units of phase. {FORMS}"));
    }
    Ok(Some(Column::Phase(strongest.or(found.first().copied()))))
}

/// Refuses phases that no SLM has in their unit. If no unit is named, it also refuses phases that are not radians, or
/// that fit another unit as well.
fn check_unit(found: &[(u16, f64)], named: Option<Unit>, unit: Unit) -> Result<(), Reason> {
    let largest = found.iter().map(|l| l.1).fold(f64::NEG_INFINITY, f64::max);
    let smallest = found.iter().map(|l| l.1).fold(f64::INFINITY, f64::min);
    let (turns, span) = (largest - smallest, (largest - smallest) / unit.turns());
    let fits = |unit: Unit, [least, most]: [f64; 2]| (least..=most).contains(&(span * unit.turns()));
    let readings = |reach: [f64; 2]| -> Vec<String> {
        let fitting = Unit::ALL.into_iter().filter(|u| fits(*u, reach));
        fitting.map(|u| format!("{:.3} turns in {}", span * u.turns(), u.name())).collect()
    };
    if named.is_some() {
        if fits(unit, REACH) {
            return Ok(());
        }
        let others = readings(USUAL_REACH);
        let others = if others.is_empty() { String::new() } else { format!(" (it would be {})", others.join(" or ")) };
        return Err(reason!(
            "span",
            "the table spans {span:.4} {}, {turns:.3} turns, but an SLM reaches 1/6 to 8{others}. {FORMS}",
            unit.name()
        ));
    }
    let fitting: Vec<Unit> = Unit::ALL.into_iter().filter(|u| fits(*u, USUAL_REACH)).collect();
    if fitting == [Unit::Radians] {
        return Ok(());
    }
    let readings = readings(if fitting.is_empty() { REACH } else { USUAL_REACH });
    let could = if readings.is_empty() { "no known unit".into() } else { readings.join(" or ") };
    Err(reason!("no-unit", "the table spans {span:.4} and names no unit. It could be {could}. {FORMS}"))
}

#[cfg(test)]
#[path = "calibration_tests.rs"]
mod tests;
