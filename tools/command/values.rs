//! Reads the values of the command line in the units of people into the units of the library.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use eyebox::low_level::encode::AsShown;
use eyebox::low_level::hologram::PhaseUnit;
use eyebox::low_level::optics::{Depth, DisplayModel, Prescription, Pupil};
use eyebox::low_level::present::Rate;
pub use eyebox::low_level::quantity::{B, CD_M2, CELSIUS, D, DB, DEG, HZ, MIN, MM, MS, NM, PX, S, UM};
use eyebox::low_level::quantity::{QuantityError, Unit, read_size};
use eyebox::low_level::solve::Method;
use std::error::Error;
use std::fmt;

/// A refused value. Its source is a [`QuantityError`] if a number or its unit is wrong.
pub type Wrong = Box<dyn Error + Send + Sync>;

/// A refused number of a list, with the form of the whole list.
#[derive(Debug)]
struct WrongNumber {
    wrong: QuantityError,
    form: &'static str,
}

impl fmt::Display for WrongNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.wrong, self.form)
    }
}

impl Error for WrongNumber {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        Some(&self.wrong)
    }
}

/// Reads numbers, each in its unit. `form` describes the whole list.
pub fn numbers<const N: usize>(parts: Vec<&str>, units: [Unit; N], form: &'static str) -> Result<[f64; N], Wrong> {
    let count = parts.len();
    let parts: [&str; N] = parts.try_into().map_err(|_| format!("{count} values: {form}"))?;
    let mut values = [0.0; N];
    for ((value, part), unit) in values.iter_mut().zip(parts).zip(units) {
        *value = unit.read(part).map_err(|wrong| WrongNumber { wrong, form })?;
    }
    Ok(values)
}

/// Returns a parser of finite numbers in this unit.
pub fn number_in(unit: Unit) -> impl Fn(&str) -> Result<f64, QuantityError> + Clone + Send + Sync + 'static {
    move |text| unit.read(text)
}

/// Returns a parser of positive numbers in this unit.
pub fn positive_in(unit: Unit) -> impl Fn(&str) -> Result<f64, Wrong> + Clone + Send + Sync + 'static {
    move |text| in_range(unit.read(text)?, 1.0 / MOST, MOST, POSITIVE)
}

/// Returns a parser of numbers from 0 in this unit.
pub fn not_negative_in(unit: Unit) -> impl Fn(&str) -> Result<f64, Wrong> + Clone + Send + Sync + 'static {
    move |text| in_range(unit.read(text)?, 0.0, MOST, NOT_NEGATIVE)
}

/// Refuses a number out of its range, which `range` states.
fn in_range(value: f64, least: f64, most: f64, range: &str) -> Result<f64, Wrong> {
    if (least..=most).contains(&value) { Ok(value) } else { Err(range.into()) }
}

/// A given pupil. Its focus, in mm or dioptres, becomes a depth only before a display.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GivenPupil {
    /// The pupil with its focus at 0.
    place: Pupil,
    focus: Depth,
}

impl GivenPupil {
    /// Returns the pupil before a display of this focal length (meters).
    pub fn before(&self, focal_length: f64) -> Pupil {
        Pupil { depth: self.focus.metres(focal_length), ..self.place }
    }
}

pub fn pupil(text: &str) -> Result<GivenPupil, Wrong> {
    let form = "expected x,y,diameter,focus in mm, such as 2,-1,4,1.5, or with units, such as 2mm,-1mm,4mm,0.5D";
    let parts: Vec<&str> = text.split(',').collect();
    let count = parts.len();
    let [x, y, diameter, focus] = <[&str; 4]>::try_from(parts).map_err(|_| match count {
        1 => format!("one value: {form}"),
        _ => format!("{count} values: {form}"),
    })?;
    let [x, y, diameter] = numbers(vec![x, y, diameter], [MM; 3], form)?;
    let place = Pupil::from_mm([x, y, diameter, 0.0]).check().map_err(|e| e.to_string())?;
    Ok(GivenPupil { place, focus: focus.parse().map_err(|wrong| WrongNumber { wrong, form })? })
}

/// Reads sphere, cylinder and axis as opticians write them.
pub fn prescription(text: &str) -> Result<Prescription, Wrong> {
    let form = "expected S, or S C AXIS, in dioptres and degrees, such as \"-2\" or \"-2 -0.5 30\", or none";
    if text == "none" {
        return Ok(Prescription::default());
    }
    let parts: Vec<&str> = text.split([' ', ',', '/', 'x', '\u{d7}']).filter(|part| !part.is_empty()).collect();
    let [sphere, cylinder, axis] = match parts.len() {
        1 => [numbers(parts, [D], form)?[0], 0.0, 0.0],
        2 => return Err(format!("a cylinder needs its axis: {form}").into()),
        _ => numbers(parts, [D, D, DEG], form)?,
    };
    let eye = Prescription::new(sphere, cylinder, axis);
    eye.check().map_err(|wrong| wrong.to_string())?;
    Ok(eye)
}

/// The terms of a display's model that a solve uses.
#[derive(Debug, Clone, PartialEq)]
pub enum TermsOfModel {
    All,
    Auto,
    These(Vec<String>),
}

pub fn model_terms(text: &str) -> Result<TermsOfModel, String> {
    let names = match text {
        "all" => return Ok(TermsOfModel::All),
        "auto" => return Ok(TermsOfModel::Auto),
        "none" => Vec::new(),
        _ => text.split(',').map(|name| name.trim().to_owned()).collect(),
    };
    match names.iter().find(|name| !DisplayModel::TERMS.contains(&name.as_str())) {
        Some(name) => {
            Err(format!("no term '{name}': expected all, auto, none, or some of {}", DisplayModel::TERMS.join(",")))
        }
        None => Ok(TermsOfModel::These(names)),
    }
}

/// Reads a depth in mm, or in dioptres with a D at its end.
pub fn depth(text: &str) -> Result<Depth, QuantityError> {
    text.parse()
}

/// Reads the rows and columns of a picture.
pub fn size(text: &str) -> Result<[usize; 2], QuantityError> {
    read_size(text)
}

/// Reads an amount of memory in bytes.
pub fn memory(text: &str) -> Result<u64, Wrong> {
    let form = "expected an amount of memory, such as 4GiB or 512MiB";
    let bytes = B.read(text).map_err(|wrong| WrongNumber { wrong, form })?;
    in_range(bytes, 1.0, 1e18, form).map(|bytes| bytes as u64)
}

/// Reads diameters of pupils in millimeters, and returns meters.
pub fn diameters(text: &str) -> Result<[f64; 2], Wrong> {
    let form = "expected MIN..MAX in mm, such as 2..6.5";
    let [low, high] = numbers(text.split("..").collect(), [MM; 2], form)?;
    if low > 0.0 && low <= high && high <= 1e6 {
        Ok([low * 1e-3, high * 1e-3])
    } else {
        Err(format!("{form}, positive, smallest first").into())
    }
}

/// Reads two depths in either order, each in mm or dioptres.
pub fn depths(text: &str) -> Result<[Depth; 2], Wrong> {
    let form = "expected MIN..MAX in mm, such as -3..3.5, or in dioptres, such as -0.02D..0.02D";
    let (first, last) = text.split_once("..").ok_or(form)?;
    let read = |text: &str| text.parse::<Depth>().map_err(|wrong| WrongNumber { wrong, form });
    Ok([read(first)?, read(last)?])
}

/// The largest accepted number in any unit. Its inverse is the smallest positive one. Results computed from such
/// numbers stay in the range of floats.
const MOST: f64 = 1e12;
const POSITIVE: &str = "expected a positive number, 1e12 at most";
const NOT_NEGATIVE: &str = "expected a number, 0 to 1e12";

/// Reads a positive number without a unit.
pub fn positive(text: &str) -> Result<f64, Wrong> {
    in_range(text.parse().unwrap_or(f64::NAN), 1.0 / MOST, MOST, POSITIVE)
}

/// Reads a power ratio in decibels.
pub fn decibels(text: &str) -> Result<f64, Wrong> {
    let form = "expected decibels, -100 to 1000, such as 30";
    in_range(DB.read(text).map_err(|wrong| WrongNumber { wrong, form })?, -100.0, 1000.0, form)
}

/// Reads the temperature of a bench in degrees Celsius.
pub fn celsius(text: &str) -> Result<f64, Wrong> {
    in_range(CELSIUS.read(text)?, -100.0, 200.0, "expected degrees Celsius, -100 to 200")
}

/// Reads the place and the diameter of an iris in mm, which are three numbers with a positive last one.
pub fn iris(text: &str) -> Result<[f64; 3], Wrong> {
    let form = "expected x, y and a positive diameter in mm, such as 0,0,6";
    let iris @ [.., diameter] = numbers(text.split(',').collect(), [MM; 3], form)?;
    if diameter > 0.0 { Ok(iris) } else { Err(form.into()) }
}

/// Directions in degrees to the right and down.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets(pub Vec<[f64; 2]>);

pub fn targets(text: &str) -> Result<Targets, Wrong> {
    let form = "expected x,y;x,y;... in degrees, such as 0,0;-8,0;8,0;0,6";
    let all: Result<Vec<[f64; 2]>, Wrong> =
        text.split(';').map(|t| numbers(t.split(',').collect(), [DEG; 2], form)).collect();
    let all = all?;
    if all.iter().flatten().any(|v| !(-60.0..=60.0).contains(v)) {
        return Err("an eye turns 60 degrees at most".into());
    }
    if (4..=64).contains(&all.len()) {
        Ok(Targets(all))
    } else {
        Err(format!("{} targets, but 4 to 64 are needed: {form}", all.len()).into())
    }
}

/// Reads the unit of bare phases.
pub fn phase_unit(text: &str) -> Result<PhaseUnit, String> {
    match text {
        "rad" => Ok(PhaseUnit::Radians),
        "turns" => Ok(PhaseUnit::Turns),
        "deg" => Ok(PhaseUnit::Degrees),
        levels => positive(levels)
            .map(PhaseUnit::Levels)
            .map_err(|_| "expected rad, turns, deg, or the number of levels per turn, such as 256".into()),
    }
}

/// Reads a rate in hertz, or as a fraction.
pub fn rate(text: &str) -> Result<Rate, Wrong> {
    if !text.contains('/') {
        HZ.read(text)?;
    }
    Ok(Rate::parse(text)?)
}

/// Reads the side of a mark in pixels.
pub fn mark(text: &str) -> Result<usize, Wrong> {
    pixels(text, 0, 65536).map(|pixels| pixels as usize)
}

/// Reads a distance on the SLM in whole pixels, at least one.
pub fn whole_pixels(text: &str) -> Result<u32, Wrong> {
    pixels(text, 1, 1000)
}

fn pixels(text: &str, least: u32, most: u32) -> Result<u32, Wrong> {
    let pixels = PX.read(text)?;
    let form = format!("expected whole pixels, {least} to {most}");
    if pixels.fract() != 0.0 {
        return Err(form.into());
    }
    in_range(pixels, f64::from(least), f64::from(most), &form).map(|pixels| pixels as u32)
}

/// Reads a share from 0 to 1.
pub fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (0.0..=1.0).contains(&v) => Ok(v),
        _ => Err("expected a number from 0 to 1".into()),
    }
}

/// Reads a number from 0 without a unit.
pub fn not_negative(text: &str) -> Result<f64, Wrong> {
    in_range(text.parse().unwrap_or(f64::NAN), 0.0, MOST, NOT_NEGATIVE)
}

/// Reads the parts of a video frame that stay as the SLM shows them, separated by commas.
pub fn as_shown(text: &str) -> Result<AsShown, String> {
    let mut left = AsShown::default();
    match text.split(',').find(|part| !left.leave(part.trim())) {
        None => Ok(left),
        Some(wrong) => Err(format!("no part '{wrong}': expected some of {}, or all", AsShown::PARTS.join(", "))),
    }
}

/// Names on the command line, each with its help and its value.
pub type Names<T, const N: usize> = [(&'static str, &'static str, T); N];

/// Returns a parser of one of a few names.
pub fn one_of<T: Copy + Send + Sync, const N: usize>(names: &'static Names<T, N>) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(names.iter().map(|(name, about, _)| PossibleValue::new(*name).help(*about)))
        .map(|given| names.iter().find(|(name, ..)| *name == given).expect("one of the possible values").2)
}

/// Reads the direction of a gaze in degrees, and returns radians.
pub fn gaze(text: &str) -> Result<[f64; 2], Wrong> {
    let degrees = numbers(text.split(',').collect(), [DEG; 2], "expected X,Y in degrees, such as 3,-1.5")?;
    Ok(degrees.map(f64::to_radians))
}

/// Reads the name of a method.
pub fn method(text: &str) -> Result<Method, String> {
    let names = || Method::ALL.map(Method::name).join(", ");
    Method::by_name(text).ok_or_else(|| format!("no such method: expected one of {}", names()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_in_human_units() {
        assert_eq!(diameters("3..3.5").unwrap(), [3e-3, 3.5e-3]);
        assert_eq!(diameters("3mm..0.35cm").unwrap(), [3e-3, 3.5e-3]);
        assert_eq!(depths("3..-3mm").unwrap(), [Depth::Metres(3e-3), Depth::Metres(-3e-3)]);
        assert_eq!(depths("-0.5D..2D").unwrap(), [Depth::Dioptres(-0.5), Depth::Dioptres(2.0)]);
        assert_eq!(depths("2m..50cm").unwrap(), [Depth::Dioptres(0.5), Depth::Dioptres(2.0)]);
        assert!(depths("3..x").is_err() && depths("3").is_err());
        assert_eq!(size("45x64"), Ok([45, 64]));
        let read = |text| pupil(text).unwrap().before(0.4).to_mm().map(|v| v.round());
        assert_eq!(read("2,-1,6,3"), [2.0, -1.0, 6.0, 3.0]);
        assert_eq!(read("2,-1,6,0.5D"), [2.0, -1.0, 6.0, 80.0]);
        assert_eq!(read("0.2cm,-1,6000um,2m"), [2.0, -1.0, 6.0, 80.0]);
        for bad in ["", "1,2,3", "1,2,3,4,5", "a,b,c,d", "0,0,0,0", "0,0,-1,0", "nan,0,1,0", "0,0,inf,0"] {
            assert!(pupil(bad).is_err(), "{bad}");
        }
        assert!(pupil("0,0,4D,0").is_err() && pupil("0,0,4,1s").is_err());
        assert_eq!(prescription("-2.00 -0.50 x 30").unwrap(), Prescription::new(-2.0, -0.5, 30.0));
        assert_eq!(prescription("-2.00D -0.50D 30deg").unwrap(), Prescription::new(-2.0, -0.5, 30.0));
        assert_eq!(prescription("+1.25").unwrap(), Prescription::new(1.25, 0.0, 0.0));
        assert!(prescription("none").unwrap().is_perfect());
        for bad in ["", "-2 -0.5", "-2 -0.5 30 12", "-2mm", "nan", "-2 -0.5 200", "90"] {
            assert!(prescription(bad).is_err(), "{bad}");
        }
        for bad in ["3..1", "1", "nan..1", "-5..5", "0..1", "1..inf"] {
            assert!(diameters(bad).is_err(), "{bad}");
        }
        for bad in ["nan", "inf", "1e308", "1e-320", "-1", "0", ""] {
            assert!(positive(bad).is_err(), "{bad}");
        }
        assert!(not_negative("1e308").is_err() && decibels("nan").is_err());
    }
}
