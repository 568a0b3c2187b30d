//! Packs the small tables of a step's pupil passes into one block.
//!
//! The tables are spans, taps, weights and arguments. The block is copied at the start of each recording.

use super::super::{EngineError, PupilPass, Resource};
use super::fft::in_use;
use super::layout::{Layout, Slot, slot_layout};
use super::views::Views;
use crate::gpu::{Block, Commands, Range};
use bytemuck::{Pod, Zeroable};
use eyebox_kernels::photograph::Tap;
use eyebox_kernels::resample::Table;
use gpu_allocator::MemoryLocation;

/// A table's place, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Place {
    offset: u64,
    size: u64,
}

/// The data of one pupil for kernels over several pupils, in the layout of `pupils.glsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Pupil {
    corner: [u32; 2],
    size: [u32; 2],
    used: [u32; 2],
    window: u32,
    window_stride: u32,
    transfer: u32,
    pixels: u32,
    accumulator: u32,
    losses: u32,
    spans: u32,
    weights: [u32; 2],
    taps: [u32; 2],
    level: [u32; 2],
    scales: [f32; 2],
    gain: f32,
    mode: u32,
    compare: [f32; 4],
    propagation: [[f32; 2]; 5],
    bins: [i32; 2],
}

/// The data of one pupil and one block of views, in the layout of `photograph.comp`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Shot {
    size: [u32; 2],
    taps: [u32; 2],
    scale: f32,
    accumulate: u32,
    views: u32,
    view_stride: u32,
    accumulator: u32,
}

/// The block of views and the pupil pass of a shot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShotOf {
    block: usize,
    pupil_pass: usize,
    /// Number of taps in it.
    pub(super) count: u32,
    /// True if it adds to the result of other blocks.
    pub(super) adds: bool,
}

/// Places of the tables of one pupil pass.
#[derive(Debug, Clone, Copy, Default)]
struct PupilPassTables {
    spans: Place,
    eye: Option<Place>,
    taper: Option<Place>,
    moments: Option<Place>,
    rows: Place,
    columns: Place,
}

/// The block and its stage, which only grow.
#[derive(Default)]
pub(super) struct Tables {
    packed: Vec<u8>,
    /// Tables of all pupil passes, then of their further modes.
    pupil_passes: Vec<PupilPassTables>,
    /// Index of the first further mode of each pupil pass.
    modes: Vec<usize>,
    taps: Vec<Tap>,
    shots: Vec<Shot>,
    shots_of: Vec<ShotOf>,
    /// All pupil passes, with each group in the order of memory.
    order: Vec<usize>,
    pupils: Vec<Pupil>,
    /// Places of the tables for all pupil passes.
    taps_at: Place,
    shots_at: Place,
    pupils_at: Place,
    stage: Option<Block>,
    block: Option<Block>,
}

/// Returns the start of a buffer in its values. For very large steps it wraps, and so do differences.
fn start(layout: &Layout) -> u32 {
    (layout.offset / layout.value.size() as u64) as u32
}

impl Tables {
    /// Packs the tables of these pupil passes, whose buffers are in these slots and whose losses start at these
    /// bytes.
    pub(super) fn pack(
        &mut self,
        pupil_passes: &[PupilPass],
        (slots, order): (Vec<Slot>, Vec<usize>),
        losses: &[u64],
        views: Option<&Views>,
    ) {
        self.order = order;
        self.packed.clear();
        self.pupil_passes.clear();
        self.pupils.clear();
        for (at, pass) in pupil_passes.iter().enumerate() {
            self.pack_one(pass, slots.get(at).copied(), losses.get(at));
        }
        self.modes.clear();
        for (at, pass) in pupil_passes.iter().enumerate() {
            self.modes.push(self.pupil_passes.len());
            for (i, mode) in pass.modes.iter().enumerate() {
                let mut slot = slots.get(at).copied();
                for kind in [Resource::Window, Resource::Transfer].into_iter().filter_map(slot_layout) {
                    if let Some(layout) = slot.as_mut().map(|slot| &mut slot[kind]) {
                        layout.offset += (i + 1) as u64 * layout.bytes() / pass.mode_count() as u64;
                    }
                }
                self.pack_one(mode, slot, losses.get(at));
            }
        }
        self.gather_shots(pupil_passes, &slots, views);
        (self.taps_at, self.shots_at, self.pupils_at) = (
            add(&mut self.packed, bytemuck::cast_slice(&self.taps)),
            add(&mut self.packed, bytemuck::cast_slice(&self.shots)),
            add(&mut self.packed, bytemuck::cast_slice(&self.pupils)),
        );
    }

    /// Packs a pupil pass, or one of its further modes, in this slot.
    fn pack_one(&mut self, pass: &PupilPass, slot: Option<Slot>, losses: Option<&u64>) {
        let mut tables = PupilPassTables { spans: self.add(&pass.spans), ..Default::default() };
        tables.eye = pass.eye.as_ref().map(|terms| self.add(&terms.pairs()));
        tables.taper = pass.taper.as_ref().map(|weights| self.add(weights));
        tables.moments = pass.moves().then(|| self.add(pass.moments.words()));
        if let Some(shot) = &pass.shot {
            tables.rows = self.add_table(&shot.rows);
            tables.columns = self.add_table(&shot.columns);
        }
        self.pupil_passes.push(tables);
        if let (Some(slot), Some(losses)) = (slot, losses) {
            self.pupils.push(pupil(pass, &tables, &slot, *losses));
        }
    }

    /// Returns the index of a pupil pass, or of one of its further modes, among the tables.
    pub(super) fn place(&self, pupil_pass: usize, mode: usize) -> usize {
        match mode {
            0 => pupil_pass,
            _ => self.modes.get(pupil_pass).map_or(usize::MAX, |first| first + mode - 1),
        }
    }

    /// Gathers the taps of each pupil pass, block by block of views. A pupil pass without taps gets an empty entry of
    /// the first block.
    fn gather_shots(&mut self, pupil_passes: &[PupilPass], slots: &[Slot], views: Option<&Views>) {
        self.taps.clear();
        self.shots.clear();
        self.shots_of.clear();
        let Some(views) = views else { return };
        let accumulator = slot_layout(Resource::Accumulator);
        for block in 0..views.blocks.len() {
            for &pupil_pass in &self.order {
                let (Some(pass), Some(slot)) = (pupil_passes.get(pupil_pass), slots.get(pupil_pass)) else { continue };
                let Some(shot) = &pass.shot else { continue };
                let Some(level) = views.levels.get(shot.level) else { continue };
                let has =
                    |piece: &super::views::Piece| shot.taps.iter().any(|t| piece.views.contains(&(t.view as usize)));
                let first = level.pieces.iter().find(|piece| has(piece)).map_or(0, |piece| piece.block);
                let begin = self.taps.len() as u32;
                let piece = level.pieces.iter().find(|piece| piece.block == block);
                if let Some(piece) = piece {
                    let inside = shot.taps.iter().filter(|t| piece.views.contains(&(t.view as usize)));
                    self.taps.extend(inside.map(|t| Tap { view: t.view - piece.views.start as u32, ..*t }));
                }
                let (end, adds) = (self.taps.len() as u32, block != first);
                if end == begin && adds {
                    continue;
                }
                self.shots_of.push(ShotOf { pupil_pass, block, count: end - begin, adds });
                self.shots.push(Shot {
                    size: [shot.args.height, shot.args.width],
                    taps: [begin, end],
                    scale: shot.args.scale,
                    accumulate: shot.args.accumulate | u32::from(adds),
                    views: piece.map_or(0, |piece| piece.offset as u32),
                    view_stride: level.stride as u32,
                    accumulator: accumulator.map_or(0, |at| start(&slot[at])),
                });
            }
        }
    }

    /// Returns the number of packed bytes.
    pub(super) fn need(&self) -> u64 {
        self.packed.len() as u64
    }

    /// Returns the bytes of available room.
    pub(super) fn room(&self) -> u64 {
        self.block.as_ref().map_or(0, |b| b.size)
    }

    /// Makes room for `need` bytes. The block is not in use.
    pub(super) fn fit(&mut self, gpu: &Commands, need: u64) -> Result<(), EngineError> {
        for (block, location) in
            [(&mut self.stage, MemoryLocation::CpuToGpu), (&mut self.block, MemoryLocation::GpuOnly)]
        {
            if need > block.as_ref().map_or(0, |b| b.size) {
                *block = None;
                *block = Some(Block::new(&gpu.device, need.next_power_of_two(), location, "tables")?);
            }
        }
        Ok(())
    }

    /// Copies the packed bytes to the stage, from which the device copies them. There is room, and the stage is not
    /// in use.
    pub(super) fn stage(&mut self) {
        if let Some(stage) = &mut self.stage {
            stage.bytes_mut()[..self.packed.len()].copy_from_slice(&self.packed);
        }
    }

    fn add<T: Pod>(&mut self, values: &[T]) -> Place {
        add(&mut self.packed, bytemuck::cast_slice(values))
    }

    fn add_table(&mut self, table: &Table) -> Place {
        let offset = self.packed.len();
        self.packed.extend_from_slice(bytemuck::cast_slice(&table.first));
        let weights = add(&mut self.packed, bytemuck::cast_slice(&table.weights));
        Place { offset: offset as u64, size: weights.offset - offset as u64 + weights.size }
    }

    /// Records the copy to the device. A barrier must follow.
    pub(super) fn record(&self, gpu: &mut Commands) {
        if let (Some(stage), Some(block)) = (&self.stage, &self.block) {
            gpu.recorder.copy(stage, block, [(0, 0, self.packed.len() as u64)]);
        }
    }

    /// Returns the binding of a table of one pupil pass.
    pub(super) fn bound(&self, pupil_pass: usize, resource: Resource) -> Option<Result<Range<'_>, EngineError>> {
        let tables = self.pupil_passes.get(pupil_pass)?;
        let place = match resource {
            Resource::Spans => tables.spans,
            Resource::EyeTerms => tables.eye?,
            Resource::TaperWeights => tables.taper?,
            Resource::Moments => tables.moments?,
            _ => return None,
        };
        Some(self.range(place))
    }

    /// Returns the range of all tables, of every kind.
    pub(super) fn all(&self) -> Result<Range<'_>, EngineError> {
        self.range(Place { offset: 0, size: self.packed.len() as u64 })
    }

    /// Returns the arguments of all pupil passes.
    pub(super) fn pupils(&self) -> Result<Range<'_>, EngineError> {
        self.range(self.pupils_at)
    }

    /// Returns the taps and shots of all pupil passes.
    pub(super) fn shots(&self) -> Result<[Range<'_>; 2], EngineError> {
        Ok([self.range(self.taps_at)?, self.range(self.shots_at)?])
    }

    /// Returns the data of a pupil pass and a block of views, with its index in the table. Entries are in the order
    /// of memory.
    pub(super) fn shot(&self, block: usize, pupil_pass: usize) -> Option<(usize, ShotOf)> {
        let at = self.shots_of.iter().position(|of| (of.block, of.pupil_pass) == (block, pupil_pass))?;
        Some((at, self.shots_of[at]))
    }

    /// Returns a group of pupil passes in the order of memory, or none if the tables were not made for it.
    pub(super) fn order(&self, group: &std::ops::Range<usize>, slots: &[Slot]) -> Option<&[usize]> {
        let image = slot_layout(Resource::Image)?;
        let are_the_same = |(pupil, slot): (&Pupil, &Slot)| pupil.pixels == start(&slot[image]);
        let pupils = self.pupils.get(group.clone()).filter(|pupils| pupils.len() == slots.len())?;
        pupils.iter().zip(slots).all(are_the_same).then(|| self.order.get(group.clone())).flatten()
    }

    fn range(&self, place: Place) -> Result<Range<'_>, EngineError> {
        let block = self.block.as_ref().ok_or_else(|| EngineError::mismatch("the step has no pupil passes"))?;
        Ok(block.range(place.offset, place.size))
    }
}

fn add(packed: &mut Vec<u8>, bytes: &[u8]) -> Place {
    // An empty table has a place that can be bound, too.
    let offset = packed.len();
    packed.extend_from_slice(bytes);
    packed.resize((offset + bytes.len().max(1)).next_multiple_of(256), 0);
    Place { offset: offset as u64, size: bytes.len().max(4) as u64 }
}

fn pupil(pass: &PupilPass, tables: &PupilPassTables, slot: &Slot, losses: u64) -> Pupil {
    let at = |resource| slot_layout(resource).map_or(0, |at| start(&slot[at]));
    let stride = slot_layout(Resource::Window).map_or(0, |at| slot[at].stride() as u32);
    let PupilPass { back, compare, transfer, .. } = pass;
    let resample = pass.shot.as_ref().map(|shot| shot.resample);
    Pupil {
        corner: [back.y0, back.x0],
        size: [back.rows, back.columns],
        used: in_use(pass.columns, pass.window.columns),
        window: at(Resource::Window),
        window_stride: stride,
        transfer: at(Resource::Transfer),
        pixels: at(Resource::Image),
        accumulator: at(Resource::Accumulator),
        losses: (losses / 4) as u32,
        spans: (tables.spans.offset / 8) as u32,
        weights: [tables.rows, tables.columns].map(|place| (place.offset / 4) as u32),
        taps: resample.map_or([0; 2], |r| [r.row_taps, r.column_taps]),
        level: resample.map_or([1; 2], |r| [r.in_height, r.in_width]),
        scales: [pass.pass.scale, back.scale],
        gain: pass.intensity.gain,
        mode: compare.mode,
        compare: [compare.exposure, compare.weight, compare.floor, compare.limit],
        propagation: transfer.pairs(),
        bins: [transfer.y0, transfer.x0],
    }
}
