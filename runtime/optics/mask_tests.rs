use super::super::{Color, Display};
use super::*;
use crate::OpticsError;
use eyebox_base::error::ErrorData;
use eyebox_base::files::write_npy;
use eyebox_kernels::Complex64;
use eyebox_kernels::fft::{Direction, transform_f64};
use std::f64::consts::TAU;

const BENCH: &str =
    "resolution = [6, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { red = 640, green = 520 }\n";

fn load(at: &Path, mask: &str) -> Result<Display, OpticsError> {
    let file = at.join("bench.toml");
    Display::from_toml(&format!("{BENCH}{mask}"), file.to_str().unwrap())
}

/// The display's text keeps the phases of a file, so the file is no longer needed.
#[test]
fn phases_of_a_file_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let turns: Vec<f32> = (0..12 * 16).map(|i| (37 * i % 4096) as f32 / 4096.0).collect();
    // Whole turns count as none.
    let radians: Vec<f32> = turns.iter().map(|t| (f64::from(*t) * TAU - TAU) as f32).collect();
    write_npy(&dir.path().join("mask.npy"), &[12, 16], &radians).unwrap();
    let display = load(dir.path(), "[mask]\nfactor = 2\nfile = \"mask.npy\"\ndistance_mm = 0.5\n").unwrap();
    let mask = display.mask.as_ref().unwrap();
    assert_eq!((mask.turns([12, 16]), mask.distance()), (turns.clone(), 0.5e-3));
    let again = Display::from_toml(&display.to_toml(), "elsewhere").unwrap();
    assert_eq!(again.mask, display.mask);
    // A display of another size has the same corner, and repeats the phases.
    let smaller = mask.turns([4, 20]);
    assert_eq!(smaller[20..36], turns[16..32]);
    assert_eq!(smaller[36..40], turns[16..20]);
    assert_eq!(display.mask_slope(640e-9), 1.0);
    assert!((display.mask_slope(520e-9) - 640.0 / 520.0).abs() < 1e-12);
}

/// A mask without phases and without finer pixels is no mask.
#[test]
fn a_clear_mask_is_none() {
    let dir = tempfile::tempdir().unwrap();
    write_npy(&dir.path().join("clear.npy"), &[6, 8], &[0.0; 48]).unwrap();
    write_npy(&dir.path().join("finer.npy"), &[12, 16], &[0.0; 192]).unwrap();
    assert_eq!(load(dir.path(), "[mask]\nfactor = 1\nfile = \"clear.npy\"\n").unwrap(), load(dir.path(), "").unwrap());
    let finer = load(dir.path(), "[mask]\nfactor = 2\nfile = \"finer.npy\"\n").unwrap();
    let (plain, finer) = (load(dir.path(), "").unwrap(), finer);
    let eyebox = |display: &Display| display.optics(Color::Green).unwrap().eyebox();
    assert!((eyebox(&finer) / eyebox(&plain) - 2.0).abs() < 1e-12);
    assert!((finer.eyebox_min() / plain.eyebox_min() - 2.0).abs() < 1e-12);
    assert_eq!(finer.picture_pixel(), plain.picture_pixel());
}

#[test]
fn a_mask_that_cannot_be_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    write_npy(&dir.path().join("small.npy"), &[6, 8], &[0.5; 48]).unwrap();
    for (mask, says) in [
        ("seed = 1\n", "display-file/toml"),
        ("factor = 0\nseed = 1\n", "display-file/range"),
        ("factor = 5\nseed = 1\n", "display-file/range"),
        ("factor = 2\n", "display-file/mask-without-phases"),
        ("factor = 2\nband = 0.5\n", "display-file/mask-band-without-seed"),
        ("factor = 2\nseed = 1\nband = 1.5\n", "display-file/mask-band"),
        ("factor = 2\nseed = 1\ndistance_mm = -1\n", "display-file/range"),
        ("factor = 2\nseed = 1\nwavelength_nm = 5\n", "display-file/range"),
        ("factor = 2\nfile = \"none.npy\"\n", "display-file/read"),
        ("factor = 2\nfile = \"small.npy\"\n", "display-file/mask-size"),
        ("factor = 2\nfile = \"small.npy\"\nseed = 1\n", "display-file/mask-seed-and-phases"),
        ("factor = 2\nphases = \"12x16:AB\"\n", "display-file/toml"),
        ("factor = 2\nseed = 1\nfrozen = true\n", "display-file/toml"),
        ("factor = 2\nseed = 1\n[model.all]\nsubpixels = 2\n", "display-file/mask-and-subpixels"),
        ("factor = 2\nseed = 1\ndistance_mm = 1\n[source.green]\nkind = \"led\"\n", "display-file/mask-and-source"),
    ] {
        let error = load(dir.path(), &format!("[mask]\n{mask}")).unwrap_err();
        assert!(error.to_string().lines().count() < 8, "{mask}: {error}");
        assert_eq!(ErrorData::of(&error).code, says, "{error}");
    }
    let far = BENCH.replace("pitch_um", "geometry = \"far-field\"\npitch_um");
    let error = Display::from_toml(&format!("{far}[mask]\nfactor = 2\nseed = 1\n"), "b").unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "display-file/mask-without-relay");
}

/// Share of a mask's light in the square of directions with this share of all, along an axis.
fn inside(turns: &[f32], n: usize, band: f64) -> f64 {
    let mut field: Vec<Complex64> = turns.iter().map(|t| Complex64::cis(TAU * f64::from(*t))).collect();
    transform_f64(&mut field, n, Direction::Forward);
    let mut turned: Vec<Complex64> = (0..n * n).map(|i| field[i % n * n + i / n]).collect();
    transform_f64(&mut turned, n, Direction::Forward);
    let near = |k: usize| (k.min(n - k) as f64) <= 0.5 * band * n as f64;
    let power = |all: bool| -> f64 {
        let counts = |i: usize| all || (near(i / n) && near(i % n));
        (0..n * n).filter(|i| counts(*i)).map(|i| turned[i].norm_sqr()).sum()
    };
    power(false) / power(true)
}

/// Random phases send light everywhere, designed ones into their band, and each seed gives a different mask.
#[test]
fn a_designed_mask_keeps_its_light_in_its_band() {
    let mask = |seed: u64, band: Option<f64>| {
        let mask = Mask { factor: 2, seed: Some(seed), band, ..Mask::default() };
        mask.turns([64, 64])
    };
    let random = inside(&mask(1, None), 64, 0.5);
    assert!((random - 0.26).abs() < 0.05, "{random}");
    for band in [0.25, 0.5, 0.75] {
        let lit = inside(&mask(1, Some(band)), 64, band);
        assert!(lit > 0.9, "{band}: {lit}");
    }
    assert!(mask(1, None) != mask(2, None) && mask(1, Some(0.5)) != mask(2, Some(0.5)));
    assert_eq!(mask(1, Some(0.5)), mask(1, Some(0.5)));
}
