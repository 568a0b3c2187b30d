//! Computes the intensity of a hologram through a pupil, in memory or in tiles.

use super::ReconstructionError;
use crate::engine::{Buffer, Engine, Purpose};
use crate::evaluate::{self, Plane, centered};
use crate::hologram::{Hologram, HologramError, PhaseSource, Tiles};
use crate::optics::{Pupil, WindowFactor};
use crate::plan::{Comparison, EyeTables, Kernel, ModelTables, Planner};
use crate::scene::crop_share;
use std::ops::Range;

impl PhaseSource<'_> {
    /// Returns the intensity of every color through a pupil. It is averaged over the sub-frames, or of sub-frame
    /// `frame` alone, and divided by the pupil's share of the eyebox (OPTICS 2). No exposure is applied. The image has
    /// the SLM's pixels, or in the far field a square of as many pixels. A hologram in tiles uses
    /// [`Sampling::Picture`].
    ///
    /// # Errors
    /// Returns [`HologramError::Optics`] and the errors of the engine and of the tiles.
    ///
    /// # Panics
    /// Panics if the sub-frame does not exist, which is a mistake of the caller.
    pub fn look(
        &self,
        frame: Option<usize>,
        pupil: &Pupil,
        engine: &mut dyn Engine,
    ) -> Result<Vec<Plane>, ReconstructionError> {
        let one = |color| Ok(self.look_through(color, frame, &[*pupil], Sampling::Picture, engine)?.remove(0));
        (0..self.about().colors.len()).map(one).collect()
    }

    /// Returns the intensity of one color through several pupils, with the given sampling.
    ///
    /// # Errors
    /// Returns the errors of [`look`](Self::look).
    ///
    /// # Panics
    /// Panics if the color or sub-frame does not exist, which is a mistake of the caller.
    pub fn look_through(
        &self,
        color: usize,
        frame: Option<usize>,
        pupils: &[Pupil],
        sampling: Sampling,
        engine: &mut dyn Engine,
    ) -> Result<Vec<Plane>, ReconstructionError> {
        match self {
            Self::Whole(hologram) => whole(hologram, color, frame, pupils, engine),
            Self::Tiled(tiles) => {
                let frames = frame.map_or(0..tiles.about().frames, |f| f..f + 1);
                pupils.iter().map(|p| tiled(tiles, color, frames.clone(), p, sampling, engine)).collect()
            }
        }
    }
}

/// The pixels of the image of a far field larger than memory. Images of other holograms have the SLM's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sampling {
    /// The image has as many pixels as the pupil resolves.
    Pupil,
    /// The image has as many pixels as the pupil resolves. Along each axis, two samples of a window twice as wide are
    /// averaged to one.
    Picture,
}

impl Sampling {
    /// Returns the window that is computed.
    pub(super) fn factor(self) -> WindowFactor {
        match self {
            Self::Pupil => WindowFactor::One,
            Self::Picture => WindowFactor::Two,
        }
    }

    /// Returns the picture's part of the square image in the window, with the axis moved from the first pixel to the
    /// middle.
    pub(super) fn picture(self, image: Vec<f32>, share: f64) -> Plane {
        let n = (image.len() as f64).sqrt().round() as usize;
        let image = centered(&image, n, n);
        let values = if share < 1.0 { crop_share(&image, n, n, share) } else { image };
        let plane = Plane { rows: n, columns: n, values };
        if self == Self::Picture { plane.pooled() } else { plane }
    }
}

impl Hologram {
    /// Returns the intensity of every color through a pupil, without exposure. See [`PhaseSource::look`].
    ///
    /// # Errors
    /// Returns the errors of [`PhaseSource::look`].
    pub fn look(&self, pupil: &Pupil, engine: &mut dyn Engine) -> Result<Vec<Plane>, ReconstructionError> {
        PhaseSource::from(self).look(None, pupil, engine)
    }

    /// Applies the distortion of its display's picture to planes in its colors, which have its picture's size.
    pub fn as_seen(&self, mut planes: Vec<Plane>) -> Vec<Plane> {
        for (plane, color) in planes.iter_mut().zip(&self.colors) {
            let size = [plane.rows, plane.columns];
            if let Some(map) = color.color.and_then(|color| self.metadata.picture.map(color, size)) {
                *plane = plane.as_seen(&map);
            }
        }
        planes
    }

    /// Returns the planner for images of one of its colors. It has the whole spectrum, and the padding and the
    /// display's model of the solve.
    ///
    /// # Errors
    /// Returns [`HologramError::Optics`] for impossible optics.
    pub fn planner(&self, color: usize) -> Result<Planner, HologramError> {
        let plain = Planner::new(self.optics(color)?, self.frames, WindowFactor::Full);
        let plain = plain.with_padding(self.metadata.padding());
        let model = self.model(color, plain.slm, plain.grid)?;
        let eye = EyeTables::new(self.metadata.prescription.as_ref());
        let modes = self.modes(color)?.into();
        let powers = self.powers(color).unwrap_or_default().into();
        Ok(Planner { share: self.picture_share(color), model, eye, modes, powers, ..plain })
    }
}

fn whole(
    hologram: &Hologram,
    color: usize,
    frame: Option<usize>,
    pupils: &[Pupil],
    engine: &mut dyn Engine,
) -> Result<Vec<Plane>, ReconstructionError> {
    let mut planner = hologram.planner(color)?;
    let phases = match frame {
        Some(frame) => {
            planner.frames = 1;
            planner.powers = hologram.powers(color).map(|powers| powers[frame]).into_iter().collect();
            planner.modes = planner.modes.iter().map(|mode| mode.in_frame(frame, hologram.frames)).collect();
            hologram.frame(color, frame)
        }
        None => &hologram.colors[color].phases,
    };
    let (rows, columns) = hologram.picture_size();
    let obstruction = hologram.metadata.obstruction;
    // The shadows of an obstruction move with the pupil, so each pupil has its own tables.
    let alike = if obstruction.is_some() { 1 } else { pupils.len().max(1) };
    let mut seen = Vec::with_capacity(pupils.len());
    for pupils in pupils.chunks(alike) {
        let past = obstruction.map(|obstruction| planner.obstructed(obstruction, &pupils[0]));
        let planner = past.as_ref().unwrap_or(&planner);
        if seen.is_empty() {
            engine.load(&planner.shape(Purpose::View), None)?;
            engine.write(Buffer::Phases, phases)?;
        }
        seen.append(&mut evaluate::views(engine, planner, pupils)?);
    }
    Ok(seen.into_iter().map(|values| Plane { rows, columns, values }).collect())
}

/// Returns the image of a hologram in tiles through a pupil. Sub-frames are processed one after the other, so that
/// memory depends only on the pupil's area.
fn tiled(
    tiles: &Tiles,
    color: usize,
    frames: Range<usize>,
    pupil: &Pupil,
    sampling: Sampling,
    engine: &mut dyn Engine,
) -> Result<Plane, ReconstructionError> {
    let about = tiles.about();
    let whole = about.optics(color)?;
    let model = tiles.model(color)?;
    let (at, size) = ModelTables::under(model.map(|model| &**model), &whole, pupil);
    let plain = Planner::new(whole.piece(at, size), 1, sampling.factor());
    let planner = Planner { model: model.map(|model| model.piece(at, size)), ..plain };
    let planner = match about.metadata.obstruction {
        Some(obstruction) => planner.obstructed(obstruction, pupil),
        None => planner,
    };
    let phases = tiles.read_around(color, at, size)?;
    let pixels = size[0] * size[1];
    // If sub-frames affect each other, all sub-frames of a set go through the engine at once. A single one is simulated
    // alone.
    if frames.len() > 1 && model.is_some_and(|model| model.model().lag > 0.0) {
        let planner = Planner { frames: frames.len(), ..planner };
        engine.load(&planner.shape(Purpose::View), None)?;
        engine.write(Buffer::Phases, &phases)?;
        engine.run(&planner.view_step(vec![planner.pupil_pass(pupil, &Comparison::default())]))?;
        return Ok(sampling.picture(engine.read(Buffer::Image(0))?, about.picture_share(color)));
    }
    let all = Planner { frames: frames.len(), ..planner.clone() };
    let mut pupil_pass = all.pupil_pass(pupil, &Comparison::default());
    pupil_pass.intensity.frames = 1;
    let mut step = planner.view_step(vec![pupil_pass]);
    engine.load(&planner.shape(Purpose::View), None)?;
    for (f, frame) in phases.chunks_exact(pixels).skip(frames.start).take(frames.len()).enumerate() {
        engine.write(Buffer::Phases, frame)?;
        engine.run(&step)?;
        if f == 0 {
            step.list.retain(|d| ![Kernel::Transfer, Kernel::Relay].contains(&d.kernel));
            step.pupil_passes[0].intensity.accumulate = 1;
        }
    }
    Ok(sampling.picture(engine.read(Buffer::Image(0))?, about.picture_share(color)))
}
