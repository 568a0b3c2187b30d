//! What of a difference is seen: contrasts, as finely as an eye resolves them.

use super::pass::ContrastPass;
use crate::optics::{Display, Geometry, Optics, Window, resolved_frequencies};
use eyebox_kernels::{compare, contrast_rows};
use std::f64::consts::TAU;

/// A loss of contrasts: differences of light over the light that is wanted, as finely as an eye resolves speckle at the display's
/// pixels a degree and luminance ([`resolved_frequencies`]). Noise that the eye does not resolve counts for nothing. (By the contrast
/// sensitivity itself, which is for contrasts at threshold, noise is moved to where it is seen very well:
/// docs/measurements.md.) Where the eye's gaze is known, what it looks at counts as it is, and the further from there, the more of
/// each difference is filtered coarsely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContrastLoss {
    /// Standard deviation of W^T W, a Gaussian, in the focal plane, metres.
    pub spread: f64,
    /// Light of black, 1 being white: contrasts are over what is wanted and this.
    pub black: f64,
    /// Metres of the focal plane in a radian of visual angle.
    pub radian: f64,
    /// Where the eye looks from the picture's middle, radians (x, y); none where that is not known.
    pub gaze: Option<[f64; 2]>,
}

/// Mean luminance of pictures, of white's.
const USUAL: f64 = 0.2;
/// Light of which an eye that is adapted to a picture sees no less, of the exposure, which follows the scene's bright end.
const DARKEST: f64 = 0.05;
/// The finest grating of full contrast that an eye resolves e degrees from where it looks, cycles per degree, is RESOLVED over
/// HALVED + e: 2.3 ln 64 / 0.106 (Geisler and Perry, "A real-time foveated multiresolution system for low-bandwidth video
/// communication", Proc. SPIE 3299, 1998).
const RESOLVED: f64 = 90.2;
/// Degrees from where the eye looks at which it resolves half as much as there.
const HALVED: f64 = 2.3;
/// What the filter for what the eye does not look at passes, of the highest frequency.
const COARSE: f64 = 0.25;
/// Where the Gaussians that are filtered by are cut off, standard deviations.
const REACH: f64 = 2.5;

impl ContrastLoss {
    /// As this display is seen.
    pub fn of(display: &Display) -> Self {
        let viewing = &display.viewing;
        let degrees = 1.0 / (TAU * resolved_frequencies(USUAL * viewing.luminance_cd_m2));
        let radian = display.pixels_per_degree().to_degrees() * display.picture_pixel();
        let black = viewing.black_cd_m2 / viewing.luminance_cd_m2;
        Self { spread: degrees.to_radians() * radian, black, radian, gaze: None }
    }

    /// The same, of targets that were divided by `unit`.
    pub(crate) fn in_units_of(self, unit: f64) -> Self {
        Self { black: self.black / unit, ..self }
    }

    /// Where an eye looks that is turned by these angles, radians (x, y): as far as there is a picture.
    pub(crate) fn within(&self, optics: &Optics, turned: [f64; 2]) -> [f64; 2] {
        let (high, wide) = optics.field_of_view();
        let rim = [wide, high].map(|metres| 0.5 * metres / self.radian);
        [0, 1].map(|i| turned[i].clamp(-rim[i], rim[i]))
    }

    /// What a window needs that is compared so.
    pub(super) fn pass(&self, grid: &Optics, window: &Window, compared: &compare::Args) -> ContrastPass {
        let (high, wide) = grid.field_of_view();
        let sides = [(high, window.rows), (wide, window.columns)];
        // Degrees from a pixel of the window to the next.
        let degrees = sides.map(|(metres, pixels)| (metres / (self.radian * pixels as f64)).to_degrees());
        // Cycles per degree that can be in the image and that an eye resolves where it looks.
        let highest = (0.5 / degrees[0].min(degrees[1])).min(RESOLVED / HALVED);
        // Of angles, degrees: HALVED and an angle that make one together are where an eye resolves no more than that.
        let distance = highest / RESOLVED;
        let spread = match self.gaze {
            None => sides.map(|(metres, pixels)| self.spread * pixels as f64 / metres),
            Some(_) => degrees.map(|degrees| 1.0 / (TAU * COARSE * highest * degrees)),
        };
        let [down, along] = [0, 1].map(|i| weights(spread[i], sides[i].1));
        let place = |at: usize, side: usize| {
            let Some(gaze) = self.gaze else { return [0.0; 2] };
            let pixels = sides[side].1 as f64 / 2.0 + gaze[at].to_degrees() / degrees[side];
            [pixels, degrees[side] * distance].map(|v| v as f32)
        };
        let ([gaze_y, away_y], [gaze_x, away_x]) = (place(1, 0), place(0, 1));
        // A far field's images begin with the axis, which is the picture's middle.
        let first = |pixels: usize| if grid.geometry == Geometry::FarField { pixels as u32 / 2 } else { 0 };
        let dark = self.black as f32 + DARKEST as f32 * compared.exposure;
        let args = contrast_rows::Args {
            rows: window.rows as u32,
            columns: window.columns as u32,
            reach_y: down.len() as u32 - 1,
            reach_x: along.len() as u32 - 1,
            mode: compared.mode,
            exposure: compared.exposure,
            // Between the largest that it can be over the dark and that over what is bright: halves hold both.
            weight: compared.weight * dark * compared.exposure,
            floor: compared.floor,
            limit: compared.limit,
            dark,
            first_y: first(window.rows),
            first_x: first(window.columns),
            gaze_y,
            gaze_x,
            away_y,
            away_x,
            middle: (HALVED * distance) as f32,
            coarse: COARSE as f32,
        };
        ContrastPass { args, weights: [down, along].concat() }
    }
}

/// Weights of a Gaussian of this standard deviation, pixels, over fewer than half of `count` on either side: of the middle and of
/// each further pixel, over their sum. It is a Gaussian of half its variance filtered by itself: no frequency passes with
/// the other sign.
fn weights(spread: f64, count: usize) -> Vec<f32> {
    let half = spread / std::f64::consts::SQRT_2;
    let reach = ((REACH * half).ceil() as usize).min(count.saturating_sub(1) / 4);
    let one = |t: usize| (-0.5 * (t as f64 / half.max(1e-9)).powi(2)).exp();
    let at = |t: isize| if t.unsigned_abs() <= reach { one(t.unsigned_abs()) } else { 0.0 };
    let reach = reach as isize;
    let both: Vec<f64> = (0..=2 * reach).map(|t| (-reach..=reach).map(|s| at(s) * at(t - s)).sum()).collect();
    let sum = 2.0 * both.iter().sum::<f64>() - both[0];
    both.iter().map(|w| (w / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{Pupil, WindowFactor};

    #[test]
    fn filters_pass_a_gaussian_of_frequencies_and_none_with_the_other_sign() {
        for (spread, count) in [(1.5, 256), (3.0, 512), (0.7, 90), (0.0, 64), (6.0, 20), (1.0, 1)] {
            let weights = weights(spread, count);
            assert!(2 * (weights.len() - 1) < count.max(2), "{spread}, {count}");
            let passes = |turns: f64| {
                let sum = |(t, w): (usize, &f32)| {
                    f64::from(*w) * if t > 0 { 2.0 } else { 1.0 } * (TAU * turns * t as f64).cos()
                };
                weights.iter().enumerate().map(sum).sum::<f64>()
            };
            for k in 0..=50 {
                let turns = f64::from(k) / 100.0;
                let (got, want) = (passes(turns), (-0.5 * (TAU * turns * spread).powi(2)).exp());
                assert!(got > -1e-6, "{spread} at {turns}: {got}");
                assert!(count < 200 || (got - want).abs() < 0.03, "{spread} at {turns}: {got}, not {want}");
            }
        }
    }

    #[test]
    fn the_same_eye_sees_more_pixels_of_finer_pictures() {
        let display = |text: &str| {
            let bench =
                "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
            Display::from_toml(&format!("{bench}[viewing]\n{text}"), "b").unwrap()
        };
        let loss = |text: &str| ContrastLoss::of(&display(text));
        let [coarse, fine] = ["pixels_per_degree = 30", "pixels_per_degree = 60"].map(loss);
        assert!((fine.spread / coarse.spread - 2.0).abs() < 1e-9);
        // About a quarter of a pixel of 8 um at 60 a degree.
        assert!((2e-6..2.5e-6).contains(&fine.spread), "{fine:?}");
        assert!((loss("black_cd_m2 = 2.0").black - 0.01).abs() < 1e-12);
        // Dimmer pictures are seen less finely.
        assert!(loss("pixels_per_degree = 60\nluminance_cd_m2 = 5").spread > 1.2 * fine.spread);
    }

    #[test]
    fn what_is_not_looked_at_is_compared_as_coarsely_as_it_is_seen() {
        let bench =
            "resolution = [256, 512]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
        let display = Display::from_toml(&format!("{bench}[viewing]\npixels_per_degree = 10\n"), "b").unwrap();
        let optics = display.optics(crate::optics::Color::Green).unwrap();
        let loss = ContrastLoss { gaze: Some([10f64.to_radians(), 0.0]), ..ContrastLoss::of(&display) };
        let whole = Pupil { x: 0.0, y: 0.0, diameter: 1.0, depth: 0.0 };
        let window = Window::new(&optics, &whole, WindowFactor::Full);
        assert_eq!([window.rows, window.columns], [256, 512]);
        let compared = compare::Args { exposure: 0.4, ..bytemuck::Zeroable::zeroed() };
        let pass = loss.pass(&optics, &window, &compared);
        // 5 cycles per degree are all that pixels show: what an eye resolves 15.7 degrees from where it looks.
        let sharp = |degrees: f64| pass.args.sharp(128, (256.0 + 100.0 - 10.0 * degrees) as usize);
        assert!(sharp(0.0) == 1.0 && sharp(15.0) == 1.0 && sharp(16.5) < 1.0);
        for degrees in [20.0, 25.0, 30.0] {
            let want = (90.2 / (2.3 + degrees) / 5.0 - 0.25) / 0.75;
            assert!((f64::from(sharp(degrees)) - want).abs() < 1e-3, "{degrees}: {}, not {want}", sharp(degrees));
        }
        // In the far field images begin with the picture's middle, and its left comes behind its right.
        let far = optics.in_geometry(Geometry::FarField);
        let piece = far.piece([0; 2], [128, 128]);
        let narrow = Pupil { diameter: 128.0 * piece.pitch, x: piece.center()[0], y: piece.center()[1], ..whole };
        let window = Window::new(&piece, &narrow, WindowFactor::One);
        let radian = 20.0 * loss.radian;
        let beside = ContrastLoss { gaze: Some([-(30f64.to_radians()), 0.0]), radian, ..loss };
        let args = beside.pass(&piece, &window, &compared).args;
        let wide = (optics.wavelength * optics.focal_length / optics.pitch / radian).to_degrees();
        let columns = window.columns as f64;
        for degrees in [-7.0, -3.0, 0.0, 5.0, 7.0] {
            let pixels = (degrees / wide * columns).round();
            let away = 30.0 + pixels * wide / columns;
            let want = ((90.2 / (2.3 + away) / (0.5 * columns / wide) - 0.25) / 0.75).min(1.0);
            let got = f64::from(args.sharp(0, pixels.rem_euclid(columns) as usize));
            assert!(want < 1.0 && (got - want).abs() < 1e-3, "{degrees}: {got}, not {want}");
        }
        // A quarter of them pass the filter.
        let [down, along] = pass.args.weights(&pass.weights);
        let passes = |t: usize, w: &f32| f64::from(*w) * (TAU * 0.125 * t as f64).cos();
        let passed: f64 = along.iter().enumerate().map(|(t, w)| passes(t, w) * if t > 0 { 2.0 } else { 1.0 }).sum();
        assert!(down == along && (passed - (-0.5f64).exp()).abs() < 0.02, "{passed}");
    }
}
