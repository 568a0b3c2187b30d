//! Converts phases to levels in the kernel [`encode`](crate::encode).

use crate::trig::ROUND;

/// Phases must be smaller than this number of radians, with either sign. Beyond it float32 cannot distinguish phases.
pub const LARGEST_PHASE: f32 = 4_194_304.0;
/// Entries of the table of levels of a color, one for each 1/65536 turn.
pub const TABLE: usize = 65536;
/// Units of 2^-32 turns per radian, which is 683565275 + 148 / 256.
pub(crate) const RADIAN: [i32; 2] = [683_565_275, 148];
/// Parts of a radian to which the rest of a phase is rounded.
pub(crate) const PARTS: f32 = 4_194_304.0;
/// Units per 2^-12 radian, and 128 times the units per 2^-22 radian. The second is less than 2^15, which processors
/// multiply faster.
pub(crate) const PART: [i32; 2] = [166_886, 20_861];

/// The levels of one color.
#[derive(Debug, Clone, PartialEq)]
pub enum Levels {
    /// Number of levels, 2 to 65536, evenly spaced over a turn. A phase is rounded to the nearest, and the level after
    /// the last is level 0.
    Even(u32),
    /// The level, or its memory code, for each of [`TABLE`] equal parts of a turn.
    Table(Box<[u8]>),
    /// The same for levels or codes above 255.
    FineTable(Box<[u16]>),
}

impl Levels {
    /// Returns true if a level takes two bytes.
    pub fn are_fine(&self) -> bool {
        match self {
            Self::Even(count) => *count > 256,
            Self::Table(_) => false,
            Self::FineTable(_) => true,
        }
    }

    /// Returns the highest level, or memory code.
    pub fn highest(&self) -> u32 {
        match self {
            Self::Even(count) => count.saturating_sub(1),
            Self::Table(table) => table.iter().copied().max().unwrap_or(0).into(),
            Self::FineTable(table) => table.iter().copied().max().unwrap_or(0).into(),
        }
    }
}

/// Returns a phase in 2^-32 turns, wrapped. The error is at most 2^-25 turns for phases of a few turns, and 2^-20 turns
/// at [`LARGEST_PHASE`].
///
/// The function is total. NaN and values beyond the range give some number.
#[inline(always)]
pub fn turns(phase: f32) -> u32 {
    let shifted = phase + ROUND;
    let whole = shifted.to_bits().wrapping_sub(ROUND.to_bits()) as i32;
    // Both are multiples of the last bit of the phase, and the rest is at most a half, so the difference is exact.
    let rest = phase - (shifted - ROUND);
    let rest = (rest * PARTS + ROUND).to_bits().wrapping_sub(ROUND.to_bits()) as i32;
    let whole = whole.wrapping_mul(RADIAN[0]).wrapping_add(whole.wrapping_mul(RADIAN[1]) >> 8);
    let high = (rest >> 10).wrapping_mul(PART[0]);
    let low = ((rest & 1023) * PART[1]) >> 7;
    whole.wrapping_add(high).wrapping_add(low) as u32
}

/// Returns the nearest of `count` levels. `count` is 3 to 255 and not a power of two.
#[inline(always)]
fn nearest(turns: u32, count: u32) -> u32 {
    let level = ((turns >> 8) * count + (1 << 23)) >> 24;
    if level == count { 0 } else { level }
}

/// Returns the nearest of `count` levels. `count` is 257 to 65535. The sum is `turns * count` over 2^16, rounded down.
#[inline(always)]
fn nearest_fine(turns: u32, count: u32) -> u32 {
    let sum = (turns >> 16) * count + (((turns & 0xffff) * count) >> 16);
    let level = (sum >> 16) + ((sum >> 15) & 1);
    if level == count { 0 } else { level }
}

/// Returns the nearest of `count` levels. `count` is a power of two, 2 to 65536.
#[inline(always)]
fn nearest_power(count: u32) -> impl Fn(u32) -> u32 {
    let shift = 32 - count.trailing_zeros();
    let half = 1 << (shift - 1);
    move |turns| turns.wrapping_add(half) >> shift
}

#[inline(always)]
fn each<L>(phases: &[f32], offsets: &[u32], out: &mut [L], level: impl Fn(u32) -> L) {
    if offsets.is_empty() {
        for (out, &phase) in out.iter_mut().zip(phases) {
            *out = level(turns(phase));
        }
    } else {
        for ((out, &phase), offset) in out.iter_mut().zip(phases).zip(offsets) {
            *out = level(turns(phase).wrapping_add(*offset));
        }
    }
}

/// Writes what `code` makes of the levels of some phases. `uneven` returns the nearest of a number of levels that is not a
/// power of two.
#[inline(always)]
fn quantise_to<L>(
    color: &Levels,
    phases: &[f32],
    offsets: &[u32],
    out: &mut [L],
    uneven: impl Fn(u32, u32) -> u32,
    code: impl Fn(u32) -> L,
) {
    match color {
        Levels::Even(count) if count.is_power_of_two() => {
            let nearest = nearest_power(*count);
            each(phases, offsets, out, |t| code(nearest(t)));
        }
        Levels::Even(count) => each(phases, offsets, out, |t| code(uneven(t, *count))),
        Levels::Table(table) => {
            let table = whole(table);
            each(phases, offsets, out, |t| code(table[(t >> 16) as usize].into()));
        }
        Levels::FineTable(table) => {
            let table = whole(table);
            each(phases, offsets, out, |t| code(table[(t >> 16) as usize].into()));
        }
    }
}

/// Returns the table with a length that the compiler knows, so that it checks no index.
#[inline(always)]
fn whole<C>(table: &[C]) -> &[C; TABLE] {
    table.try_into().expect("a table has an entry for each part of a turn")
}

/// Writes the levels of some phases, the lower byte of each. `offsets` belong to the same pixels, or are empty.
#[inline(always)]
pub(crate) fn quantise(color: &Levels, phases: &[f32], offsets: &[u32], out: &mut [u8]) {
    quantise_to(color, phases, offsets, out, nearest, |level| level as u8);
}

/// Writes the levels of some phases as [`quantise`] does, with two bytes per level.
#[inline(always)]
pub(crate) fn quantise_fine(color: &Levels, phases: &[f32], offsets: &[u32], out: &mut [u16]) {
    quantise_to(color, phases, offsets, out, nearest_fine, |level| level as u16);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    /// Returns the distance of two places on a turn, in turns.
    fn apart(got: u32, phase: f32) -> f64 {
        let off = f64::from(got) / 4_294_967_296.0 - f64::from(phase) / TAU;
        (off - off.round()).abs()
    }

    /// Returns true if the level is at most half a step from these turns.
    fn is_nearest(turns: u32, level: u32, count: u32) -> bool {
        let off = f64::from(turns) / 4_294_967_296.0 * f64::from(count) - f64::from(level);
        let off = (off - f64::from(count) * (off / f64::from(count)).round()).abs();
        off <= 0.5 + 2e-5 && level < count
    }

    #[test]
    fn edges_of_a_turn() {
        let two_pi = TAU as f32;
        for phase in [0.0, -0.0, f32::MIN_POSITIVE / 8.0, two_pi, two_pi.next_down(), -two_pi, 1.0, -1.0, 0.5, -0.5] {
            assert!(apart(turns(phase), phase) < 3e-8, "{phase}");
        }
        for phase in [1e6, -1e6, 999_999.94, LARGEST_PHASE.next_down(), -LARGEST_PHASE.next_down()] {
            assert!(apart(turns(phase), phase) < 1e-6 * f64::from(phase.abs()) / 1e6 + 3e-8, "{phase}");
        }
        assert_eq!((turns(0.0), turns(-0.0)), (0, 0));
        for phase in [f32::NAN, f32::INFINITY, -1e30] {
            turns(phase);
        }
    }

    proptest! {
        #[test]
        fn a_turn_is_wrapped_to_what_float32_holds(phase in -100.0f32..100.0, far in -1e6f32..1e6) {
            prop_assert!(apart(turns(phase), phase) < 8e-8);
            prop_assert!(apart(turns(far), far) < 5e-7);
        }

        #[test]
        fn the_nearest_level_is_taken(turns: u32, count in 2u32..=256) {
            let mut out = [0];
            // An offset is added to the phase 0.
            quantise(&Levels::Even(count), &[0.0], &[turns], &mut out);
            prop_assert!(is_nearest(turns, out[0].into(), count), "{turns} became {}", out[0]);
        }

        #[test]
        fn the_nearest_of_many_levels_is_taken(turns: u32, count in 257u32..=65536) {
            for count in [count, 1 << (count % 8 + 9)] {
                let mut out = [0];
                quantise_fine(&Levels::Even(count), &[0.0], &[turns], &mut out);
                prop_assert!(is_nearest(turns, out[0].into(), count), "{turns} became {}", out[0]);
            }
        }
    }
}
