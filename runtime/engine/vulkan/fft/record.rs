//! Records the passes of planned transforms.

use super::super::DeviceKind;
use super::super::device::Block;
use super::super::gpu::Gpu;
use super::super::pipelines::Pipeline;
use super::super::recorder::Range;
use super::{EngineError, Frames, Transform};
use eyebox_kernels::fft::{Columns, Direction};
use eyebox_kernels::fft_plan::{self, Method, Pass, Plan, PlanLimits, Radix};
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Invocations of a workgroup of a pass through global memory.
const CROWD: u32 = 64;

/// Scratch that is spent on frames at once, at least one frame, in bytes.
const SCRATCH: u64 = 64 << 20;

/// Push constants of `fft_pass` and `fft_direct`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct PassArguments {
    n: u32,
    done: u32,
    step: u32,
    lines: u32,
    inverse: u32,
    from: Layout,
    to: Layout,
    radix: u32,
}

/// How frames lie in memory, in complex values.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Layout {
    /// First column.
    first: u32,
    /// Columns before they wrap.
    wrap: u32,
    /// From row to row.
    row: u32,
    /// From frame to frame.
    frame: u32,
}

/// Plans, tables and scratch of all sizes seen.
pub(in super::super) struct Fft {
    axes: HashMap<(u32, Axis), Arc<Prepared>>,
    roots: HashMap<u32, Block>,
    scratch: Option<Block>,
    /// Scratch that became too small while it was in a recording.
    outgrown: Vec<Block>,
    /// Names of the passes recorded, where they are to be timed one by one.
    pub(in super::super) marks: Option<Vec<String>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Axis {
    Rows,
    Columns,
}

/// A length's plan and the pipelines of its passes.
struct Prepared {
    plan: Plan,
    pipelines: Vec<Pipeline>,
}

/// One axis of some frames, as its passes see them.
struct Work<'a> {
    data: Range<'a>,
    scratch: Range<'a>,
    frames: u32,
    height: u32,
    columns: Columns,
    direction: Direction,
    layout: Layout,
    spare: Layout,
}

impl Fft {
    pub(in super::super) fn new() -> Self {
        Self { axes: HashMap::new(), roots: HashMap::new(), scratch: None, outgrown: Vec::new(), marks: None }
    }

    /// The plan of an axis in words, once it is prepared.
    pub(in super::super) fn plans(&self, height: usize, width: usize) -> [String; 2] {
        [(width, Axis::Rows), (height, Axis::Columns)].map(|(n, axis)| match self.axes.get(&(n as u32, axis)) {
            Some(axis) => axis.plan.to_string(),
            None => String::new(),
        })
    }

    /// Plan, table and pipelines of a length.
    fn axis(&mut self, gpu: &mut Gpu, n: usize, axis: Axis) -> Result<(), EngineError> {
        let n = u32::try_from(n).unwrap_or(u32::MAX);
        if self.axes.contains_key(&(n, axis)) {
            return Ok(());
        }
        let limits = plan_limits(gpu, axis);
        let plan = match axis {
            Axis::Rows => fft_plan::rows(n, &limits),
            Axis::Columns => fft_plan::columns(n, &limits),
        };
        if !self.roots.contains_key(&n) && n > 1 {
            let table: Vec<[f32; 2]> = (0..n).map(|k| root(k, n)).collect();
            let block = gpu.filled(bytemuck::cast_slice(&table), "roots of unity")?;
            self.roots.insert(n, block);
        }
        let pipelines = match &plan.method {
            Method::Shared { stages, threads, lines, .. } => vec![shared_pipeline(gpu, stages, *threads, *lines)?],
            Method::Passes(passes) => passes.iter().map(|p| pipeline(gpu, *p, axis)).collect::<Result<_, _>>()?,
        };
        self.axes.insert((n, axis), Arc::new(Prepared { plan, pipelines }));
        Ok(())
    }

    fn scratch(&mut self, gpu: &Gpu, size: u64) -> Result<(), EngineError> {
        if self.scratch.as_ref().is_none_or(|s| s.size < size) {
            let made = gpu.block(size, "scratch of the transform")?;
            self.outgrown.extend(self.scratch.replace(made));
        }
        Ok(())
    }

    fn mark(&mut self, gpu: &mut Gpu, name: impl FnOnce() -> String) {
        if let Some(marks) = &mut self.marks {
            gpu.recorder.mark(marks.len());
            marks.push(name());
        }
    }
}

impl Transform for Fft {
    fn prepare(&mut self, gpu: &mut Gpu, height: usize, width: usize, _: Direction) -> Result<(), EngineError> {
        self.outgrown.clear();
        self.axis(gpu, width, Axis::Rows)?;
        self.axis(gpu, height, Axis::Columns)
    }

    fn record(
        &mut self,
        gpu: &mut Gpu,
        frames: Frames<'_>,
        direction: Direction,
        columns: Columns,
    ) -> Result<(), EngineError> {
        let (height, width) = (frames.height as u32, frames.width as u32);
        // One row more than whole cache lines, so that rows do not all fall on the same ones.
        let spare_row = width.next_multiple_of(8) + 8;
        let spare_frame = spare_row * height;
        let fit = |bytes: u64, frame: u64| (bytes / frame.max(1)).max(1) as usize;
        let limits = *gpu.limits();
        let at_once = fit(limits.storage_range, 8 * frames.stride as u64)
            .min(fit(SCRATCH.min(limits.storage_range), 8 * u64::from(spare_frame)))
            .min(limits.groups[2] as usize)
            .min(frames.count);
        let order = match direction {
            Direction::Forward => [Axis::Rows, Axis::Columns],
            Direction::Inverse => [Axis::Columns, Axis::Rows],
        };
        let uses_scratch = [(width, Axis::Rows), (height, Axis::Columns)]
            .iter()
            .any(|key| matches!(self.axes.get(key).map(|a| &a.plan.method), Some(Method::Passes(p)) if p.len() > 1));
        if uses_scratch {
            self.scratch(gpu, 8 * u64::from(spare_frame) * at_once as u64)?;
        }
        for first in (0..frames.count).step_by(at_once.max(1)) {
            let count = at_once.min(frames.count - first);
            let offset = frames.offset + 8 * (frames.stride * first) as u64;
            let size = 8 * (frames.stride * (count - 1) + frames.height * frames.width) as u64;
            let data = frames.block.range(offset, size);
            let mut begun = false;
            for axis in order {
                let n = if axis == Axis::Rows { width } else { height };
                let Some(prepared) = self.axes.get(&(n, axis)).cloned() else {
                    debug_assert!(false, "transforms are prepared before they are recorded");
                    continue;
                };
                if axis == Axis::Columns && columns.count == 0 {
                    continue;
                }
                let scratch = self.scratch.take();
                let work = Work {
                    data,
                    scratch: match &scratch {
                        Some(scratch) if uses_scratch => scratch.range(0, 8 * u64::from(spare_frame) * count as u64),
                        _ => data,
                    },
                    frames: count as u32,
                    height,
                    columns,
                    direction,
                    layout: Layout { first: 0, wrap: width, row: width, frame: frames.stride as u32 },
                    spare: Layout { first: 0, wrap: u32::MAX, row: spare_row, frame: spare_frame },
                };
                let done = match &prepared.plan.method {
                    Method::Shared { lines, .. } => {
                        if begun {
                            gpu.recorder.barrier();
                        }
                        begun = true;
                        self.whole_rows(gpu, &work, n, *lines, prepared.pipelines[0])
                    }
                    Method::Passes(passes) => {
                        let passes = passes.iter().copied().zip(prepared.pipelines.iter().copied());
                        self.passes(gpu, &work, axis, n, passes, &mut begun)
                    }
                };
                self.scratch = scratch;
                done?;
            }
        }
        Ok(())
    }
}

impl Fft {
    /// From the data to the scratch and back, until all passes are done; an odd last one stays on the data.
    fn passes(
        &mut self,
        gpu: &mut Gpu,
        work: &Work<'_>,
        axis: Axis,
        n: u32,
        passes: impl ExactSizeIterator<Item = (Pass, Pipeline)>,
        begun: &mut bool,
    ) -> Result<(), EngineError> {
        let count = match axis {
            Axis::Rows => work.height,
            Axis::Columns => work.columns.count as u32,
        };
        let data = match axis {
            Axis::Rows => work.layout,
            Axis::Columns => Layout { first: work.columns.first as u32, ..work.layout },
        };
        let (mut done, mut in_scratch) = (1, false);
        let last = passes.len().saturating_sub(1);
        for (i, (pass, pipeline)) in passes.enumerate() {
            let to_scratch = !in_scratch && i < last;
            // What came before, in this transform or in another one, may still use the scratch.
            if *begun || to_scratch {
                gpu.recorder.barrier();
            }
            *begun = true;
            let side = |scratch: bool| if scratch { (work.scratch, work.spare) } else { (work.data, data) };
            let ((from, from_layout), (to, to_layout)) = (side(in_scratch), side(to_scratch));
            let radix = pass.radix();
            let arguments = PassArguments {
                n,
                done,
                step: n / done / radix,
                lines: count,
                inverse: u32::from(work.direction == Direction::Inverse),
                from: from_layout,
                to: to_layout,
                radix,
            };
            let items = match pass {
                Pass::Butterfly(_) => n / radix,
                Pass::Direct(_) => n,
            };
            let (along, across) = if axis == Axis::Rows { (items, count) } else { (count, items) };
            let groups = [along.div_ceil(CROWD), across.min(gpu.limits().groups[1]), work.frames];
            let Some(roots) = self.roots.get(&n) else { return Ok(()) };
            gpu.recorder.dispatch(pipeline, &[from, to, roots.all()], bytemuck::bytes_of(&arguments), groups)?;
            self.mark(gpu, || format!("{axis:?} {n}: radix {radix}"));
            done *= radix;
            in_scratch = to_scratch;
        }
        Ok(())
    }
}

impl Fft {
    /// All rows through shared memory, in place.
    fn whole_rows(
        &mut self,
        gpu: &mut Gpu,
        work: &Work<'_>,
        n: u32,
        lines: u32,
        pipeline: Pipeline,
    ) -> Result<(), EngineError> {
        let inverse = u32::from(work.direction == Direction::Inverse);
        let arguments = [work.height, inverse, work.layout.row, work.layout.frame];
        let wanted = work.height.div_ceil(lines);
        let along = wanted.min(gpu.limits().groups[0]);
        let groups = [along, wanted.div_ceil(along), work.frames];
        let Some(roots) = self.roots.get(&n) else { return Ok(()) };
        gpu.recorder.dispatch(pipeline, &[work.data, roots.all()], bytemuck::cast_slice(&arguments), groups)?;
        self.mark(gpu, || format!("Rows {n}: in shared memory"));
        Ok(())
    }
}

/// The pipeline of whole rows.
fn shared_pipeline(gpu: &mut Gpu, stages: &[Radix], threads: u32, lines: u32) -> Result<Pipeline, EngineError> {
    let mut constants = [0; 11 + 3 * CONSTANTS];
    constants[..2].copy_from_slice(&[threads, lines]);
    for i in 0..3 {
        let radix = stages.get(i).copied().unwrap_or(Radix::ONE);
        constants[2 + 3 * i..][..3].copy_from_slice(&[radix.a, radix.b, radix.c]);
        roots_within(radix, &mut constants[11 + CONSTANTS * i..][..CONSTANTS]);
    }
    gpu.pipeline(&eyebox_spirv::FFT_ROWS, 2, &constants)
}

/// The pipeline of a pass, from the first time on the same one.
fn pipeline(gpu: &mut Gpu, pass: Pass, axis: Axis) -> Result<Pipeline, EngineError> {
    let rows = u32::from(axis == Axis::Rows);
    match pass {
        Pass::Butterfly(radix) => {
            let mut constants = [0; 5 + CONSTANTS];
            constants[..5].copy_from_slice(&[radix.a, radix.b, radix.c, rows, CROWD]);
            roots_within(radix, &mut constants[5..]);
            gpu.pipeline(&eyebox_spirv::FFT_PASS, 3, &constants)
        }
        Pass::Direct(_) => gpu.pipeline(&eyebox_spirv::FFT_DIRECT, 3, &[rows, CROWD]),
    }
}

/// Specialisation constants of `fft_roots.glsl`.
const CONSTANTS: usize = 64;

/// Bits of cos and sin 2 pi k / radix, k = 1 .. 32.
fn roots_within(radix: Radix, constants: &mut [u32]) {
    for k in 1..=32 {
        let [re, im] = root(k, radix.size());
        constants[k as usize - 1] = re.to_bits();
        constants[k as usize + 31] = (-im).to_bits();
    }
}

/// What plans must fit on this device.
fn plan_limits(gpu: &Gpu, axis: Axis) -> PlanLimits {
    let limits = gpu.limits();
    let radix = match (gpu.report().kind, axis) {
        // A processor pays for every value that it gathers or scatters, and little for what spills from registers.
        (DeviceKind::Cpu, Axis::Rows) => 32,
        (DeviceKind::Cpu, Axis::Columns) => 36,
        _ => 16,
    };
    PlanLimits { shared_bytes: limits.shared_memory, invocations: limits.invocations, radix }
}

/// `exp(-i 2 pi k / n)`.
fn root(k: u32, n: u32) -> [f32; 2] {
    let (sin, cos) = (TAU * f64::from(k) / f64::from(n)).sin_cos();
    [cos as f32, -sin as f32]
}
