//! Reads quantities as people write them, such as `4mm`, `0.5D`, `520nm`, `30Hz`, `10s`, `4GiB` and `1080p`.
//!
//! A number without a unit is in the unit that its reader names. The case of a unit does not matter.

use serde::Serialize;
use std::f64::consts::PI;
use std::fmt;

/// Dimension of a quantity. A unit of another dimension is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Dimension {
    /// Length, of which all units are powers of ten of a meter.
    Length,
    /// Inverse of a distance from the eye.
    Vergence,
    /// Number of events per second.
    Frequency,
    /// Duration of an event.
    Time,
    /// Amount of memory in bytes.
    Memory,
    /// Angle in a plane.
    Angle,
    /// Brightness of a surface.
    Luminance,
    /// Ratio of powers on a logarithmic scale.
    Level,
    /// Temperature of a bench.
    Temperature,
    /// Number of pixels along an axis.
    Pixels,
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Length => "length",
            Self::Vergence => "vergence",
            Self::Frequency => "frequency",
            Self::Time => "time",
            Self::Memory => "memory",
            Self::Angle => "angle",
            Self::Luminance => "luminance",
            Self::Level => "level",
            Self::Temperature => "temperature",
            Self::Pixels => "pixels",
        })
    }
}

/// A unit, which is `factor` times 10 to the power `exponent` of the first unit of its dimension.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    name: &'static str,
    dimension: Dimension,
    factor: f64,
    exponent: i32,
}

const fn unit(name: &'static str, dimension: Dimension, factor: f64, exponent: i32) -> Unit {
    Unit { name, dimension, factor, exponent }
}

/// The unit of nanometers.
pub const NM: Unit = unit("nm", Dimension::Length, 1.0, -9);
/// The unit of micrometers.
pub const UM: Unit = unit("um", Dimension::Length, 1.0, -6);
/// The unit of millimeters.
pub const MM: Unit = unit("mm", Dimension::Length, 1.0, -3);
/// The unit of centimeters.
pub const CM: Unit = unit("cm", Dimension::Length, 1.0, -2);
/// The unit of meters.
pub const M: Unit = unit("m", Dimension::Length, 1.0, 0);
/// The unit of diopters.
pub const D: Unit = unit("D", Dimension::Vergence, 1.0, 0);
/// The unit of hertz.
pub const HZ: Unit = unit("Hz", Dimension::Frequency, 1.0, 0);
/// The unit of kilohertz.
pub const KHZ: Unit = unit("kHz", Dimension::Frequency, 1.0, 3);
/// The unit of microseconds.
pub const US: Unit = unit("us", Dimension::Time, 1.0, -6);
/// The unit of milliseconds.
pub const MS: Unit = unit("ms", Dimension::Time, 1.0, -3);
/// The unit of seconds.
pub const S: Unit = unit("s", Dimension::Time, 1.0, 0);
/// The unit of minutes.
pub const MIN: Unit = unit("min", Dimension::Time, 60.0, 0);
/// The unit of hours.
pub const H: Unit = unit("h", Dimension::Time, 3600.0, 0);
/// The unit of bytes.
pub const B: Unit = unit("B", Dimension::Memory, 1.0, 0);
/// The unit of degrees.
pub const DEG: Unit = unit("deg", Dimension::Angle, PI / 180.0, 0);
/// The unit of minutes of arc.
pub const ARCMIN: Unit = unit("arcmin", Dimension::Angle, PI / 10800.0, 0);
/// The unit of radians.
pub const RAD: Unit = unit("rad", Dimension::Angle, 1.0, 0);
/// The unit of candelas per square meter.
pub const CD_M2: Unit = unit("cd/m2", Dimension::Luminance, 1.0, 0);
/// The unit of decibels.
pub const DB: Unit = unit("dB", Dimension::Level, 1.0, 0);
/// The unit of degrees Celsius.
pub const CELSIUS: Unit = unit("C", Dimension::Temperature, 1.0, 0);
/// The unit of pixels.
pub const PX: Unit = unit("px", Dimension::Pixels, 1.0, 0);

/// All units, from the smallest of a dimension to the largest.
pub const UNITS: [Unit; 29] = [
    NM,
    UM,
    MM,
    CM,
    M,
    D,
    HZ,
    KHZ,
    US,
    MS,
    S,
    MIN,
    H,
    B,
    unit("KB", Dimension::Memory, 1.0, 3),
    unit("KiB", Dimension::Memory, 1024.0, 0),
    unit("MB", Dimension::Memory, 1.0, 6),
    unit("MiB", Dimension::Memory, 1048576.0, 0),
    unit("GB", Dimension::Memory, 1.0, 9),
    unit("GiB", Dimension::Memory, 1073741824.0, 0),
    unit("TB", Dimension::Memory, 1.0, 12),
    unit("TiB", Dimension::Memory, 1099511627776.0, 0),
    ARCMIN,
    DEG,
    RAD,
    CD_M2,
    DB,
    CELSIUS,
    PX,
];

/// Names of pictures by their rows, and their rows and columns.
const SIZES: [(&str, [usize; 2]); 6] = [
    ("720p", [720, 1280]),
    ("1080p", [1080, 1920]),
    ("1440p", [1440, 2560]),
    ("2160p", [2160, 3840]),
    ("4k", [2160, 3840]),
    ("4320p", [4320, 7680]),
];

/// Most pixels along an axis of a display.
const MOST_PIXELS: usize = 65536;

/// A refused quantity, with its text and the units that fit.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
#[non_exhaustive]
#[allow(missing_docs, reason = "fields that their names explain")]
pub enum QuantityError {
    /// The text does not begin with a finite number.
    #[error("'{value}' is not a number, alone or with a unit ({})", list(fits))]
    NotANumber { value: String, fits: Vec<&'static str> },
    /// The text has no unit, but its reader requires one.
    #[error("'{value}' has no unit, add one of {}", list(fits))]
    NoUnit { value: String, fits: Vec<&'static str> },
    /// No unit has this name.
    #[error("'{value}' has the unknown unit {unit}, use {}", list(fits))]
    UnknownUnit { value: String, unit: String, fits: Vec<&'static str> },
    /// The unit belongs to another dimension.
    #[error("{unit} of '{value}' is a unit of {given}, not of {expected}, use {}", list(fits))]
    OtherDimension { value: String, unit: &'static str, given: Dimension, expected: Dimension, fits: Vec<&'static str> },
    /// The number is out of its range.
    #[error("'{value}' is out of range, expected {range}")]
    OutOfRange { value: String, range: &'static str },
    /// The text is not a size.
    #[error(
        "'{value}' is no size, expected rows x columns, such as 1080x1920, one number for a square, or {}",
        list(fits)
    )]
    NotASize { value: String, fits: Vec<&'static str> },
    /// An axis has no pixels or too many.
    #[error("each axis of '{value}' must be 1 to {MOST_PIXELS} pixels")]
    SizeOutOfRange { value: String },
}

fn list(names: &[&str]) -> String {
    match names {
        [all @ .., last] if !all.is_empty() => format!("{} or {last}", all.join(", ")),
        _ => names.concat(),
    }
}

/// A number with its unit, as it was written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity<'a> {
    number: &'a str,
    unit: Unit,
}

impl<'a> Quantity<'a> {
    /// Reads a number without a unit, or with a unit of the dimension of `plain` or of `also`.
    ///
    /// # Errors
    /// [`QuantityError`] if the text is something else.
    pub fn read(text: &'a str, plain: Unit, also: &[Dimension]) -> Result<Self, QuantityError> {
        let (number, unit) = Self::parts(text, plain, also)?;
        Ok(Self { number, unit: unit.unwrap_or(plain) })
    }

    /// Reads a number with a unit of the dimension of `expected` or of `also`.
    ///
    /// # Errors
    /// [`QuantityError`] if the text is something else.
    pub fn read_with_unit(text: &'a str, expected: Unit, also: &[Dimension]) -> Result<Self, QuantityError> {
        let (number, unit) = Self::parts(text, expected, also)?;
        let unit = unit.ok_or_else(|| QuantityError::NoUnit { value: text.into(), fits: fits(expected, also) })?;
        Ok(Self { number, unit })
    }

    fn parts(text: &'a str, plain: Unit, also: &[Dimension]) -> Result<(&'a str, Option<Unit>), QuantityError> {
        let text = text.trim();
        let (number, name) = text.split_at(length_of_number(text));
        let name = name.trim_start();
        let fits = || fits(plain, also);
        if !number.parse().is_ok_and(f64::is_finite) {
            return Err(QuantityError::NotANumber { value: text.into(), fits: fits() });
        }
        if name.is_empty() {
            return Ok((number, None));
        }
        let unknown = || QuantityError::UnknownUnit { value: text.into(), unit: name.into(), fits: fits() };
        let unit = Unit::named(name).ok_or_else(unknown)?;
        if unit.dimension != plain.dimension && !also.contains(&unit.dimension) {
            return Err(QuantityError::OtherDimension {
                value: text.into(),
                unit: unit.name,
                given: unit.dimension,
                expected: plain.dimension,
                fits: fits(),
            });
        }
        Ok((number, Some(unit)))
    }

    /// Returns the error of a number out of its range, which a sentence states.
    pub fn out_of_range(self, range: &'static str) -> QuantityError {
        QuantityError::OutOfRange { value: format!("{}{}", self.number, self.unit.name), range }
    }

    /// Returns the unit that was written, or the plain one.
    pub fn unit(self) -> Unit {
        self.unit
    }

    /// Returns the number in another unit of the same dimension. Powers of ten are exact because they move the decimal
    /// point of the text.
    pub fn value_in(self, unit: Unit) -> f64 {
        let shift = self.unit.exponent - unit.exponent;
        let (mantissa, exponent) = self.number.split_once(['e', 'E']).unwrap_or((self.number, "0"));
        let exponent = exponent.parse::<i32>().unwrap_or(0).saturating_add(shift);
        let text = if shift == 0 { self.number.to_owned() } else { format!("{mantissa}e{exponent}") };
        let value: f64 = text.parse().unwrap_or(f64::NAN);
        if self.unit.factor.to_bits() == unit.factor.to_bits() { value } else { value * self.unit.factor / unit.factor }
    }
}

impl Unit {
    /// Returns the name, as people write it.
    pub fn name(self) -> &'static str {
        self.name
    }

    /// Returns the dimension of the unit.
    pub fn dimension(self) -> Dimension {
        self.dimension
    }

    /// Returns the unit of a name in either case. The micro sign and the degree sign have their meaning.
    pub fn named(name: &str) -> Option<Self> {
        let name = name.replace(['\u{b5}', '\u{3bc}'], "u").replace('\u{b0}', "deg");
        let name = if name.eq_ignore_ascii_case("degC") { "C" } else { &name };
        UNITS.into_iter().find(|unit| unit.name.eq_ignore_ascii_case(name))
    }

    /// Reads a number in this unit, or with any unit of the same dimension, and returns it in this unit.
    ///
    /// # Errors
    /// [`QuantityError`] if the text is something else.
    pub fn read(self, text: &str) -> Result<f64, QuantityError> {
        Quantity::read(text, self, &[]).map(|quantity| quantity.value_in(self))
    }

    /// Writes a number with this unit, so that [`Self::read`] returns the same number.
    pub fn text(self, value: f64) -> String {
        format!("{value}{}", self.name)
    }
}

/// Returns the names of the units that fit.
fn fits(plain: Unit, also: &[Dimension]) -> Vec<&'static str> {
    let fits = |unit: &Unit| unit.dimension == plain.dimension || also.contains(&unit.dimension);
    UNITS.iter().filter(|unit| fits(unit)).map(|unit| unit.name).collect()
}

/// Returns the length of the number that a text begins with [bytes].
fn length_of_number(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |from: usize| from + bytes[from..].iter().take_while(|b| b.is_ascii_digit()).count();
    let sign = |at: usize| at + usize::from(matches!(bytes.get(at), Some(b'+' | b'-')));
    let mut end = digits(sign(0));
    if bytes.get(end) == Some(&b'.') {
        end = digits(end + 1);
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let first = sign(end + 1);
        let last = digits(first);
        end = if last > first { last } else { end };
    }
    end
}

/// Reads rows and columns, such as `1080x1920`, `256` for a square, `1080p`, `4k`.
///
/// # Errors
/// Returns [`QuantityError::NotASize`] or [`QuantityError::SizeOutOfRange`].
pub fn read_size(text: &str) -> Result<[usize; 2], QuantityError> {
    let text = text.trim();
    if let Some((_, size)) = SIZES.iter().find(|(name, _)| name.eq_ignore_ascii_case(text)) {
        return Ok(*size);
    }
    let wrong = || QuantityError::NotASize { value: text.into(), fits: SIZES.map(|(name, _)| name).to_vec() };
    let number = |text: &str| text.trim().parse::<usize>().map_err(|_| wrong());
    let (rows, columns) = text.split_once(['x', 'X', '\u{d7}']).unwrap_or((text, text));
    let size = [number(rows)?, number(columns)?];
    if size.iter().all(|axis| (1..=MOST_PIXELS).contains(axis)) {
        Ok(size)
    } else {
        Err(QuantityError::SizeOutOfRange { value: text.into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn quantities_are_read_in_every_unit() {
        for (text, unit, value) in [
            ("4", MM, 4.0),
            ("4mm", MM, 4.0),
            ("4 mm", MM, 4.0),
            ("-0.4cm", MM, -4.0),
            ("520nm", NM, 520.0),
            ("0.52um", NM, 520.0),
            ("0.52\u{b5}m", NM, 520.0),
            ("8e-3mm", UM, 8.0),
            ("1.1um", MM, 0.0011),
            ("0.4m", MM, 400.0),
            ("+.5D", D, 0.5),
            ("0.5d", D, 0.5),
            ("30Hz", HZ, 30.0),
            ("1.2kHz", HZ, 1200.0),
            ("10s", S, 10.0),
            ("250ms", S, 0.25),
            ("2min", S, 120.0),
            ("1h", MIN, 60.0),
            ("20", MS, 20.0),
            ("4GiB", B, 4294967296.0),
            ("4GB", B, 4e9),
            ("512 mib", B, 536870912.0),
            ("3deg", DEG, 3.0),
            ("3\u{b0}", DEG, 3.0),
            ("30arcmin", DEG, 0.5),
            ("3.141592653589793rad", DEG, 180.0),
            ("200cd/m2", CD_M2, 200.0),
            ("30dB", DB, 30.0),
            ("-5C", CELSIUS, -5.0),
            ("-5\u{b0}C", CELSIUS, -5.0),
            ("64px", PX, 64.0),
        ] {
            assert_eq!(unit.read(text), Ok(value), "{text}");
        }
    }

    #[test]
    fn other_texts_are_refused_with_the_units_that_fit() {
        for bad in ["", "mm", "x", "nan", "inf", "infmm", "nanGiB", "1e400mm", "0x10", "--3", "1,5mm", ".", "-", "e3"] {
            assert!(MM.read(bad).is_err(), "{bad}");
        }
        let fits = vec!["nm", "um", "mm", "cm", "m"];
        let dioptric = MM.read("0.5D").unwrap_err();
        assert!(dioptric.to_string().contains("nm, um, mm, cm or m"), "{dioptric}");
        let (given, expected) = (Dimension::Vergence, Dimension::Length);
        let other = QuantityError::OtherDimension { value: "0.5D".into(), unit: "D", given, expected, fits };
        assert_eq!(dioptric, other);
        let data = crate::error::ErrorData::of(&dioptric);
        assert_eq!((&data.code[..], &data.fields["given"]), ("other-dimension", &"vergence".into()));
        assert!(matches!(MM.read("4 mm2"), Err(QuantityError::UnknownUnit { unit, .. }) if unit == "mm2"));
        assert!(matches!(Quantity::read_with_unit("4", M, &[]), Err(QuantityError::NoUnit { .. })));
        assert!(Quantity::read("0.5D", MM, &[Dimension::Vergence]).is_ok_and(|q| q.unit() == D));
    }

    #[test]
    fn sizes_are_rows_and_columns() {
        for (text, size) in [
            ("256", [256, 256]),
            ("1920x1080", [1920, 1080]),
            ("45 X 64", [45, 64]),
            ("45\u{d7}64", [45, 64]),
            ("720p", [720, 1280]),
            ("1080P", [1080, 1920]),
            ("2160p", [2160, 3840]),
            ("4K", [2160, 3840]),
        ] {
            assert_eq!(read_size(text), Ok(size), "{text}");
        }
        for bad in ["0x8", "0", "x", "8x", "-1x4", "99999999x4", "p", "256mm", "1x2x3", "", "5.5"] {
            assert!(read_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn names_of_units_differ_in_more_than_case() {
        for (i, unit) in UNITS.iter().enumerate() {
            assert_eq!(Unit::named(unit.name), Some(*unit));
            assert!(UNITS[..i].iter().all(|other| !other.name.eq_ignore_ascii_case(unit.name)), "{}", unit.name);
        }
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(value in proptest::num::f64::NORMAL, at in 0..UNITS.len(), to in 0..UNITS.len()) {
            let (unit, other) = (UNITS[at], UNITS[to]);
            let text = unit.text(value);
            prop_assert_eq!(unit.read(&text), Ok(value));
            prop_assert_eq!(unit.read(&value.to_string()), Ok(value));
            match other.read(&text) {
                Ok(_) => prop_assert_eq!(other.dimension, unit.dimension),
                Err(QuantityError::OtherDimension { .. }) => prop_assert_ne!(other.dimension, unit.dimension),
                Err(error) => prop_assert!(false, "{}", error),
            }
        }

        #[test]
        fn a_quantity_is_the_same_in_each_unit(value in -1e6..1e6f64, at in 0..UNITS.len()) {
            let unit = UNITS[at];
            for other in UNITS.into_iter().filter(|other| other.dimension == unit.dimension) {
                let there = other.read(&unit.text(value)).expect("the same dimension");
                let back = unit.read(&other.text(there)).expect("the same dimension");
                prop_assert!((back - value).abs() <= 1e-12 * value.abs(), "{} {} {}", value, unit.name, other.name);
            }
        }

        #[test]
        fn no_text_panics(text in ".*") {
            let _ = (MM.read(&text), read_size(&text));
        }
    }
}
