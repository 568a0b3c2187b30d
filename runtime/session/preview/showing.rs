//! Describes the content that the display shows.

use super::PreviewError;
use crate::evaluate::Plane;
use crate::hologram::{ColorHologram, Hologram, HologramError, Tiles};
use crate::optics::{Color, Obstruction, Optics, Padding, PictureMap, SourceMode};
use crate::plan::{EyeTables, ModelTables, Planner};
use crate::solve::{Motion, Problem};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::sync::Arc;

/// One color of the content.
#[derive(Debug, Clone)]
pub struct PreviewColor {
    /// The name of the color, or `None` if only its wavelength is given.
    pub color: Option<Color>,
    /// The optics over the SLM.
    pub optics: Optics,
    /// The exposure of this color, one for the whole eyebox (OPTICS 2).
    pub exposure: f64,
    /// The share of its field of view that all colors have. It is 1 except in the far field (OPTICS 9).
    pub share: f64,
    /// The display model, or `None` for an ideal display.
    pub model: Option<Arc<ModelTables>>,
    /// The model of the eye, or `None` for a perfect eye.
    pub eye: Option<Arc<EyeTables>>,
    /// The modes of the source, or an empty list for a laser on the axis.
    pub modes: Arc<[SourceMode]>,
    /// The power of the laser in each sub-frame over its mean (OPTICS 13), or an empty list if all are equal.
    pub powers: Arc<[f64]>,
    /// The map of the visible picture, or `None` if the display does not distort it.
    pub map: Option<PictureMap>,
    /// The phases (sub-frame, row, column) in radians, or an empty list if they are in tiles. If a color keeps the same
    /// phases, its spectrum is not computed again.
    pub phases: Arc<Vec<f32>>,
}

/// The phases on a display, and the light that makes them visible.
#[derive(Debug, Clone)]
pub struct PreviewContent {
    /// The number of sub-frames.
    pub frames: usize,
    /// The zeros around the SLM in the computation.
    pub padding: Padding,
    /// The colors of the hologram.
    pub colors: Vec<PreviewColor>,
    /// The side of the eyebox that all colors of the display serve (m).
    pub eyebox: f64,
    /// The phases of a far field that stay on the disk. Each picture reads those under its pupil.
    pub tiles: Option<Arc<Tiles>>,
    /// The target scene for each color, if it changes with the content. Otherwise the viewer uses the scene that it was
    /// started with.
    pub scene: Option<Arc<Vec<Problem>>>,
    /// The motion of each color while its sub-frames are lit, over which the image is integrated. It is empty if
    /// nothing moves.
    pub motion: Vec<Motion>,
    /// The obstruction in the pupil of the eye. For tiles, the obstruction of the tiles counts.
    pub obstruction: Option<Obstruction>,
}

impl PreviewContent {
    /// Takes the content of a hologram, with the padding that it was solved with.
    ///
    /// # Errors
    /// Returns the error of its optics, or of a hologram that contradicts itself.
    pub fn new(hologram: Hologram, padding: Padding) -> Result<Self, PreviewError> {
        if hologram.colors.is_empty() {
            return Err(PreviewError::Showing { reason: reason!("no-color", "it has no colors") });
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

    /// Returns the motion while the sub-frames of a color are lit, if there is any.
    pub(super) fn moving(&self, color: usize) -> Option<&Motion> {
        self.motion.get(color).filter(|motion| !motion.is_still())
    }

    /// Distorts the planes of the colors in the display to the planes that an eye sees.
    pub(super) fn as_seen(&self, planes: Vec<Plane>) -> Vec<Plane> {
        let seen = |(plane, shown): (Plane, &PreviewColor)| match &shown.map {
            Some(map) => plane.as_seen(map),
            None => plane,
        };
        planes.into_iter().zip(&self.colors).map(seen).collect()
    }

    /// Returns the rows and columns of the image. These are the pixels of the SLM, or a square of as many in the far
    /// field.
    pub fn size(&self) -> [usize; 2] {
        self.colors.first().map_or([0, 0], |c| c.optics.image_size().into())
    }

    /// Checks that the parts of the content fit together.
    ///
    /// # Errors
    /// Returns [`PreviewError::Showing`] if they do not.
    pub fn check(&self) -> Result<(), PreviewError> {
        let wrong = |reason: Reason| Err(PreviewError::Showing { reason });
        let [height, width] = self.colors.first().map_or([0, 0], |c| [c.optics.height, c.optics.width]);
        if self.colors.is_empty() || self.frames == 0 {
            return wrong(reason!(
                "size",
                "it has {} colors and {} sub-frames, but both must be at least 1",
                self.colors.len(),
                self.frames
            ));
        }
        let about = self.tiles.as_ref().map(|t| t.about());
        if about.is_some_and(|a| (a.frames, a.colors.len()) != (self.frames, self.colors.len())) {
            return wrong(reason!("other-tiles", "its tiles have a different number of sub-frames or colors"));
        }
        for (i, c) in self.colors.iter().enumerate() {
            let expected = match self.tiles {
                Some(_) => Some(0),
                None => height.checked_mul(width).and_then(|n| n.checked_mul(self.frames)),
            };
            if [c.optics.height, c.optics.width] != [height, width] || Some(c.phases.len()) != expected {
                return wrong(reason!(
                    "phases-count",
                    "color {i} has {} phases of {}x{}, not {} sub-frames of {height}x{width}",
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
