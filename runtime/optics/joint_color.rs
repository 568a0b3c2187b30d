//! Defines sub-frames in simultaneous color, each lit by every laser with its own power (OPTICS 13).
//!
//! The method follows Markley et al. 2023 and Kavakli et al. 2023.

use super::Color;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// The most turns that a color's light may make over all drive values. No display spans more.
const STEEPEST: f64 = 8.0;

/// The use of one drive value and several lasers for all colors. A hologram stores it with its phases.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointColor {
    /// The laser of each color.
    pub lasers: BTreeMap<Color, Laser>,
}

/// One laser of simultaneous color.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Laser {
    /// Turns of the laser's light over all drive values, which are one turn here. The reference color has a whole
    /// number, usually 1.
    pub slope: f64,
    /// The power of the laser in each sub-frame, over its mean.
    pub powers: Vec<f64>,
}

impl Laser {
    /// Share of the time that the laser would shine with its largest power, which is mean over largest, `B_c`. This
    /// share limits the brightness of white at one exposure, for lasers of one peak power.
    pub fn duty(&self) -> f64 {
        let largest = self.powers.iter().copied().fold(0.0, f64::max);
        if largest > 0.0 { 1.0 / largest } else { 0.0 }
    }

    /// The phases (radians) of the laser's light for drive values, which are given as phases of one turn.
    pub fn phases(&self, drives: &[f32]) -> Vec<f32> {
        drives.iter().map(|drive| phase_of(drive_of(*drive), self.slope)).collect()
    }
}

impl JointColor {
    /// The reference color of the drive values, if it is among these lasers.
    pub fn reference(&self) -> Option<Color> {
        let place = reference_of(self.lasers.values().map(|laser| laser.slope));
        place.and_then(|place| self.lasers.keys().nth(place).copied())
    }

    /// Ratio of the brightness of white to sequential color, with lasers of the same peak power and at the same
    /// exposures.
    pub fn brightness(&self) -> f64 {
        self.lasers.len() as f64 * self.lasers.values().map(Laser::duty).fold(f64::INFINITY, f64::min)
    }

    /// A table of the lasers' powers for their driver. It has a line per sub-frame and a column per color, and 1 is the
    /// largest power of all.
    pub fn table(&self) -> String {
        let frames = self.lasers.values().next().map_or(0, |laser| laser.powers.len());
        let all = self.lasers.values().flat_map(|laser| &laser.powers);
        let peak = all.copied().fold(f64::MIN_POSITIVE, f64::max);
        let names: String = self.lasers.keys().map(|color| format!(",{color}")).collect();
        let line = |f: usize| {
            let powers =
                self.lasers.values().map(|laser| format!(",{:.6}", laser.powers[f] / peak)).collect::<String>();
            format!("{f}{powers}\n")
        };
        format!("sub_frame{names}\n{}", (0..frames).map(line).collect::<String>())
    }

    /// Rejects values that do not fit a hologram of these colors and this many sub-frames.
    ///
    /// # Errors
    /// The fault and the remedy.
    pub fn check(&self, colors: &[Option<Color>], frames: usize) -> Result<(), Reason> {
        let lit = |color: &Option<Color>| color.is_some_and(|color| self.lasers.contains_key(&color));
        if let Some(dark) = colors.iter().position(|color| !lit(color)) {
            return Err(reason!("no-laser", "joint_color has no laser of its color {dark}: it must have one of each"));
        }
        for (color, Laser { slope, powers }) in &self.lasers {
            if !(*slope > 0.0 && *slope <= STEEPEST) {
                return Err(reason!(
                    "slope",
                    "joint_color has the slope {slope} of {color}: it must be above 0, at most {STEEPEST}"
                ));
            }
            if powers.len() != frames {
                return Err(reason!(
                    "powers-count",
                    "joint_color has {} powers of {color}: it must be {frames}, one per sub-frame",
                    powers.len()
                ));
            }
            if let Some(power) = powers.iter().find(|power| !(power.is_finite() && **power >= 0.0)) {
                return Err(reason!("power", "joint_color has the power {power} of {color}: it must be 0 or more"));
            }
            let mean = powers.iter().sum::<f64>() / frames as f64;
            if (mean - 1.0).abs() > 1e-6 {
                return Err(reason!(
                    "powers-mean",
                    "joint_color has powers of {color} with the mean {mean}: it must be 1"
                ));
            }
        }
        if self.reference().is_none() {
            return Err(reason!(
                "no-whole-slope",
                "joint_color has no slope of 1, 2 ..: one color must make whole turns over all drives"
            ));
        }
        Ok(())
    }
}

/// The powers of one color after another, (color, sub-frame). Each of `colors` has `colors` times its mean power in its
/// own sub-frames, which are consecutive, and no power in the others.
pub fn powers_in_sequence(colors: usize, frames: usize) -> Vec<Vec<f64>> {
    let power = |color: usize, frame: usize| if frame * colors / frames.max(1) == color { 1.0 } else { 0.0 };
    (0..colors).map(|c| with_mean_of_one((0..frames).map(|f| power(c, f)).collect())).collect()
}

/// The place of the reference color of the drive values, among colors of these slopes. It makes the smallest whole
/// number of turns.
pub fn reference_of(slopes: impl Iterator<Item = f64>) -> Option<usize> {
    let whole = slopes.enumerate().filter(|(_, slope)| *slope >= 1.0 && slope.fract() == 0.0);
    whole.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(place, _)| place)
}

/// The drive values, as phases (radians) of one turn, that give colors of these slopes these phases. If the reference
/// color makes one turn, its phases are the drive values.
pub fn drives_of<'a>(slopes: &[f64], phases: impl Fn(usize) -> &'a [f32] + Sync) -> Vec<f32> {
    let Some(reference) = reference_of(slopes.iter().copied()) else { return Vec::new() };
    let mut drives = phases(reference).to_vec();
    if slopes[reference] != 1.0 {
        drives_into(slopes, reference, phases, &mut drives);
    }
    drives
}

/// The same for a given reference color, into existing memory. Several drive values give the reference color its phase.
/// The result is the one of them that fits the other colors best.
pub fn drives_into<'a>(
    slopes: &[f64],
    reference: usize,
    phases: impl Fn(usize) -> &'a [f32] + Sync,
    drives: &mut [f32],
) {
    let turns = slopes[reference];
    drives.par_iter_mut().enumerate().for_each(|(i, to)| {
        let least = drive_of(phases(reference)[i]) / turns;
        let miss = |drive: f64| -> f64 {
            let off = |(color, slope): (usize, &f64)| (slope * drive - f64::from(phases(color)[i])) / TAU;
            slopes.iter().enumerate().map(off).map(|turns| (turns - turns.round()).powi(2)).sum()
        };
        let mut best = (f64::INFINITY, least);
        for turn in 0..turns as usize {
            let drive = least + TAU * turn as f64 / turns;
            let missed = miss(drive);
            if missed < best.0 {
                best = (missed, drive);
            }
        }
        *to = phase_of(best.1, 1.0);
    });
}

/// Divides the powers by their mean.
pub fn with_mean_of_one(mut powers: Vec<f64>) -> Vec<f64> {
    let mean = powers.iter().sum::<f64>() / powers.len().max(1) as f64;
    if mean > 0.0 {
        powers.iter_mut().for_each(|power| *power /= mean);
    }
    powers
}

/// The drive value, 0 to a turn, of a phase of the reference color (radians, any turn).
pub fn drive_of(phase: f32) -> f64 {
    let phase = f64::from(phase);
    // Phases are within a turn of zero, so this gives the same result without a division.
    let drive = match phase {
        0.0..TAU => phase,
        _ if phase < 0.0 && phase > -TAU => phase + TAU,
        _ => phase.rem_euclid(TAU),
    };
    // A value below zero by less than a digit becomes a whole turn, which is zero.
    if drive >= TAU { 0.0 } else { drive }
}

/// The phase, -pi to pi radians, that a color of this slope has at a drive value (OPTICS 13). The drive value keeps its
/// wrap.
pub fn phase_of(drive: f64, slope: f64) -> f32 {
    let phase = slope * drive;
    (phase - TAU * (phase / TAU).round()) as f32
}

/// Rejects a `dispersion` that no SLM has, for a display of these wavelengths (meters).
pub(super) fn check_dispersion(dispersion: &BTreeMap<Color, f64>, wavelengths: &[(Color, f64)]) -> Result<(), Reason> {
    let longest = wavelengths.iter().map(|w| w.1).fold(0.0, f64::max);
    let color_of_longest = wavelengths.iter().find(|w| w.1 == longest).map(|w| w.0);
    let fewest = color_of_longest.and_then(|color| dispersion.get(&color)).copied().unwrap_or(1.0);
    for (color, slope) in dispersion {
        let Some((_, wavelength)) = wavelengths.iter().find(|w| w.0 == *color) else {
            return Err(reason!("dispersion-color", "dispersion names {color}, but wavelengths_nm has no such color"));
        };
        if !(*slope > 0.0 && *slope <= STEEPEST) {
            return Err(reason!(
                "dispersion",
                "dispersion of {color} is {slope}: it must be above 0, at most {STEEPEST}"
            ));
        }
        if *wavelength == longest && (*slope < 1.0 || slope.fract() != 0.0) {
            return Err(reason!(
                "dispersion-whole",
                "dispersion of {color} is {slope}: it must be a whole number of turns, usually 1, because the longest \
                 wavelength defines the drive values"
            ));
        }
        if *slope < fewest {
            return Err(reason!(
                "dispersion-order",
                "dispersion of {color} is {slope}: it must be at least {fewest}, the value of the longest wavelength"
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Display;
    use eyebox_base::error::ErrorData;

    const ALL: [Color; 3] = [Color::Red, Color::Green, Color::Blue];

    fn joint(powers: Vec<Vec<f64>>) -> JointColor {
        let laser = |(color, powers): (Color, Vec<f64>)| {
            (color, Laser { slope: if color == Color::Red { 1.0 } else { 1.4 }, powers })
        };
        JointColor { lasers: ALL.into_iter().zip(powers).map(laser).collect() }
    }

    #[test]
    fn one_colour_after_another_is_a_case_of_it() {
        let joint = joint(powers_in_sequence(3, 6));
        assert_eq!(joint.lasers[&Color::Green].powers, [0.0, 0.0, 3.0, 3.0, 0.0, 0.0]);
        joint.check(&ALL.map(Some), 6).unwrap();
        assert!((joint.brightness() - 1.0).abs() < 1e-12 && joint.reference() == Some(Color::Red));
        assert_eq!(self::joint(vec![vec![1.0; 4]; 3]).brightness(), 3.0);
        assert_eq!(joint.table().lines().next(), Some("sub_frame,red,green,blue"));
        assert_eq!(joint.table().lines().nth(3), Some("2,0.000000,1.000000,0.000000"));
    }

    #[test]
    fn what_cannot_be_is_refused_in_a_line() {
        let with = |red: Vec<f64>, slope: f64| {
            let mut joint = joint(vec![red, vec![1.0; 2], vec![1.0; 2]]);
            joint.lasers.get_mut(&Color::Green).unwrap().slope = slope;
            joint
        };
        for (wrong, says) in [
            (with(vec![-1.0, 3.0], 1.2), "power"),
            (with(vec![f64::NAN, 1.0], 1.2), "power"),
            (with(vec![2.0; 2], 1.2), "powers-mean"),
            (with(vec![1.0; 3], 1.2), "powers-count"),
            (with(vec![1.0; 2], 0.0), "slope"),
            (joint(vec![vec![1.0; 2]; 2]), "no-laser"),
        ] {
            let said = wrong.check(&ALL.map(Some), 2).unwrap_err();
            assert_eq!(said.code(), says, "{said}");
        }
    }

    /// Phases that were stored in eight bits have the same property.
    #[test]
    fn drives_are_found_behind_the_phases_of_all_colours() {
        let drives: Vec<f32> = (0..4000).map(|i| (f64::from(i) / 4000.0 * TAU - TAU / 2.0) as f32).collect();
        for slopes in [[1.0, 1.27, 1.5], [2.0, 2.54, 3.0], [3.0, 3.9, 5.1]] {
            let of = |slope: f64| Laser { slope, powers: Vec::new() }.phases(&drives);
            let exact = slopes.map(of);
            let level = (TAU / 256.0) as f32;
            let rounded =
                exact.clone().map(|phases| phases.iter().map(|p| (p / level).round() * level).collect::<Vec<_>>());
            for (phases, most) in [(&exact, 1e-5), (&rounded, TAU / 510.0 / slopes[0])] {
                let found = drives_of(&slopes, |color| &phases[color]);
                let off = |(a, b): (&f32, &f32)| {
                    let turns = (f64::from(*a) - f64::from(*b)) / TAU;
                    (turns - turns.round()).abs() * TAU
                };
                let worst = found.iter().zip(&drives).map(off).fold(0.0, f64::max);
                assert!(found.len() == drives.len() && worst < most, "{slopes:?}: {worst}");
            }
        }
        assert!(drives_of(&[1.5, 1.7], |_| &[]).is_empty());
    }

    #[test]
    fn phases_follow_the_drive_and_keep_its_wrap() {
        for (drive, slope, wanted) in [(1.0, 1.5, 1.5), (4.0, 1.5, 6.0 - TAU), (6.0, 1.0, 6.0 - TAU)] {
            assert!((f64::from(phase_of(drive, slope)) - wanted).abs() < 1e-6);
        }
        // A drive value beyond a turn begins again, and its colors with it.
        assert!((drive_of(-0.5) - (TAU - 0.5)).abs() < 1e-6 && drive_of(-1e-20) < TAU);
        assert!((f64::from(phase_of(drive_of(-0.5), 1.5)) - (1.5 * (TAU - 0.5) - TAU)).abs() < 1e-5);
    }

    #[test]
    fn dispersion_comes_from_the_file_or_the_wavelengths() {
        let text = "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { red = 660, green = 520, blue = 440 }\n";
        let read = |more: &str| Display::from_toml(&format!("{text}{more}"), "b.toml");
        let all = [Color::Red, Color::Green, Color::Blue];
        let plain = read("").unwrap().slopes(&all);
        let wanted = [1.0, 660.0 / 520.0, 1.5];
        assert!(plain.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12) && plain[0] == 1.0, "{plain:?}");
        let measured = read("dispersion = { green = 1.31, blue = 1.62 }\n").unwrap();
        assert_eq!(measured.slopes(&all), [1.0, 1.31, 1.62]);
        assert_eq!(measured.slopes(&all[1..]), [1.0, 1.62 / 1.31]);
        // This SLM makes more than a turn, two turns of red, and the other colors more in proportion.
        let far = read("dispersion = { red = 2 }\n").unwrap();
        assert!(far.slopes(&all).iter().zip(wanted).all(|(a, b)| (a - 2.0 * b).abs() < 1e-12));
        let [green, blue] = far.slopes(&all[1..])[..] else { panic!("two colors") };
        assert!(green == 2.0 && (blue - 2.0 * 520.0 / 440.0).abs() < 1e-12);
        assert_eq!(Display::from_toml(&measured.to_toml(), "b").unwrap().dispersion, measured.dispersion);
        for (wrong, says) in [
            ("dispersion = { blue = -1.5 }\n", "display-file/dispersion"),
            ("dispersion = { blue = 80 }\n", "display-file/dispersion"),
            ("dispersion = { red = 1.2 }\n", "display-file/dispersion-whole"),
            ("dispersion = { red = 2, green = 1.5 }\n", "display-file/dispersion-order"),
        ] {
            let error = read(wrong).unwrap_err();
            assert!(error.to_string().contains("b.toml") && !error.to_string().contains('\n'), "{error}");
            assert_eq!(ErrorData::of(&error).code, says, "{error}");
        }
    }
}
