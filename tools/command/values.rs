//! Values on the command line: what people write, and what it means inside.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use eyebox::low_level::encode::AsShown;
use eyebox::low_level::error::Reason;
use eyebox::low_level::hologram::PhaseUnit;
use eyebox::low_level::optics::{Depth, DisplayModel, Prescription, Pupil};
use eyebox::low_level::present::Rate;
use eyebox::low_level::solve::Method;

fn numbers<const N: usize>(parts: Vec<&str>, form: &str) -> Result<[f64; N], String> {
    let count = parts.len();
    let values: Result<Vec<f64>, _> = parts.iter().map(|p| p.trim().parse::<f64>()).collect();
    let values = values.map_err(|_| format!("not numbers: expected {form}"))?;
    values.try_into().map_err(|_| format!("{count} numbers: expected {form}"))
}

/// A pupil as it is given: its focus, in mm or dioptres, is a depth only before a display.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GivenPupil {
    /// Focused at 0.
    place: Pupil,
    focus: Depth,
}

impl GivenPupil {
    /// The pupil before a display of this focal length (metres).
    pub fn before(&self, focal_length: f64) -> Pupil {
        Pupil { depth: self.focus.metres(focal_length), ..self.place }
    }
}

pub fn pupil(text: &str) -> Result<GivenPupil, String> {
    let form = "x,y,diameter,focus in mm, such as 2,-1,4,1.5, or with the focus in dioptres, 2,-1,4,0.5D";
    let parts: Vec<&str> = text.split(',').collect();
    let count = parts.len();
    let [x, y, diameter, focus] = <[&str; 4]>::try_from(parts).map_err(|_| match count {
        1 => format!("one value: expected four, {form}"),
        _ => format!("{count} values: expected four, {form}"),
    })?;
    let [x, y, diameter] = numbers::<3>(vec![x, y, diameter], form)?;
    let place = Pupil::from_mm([x, y, diameter, 0.0]).check().map_err(|e| e.to_string())?;
    Ok(GivenPupil { place, focus: depth(focus)? })
}

/// Sphere, cylinder and axis as opticians write them.
pub fn prescription(text: &str) -> Result<Prescription, String> {
    let form = "S, or S C AXIS, in dioptres and degrees, such as \"-2\" or \"-2 -0.5 30\", or none";
    if text == "none" {
        return Ok(Prescription::default());
    }
    let parts: Vec<&str> = text.split([' ', ',', '/', 'x', '\u{d7}']).filter(|part| !part.is_empty()).collect();
    let [sphere, cylinder, axis] = match parts.len() {
        1 => [numbers::<1>(parts, form)?[0], 0.0, 0.0],
        2 => return Err(format!("a cylinder needs its axis: expected {form}")),
        _ => numbers::<3>(parts, form)?,
    };
    let eye = Prescription::new(sphere, cylinder, axis);
    eye.check().map_err(|wrong| wrong.to_string())?;
    Ok(eye)
}

/// Which terms of a display's model are solved for.
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
            Err(format!("'{name}' is no term: expected all, auto, none, or some of {}", DisplayModel::TERMS.join(",")))
        }
        None => Ok(TermsOfModel::These(names)),
    }
}

/// A depth: mm, or dioptres with a D behind.
pub fn depth(text: &str) -> Result<Depth, String> {
    text.parse().map_err(|wrong: Reason| wrong.to_string())
}

pub fn size(text: &str) -> Result<[usize; 2], String> {
    let form = "expected rows x columns, such as 1080x1920";
    let (h, w) = text.split_once(['x', 'X']).ok_or(form)?;
    let [h, w] = [h, w].map(|n| n.trim().parse::<usize>());
    let (h, w) = (h.map_err(|_| form)?, w.map_err(|_| form)?);
    if (1..=65536).contains(&h) && (1..=65536).contains(&w) {
        Ok([h, w])
    } else {
        Err("each axis must be 1 to 65536 pixels".into())
    }
}

/// Bytes: a number with KiB, MiB, GiB, or a plain one.
pub fn memory(text: &str) -> Result<u64, String> {
    let form = "expected an amount of memory, such as 4GiB or 512MiB";
    let units = [("KiB", 10), ("MiB", 20), ("GiB", 30), ("TiB", 40)];
    let (number, shift) =
        units.iter().find_map(|(unit, shift)| Some((text.strip_suffix(unit)?, *shift))).unwrap_or((text, 0));
    let bytes = number.trim().parse::<f64>().map_err(|_| form)? * f64::from(shift).exp2();
    if (1.0..1e18).contains(&bytes) { Ok(bytes as u64) } else { Err(form.into()) }
}

/// Diameters of pupils, metres, given in millimetres.
pub fn diameters(text: &str) -> Result<[f64; 2], String> {
    let form = "MIN..MAX in mm, such as 2..6.5";
    let [low, high] = numbers::<2>(text.split("..").collect(), form)?;
    if low > 0.0 && low <= high && high <= 1e6 {
        Ok([low * 1e-3, high * 1e-3])
    } else {
        Err(format!("expected {form}, positive, smallest first"))
    }
}

/// Two depths in either order, each in mm or dioptres.
pub fn depths(text: &str) -> Result<[Depth; 2], String> {
    let form = "expected MIN..MAX in mm, such as -3..3.5, or in dioptres, such as -0.02D..0.02D";
    let (first, last) = text.split_once("..").ok_or(form)?;
    let read = |text: &str| text.parse::<Depth>().map_err(|_| form.to_owned());
    Ok([read(first)?, read(last)?])
}

/// Most that a number can mean here, in whatever unit; its inverse is the least. Nothing computed of such is beyond floats.
const MOST: f64 = 1e12;

pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (1.0 / MOST..=MOST).contains(&v) => Ok(v),
        _ => Err("expected a positive number, 1e12 at most".into()),
    }
}

/// A power ratio.
pub fn decibels(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (-100.0..=1000.0).contains(&v) => Ok(v),
        _ => Err("expected decibels, -100 to 1000, such as 30".into()),
    }
}

/// Directions, degrees to the right and down.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets(pub Vec<[f64; 2]>);

pub fn targets(text: &str) -> Result<Targets, String> {
    let form = "x,y;x,y;... in degrees, such as 0,0;-8,0;8,0;0,6";
    let all: Result<Vec<[f64; 2]>, String> =
        text.split(';').map(|t| numbers::<2>(t.split(',').collect(), form)).collect();
    let all = all?;
    if all.iter().flatten().any(|v| !(-60.0..=60.0).contains(v)) {
        return Err("an eye turns 60 degrees at most".into());
    }
    if (4..=64).contains(&all.len()) { Ok(Targets(all)) } else { Err(format!("expected 4 to 64 targets: {form}")) }
}

/// What numbers of bare phases are.
pub fn phase_unit(text: &str) -> Result<PhaseUnit, String> {
    match text {
        "rad" => Ok(PhaseUnit::Radians),
        "turns" => Ok(PhaseUnit::Turns),
        "deg" => Ok(PhaseUnit::Degrees),
        levels => positive(levels)
            .map(PhaseUnit::Levels)
            .map_err(|_| "expected rad, turns, deg, or how many levels are a full turn, such as 256".into()),
    }
}

/// Hertz, or a fraction.
pub fn rate(text: &str) -> Result<Rate, String> {
    Rate::parse(text).map_err(|e| e.to_string())
}

/// The side of a mark.
pub fn mark(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n <= 65536).ok_or_else(|| "expected pixels, 0 to 65536".into())
}

/// A share, both ends included.
pub fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (0.0..=1.0).contains(&v) => Ok(v),
        _ => Err("expected a number from 0 to 1".into()),
    }
}

pub fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (0.0..=MOST).contains(&v) => Ok(v),
        _ => Err("expected a number, 0 to 1e12".into()),
    }
}

/// Parts of what an SLM shows, separated by commas.
pub fn as_shown(text: &str) -> Result<AsShown, String> {
    let mut left = AsShown::default();
    match text.split(',').find(|part| !left.leave(part.trim())) {
        None => Ok(left),
        Some(wrong) => Err(format!("'{wrong}' is nothing to leave: there are {} and all", AsShown::PARTS.join(", "))),
    }
}

/// Names on the command line, what each means for people, and what it is.
pub type Names<T, const N: usize> = [(&'static str, &'static str, T); N];

/// One of a few names.
pub fn one_of<T: Copy + Send + Sync, const N: usize>(names: &'static Names<T, N>) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(names.iter().map(|(name, about, _)| PossibleValue::new(*name).help(*about)))
        .map(|given| names.iter().find(|(name, ..)| *name == given).expect("one of the possible values").2)
}

/// Where an eye looks, radians, given in degrees.
pub fn gaze(text: &str) -> Result<[f64; 2], String> {
    let degrees = numbers::<2>(text.split(',').collect(), "X,Y in degrees, such as 3,-1.5")?;
    Ok(degrees.map(f64::to_radians))
}

/// A method by its name.
pub fn method(text: &str) -> Result<Method, String> {
    let names = || Method::ALL.map(Method::name).join(", ");
    Method::by_name(text).ok_or_else(|| format!("no method is called so: there are {}", names()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_in_human_units() {
        assert_eq!(diameters("3..3.5"), Ok([3e-3, 3.5e-3]));
        assert_eq!(depths("3..-3"), Ok([Depth::Metres(3e-3), Depth::Metres(-3e-3)]));
        assert_eq!(depths("-0.5D..2D"), Ok([Depth::Dioptres(-0.5), Depth::Dioptres(2.0)]));
        assert!(depths("3..x").is_err() && depths("3").is_err());
        assert_eq!(size("45x64"), Ok([45, 64]));
        let read = |text| pupil(text).unwrap().before(0.4).to_mm().map(|v| v.round());
        assert_eq!(read("2,-1,6,3"), [2.0, -1.0, 6.0, 3.0]);
        assert_eq!(read("2,-1,6,0.5D"), [2.0, -1.0, 6.0, 80.0]);
        for bad in ["", "1,2,3", "1,2,3,4,5", "a,b,c,d", "0,0,0,0", "0,0,-1,0", "nan,0,1,0", "0,0,inf,0"] {
            assert!(pupil(bad).is_err(), "{bad}");
        }
        for bad in ["0x8", "8", "x", "8x", "-1x4", "99999999x4"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert_eq!(prescription("-2.00 -0.50 x 30"), Ok(Prescription::new(-2.0, -0.5, 30.0)));
        assert_eq!(prescription("+1.25"), Ok(Prescription::new(1.25, 0.0, 0.0)));
        assert!(prescription("none").unwrap().is_perfect());
        for bad in ["", "-2 -0.5", "-2 -0.5 30 12", "-2D", "nan", "-2 -0.5 200", "90"] {
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
