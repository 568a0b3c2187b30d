//! Defines switchable sources, each of which moves the SLM's eyebox to another place (OPTICS 12).
//!
//! Each source lights the SLM from its own angle. The display's eyebox grows with the number of sources.

use super::units::within;
use super::{Color, SourceMode};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A switchable source in a display file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SwitchedSource {
    /// Direction of its light on the SLM in milliradians (x, y). The default is on the axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_mrad: Option<[f64; 2]>,
    /// The same direction as the middle of its eyebox, in millimeters (x, y).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eyebox_mm: Option<[f64; 2]>,
    /// Colors of the source. The default is all colors.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub colors: Vec<Color>,
    /// Power of the source relative to a source of power 1. The default is 1.
    #[serde(skip_serializing_if = "is_one")]
    pub power: f64,
    /// Time in microseconds to switch it on or off. The default is 0.
    #[serde(skip_serializing_if = "super::is_default")]
    pub switching_us: f64,
    /// Numbers of the sources, from 1, that may be lit together with it. The default is all sources.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub with: Option<Vec<usize>>,
}

/// The choice of lit sources.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SourcesLit {
    /// The sources take turns over the sub-frames, in their order. A pupil sees the sub-frames of the source whose
    /// eyebox holds it.
    #[default]
    InTurn,
    /// All sources are lit in every sub-frame.
    Together,
    /// The source in the middle is lit until a tracker reports the pupil. Then the source whose eyebox holds the pupil
    /// is lit, or several near a border.
    Steered,
    /// These sources of each color are lit, by their numbers from 1.
    Only(BTreeMap<Color, Vec<usize>>),
}

/// The switchable sources of a display, and the choice of lit ones.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sources {
    /// The sources. The list is empty for a single source on the axis.
    pub each: Vec<SwitchedSource>,
    /// The choice of lit sources.
    pub lit: SourcesLit,
    /// Duration of a sub-frame in microseconds, if a source takes time to switch. It is not in display files, because
    /// it follows from their rate and packing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sub_frame_us: Option<f64>,
}

/// The most sources that a display may have.
const MOST: usize = 64;
/// The largest direction sine of a source along an axis (30 degrees), in thousandths.
const STEEPEST_MRAD: f64 = 500.0;

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_one(power: &f64) -> bool {
    *power == 1.0
}

impl Default for SwitchedSource {
    fn default() -> Self {
        Self { angle_mrad: None, eyebox_mm: None, colors: Vec::new(), power: 1.0, switching_us: 0.0, with: None }
    }
}

impl SwitchedSource {
    /// Direction sines of the source's light on the SLM, (x, y).
    pub fn angle(&self, focal_length: f64) -> [f64; 2] {
        let image = |place: [f64; 2]| place.map(|mm| mm * 1e-3 / focal_length);
        self.angle_mrad.map(|angle| angle.map(|mrad| mrad * 1e-3)).or(self.eyebox_mm.map(image)).unwrap_or_default()
    }

    /// The middle of the source's eyebox, (x, y), in meters.
    pub(super) fn eyebox(&self, focal_length: f64) -> [f64; 2] {
        self.angle(focal_length).map(|t| focal_length * t)
    }

    fn has(&self, color: Color) -> bool {
        self.power > 0.0 && (self.colors.is_empty() || self.colors.contains(&color))
    }
}

impl Sources {
    /// True if there are no sources, also for `skip_serializing_if`.
    pub fn is_empty(&self) -> bool {
        self.each.is_empty()
    }

    /// Number of sources that take turns over the sub-frames in a color. It is 1 if none take turns.
    pub fn turns(&self, color: Color) -> usize {
        if self.lit == SourcesLit::InTurn { self.of(color).len().max(1) } else { 1 }
    }

    /// The sources with light of a color, by their places.
    pub fn of(&self, color: Color) -> Vec<usize> {
        (0..self.each.len()).filter(|at| self.each[*at].has(color)).collect()
    }

    /// The sources that are lit in a color, now or in their turn, by their places.
    pub fn lit(&self, color: Color, focal_length: f64) -> Vec<usize> {
        let all = self.of(color);
        match &self.lit {
            SourcesLit::InTurn | SourcesLit::Together => all,
            SourcesLit::Steered => {
                let off = |at: &usize| self.each[*at].angle(focal_length).iter().map(|t| t * t).sum::<f64>();
                all.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).into_iter().collect()
            }
            SourcesLit::Only(chosen) => {
                let chosen = chosen.get(&color).map_or(&[][..], Vec::as_slice);
                all.into_iter().filter(|at| chosen.contains(&(at + 1))).collect()
            }
        }
    }

    /// Lights only these sources in a color, by their places. An empty list changes nothing.
    pub fn light_only(&mut self, color: Color, sources: &[usize]) {
        if sources.is_empty() {
            return;
        }
        if !matches!(self.lit, SourcesLit::Only(_)) {
            self.lit = SourcesLit::Only(BTreeMap::new());
        }
        if let SourcesLit::Only(chosen) = &mut self.lit {
            chosen.insert(color, sources.iter().map(|at| at + 1).collect());
        }
    }

    /// True if two sources, by their places, may be lit at once.
    pub fn may_meet(&self, a: usize, b: usize) -> bool {
        let allows = |of: usize, other: usize| self.each[of].with.as_ref().is_none_or(|w| w.contains(&(other + 1)));
        a == b || (allows(a, b) && allows(b, a))
    }

    /// The modes of all sources in a color. Each source has the modes `within` it (around the axis, with weights that
    /// add up to 1), less the light of its switching time. Modes of unlit sources have no [turn](SourceMode::turn).
    pub(super) fn modes(&self, color: Color, focal_length: f64, within: &[SourceMode]) -> Vec<SourceMode> {
        let lit = self.lit(color, focal_length);
        let in_turn = self.lit == SourcesLit::InTurn;
        let shares = self.lit_shares(color, focal_length);
        let of_source = |at: usize| {
            let source = &self.each[at];
            let tilt = source.angle(focal_length);
            let place = lit.iter().position(|l| *l == at);
            let turn = match place {
                Some(place) if in_turn => [place, lit.len()],
                Some(_) => SourceMode::ALWAYS,
                None => SourceMode::NEVER,
            };
            let share = place.map_or(1.0, |place| shares[place]);
            within.iter().map(move |mode| SourceMode {
                angle: [mode.angle[0] + tilt[0], mode.angle[1] + tilt[1]],
                weight: mode.weight * source.power * share,
                source: at,
                turn,
                ..*mode
            })
        };
        self.of(color).into_iter().flat_map(of_source).collect()
    }

    /// The power of each source in each sub-frame of a color while it is on, (source, sub-frame). The unit is a source
    /// of power 1 that is always lit.
    pub fn powers(&self, color: Color, frames: usize, focal_length: f64) -> Vec<Vec<f64>> {
        let at_once = Self { sub_frame_us: None, ..self.clone() };
        // The powers do not depend on the wavelength.
        let modes = at_once.modes(color, focal_length, &[SourceMode::centred(1.0)]);
        let mut powers = vec![vec![0.0; frames]; self.each.len()];
        for mode in &modes {
            powers[mode.source] = (0..frames).map(|frame| mode.weight * mode.power(frame, frames)).collect();
        }
        powers
    }

    /// Checks the sources on a display of these colors.
    pub(super) fn check(&self, colors: &[Color], focal_length: f64) -> Result<(), Reason> {
        if self.each.is_empty() {
            let unlit = "sources_lit needs switchable sources, but there are none: give [[sources]]";
            let is_stated = self.lit != SourcesLit::InTurn;
            return if is_stated { Err(Reason::new("lit-without-sources", unlit)) } else { Ok(()) };
        }
        if self.each.len() > MOST {
            return Err(reason!("sources-count", "{} sources: give at most {MOST}", self.each.len()));
        }
        for (i, source) in self.each.iter().enumerate() {
            self.check_one(i, colors, focal_length)
                .map_err(|reason| reason.within(format!("[[sources]] {}", i + 1)))?;
            let alike = |other: &&SwitchedSource| {
                let shared = colors.iter().any(|color| source.has(*color) && other.has(*color));
                shared && source.angle(focal_length) == other.angle(focal_length)
            };
            if let Some(j) = self.each[..i].iter().position(|other| alike(&other)) {
                return Err(reason!(
                    "sources-same-place",
                    "[[sources]] {}: it is at the same place as source {}",
                    i + 1,
                    j + 1
                ));
            }
        }
        if let Some(dark) = colors.iter().find(|color| self.of(**color).is_empty()) {
            return Err(reason!(
                "sources-without-color",
                "[[sources]]: none has {dark} light, but one of that color must have a power above 0"
            ));
        }
        let together = |color: &Color| {
            let lit = self.lit(*color, focal_length);
            let pairs = lit.iter().flat_map(|a| lit.iter().map(move |b| [*a, *b]));
            pairs.filter(|[a, b]| !self.may_meet(*a, *b)).map(|pair| pair.map(|at| at + 1)).next()
        };
        if let SourcesLit::Only(chosen) = &self.lit {
            let known = |number: &usize| (1..=self.each.len()).contains(number);
            if let Some(other) = chosen.values().flatten().find(|number| !known(number)) {
                return Err(reason!("lit-source", "sources_lit names source {other}: there are {}", self.each.len()));
            }
            if let Some(dark) = colors.iter().find(|color| self.lit(**color, focal_length).is_empty()) {
                return Err(reason!(
                    "lit-color",
                    "sources_lit lights no source of {dark}: it must name one that has that color"
                ));
            }
        }
        match colors.iter().filter(|_| self.lit != SourcesLit::InTurn).find_map(together) {
            Some([a, b]) => Err(reason!(
                "lit-together",
                "sources_lit lights {a} and {b} together, which their `with` does not allow"
            )),
            None => self.check_times(colors, focal_length),
        }
    }

    fn check_one(&self, at: usize, colors: &[Color], focal_length: f64) -> Result<(), Reason> {
        let SwitchedSource { angle_mrad, eyebox_mm, power, switching_us, with, .. } = &self.each[at];
        if angle_mrad.is_some() && eyebox_mm.is_some() {
            return Err(reason!(
                "source-place-twice",
                "angle_mrad and eyebox_mm both give the place of a source: leave out one of them"
            ));
        }
        within("power", *power, 0.0, 1e6)?;
        within("switching_us", *switching_us, 0.0, 1e6)?;
        for value in angle_mrad.iter().chain(eyebox_mm).flatten() {
            within(if angle_mrad.is_some() { "angle_mrad" } else { "eyebox_mm" }, *value, -1e6, 1e6)?;
        }
        let angle = self.each[at].angle(focal_length).map(|t| t * 1e3);
        if let Some(beyond) = angle.into_iter().find(|mrad| mrad.abs() > STEEPEST_MRAD) {
            return Err(reason!(
                "source-angle",
                "an angle of {beyond:.1} mrad is beyond what lights an SLM, {STEEPEST_MRAD:.0} mrad (30 degrees)"
            ));
        }
        if let Some(other) = self.each[at].colors.iter().find(|color| !colors.contains(color)) {
            return Err(reason!("no-such-color", "wavelengths_nm has no {other}"));
        }
        let count = self.each.len();
        match with.iter().flatten().find(|number| !(1..=count).contains(*number)) {
            Some(number) => Err(reason!("source-number", "with names source {number}: there are {count}")),
            None => Ok(()),
        }
    }
}
