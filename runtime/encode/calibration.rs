//! The phase of every level, from a CSV table.

use super::EncodeError;
use crate::files::FileError;
use crate::files::read;
use std::path::Path;

/// Reads (level, turns) from lines `level,phase`; commas, semicolons or tabs.
///
/// Phases are radians, or what a first line says: `level,phase_rad`, `phase_pi`, `phase_turns` or `phase_deg`. Empty
/// lines and those that start with # are passed over. Levels may come in any order, and phases need not rise.
///
/// # Errors
/// [`EncodeError::File`]; [`EncodeError::Table`] naming the line that is wrong.
pub(super) fn read(file: &Path, levels: u32) -> Result<Vec<(u8, f64)>, EncodeError> {
    let text = read::text(file, read::TEXT).map_err(|e| FileError::read(file, e))?;
    parse(&text, levels).map_err(|(line, reason)| EncodeError::Table { file: file.display().to_string(), line, reason })
}

fn parse(text: &str, levels: u32) -> Result<Vec<(u8, f64)>, (usize, String)> {
    let mut found: Vec<(u8, f64)> = Vec::new();
    // Turns in the unit of the phases.
    let mut unit = 0.5 / std::f64::consts::PI;
    let mut first = true;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    for (line, row) in (1..).zip(text.lines()) {
        let row = row.trim();
        if row.is_empty() || row.starts_with('#') {
            continue;
        }
        let cells: Vec<&str> = row.split([',', ';', '\t']).map(|c| c.trim().trim_matches('"')).collect();
        let [level, phase] = cells[..] else {
            return Err((line, format!("has {} columns: level and phase are wanted", cells.len())));
        };
        let heads = std::mem::replace(&mut first, false);
        if heads && level.eq_ignore_ascii_case("level") {
            unit = match phase.to_ascii_lowercase().as_str() {
                "phase" | "phase_rad" => unit,
                "phase_pi" => 0.5,
                "phase_turns" => 1.0,
                "phase_deg" => 1.0 / 360.0,
                other => {
                    let known = "phase_rad, phase_pi, phase_turns or phase_deg";
                    return Err((line, format!("calls the second column '{other}': {known} is wanted")));
                }
            };
            continue;
        }
        let level =
            level.parse::<u32>().ok().filter(|l| *l < levels.min(256)).ok_or_else(|| {
                (line, format!("has the level '{level}': a number from 0 to {} is wanted", levels - 1))
            })?;
        let turns = phase.parse::<f64>().ok().map(|p| p * unit).filter(|t| t.abs() <= 1000.0);
        let turns = turns.ok_or_else(|| {
            (line, format!("has the phase '{phase}': a finite number of at most 1000 turns is wanted"))
        })?;
        if found.iter().any(|l| u32::from(l.0) == level) {
            return Err((line, format!("has level {level} a second time")));
        }
        found.push((level as u8, turns));
    }
    if found.len() < 2 {
        return Err((
            text.lines().count().max(1),
            format!("is the last, and there are {} levels: at least two are wanted", found.len()),
        ));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn units_headers_and_separators() {
        for (text, last) in [
            ("0,0\n1,3.14159265358979", 0.5),
            ("level,phase_pi\n0,0\n1,1.0\n", 0.5),
            ("# bench, May\nLevel;phase_turns\n\n0;0\r\n1;0.25\r\n", 0.25),
            ("\u{feff}level\tphase_deg\n1\t90\n0\t0", 0.25),
        ] {
            let table = parse(text, 256).unwrap();
            let turns = table.iter().find(|l| l.0 == 1).unwrap().1;
            assert!(table.len() == 2 && (turns - last).abs() < 1e-12, "{text}: {turns}");
        }
    }

    #[test]
    fn the_wrong_line_is_named() {
        for (text, line, what) in [
            ("0,0\n1,x\n", 2, "phase 'x'"),
            ("0,0\n1\n", 2, "columns"),
            ("0,0\n\n#\n256,1\n", 4, "0 to 255"),
            ("0,0\n0,1\n", 2, "second time"),
            ("level,phase_mm\n0,0\n", 1, "phase_mm"),
            ("0,nan\n1,2", 1, "nan"),
            ("0,0\n1,inf", 2, "inf"),
            ("0,0\n", 1, "at least two"),
            ("", 1, "at least two"),
            ("0,0\nlevel,phase\n", 2, "level"),
        ] {
            let (at, reason) = parse(text, 256).unwrap_err();
            assert!(at == line && reason.contains(what), "{text:?}: line {at}: {reason}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[0-9,;.\\-e\n#a-z\t ]{0,200}", levels in 2u32..=300) {
            if let Ok(table) = parse(&text, levels) {
                prop_assert!(table.len() >= 2 && table.iter().all(|l| u32::from(l.0) < levels && l.1.is_finite()));
            }
        }
    }
}
