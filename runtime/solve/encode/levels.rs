//! Maps each phase to a level, the one with the nearest phase modulo a turn.

use eyebox_kernels::encode::{Levels, TABLE};

/// A level beyond the first turn is used if no other level is within this distance of its phase, in turns. It is half
/// a step of 256 even levels. Finer steps gain less light than jumps by a turn between neighbors cost by crosstalk.
const WORTH_TURNS: f64 = 1.0 / 512.0;

/// The phases of an SLM's levels at one wavelength.
pub(super) enum Scale {
    /// Level `i` is `i / two_pi` turns.
    Even {
        /// Gray level of 2 pi.
        two_pi: f64,
        /// Number of levels of the SLM.
        levels: u32,
    },
    /// Pairs (level, turns) of a table.
    Listed(Vec<(u16, f64)>),
}

impl Scale {
    /// Returns (level, turns) of all levels.
    fn list(&self) -> Vec<(u16, f64)> {
        match self {
            Self::Even { two_pi, levels } => {
                (0..*levels).map(|level| (level as u16, f64::from(level) / two_pi)).collect()
            }
            Self::Listed(listed) => listed.clone(),
        }
    }
}

/// Returns the memory's code for a level. `codes` lists them. If it is empty, the code is the level.
fn code_of(codes: &[u16], level: u16) -> u16 {
    codes.get(usize::from(level)).copied().unwrap_or(level)
}

/// Returns the phase in turns of every code up to the highest, or none for codes that are not levels.
pub(super) fn phases(scale: &Scale, codes: &[u16]) -> Vec<Option<f64>> {
    let listed = scale.list();
    let highest = listed.iter().map(|l| code_of(codes, l.0)).max().unwrap_or(0);
    let mut phases = vec![None; usize::from(highest) + 1];
    for (level, turns) in listed {
        phases[usize::from(code_of(codes, level))].get_or_insert(turns);
    }
    phases
}

/// Returns the levels of one color, and a note for the user, if there is one.
///
/// `codes` lists the memory's code for each level. If it is empty, the code is the level.
pub(super) fn levels(scale: &Scale, codes: &[u16]) -> (Levels, Option<String>) {
    let mut listed = scale.list();
    if let Scale::Even { two_pi, levels } = scale
        && codes.is_empty()
        && two_pi.fract() == 0.0
        && *two_pi <= f64::from(*levels)
    {
        // If one level is a turn, every phase is level 0, and a table represents that as well.
        if *two_pi >= 2.0 {
            return (Levels::Even(*two_pi as u32), None);
        }
        listed.truncate(1);
    }
    let smallest = listed.iter().map(|l| l.1).fold(f64::INFINITY, f64::min);
    let (first, beyond): (Vec<_>, Vec<_>) = listed.into_iter().partition(|l| l.1 - smallest < 1.0 - 1e-9);
    let largest = first.iter().map(|l| l.1).fold(smallest, f64::max);
    // The step over the end of the turn is compared with the largest of the others.
    let mut listed = on_circle(first);
    let widest = listed.windows(2).map(|w| w[1].1 - w[0].1).fold(0.0, f64::max);
    let missing = 1.0 - (largest - smallest);
    let note = (beyond.is_empty() && missing > 2.0 * widest && missing > 0.02).then(|| {
        format!(
            "the SLM reaches {:.3} of a turn. Phases beyond become its last or its first level, the nearer one",
            largest - smallest
        )
    });
    // Levels of `two_pi_level` beyond a turn repeat the first ones.
    if matches!(scale, Scale::Listed(_)) {
        fill_gaps(&mut listed, beyond);
    }
    (table(&listed, codes), note)
}

/// Wraps phases to a turn, and sorts the levels by phase.
fn on_circle(mut listed: Vec<(u16, f64)>) -> Vec<(u16, f64)> {
    for level in &mut listed {
        level.1 -= level.1.floor();
    }
    listed.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    listed
}

/// Returns the indices of the levels before and after a phase on the circle.
fn neighbors(listed: &[(u16, f64)], turns: f64) -> [usize; 2] {
    let next = listed.partition_point(|l| l.1 < turns);
    [(next + listed.len() - 1) % listed.len(), next % listed.len()]
}

/// Adds the levels beyond the first turn that fill a gap between the others, the lowest phases first.
fn fill_gaps(listed: &mut Vec<(u16, f64)>, mut beyond: Vec<(u16, f64)>) {
    beyond.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    for (level, turns) in beyond {
        let turns = turns - turns.floor();
        let [before, after] = neighbors(listed, turns).map(|i| listed[i].1);
        let far = f64::min((turns - before).rem_euclid(1.0), (after - turns).rem_euclid(1.0));
        if far > WORTH_TURNS {
            let at = listed.partition_point(|l| l.1 < turns);
            listed.insert(at, (level, turns));
        }
    }
}

/// Returns the nearest of some levels for each part of a turn.
fn table(listed: &[(u16, f64)], codes: &[u16]) -> Levels {
    let nearest = |i: usize| {
        let turns = (i as f64 + 0.5) / TABLE as f64;
        let [before, after] = neighbors(listed, turns).map(|i| listed[i]);
        let far = |from: f64, to: f64| (to - from).rem_euclid(1.0);
        code_of(codes, if far(turns, after.1) <= far(before.1, turns) { after.0 } else { before.0 })
    };
    let table: Vec<u16> = (0..TABLE).map(nearest).collect();
    if table.iter().all(|code| *code < 256) {
        return Levels::Table(table.iter().map(|code| *code as u8).collect());
    }
    Levels::FineTable(table.into())
}
