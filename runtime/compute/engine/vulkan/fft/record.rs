//! Records the passes of planned transforms.

use super::convolution::{Chunks, chirp_pipeline};
use super::state::{Along, Fft, Frames, Planned, Work, columns_axis};
use crate::engine::{EngineError, Storage};
use crate::gpu::{Block, Commands, Pipeline};
use bytemuck::{Pod, Zeroable};
use eyebox_kernels::fft::{Columns, Direction};
use eyebox_kernels::fft_plan::{Axis, LONGEST, Method, Plan, PlanLimits, Radix, Shared};
use std::sync::Arc;

/// Invocations of a workgroup of `fft_pass` along memory. They access whole cache lines, one after the other. By
/// measurement, 16 by 4 takes twice as long.
const CROWD: u32 = 32;

/// Bytes of scratch for frames at once, of which there is at least one.
const SCRATCH: u64 = 64 << 20;

/// Push constants of `fft_pass`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PassArguments {
    n: u32,
    s: u32,
    inverse_s: f32,
    table: u32,
    inverse: u32,
    count: u32,
    first: u32,
    wrap: u32,
    row: u32,
    from_frame: u32,
    to_frame: u32,
}

impl Fft {
    /// Makes plan, tables and pipelines of a length.
    fn axis(
        &mut self,
        gpu: &mut Commands,
        n: usize,
        axis: Axis,
        even_width: bool,
        storage: Storage,
    ) -> Result<(), EngineError> {
        let short = u32::try_from(n).unwrap_or(u32::MAX);
        let planned = match self.axes.get(&(short, axis)) {
            Some(planned) => Arc::clone(planned),
            None => {
                let plan = Plan::new(short, axis, &plan_limits(gpu)).ok_or_else(|| {
                    EngineError::mismatch(format!("{n} points cannot be transformed, 1 to {LONGEST} can"))
                })?;
                let planned = Arc::new(planned(gpu, plan)?);
                self.axes.insert((short, axis), Arc::clone(&planned));
                planned
            }
        };
        // All pipelines are compiled now and not during a recording.
        compile(gpu, &planned.plan, axis, even_width, storage)
    }

    fn scratch(&mut self, gpu: &Commands, size: u64) -> Result<Block, EngineError> {
        match self.scratch.take() {
            Some(scratch) if scratch.size >= size => Ok(scratch),
            small => {
                self.outgrown.extend(small);
                gpu.block(size, "scratch of the transform")
            }
        }
    }

    /// Makes the resources that [`record`](Self::record) needs for frames of this (height, width), unless they exist.
    /// Call it outside of a recording, because it may upload.
    pub(in super::super) fn prepare(
        &mut self,
        gpu: &mut Commands,
        [height, width]: [usize; 2],
        storage: Storage,
    ) -> Result<(), EngineError> {
        // No recording is open, but submissions may still be under way.
        if !self.outgrown.is_empty() {
            gpu.recorder.idle()?;
            self.outgrown.clear();
        }
        self.axis(gpu, width, Axis::Rows, true, storage)?;
        self.axis(gpu, height, columns_axis(gpu, width), width.is_multiple_of(2), storage)
    }

    /// Returns the plan of a length that was prepared, with its tables.
    pub(in super::super) fn planned(&self, n: usize, axis: Axis) -> Option<Arc<Planned>> {
        self.axes.get(&(u32::try_from(n).ok()?, axis)).cloned()
    }

    /// Records the pruned transform of `kernels::fft`, in place. The engine sets barriers before and after it.
    /// Barriers between passes are set here.
    pub(in super::super) fn record(
        &mut self,
        gpu: &mut Commands,
        frames: Frames<'_>,
        direction: Direction,
        columns: Columns,
        along: Along,
    ) -> Result<(), EngineError> {
        let (height, width) = (frames.height as u32, frames.width as u32);
        let axes = [(width, Axis::Rows), (height, columns_axis(gpu, frames.width))]
            .map(|key| self.axes.get(&key).cloned().map(|planned| (key.1, planned)));
        let [Some(rows), Some(down)] = axes else {
            return Err(EngineError::mismatch(format!("no transform of {height} x {width} was prepared")));
        };
        let limits = gpu.limits;
        let size = frames.storage.bytes() as u64;
        let one = u64::from(height) * u64::from(width);
        // A frame that starts at an odd value cannot be read in pairs, but each frame alone is aligned.
        let packed = one.next_multiple_of(2);
        let most = if frames.stride.is_multiple_of(2) { frames.count } else { 1 };
        let fit = |bytes: u64, frame: u64| (bytes / frame.max(1)).max(1) as usize;
        let leaves = |(_, planned): &&(Axis, Arc<Planned>)| match &planned.plan.method {
            Method::Nothing | Method::Shared(_) => false,
            Method::Passes { radices, .. } => radices.len() > 1,
            Method::Bluestein { .. } => true,
        };
        let spent = if [&rows, &down].iter().any(leaves) { SCRATCH } else { u64::MAX };
        let timed = fit(gpu.dispatch_bytes(), 2 * size * one);
        let at_once = fit(limits.storage_range, size * frames.stride as u64)
            .min(fit(spent.min(limits.storage_range), size * packed))
            .min(limits.groups[2] as usize)
            .min(timed)
            .min(most);
        let axes = match (along, direction) {
            (Along::Rows, _) => vec![rows],
            (Along::Columns, _) => vec![down],
            (Along::Both, Direction::Forward) => vec![rows, down],
            (Along::Both, Direction::Inverse) => vec![down, rows],
        };
        // The same columns are used for the scratch and for the work.
        let [first_column, used] = in_use(columns, frames.width);
        let need = axes.iter().filter(leaves).map(|(axis, planned)| match &planned.plan.method {
            Method::Bluestein { inner } => {
                let lines = if *axis == Axis::Rows { height } else { used };
                2 * Chunks::new(inner.n, lines, at_once as u32, *axis).bytes()
            }
            _ => size * packed * at_once as u64,
        });
        let need = need.max().unwrap_or(0);
        let scratch = if need > 0 { Some(self.scratch(gpu, need)?) } else { None };
        if scratch.is_some() {
            // Work recorded before may still use the scratch.
            gpu.recorder.barrier();
        }
        let mut done = Ok(());
        let mut begun = false;
        for first in (0..frames.count).step_by(at_once.max(1)) {
            let count = at_once.min(frames.count - first);
            let offset = frames.offset + size * (frames.stride * first) as u64;
            let data = frames.block.range(offset, size * (frames.stride as u64 * (count as u64 - 1) + one));
            for (axis, planned) in &axes {
                if matches!(planned.plan.method, Method::Nothing) || (*axis != Axis::Rows && used == 0) {
                    continue;
                }
                if std::mem::replace(&mut begun, true) {
                    gpu.recorder.barrier();
                }
                let spare = match (&scratch, &planned.plan.method) {
                    (Some(scratch), Method::Bluestein { .. }) => scratch.range(0, need),
                    (Some(scratch), _) => scratch.range(0, need.min(size * packed * count as u64)),
                    (None, _) => data,
                };
                let (first, count_of_lines, wrap) = match axis {
                    Axis::Rows => (0, height, u32::MAX),
                    Axis::Columns | Axis::ColumnPairs => (first_column, used, width),
                };
                let work = Work {
                    data,
                    spare,
                    frames: count as u32,
                    axis: *axis,
                    first,
                    count: count_of_lines,
                    columns: [first_column, used],
                    wrap,
                    row: width,
                    frame: frames.stride as u32,
                    spare_frame: packed as u32,
                    inverse: direction == Direction::Inverse,
                    storage: frames.storage,
                };
                done = done.and_then(|()| self.lines(gpu, planned, &work));
            }
        }
        self.scratch = scratch.or(self.scratch.take());
        done
    }

    pub(super) fn lines(&mut self, gpu: &mut Commands, planned: &Planned, work: &Work<'_>) -> Result<(), EngineError> {
        match &planned.plan.method {
            Method::Nothing => Ok(()),
            Method::Shared(shared) => self.shared(gpu, planned, shared, work),
            Method::Passes { radices, pair } => self.passes(gpu, planned, radices, *pair, work),
            Method::Bluestein { .. } => self.convolution(gpu, planned, work),
        }
    }

    /// Records whole rows, or whole columns in pairs.
    fn shared(
        &mut self,
        gpu: &mut Commands,
        planned: &Planned,
        shared: &Shared,
        work: &Work<'_>,
    ) -> Result<(), EngineError> {
        let (n, rows) = (planned.plan.n, work.count * work.frames);
        let (all, groups) = if work.axis == Axis::Rows {
            (rows, row_groups(gpu, shared, rows))
        } else {
            (work.wrap, [(work.count / 2).div_ceil(shared.lines), work.frames, 1])
        };
        let inverse = u32::from(work.inverse);
        let Work { count, row, frame, columns: [first, used], .. } = *work;
        let arguments = [n, count, all, inverse, row, frame, first, used];
        let pipeline = shared_pipeline(gpu, shared, work.axis, work.storage)?;
        let buffers = [work.data, planned.twiddles.all()];
        gpu.recorder.dispatch(pipeline, &buffers, bytemuck::cast_slice(&arguments), groups)?;
        let value = work.storage.bytes() as u64 * u64::from(rows);
        let of_row = |skips: bool| value * u64::from(if work.axis == Axis::Rows && skips { used } else { n });
        gpu.recorder.moved(|| vec![work.data.reads(of_row(work.inverse)), work.data.writes(of_row(!work.inverse))]);
        self.mark(gpu, || format!("{:?} of {n} through shared memory", work.axis).to_lowercase());
        Ok(())
    }

    /// Records passes from the data to the spare and back. An odd last pass stays on the data, because its
    /// invocations write the values that they read.
    fn passes(
        &mut self,
        gpu: &mut Commands,
        planned: &Planned,
        radices: &[Radix],
        pair: bool,
        work: &Work<'_>,
    ) -> Result<(), EngineError> {
        let n = planned.plan.n;
        let (first, count) = (work.first, work.count);
        let pair = if work.axis == Axis::Rows { pair } else { work.wrap.is_multiple_of(2) };
        let (mut s, mut in_spare) = (1, false);
        for (i, radix) in radices.iter().enumerate() {
            let to_spare = !in_spare && i + 1 < radices.len();
            let side = |spare: bool| if spare { (work.spare, work.spare_frame) } else { (work.data, work.frame) };
            let ((from, from_frame), (to, to_frame)) = (side(in_spare), side(to_spare));
            let butterflies = n / radix.size();
            if i > 0 {
                gpu.recorder.barrier();
            }
            let arguments = PassArguments {
                n,
                s,
                inverse_s: 1.0 / s as f32,
                table: planned.starts[i],
                inverse: u32::from(work.inverse),
                count,
                first,
                wrap: work.wrap,
                row: work.row,
                from_frame,
                to_frame,
            };
            let (along, across) = if work.axis == Axis::Rows { (butterflies, count) } else { (count, butterflies) };
            let along = if pair { along.div_ceil(2) } else { along };
            let groups = [along.div_ceil(CROWD), across, work.frames];
            let constants = pass_constants(*radix, work.axis, pair, i == 0);
            let pipeline = gpu.pipeline(eyebox_spirv::FFT_PASS.stored(work.storage == Storage::F16), 3, &constants)?;
            let buffers = [from, to, planned.twiddles.all()];
            gpu.recorder.dispatch(pipeline, &buffers, bytemuck::bytes_of(&arguments), groups)?;
            let values = u64::from(n) * u64::from(count) * u64::from(work.frames);
            let bytes = work.storage.bytes() as u64 * values;
            gpu.recorder.moved(|| vec![from.reads(bytes), to.writes(bytes)]);
            self.mark(gpu, || format!("{:?} of {n}, radix {}", work.axis, radix.size()).to_lowercase());
            s *= radix.size();
            in_spare = to_spare;
        }
        Ok(())
    }
}

/// Returns the first column in use and their count, which may wrap, as pairs from an even column on. One more column
/// may be transformed on either side. On the way forward nobody reads it, and on the way back it is zero. If the
/// width is odd, rows are not aligned and no columns go in pairs.
pub(in super::super) fn in_use(columns: Columns, width: usize) -> [u32; 2] {
    let (first, count) = (columns.first % width.max(1), columns.count);
    let (first, count) = match count > 0 && width.is_multiple_of(2) {
        true => (first & !1, (first % 2 + count).next_multiple_of(2).min(width)),
        false => (first, count),
    };
    [first as u32, count as u32]
}

/// Makes a plan's tables.
fn planned(gpu: &mut Commands, plan: Plan) -> Result<Planned, EngineError> {
    let (mut table, starts) = plan.twiddles();
    if table.is_empty() {
        // A binding must not be empty.
        table.push([1.0, 0.0, 1.0, 0.0]);
    }
    let twiddles = gpu.filled(bytemuck::cast_slice(&table), "twiddles")?;
    let convolution = match (&plan.method, plan.chirp()) {
        (Method::Bluestein { inner }, Some([chirp, filter])) => {
            let chirp = gpu.filled(bytemuck::cast_slice(&chirp), "chirp")?;
            let filter = gpu.filled(bytemuck::cast_slice(&filter), "filter")?;
            Some((chirp, filter, Arc::new(planned(gpu, (**inner).clone())?)))
        }
        _ => None,
    };
    Ok(Planned { plan, twiddles, starts, convolution })
}

fn compile(gpu: &mut Commands, plan: &Plan, axis: Axis, even_width: bool, storage: Storage) -> Result<(), EngineError> {
    match &plan.method {
        Method::Nothing => {}
        Method::Shared(shared) => {
            shared_pipeline(gpu, shared, axis, storage)?;
        }
        Method::Passes { radices, pair } => {
            let pair = if axis == Axis::Rows { *pair } else { even_width };
            for (i, radix) in radices.iter().enumerate() {
                let constants = pass_constants(*radix, axis, pair, i == 0);
                gpu.pipeline(eyebox_spirv::FFT_PASS.stored(storage == Storage::F16), 3, &constants)?;
            }
        }
        Method::Bluestein { inner } => {
            // The first and last kernels access the data, and the one between only the scratch.
            for storage in [storage, Storage::F32] {
                chirp_pipeline(gpu, storage)?;
            }
            compile(gpu, inner, axis, true, Storage::F32)?;
        }
    }
    Ok(())
}

fn pass_constants(radix: Radix, axis: Axis, pair: bool, first: bool) -> [u32; 7] {
    let rows = u32::from(axis == Axis::Rows);
    [CROWD, 1, radix.a, radix.b, u32::from(pair), rows, u32::from(first)]
}

fn shared_pipeline(gpu: &mut Commands, shared: &Shared, axis: Axis, storage: Storage) -> Result<Pipeline, EngineError> {
    let constants = shared_constants(shared, axis);
    gpu.pipeline(eyebox_spirv::FFT_SHARED.stored(storage == Storage::F16), 2, &constants)
}

/// Returns the constants of `fft_lines.glsl`.
pub(in super::super) fn shared_constants(shared: &Shared, axis: Axis) -> [u32; 21] {
    let Shared { radices, counts, pair, threads, lines, slots } = shared;
    let mut constants = [1; 21];
    let [x, y] = if axis == Axis::Rows { [*threads, *lines] } else { [*lines, *threads] };
    constants[..5].copy_from_slice(&[x, y, u32::from(*pair), radices.len() as u32, *slots]);
    for (i, stage) in constants[5..20].chunks_exact_mut(3).enumerate() {
        let count = counts.get(i).copied().unwrap_or(0);
        let Radix { a, b } = radices.get(i).copied().unwrap_or(Radix { a: 1, b: 1 });
        stage.copy_from_slice(&[a, b, count]);
    }
    constants[20] = u32::from(axis != Axis::Rows);
    constants
}

/// Returns the workgroups for `rows` rows.
pub(in super::super) fn row_groups(gpu: &Commands, shared: &Shared, rows: u32) -> [u32; 3] {
    let groups = rows.div_ceil(shared.lines);
    let wide = groups.min(gpu.limits.groups[0]);
    [wide, groups.div_ceil(wide.max(1)), 1]
}

/// Returns the limits of plans on this device.
pub(in super::super) fn plan_limits(gpu: &Commands) -> PlanLimits {
    let limits = gpu.limits;
    PlanLimits { shared_bytes: limits.shared_memory, invocations: limits.invocations }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_grow_by_one_on_either_side_at_most_and_go_in_pairs() {
        for width in 1..12 {
            for (first, count) in (0..width).flat_map(|first| (1..=width).map(move |count| (first, count))) {
                let columns = Columns { first: first as usize, count: count as usize };
                let [from, many] = in_use(columns, width as usize);
                let all = |first: u32, count: u32| (0..count).map(move |i| (first + i) % width);
                assert!(all(first, count).all(|c| all(from, many).any(|d| c == d)), "{first} {count} {width}");
                assert!(width % 2 == 1 || (from % 2, many % 2) == (0, 0), "{first} {count} {width}");
                assert!(many <= width && many <= count + 2, "{first} {count} {width}");
            }
        }
    }
}
