//! The list of kernels as data.

use super::Storage;
use crate::optics::Window;
use eyebox_kernels::{
    adam, compare, divide_by_overlap, equalise_eyebox, exposure, fft::Columns, intensity, modulate, pass_pupil,
    photograph, project, quantise, resample, transfer,
};
use std::ops::Range;

/// A kernel of the list. Each has a module of its name in `kernels`; the transforms are one kernel over three buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kernel {
    /// Zeroes `Change` and `Hits`.
    Clear,
    /// `Phases`, `Levels` -> `Shown`.
    Quantise,
    /// `Phases`, or `Shown` where the SLM has levels -> `Field`.
    Modulate,
    /// `Field`, forward, in the step's columns.
    FieldForward,
    /// `Field` -> `Energy`.
    Energy,
    /// `Hits` of all pupil passes in the dispatch.
    Overlap,
    /// -> `Transfer`.
    Transfer,
    /// `Transfer` -> `Transfer`, in pupil passes that are tapered.
    Taper,
    /// Views -> `Accumulator`.
    Photograph,
    /// `Accumulator` -> `Target`.
    Resample,
    /// `Field`, `Transfer` -> `Window`.
    PassPupil,
    /// `Window`, inverse, in the pupil pass's columns.
    WindowInverse,
    /// `Window` -> `Image`.
    Intensity,
    /// `Image`, `Target` -> `Image` (factor), loss.
    Compare,
    /// `Image` (factor), `Window` -> `Window`.
    ApplyFactor,
    /// `Window`, forward, in the pupil pass's columns.
    WindowForward,
    /// `Window`, `Transfer` of all pupil passes in the dispatch, in their order -> `Change`.
    ReturnPupil,
    /// `Hits`, `Change` -> `Change`.
    DivideByOverlap,
    /// `Energy`, `Field` -> `Change`.
    EqualiseEyebox,
    /// `Change`, inverse, in the step's columns.
    ChangeInverse,
    /// `Change`: makes all losses NaN if a value of it is NaN or infinite, so that the step is not taken. Where fields
    /// are stored as halves.
    CheckFinite,
    /// `Change` -> `Phases`, `Momentum`.
    Project,
    /// `Change` -> `Phases`, `Momentum`, `Second`.
    Adam,
    /// `Image`, `Target` -> `Sums`.
    Exposure,
}

/// What a kernel runs over; neighbours of one scope may run frame by frame, or pupil pass by pupil pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Each sub-frame by itself.
    Frames,
    /// Each pupil by itself, all sub-frames.
    PupilPasses,
    /// Once.
    Whole,
}

impl Kernel {
    /// All of them.
    pub const ALL: [Self; 24] = [
        Self::Clear,
        Self::Quantise,
        Self::Modulate,
        Self::FieldForward,
        Self::Energy,
        Self::Overlap,
        Self::Transfer,
        Self::Taper,
        Self::Photograph,
        Self::Resample,
        Self::PassPupil,
        Self::WindowInverse,
        Self::Intensity,
        Self::Compare,
        Self::ApplyFactor,
        Self::WindowForward,
        Self::ReturnPupil,
        Self::DivideByOverlap,
        Self::EqualiseEyebox,
        Self::ChangeInverse,
        Self::CheckFinite,
        Self::Project,
        Self::Adam,
        Self::Exposure,
    ];

    /// The name by which it is timed and chosen.
    pub fn name(self) -> &'static str {
        [
            "clear",
            "quantise",
            "modulate",
            "field_forward",
            "energy",
            "overlap",
            "transfer",
            "taper",
            "photograph",
            "resample",
            "pass_pupil",
            "window_inverse",
            "intensity",
            "compare",
            "apply_factor",
            "window_forward",
            "return_pupil",
            "divide_by_overlap",
            "equalise_eyebox",
            "change_inverse",
            "check_finite",
            "project",
            "adam",
            "exposure",
        ][self as usize]
    }

    /// The kernel of this name, or of the name that it had before.
    pub fn by_name(name: &str) -> Option<Self> {
        let before = [
            ("weigh", "apply_factor"),
            ("guard", "check_finite"),
            ("balance", "divide_by_overlap"),
            ("even", "equalise_eyebox"),
        ];
        let name = before.iter().find(|(old, _)| *old == name).map_or(name, |(_, new)| new);
        Self::ALL.into_iter().find(|k| k.name() == name)
    }

    /// What it runs over.
    pub fn scope(self) -> Scope {
        match self {
            Self::Clear | Self::Energy | Self::Overlap | Self::CheckFinite => Scope::Whole,
            Self::Quantise
            | Self::Modulate
            | Self::FieldForward
            | Self::ReturnPupil
            | Self::DivideByOverlap
            | Self::EqualiseEyebox
            | Self::ChangeInverse
            | Self::Project
            | Self::Adam => Scope::Frames,
            _ => Scope::PupilPasses,
        }
    }
}

/// A buffer. Pupil pass buffers are named by their slot: the pupil pass's place in its dispatch's range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Buffer {
    /// Phases, radians: (frames, height, width).
    Phases,
    /// The levels nearest to them, which the SLM shows: (frames, height, width).
    Shown,
    /// Phases of the levels, ascending: `quantise::MOST`, of which the first are used.
    Levels,
    /// The projection's velocity, Adam's first moment: (frames, height, width).
    Momentum,
    /// Adam's second moment: (frames, height, width).
    Second,
    /// The field, then its spectrum: complex (frames, grid height, grid width).
    Field,
    /// The change of the spectrum, then of the field: complex (frames, grid height, grid width).
    Change,
    /// How many pupils pass each bin: (grid height, grid width).
    Hits,
    /// Light per patch of the eyebox: `energy::MOST` squared, of which the first `patches` squared are used.
    Energy,
    /// K on the window: complex (rows, columns).
    Transfer(usize),
    /// The retinal fields: complex (frames, rows, columns).
    Window(usize),
    /// The intensity, then the factor: (rows, columns).
    Image(usize),
    /// The photograph: (rows, columns).
    Target(usize),
    /// The photograph on its level of the pyramid.
    Accumulator(usize),
    /// What `exposure` sums: (parts, 6).
    Sums(usize),
}

/// What the buffers are for: those that a purpose does not need are not made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Views and photographs only.
    View,
    /// The projection: `Change`, `Hits`, `Momentum`.
    Project,
    /// Adam: `Change`, `Momentum`, `Second`.
    Adam,
}

/// Sizes of all buffers that are not a pupil pass's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Sub-frames.
    pub frames: usize,
    /// SLM and grid; equal but for padding.
    pub place: modulate::Args,
    /// Which buffers are needed.
    pub purpose: Purpose,
    /// Whether the SLM has levels: `Shown` and `Levels`.
    pub quantised: bool,
    /// How `Field`, `Change` and `Window` are stored, each times a power of two that suits it: what an engine reads and
    /// writes is what these buffers hold.
    pub storage: Storage,
}

impl Shape {
    /// Pixels of one sub-frame on the SLM.
    pub fn pixels(&self) -> usize {
        self.place.height as usize * self.place.width as usize
    }

    /// What `modulate` multiplies the field by.
    pub fn field_scale(&self) -> f32 {
        self.storage.field_scale(self.points()) as f32
    }

    /// Points of the grid.
    pub fn points(&self) -> usize {
        self.place.grid_height as usize * self.place.grid_width as usize
    }
}

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
    pub rows: resample::Table,
    /// Weights along columns.
    pub columns: resample::Table,
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
    /// Weights of `taper`: those of all rows, then those of all columns. None for an aperture with a sharp edge.
    pub taper: Option<Vec<f32>>,
    /// Arguments of `pass_pupil` and `overlap`.
    pub pass: pass_pupil::Args,
    /// Arguments of `return_pupil`: the same place, another scale.
    pub back: pass_pupil::Args,
    /// Columns of the window that any span touches.
    pub columns: Columns,
    /// Arguments of `intensity`.
    pub intensity: intensity::Args,
    /// Arguments of `compare`.
    pub compare: compare::Args,
    /// The photograph; none where only the wave is looked at.
    pub shot: Option<Shot>,
}

impl PupilPass {
    /// Pixels of its window.
    pub fn count(&self) -> usize {
        self.window.rows * self.window.columns
    }

    /// Arguments of `exposure`: the part of its image that is the SLM's, `place` being where that lies in the grid.
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

    /// Its columns as columns of the grid.
    pub fn grid_columns(&self) -> Columns {
        let width = self.pass.grid_width as usize;
        Columns { first: (self.pass.x0 as usize + self.columns.first) % width, count: self.columns.count.min(width) }
    }
}

/// One entry of the list.
#[derive(Debug, Clone, PartialEq)]
pub struct Dispatch {
    /// Which kernel.
    pub kernel: Kernel,
    /// Over which pupil passes, where the kernel looks at pupil passes. Pupil pass `i` uses slot `i - pupil_passes.start`.
    pub pupil_passes: Range<usize>,
}

/// A list and its arguments: one step of a solve, or a look at a hologram.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// The kernels, in order.
    pub list: Vec<Dispatch>,
    /// The pupils.
    pub pupil_passes: Vec<PupilPass>,
    /// Columns of the spectrum that any pupil passes.
    pub columns: Columns,
    /// Arguments of `quantise`; no levels where any phase can be shown.
    pub quantise: quantise::Args,
    /// Arguments of `divide_by_overlap`.
    pub divide_by_overlap: divide_by_overlap::Args,
    /// Arguments of `equalise_eyebox`, and, inside, of `energy`.
    pub equalise_eyebox: equalise_eyebox::Args,
    /// Arguments of `project`.
    pub project: project::Args,
    /// Arguments of `adam`.
    pub adam: adam::Args,
}

/// Time spent in one kernel. On the CPU, the sum over threads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Which.
    pub kernel: Kernel,
    /// How often it ran (per frame or pupil pass on the CPU).
    pub calls: u64,
    /// Seconds in all.
    pub seconds: f64,
}
