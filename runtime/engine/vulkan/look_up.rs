//! First phases by a table, on the device: by the kernels `pupil_light` and `table_start`, beside the lists of kernels. The host gives the
//! table once, and of each picture nothing but which views are seen.

use super::super::{Buffer, EngineError, LookUp};
use super::engine::VulkanEngine;
use super::layout::Value;
use super::views::Views;
use crate::gpu::{Block, Commands};
use eyebox_kernels::pupil_light::Share;
use eyebox_kernels::{WIDTH, pupil_light, table_start};
use eyebox_spirv as spirv;
use std::sync::Arc;

/// Most workgroups along an axis.
const GROUPS: u32 = 65_535;

/// What a table and a picture's place need on the device.
pub(super) struct Tables {
    table: (Arc<[u16]>, Block),
    needs: Option<(Arc<[u32]>, Block)>,
    shares: (Vec<Share>, Block),
    light: Block,
}

/// Whether both are the same memory.
fn is_same<T>(a: Option<&Arc<[T]>>, b: Option<&Arc<[T]>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (a, b) => a.is_none() && b.is_none(),
    }
}

impl Tables {
    fn fits(&self, of: &LookUp) -> bool {
        let needs = self.needs.as_ref().map(|(needs, _)| needs);
        let pixels = u64::from(of.args.height * of.args.width);
        let same = is_same(Some(&self.table.0), Some(&of.table)) && is_same(needs, of.needs.as_ref());
        same && self.shares.0 == of.shares && self.light.size == 4 * pixels
    }

    fn new(gpu: &mut Commands, of: &LookUp) -> Result<Self, EngineError> {
        let pixels = u64::from(of.args.height * of.args.width);
        let table: &[u8] = bytemuck::cast_slice(&of.table);
        // Words of two angles.
        let padded = [table, &[0; 2][..table.len() % 4]].concat();
        let needs = match &of.needs {
            Some(needs) => Some((Arc::clone(needs), gpu.filled(bytemuck::cast_slice(needs), "light of pixels")?)),
            None => None,
        };
        Ok(Self {
            table: (Arc::clone(&of.table), gpu.filled(&padded, "first phases")?),
            needs,
            shares: (of.shares.clone(), gpu.filled(bytemuck::cast_slice(&of.shares), "shares of views")?),
            light: gpu.block(4 * pixels, "light of a picture")?,
        })
    }
}

/// The shares that lie in a piece of views, from the first of its views on: `shares` are in order.
fn within(shares: &[Share], views: &std::ops::Range<usize>) -> std::ops::Range<u32> {
    let at = |view: usize| shares.partition_point(|share| (share.view as usize) < view) as u32;
    at(views.start)..at(views.end)
}

impl VulkanEngine {
    pub(super) fn look_up_here(&mut self, of: &LookUp) -> Result<(), EngineError> {
        let views =
            self.views.clone().ok_or_else(|| EngineError::Mismatch { reason: "no views were loaded".into() })?;
        if !self.tables.as_ref().is_some_and(|tables| tables.fits(of)) {
            self.gpu.recorder.idle()?;
            self.tables = None;
            self.tables = Some(Tables::new(&mut self.gpu, of)?);
        }
        let Some(tables) = &self.tables else { return Ok(()) };
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.barrier();
        record_light(&mut self.gpu, of, tables, &views)?;
        let phases = self.stacks.get(Buffer::Phases)?;
        let wanted = (of.args.frames as usize, (of.args.height * of.args.width) as usize);
        if (phases.layout.frames, phases.layout.values) != wanted {
            let reason = format!("{} sub-frames of {} phases are looked up", wanted.0, wanted.1);
            return Err(EngineError::Mismatch { reason });
        }
        let all = table_start::Args {
            evenly_lit: u32::from(tables.needs.is_none()),
            stride: phases.layout.stride() as u32,
            angles: u32::from(phases.layout.value == Value::Angle),
            ..of.args
        };
        let needs = tables.needs.as_ref().map_or(tables.light.all(), |(_, needs)| needs.all());
        let pipeline = self.gpu.pipeline(&spirv::TABLE_START, 4, &[])?;
        self.gpu.recorder.barrier();
        let at_once = phases.layout.at_once(self.gpu.limits().storage_range).max(1);
        for first in (0..wanted.0).step_by(at_once) {
            let frames = at_once.min(wanted.0 - first);
            let to = phases.layout.range(&phases.block, first, frames);
            let args = table_start::Args { first: first as u32, frames: frames as u32, ..all };
            let groups = [(wanted.1 as u32).div_ceil(2 * WIDTH).min(GROUPS), args.frames.min(GROUPS), 1];
            let buffers = [tables.light.all(), needs, tables.table.1.all(), to];
            self.gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&args), groups)?;
        }
        self.gpu.recorder.submit("table_start").map(drop)
    }
}

/// What the pupil sees, piece by piece of the views.
fn record_light(gpu: &mut Commands, of: &LookUp, tables: &Tables, views: &Views) -> Result<(), EngineError> {
    let Some(level) = views.levels.first() else { return Ok(()) };
    let pipeline = gpu.pipeline(&spirv::PUPIL_LIGHT, 3, &[])?;
    let mut adds = 0;
    for piece in &level.pieces {
        let shares = within(&of.shares, &piece.views);
        if shares.is_empty() {
            continue;
        }
        if adds > 0 {
            gpu.recorder.barrier();
        }
        let args = pupil_light::Args {
            stride: level.stride as u32,
            // Shares count views from the first of all.
            from: piece.views.start as u32,
            begin: shares.start,
            end: shares.end,
            adds,
            ..of.place
        };
        adds = 1;
        let buffers = [level.range(&views.blocks, piece, &piece.views), tables.shares.1.all(), tables.light.all()];
        let groups = [(args.height * args.width).div_ceil(WIDTH).min(GROUPS), 1, 1];
        gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&args), groups)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Engine;
    use crate::gpu::Gpu;
    use crate::gpu::test_options::watched;
    use crate::optics::{Optics, WindowFactor};
    use crate::plan::{Planner, Purpose, Storage, ViewLayout};
    use crate::scene::{Pyramid, ViewGrid};
    use eyebox_kernels::table_start::LEVELS;
    use std::sync::PoisonError;

    const FRAMES: usize = 5;

    fn planner([height, width]: [usize; 2]) -> (Planner, Arc<Pyramid>) {
        let slm = Optics::new(height, width, 8e-6, 520e-9, 0.4).unwrap();
        let of = |v: usize| (0..height * width).map(|i| ((i * 37 + v * 101) % 211) as f32 / 150.0).collect();
        let views: Vec<Vec<f32>> = (0..9).map(of).collect();
        let pyramid = Arc::new(Pyramid::new(&views, height, width));
        let grid = ViewGrid { rows: 3, columns: 3, cell: slm.eyebox() / 3.0 };
        let views = Some(ViewLayout::new(grid, &pyramid));
        (Planner { views, ..Planner::new(slm, FRAMES, WindowFactor::Two) }, pyramid)
    }

    /// A table of no display, of an odd size.
    fn of([height, width]: [usize; 2], views: &Arc<Pyramid>, bright: f64, shaded: bool) -> LookUp {
        let [rows, columns, pixels] = [height, width, height * width].map(|n| n as u32);
        let parts = [(0, 0.1), (2, 0.25), (4, 0.3), (5, 0.05), (8, 0.3)];
        let shares = pupil_light::shares(&parts);
        let (side, count) = (7, FRAMES * 49 * LEVELS);
        let place = pupil_light::Args {
            height: rows,
            width: columns,
            line: columns,
            first: 0,
            stride: pixels,
            from: 0,
            begin: 0,
            end: shares.len() as u32,
            adds: 0,
        };
        let args = table_start::Args {
            height: rows,
            width: columns,
            side,
            first: 0,
            frames: FRAMES as u32,
            factor: 0,
            shift: 0,
            evenly_lit: 1,
            stride: pixels,
            angles: 1,
        };
        let needs = (0..pixels).map(|i| table_start::need(0.1 + (i % 9) as f32 / 4.0));
        LookUp {
            table: (0..count).map(|i| (i * 26_881 % 65_536) as u16).collect(),
            views: Arc::clone(views),
            shares,
            place,
            args: args.brightness(bright),
            needs: shaded.then(|| needs.collect()),
        }
    }

    /// The device looks up what the host does, to the bit: phases and binary angles, pixels in odd numbers, dark, bright and unevenly
    /// lit, other tables and pictures after it, and where kernels see few views and sub-frames at a time.
    #[test]
    fn the_device_looks_up_what_the_host_does() {
        let gpu = Gpu::open(&watched()).unwrap();
        let mut engine = VulkanEngine::new(&gpu).unwrap();
        for (size, range) in [([33, 27], None), ([48, 64], None), ([40, 64], Some(2 * 4 * 40 * 64 + 512))] {
            if let Some(bytes) = range {
                engine.pretend_range(bytes);
            }
            let (planner, pyramid) = planner(size);
            for storage in [Storage::F32, Storage::F16] {
                let binary_angles = storage == Storage::F16;
                let planner = Planner { storage, binary_angles, ..planner.clone() };
                engine.load(&planner.shape(Purpose::Project), Some(Arc::clone(&pyramid))).unwrap();
                for (bright, shaded) in [(1.7, false), (1e-4, false), (9e4, false), (0.9, true), (0.9, true)] {
                    let of = of(size, &pyramid, bright, shaded);
                    engine.look_up(&of).unwrap();
                    let (got, wanted) = (engine.read(Buffer::Phases).unwrap(), of.phases().unwrap());
                    assert!(got == wanted, "{size:?} {storage:?} {bright}");
                }
            }
        }
        let (_, pyramid) = planner([48, 64]);
        assert!(matches!(engine.look_up(&of([48, 64], &pyramid, 1.0, false)), Err(EngineError::Mismatch { .. })));
        let messages = engine.gpu().messages();
        drop((engine, gpu));
        assert_eq!(*messages.lock().unwrap_or_else(PoisonError::into_inner), Vec::<String>::new());
    }
}
