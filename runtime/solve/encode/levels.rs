//! Maps each phase to a level, the one with the nearest phase modulo a turn.

use eyebox_kernels::encode::{Levels, TABLE};

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
    Listed(Vec<(u8, f64)>),
}

/// Returns the phase in turns of every code that the memory may hold, or none for codes that are not levels.
pub(super) fn phases(scale: &Scale, codes: &[u8]) -> [Option<f64>; 256] {
    let listed = match scale {
        Scale::Even { two_pi, levels } => (0..*levels).map(|level| (level as u8, f64::from(level) / two_pi)).collect(),
        Scale::Listed(listed) => listed.clone(),
    };
    let mut phases = [None; 256];
    for (level, turns) in listed {
        let code = codes.get(usize::from(level)).copied().unwrap_or(level);
        phases[usize::from(code)].get_or_insert(turns);
    }
    phases
}

/// Returns the levels of one color, and a note for the user, if there is one.
///
/// `codes` lists the memory's code for each level. If it is empty, the code is the level.
pub(super) fn levels(scale: &Scale, codes: &[u8]) -> (Levels, Option<String>) {
    let mut listed = match scale {
        Scale::Even { two_pi, levels }
            if codes.is_empty() && two_pi.fract() == 0.0 && *two_pi <= f64::from(*levels) =>
        {
            // If one level is a turn, every phase is level 0, and a table represents that as well.
            if *two_pi >= 2.0 {
                return (Levels::Even(*two_pi as u32), None);
            }
            vec![(0, 0.0)]
        }
        Scale::Even { two_pi, levels } => (0..*levels).map(|level| (level as u8, f64::from(level) / two_pi)).collect(),
        Scale::Listed(listed) => listed.clone(),
    };
    // If an SLM reaches further than a turn, only the first turn is used.
    let smallest = listed.iter().map(|l| l.1).fold(f64::INFINITY, f64::min);
    listed.retain(|l| l.1 - smallest < 1.0 - 1e-9);
    let largest = listed.iter().map(|l| l.1).fold(smallest, f64::max);
    for level in &mut listed {
        level.1 -= level.1.floor();
    }
    listed.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    let code = |level: u8| codes.get(usize::from(level)).copied().unwrap_or(level);
    let nearest = |i: usize| {
        let turns = (i as f64 + 0.5) / TABLE as f64;
        let next = listed.partition_point(|l| l.1 < turns);
        let (after, before) = (listed[next % listed.len()], listed[(next + listed.len() - 1) % listed.len()]);
        let far = |from: f64, to: f64| (to - from).rem_euclid(1.0);
        if far(turns, after.1) <= far(before.1, turns) { code(after.0) } else { code(before.0) }
    };
    let table = (0..TABLE).map(nearest).collect();
    // The step over the end of the turn is compared with the largest of the others.
    let widest = listed.windows(2).map(|w| w[1].1 - w[0].1).fold(0.0, f64::max);
    let missing = 1.0 - (largest - smallest);
    let note = (missing > 2.0 * widest && missing > 0.02).then(|| {
        format!(
            "the SLM reaches {:.3} of a turn. Phases beyond become its last or its first level, the nearer one",
            largest - smallest
        )
    });
    (Levels::Table(table), note)
}
