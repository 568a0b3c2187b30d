//! Measures the effect of an etendue-expanding phase mask on the quality (OPTICS 12).
//!
//! The mask widens the eyebox, but the number of phases that serve it stays the same. Each hologram is solved for its
//! mask.

use super::picture;
use super::pupils::Pupils;
use super::results::EtendueFigures;
use super::speckle::{self, plane, seen_of};
use eyebox::low_level::engine::Engine;
use eyebox::low_level::error::Reason;
use eyebox::low_level::evaluate::{self, Group, Summary};
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::{Color, Display, Mask, Padding, Pupil};
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::SceneSource;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{self, Flow, Problem, Settings};
use std::fmt;
use std::str::FromStr;

/// The approximate time that one mask takes, in units of a solve.
pub(super) const EFFORT: f64 = 12.0;
/// The number of holograms of an even plane whose contrast is averaged.
const REPEATS: usize = 2;
/// The seed of the phases of all masks.
const SEED: u64 = 1;
/// The share of the mask's own eyebox, along an axis, that a designed mask lights.
const BAND: f64 = 0.5;

/// A phase mask that is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct MaskKind {
    /// Mask pixels per SLM pixel along an axis, or 1 for no mask.
    pub factor: usize,
    /// True for a mask that sends its light evenly into half of its own eyebox along an axis. Other masks have random
    /// phases.
    pub designed: bool,
}

impl FromStr for MaskKind {
    type Err = Reason;

    /// Reads a factor, followed by `d` for a designed mask.
    fn from_str(text: &str) -> Result<Self, Reason> {
        let (factor, designed) = text.strip_suffix('d').map_or((text, false), |factor| (factor, true));
        match factor.parse() {
            Ok(factor) if (1..=4).contains(&factor) && !(designed && factor == 1) => Ok(Self { factor, designed }),
            _ => Err(reason!("etendue", "expected 1 for no mask, 2 to 4, or 2d to 4d for a designed mask")),
        }
    }
}

impl fmt::Display for MaskKind {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self { factor: 1, .. } => write!(out, "no mask"),
            Self { factor, designed: true } => write!(out, "a designed mask of {factor} x {factor}"),
            Self { factor, .. } => write!(out, "a random mask of {factor} x {factor}"),
        }
    }
}

impl MaskKind {
    /// Returns the display behind this mask, which replaces the display's own mask.
    ///
    /// # Errors
    /// Returns the property of the display that does not fit the mask.
    pub fn before(&self, display: &Display) -> Result<Display, Reason> {
        let band = self.designed.then_some(BAND);
        display.with_mask((self.factor > 1).then(|| Mask::of_seed(self.factor, SEED, band)))
    }
}

/// A scene on a display, in one color, for which masks are compared.
pub(super) struct Masks<'a> {
    pub field: &'a LightField,
    pub display: &'a Display,
    pub color: Color,
    pub settings: &'a Settings,
    /// The longest side of a picture, in pixels.
    pub longest: usize,
}

impl Masks<'_> {
    /// Measures one mask. Returns `None` once `went` returns false. It is called within each solve.
    pub fn measure(
        &self,
        kind: MaskKind,
        engine: &mut dyn Engine,
        went: &mut dyn FnMut() -> bool,
    ) -> Result<Option<EtendueFigures>, QualityError> {
        let refused = |reason| QualityError::Input { what: kind.to_string(), reason };
        let display = kind.before(self.display).map_err(refused)?;
        let plain = MaskKind { factor: 1, designed: false }.before(self.display).map_err(refused)?;
        let (eyebox, settings) = (display.eyebox_min(), self.settings_of(&display, plain.eyebox_min()));
        let mut stopped = false;
        let mut observe = |_: &solve::Progress| {
            stopped |= !went();
            if stopped { Flow::Stop } else { Flow::Continue }
        };
        let problem = Problem::new(self.field, self.color, &display, Padding::default())?;
        let solution = solve::solve(&problem, &settings, engine, &mut observe)?;
        let hologram =
            Hologram::from_solutions(self.field, &display, &settings, Padding::default(), &[(self.color, solution)])?;
        let members = Pupils::new(eyebox, settings.diameter, settings.depth, 0).members;
        let pupils: Vec<Pupil> = members.iter().filter(|m| m.group == Group::Random).map(|m| m.pupil).collect();
        let scored = hologram.score(&SceneSource::from(vec![problem]), &pupils, engine)?;
        let scores: Vec<f64> = scored.pupils.iter().filter_map(|pupil| pupil.psnr).collect();
        let summary = Summary::of(&scores);
        let [low, high] = settings.diameter;
        let eye = Pupil { x: 0.0, y: 0.0, diameter: (low * high).sqrt(), depth: 0.0 };
        let contrast = self.contrast(&display, &settings, &eye, engine, &mut observe)?;
        if stopped {
            return Ok(None);
        }
        let seen = hologram.look(&eye, engine)?.remove(0);
        let shown: Vec<f32> = seen.values.iter().map(|v| v * scored.exposures[0] as f32).collect();
        let (height, width) = display.picture_size();
        let psnr = summary.map(|s| s.mean);
        Ok(Some(EtendueFigures {
            scene: self.field.name.clone(),
            frames: settings.frames,
            color: self.color,
            mask: kind.to_string(),
            factor: kind.factor,
            designed: kind.designed,
            eyebox_mm: eyebox * 1e3,
            etendue_mm2_sr: display.reach().etendue_mm2_sr,
            mean_db: summary.map(|s| s.mean),
            worst_db: summary.map(|s| s.worst),
            contrast,
            eye_mm: eye.diameter * 1e3,
            picture: Some(picture::light(&[(self.color, &shown)], height, width, self.longest, psnr)),
        }))
    }

    /// Returns the settings behind a mask, with the same pupils as without a mask. Views without a stated pitch stretch
    /// over the eyebox. Their content then has the same disparity from edge to edge, and its depths are smaller by the
    /// growth of the eyebox.
    fn settings_of(&self, display: &Display, plain: f64) -> Settings {
        let shallower =
            if self.field.view_pitch.is_some() { 1.0 } else { self.display.eyebox_min() / display.eyebox_min() };
        Settings {
            diameter: self.settings.diameter.map(|d| d.min(plain)),
            depth: self.settings.depth.map(|z| z * shallower),
            ..self.settings.clone()
        }
    }

    /// Returns the speckle contrast of an even plane, which is only as large as the contrast needs.
    fn contrast(
        &self,
        display: &Display,
        settings: &Settings,
        eye: &Pupil,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&solve::Progress) -> Flow,
    ) -> Result<f64, QualityError> {
        let side = speckle::SIDE.min(display.height).min(display.width);
        let small = Display { height: side, width: side, prescription: None, ..display.clone() };
        let problem = Problem::new(&plane(side, self.color, self.field.grid), self.color, &small, Padding::default())?;
        let problems = [problem.clone(), problem];
        let mut sum = 0.0;
        for i in 0..REPEATS {
            let seed = settings.seed.wrapping_add(1 + i as u64);
            let efficiency = Some(speckle::EFFICIENCY);
            let settings = Settings { depth: [0.0; 2], seed, efficiency, ..settings.clone() };
            let image = seen_of(&problems, &settings, &[*eye], engine, observe)?.remove(0);
            sum += evaluate::contrast(&image) / REPEATS as f64;
        }
        Ok(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::low_level::engine::cpu::CpuEngine;
    use eyebox::low_level::scene::{self, Request};

    #[test]
    fn kinds_are_read() {
        let read = |text: &str| text.parse::<MaskKind>().ok().map(|kind| (kind.factor, kind.designed));
        assert_eq!(["1", "4", "2d"].map(read), [Some((1, false)), Some((4, false)), Some((2, true))]);
        assert_eq!(["0", "5", "1d", "d", "", "-2"].map(read), [None; 6]);
    }

    /// The eyebox grows with the factor and the etendue with its square, at a cost in quality. A mask of the display
    /// itself is replaced.
    #[test]
    fn a_larger_eyebox_costs_quality() {
        let display = Display { height: 48, width: 48, ..Display::preset("small").unwrap() };
        let request = Request { views: 3, ..Request::new(&display, &[Color::Green]) };
        let field = scene::load("builtin:still-life", &request).unwrap();
        let depth = [-1e-4, 1e-4];
        let (frames, steps, pupils) = (8, 20, 6);
        let settings = Settings { frames, steps, pupils, diameter: [3.5e-3, 4.5e-3], depth, ..Settings::default() };
        let (color, settings) = (Color::Green, &settings);
        let measure = |display: &Display, text: &str| {
            let masks = Masks { field: &field, display, color, settings, longest: 48 };
            masks.measure(text.parse().unwrap(), &mut CpuEngine::new(), &mut || true).unwrap().unwrap()
        };
        let (none, three) = (measure(&display, "1"), measure(&display, "3"));
        assert!((three.eyebox_mm / none.eyebox_mm - 3.0).abs() < 1e-9);
        assert!((three.etendue_mm2_sr / none.etendue_mm2_sr - 9.0).abs() < 1e-6);
        // The same number of phases serves nine times as many pupils. Eight sub-frames then cannot avoid as much of
        // their speckle.
        let [three_db, none_db] = [three.mean_db, none.mean_db].map(Option::unwrap);
        assert!(three_db < none_db - 0.5, "{none_db} {three_db}");
        let own = measure(&MaskKind { factor: 2, designed: false }.before(&display).unwrap(), "1");
        assert!((own.eyebox_mm - none.eyebox_mm).abs() < 1e-9);
    }
}
