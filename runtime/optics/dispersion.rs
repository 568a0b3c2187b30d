//! Computes the turns of each color's light for one drive value of a display (OPTICS 13).

use super::{Color, Display};

impl Display {
    /// Turns of each color's light over all drive values, in the order of `colors`. They come from `dispersion` of the
    /// file. Otherwise they are in proportion to one over the wavelength (OPTICS 13). The longest wavelength of
    /// `colors` makes the largest whole number of turns that the SLM reaches, usually one.
    pub fn slopes(&self, colors: &[Color]) -> Vec<f64> {
        let wavelength =
            |color: &Color| self.wavelengths.iter().find(|w| w.color == *color).map_or(f64::NAN, |w| w.wavelength);
        let all = self.wavelengths.iter().map(|w| w.wavelength).fold(0.0, f64::max);
        let longest = self.wavelengths.iter().find(|w| w.wavelength == all).and_then(|w| self.dispersion.get(&w.color));
        let of_longest = longest.copied().unwrap_or(1.0);
        let turns = |color: &Color| self.dispersion.get(color).copied().unwrap_or(of_longest * all / wavelength(color));
        let reference = colors.iter().max_by(|a, b| wavelength(a).total_cmp(&wavelength(b))).map_or(1.0, turns);
        colors.iter().map(|color| turns(color) / reference * reference.floor().max(1.0)).collect()
    }
}
