//! Renders through a moving pupil.
//!
//! It keeps the spectrum, so that only the parts that depend on the pupil are computed.

use super::picture::Detail;
use super::{PreviewColor, PreviewContent, PreviewError};
use crate::engine::{Buffer, Engine, EngineError, Purpose};
use crate::evaluate::{self, Plane};
use crate::hologram::PhaseSource;
use crate::optics::{Geometry, Padding, Pupil, WindowFactor};
use crate::plan::{Comparison, ModelTables, Moving, Planner, Viewpoint};
use eyebox_kernels::fft::Columns;
use std::sync::Arc;

/// The pixels of the SLM across the pupil of a coarse picture of tiles.
const TILED_ACROSS: f64 = 384.0;

/// A function that opens one engine.
pub type Opener = Box<dyn FnMut() -> Result<Box<dyn Engine>, EngineError> + Send>;

/// Renders the content of a display, with an engine for each color.
pub struct Eye {
    open: Opener,
    holds: Vec<Hold>,
}

/// A color whose spectrum is in its engine.
struct Hold {
    engine: Box<dyn Engine>,
    spectrum: Option<Spectrum>,
}

struct Spectrum {
    planner: Planner,
    /// The model of the display, without the obstruction of the pupil.
    model: Option<Arc<ModelTables>>,
    of: Arc<Vec<f32>>,
    frame: Option<usize>,
}

impl Eye {
    /// Creates an eye whose engines `open` opens when they are needed, one for each color.
    pub fn new(open: Opener) -> Self {
        Self { open, holds: Vec::new() }
    }

    /// Returns the function that opens engines, for a caller that needs an engine of the same kind.
    pub(super) fn opener(&mut self) -> &mut Opener {
        &mut self.open
    }

    /// Returns one engine for content whose spectrum is not kept, so that memory holds one such content at a time.
    pub(super) fn single(&mut self) -> Result<&mut dyn Engine, EngineError> {
        if self.holds.is_empty() {
            self.holds.push(Hold { engine: (self.open)()?, spectrum: None });
        }
        self.holds.truncate(1);
        self.holds[0].spectrum = None;
        Ok(self.holds[0].engine.as_mut())
    }

    /// Renders the intensity of each color through one pupil, divided by the share of the pupil and without exposure,
    /// as [`evaluate::views`] does.
    ///
    /// The intensity is the mean of all sub-frames, or the intensity of `frame` alone. For a hologram in tiles, the
    /// samples have the resolution of the pupil.
    ///
    /// # Errors
    /// Returns [`PreviewError::Showing`] if the content contradicts itself, and the errors of the engines.
    pub fn look(
        &mut self,
        showing: &PreviewContent,
        frame: Option<usize>,
        pupil: &Pupil,
        detail: Detail,
    ) -> Result<Vec<Plane>, PreviewError> {
        showing.check()?;
        let frame = frame.map(|f| f.min(showing.frames - 1));
        if let Some(tiles) = &showing.tiles {
            // A coarse picture uses the middle of the pupil. It needs fewer tiles and has fewer details, with the same
            // parallax and light.
            let coarse = (TILED_ACROSS * tiles.about().pitch).min(pupil.diameter / 2.0);
            let diameter = if detail == Detail::Whole { pupil.diameter } else { coarse };
            let source = PhaseSource::Tiled(Arc::clone(tiles));
            return Ok(source.look(frame, &Pupil { diameter, ..*pupil }, self.single()?)?);
        }
        while self.holds.len() < showing.colors.len() {
            self.holds.push(Hold { engine: (self.open)()?, spectrum: None });
        }
        let look = |(i, (hold, shown)): (usize, (&mut Hold, &PreviewColor))| {
            // A sub-frame alone is lit only briefly, so its motion is left out.
            let motion = showing.moving(i).filter(|_| frame.is_none());
            let through = motion.map_or(Viewpoint::Pupil(*pupil), |m| m.seen_through(*pupil, showing.frames));
            hold.look(showing, shown, frame, &through, detail)
        };
        Ok(self.holds.iter_mut().zip(&showing.colors).enumerate().map(look).collect::<Result<_, _>>()?)
    }
}

impl Hold {
    fn look(
        &mut self,
        showing: &PreviewContent,
        shown: &PreviewColor,
        frame: Option<usize>,
        through: &Viewpoint,
        detail: Detail,
    ) -> Result<Plane, EngineError> {
        let frames = if frame.is_some() { 1 } else { showing.frames };
        let plain = Planner::new(shown.optics, frames, WindowFactor::Full).with_padding(showing.padding);
        let (model, eye) = (shown.model.clone(), shown.eye.clone());
        let modes = match frame {
            Some(f) => shown.modes.iter().map(|mode| mode.in_frame(f, showing.frames)).collect(),
            None => shown.modes.clone(),
        };
        let powers = match frame {
            Some(f) => shown.powers.get(f).into_iter().copied().collect(),
            None => shown.powers.clone(),
        };
        let planner = Planner { share: shown.share, model, eye, modes, powers, ..plain };
        let planner = match (showing.obstruction, through) {
            (Some(obstruction), Viewpoint::Pupil(pupil) | Viewpoint::Moving(Moving { pupil, .. })) => {
                planner.obstructed(obstruction, pupil)
            }
            _ => planner,
        };
        // The crop of a padded image and the centering of the axis of a far field work in whole pixels only.
        let relay = shown.optics.geometry == Geometry::Relay;
        let fine = detail == Detail::Whole || showing.padding != Padding::default() || !relay;
        let looking = if fine { planner.clone() } else { Planner { factor: WindowFactor::Two, ..planner.clone() } };
        let pupil_pass = looking.viewpoint(through, &Comparison::default());
        let (rows, columns) = (pupil_pass.window.rows, pupil_pass.window.columns);
        let mut step = looking.view_step(vec![pupil_pass]);
        // The next call may use any other pupil.
        step.columns = Columns { first: 0, count: planner.grid.width };
        let shared = step.shared();
        let known = self.spectrum.as_ref().is_some_and(|s| {
            s.frame == frame
                && Arc::ptr_eq(&s.of, &shown.phases)
                && (s.planner.slm, s.planner.grid) == (planner.slm, planner.grid)
                && s.model == shown.model
                && s.planner.shape(Purpose::View) == planner.shape(Purpose::View)
        });
        if !known {
            let shape = planner.shape(Purpose::View);
            if self.spectrum.take().is_none_or(|s| s.planner.shape(Purpose::View) != shape) {
                self.engine.load(&shape, None)?;
            }
            let phases = match frame {
                Some(f) => &shown.phases[f * shape.pixels()..(f + 1) * shape.pixels()],
                None => &shown.phases[..],
            };
            self.engine.write(Buffer::Phases, phases)?;
            self.engine.run_part(&step, 0..shared)?;
            let (of, model) = (Arc::clone(&shown.phases), shown.model.clone());
            self.spectrum = Some(Spectrum { planner: planner.clone(), model, of, frame });
        }
        self.engine.run_part(&step, shared..step.list.len())?;
        let image = self.engine.read(Buffer::Image(0))?;
        Ok(if fine {
            let (rows, columns) = planner.slm.image_size();
            Plane { rows, columns, values: evaluate::crop(&planner, image) }
        } else {
            Plane { rows, columns, values: image }
        })
    }
}
