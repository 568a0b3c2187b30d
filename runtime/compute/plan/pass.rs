//! Holds the data of one pupil.

use super::list::{BufferSize, Resource, Shape};
use crate::optics::Window;
use bytemuck::Zeroable;
use eyebox_kernels::{
    compare, exposure, eye, fft::Columns, intensity, modulate, motion, pass_pupil, photograph, resample, transfer,
};
use std::sync::Arc;

/// The target image of one pupil pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// Level of the pyramid.
    pub level: usize,
    /// Arguments of kernel `photograph`.
    pub args: photograph::Args,
    /// The views that the pupil covers.
    pub taps: Vec<photograph::Tap>,
    /// Arguments of kernel `resample`.
    pub resample: resample::Args,
    /// Weights of `resample` along rows.
    pub rows: Arc<resample::Table>,
    /// Weights of `resample` along columns.
    pub columns: Arc<resample::Table>,
}

/// The data of one pupil.
#[derive(Debug, Clone, PartialEq)]
pub struct PupilPass {
    /// The spectral window, signed bins.
    pub window: Window,
    /// For each row of the window the columns that pass, first and end.
    pub spans: Vec<[u32; 2]>,
    /// Arguments of kernel `transfer`.
    pub transfer: transfer::Args,
    /// Factors of the kernel `eye`, if the eye is imperfect.
    pub eye: Option<eye::Terms>,
    /// Weights of `taper`, for all rows and then all columns. There are none for an aperture with a sharp edge.
    pub taper: Option<Vec<f32>>,
    /// Action of `motion` on each sub-frame. It is empty unless the eye moves or misses some sub-frames.
    pub moments: motion::Table,
    /// Arguments of `pass_pupil` and `overlap`.
    pub pass: pass_pupil::Args,
    /// Arguments of `pupil_adjoint`, with the same place and another scale.
    pub back: pass_pupil::Args,
    /// Columns of the window that any span touches.
    pub columns: Columns,
    /// Arguments of kernel `intensity`.
    pub intensity: intensity::Args,
    /// Arguments of kernel `compare`.
    pub compare: compare::Args,
    /// The target image, if one is needed besides the wave.
    pub shot: Option<Shot>,
    /// Share of the source's light in its own mode, 1 for a single mode.
    pub weight: f32,
    /// Index of its own mode in the planner's modes, 0 for a laser on the axis.
    pub source_mode: usize,
    /// Further modes of the source (OPTICS 12), as windows of the same size whose intensities add to this one's. They
    /// have no target image and no further modes.
    pub modes: Vec<PupilPass>,
}

impl PupilPass {
    /// Makes an empty pass, which is filled later.
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

    /// Runs `work` on each mode of the source, the first of which is this pass, with its item of `each`.
    pub(super) fn with_modes<T>(&mut self, each: impl IntoIterator<Item = T>, mut work: impl FnMut(&mut Self, T)) {
        let mut modes = std::mem::take(&mut self.modes);
        let mut each = each.into_iter();
        each.next().into_iter().for_each(|of_first| work(self, of_first));
        modes.iter_mut().zip(each).for_each(|(mode, of_mode)| work(mode, of_mode));
        self.modes = modes;
    }

    /// Returns true if the eye moves or misses some sub-frames.
    pub(crate) fn moves(&self) -> bool {
        self.moments.frames() > 0
    }

    /// Returns the pixels of its window.
    pub fn count(&self) -> usize {
        self.window.rows * self.window.columns
    }

    /// Returns all modes of the source, the first of which is this pass.
    pub fn each_mode(&self) -> impl Iterator<Item = &Self> + Clone {
        std::iter::once(self).chain(&self.modes)
    }

    /// Returns the number of modes.
    pub fn mode_count(&self) -> usize {
        1 + self.modes.len()
    }

    /// Returns the highest index of its modes in the planner's modes.
    pub(crate) fn last_source_mode(&self) -> usize {
        self.each_mode().map(|mode| mode.source_mode).max().unwrap_or(0)
    }

    /// Returns one of the modes.
    pub(crate) fn mode(&self, at: usize) -> &Self {
        at.checked_sub(1).map_or(self, |at| &self.modes[at])
    }

    /// Returns the arguments of `overlap`, which have the weight as their scale.
    pub(crate) fn overlap_args(&self) -> pass_pupil::Args {
        pass_pupil::Args { scale: self.weight, ..self.pass }
    }

    /// Returns the arguments of `eye`.
    pub(crate) fn eye_args(&self) -> Option<eye::Args> {
        let transfer::Args { rows, columns, .. } = self.transfer;
        self.eye.as_ref().map(|terms| eye::Args { rows, columns, degree: terms.degree })
    }

    /// Returns the arguments of `motion`, from sub-frame `first` on.
    pub(crate) fn motion_args(&self, first: usize, back: bool) -> Option<motion::Args> {
        let transfer::Args { rows, columns, .. } = self.transfer;
        let frames = self.moments.frames() as u32;
        self.moves().then_some(motion::Args { rows, columns, frames, first: first as u32, back: u32::from(back) })
    }

    /// Returns the bins that it passes, in all modes.
    pub(crate) fn passing(&self) -> u64 {
        self.each_mode().map(Self::passing_itself).sum()
    }

    /// Returns the bins that its own mode passes.
    pub(crate) fn passing_itself(&self) -> u64 {
        self.spans.iter().map(|[first, end]| u64::from(end - first)).sum()
    }

    /// Returns the number of parts in which a shader may leave the loss, which are shares of the window or its rows.
    #[cfg(feature = "vulkan")]
    pub(crate) fn loss_parts(&self) -> usize {
        self.compare.parts().max(self.window.rows)
    }

    /// Returns the size of one of its buffers, with no frames for a resource that is no buffer of a pupil pass.
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

    /// Returns the arguments of `exposure` for the SLM's part of its image. `place` is the SLM's place in the grid
    /// ([`Shape::on_grid`]).
    pub fn exposure(&self, place: &modulate::Args) -> exposure::Args {
        // A window has fewer pixels than the grid. Only pixels that are entirely on the SLM count.
        let inside = |first: u32, count: u32, grid: u32, pixels: usize| {
            let scaled = |edge: u32| u64::from(edge) * pixels as u64;
            let (first, end) = (scaled(first).div_ceil(u64::from(grid)), scaled(first + count) / u64::from(grid));
            (first as u32, end.saturating_sub(first) as u32)
        };
        let (top, height) = inside(place.top, place.height, place.grid_height.max(1), self.window.rows);
        let (left, width) = inside(place.left, place.width, place.grid_width.max(1), self.window.columns);
        exposure::Args { height, width, pitch: self.window.columns as u32, top, left }
    }

    /// Returns the columns of its own mode as columns of the grid.
    pub(crate) fn grid_columns(&self) -> Columns {
        let width = self.pass.grid_width as usize;
        Columns { first: (self.pass.x0 as usize + self.columns.first) % width, count: self.columns.count.min(width) }
    }
}
