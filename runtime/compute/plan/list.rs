//! Describes the buffers of a list as data, with their values and sizes.

use super::Storage;
use eyebox_kernels::{crosstalk, energy, modulate, multiply, quantise};

/// A buffer. Buffers of a pupil pass are named by their slot, the index of the pupil pass in its dispatch's range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Buffer {
    /// Phases, radians: (frames, height, width).
    Phases,
    /// The nearest levels to the phases, which the SLM shows: (frames, height, width).
    Shown,
    /// Phases of the levels, ascending, `quantise::MOST` values of which the first are used.
    Levels,
    /// The projection's velocity or Adam's first moment: (frames, height, width).
    Momentum,
    /// Adam's second moment: (frames, height, width).
    Second,
    /// The field, then its spectrum, complex: (frames, grid height, grid width).
    Field,
    /// The change of the spectrum, then of the field, complex: (frames, grid height, grid width).
    Change,
    /// Number of pupils that pass each bin: (grid height, grid width).
    Hits,
    /// Light per patch of the eyebox, `energy::MOST` squared, of which the first `patches` squared are used.
    Energy,
    /// Phases of each sub-pixel between a drive and the field, and their wanted changes on the way back: (frames,
    /// sub-pixels along y, along x, height, width). Drives, one per pixel, use the plane of the first sub-pixel.
    Wave,
    /// The same values between crosstalk along x and along y: (frames, sub-pixels along x, height, width).
    Blurred,
    /// The field of each sub-pixel, if a pixel has several, then its spectrum, complex: (frames, sub-pixels along y,
    /// along x, grid height, grid width).
    Subpixels,
    /// For each pixel the level of its look-up table, the source's amplitude, and the real and imaginary part of the
    /// zero order: (4, height, width). An engine fills it from the step's model, like the two buffers that follow.
    Pixels,
    /// Weights of crosstalk, along y and along x: (sub-pixels, 2 reach + 1).
    Crosstalk,
    /// Factors by which the place of each sub-pixel moves the spectrum: (sub-pixels, grid height) along y,
    /// (sub-pixels, grid width) along x, each (re, im).
    Offsets,
    /// Factors of the pixels' aperture and the relay for each bin: (modes, grid height, grid width), each (re, im).
    Relay,
    /// The static mask, (rows, columns) of its pixels over the SLM, each (re, im).
    Mask,
    /// Propagation from the SLM to a distant mask: (grid height, grid width), each (re, im).
    MaskTransfer,
    /// The transfer function K on the spectral window, complex: (modes, rows, columns).
    Transfer(usize),
    /// The retinal fields, complex: (modes, frames, rows, columns).
    Window(usize),
    /// The intensity, then the factor: (rows, columns).
    Image(usize),
    /// The target image: (rows, columns).
    Target(usize),
    /// The target image at its pyramid level.
    Accumulator(usize),
    /// Partial sums of `exposure`: (parts, 6).
    Sums(usize),
}

/// Pairs buffers with the resources of the same name, for buffers of the shape and of a slot.
macro_rules! buffers {
    (shape: $($shared:ident)*; slot: $($own:ident)*) => {
        impl Buffer {
            /// Returns the buffer as a resource, with its slot if it belongs to a pupil pass.
            pub fn resource(self) -> (Resource, Option<usize>) {
                match self {
                    $(Self::$shared => (Resource::$shared, None),)*
                    $(Self::$own(slot) => (Resource::$own, Some(slot)),)*
                }
            }
        }

        impl Resource {
            /// The buffers of the shape.
            pub const OF_SHAPE: [Self; 18] = [$(Self::$shared),*];

            /// The buffers of a slot.
            pub const OF_SLOT: [Self; 6] = [$(Self::$own),*];

            /// Returns the buffer, with this slot if it belongs to a pupil pass. Resources that come with a step or
            /// return from it have no buffer.
            pub fn buffer(self, slot: usize) -> Option<Buffer> {
                match self {
                    $(Self::$shared => Some(Buffer::$shared),)*
                    $(Self::$own => Some(Buffer::$own(slot)),)*
                    _ => None,
                }
            }
        }
    };
}

buffers! {
    shape: Phases Shown Levels Momentum Second Field Change Hits Energy Wave Blurred Subpixels Pixels Crosstalk Offsets Relay Mask MaskTransfer;
    slot: Transfer Window Image Target Accumulator Sums
}

/// A binding of a kernel, to a buffer of any slot or to data that comes with a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Resource {
    /// A binding of [`Buffer::Phases`].
    Phases,
    /// [`Buffer::Shown`], or the phases if the SLM has no levels.
    Shown,
    /// A binding of [`Buffer::Levels`].
    Levels,
    /// A binding of [`Buffer::Momentum`].
    Momentum,
    /// A binding of [`Buffer::Second`].
    Second,
    /// A binding of [`Buffer::Field`].
    Field,
    /// A binding of [`Buffer::Change`].
    Change,
    /// A binding of [`Buffer::Hits`].
    Hits,
    /// A binding of [`Buffer::Energy`].
    Energy,
    /// A binding of [`Buffer::Wave`].
    Wave,
    /// A binding of [`Buffer::Blurred`].
    Blurred,
    /// A binding of [`Buffer::Subpixels`].
    Subpixels,
    /// A binding of [`Buffer::Pixels`].
    Pixels,
    /// A binding of [`Buffer::Crosstalk`].
    Crosstalk,
    /// A binding of [`Buffer::Offsets`].
    Offsets,
    /// A binding of [`Buffer::Relay`].
    Relay,
    /// A binding of [`Buffer::Mask`].
    Mask,
    /// A binding of [`Buffer::MaskTransfer`].
    MaskTransfer,
    /// A binding of [`Buffer::Transfer`].
    Transfer,
    /// A binding of [`Buffer::Window`].
    Window,
    /// A binding of [`Buffer::Image`].
    Image,
    /// A binding of [`Buffer::Target`].
    Target,
    /// A binding of [`Buffer::Accumulator`].
    Accumulator,
    /// A binding of [`Buffer::Sums`].
    Sums,
    /// The spans of the pupil pass.
    Spans,
    /// The polynomial of the pupil pass's eye.
    EyeTerms,
    /// The weights of `taper` of the pupil pass.
    TaperWeights,
    /// The shift of each sub-frame of the pupil pass.
    Moments,
    /// The views of the light field.
    Views,
    /// The views that the pupil covers.
    Taps,
    /// Weights of `resample` along rows.
    RowWeights,
    /// Weights of `resample` along columns.
    ColumnWeights,
    /// The loss of the pupil pass.
    Losses,
    /// Flag that is set if a value is infinite or NaN.
    NotFinite,
}

impl Resource {
    /// Returns true if a value is two numbers.
    pub(crate) fn is_complex(self) -> bool {
        matches!(self, Self::Field | Self::Change | Self::Subpixels | Self::Transfer | Self::Window)
    }

    /// Returns the storage of its complex values. The transfer function next to a window is always read as float32.
    pub(crate) fn stored(self, storage: Storage) -> Storage {
        if self == Self::Transfer { Storage::F32 } else { storage }
    }

    /// Returns the number of axes along which each sub-frame has a plane per sub-pixel.
    pub(crate) fn axes_of_subpixels(self) -> u32 {
        match self {
            Self::Wave | Self::Subpixels => 2,
            Self::Blurred => 1,
            _ => 0,
        }
    }

    /// Returns the name for messages.
    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Returns true if it is a buffer of the shape.
    pub fn is_shared(self) -> bool {
        Self::OF_SHAPE.contains(&self)
    }

    /// Returns true if each pupil pass has its own.
    pub(crate) fn is_per_pupil(self) -> bool {
        !self.is_shared() && self != Self::NotFinite
    }

    /// Returns the kind of frame that it has for each sub-frame, if any.
    pub fn per_frame(self) -> Option<PerFrame> {
        match self {
            Self::Phases | Self::Shown | Self::Momentum | Self::Second => Some(PerFrame::Pixels),
            Self::Field | Self::Change => Some(PerFrame::Grid),
            Self::Window => Some(PerFrame::Window),
            _ => None,
        }
    }
}

/// The kinds of frames. All frames of a kind have one size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PerFrame {
    /// A frame of the SLM's pixels.
    Pixels,
    /// A frame of the grid's points.
    Grid,
    /// A frame of the spectral window of a pupil pass.
    Window,
}

/// The size of a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BufferSize {
    /// Number of frames, 0 if the buffer is not needed.
    pub frames: usize,
    /// Values of a frame.
    pub values: usize,
    /// True if a value is two numbers.
    pub complex: bool,
}

impl BufferSize {
    /// Returns the total count of numbers.
    pub fn floats(self) -> usize {
        self.frames * self.values * if self.complex { 2 } else { 1 }
    }
}

/// The parts of a display's model that need buffers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ModelParts {
    /// True if something is between phases and field (look-up table, lag, crosstalk, source or zero order).
    pub drives: bool,
    /// Pixels that crosstalk reaches along y and along x, or none without crosstalk.
    pub crosstalk: Option<[usize; 2]>,
    /// Sub-pixels of a pixel along an axis, beyond the first.
    pub more_subpixels: usize,
    /// Number of tables with the pixels' aperture and the relay's wavefront as factors on the bins. It is one per
    /// mode of the source, or 0.
    pub relay: usize,
    /// Pixels of a static mask along an axis of one pixel of the SLM, or 0 without a mask.
    pub mask: usize,
    /// True if that mask is at a distance from the SLM.
    pub mask_away: bool,
}

/// The purpose of the buffers. An engine makes only the buffers that a purpose needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Views and target images only.
    View,
    /// The projection, with `Change`, `Hits` and `Momentum`.
    Project,
    /// Adam, with `Change`, `Momentum` and `Second`.
    Adam,
}

/// Sizes of all buffers that belong to no pupil pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Number of sub-frames in memory.
    pub frames: usize,
    /// SLM and grid, which are equal without padding.
    pub place: modulate::Args,
    /// The buffers that are needed.
    pub purpose: Purpose,
    /// True if the SLM has levels, which need `Shown` and `Levels`.
    pub quantised: bool,
    /// Storage of `Field`, `Change` and `Window`, each scaled by a suitable power of two. An engine's reads and
    /// writes of these buffers carry that scale.
    pub storage: Storage,
    /// True if phases are stored as [binary angles](eyebox_kernels::binary_angle), 16 bits per turn, and velocities
    /// as halves.
    pub binary_angles: bool,
    /// The parts of the display's model that need buffers.
    pub model: ModelParts,
}

impl Shape {
    /// Returns the shape of an engine before it is loaded.
    pub fn empty() -> Self {
        let place = bytemuck::Zeroable::zeroed();
        let (purpose, storage, model) = (Purpose::View, Storage::F32, ModelParts::default());
        Self { frames: 0, place, purpose, quantised: false, storage, binary_angles: false, model }
    }

    /// Returns the pixels of one sub-frame on the SLM.
    pub fn pixels(&self) -> usize {
        self.place.height as usize * self.place.width as usize
    }

    /// Returns the place of the SLM in the grid, in pixels of the grid. Pixels of a mask are smaller than the SLM's.
    pub fn on_grid(&self) -> modulate::Args {
        let finer = self.model.mask.max(1) as u32;
        modulate::Args { height: finer * self.place.height, width: finer * self.place.width, ..self.place }
    }

    /// Returns the arguments of `multiply` by the phases of a mask at a distance, and by the propagation to it. Each
    /// has the root of the factor of two transforms, so that halves stay in range.
    pub(crate) fn mask_factors(&self, back: bool) -> [multiply::Args; 2] {
        let modulate::Args { height, width, grid_height, grid_width, top, left } = self.on_grid();
        let (conjugate, scale) = (u32::from(back), (self.points() as f32).sqrt().recip());
        let mask =
            multiply::Args { rows: height, columns: width, grid_height, grid_width, top, left, conjugate, scale };
        [mask, multiply::Args { rows: grid_height, columns: grid_width, top: 0, left: 0, ..mask }]
    }

    /// Returns the factor by which `modulate` scales the field.
    pub fn field_scale(&self) -> f32 {
        self.storage.field_scale(self.points()) as f32
    }

    /// Returns the points of the grid.
    pub fn points(&self) -> usize {
        self.place.grid_height as usize * self.place.grid_width as usize
    }

    /// Returns the sub-pixels of a pixel along an axis.
    pub fn subpixels(&self) -> usize {
        1 + self.model.more_subpixels
    }

    /// Returns the arguments of crosstalk's kernels.
    pub fn crosstalk(&self) -> crosstalk::Args {
        let [reach_y, reach_x] = self.model.crosstalk.unwrap_or_default().map(|pixels| pixels as u32);
        crosstalk::Args { place: self.place, subpixels: self.subpixels() as u32, reach_y, reach_x }
    }

    /// Returns true if complex fields are stored as halves.
    pub fn halves(&self) -> bool {
        self.storage == Storage::F16
    }

    /// Returns true if the real values of this resource are halves. Drives and their wanted changes are halves if
    /// fields are. Velocities are halves if phases are binary angles.
    pub(crate) fn stores_half(&self, resource: Resource) -> bool {
        match resource {
            Resource::Wave | Resource::Blurred => self.halves(),
            Resource::Momentum => self.binary_angles,
            _ => false,
        }
    }

    /// Returns the bytes of a number on a device, for buffers that are not complex.
    pub(crate) fn real_bytes(&self, resource: Resource) -> u64 {
        let short = self.binary_angles && resource.per_frame() == Some(PerFrame::Pixels);
        if short || self.stores_half(resource) { 2 } else { 4 }
    }

    /// Returns the size of a buffer of the shape, with no frames if the purpose does not need it.
    pub fn extent(&self, resource: Resource) -> BufferSize {
        let planes = self.frames * self.subpixels().pow(resource.axes_of_subpixels());
        let (frames, values) = match resource {
            Resource::Levels => (1, quantise::MOST),
            Resource::Hits => (1, self.points()),
            Resource::Energy => (1, (energy::MOST * energy::MOST) as usize),
            Resource::Field | Resource::Change => (self.frames, self.points()),
            Resource::Subpixels => (planes, self.points()),
            Resource::Wave | Resource::Blurred => (planes, self.pixels()),
            Resource::Pixels => (1, 4 * self.pixels()),
            Resource::Crosstalk => {
                let weights = |reach: usize| self.subpixels() * (2 * reach + 1);
                (1, self.model.crosstalk.map_or(0, |reach| reach.map(weights).iter().sum()))
            }
            Resource::Offsets => (1, 2 * self.subpixels() * (self.place.grid_height + self.place.grid_width) as usize),
            Resource::Relay => (self.model.relay, 2 * self.points()),
            Resource::Mask => (1, 2 * self.model.mask.pow(2) * self.pixels()),
            Resource::MaskTransfer => (1, 2 * self.points()),
            _ => (self.frames, self.pixels()),
        };
        let frames = if self.has(resource) { frames } else { 0 };
        BufferSize { frames, values, complex: resource.is_complex() }
    }

    /// Returns true if this shape has the buffer.
    fn has(&self, resource: Resource) -> bool {
        match resource {
            Resource::Phases | Resource::Field => true,
            Resource::Shown | Resource::Levels => self.quantised,
            Resource::Momentum | Resource::Change | Resource::Hits | Resource::Energy => self.purpose != Purpose::View,
            Resource::Second => self.purpose == Purpose::Adam,
            Resource::Wave | Resource::Pixels => self.model.drives,
            Resource::Blurred | Resource::Crosstalk => self.model.crosstalk.is_some(),
            Resource::Subpixels | Resource::Offsets => self.model.more_subpixels > 0,
            Resource::Relay => self.model.relay > 0,
            Resource::Mask => self.model.mask > 0,
            Resource::MaskTransfer => self.model.mask_away,
            _ => false,
        }
    }

    /// Returns the buffers that this shape has.
    pub fn buffers(&self) -> impl Iterator<Item = Buffer> {
        Resource::OF_SHAPE.into_iter().filter(|r| self.has(*r)).filter_map(|resource| resource.buffer(0))
    }

    /// Returns the actual binding of a kernel. If the SLM has no levels, `Shown` is bound to the phases.
    pub(crate) fn alias(&self, resource: Resource) -> Resource {
        if resource == Resource::Shown && !self.quantised { Resource::Phases } else { resource }
    }

    /// Returns true if a kernel can be bound to this. `Shown` always can, because it is `Phases` if the SLM has no
    /// levels.
    pub fn provides(&self, resource: Resource) -> bool {
        !resource.is_shared() || resource == Resource::Shown || self.has(resource)
    }
}
