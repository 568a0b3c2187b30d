//! Defines objects that stop light in an eye's pupil, such as lashes or floaters (OPTICS 11).

use super::{Optics, OpticsError, Pupil};
use std::str::FromStr;

/// A set of opaque marks in an eye's pupil. It moves with the pupil.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Obstruction {
    /// Six lashes, 0.2 mm wide and 0.6 mm apart, that spread like a fan.
    Lashes,
    /// Twelve dots, 0.1 to 0.4 mm wide, within 4 mm.
    Floaters,
    /// An opacity of 1 mm over the pupil's center.
    Opacity,
    /// Eight scratches of a lens, 0.05 mm wide, in all directions.
    Scratches,
}

/// One opaque mark. Lengths are meters from the pupil's center.
enum Mark {
    /// A line without ends. It is `offset` away from the center, along its normal, which has this angle from +x, radians.
    Line { offset: f64, normal: f64, width: f64 },
    /// A disc with this center and diameter.
    Disc { center: [f64; 2], diameter: f64 },
}

/// The angle between neighboring seeds of a sunflower, radians. No two seeds are in one direction.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
/// Share of a pupil's light below which it counts as dark.
const DARK: f64 = 1e-12;

impl Obstruction {
    /// All kinds of obstructions.
    pub const ALL: [Self; 4] = [Self::Lashes, Self::Floaters, Self::Opacity, Self::Scratches];

    /// The name of the obstruction.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lashes => "lashes",
            Self::Floaters => "floaters",
            Self::Opacity => "opacity",
            Self::Scratches => "scratches",
        }
    }

    fn marks(self) -> Vec<Mark> {
        match self {
            Self::Lashes => {
                // The direction changes by 10 degrees for each millimeter from the middle.
                let lash = |i: i32| {
                    let offset = (f64::from(i) - 2.5) * 0.6e-3;
                    Mark::Line { offset, normal: offset * 1e3 * 10f64.to_radians(), width: 0.2e-3 }
                };
                (0..6).map(lash).collect()
            }
            Self::Floaters => {
                let dot = |i: i32| {
                    let (share, angle) = ((f64::from(i) + 0.5) / 12.0, f64::from(i) * GOLDEN_ANGLE);
                    let center = [angle.cos(), angle.sin()].map(|part| 2e-3 * share.sqrt() * part);
                    Mark::Disc { center, diameter: 0.1e-3 * f64::from(1 + i % 4) }
                };
                (0..12).map(dot).collect()
            }
            Self::Opacity => vec![Mark::Disc { center: [0.0; 2], diameter: 1e-3 }],
            Self::Scratches => {
                let scratch = |i: i32| {
                    let offset = (f64::from(i) - 3.5) * 0.45e-3;
                    Mark::Line { offset, normal: f64::from(i) * GOLDEN_ANGLE, width: 0.05e-3 }
                };
                (0..8).map(scratch).collect()
            }
        }
    }

    /// The amplitude that passes the eye's pupil, from 0 to 1, times one factor. Its argument is a place (x, y) of a
    /// bin in the pupil plane, in meters. The factor keeps the mean light of the pupil's bins the same as without the
    /// obstruction, because an eye adapts to less light. The factor is 1 if the obstruction leaves no light at all.
    pub fn amplitude(self, grid: &Optics, pupil: &Pupil) -> impl Fn([f64; 2]) -> f64 + use<> {
        let (marks, (bin_y, bin_x)) = (self.marks(), grid.bin_size());
        let (center, bin) = ([pupil.x, pupil.y], 0.5 * (bin_x + bin_y));
        let passing = move |[x, y]: [f64; 2]| {
            let at = [x - center[0], y - center[1]];
            marks.iter().map(|mark| 1.0 - mark.coverage(at, bin)).product::<f64>()
        };
        let radius = 0.5 * pupil.diameter;
        let bins = |s: f64, bin: f64| (((s - radius) / bin).ceil() as i64)..=(((s + radius) / bin).floor() as i64);
        let (mut light, mut count) = (0.0, 0u64);
        for y in bins(pupil.y, bin_y).map(|k| k as f64 * bin_y) {
            for x in bins(pupil.x, bin_x).map(|k| k as f64 * bin_x) {
                if (x - pupil.x).hypot(y - pupil.y) < radius {
                    light += passing([x, y]).powi(2);
                    count += 1;
                }
            }
        }
        // The remainder of covered bins after rounding is no light.
        let factor = if light > DARK * count as f64 { (count as f64 / light).sqrt() } else { 1.0 };
        move |at| factor * passing(at)
    }
}

impl FromStr for Obstruction {
    type Err = OpticsError;

    fn from_str(name: &str) -> Result<Self, OpticsError> {
        let found = Self::ALL.into_iter().find(|obstruction| obstruction.name() == name);
        found.ok_or_else(|| OpticsError::UnknownObstruction {
            name: name.into(),
            known: Self::ALL.map(Self::name).join(", "),
        })
    }
}

impl Mark {
    /// The share of a bin of this side (meters), at this place from the pupil's center, that the mark covers.
    fn coverage(&self, [x, y]: [f64; 2], bin: f64) -> f64 {
        // The overlap of an interval of the bin's size with the mark's interval, across the mark.
        let common = |distance: f64, width: f64| {
            let (low, high) = ((distance - bin / 2.0).max(-width / 2.0), (distance + bin / 2.0).min(width / 2.0));
            (high - low).max(0.0) / bin
        };
        match *self {
            Self::Line { offset, normal, width } => common(x * normal.cos() + y * normal.sin() - offset, width),
            Self::Disc { center, diameter } => {
                // A disc that is narrower than a bin covers it along both axes.
                let along = (diameter / bin).min(1.0);
                common((x - center[0]).hypot(y - center[1]), diameter) * along
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn optics(pixels: usize) -> Optics {
        Optics::new(pixels, pixels, 8e-6, 520e-9, 0.4).unwrap()
    }

    /// The share of a 4 mm pupil's light that each obstruction stops, against the areas of its marks in float64.
    #[test]
    fn marks_stop_the_light_of_their_area() {
        let pupil = Pupil::from_mm([1.0, -2.0, 4.0, 0.0]);
        let disc = 4.0 * std::f64::consts::PI;
        for (obstruction, area) in [(Obstruction::Opacity, 0.25 * std::f64::consts::PI), (Obstruction::Lashes, 4.07)] {
            // Bins that a mark covers in part lose more than their covered area. Therefore the bins are narrow here.
            let passing = obstruction.amplitude(&optics(4096), &pupil);
            // At a place without a mark, the amplitude is the factor alone.
            let factor = passing([1e-3 - 1.95e-3, -2e-3]);
            let open = 1.0 / (factor * factor);
            assert!((open - (1.0 - area / disc)).abs() < 0.01, "{obstruction:?}: {open}");
        }
    }

    #[test]
    fn an_opacity_is_where_the_pupil_is() {
        let pupil = Pupil::from_mm([3.0, 1.0, 4.0, 0.0]);
        let passing = Obstruction::Opacity.amplitude(&optics(512), &pupil);
        assert_eq!(passing([3e-3, 1e-3]), 0.0);
        assert!(passing([3.3e-3, 1.3e-3]).abs() < 1e-9);
        assert!(passing([3.6e-3, 1e-3]) > 1.0 && passing([0.0, 0.0]) > 1.0);
    }

    /// A pupil that is covered completely is dark. No factor makes light from nothing.
    #[test]
    fn a_covered_pupil_is_dark() {
        let pupil = Pupil::from_mm([0.0, 0.0, 0.5, 0.0]);
        let passing = Obstruction::Opacity.amplitude(&optics(512), &pupil);
        assert_eq!(passing([0.0, 0.0]), 0.0);
        // It is dark between the bins, too, although rounding leaves the covered share slightly below 1.
        let at = |i: i32| [f64::from(i % 40 - 20) * 1e-5, f64::from(i / 40 - 20) * 0.6e-5];
        let most = (0..1600).map(|i| passing(at(i)).abs()).fold(0.0, f64::max);
        assert!(most < 1e-12, "{most}");
    }

    #[test]
    fn each_is_found_by_its_name_and_no_mark_is_everything() {
        let unknown = "nose".parse::<Obstruction>().unwrap_err();
        let known = "lashes, floaters, opacity, scratches".into();
        assert_eq!(unknown, OpticsError::UnknownObstruction { name: "nose".into(), known });
        for obstruction in Obstruction::ALL {
            assert_eq!(obstruction.name().parse(), Ok(obstruction));
            let passing = obstruction.amplitude(&optics(512), &Pupil::from_mm([0.0, 0.0, 4.0, 0.0]));
            let at = |i: i32| [f64::from(i % 40 - 20) * 1e-4, f64::from(i / 40 - 20) * 1e-4];
            let places: Vec<f64> = (0..1600).map(|i| passing(at(i))).collect();
            assert!(places.iter().any(|a| *a > 1.0) && places.iter().all(|a| a.is_finite() && *a < 1.5));
            assert!(places.iter().any(|a| *a < 0.99), "{obstruction:?}");
        }
    }
}
