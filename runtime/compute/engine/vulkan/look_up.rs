//! Looks up first phases in a table on the device, with the kernels `pupil_light` and `table_start` outside of lists.
//!
//! The host passes the table once, and for each picture only the visible views.

use super::super::{EngineError, LookUp};
use super::layout::Value;
use super::record::Stack;
use super::views::Views;
use crate::gpu::{Block, Commands};
use eyebox_kernels::pupil_light::Share;
use eyebox_kernels::{WIDTH, pupil_light, table_start};
use eyebox_spirv as spirv;
use std::sync::Arc;

/// Most workgroups along an axis.
const GROUPS: u32 = 65_535;

/// Device copies of a table and of a picture's data.
pub(super) struct Tables {
    table: (Arc<[u16]>, Block),
    needs: Option<(Arc<[u32]>, Block)>,
    shares: (Vec<Share>, Block),
    light: Block,
}

/// Returns true if both are the same memory.
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
        // The table is padded to words of two angles.
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

/// Returns the range of the shares for a piece of views. `shares` are in the order of views.
fn within(shares: &[Share], views: &std::ops::Range<usize>) -> std::ops::Range<u32> {
    let at = |view: usize| shares.partition_point(|share| (share.view as usize) < view) as u32;
    at(views.start)..at(views.end)
}

/// Fills `phases` by a table, from `views`. `kept` keeps the device copies.
pub(super) fn look_up(
    gpu: &mut Commands,
    kept: &mut Option<Tables>,
    views: &Views,
    phases: &Stack,
    of: &LookUp,
) -> Result<(), EngineError> {
    let wanted = (of.args.frames as usize, (of.args.height * of.args.width) as usize);
    if (phases.layout.frames, phases.layout.values) != wanted {
        return Err(EngineError::mismatch(format!("the table is for {} sub-frames of {} phases", wanted.0, wanted.1)));
    }
    let tables = match kept.take() {
        Some(tables) if tables.fits(of) => kept.insert(tables),
        other => {
            gpu.recorder.idle()?;
            drop(other); // Both may not fit.
            kept.insert(Tables::new(gpu, of)?)
        }
    };
    gpu.recorder.begin(0)?;
    gpu.recorder.barrier();
    record_light(gpu, of, tables, views)?;
    let all = table_start::Args {
        evenly_lit: u32::from(tables.needs.is_none()),
        stride: phases.layout.stride() as u32,
        angles: u32::from(phases.layout.value == Value::Angle),
        ..of.args
    };
    let needs = tables.needs.as_ref().map_or(tables.light.all(), |(_, needs)| needs.all());
    let pipeline = gpu.pipeline(&spirv::TABLE_START, 4, &[])?;
    gpu.recorder.barrier();
    let at_once = phases.layout.at_once(gpu.limits.storage_range).max(1);
    for first in (0..wanted.0).step_by(at_once) {
        let frames = at_once.min(wanted.0 - first);
        let to = phases.layout.range(&phases.block, first, frames);
        let args = table_start::Args { first: first as u32, frames: frames as u32, ..all };
        let groups = [(wanted.1 as u32).div_ceil(2 * WIDTH).min(GROUPS), args.frames.min(GROUPS), 1];
        let buffers = [tables.light.all(), needs, tables.table.1.all(), to];
        gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&args), groups)?;
    }
    gpu.recorder.submit("table_start").map(drop)
}

/// Records the light that the pupil sees, one piece of views after the other.
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
            // Shares count views from the first view of all.
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
