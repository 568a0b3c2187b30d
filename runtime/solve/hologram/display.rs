//! Finds the display for which a hologram was solved, and the one to which it is sent.
//!
//! The first gives the effects on the light (source, lasers, model). The second is the same display, found again,
//! unless another is named.

use super::{Hologram, HologramError};
use crate::optics::{Display, Optics, OpticsError, SourceMode};
use crate::plan::ModelTables;
use std::sync::Arc;

impl Hologram {
    /// Returns the power of one color's lasers in each sub-frame, over its mean. Returns none if all powers are equal.
    pub fn powers(&self, color: usize) -> Option<&[f64]> {
        let laser = self.metadata.joint_color.as_ref()?.lasers.get(&self.colors[color].color?)?;
        Some(&laser.powers)
    }

    /// Returns a table of the powers of its switchable sources, for a program that drives them. It has one line per
    /// color and sub-frame and one column per source. A power of 1 is a source that is always lit at power 1. Returns
    /// none if the display has no such sources.
    pub fn sources_table(&self) -> Option<String> {
        let sources = &self.metadata.sources;
        if sources.is_empty() {
            return None;
        }
        let mut table = String::from("color,sub_frame");
        (1..=sources.each.len()).for_each(|number| table += &format!(",source_{number}"));
        table.push('\n');
        for color in &self.colors {
            let name = color.color?;
            let powers = sources.powers(name, self.frames, self.focal_length);
            for frame in 0..self.frames {
                let each: String = powers.iter().map(|of_source| format!(",{:.6}", of_source[frame])).collect();
                table += &format!("{name},{frame}{each}\n");
            }
        }
        Some(table)
    }

    /// Returns the modes of the source for which one of its colors was solved and with which it is simulated. The list
    /// is empty for a laser on the axis.
    ///
    /// # Errors
    /// Returns [`HologramError::NoDisplay`] if the display is not known.
    pub fn modes(&self, color: usize) -> Result<Vec<SourceMode>, HologramError> {
        // Only colors that have a name have a source.
        match self.colors[color].color {
            Some(name) if !(self.metadata.source.is_empty() && self.metadata.sources.is_empty()) => {
                Ok(self.made_for()?.modes(name))
            }
            _ => Ok(Vec::new()),
        }
    }

    /// Returns the model of its display for one of its colors, with the SLM inside a grid. Returns none for an ideal
    /// display.
    ///
    /// # Errors
    /// Returns [`HologramError::NoDisplay`] if the display is not known.
    pub(crate) fn model(
        &self,
        color: usize,
        slm: Optics,
        grid: Optics,
    ) -> Result<Option<Arc<ModelTables>>, HologramError> {
        // Only colors that have a name have a model, or can be computed behind a mask.
        match self.colors[color].color {
            None if self.metadata.mask.is_some() => Err(HologramError::NoDisplay),
            Some(name) if !self.metadata.model.is_empty() || self.metadata.mask.is_some() => {
                Ok(ModelTables::of(&self.made_for()?, name, slm, grid))
            }
            _ => Ok(None),
        }
    }
}

/// Wavelengths, pitches and focal lengths that differ by no more than this share are equal.
const SAME: f64 = 1e-6;

impl Hologram {
    /// Returns the display that a preset or file names, or the one of the solve, with its present encoding. The display
    /// of the solve is cut to the hologram's size, as it was then.
    ///
    /// # Errors
    /// Returns [`HologramError::DisplayNotFound`] for a display that no longer exists or has other optics now, and
    /// [`HologramError::Optics`] for one that cannot be read.
    pub fn shown_on(&self, named: Option<&str>) -> Result<Display, HologramError> {
        let display = match named {
            Some(name) => Display::load(name)?,
            None => self.own_display()?,
        };
        let is_own = display.name == self.display && self.was_made_for(&display).is_none();
        Ok(if is_own { self.cut(display) } else { display })
    }

    /// Returns a display with as many pixels as the hologram, if it has at least as many, or if they fit its video frame.
    fn cut(&self, display: Display) -> Display {
        let is_turned = display.encoding.rotation_deg % 180 == 90;
        let (height, width) = if is_turned { (self.width, self.height) } else { (self.height, self.width) };
        let [rows, columns] = display.encoding.most_pixels().unwrap_or([display.height, display.width]);
        if height > rows.max(display.height) || width > columns.max(display.width) {
            return display;
        }
        Display { height, width, portrait: display.portrait || height > width, ..display }
    }

    /// Returns the display for which it was solved, with its encoding.
    fn own_display(&self) -> Result<Display, HologramError> {
        let missing = |why: String| HologramError::DisplayNotFound { display: self.display.clone(), why };
        let Some(file) = &self.metadata.display_file else {
            let why = if self.display.is_empty() { "the hologram names none" } else { "it is not a preset" };
            let preset = Display::preset(&self.display).ok_or_else(|| missing(why.into()))?;
            return self.was_made_for(&preset).map_or(Ok(preset), |why| Err(missing(why)));
        };
        let mut first = None;
        for place in file.places() {
            let looked = place.display().to_string();
            let why = match Display::load(&looked) {
                Ok(display) => match self.was_made_for(&display) {
                    None => return Ok(display),
                    Some(why) => format!("{looked}: {why}"),
                },
                Err(OpticsError::UnknownDisplay { .. }) => format!("{looked} cannot be read"),
                Err(error) => error.to_string(),
            };
            first = first.or(Some(why));
        }
        Err(missing(first.unwrap_or_else(|| "the path of its file is not known".into())))
    }

    /// Returns the difference in optics between a display and the one for which it was made. Returns none if they are
    /// equal.
    fn was_made_for(&self, display: &Display) -> Option<String> {
        let differs = |a: f64, b: f64| (a / b - 1.0).abs() > SAME;
        if self.geometry != display.geometry {
            let (made, is) = (self.geometry.name(), display.geometry.name());
            return Some(format!("the hologram was made for a {made} display, but this display is {is}"));
        }
        for (what, made, is) in
            [("pitch", self.pitch, display.pitch), ("focal length", self.focal_length, display.focal_length)]
        {
            if differs(made, is) {
                let [made, is] = [made, is].map(|meters| meters * 1e3);
                return Some(format!("the hologram was made for a {what} of {made:.4} mm, but it is {is:.4} mm"));
            }
        }
        for color in &self.colors {
            let of = display.wavelengths.iter().find(|w| Some(w.color) == color.color);
            match of {
                Some(w) if !differs(w.wavelength, color.wavelength) => {}
                _ => {
                    let nm = color.wavelength * 1e9;
                    return Some(format!("the hologram was made for {nm:.1} nm, which this display does not have"));
                }
            }
        }
        None
    }
}
