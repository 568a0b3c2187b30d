//! Detects values that are possible but most likely a mistake in units, in axes or in the pupil.
//!
//! User input passes these checks before any computation. A caller that means such a value can skip them.

use super::units::{APERTURE, COMMON_DEPTH, DIAMETER, FOCAL_LENGTH, PITCH, VIEW_PITCH, WAVELENGTH, in_words, meant};
use super::{Color, Display, Optics, OpticsError, Pupil, depth_of_dioptres};

/// Ratio of rows to columns above which the axes are probably exchanged. The squarest SLMs are 5 to 4.
const PORTRAIT: [usize; 2] = [6, 5];
/// A pupil may be as wide as the eyebox, and users round its diameter.
const ROUNDED: f64 = 1.01;

impl Optics {
    /// Checks that pitch, wavelength and focal length are plausible for a real display, to detect a wrong unit.
    ///
    /// # Errors
    /// [`OpticsError::Unusual`] for a value that is not plausible.
    pub fn check_usual(&self) -> Result<(), OpticsError> {
        PITCH.check(self.pitch * 1e6)?;
        WAVELENGTH.check(self.wavelength * 1e9)?;
        FOCAL_LENGTH.check(self.focal_length * 1e3)
    }
}

impl Display {
    /// Checks every color with [`Optics::check_usual`], the order of the colors' wavelengths, and the order of rows and
    /// columns. A display may be clearly higher than wide only if it is marked as a portrait.
    ///
    /// # Errors
    /// [`OpticsError::Unusual`] and the errors of [`optics`](Self::optics).
    pub fn check_usual(&self) -> Result<(), OpticsError> {
        for w in &self.wavelengths {
            self.optics(w.color)?.check_usual()?;
        }
        let of = |color| self.wavelengths.iter().find(|w| w.color == color).map(|w| (color, w.wavelength * 1e9));
        let present: Vec<(Color, f64)> = [Color::Red, Color::Green, Color::Blue].into_iter().filter_map(of).collect();
        if let Some([long, short]) = present.windows(2).find(|w| w[0].1 <= w[1].1).and_then(<[_]>::first_chunk) {
            let given = format!("{} is {} nm and {} {} nm", long.0, in_words(long.1), short.0, in_words(short.1));
            let probably = format!("probably they are exchanged: {} is the longer wavelength", long.0);
            return Err(OpticsError::Unusual { given, probably });
        }
        let Self { height, width, .. } = *self;
        if height * PORTRAIT[1] > width * PORTRAIT[0] && !self.portrait {
            let given = format!("{height} rows x {width} columns is higher than wide");
            let probably = format!(
                "rows come first, probably {width}x{height} is meant. If not, set portrait = true in the display file"
            );
            return Err(OpticsError::Unusual { given, probably });
        }
        Ok(())
    }
}

impl Pupil {
    /// Does [`check`](Self::check), and checks that the pupil is plausible for an eye. It must not be in meters, not be
    /// wider than the eyebox, and have its center inside ([`check_within`](Self::check_within)). Its focus must be
    /// possible for an eye ([`check_usual_depth`]).
    ///
    /// # Errors
    /// [`OpticsError::Unusual`] and the errors of the two.
    pub fn check_usual(self, optics: &Optics) -> Result<Self, OpticsError> {
        self.check()?;
        check_usual_diameters([self.diameter; 2], optics.eyebox())?;
        check_usual_depth(self.depth, optics.focal_length)?;
        self.check_within(optics)
    }
}

/// Checks that a range of pupil diameters (meters) is plausible for an eye and fits the eyebox (meters).
///
/// # Errors
/// [`OpticsError::Unusual`] for a value that is not plausible.
pub fn check_usual_diameters([least, most]: [f64; 2], eyebox: f64) -> Result<(), OpticsError> {
    // Zero is no mistake of units. The code that draws pupils rejects it.
    if least > 0.0 {
        DIAMETER.check(least * 1e3)?;
    }
    if most <= eyebox * ROUNDED {
        return Ok(());
    }
    let (most, eyebox) = (most * 1e3, eyebox * 1e3);
    let given = format!("a pupil {} mm wide does not fit the eyebox of {eyebox:.2} mm", in_words(most));
    let probably = match meant(most, [1.0, eyebox.min(10.0)]) {
        Some(meant) => format!("probably {} mm is meant", in_words(meant)),
        None => format!("it may be as wide as the eyebox, {eyebox:.2} mm"),
    };
    Err(OpticsError::Unusual { given, probably })
}

/// Rejects a distance of neighboring views in the pupil plane (meters) that most likely is in another unit.
///
/// # Errors
/// [`OpticsError::Unusual`] for a value that is not plausible.
pub fn check_usual_view_pitch(pitch: f64) -> Result<(), OpticsError> {
    VIEW_PITCH.check(pitch * 1e3)
}

/// Rejects a stated range of depths (meters) that is too shallow to matter for any pupil of any display. It is most
/// likely in another unit. The plane at 0 alone is accepted.
///
/// # Errors
/// [`OpticsError::Unusual`] for a value that is not plausible.
pub fn check_usual_depths(depths: [f64; 2]) -> Result<(), OpticsError> {
    let [a, b] = depths.map(|depth| depth * 1e3);
    let most = a.abs().max(b.abs());
    if most == 0.0 || most >= SHALLOWEST {
        return Ok(());
    }
    let given = format!("the depths are {} to {} mm", in_words(a), in_words(b));
    let probably = match meant(most, COMMON_DEPTH) {
        Some(meant) => {
            let [a, b] = [a, b].map(|depth| in_words(depth * meant / most));
            format!("probably {a} to {b} mm are meant. A scene without depth has 0 to 0 mm")
        }
        None => "a scene without depth has 0 to 0 mm".into(),
    };
    Err(OpticsError::Unusual { given, probably })
}

/// Rejects a diameter (meters) of a camera's aperture that most likely is in another unit.
///
/// # Errors
/// [`OpticsError::Unusual`] for a value that is not plausible.
pub fn check_usual_aperture(diameter: f64) -> Result<(), OpticsError> {
    APERTURE.check(diameter * 1e3)
}

/// Depths below this (mm) count as the plane at 0. Pixels of 4 um give 0.1 waves of defocus over the whole eyebox at
/// this depth.
const SHALLOWEST: f64 = 0.02;
/// Depths up to this (meters) are accepted behind any lens.
const SHALLOW: f64 = 50e-3;
/// Depths up to this (diopters) are accepted. This is closer than an eye reads.
const CLOSE: f64 = 5.0;

/// Rejects a depth at the display (meters, behind a lens of `focal_length`, meters) that most likely is in another
/// unit.
///
/// # Errors
/// [`OpticsError::Unusual`] for a value that is not plausible.
pub fn check_usual_depth(depth: f64, focal_length: f64) -> Result<(), OpticsError> {
    let most = SHALLOW.max(depth_of_dioptres(CLOSE, focal_length));
    if depth.abs() <= most {
        return Ok(());
    }
    let (depth, most) = (depth * 1e3, most * 1e3);
    let given = format!("the depth is {} mm", in_words(depth));
    let probably = match meant(depth.abs(), COMMON_DEPTH) {
        Some(meant) => format!("probably {} mm is meant", in_words(meant * depth.signum())),
        None => format!("before this display it may be {} mm at most", in_words(most)),
    };
    Err(OpticsError::Unusual { given, probably })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(error: Result<(), OpticsError>, words: &[&str]) {
        let error = error.unwrap_err();
        assert!(
            matches!(
                error,
                OpticsError::Unusual { .. } | OpticsError::OutOfRange { .. } | OpticsError::OutsideEyebox { .. }
            ),
            "{error}"
        );
        let text = error.to_string();
        assert!(words.iter().all(|w| text.contains(w)) && !text.contains('\n'), "{text}");
    }

    #[test]
    fn wrong_units_are_refused_with_what_is_probably_meant() {
        let optics = |pitch: f64, nm: f64, mm: f64| {
            Optics::new(8, 8, pitch * 1e-6, nm * 1e-9, mm * 1e-3).and_then(|o| o.check_usual())
        };
        for (pitch, nm, mm) in [(8.0, 520.0, 400.0), (1.0, 440.0, 2.0), (20.0, 1550.0, 1000.0)] {
            assert_eq!(optics(pitch, nm, mm), Ok(()));
        }
        refused(optics(0.008, 520.0, 400.0), &["0.008 um", "8 um"]);
        refused(optics(8000.0, 520.0, 400.0), &["8000 um", " 8 um"]);
        refused(optics(8e-6, 520.0, 400.0), &[" 8 "]);
        refused(optics(8.0, 0.52, 400.0), &[" 520 "]);
        refused(optics(8.0, 5.2e-7, 400.0), &[" 520 "]);
        refused(optics(8.0, 52000.0, 400.0), &["52000 nm", "380", "1100 nm"]);
        refused(optics(8.0, 520.0, 0.4), &["0.4 mm", "400 mm"]);
        refused(optics(8.0, 520.0, 400_000.0), &["400 mm"]);
    }

    #[test]
    fn presets_are_usual_and_portraits_say_so() {
        for name in crate::PRESETS {
            assert_eq!(Display::preset(name).unwrap().check_usual(), Ok(()), "{name}");
        }
        let upright = Display { height: 1920, width: 1080, ..Display::preset("paper").unwrap() };
        refused(upright.check_usual(), &["1920", "1080x1920", "portrait = true"]);
        assert_eq!(Display { portrait: true, ..upright.clone() }.check_usual(), Ok(()));
        let mut exchanged = Display::preset("paper").unwrap();
        exchanged.wavelengths[0].wavelength = 440e-9;
        exchanged.wavelengths[2].wavelength = 660e-9;
        refused(exchanged.check_usual(), &["440 nm", "520 nm"]);
    }

    #[test]
    fn view_pitches_and_depths_in_another_unit_are_refused() {
        let unusual = |checked: Result<(), OpticsError>| match checked {
            Ok(()) => None,
            Err(OpticsError::Unusual { probably, .. }) => Some(probably),
            Err(other) => panic!("{other}"),
        };
        for mm in [0.01, 0.2, 2.2, 11.0, 60.0, 100.0] {
            assert_eq!(unusual(check_usual_view_pitch(mm * 1e-3)), None, "{mm}");
        }
        for (given, meant) in [(2.2, "2.2 mm"), (0.5, "0.5 mm"), (2.2e-6, "2.2 mm"), (11.0, "11 mm"), (2.2e3, "2.2 mm")]
        {
            assert!(unusual(check_usual_view_pitch(given)).unwrap().contains(meant), "{given} m");
        }
        assert!(unusual(check_usual_view_pitch(1e-30)).is_some());
        for (mm, focal_length) in [(0.0, 0.4), (14.0, 0.4), (-50.0, 0.04), (400.0, 0.4), (-800.0, 0.4), (3000.0, 1.0)] {
            assert_eq!(unusual(check_usual_depth(mm * 1e-3, focal_length)), None, "{mm}");
        }
        for (given, focal_length, meant) in
            [(1.0, 0.4, "1 mm"), (-3.0, 0.4, "-3 mm"), (14.0, 0.4, "14 mm"), (0.5, 0.04, "0.5 mm"), (3e3, 1.0, "3 mm")]
        {
            assert!(unusual(check_usual_depth(given, focal_length)).unwrap().contains(meant), "{given} m");
        }
        assert!(unusual(check_usual_depth(1e30, 0.4)).is_some() && unusual(check_usual_depth(f64::NAN, 0.4)).is_some());
    }

    #[test]
    fn pupils_are_such_as_eyes_have() {
        let optics = Optics::new(8, 8, 8e-6, 440e-9, 0.4).unwrap();
        let check = |mm| Pupil::from_mm(mm).check_usual(&optics).map(|_| ());
        assert_eq!(check([0.0, 0.0, 4.0, 1.5]), Ok(()));
        assert_eq!(check([0.0, 0.0, 22.0, 0.0]), Ok(()));
        refused(check([0.0, 0.0, 0.004, 0.0]), &["0.004 mm", "probably 4 mm"]);
        refused(check([0.0, 0.0, 4000.0, 0.0]), &["4000 mm", "probably 4 mm"]);
        refused(check([0.0, 0.0, 30.0, 0.0]), &["30 mm wide", "22.00 mm"]);
        refused(check([0.0, 0.0, 4.0, 1000.0]), &["1000 mm", "probably 1 mm"]);
        refused(check([14.0, 0.0, 4.0, 0.0]), &["outside", "11.00 mm"]);
        refused(check_usual_diameters([2e-6, 4e-6], 22e-3), &["0.002 mm", "probably 2 mm"]);
    }
}
