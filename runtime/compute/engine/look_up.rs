//! Looks up first phases in a table, for whichever engine holds the phases.

use super::EngineError;
use crate::scene::Pyramid;
use eyebox_kernels::pupil_light::{self, Share, pupil_light};
use eyebox_kernels::table_start::{self, LEVELS, table_start};
use rayon::prelude::*;
use std::sync::Arc;

/// Rows of one look-up. Their light stays in the first-level cache for all sub-frames.
const BAND: usize = 8;

/// A table, and the picture whose phases the look-up finds in it.
#[derive(Debug, Clone)]
pub struct LookUp {
    /// Binary angles (sub-frames, side, side, levels).
    pub table: Arc<[u16]>,
    /// The views, which an engine that runs them already has.
    pub views: Arc<Pyramid>,
    /// The visible views, each with its share.
    pub shares: Vec<Share>,
    /// Place of the SLM in the views, in the layout of the host.
    pub place: pupil_light::Args,
    /// Sizes and brightness, for phases in the layout of the host.
    pub args: table_start::Args,
    /// The [need](table_start::need) of each pixel because of its own light, or none if all pixels have the same.
    pub needs: Option<Arc<[u32]>>,
}

impl LookUp {
    /// Returns the phases (sub-frames, height, width), radians in -pi .. pi. They are whole binary angles, computed
    /// on the host.
    ///
    /// # Errors
    /// [`EngineError`] if the views are on a device that does not answer.
    pub fn phases(&self) -> Result<Vec<f32>, EngineError> {
        let mut phases = vec![0.0; self.count()];
        self.phases_into(&mut phases)?;
        Ok(phases)
    }

    /// Returns the number of phases.
    pub(super) fn count(&self) -> usize {
        [self.args.frames, self.args.height, self.args.width].map(|n| n as usize).iter().product()
    }

    /// Fills existing memory of the right length with the phases, because new memory takes longer than the look-up.
    pub(super) fn phases_into(&self, phases: &mut [f32]) -> Result<(), EngineError> {
        let views = super::on_host(&self.views)?;
        self.phases_of(phases, &|row, light| self.light(&views, row, light));
        Ok(())
    }

    /// Returns the drives (sub-frames, height, width) that all colors share, as phases of one turn in -pi .. pi. The
    /// look-up is by gray, the mean brightness of the colors, in the table of the first color.
    ///
    /// # Errors
    /// [`EngineError`] if there is no color, or the views are on a device that does not answer.
    pub fn drives(colors: &[Self]) -> Result<Vec<f32>, EngineError> {
        let Some(first) = colors.first() else {
            return Err(EngineError::mismatch("no color was given"));
        };
        let views = colors.iter().map(|color| super::on_host(&color.views)).collect::<Result<Vec<_>, _>>()?;
        let of_gray = Self { args: first.args.as_it_is(), needs: None, ..first.clone() };
        let width = first.args.width as usize;
        let mut phases = vec![0.0; first.count()];
        of_gray.phases_of(&mut phases, &|row, gray| {
            let (mut light, mut sums) = (vec![0; gray.len()], vec![0; gray.len()]);
            for (color, views) in colors.iter().zip(&views) {
                color.light(views, row, &mut light);
                let needs = color.needs.as_ref().map(|needs| &needs[row * width..][..gray.len()]);
                table_start::add_brightness(&color.args, &light, needs, &mut sums);
            }
            gray.iter_mut().zip(&sums).for_each(|(gray, sum)| *gray = (sum / colors.len() as u64) as u32);
        });
        Ok(phases)
    }

    /// Computes the light of whole rows of the SLM, from `row` on. 2^32 is full light.
    fn light(&self, views: &Pyramid, row: usize, light: &mut [u32]) {
        let first = self.place.first + row as u32 * self.place.line;
        let place = pupil_light::Args { height: light.len() as u32 / self.place.width, first, ..self.place };
        pupil_light(&place, &views.levels[0].views, &self.shares, light);
    }

    /// Fills `phases` from light that `make` computes for whole rows of the SLM, from a row on.
    fn phases_of(&self, phases: &mut [f32], make: &(dyn Fn(usize, &mut [u32]) + Sync)) {
        let [height, width, side] = [self.args.height, self.args.width, self.args.side].map(|n| n as usize);
        // Each band holds the same rows of all sub-frames.
        let mut bands: Vec<Vec<&mut [f32]>> = (0..height.div_ceil(BAND)).map(|_| Vec::new()).collect();
        for frame in phases.chunks_exact_mut(height * width) {
            bands.iter_mut().zip(frame.chunks_mut(BAND * width)).for_each(|(band, rows)| band.push(rows));
        }
        let room = || [vec![0; BAND * width], vec![0; BAND * width]];
        bands.into_par_iter().enumerate().for_each_init(room, |[light, places], (band, frames)| {
            let row = band * BAND;
            let rows = BAND.min(height - row);
            let [light, places] = [light, places].map(|room| &mut room[..rows * width]);
            make(row, light);
            let needs = self.needs.as_ref().map(|needs| &needs[row * width..][..rows * width]);
            table_start::places(&self.args, light, needs, places);
            for (phases, table) in frames.into_iter().zip(self.table.chunks(side * side * LEVELS)) {
                table_start(&self.args, row, places, table, phases);
            }
        });
    }
}
