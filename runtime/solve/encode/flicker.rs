//! Sets that are slower than the eye fuses, and what would help.

use super::Packed;
use crate::optics::{Color, Display, Encoding, Packing};

/// Sets a second from which an eye sees no flicker: what is bright and wide flickers longest, up to about 60 Hz.
pub(crate) const FUSION_HZ: f64 = 50.0;

/// What to say where multiplex sets of these colours, `sub_frames` of each, come slower than an eye fuses at `video_hz` video
/// frames a second: how slow, and what would help. None where they do not, or where the packing does not hold them.
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
        helps.extend(most.map(|n| format!("an SLM of colour fields with {n} sub-frame{}", s(n))));
    }
    let planes = (colors.len() * sub_frames).div_ceil(24);
    if frames > planes && fast(planes) {
        helps.push("an SLM of bit-planes (24 to a video frame)".into());
    }
    helps.push(format!("{:.0} video frames a second", FUSION_HZ * frames as f64));
    Some(format!(
        "a set of {sub_frames} sub-frame{} of {} takes {frames} video frame{}: at {hz} Hz {sets:.2} sets a second, and an eye \
         sees flicker below about {FUSION_HZ:.0}; what would help: {}",
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
