//! Computes the times at which the sub-frames of a set are lit, and finds sets that flicker.
//!
//! Sets are shown whole or as a rolling update.

use super::Packed;
use crate::optics::{Color, Display, Encoding, Packing};

/// The times at which the sub-frames of one color are lit, approximated as evenly spaced.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LitTimes {
    /// The sub-frame that is lit first. The others follow in their order, and the ones before it follow the last.
    pub first: usize,
    /// The middle of the time in which all of them are lit, and its length, in sets.
    pub lit: [f64; 2],
}

/// The times at which the sub-frames of a set are lit, for any of its video frames as the first (OPTICS 15).
///
/// Sets that are shown whole have one turn, and times are relative to the middle of the set. In a rolling update each
/// video frame is chosen separately and has its own turn. Its times are relative to the middle of that video frame,
/// with which a set's length of time begins.
#[derive(Debug, Clone, PartialEq)]
pub struct Lighting {
    /// The times of each color, by turn.
    turns: Vec<Vec<LitTimes>>,
    /// The turn of each sub-frame of each color.
    turn_of: Vec<Vec<usize>>,
}

impl Lighting {
    /// Returns the lighting of sets of this packing, which are shown whole or roll.
    pub(crate) fn of(packed: &Packed, rolls: bool) -> Self {
        let turns = if rolls { packed.video_frames.max(1) } else { 1 };
        let colors = packed.slots.iter().map(|slot| slot.color + 1).max().unwrap_or(0);
        let since = if rolls { 0.5 - 0.5 / turns as f64 } else { 0.0 };
        let turn_of = |color| {
            let mut of = vec![0; packed.sub_frames];
            for slot in packed.slots.iter().filter(|slot| rolls && slot.color == color) {
                of[slot.sub_frame] = slot.video_frame;
            }
            of
        };
        Self {
            turns: (0..turns)
                .map(|turn| (0..colors).map(|color| times(packed, turn, color, since)).collect())
                .collect(),
            turn_of: (0..colors).map(turn_of).collect(),
        }
    }

    /// Returns the lighting of `colors` colors that share the sub-frames of the first (OPTICS 13).
    #[must_use]
    pub fn shared_by(mut self, colors: usize) -> Self {
        let Self { turns, turn_of } = &mut self;
        for times in turns {
            let first = times.first().copied();
            *times = first.into_iter().cycle().take(colors).collect();
        }
        *turn_of = turn_of.first().cloned().into_iter().cycle().take(colors).collect();
        self
    }

    /// Returns the number of turns, which is the video frames of a set that rolls, otherwise 1.
    pub fn turns(&self) -> usize {
        self.turns.len()
    }

    /// Returns the times at which the sub-frames of each color are lit from this turn on.
    pub fn times(&self, turn: usize) -> &[LitTimes] {
        &self.turns[turn % self.turns.len()]
    }

    /// Returns the turn of each sub-frame of a color.
    pub fn turn_of(&self, color: usize) -> &[usize] {
        self.turn_of.get(color).map_or(&[], Vec::as_slice)
    }
}

/// Returns the times of a color's slots from a video frame on, as evenly spaced slots. `since` is the time in sets from
/// the origin of times to the middle of the set. Colors with one slot that are lit at once are lit during the whole
/// set.
fn times(packed: &Packed, turn: usize, color: usize, since: f64) -> LitTimes {
    let begins = packed.slots.iter().position(|slot| slot.video_frame >= turn).unwrap_or(0);
    let (before, from) = packed.slots.split_at(begins);
    let count = packed.slots.len().max(1) as f64;
    let of = || from.iter().chain(before).enumerate().filter(|(_, slot)| slot.color == color);
    let time = |(i, _): (usize, &_)| (i as f64 + 0.5) / count - 0.5;
    let (first, last) = (of().map(time).next().unwrap_or(0.0), of().map(time).last().unwrap_or(0.0));
    let n = of().count().max(1) as f64;
    let middle = of().map(time).sum::<f64>() / n;
    // There are n of them from the first to the last, and half a step before and after.
    let length = if n > 1.0 { (last - first) * n / (n - 1.0) } else { 1.0 };
    LitTimes {
        first: of().next().map_or(0, |(_, slot)| slot.sub_frame),
        lit: [middle + since, length.clamp(1.0 / count, 1.0)],
    }
}

/// Sets per second above which an eye sees no flicker. Bright and wide content flickers longest, up to about 60 Hz.
const FUSION_HZ: f64 = 50.0;

/// Returns a message if multiplex sets of these colors are too slow for the eye at `video_hz` video frames per second.
/// It states the rate and the remedies. Returns none if they are fast enough, or if the packing cannot hold
/// `sub_frames` of each color.
pub fn flicker(display: &Display, colors: &[Color], sub_frames: usize, video_hz: f64) -> Option<String> {
    let frames_of = |encoding: &Encoding, n: usize| Packed::new(encoding, colors, n).ok().map(|p| p.video_frames);
    let frames = frames_of(&display.encoding, sub_frames)?;
    let sets = video_hz / frames as f64;
    if sets >= FUSION_HZ {
        return None;
    }
    let fast = |frames: usize| video_hz / frames as f64 >= FUSION_HZ;
    let (s, hz) = (|n: usize| if n == 1 { "" } else { "s" }, (video_hz * 1e3).round() / 1e3);
    let mut helps = Vec::new();
    let fewer = (1..sub_frames).rev().find(|n| frames_of(&display.encoding, *n).is_some_and(fast));
    helps.extend(fewer.map(|n| format!("{n} sub-frame{}", s(n))));
    if display.encoding.packing != Packing::Fields && colors.len() > 1 {
        let fields = Encoding { packing: Packing::Fields, ..Encoding::default() };
        let most = (1..=sub_frames).rev().find(|n| frames_of(&fields, *n).is_some_and(fast));
        helps.extend(most.map(|n| format!("an SLM of color fields with {n} sub-frame{}", s(n))));
    }
    let planes = (colors.len() * sub_frames).div_ceil(24);
    if frames > planes && fast(planes) {
        helps.push("an SLM of bit-planes (24 per video frame)".into());
    }
    helps.push(format!("{:.0} video frames per second", FUSION_HZ * frames as f64));
    Some(format!(
        "a set of {sub_frames} sub-frame{} of {} takes {frames} video frame{}. {hz} Hz gives {sets:.2} sets per \
         second, but an eye sees flicker below about {FUSION_HZ:.0}. Use {}",
        s(sub_frames),
        colors.iter().map(Color::to_string).collect::<Vec<_>>().join(", "),
        s(frames),
        helps.join(", or ")
    ))
}

#[cfg(test)]
mod tests {
    use super::super::tests::numbers;
    use super::*;
    use crate::encode::Encoder;
    use crate::optics::{Color, Display};

    const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];

    fn lighting(preset: &str, colors: &[Color], frames: usize, rolls: bool) -> Lighting {
        Encoder::new(&Display::preset(preset).unwrap(), colors, frames).unwrap().lighting(rolls)
    }

    fn close(times: LitTimes, first: usize, lit: [f64; 2]) {
        let near = (0..2).all(|i| (times.lit[i] - lit[i]).abs() < 1e-12);
        assert!(times.first == first && near, "{times:?}, not {first}, {lit:?}");
    }

    #[test]
    fn colours_are_lit_one_after_the_other_where_the_packing_says_so() {
        let planes = lighting("planes24", &ALL, 8, false);
        for (times, middle) in planes.times(0).iter().zip([-1.0 / 3.0, 0.0, 1.0 / 3.0]) {
            close(*times, 0, [middle, 1.0 / 3.0]);
        }
        close(lighting("planes8", &ALL[1..2], 8, false).times(0)[0], 0, [0.0, 1.0]);
        // In fields of colors in turn, each takes all the set, a third of a sub-frame apart.
        let fields = lighting("fields", &ALL, 8, false);
        for (times, middle) in fields.times(0).iter().zip([-1.0 / 24.0, 0.0, 1.0 / 24.0]) {
            close(*times, 0, [middle, 1.0]);
        }
        assert_eq!((fields.turns(), fields.turn_of(1)), (1, &[0; 8][..]));
    }

    #[test]
    fn of_sets_that_roll_every_video_frame_is_the_first_of_those_to_come() {
        // Eight sub-frames follow each other. Any first one is lit now, and the last one seven eighths of a set later.
        let one = lighting("grey8", &ALL[1..2], 8, true);
        assert_eq!((one.turns(), one.turn_of(0)), (8, &[0, 1, 2, 3, 4, 5, 6, 7][..]));
        (0..8).for_each(|turn| close(one.times(turn)[0], turn, [7.0 / 16.0, 1.0]));
        // Two sub-frames of three colors in turn, in the order red, green, blue, red, green, blue.
        let three = lighting("grey8", &ALL, 2, true);
        assert_eq!((three.turns(), three.turn_of(2)), (6, &[2, 5][..]));
        let middle = |after: f64| [after / 6.0 + 0.25, 1.0];
        // When the first green one is first, red's second is before its first.
        for (times, (first, after)) in three.times(1).iter().zip([(1, 2.0), (0, 0.0), (0, 1.0)]) {
            close(*times, first, middle(after));
        }
        // A color's eight planes in one video frame, of three in turn.
        let planes = lighting("planes8", &ALL, 8, true);
        assert_eq!((planes.turns(), planes.turn_of(1)), (3, &[1; 8][..]));
        for (times, after) in planes.times(2).iter().zip([1.0, 2.0, 0.0]) {
            close(*times, 0, [after / 3.0, 1.0 / 3.0]);
        }
    }

    #[test]
    fn slow_sets_are_said_with_what_helps() {
        let all = [Color::Red, Color::Green, Color::Blue];
        let said = |preset: &str, colors: usize, n: usize, hz: f64| {
            flicker(&Display::preset(preset).unwrap(), &all[..colors], n, hz)
        };
        // The line names the slow rate and then the remedies.
        let slow = said("grey8", 1, 8, 60.0).unwrap();
        assert_eq!(numbers(&slow), ["8", "8", "60", "7.50", "50", "1", "24", "400"], "{slow}");
        // Three colors in turn are too slow even with 1 sub-frame. As fields they are fast enough.
        let slow = said("grey8", 3, 8, 60.0).unwrap();
        assert_eq!(numbers(&slow), ["8", "24", "60", "2.50", "50", "1", "24", "1200"], "{slow}");
        let slow = said("planes24", 3, 8, 30.0).unwrap();
        assert_eq!(numbers(&slow), ["8", "1", "30", "30.00", "50", "50"], "{slow}");
        for (preset, colors, n, hz) in [
            ("grey8", 1, 1, 60.0),
            ("planes24", 3, 8, 60.0),
            ("fields", 3, 1, 59.94),
            ("grey8", 1, 8, 480.0),
            ("planes24", 3, 5, 10.0),
        ] {
            assert_eq!(said(preset, colors, n, hz), None);
        }
    }
}
