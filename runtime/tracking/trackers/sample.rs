//! Defines samples with a steady time, which every source gives.

use serde::{Deserialize, Serialize};

/// The unit of a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Unit {
    /// A length in meters.
    Metres,
    /// An angle in radians.
    Radians,
    /// Shares of a picture's width and height, 0 to 1.
    Normalized,
    /// Counts of the device, of unknown size. They need a calibration.
    Counts,
}

impl Unit {
    /// Returns the factor from the unit in files ([`UnitText`]) to this unit.
    pub(crate) fn of_stated(self) -> f64 {
        match self {
            Self::Metres => 1e-3,
            Self::Radians => 1f64.to_radians(),
            Self::Normalized | Self::Counts => 1.0,
        }
    }
}

/// The unit of positions in files.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Unit", rename_all = "lowercase")]
pub(crate) enum UnitText {
    #[serde(rename = "mm")]
    Metres,
    #[serde(rename = "deg")]
    Radians,
    Normalized,
    Counts,
}

/// The quantity of a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Quantity {
    /// The place of the eye or of its pupil.
    #[default]
    Pupil,
    /// The gaze point on a screen, or the direction of the gaze.
    Gaze,
}

/// One measured position of an eye.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reading {
    /// The quantity of the position.
    pub quantity: Quantity,
    /// The unit of the position.
    pub unit: Unit,
    /// Coordinates along x and y of the tracker. They are finite if `valid` is true.
    pub position: [f64; 2],
    /// Coordinate along z, from sources that have it.
    pub distance: Option<f64>,
    /// Velocity along x and y, in the unit per second, from sources that report it. It is finite if it exists.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[f64; 2]>,
    /// Diameter of the pupil, meters.
    pub diameter: Option<f64>,
    /// True if the source marks the reading as valid, it is in range and it is finite.
    pub valid: bool,
    /// Confidence from 0 to 1. It is 1 from sources without a confidence.
    pub confidence: f64,
}

impl Reading {
    /// Creates a valid reading with full confidence.
    pub fn new(quantity: Quantity, unit: Unit, position: [f64; 2]) -> Self {
        let (distance, velocity, diameter) = (None, None, None);
        Self { quantity, unit, position, distance, velocity, diameter, valid: true, confidence: 1.0 }.checked()
    }

    /// The reading, marked invalid if a number is not finite or the confidence is out of range. An impossible diameter
    /// or velocity is dropped.
    #[must_use]
    pub fn checked(mut self) -> Self {
        self.valid &= self.position.iter().all(|p| p.is_finite()) && self.distance.is_none_or(f64::is_finite);
        if !(0.0..=1.0).contains(&self.confidence) {
            self.confidence = 0.0;
            self.valid = false;
        }
        self.diameter = self.diameter.filter(|d| d.is_finite() && *d > 0.0);
        self.velocity = self.velocity.filter(|v| self.valid && v.iter().all(|v| v.is_finite()));
        if !self.valid {
            // No later stage may compute with a NaN.
            self.position = self.position.map(|p| if p.is_finite() { p } else { 0.0 });
            self.distance = self.distance.filter(|d| d.is_finite());
        }
        self
    }
}

/// The data of a tracker at one time. Readings that the source does not have are absent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sample {
    /// Time at which the eye was as in the sample, nanoseconds of the [steady clock](super::now_ns), minus the source's
    /// latency.
    pub time_ns: u64,
    /// Arrival of the sample on the same clock, nanoseconds.
    pub received_ns: u64,
    /// The tracker's own time, nanoseconds of a clock of its own, which may begin anywhere.
    pub tracker_ns: Option<i64>,
    /// Reading of the left eye.
    pub left: Option<Reading>,
    /// Reading of the right eye.
    pub right: Option<Reading>,
    /// Reading of both eyes, or of one eye without a name.
    pub combined: Option<Reading>,
    /// Focus of the eyes, dioptres (1 / meters), from sources that measure it.
    pub focus_dioptres: Option<f64>,
}

impl Sample {
    /// A sample without readings, whose time is its arrival.
    pub fn empty(received_ns: u64) -> Self {
        let (tracker_ns, left, right, combined, focus_dioptres) = (None, None, None, None, None);
        Self { time_ns: received_ns, received_ns, tracker_ns, left, right, combined, focus_dioptres }
    }

    /// The existing readings of left, right and combined, with their names.
    pub fn readings(&self) -> impl Iterator<Item = (&'static str, &Reading)> {
        [("left", &self.left), ("right", &self.right), ("combined", &self.combined)]
            .into_iter()
            .filter_map(|(name, reading)| Some((name, reading.as_ref()?)))
    }

    /// True if any reading is valid.
    pub fn valid(&self) -> bool {
        self.readings().any(|(_, r)| r.valid)
    }
}

impl std::fmt::Display for Reading {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.valid {
            return f.write_str("invalid");
        }
        let (scale, unit) = match self.unit {
            Unit::Metres => (1e3, " mm"),
            Unit::Radians => (1f64.to_degrees(), " deg"),
            Unit::Normalized => (1.0, ""),
            Unit::Counts => (1.0, " counts"),
        };
        let [x, y] = self.position.map(|p| p * scale);
        write!(f, "({x:.3}, {y:.3}")?;
        if let Some(z) = self.distance {
            write!(f, ", {:.3}", z * scale)?;
        }
        write!(f, "){unit}")?;
        if let Some([x, y]) = self.velocity.map(|v| v.map(|v| v * scale)) {
            write!(f, " moving ({x:.3}, {y:.3}){unit}/s")?;
        }
        if let Some(d) = self.diameter {
            write!(f, " pupil {:.2} mm", d * 1e3)?;
        }
        if self.confidence < 1.0 {
            write!(f, " confidence {:.2}", self.confidence)?;
        }
        Ok(())
    }
}

impl std::fmt::Display for Sample {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.6} s", self.time_ns as f64 * 1e-9)?;
        if let Some(t) = self.tracker_ns {
            write!(f, " (tracker {:.6} s)", t as f64 * 1e-9)?;
        }
        for (name, reading) in self.readings() {
            write!(f, "  {name} {reading}")?;
        }
        if self.readings().next().is_none() {
            f.write_str("  nothing")?;
        }
        if let Some(focus) = self.focus_dioptres {
            write!(f, "  focus {focus:.2} D")?;
        }
        Ok(())
    }
}
