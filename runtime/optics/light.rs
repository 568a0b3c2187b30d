//! A display's light: the modes of its source, color by color, and how few of them do (OPTICS 12).

use super::quadrature::MOST;
use super::source::{LINES, SourceMode, SourceShape, SourceTerms};
use super::{Color, Display, Geometry, ModelOf};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::Serialize;
use std::f64::consts::PI;

/// The contrast of speckle may be off by so much of itself, for as few samples as a scene requires.
pub(super) const EXACT: f64 = 0.03;

/// How many samples stand for a source, and what they make of speckle through a pupil.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SourceSampling {
    /// Points along an axis of its size, and wavelengths of its line.
    pub samples: [usize; 2],
    /// Modes in all.
    pub modes: usize,
    /// Contrast of fully developed speckle in one sub-frame through the pupil, with these samples,
    pub contrast: f64,
    /// with one more along each axis,
    pub one_more: f64,
    /// and with the most that there are.
    pub limit: f64,
}

impl Display {
    /// The terms of its source at a color; none where nothing is said of it.
    fn source_terms(&self, color: Color) -> Option<SourceTerms> {
        let (own, all) = (self.source.get(&color.into()), self.source.get(&ModelOf::All));
        match (own, all) {
            (Some(own), Some(all)) => Some(own.or(all)),
            (own, all) => own.or(all).cloned(),
        }
    }

    /// The modes of one of its colors' light, whose weights add up to 1 for each switchable source of power 1, of sources that are
    /// lit and of those that are not; none for a laser on the axis, or a color that it does not have.
    pub fn modes(&self, color: Color) -> Vec<SourceMode> {
        let Ok(optics) = self.optics(color) else { return Vec::new() };
        let centred = || vec![SourceMode::centred(optics.wavelength)];
        let modes = self.source_terms(color).map_or_else(centred, |t| t.modes(optics.wavelength, optics.focal_length));
        let modes = match self.sources.is_empty() {
            true => modes,
            false => self.sources.modes(color, self.focal_length, &modes),
        };
        match modes[..] {
            // Whichever source it is of, there is no other.
            [one] if SourceMode { source: 0, ..one } == SourceMode::centred(optics.wavelength) => Vec::new(),
            _ => modes,
        }
    }

    /// What is wrong with its source, in words.
    pub(super) fn check_source(&self) -> Result<(), Reason> {
        if !self.sources.is_empty() && self.geometry == Geometry::FarField {
            return Err(reason!(
                "sources-without-relay",
                "[[sources]]: they are for an SLM behind a relay: leave them out"
            ));
        }
        let all: Vec<Color> = self.wavelengths.iter().map(|w| w.color).collect();
        self.sources.check(&all, self.focal_length)?;
        for (of, own) in &self.source {
            let is_its = |color: &&Color| *of == ModelOf::All || ModelOf::from(**color) == *of;
            let mut colors = all.iter().filter(is_its).peekable();
            let wrong = |reason: Reason| reason.within(format!("[source.{}]", of.name()));
            if colors.peek().is_none() {
                return Err(wrong(reason!("no-such-color", "wavelengths_nm has no such color")));
            }
            if self.geometry == Geometry::FarField {
                return Err(wrong(reason!(
                    "source-without-relay",
                    "a source is for an SLM behind a relay: leave it out"
                )));
            }
            for color in colors {
                let optics = self.optics(*color).map_err(|e| e.to_string())?;
                let terms = self.source_terms(*color).unwrap_or_default();
                own.check(&optics).and_then(|()| terms.check(&optics)).map_err(wrong)?;
            }
        }
        Ok(())
    }

    /// The fewest samples of one of its colors' source that do for pupils from this diameter on anywhere in the eyebox, and
    /// content up to this far from the eye's focus (meters): the contrast of speckle is right to 3 %, and neighboring points
    /// part no content by more than a pixel. What its file gives is taken. None where there is nothing to sample.
    pub fn source_sampling(&self, color: Color, diameter: f64, depth: f64) -> Option<SourceSampling> {
        let terms = self.source_terms(color).filter(|terms| terms.modes.is_empty())?;
        let optics = self.optics(color).ok()?;
        let (angle, line) = (terms.angle(optics.focal_length), terms.line());
        if angle <= 0.0 && line <= 0.0 {
            return None;
        }
        let most = if terms.shape.unwrap_or_default() == SourceShape::Disc { 4 } else { MOST };
        let modes = |samples: usize, lines: usize| {
            let sampled = SourceTerms { samples: Some(samples), lines: Some(lines), ..terms.clone() };
            sampled.modes(optics.wavelength, optics.focal_length)
        };
        let contrast = |samples: usize, lines: usize| {
            speckle_contrast(&modes(samples, lines), diameter, self.eyebox_min() / 2.0, optics.focal_length)
        };
        let most_lines = terms.lines.unwrap_or(LINES);
        let limit = contrast(most, most_lines);
        let parts = |samples: usize| depth * angle / samples as f64 / self.picture_pixel();
        let does = |samples: usize, lines: usize| {
            (contrast(samples, lines) / limit - 1.0).abs() <= EXACT && parts(samples) <= 1.0
        };
        let fits = |given: Option<usize>, value: usize| given.is_none_or(|given| given == value);
        let all = (1..=most).flat_map(|samples| (1..=most_lines).map(move |lines| (samples, lines)));
        let all = all.filter(|(samples, lines)| fits(terms.samples, *samples) && fits(terms.lines, *lines));
        let mut all: Vec<_> = all.filter(|(s, l)| (angle > 0.0 || *s == 1) && (line > 0.0 || *l == 1)).collect();
        all.sort_by_key(|(samples, lines)| modes(*samples, *lines).len());
        let found = all.iter().find(|(samples, lines)| does(*samples, *lines)).or(all.last()).copied();
        let (samples, lines) = found.unwrap_or((terms.samples.unwrap_or(1).min(most), terms.lines.unwrap_or(1)));
        Some(SourceSampling {
            samples: [samples, lines],
            modes: modes(samples, lines).len(),
            contrast: contrast(samples, lines),
            one_more: contrast((samples + 1).min(most), if line > 0.0 { (lines + 1).min(most_lines) } else { 1 }),
            limit,
        })
    }

    /// The same display with so many samples of a color's source.
    #[must_use]
    pub fn with_source_samples(&self, color: Color, [samples, lines]: [usize; 2]) -> Self {
        let mut display = self.clone();
        if let Some(terms) = self.source_terms(color).filter(|terms| terms.modes.is_empty()) {
            let terms = SourceTerms { samples: Some(samples), lines: Some(lines), ..terms };
            display.source.insert(color.into(), terms);
        }
        display
    }
}

/// Where a mode's light is, meters: (x, y) of the eyebox, and how far it is moved at the eyebox's edge, `reach` from the axis, for its
/// wavelength is not the main one.
pub(super) fn place(mode: &SourceMode, main: f64, reach: f64, focal_length: f64) -> [f64; 3] {
    let [x, y] = mode.eyebox(focal_length);
    [x, y, reach * (mode.wavelength / main - 1.0)]
}

/// Contrast (standard deviation over mean) of fully developed speckle that these modes show through a pupil: the root of
/// `sum w_j w_k |mu_jk|^2`, `mu` what the discs of two modes have in common of a disc (Goodman 2007, chapter 4). A wavelength moves
/// the disc by its share of the place in the eyebox, of which the edge, `reach` from the axis, is taken.
pub(super) fn speckle_contrast(modes: &[SourceMode], diameter: f64, reach: f64, focal_length: f64) -> f64 {
    let main = modes.iter().map(|mode| mode.weight * mode.wavelength).sum::<f64>();
    let place = |mode: &SourceMode| place(mode, main, reach, focal_length);
    let squares = modes.iter().flat_map(|a| modes.iter().map(move |b| (a, b))).map(|(a, b)| {
        let ([x, y, z], [u, v, w]) = (place(a), place(b));
        let apart = ((x - u).hypot(y - v).hypot(z - w) / diameter).min(1.0);
        let common = 2.0 / PI * (apart.acos() - apart * (1.0 - apart * apart).sqrt());
        a.weight * b.weight * common * common
    });
    squares.sum::<f64>().sqrt()
}

#[cfg(test)]
#[path = "light_tests.rs"]
mod tests;
