//! What one pupil needs, as data.

use super::list::{BufferSize, Resource, Shape};
use crate::optics::Window;
use bytemuck::Zeroable;
use eyebox_kernels::{
    compare, exposure, eye, fft::Columns, intensity, modulate, motion, pass_pupil, photograph, resample, transfer,
};
use std::sync::Arc;

/// The photograph of one pupil pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// Level of the pyramid.
    pub level: usize,
    /// Arguments of `photograph`.
    pub args: photograph::Args,
    /// The views that the pupil covers.
    pub taps: Vec<photograph::Tap>,
    /// Arguments of `resample`.
    pub resample: resample::Args,
    /// Weights along rows.
    pub rows: Arc<resample::Table>,
    /// Weights along columns.
    pub columns: Arc<resample::Table>,
}

/// What one pupil needs.
#[derive(Debug, Clone, PartialEq)]
pub struct PupilPass {
    /// Its window, signed bins.
    pub window: Window,
    /// Per row of the window, the columns that pass.
    pub spans: Vec<[u32; 2]>,
    /// Arguments of `transfer`.
    pub transfer: transfer::Args,
    /// What `eye` multiplies by, where the eye is not perfect.
    pub eye: Option<eye::Terms>,
    /// Weights of `taper`: those of all rows, then those of all columns. None for an aperture with a sharp edge.
    pub taper: Option<Vec<f32>>,
    /// What `motion` does to each sub-frame, where the eye moves, or does not see all of them; else of no sub-frame.
    pub moments: motion::Table,
    /// Arguments of `pass_pupil` and `overlap`.
    pub pass: pass_pupil::Args,
    /// Arguments of `pupil_adjoint`: the same place, another scale.
    pub back: pass_pupil::Args,
    /// Columns of the window that any span touches.
    pub columns: Columns,
    /// Arguments of `intensity`.
    pub intensity: intensity::Args,
    /// Arguments of `compare`.
    pub compare: compare::Args,
    /// The photograph; none where only the wave is looked at.
    pub shot: Option<Shot>,
    /// Share of the source's light that its own mode has; 1 where there is one mode.
    pub weight: f32,
    /// Which of the planner's modes its own is; 0 for a laser on the axis.
    pub source_mode: usize,
    /// The source's further modes (OPTICS 12): windows of the same size, whose intensities add to this one's. They have no
    /// photograph and no modes of their own.
    pub modes: Vec<PupilPass>,
}

impl PupilPass {
    /// One that needs nothing, to be filled.
    pub fn empty() -> Self {
        Self {
            window: Window { y0: 0, x0: 0, rows: 0, columns: 0 },
            spans: Vec::new(),
            transfer: transfer::Args::zeroed(),
            eye: None,
            taper: None,
            moments: motion::Table::default(),
            pass: pass_pupil::Args::zeroed(),
            back: pass_pupil::Args::zeroed(),
            columns: Columns { first: 0, count: 0 },
            intensity: intensity::Args::zeroed(),
            compare: compare::Args::zeroed(),
            shot: None,
            weight: 1.0,
            source_mode: 0,
            modes: Vec::new(),
        }
    }

    /// Does something to each mode of the source, the first of which is this, with what there is of each.
    pub(super) fn with_modes<T>(&mut self, each: impl IntoIterator<Item = T>, mut work: impl FnMut(&mut Self, T)) {
        let mut modes = std::mem::take(&mut self.modes);
        let mut each = each.into_iter();
        each.next().into_iter().for_each(|of_first| work(self, of_first));
        modes.iter_mut().zip(each).for_each(|(mode, of_mode)| work(mode, of_mode));
        self.modes = modes;
    }

    /// Whether the eye moves, or does not see all sub-frames.
    pub(crate) fn moves(&self) -> bool {
        self.moments.frames() > 0
    }

    /// Pixels of its window.
    pub fn count(&self) -> usize {
        self.window.rows * self.window.columns
    }

    /// All modes of the source, the first of which is this.
    pub fn each_mode(&self) -> impl Iterator<Item = &Self> + Clone {
        std::iter::once(self).chain(&self.modes)
    }

    /// How many those are.
    pub fn mode_count(&self) -> usize {
        1 + self.modes.len()
    }

    /// The last of the planner's modes that is among them.
    pub(crate) fn last_source_mode(&self) -> usize {
        self.each_mode().map(|mode| mode.source_mode).max().unwrap_or(0)
    }

    /// One of them.
    pub(crate) fn mode(&self, at: usize) -> &Self {
        at.checked_sub(1).map_or(self, |at| &self.modes[at])
    }

    /// Arguments of `overlap`: the weight in the place of a scale.
    pub(crate) fn overlap_args(&self) -> pass_pupil::Args {
        pass_pupil::Args { scale: self.weight, ..self.pass }
    }

    /// Arguments of `eye`.
    pub(crate) fn eye_args(&self) -> Option<eye::Args> {
        let transfer::Args { rows, columns, .. } = self.transfer;
        self.eye.as_ref().map(|terms| eye::Args { rows, columns, degree: terms.degree })
    }

    /// Arguments of `motion`, from a sub-frame on.
    pub(crate) fn motion_args(&self, first: usize, back: bool) -> Option<motion::Args> {
        let transfer::Args { rows, columns, .. } = self.transfer;
        let frames = self.moments.frames() as u32;
        self.moves().then_some(motion::Args { rows, columns, frames, first: first as u32, back: u32::from(back) })
    }

    /// Bins that it passes, in all modes.
    pub(crate) fn passing(&self) -> u64 {
        self.each_mode().map(Self::passing_itself).sum()
    }

    /// Bins that its own mode passes.
    pub(crate) fn passing_itself(&self) -> u64 {
        self.spans.iter().map(|[first, end]| u64::from(end - first)).sum()
    }

    /// Parts that a shader may leave the loss in: shares of the window, or its rows.
    #[cfg(feature = "vulkan")]
    pub(crate) fn loss_parts(&self) -> usize {
        self.compare.parts().max(self.window.rows)
    }

    /// How large one of its buffers is; no frames for what is no buffer of a pupil pass.
    pub fn extent(&self, resource: Resource, shape: &Shape) -> BufferSize {
        let (frames, values) = match resource {
            Resource::Image | Resource::Target => (1, self.count()),
            Resource::Transfer => (self.mode_count(), self.count()),
            Resource::Window => (self.mode_count() * shape.frames, self.count()),
            Resource::Accumulator => {
                (1, self.shot.as_ref().map_or(0, |s| s.args.height as usize * s.args.width as usize))
            }
            Resource::Sums => (1, exposure::PART * self.exposure(&shape.on_grid()).parts()),
            _ => (0, 0),
        };
        BufferSize { frames, values, complex: resource.is_complex() }
    }

    /// Arguments of `exposure`: the part of its image that is the SLM's, `place` being where that lies in the grid ([`Shape::on_grid`]).
    pub fn exposure(&self, place: &modulate::Args) -> exposure::Args {
        // A window has fewer pixels than the grid: those are taken that lie wholly on the SLM.
        let inside = |first: u32, count: u32, grid: u32, pixels: usize| {
            let scaled = |edge: u32| u64::from(edge) * pixels as u64;
            let (first, end) = (scaled(first).div_ceil(u64::from(grid)), scaled(first + count) / u64::from(grid));
            (first as u32, end.saturating_sub(first) as u32)
        };
        let (top, height) = inside(place.top, place.height, place.grid_height.max(1), self.window.rows);
        let (left, width) = inside(place.left, place.width, place.grid_width.max(1), self.window.columns);
        exposure::Args { height, width, pitch: self.window.columns as u32, top, left }
    }

    /// The columns of its own mode as columns of the grid.
    pub(crate) fn grid_columns(&self) -> Columns {
        let width = self.pass.grid_width as usize;
        Columns { first: (self.pass.x0 as usize + self.columns.first) % width, count: self.columns.count.min(width) }
    }
}
