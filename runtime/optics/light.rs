//! Computes the modes of a display's source for each color, and how few modes are enough (OPTICS 12).

use super::quadrature::MOST;
use super::source::{LINES, SourceMode, SourceShape, SourceTerms};
use super::{Color, Display, Geometry, ModelOf};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::Serialize;
use std::f64::consts::PI;

/// Relative error of the speckle contrast that is allowed for the fewest samples of a scene.
pub(super) const EXACT: f64 = 0.03;

/// The samples of a source, and the speckle contrast that they give through a pupil.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SourceSampling {
    /// Points along an axis of the source's size, and wavelengths of its line.
    pub samples: [usize; 2],
    /// Number of modes in all.
    pub modes: usize,
    /// Contrast of fully developed speckle in one sub-frame through the pupil, with these samples.
    pub contrast: f64,
    /// The contrast with one more sample along each axis.
    pub one_more: f64,
    /// The contrast with the largest number of samples.
    pub limit: f64,
}

impl Display {
    /// The terms of the source at a color, or none if the file has none.
    fn source_terms(&self, color: Color) -> Option<SourceTerms> {
        let (own, all) = (self.source.get(&color.into()), self.source.get(&ModelOf::All));
        match (own, all) {
            (Some(own), Some(all)) => Some(own.or(all)),
            (own, all) => own.or(all).cloned(),
        }
    }

    /// The modes of the light of one color, from lit and unlit sources. Their weights add up to 1 for each switchable
    /// source of power 1. The list is empty for a laser on the axis, or for a color that the display does not have.
    pub fn modes(&self, color: Color) -> Vec<SourceMode> {
        let Ok(optics) = self.optics(color) else { return Vec::new() };
        let centred = || vec![SourceMode::centred(optics.wavelength)];
        let modes = self.source_terms(color).map_or_else(centred, |t| t.modes(optics.wavelength, optics.focal_length));
        let modes = match self.sources.is_empty() {
            true => modes,
            false => self.sources.modes(color, self.focal_length, &modes),
        };
        match modes[..] {
            // The number of the source does not matter, because there is no other.
            [one] if SourceMode { source: 0, ..one } == SourceMode::centred(optics.wavelength) => Vec::new(),
            _ => modes,
        }
    }

    /// Checks the source and the switchable sources.
    pub(super) fn check_source(&self) -> Result<(), Reason> {
        if !self.sources.is_empty() && self.geometry == Geometry::FarField {
            return Err(reason!(
                "sources-without-relay",
                "[[sources]]: only an SLM behind a relay has switchable sources, so leave them out"
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
                    "only an SLM behind a relay has a source: leave it out"
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

    /// The fewest samples of one color's source that are enough for pupils from this diameter on anywhere in the
    /// eyebox. Content may be this far from the eye's focus (meters). The speckle contrast is right to 3 %, and
    /// neighboring points split no content by more than a pixel. Values of the display file are kept. The result is
    /// none if there is nothing to sample.
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

    /// The same display with this many samples of a color's source.
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

/// The place of a mode's light in meters. The first two numbers are (x, y) of its eyebox. The third is the shift at the
/// eyebox's edge, `reach` from the axis, because its wavelength is not the main one.
pub(super) fn place(mode: &SourceMode, main: f64, reach: f64, focal_length: f64) -> [f64; 3] {
    let [x, y] = mode.eyebox(focal_length);
    [x, y, reach * (mode.wavelength / main - 1.0)]
}

/// Contrast (standard deviation over mean) of fully developed speckle that these modes show through a pupil. It is the
/// root of `sum w_j w_k |mu_jk|^2`, with `mu` the common share of the discs of two modes (Goodman 2007, chapter 4). A
/// wavelength moves the disc in proportion to the place in the eyebox. This takes the edge, `reach` from the axis.
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
