//! What the display that a hologram was solved for does to its light: source, lasers, model.

use super::{Hologram, HologramError};
use crate::optics::{Optics, SourceMode};
use crate::plan::ModelTables;
use std::sync::Arc;

impl Hologram {
    /// Power of one of its colours' lasers in each sub-frame, over its mean; none where all are alike.
    pub fn powers(&self, color: usize) -> Option<&[f64]> {
        let laser = self.metadata.joint_color.as_ref()?.lasers.get(&self.colors[color].color?)?;
        Some(&laser.powers)
    }

    /// A table of its switchable sources' powers, for whoever drives them: a line a colour and sub-frame, a column a source; 1 is a
    /// source of power 1 that is always lit. None where its display has no such sources.
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

    /// The modes of the source that one of its colours was solved for, and is looked at in; none for a laser on the axis.
    ///
    /// # Errors
    /// [`HologramError::NoDisplay`].
    pub fn modes(&self, color: usize) -> Result<Vec<SourceMode>, HologramError> {
        // Only colours that have a name have a source.
        match self.colors[color].color {
            Some(name) if !(self.metadata.source.is_empty() && self.metadata.sources.is_empty()) => {
                Ok(self.made_for()?.modes(name))
            }
            _ => Ok(Vec::new()),
        }
    }

    /// What the display that it was solved for does to one of its colours, on its SLM inside a grid; none for the ideal one.
    ///
    /// # Errors
    /// [`HologramError::NoDisplay`].
    pub(crate) fn model(
        &self,
        color: usize,
        slm: Optics,
        grid: Optics,
    ) -> Result<Option<Arc<ModelTables>>, HologramError> {
        // Only colours that have a name have a model, or are known behind a mask.
        match self.colors[color].color {
            None if self.metadata.mask.is_some() => Err(HologramError::NoDisplay),
            Some(name) if !self.metadata.model.is_empty() || self.metadata.mask.is_some() => {
                Ok(ModelTables::of(&self.made_for()?, name, slm, grid))
            }
            _ => Ok(None),
        }
    }
}
