//! How far a display turns each colour's light for one drive (OPTICS 13).

use super::{Color, Display};

impl Display {
    /// Turns of each colour's light over all drives, in the order of `colors`: as the file's `dispersion` says, else in proportion to
    /// one over the wavelength (OPTICS 13). The longest wavelength of them makes as many whole turns as the SLM reaches, one as a rule.
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

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_base::error::ErrorData;

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
        // An SLM of more than a turn: of red two, and of the rest as much more.
        let far = read("dispersion = { red = 2 }\n").unwrap();
        assert!(far.slopes(&all).iter().zip(wanted).all(|(a, b)| (a - 2.0 * b).abs() < 1e-12));
        let [green, blue] = far.slopes(&all[1..])[..] else { panic!("two colours") };
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
