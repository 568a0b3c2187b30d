//! What the display shows.

use super::PreviewError;
use crate::evaluate::Plane;
use crate::hologram::{ColorHologram, Hologram, HologramError, Tiles};
use crate::optics::{Color, Obstruction, Optics, Padding, PictureMap, SourceMode};
use crate::plan::{EyeTables, ModelTables, Planner};
use crate::solve::{Motion, Problem};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::sync::Arc;

/// One colour of what is shown.
#[derive(Debug, Clone)]
pub struct PreviewColor {
    /// Its colour; none where only a wavelength is known.
    pub color: Option<Color>,
    /// Over the SLM.
    pub optics: Optics,
    /// One exposure for the whole eyebox (OPTICS 2).
    pub exposure: f64,
    /// The share of its field of view that all colours have: 1 but in the far field (OPTICS 9).
    pub share: f64,
    /// What the display does to the light beside showing phases; none for the ideal one.
    pub model: Option<Arc<ModelTables>>,
    /// The eye that looks; none for a perfect one.
    pub eye: Option<Arc<EyeTables>>,
    /// The modes of its source; none for a laser on the axis.
    pub modes: Arc<[SourceMode]>,
    /// Power of its laser in each sub-frame, over its mean (OPTICS 13); none where all are alike.
    pub powers: Arc<[f64]>,
    /// Where its picture is seen; none where nothing bends it.
    pub map: Option<PictureMap>,
    /// (sub-frame, row, column), radians; none where they are in tiles. A colour whose phases are the same as before costs
    /// nothing again.
    pub phases: Arc<Vec<f32>>,
}

/// Phases on a display, and the light that they are seen by.
#[derive(Debug, Clone)]
pub struct PreviewContent {
    /// Sub-frames.
    pub frames: usize,
    /// Zeros around the SLM in the computation.
    pub padding: Padding,
    /// The colours.
    pub colors: Vec<PreviewColor>,
    /// Side of the eyebox that all colours of the display serve, metres.
    pub eyebox: f64,
    /// The phases of a far field that stay on the disk: those under the pupil are read for each picture.
    pub tiles: Option<Arc<Tiles>>,
    /// What it should be, colour by colour, where that changes with what is shown; else the scene that the viewer was given.
    pub scene: Option<Arc<Vec<Problem>>>,
    /// What moves while its sub-frames are lit, colour by colour: what is seen is integrated over it. Empty where nothing does.
    pub motion: Vec<Motion>,
    /// What is in the pupil of the eye that looks. Of tiles, theirs counts.
    pub obstruction: Option<Obstruction>,
}

impl PreviewContent {
    /// A hologram, seen as it was solved: with this padding.
    ///
    /// # Errors
    /// Its optics, or a hologram that contradicts itself.
    pub fn new(hologram: Hologram, padding: Padding) -> Result<Self, PreviewError> {
        if hologram.colors.is_empty() {
            return Err(PreviewError::Showing { reason: reason!("no-color", "it has no colours") });
        }
        let optics = (0..hologram.colors.len()).map(|i| hologram.optics(i)).collect::<Result<Vec<_>, _>>()?;
        let solved = optics.iter().map(|o| o.wavelength);
        let shortest = hologram.display_wavelengths.iter().map(|w| w.wavelength).chain(solved).fold(f64::MAX, f64::min);
        let eyebox = match hologram.made_for() {
            Ok(display) if !display.sources.is_empty() => display.eyebox_min(),
            _ => Optics { wavelength: shortest, ..optics[0] }.eyebox(),
        };
        let shares: Vec<f64> = (0..hologram.colors.len()).map(|i| hologram.picture_share(i)).collect();
        let planners = (0..hologram.colors.len()).map(|i| hologram.planner(i));
        let planners = planners.collect::<Result<Vec<_>, HologramError>>()?;
        let obstruction = hologram.metadata.obstruction;
        let (picture, size) = (hologram.metadata.picture, [hologram.height, hologram.width]);
        let shown = |(((color, optics), share), planner): (((ColorHologram, Optics), f64), Planner)| PreviewColor {
            color: color.color,
            optics,
            exposure: color.exposure,
            share,
            model: planner.model,
            eye: planner.eye,
            modes: planner.modes,
            powers: planner.powers,
            map: color.color.and_then(|color| picture.map(color, size)),
            phases: Arc::new(color.phases),
        };
        let colors = hologram.colors.into_iter().zip(optics).zip(shares).zip(planners).map(shown).collect();
        let (tiles, scene, motion) = (None, None, Vec::new());
        Ok(Self { frames: hologram.frames, padding, colors, eyebox, tiles, scene, motion, obstruction })
    }

    /// What moves while a colour's sub-frames are lit, where something does.
    pub(super) fn moving(&self, color: usize) -> Option<&Motion> {
        self.motion.get(color).filter(|motion| !motion.is_still())
    }

    /// Planes of its colours, as the display shows them, as they are seen.
    pub(super) fn as_seen(&self, planes: Vec<Plane>) -> Vec<Plane> {
        let seen = |(plane, shown): (Plane, &PreviewColor)| match &shown.map {
            Some(map) => plane.as_seen(map),
            None => plane,
        };
        planes.into_iter().zip(&self.colors).map(seen).collect()
    }

    /// Rows and columns of what is seen: the SLM's pixels, or, in the far field, a square of as many.
    pub fn size(&self) -> [usize; 2] {
        self.colors.first().map_or([0, 0], |c| c.optics.image_size().into())
    }

    /// Refuses what does not hang together.
    ///
    /// # Errors
    /// [`PreviewError::Showing`].
    pub fn check(&self) -> Result<(), PreviewError> {
        let wrong = |reason: Reason| Err(PreviewError::Showing { reason });
        let [height, width] = self.colors.first().map_or([0, 0], |c| [c.optics.height, c.optics.width]);
        if self.colors.is_empty() || self.frames == 0 {
            return wrong(reason!("size", "{} colours and {} sub-frames", self.colors.len(), self.frames));
        }
        let about = self.tiles.as_ref().map(|t| t.about());
        if about.is_some_and(|a| (a.frames, a.colors.len()) != (self.frames, self.colors.len())) {
            return wrong(reason!("other-tiles", "its tiles hold other sub-frames or colours"));
        }
        for (i, c) in self.colors.iter().enumerate() {
            let expected = match self.tiles {
                Some(_) => Some(0),
                None => height.checked_mul(width).and_then(|n| n.checked_mul(self.frames)),
            };
            if [c.optics.height, c.optics.width] != [height, width] || Some(c.phases.len()) != expected {
                return wrong(reason!(
                    "phases-count",
                    "colour {i} has {} phases of {}x{}, not {} sub-frames of {height}x{width}",
                    c.phases.len(),
                    c.optics.height,
                    c.optics.width,
                    self.frames
                ));
            }
        }
        Ok(())
    }
}
