//! Subtracts the switching time of switchable sources from the light of the sub-frames (OPTICS 12).

use super::{Color, Display, Encoding, Packing, SourceMode, Sources, SourcesLit, Wavelength};
use eyebox_base::error::Reason;
use eyebox_base::reason;

/// Video frames per second of a display whose file has no rate.
pub const USUAL_RATE_HZ: f64 = 60.0;

impl Encoding {
    /// Number of sub-frames that a video frame shows one after another.
    fn sub_frames_of_video_frame(&self) -> usize {
        match self.packing {
            Packing::Grey8 => 1,
            Packing::Fields => 3,
            Packing::Planes8 => 8,
            Packing::Planes24 => 24,
            Packing::Map => {
                let of = |frame: u32| self.map.iter().filter(|place| place.video_frame == frame).count();
                self.map.iter().map(|place| of(place.video_frame)).max().unwrap_or(1)
            }
        }
    }
}

impl Display {
    /// Duration of a sub-frame in microseconds. It is a video frame at [`rate_hz`](Self::rate_hz) (or
    /// [`USUAL_RATE_HZ`]) over the number of its sub-frames.
    pub fn sub_frame_us(&self) -> f64 {
        1e6 / (self.rate_hz.unwrap_or(USUAL_RATE_HZ) * self.encoding.sub_frames_of_video_frame() as f64)
    }

    /// Share of light that remains in a sub-frame of the source that loses most, in any color.
    pub(super) fn least_lit(&self) -> f64 {
        let of = |w: &Wavelength| self.sources.lit_shares(w.color, self.focal_length);
        self.wavelengths.iter().flat_map(of).fold(1.0, f64::min)
    }

    /// The sources, with the duration of a sub-frame if one of them takes time to switch.
    pub(super) fn timed_sources(&self) -> Sources {
        let slow = self.sources.each.iter().any(|source| source.switching_us > 0.0);
        Sources { sub_frame_us: slow.then(|| self.sub_frame_us()), ..self.sources.clone() }
    }
}

impl Sources {
    /// The longest switching time of a source in microseconds.
    pub fn switching_us(&self) -> f64 {
        self.each.iter().map(|source| source.switching_us).fold(0.0, f64::max)
    }

    /// Time in microseconds without light at the beginning of a sub-frame, until its source is on and the one before it
    /// is off. The sources `lit` take turns, and the source of the sub-frame is at place `turn`.
    fn dark_us(&self, lit: &[usize], turn: usize) -> f64 {
        let before = lit[(turn + lit.len() - 1) % lit.len()];
        if lit.len() < 2 { 0.0 } else { self.each[lit[turn]].switching_us.max(self.each[before].switching_us) }
    }

    /// Share of a sub-frame in which its source is lit, for each of the [lit sources](Self::lit) of a color, in their
    /// order. It is 1 unless they take turns and take time to switch.
    pub fn lit_shares(&self, color: Color, focal_length: f64) -> Vec<f64> {
        let lit = self.lit(color, focal_length);
        let share = |turn| match (&self.lit, self.sub_frame_us) {
            (SourcesLit::InTurn, Some(sub_frame)) => 1.0 - self.dark_us(&lit, turn) / sub_frame,
            _ => 1.0,
        };
        (0..lit.len()).map(share).collect()
    }

    /// Rejects sources that take turns and take longer to switch than a sub-frame lasts.
    pub(super) fn check_times(&self, colors: &[Color], focal_length: f64) -> Result<(), Reason> {
        let Some(sub_frame) = self.sub_frame_us else { return Ok(()) };
        for color in colors {
            let shares = self.lit_shares(*color, focal_length);
            if let Some((source, share)) = self.lit(*color, focal_length).iter().zip(shares).find(|(_, s)| *s <= 0.0) {
                return Err(reason!(
                    "switching-times",
                    "[[sources]] {}: its {color} sub-frames begin with {:.0} us of switching and last only \
                     {sub_frame:.0} us. Give a shorter switching_us, a display of longer sub-frames, or sources_lit = \
                     \"together\" or \"steered\"",
                    source + 1,
                    (1.0 - share) * sub_frame
                ));
            }
        }
        Ok(())
    }
}

/// Mean light over the eyeboxes of the lit sources, relative to a source of power 1 that is always lit. It is 1 without
/// switchable sources.
pub fn mean_light(modes: &[SourceMode]) -> f64 {
    let mut lit: Vec<usize> = modes.iter().filter(|mode| mode.is_lit()).map(|mode| mode.source).collect();
    lit.dedup();
    let light: f64 = modes.iter().filter(|mode| mode.is_lit()).map(|mode| mode.weight).sum();
    if lit.is_empty() { 1.0 } else { light / lit.len() as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::OpticsError;
    use eyebox_base::error::ErrorData;

    fn display(lit: &str, each: [f64; 3], rest: &str) -> Result<Display, OpticsError> {
        let sources = each
            .iter()
            .enumerate()
            .map(|(i, us)| format!("[[sources]]\neyebox_mm = [{}, 0]\nswitching_us = {us}\n", 26.0 * (i as f64 - 1.0)));
        let text = format!(
            "resolution = [16, 16]\npitch_um = 8.0\nfocal_length_mm = 400.0\nlevels = 2\nrate_hz = 50\nsources_lit = \"{lit}\"\n\
             wavelengths_nm = {{ green = 520 }}\n{}[encoding]\npacking = \"planes24\"\n{rest}",
            sources.collect::<String>()
        );
        Display::from_toml(&text, "b.toml")
    }

    #[test]
    fn switching_is_taken_from_the_sub_frame_that_follows() {
        // A sub-frame is a 24th of 20 ms.
        let turns = display("in-turn", [100.0, 50.0, 0.0], "").unwrap();
        assert!((turns.sub_frame_us() - 1e6 / 1200.0).abs() < 1e-9);
        let shares = turns.sources.lit_shares(Color::Green, 0.4);
        // The first waits for itself, the second until the first is off, and the third until the second is off.
        for (share, dark) in shares.iter().zip([100.0, 100.0, 50.0]) {
            assert!((share - (1.0 - dark * 1200e-6)).abs() < 1e-12, "{shares:?}");
        }
        let modes = turns.modes(Color::Green);
        assert!(modes.iter().zip(&shares).all(|(mode, share)| (mode.weight - share).abs() < 1e-12));
        assert!((mean_light(&modes) - shares.iter().sum::<f64>() / 3.0).abs() < 1e-12);
        // The driver of the sources receives their powers, which do not depend on switching.
        let powers = turns.sources.powers(Color::Green, 3, 0.4);
        assert!((powers[0][0] - 3.0).abs() < 1e-12);
        assert_eq!(Display::from_toml(&turns.to_toml(), "b.toml").unwrap(), turns);
        for lit in ["together", "steered"] {
            let others = display(lit, [100.0, 50.0, 0.0], "").unwrap();
            assert!(others.sources.lit_shares(Color::Green, 0.4).iter().all(|share| *share == 1.0));
        }
        let at_once = display("in-turn", [0.0; 3], "").unwrap();
        assert_eq!(at_once.sources.sub_frame_us, None);
        assert!(at_once.modes(Color::Green).iter().all(|mode| mode.weight == 1.0));
    }

    #[test]
    fn sources_slower_than_a_sub_frame_take_no_turns() {
        let refused = display("in-turn", [0.0, 900.0, 0.0], "").unwrap_err();
        assert_eq!(ErrorData::of(&refused).code, "display-file/switching-times");
        let line = refused.to_string();
        assert!(["[[sources]] 2", "900 us", "833 us"].iter().all(|part| line.contains(part)), "{line}");
        assert!(display("steered", [0.0, 900.0, 0.0], "").is_ok());
    }

    #[test]
    fn a_sub_frame_lasts_as_long_as_its_packing_leaves_it() {
        for (preset, count) in [("grey8", 1.0), ("fields", 3.0), ("planes8", 8.0), ("planes24", 24.0)] {
            let display = Display { rate_hz: None, ..Display::preset(preset).unwrap() };
            assert!((display.sub_frame_us() - 1e6 / 60.0 / count).abs() < 1e-6, "{preset}");
        }
    }
}
