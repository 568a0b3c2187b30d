//! The small tables of a step's pupil passes (spans, taps, weights), packed into one block that is copied at the start of
//! each recording.

use super::super::{EngineError, PupilPass, Resource};
use super::layout::{Layout, Slot, slot_layout};
use super::views::Views;
use crate::gpu::{Block, Commands, Range};
use eyebox_kernels::photograph::Tap;
use eyebox_kernels::resample::Table;
use gpu_allocator::MemoryLocation;

/// A table's place, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Place {
    offset: u64,
    size: u64,
}

/// Taps into one block of views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TapPart {
    /// Which block of the level.
    pub(super) chunk: usize,
    pub(super) count: usize,
    pub(super) place: Place,
}

/// Where one pupil pass's tables lie.
#[derive(Debug, Clone, Default)]
pub(super) struct PupilPassTables {
    pub(super) spans: Place,
    pub(super) taper: Option<Place>,
    pub(super) taps: Vec<TapPart>,
    pub(super) rows: Place,
    pub(super) columns: Place,
}

/// The block and its stage; both only grow.
#[derive(Default)]
pub(super) struct Tables {
    packed: Vec<u8>,
    pupil_passes: Vec<PupilPassTables>,
    /// What `gather_columns` knows of each pupil pass.
    places: Place,
    stage: Option<Block>,
    block: Option<Block>,
}

impl Tables {
    /// Packs the tables of these pupil passes, whose buffers lie in these slots. A photograph goes in parts that move `most` bytes.
    pub(super) fn pack(&mut self, pupil_passes: &[PupilPass], slots: &[Slot], views: Option<&Views>, most: u64) {
        self.packed.clear();
        self.pupil_passes.clear();
        for pupil_pass in pupil_passes {
            let mut tables =
                PupilPassTables { spans: self.add(bytemuck::cast_slice(&pupil_pass.spans)), ..Default::default() };
            tables.taper = pupil_pass.taper.as_ref().map(|weights| self.add(bytemuck::cast_slice(weights)));
            if let Some(shot) = &pupil_pass.shot {
                tables.rows = self.add_table(&shot.rows);
                tables.columns = self.add_table(&shot.columns);
                if let Some(level) = views.and_then(|v| v.levels.get(shot.level)) {
                    for (chunk, first) in level.firsts() {
                        let inside = |t: &&Tap| level.chunk_of(t.view as usize) == chunk;
                        let part: Vec<Tap> = shot.taps.iter().filter(inside).copied().collect();
                        let part: Vec<Tap> = part.iter().map(|t| Tap { view: t.view - first as u32, ..*t }).collect();
                        // Two samples of halves a tap, as `photograph` says.
                        let tap_bytes = 3 * u64::from(shot.args.height) * u64::from(shot.args.width);
                        let at_once = usize::try_from(most / tap_bytes.max(1)).unwrap_or(usize::MAX).max(1);
                        for part in part.chunks(at_once) {
                            let place = self.add(bytemuck::cast_slice(part));
                            tables.taps.push(TapPart { chunk, count: part.len(), place });
                        }
                    }
                }
            }
            self.pupil_passes.push(tables);
        }
        let places: Vec<[u32; 12]> =
            pupil_passes.iter().zip(slots).enumerate().map(|(i, (pass, slot))| self.place(i, pass, slot)).collect();
        self.places = self.add(bytemuck::cast_slice(&places));
    }

    /// Bytes that were packed.
    pub(super) fn need(&self) -> u64 {
        self.packed.len() as u64
    }

    /// Bytes that there is room for.
    pub(super) fn room(&self) -> u64 {
        self.block.as_ref().map_or(0, |b| b.size)
    }

    /// Makes room for so many bytes; nothing of it is in use.
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

    /// Puts what was packed where the device fetches it from; there is room for it, and nothing of it is in use.
    pub(super) fn stage(&mut self) {
        if let Some(stage) = &mut self.stage {
            stage.bytes_mut()[..self.packed.len()].copy_from_slice(&self.packed);
        }
    }

    /// As `gather_columns.comp` has it; in a step that is too large for that these say nothing.
    fn place(&self, index: usize, pass: &PupilPass, slot: &Slot) -> [u32; 12] {
        let at = |resource| slot_layout(resource).map(|at| slot[at]);
        let first = |layout: Option<Layout>| layout.map_or(0, |l| (l.offset / l.value.size() as u64) as u32);
        let (window, transfer) = (at(Resource::Window), at(Resource::Transfer));
        let back = &pass.back;
        let stride = window.map_or(0, |l| l.stride() as u32);
        let spans = (self.pupil_passes[index].spans.offset / 8) as u32;
        [
            back.y0,
            back.x0,
            back.rows,
            back.columns,
            first(window),
            stride,
            first(transfer),
            spans,
            back.scale.to_bits(),
            0,
            0,
            0,
        ]
    }

    /// All tables, and among them where each pupil pass's buffers lie.
    pub(super) fn all(&self) -> Result<(Range<'_>, Range<'_>), EngineError> {
        let places = self.range(self.places)?;
        Ok((places.block.range(0, self.packed.len() as u64), places))
    }

    fn add(&mut self, bytes: &[u8]) -> Place {
        // A table that is empty still has a place that can be bound.
        let offset = self.packed.len();
        self.packed.extend_from_slice(bytes);
        self.packed.resize((offset + bytes.len().max(1)).next_multiple_of(256), 0);
        Place { offset: offset as u64, size: bytes.len().max(4) as u64 }
    }

    fn add_table(&mut self, table: &Table) -> Place {
        let mut words = table.first.clone();
        words.extend(table.weights.iter().map(|w| w.to_bits()));
        self.add(bytemuck::cast_slice(&words))
    }

    /// Records the copy to the device; a barrier must follow.
    pub(super) fn record(&self, gpu: &mut Commands) {
        if let (Some(stage), Some(block)) = (&self.stage, &self.block) {
            gpu.recorder.copy(stage, block, [(0, 0, self.packed.len() as u64)]);
        }
    }

    pub(super) fn pupil_pass(&self, index: usize) -> &PupilPassTables {
        &self.pupil_passes[index]
    }

    pub(super) fn range(&self, place: Place) -> Result<Range<'_>, EngineError> {
        let block = self
            .block
            .as_ref()
            .ok_or_else(|| EngineError::Mismatch { reason: "the step has no pupil_passes".into() })?;
        Ok(block.range(place.offset, place.size))
    }
}
