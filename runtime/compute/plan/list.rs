//! The buffers of a list as data: what kernels read and write, and how large it is.

use super::Storage;
use eyebox_kernels::{crosstalk, energy, modulate, multiply, quantise};

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
    /// Of each sub-pixel the phases between a drive and the field, and, on their way back, what is asked of them: (frames,
    /// sub-pixels along y, along x, height, width). Drives, which a pixel has one of, lie in the first sub-pixel's place.
    Wave,
    /// The same between crosstalk along x and along y: (frames, sub-pixels along x, height, width).
    Blurred,
    /// The field of each sub-pixel, where a pixel has several, then its spectrum: complex (frames, sub-pixels along y, along x,
    /// grid height, grid width).
    Subpixels,
    /// Of each pixel its look-up table's level, the source's amplitude, real and imaginary part of the undiffracted light:
    /// (4, height, width). An engine fills it from the step's model, as the two that follow.
    Pixels,
    /// Weights of crosstalk, along y and along x: (sub-pixels, 2 reach + 1).
    Crosstalk,
    /// By what each sub-pixel's place moves the spectrum: (sub-pixels, grid height) along y, (sub-pixels, grid width) along x,
    /// each (re, im).
    Offsets,
    /// What the pixels' aperture and the relay do to each bin: (modes, grid height, grid width), each (re, im).
    Relay,
    /// The static mask, (rows, columns) of its pixels over the SLM, each (re, im).
    Mask,
    /// Propagation from the SLM to a mask at a distance: (grid height, grid width), each (re, im).
    MaskTransfer,
    /// K on the window: complex (modes, rows, columns).
    Transfer(usize),
    /// The retinal fields: complex (modes, frames, rows, columns).
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

/// Pairs buffers with the resources of the same name: those of the shape, and those of a slot.
macro_rules! buffers {
    (shape: $($shared:ident)*; slot: $($own:ident)*) => {
        impl Buffer {
            /// Returns it as a resource, with its slot if it belongs to a pupil pass.
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

            /// Returns the buffer, of this slot if it belongs to a pupil pass. What comes with a step or is its answer has none.
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
    /// [`Buffer::Blurred`].
    Blurred,
    /// [`Buffer::Subpixels`].
    Subpixels,
    /// [`Buffer::Pixels`].
    Pixels,
    /// [`Buffer::Crosstalk`].
    Crosstalk,
    /// [`Buffer::Offsets`].
    Offsets,
    /// [`Buffer::Relay`].
    Relay,
    /// [`Buffer::Mask`].
    Mask,
    /// [`Buffer::MaskTransfer`].
    MaskTransfer,
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
    /// Its eye's polynomial.
    EyeTerms,
    /// Its weights of `taper`.
    TaperWeights,
    /// What each of its sub-frames is shifted by.
    Moments,
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
    /// Whether a value is two numbers.
    pub(crate) fn is_complex(self) -> bool {
        matches!(self, Self::Field | Self::Change | Self::Subpixels | Self::Transfer | Self::Window)
    }

    /// How its complex values are stored: what is read beside a window as float32 always.
    pub(crate) fn stored(self, storage: Storage) -> Storage {
        if self == Self::Transfer { Storage::F32 } else { storage }
    }

    /// Of how many sub-pixels each sub-frame has a plane, along how many axes.
    pub(crate) fn axes_of_subpixels(self) -> u32 {
        match self {
            Self::Wave | Self::Subpixels => 2,
            Self::Blurred => 1,
            _ => 0,
        }
    }

    /// As messages call it.
    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Whether it is a buffer of the shape.
    pub fn is_shared(self) -> bool {
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
pub struct BufferSize {
    /// Frames; none where the buffer is not needed.
    pub frames: usize,
    /// Values of a frame.
    pub values: usize,
    /// Whether a value is two numbers.
    pub complex: bool,
}

impl BufferSize {
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
    /// Pixels that crosstalk reaches along y and along x; none without crosstalk.
    pub crosstalk: Option<[usize; 2]>,
    /// Sub-pixels of a pixel along an axis beyond the first.
    pub more_subpixels: usize,
    /// Tables of factors on the bins, the pixels' aperture and the relay's wavefront: one for each mode of the source, 0 for
    /// none.
    pub relay: usize,
    /// Pixels of a static mask along an axis of one of the SLM's, 0 without.
    pub mask: usize,
    /// Whether that mask stands at a distance from the SLM.
    pub mask_away: bool,
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
    pub fn empty() -> Self {
        let place = bytemuck::Zeroable::zeroed();
        let (purpose, storage, model) = (Purpose::View, Storage::F32, ModelParts::default());
        Self { frames: 0, place, purpose, quantised: false, storage, binary_angles: false, model }
    }

    /// Pixels of one sub-frame on the SLM.
    pub fn pixels(&self) -> usize {
        self.place.height as usize * self.place.width as usize
    }

    /// Where the SLM lies in the grid, in the grid's own pixels: a mask's are smaller than the SLM's.
    pub fn on_grid(&self) -> modulate::Args {
        let finer = self.model.mask.max(1) as u32;
        modulate::Args { height: finer * self.place.height, width: finer * self.place.width, ..self.place }
    }

    /// Arguments of `multiply` by the phases of a mask at a distance, and by the propagation to it. Each has the root of what two
    /// transforms multiply by, so that halves stay in range.
    pub(crate) fn mask_factors(&self, back: bool) -> [multiply::Args; 2] {
        let modulate::Args { height, width, grid_height, grid_width, top, left } = self.on_grid();
        let (conjugate, scale) = (u32::from(back), (self.points() as f32).sqrt().recip());
        let mask =
            multiply::Args { rows: height, columns: width, grid_height, grid_width, top, left, conjugate, scale };
        [mask, multiply::Args { rows: grid_height, columns: grid_width, top: 0, left: 0, ..mask }]
    }

    /// What `modulate` multiplies the field by.
    pub fn field_scale(&self) -> f32 {
        self.storage.field_scale(self.points()) as f32
    }

    /// Points of the grid.
    pub fn points(&self) -> usize {
        self.place.grid_height as usize * self.place.grid_width as usize
    }

    /// Sub-pixels of a pixel along an axis.
    pub fn subpixels(&self) -> usize {
        1 + self.model.more_subpixels
    }

    /// Arguments of crosstalk's kernels.
    pub fn crosstalk(&self) -> crosstalk::Args {
        let [reach_y, reach_x] = self.model.crosstalk.unwrap_or_default().map(|pixels| pixels as u32);
        crosstalk::Args { place: self.place, subpixels: self.subpixels() as u32, reach_y, reach_x }
    }

    /// Whether complex fields are stored as halves.
    pub fn halves(&self) -> bool {
        self.storage == Storage::F16
    }

    /// Whether what this holds, which is not complex, are halves: where fields are, drives and what is asked of them; velocities beside
    /// binary angles.
    pub(crate) fn stores_half(&self, resource: Resource) -> bool {
        match resource {
            Resource::Wave | Resource::Blurred => self.halves(),
            Resource::Momentum => self.binary_angles,
            _ => false,
        }
    }

    /// Bytes of a number on a device, of buffers that are not complex.
    #[cfg(feature = "vulkan")]
    pub(crate) fn real_bytes(&self, resource: Resource) -> u64 {
        let short = self.binary_angles && resource.per_frame() == Some(PerFrame::Pixels);
        if short || self.stores_half(resource) { 2 } else { 4 }
    }

    /// How large a buffer of the shape is; no frames where the purpose does not need it.
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

    /// Whether it is a buffer that this shape has.
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

    /// The buffers that this shape has.
    pub fn buffers(&self) -> impl Iterator<Item = Buffer> {
        Resource::OF_SHAPE.into_iter().filter(|r| self.has(*r)).filter_map(|resource| resource.buffer(0))
    }

    /// What a kernel that is bound to this is really bound to: where the SLM has no levels, the phases are what is shown.
    #[cfg(feature = "vulkan")]
    pub(crate) fn alias(&self, resource: Resource) -> Resource {
        if resource == Resource::Shown && !self.quantised { Resource::Phases } else { resource }
    }

    /// Whether a kernel can be bound to this: `Shown` always, for it is `Phases` where the SLM has no levels.
    pub fn provides(&self, resource: Resource) -> bool {
        !resource.is_shared() || resource == Resource::Shown || self.has(resource)
    }
}
