//! What every source gives: samples with a steady time.

use serde::{Deserialize, Serialize};

/// What a position is measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Unit {
    /// Metres.
    Metres,
    /// Radians.
    Radians,
    /// Shares of a picture's width and height, 0 to 1.
    Normalized,
    /// Counts of the device, of unknown size: of use after a calibration only.
    Counts,
}

impl Unit {
    /// Returns how many of this unit make one of the unit in files ([`UnitText`]).
    pub(crate) fn of_stated(self) -> f64 {
        match self {
            Self::Metres => 1e-3,
            Self::Radians => 1f64.to_radians(),
            Self::Normalized | Self::Counts => 1.0,
        }
    }
}

/// How files state a unit.
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

/// What a position tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Quantity {
    /// Where the eye, or its pupil, is.
    #[default]
    Pupil,
    /// Where the eye looks: a point on a screen, or a direction.
    Gaze,
}

/// One measured position.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reading {
    /// What it tells.
    pub quantity: Quantity,
    /// What it is measured in.
    pub unit: Unit,
    /// Along x and y of the tracker. Finite whenever `valid`.
    pub position: [f64; 2],
    /// Along z, from sources that have it.
    pub distance: Option<f64>,
    /// How fast the position moves, along x and y, in its unit a second, from sources that tell. Finite where it is there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[f64; 2]>,
    /// Diameter of the pupil, metres.
    pub diameter: Option<f64>,
    /// Whether the source stands by it: in range, finite, flagged as seen.
    pub valid: bool,
    /// 0 to 1; 1 from sources that have no such thing.
    pub confidence: f64,
}

impl Reading {
    /// A valid reading with full confidence.
    pub fn new(quantity: Quantity, unit: Unit, position: [f64; 2]) -> Self {
        let (distance, velocity, diameter) = (None, None, None);
        Self { quantity, unit, position, distance, velocity, diameter, valid: true, confidence: 1.0 }.checked()
    }

    /// The same, invalid where a number is not finite or the confidence is none; an impossible diameter or velocity is dropped.
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
            // Nothing downstream may compute with what is not a number.
            self.position = self.position.map(|p| if p.is_finite() { p } else { 0.0 });
            self.distance = self.distance.filter(|d| d.is_finite());
        }
        self
    }
}

/// What a tracker said at one time. Absent readings are those that the source does not have.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sample {
    /// When the eye was as the sample says: nanoseconds of the [steady clock](super::now_ns), the source's latency
    /// taken off.
    pub time_ns: u64,
    /// When the sample arrived, on the same clock.
    pub received_ns: u64,
    /// The tracker's own time, nanoseconds of a clock of its own, which may begin anywhere.
    pub tracker_ns: Option<i64>,
    /// The left eye.
    pub left: Option<Reading>,
    /// The right eye.
    pub right: Option<Reading>,
    /// Of both eyes, or of one without a name.
    pub combined: Option<Reading>,
    /// What the eyes focus at, dioptres (1 / metres), from sources that measure it.
    pub focus_dioptres: Option<f64>,
}

impl Sample {
    /// A sample without readings, seen as it arrived.
    pub fn empty(received_ns: u64) -> Self {
        let (tracker_ns, left, right, combined, focus_dioptres) = (None, None, None, None, None);
        Self { time_ns: received_ns, received_ns, tracker_ns, left, right, combined, focus_dioptres }
    }

    /// Left, right, combined: those that there are.
    pub fn readings(&self) -> impl Iterator<Item = (&'static str, &Reading)> {
        [("left", &self.left), ("right", &self.right), ("combined", &self.combined)]
            .into_iter()
            .filter_map(|(name, reading)| Some((name, reading.as_ref()?)))
    }

    /// Whether any reading is valid.
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
