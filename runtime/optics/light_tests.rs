use super::super::Pupil;
use super::super::source::WIDTHS;
use super::*;
use crate::OpticsError;
use eyebox_base::error::ErrorData;

const BENCH: &str =
    "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { red = 660, green = 520 }\n";

fn display(source: &str) -> Display {
    Display::from_toml(&format!("{BENCH}{source}"), "b.toml").unwrap()
}

fn refused(source: &str) -> OpticsError {
    let error = Display::from_toml(&format!("{BENCH}{source}"), "b.toml").unwrap_err();
    assert!(error.to_string().contains("b.toml") && !error.to_string().trim_end().contains('\n'), "{error}");
    error
}

/// The sum of the weights, the mean of the angle and its spread along x (standard deviation), radians.
fn moments(modes: &[SourceMode]) -> [f64; 3] {
    let sum = |of: &dyn Fn(&SourceMode) -> f64| modes.iter().map(|m| m.weight * of(m)).sum::<f64>();
    let mean = sum(&|m| m.angle[0]);
    [sum(&|_| 1.0), mean, (sum(&|m| m.angle[0] * m.angle[0]) - mean * mean).sqrt()]
}

#[test]
fn presets_and_sizes_are_modes_of_their_spread() {
    assert!(display("").modes(Color::Green).is_empty());
    // A laser, given or by default, and a point of one line are no source at all.
    for none in ["[source.all]\nkind = \"laser\"\n", "[source.green]\nmodes = [{ weight = 3 }]\n"] {
        assert!(display(none).modes(Color::Green).is_empty());
    }
    let f = 0.4;
    let led = display("[source.all]\nkind = \"led\"\nsamples = 3\nlines = 3\n");
    let modes = led.modes(Color::Green);
    assert_eq!((modes.len(), led.modes(Color::Red).len()), (7 * 3, 7 * 3));
    let [sum, mean, spread] = moments(&modes);
    // A disc of 1 mm has a standard deviation of a quarter of its diameter along an axis.
    assert!((sum - 1.0).abs() < 1e-14 && mean.abs() < 1e-15 && (spread * f * 1e3 - 0.25).abs() < 1e-12);
    let line = modes.iter().map(|m| m.weight * (m.wavelength - 520e-9).powi(2)).sum::<f64>().sqrt();
    assert!((line * 1e9 - 10.0 / WIDTHS).abs() < 1e-6, "{line:e}");
    let square = display("[source.green]\nimage_mm = 2\nshape = \"square\"\n").modes(Color::Green);
    assert_eq!(square.len(), 9);
    assert!((moments(&square)[2] * f * 1e3 - 2.0 / 12f64.sqrt()).abs() < 1e-12);
    let gaussian = display("[source.green]\nangle_mrad = 5\nshape = \"gaussian\"\nsamples = 5\n").modes(Color::Green);
    assert!((moments(&gaussian)[2] * 1e3 - 5.0 / WIDTHS).abs() < 1e-12);
}

#[test]
fn a_colour_s_source_comes_before_that_of_all_and_survives_the_file() {
    let text =
        "[source.all]\nkind = \"led\"\nsamples = 2\n[source.red]\nkind = \"laser\"\n[source.green]\nangle_mrad = 1\n";
    let both = display(text);
    assert!(both.modes(Color::Red).is_empty());
    let green = both.modes(Color::Green);
    assert_eq!(green.len(), 4);
    assert!((moments(&green)[2] - 0.25e-3).abs() < 1e-15);
    assert_eq!(Display::from_toml(&both.to_toml(), "b").unwrap(), both);
    let list = display(
        "[source.green]\nmodes = [{ angle_mrad = [1, -2], wavelength_nm = 522, weight = 3 }, { weight = 1 }]\n",
    );
    let wanted = [
        SourceMode { angle: [1e-3, -2e-3], wavelength: 522e-9, weight: 0.75, ..SourceMode::centred(522e-9) },
        SourceMode { angle: [0.0; 2], wavelength: 520e-9, weight: 0.25, ..SourceMode::centred(520e-9) },
    ];
    let modes = list.modes(Color::Green);
    assert!((modes[0].wavelength - wanted[0].wavelength).abs() < 1e-21);
    assert_eq!((modes[0].angle, modes[0].weight, modes[1]), (wanted[0].angle, wanted[0].weight, wanted[1]));
    assert_eq!(Display::from_toml(&list.to_toml(), "b").unwrap(), list);
    // In the SLM's own light, the pupil of a mode is moved against the mode's image.
    let seen = wanted[0].pupil(&Pupil::from_mm([1.0, 1.0, 4.0, 2.0]), 0.4).to_mm();
    assert!(seen.iter().zip([0.6, 1.8, 4.0, 2.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{seen:?}");
}

#[test]
fn sources_that_cannot_be_are_refused_in_a_line() {
    let mode = |rest: &str| format!("[source.green]\nmodes = [{{ weight = 1 }}, {{ {rest} }}]\n");
    let cases = [
        ("[source.green]\nmodes = [{ weight = 0 }]\n".to_owned(), "display-file/source-without-light"),
        (mode("weight = -0.5"), "display-file/range"),
        (mode("weight = nan"), "display-file/range"),
        (mode("weight = 1, wavelength_nm = 560"), "display-file/line-width"),
        (mode("weight = 1, wavelength_nm = -1"), "display-file/line-width"),
        // 520 nm over 2 x 8 um.
        (mode("weight = 1, angle_mrad = [0, 33]"), "display-file/source-angle"),
        (mode("weight = 1, power = 2"), "display-file/toml"),
        ("[source.blue]\nkind = \"led\"\n".into(), "display-file/no-such-color"),
        ("[source.all]\nkind = \"sun\"\n".into(), "display-file/toml"),
        ("[source.all]\nimage_mm = -1\n".into(), "display-file/range"),
        ("[source.all]\nimage_mm = 40\n".into(), "display-file/source-angle"),
        ("[source.all]\nimage_mm = 1\nangle_mrad = 1\n".into(), "display-file/source-place-twice"),
        ("[source.all]\nlinewidth_nm = 60\n".into(), "display-file/line-width"),
        ("[source.all]\nkind = \"led\"\nsamples = 9\n".into(), "display-file/range"),
    ];
    for (text, says) in cases {
        let error = refused(&text);
        assert_eq!(ErrorData::of(&error).code, says, "{error}");
    }
    let far = "geometry = \"far-field\"\n[source.all]\nkind = \"led\"\n";
    assert_eq!(ErrorData::of(&refused(far)).code, "display-file/source-without-relay");
}

/// A source image of 2 x 2 mm leaves speckle through 4 mm a contrast of 0.64 (OPTICS 12).
#[test]
fn speckle_falls_as_the_source_grows_and_few_samples_tell() {
    let square = display("[source.green]\nimage_mm = 2.5\nshape = \"square\"\n");
    let contrast = |modes: &[SourceMode]| speckle_contrast(modes, 4e-3, 13e-3, 0.4);
    let grid: Vec<SourceMode> = (0..25)
        .map(|i| SourceMode {
            angle: [f64::from(i % 5 - 2), f64::from(i / 5 - 2)].map(|at| at * 0.5e-3 / 0.4),
            wavelength: 520e-9,
            weight: 0.04,
            ..SourceMode::centred(520e-9)
        })
        .collect();
    assert!((contrast(&grid) - 0.64).abs() < 0.01, "{}", contrast(&grid));
    assert!((contrast(&[SourceMode::centred(520e-9)]) - 1.0).abs() < 1e-12);
    let sampling = |diameter| square.source_sampling(Color::Green, diameter, 0.0).unwrap();
    let (few, many) = (sampling(8e-3), sampling(2e-3));
    assert!(few.modes < many.modes && many.samples[1] == 1, "{few:?}, {many:?}");
    assert!((few.contrast / few.limit - 1.0).abs() <= EXACT && (few.one_more - few.contrast).abs() < 0.05, "{few:?}");
    // Content far from the focus requires more samples. Values of the file are kept.
    assert!(square.source_sampling(Color::Green, 8e-3, 8e-3).unwrap().modes > few.modes);
    let given =
        display("[source.green]\nimage_mm = 2\nsamples = 4\n").source_sampling(Color::Green, 8e-3, 0.0).unwrap();
    assert_eq!((given.samples, given.modes), ([4, 1], 12));
    assert!(display("").source_sampling(Color::Green, 4e-3, 0.0).is_none());
    let fixed = square.with_source_samples(Color::Green, few.samples);
    assert_eq!(fixed.modes(Color::Green).len(), few.modes);
}
