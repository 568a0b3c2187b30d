//! The buffers of a list as data: what kernels read and write, and how large it is.

use super::Storage;
use crate::optics::Window;
use eyebox_kernels::{
    compare, energy, exposure, fft::Columns, intensity, modulate, pass_pupil, photograph, quantise, resample, transfer,
};
use std::sync::Arc;

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
    /// Pairs of sub-frames between their phases and the field: complex (frames / 2, grid height, grid width).
    Wave,
    /// Of each pixel its look-up table's level, the source's amplitude, real and imaginary part of the undiffracted light:
    /// (4, height, width). An engine fills it from the step's model, as the two that follow.
    Pixels,
    /// The transfer of the crosstalk's kernel: (grid height) along y and (grid width) along x, each (re, im).
    Crosstalk,
    /// What the pixels' aperture and the relay do to each bin: (grid height, grid width), each (re, im).
    Relay,
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

impl Buffer {
    /// What it is as a resource, and its slot where it is a pupil pass's.
    pub fn resource(self) -> (Resource, Option<usize>) {
        match self {
            Self::Phases => (Resource::Phases, None),
            Self::Shown => (Resource::Shown, None),
            Self::Levels => (Resource::Levels, None),
            Self::Momentum => (Resource::Momentum, None),
            Self::Second => (Resource::Second, None),
            Self::Field => (Resource::Field, None),
            Self::Change => (Resource::Change, None),
            Self::Hits => (Resource::Hits, None),
            Self::Energy => (Resource::Energy, None),
            Self::Wave => (Resource::Wave, None),
            Self::Pixels => (Resource::Pixels, None),
            Self::Crosstalk => (Resource::Crosstalk, None),
            Self::Relay => (Resource::Relay, None),
            Self::Transfer(slot) => (Resource::Transfer, Some(slot)),
            Self::Window(slot) => (Resource::Window, Some(slot)),
            Self::Image(slot) => (Resource::Image, Some(slot)),
            Self::Target(slot) => (Resource::Target, Some(slot)),
            Self::Accumulator(slot) => (Resource::Accumulator, Some(slot)),
            Self::Sums(slot) => (Resource::Sums, Some(slot)),
        }
    }
}

/// What kernels are bound to: buffers, of whatever slot, and what comes with a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Resource {
    /// [`Buffer::Phases`].
    Phases,
    /// [`Buffer::Shown`]; the phases themselves where the SLM has no levels.
    Shown,
    /// [`Buffer::Levels`].
    Levels,
    /// [`Buffer::Momentum`].
    Momentum,
    /// [`Buffer::Second`].
    Second,
    /// [`Buffer::Field`].
    Field,
    /// [`Buffer::Change`].
    Change,
    /// [`Buffer::Hits`].
    Hits,
    /// [`Buffer::Energy`].
    Energy,
    /// [`Buffer::Wave`].
    Wave,
    /// [`Buffer::Pixels`].
    Pixels,
    /// [`Buffer::Crosstalk`].
    Crosstalk,
    /// [`Buffer::Relay`].
    Relay,
    /// [`Buffer::Transfer`].
    Transfer,
    /// [`Buffer::Window`].
    Window,
    /// [`Buffer::Image`].
    Image,
    /// [`Buffer::Target`].
    Target,
    /// [`Buffer::Accumulator`].
    Accumulator,
    /// [`Buffer::Sums`].
    Sums,
    /// The pupil pass's spans.
    Spans,
    /// Its weights of `taper`.
    TaperWeights,
    /// The light field's views.
    Views,
    /// Those that the pupil covers.
    Taps,
    /// Weights of `resample` along rows.
    RowWeights,
    /// And along columns.
    ColumnWeights,
    /// The loss of the pupil pass.
    Losses,
    /// Whether a value is infinite or NaN.
    NotFinite,
}

impl Resource {
    /// Those that are buffers of the shape.
    pub const OF_SHAPE: [Self; 13] = [
        Self::Phases,
        Self::Shown,
        Self::Levels,
        Self::Momentum,
        Self::Second,
        Self::Field,
        Self::Change,
        Self::Hits,
        Self::Energy,
        Self::Wave,
        Self::Pixels,
        Self::Crosstalk,
        Self::Relay,
    ];

    /// Those that are buffers of a slot.
    pub const OF_SLOT: [Self; 6] =
        [Self::Transfer, Self::Window, Self::Image, Self::Target, Self::Accumulator, Self::Sums];

    /// The buffer, of this slot where it is a pupil pass's; none for what comes with a step or is its answer.
    pub fn buffer(self, slot: usize) -> Option<Buffer> {
        Some(match self {
            Self::Phases => Buffer::Phases,
            Self::Shown => Buffer::Shown,
            Self::Levels => Buffer::Levels,
            Self::Momentum => Buffer::Momentum,
            Self::Second => Buffer::Second,
            Self::Field => Buffer::Field,
            Self::Change => Buffer::Change,
            Self::Hits => Buffer::Hits,
            Self::Energy => Buffer::Energy,
            Self::Wave => Buffer::Wave,
            Self::Pixels => Buffer::Pixels,
            Self::Crosstalk => Buffer::Crosstalk,
            Self::Relay => Buffer::Relay,
            Self::Transfer => Buffer::Transfer(slot),
            Self::Window => Buffer::Window(slot),
            Self::Image => Buffer::Image(slot),
            Self::Target => Buffer::Target(slot),
            Self::Accumulator => Buffer::Accumulator(slot),
            Self::Sums => Buffer::Sums(slot),
            _ => return None,
        })
    }

    /// How its complex values are stored: phases that are on their way to the field as float32 always, as is what is read
    /// beside a window.
    pub(crate) fn stored(self, storage: Storage) -> Storage {
        if matches!(self, Self::Wave | Self::Transfer) { Storage::F32 } else { storage }
    }

    /// As messages call it.
    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Whether it is a buffer of the shape.
    pub(crate) fn is_shared(self) -> bool {
        Self::OF_SHAPE.contains(&self)
    }

    /// Whether each pupil pass has its own.
    pub(crate) fn is_per_pupil(self) -> bool {
        !self.is_shared() && self != Self::NotFinite
    }

    /// What each sub-frame has of it, if it has one of its own.
    pub fn per_frame(self) -> Option<PerFrame> {
        match self {
            Self::Phases | Self::Shown | Self::Momentum | Self::Second => Some(PerFrame::Pixels),
            Self::Field | Self::Change => Some(PerFrame::Grid),
            Self::Window => Some(PerFrame::Window),
            _ => None,
        }
    }
}

/// Kinds of frames: those of a kind are equally large.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PerFrame {
    /// Of the SLM's pixels.
    Pixels,
    /// Of the grid.
    Grid,
    /// Of a pupil pass's window.
    Window,
}

/// How large a buffer is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// Frames; none where the buffer is not needed.
    pub frames: usize,
    /// Values of a frame.
    pub values: usize,
    /// Whether a value is two numbers.
    pub complex: bool,
}

impl Extent {
    /// Numbers in all.
    pub fn floats(self) -> usize {
        self.frames * self.values * if self.complex { 2 } else { 1 }
    }
}

/// What of a display's model needs buffers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ModelParts {
    /// What stands between phases and field: look-up table, lag, crosstalk, source, undiffracted light.
    pub drives: bool,
    /// Crosstalk.
    pub crosstalk: bool,
    /// Factors on the bins: the pixels' aperture, the relay's wavefront.
    pub relay: bool,
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
    /// Whether phases are stored as [binary angles](eyebox_kernels::binary_angle), 16 bits of a turn, and velocities as halves.
    pub binary_angles: bool,
    /// What of the display's model needs buffers.
    pub model: ModelParts,
}

impl Shape {
    /// That of nothing: what an engine has before it is loaded.
    pub(crate) fn empty() -> Self {
        let place = bytemuck::Zeroable::zeroed();
        let (purpose, storage, model) = (Purpose::View, Storage::F32, ModelParts::default());
        Self { frames: 0, place, purpose, quantised: false, storage, binary_angles: false, model }
    }

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

    /// Whether complex fields are stored as halves.
    pub fn halves(&self) -> bool {
        self.storage == Storage::F16
    }

    /// Bytes of a number on a device, of buffers that are not complex.
    #[cfg(feature = "vulkan")]
    pub(crate) fn real_bytes(&self, resource: Resource) -> u64 {
        let short = self.binary_angles && resource.per_frame() == Some(PerFrame::Pixels);
        if short { 2 } else { 4 }
    }

    /// How large a buffer of the shape is; no frames where the purpose does not need it.
    pub fn extent(&self, resource: Resource) -> Extent {
        let (frames, values) = match resource {
            Resource::Levels => (1, quantise::MOST),
            Resource::Hits => (1, self.points()),
            Resource::Energy => (1, (energy::MOST * energy::MOST) as usize),
            Resource::Field | Resource::Change => (self.frames, self.points()),
            Resource::Wave => (self.frames.div_ceil(2), self.points()),
            Resource::Pixels => (1, 4 * self.pixels()),
            Resource::Crosstalk => (1, 2 * (self.place.grid_height + self.place.grid_width) as usize),
            Resource::Relay => (1, 2 * self.points()),
            _ => (self.frames, self.pixels()),
        };
        let complex = matches!(resource, Resource::Field | Resource::Change | Resource::Wave);
        Extent { frames: if self.has(resource) { frames } else { 0 }, values, complex }
    }

    /// Whether it is a buffer that this shape has.
    fn has(&self, resource: Resource) -> bool {
        match resource {
            Resource::Phases | Resource::Field => true,
            Resource::Shown | Resource::Levels => self.quantised,
            Resource::Momentum | Resource::Change | Resource::Hits | Resource::Energy => self.purpose != Purpose::View,
            Resource::Second => self.purpose == Purpose::Adam,
            Resource::Wave | Resource::Pixels => self.model.drives,
            Resource::Crosstalk => self.model.crosstalk,
            Resource::Relay => self.model.relay,
            _ => false,
        }
    }

    /// The buffers that this shape has.
    pub fn buffers(&self) -> impl Iterator<Item = Buffer> {
        Resource::OF_SHAPE.into_iter().filter(|r| self.has(*r)).filter_map(|resource| resource.buffer(0))
    }

    /// Whether a kernel can be bound to this: `Shown` always, for it is `Phases` where the SLM has no levels.
    pub fn provides(&self, resource: Resource) -> bool {
        !resource.is_shared() || resource == Resource::Shown || self.has(resource)
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

    /// Bins that it passes.
    pub(crate) fn passing(&self) -> u64 {
        self.spans.iter().map(|[first, end]| u64::from(end - first)).sum()
    }

    /// Parts that a shader may leave the loss in: shares of the window, or its rows.
    #[cfg(feature = "vulkan")]
    pub(crate) fn loss_parts(&self) -> usize {
        self.compare.parts().max(self.window.rows)
    }

    /// How large one of its buffers is; no frames for what is no buffer of a pupil pass.
    pub fn extent(&self, resource: Resource, shape: &Shape) -> Extent {
        let (frames, values) = match resource {
            Resource::Transfer | Resource::Image | Resource::Target => (1, self.count()),
            Resource::Window => (shape.frames, self.count()),
            Resource::Accumulator => {
                (1, self.shot.as_ref().map_or(0, |s| s.args.height as usize * s.args.width as usize))
            }
            Resource::Sums => (1, exposure::PART * self.exposure(&shape.place).parts()),
            _ => (0, 0),
        };
        Extent { frames, values, complex: matches!(resource, Resource::Transfer | Resource::Window) }
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
    pub(crate) fn grid_columns(&self) -> Columns {
        let width = self.pass.grid_width as usize;
        Columns { first: (self.pass.x0 as usize + self.columns.first) % width, count: self.columns.count.min(width) }
    }
}
