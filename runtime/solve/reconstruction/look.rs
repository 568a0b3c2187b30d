//! The intensity that a pupil sees of a hologram, in memory or in tiles.

use super::ReconstructionError;
use crate::engine::{Buffer, Engine, Purpose};
use crate::evaluate::{self, Plane, centered};
use crate::hologram::{Hologram, HologramError, PhaseSource, Tiles};
use crate::optics::{Pupil, WindowFactor};
use crate::plan::{Comparison, EyeTables, Kernel, ModelTables, Planner};
use crate::scene::crop_share;
use std::ops::Range;

impl PhaseSource<'_> {
    /// What a pupil sees of every colour: the time-averaged intensity over the pupil's share of the eyebox (OPTICS 2), or that
    /// of sub-frame `frame` alone. No exposure is applied. On the SLM's pixels, or in the far field a square of as many; of a
    /// hologram in tiles, on [`Sampling::Picture`].
    ///
    /// # Errors
    /// [`HologramError::Optics`]; those of the engine and of the tiles.
    ///
    /// # Panics
    /// If there is no such sub-frame: the caller's mistake.
    pub fn look(
        &self,
        frame: Option<usize>,
        pupil: &Pupil,
        engine: &mut dyn Engine,
    ) -> Result<Vec<Plane>, ReconstructionError> {
        let one = |color| Ok(self.look_through(color, frame, &[*pupil], Sampling::Picture, engine)?.remove(0));
        (0..self.about().colors.len()).map(one).collect()
    }

    /// The same of one colour through several pupils, sampled as asked.
    ///
    /// # Errors
    /// Those of [`look`](Self::look).
    ///
    /// # Panics
    /// If there is no such colour or sub-frame: the caller's mistake.
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

/// On which pixels a far field larger than memory is seen. Other holograms are seen on the SLM's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sampling {
    /// As many as the pupil resolves.
    Pupil,
    /// As many: two samples of a window twice as wide averaged to one along each axis.
    Picture,
}

impl Sampling {
    /// The window that is computed,
    pub(super) fn factor(self) -> WindowFactor {
        match self {
            Self::Pupil => WindowFactor::One,
            Self::Picture => WindowFactor::Two,
        }
    }

    /// and what becomes of the square image in it, whose axis comes first: the picture's part, with the axis in the middle.
    pub(super) fn picture(self, image: Vec<f32>, share: f64) -> Plane {
        let n = (image.len() as f64).sqrt().round() as usize;
        let image = centered(&image, n, n);
        let values = if share < 1.0 { crop_share(&image, n, n, share) } else { image };
        let plane = Plane { rows: n, columns: n, values };
        if self == Self::Picture { plane.pooled() } else { plane }
    }
}

impl Hologram {
    /// What a pupil sees of every colour, without exposure; see [`PhaseSource::look`].
    ///
    /// # Errors
    /// Those of [`PhaseSource::look`].
    pub fn look(&self, pupil: &Pupil, engine: &mut dyn Engine) -> Result<Vec<Plane>, ReconstructionError> {
        PhaseSource::from(self).look(None, pupil, engine)
    }

    /// What is seen of planes in its colours, of its own picture's size, behind what bends its display's picture.
    pub fn as_seen(&self, mut planes: Vec<Plane>) -> Vec<Plane> {
        for (plane, color) in planes.iter_mut().zip(&self.colors) {
            let size = [plane.rows, plane.columns];
            if let Some(map) = color.color.and_then(|color| self.metadata.picture.map(color, size)) {
                *plane = plane.as_seen(&map);
            }
        }
        planes
    }

    /// Plans for what is seen of one of its colours: the whole spectrum, with the padding and the display's model that it was
    /// solved with.
    ///
    /// # Errors
    /// [`HologramError::Optics`] for optics that cannot be.
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
    // Marks move with the pupil, and so each pupil has tables of its own.
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

/// What a pupil sees of a hologram in tiles. Sub-frames go one after the other: memory follows the pupil's area.
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
    // Seen in each other, all sub-frames of a set go through the engine at once; a single one was seen alone.
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
