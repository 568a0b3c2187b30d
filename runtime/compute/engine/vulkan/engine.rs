//! Implements the engine with its buffers, one recording per part of a list, and the return of losses and times.

use super::super::{
    Buffer, Dispatch, Engine, EngineError, Kernel, LookUp, Memory, PendingStep, Purpose, Resource, Shape, State, Step,
    StepResult, Storage, Timing, check_shape, misfit, not_kept, not_under_way, nothing_kept,
};
use super::check::check;
use super::fft::Fft;
use super::flight::{Flight, Guarded, Verdict};
use super::layout::{Arenas, Layout, Slot, Value, pupil_pass_buffer, slots};
use super::look_up::{Tables, look_up};
use super::record::{Hazards, Stack, Stacks, Work};
use super::splats::VulkanSplats;
use super::views::Views;
use crate::gpu::{Block, Commands, DeviceKind, Gpu, IN_FLIGHT, PhasesOnDevice};
use crate::plan::BufferSize;
use crate::plan::fusion::Fusion;
use crate::scene::{Pyramid, SplatDrawer};
use std::collections::HashMap;
use std::fmt::Write;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Runs lists of kernels on a Vulkan device.
pub struct VulkanEngine {
    // Fields are dropped in this order, the device last.
    stacks: Stacks,
    /// The phases that are kept.
    kept: Option<Stack>,
    /// Tables of the last look-up of first phases.
    tables: Option<Tables>,
    pub(super) arenas: Arenas,
    /// Lists in flight, used in turn. `at` is the index of the last one.
    pub(super) flights: [Flight; IN_FLIGHT],
    pub(super) at: usize,
    /// Number of steps that were begun.
    begun: u64,
    pub(super) views: Option<Arc<Views>>,
    /// Sums of the loss on the device.
    pub(super) losses: Option<Block>,
    pub(super) verdict: Option<Verdict>,
    transforms: Fft,
    pub(super) shape: Shape,
    /// Places of the pupil pass buffers of the last step.
    slots: Vec<Slot>,
    /// Pupil pass buffers that were written since. The next step determines their place.
    written: HashMap<Buffer, Vec<f32>>,
    clock: [(u64, f64); Kernel::ALL.len()],
    is_timed: bool,
    pub(super) gpu: Commands,
}

impl VulkanEngine {
    /// Makes an engine on a device that has not been tested.
    pub(super) fn untested(gpu: &Gpu) -> Result<Self, EngineError> {
        let gpu = Commands::new(gpu)?;
        Ok(Self {
            stacks: Stacks::default(),
            kept: None,
            tables: None,
            arenas: Arenas::default(),
            flights: Default::default(),
            at: 0,
            begun: 0,
            views: None,
            losses: None,
            verdict: None,
            transforms: Fft::default(),
            shape: Shape::empty(),
            slots: Vec::new(),
            written: HashMap::new(),
            clock: [(0, 0.0); Kernel::ALL.len()],
            is_timed: false,
            gpu,
        })
    }

    /// Returns the device of the engine.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu.shared
    }

    fn stack(&self, layout: Layout, what: &str) -> Result<Option<Stack>, EngineError> {
        if layout.values == 0 || layout.frames == 0 {
            return Ok(None);
        }
        let limit = self.gpu.limits.storage_range;
        if layout.at_once(limit) == 0 {
            let bytes = layout.frame_bytes();
            let reason = format!("one frame of the {what} takes {bytes} bytes, but a kernel binds {limit}");
            return Err(self.gpu.unsuitable(reason));
        }
        Ok(Some(Stack { layout, block: self.gpu.block(layout.bytes(), what)? }))
    }

    fn fill_moments(&mut self) {
        for moment in [Buffer::Momentum, Buffer::Second] {
            if let Ok(stack) = self.stacks.get(moment) {
                self.gpu.recorder.clear(stack.block.all());
            }
        }
    }

    /// Copies the pupil pass buffers that were written by hand into the slots of `group`.
    fn place_written(&mut self, group: &[Slot]) -> Result<(), EngineError> {
        for (buffer, data) in std::mem::take(&mut self.written) {
            let Some((resource, at, index)) = pupil_pass_buffer(buffer) else { continue };
            let Some(layout) = group.get(index).map(|slot| slot[at]) else {
                return Err(EngineError::mismatch(format!("{buffer:?} was written, but no pupil pass uses it")));
            };
            if layout.floats() != data.len() {
                return Err(misfit(buffer, layout.floats(), data.len()));
            }
            if let Some(block) = self.arenas.block(resource).filter(|_| !data.is_empty()) {
                layout.write(&mut self.gpu, block, &data)?;
            }
        }
        Ok(())
    }

    /// Runs these parts of a step's list after the work in flight. With `judged`, phases change only if all losses
    /// are finite. The result is in the flight that is then the last one.
    fn launch(&mut self, step: &Step, parts: &[Range<usize>], judged: bool) -> Result<(), EngineError> {
        for part in parts {
            check(step, part, &self.shape, self.views.as_deref())?;
        }
        let next = (self.at + 1) % IN_FLIGHT;
        let Flight { submission, during, .. } = &mut self.flights[next];
        if let Some(submission) = submission.take() {
            self.gpu.recorder.wait_for(submission, during)?;
        }
        self.absorb();
        (self.at, self.flights[next].seconds) = (next, 0.0);
        let list: Vec<&Dispatch> = parts.iter().flat_map(|part| &step.list[part.clone()]).collect();
        let flight = &mut self.flights[next];
        flight.answers.clear();
        (flight.number, flight.known) = (0, None);
        (flight.is_checked, flight.is_judged, flight.begun) = (false, false, Some(Instant::now()));
        if self.shape.frames == 0 || list.is_empty() {
            return Ok(());
        }
        self.stacks.hold(&mut self.gpu, step.model.as_ref())?;
        let flight = &mut self.flights[next];
        flight.lay_out(step, &self.shape, self.views.as_deref());
        self.fit_flights()?;
        self.flights[next].tables.stage();
        self.arenas.fit(&mut self.gpu, step, &self.shape)?;
        if let Some(first) = list.iter().find(|d| !d.pupil_passes.is_empty()) {
            let group = slots(&step.pupil_passes[first.pupil_passes.clone()], &self.shape);
            self.place_written(&group)?;
        }
        self.record(step, &list, judged, true)
    }

    pub(super) fn record(
        &mut self,
        step: &Step,
        list: &[&Dispatch],
        judged: bool,
        runs: bool,
    ) -> Result<(), EngineError> {
        let Self { stacks, arenas, flights, at, views, losses, verdict, transforms, shape, gpu, is_timed, .. } = self;
        let flight = &mut flights[*at];
        let answers = |d: &Dispatch| d.kernel.writes().any(|r| matches!(r, Resource::Losses | Resource::NotFinite));
        let changes = |d: &Dispatch| d.kernel.writes().any(|r| r == Resource::Phases);
        let known = list.iter().rposition(|d| answers(d)).map_or(list.len(), |i| i + 1);
        let verdict = verdict.as_ref().filter(|_| judged && list[known..].iter().any(|d| changes(d)));
        flight.is_judged = verdict.is_some();
        let sums = losses.as_ref().map(|l| (l, &flight.offsets[..]));
        let mut groups = flight.groups.take();
        let guarded = verdict.zip(groups.as_mut()).map(|(verdict, groups)| Guarded {
            verdict,
            groups,
            count: 0,
            is_judged: false,
            part: 0,
        });
        let mut work = Work {
            gpu,
            transforms,
            shape,
            step,
            stacks,
            arenas,
            tables: &flight.tables,
            views: views.as_deref(),
            guarded,
            losses: sums,
            hazards: Hazards::default(),
        };
        work.gpu.gather_uploads();
        let prepared = work.prepare(list);
        work.gpu.send_uploads()?;
        prepared?;
        let ways = work.ways(list);
        let marks = if *is_timed { list.len() } else { 1 };
        work.gpu.recorder.is_cut = runs && work.gpu.device.planned_as != DeviceKind::Cpu;
        work.gpu.recorder.begin(marks)?;
        // Earlier submissions may still be running.
        work.gpu.recorder.barrier();
        flight.tables.record(work.gpu);
        work.prepare_verdict(flight.end, verdict.is_some_and(|v| v.is_bad));
        let mut group: (Range<usize>, Vec<Slot>) = (0..0, Vec::new());
        let entries = list.iter().zip(ways).enumerate().filter(|(_, (_, way))| *way != Fusion::Elsewhere);
        for (i, (dispatch, way)) in entries {
            if !dispatch.pupil_passes.is_empty() && dispatch.pupil_passes != group.0 {
                group =
                    (dispatch.pupil_passes.clone(), slots(&step.pupil_passes[dispatch.pupil_passes.clone()], shape));
            }
            if i >= known {
                work.judge(flight.end)?;
            }
            work.record(dispatch, way, &group.1)?;
            match *is_timed {
                true => work.gpu.recorder.mark(dispatch.kernel as usize),
                false => work.gpu.recorder.note(dispatch.kernel as usize),
            }
        }
        let compared = list.iter().filter(|d| d.kernel.writes().any(|r| r == Resource::Losses));
        let parts = |i: usize| step.pupil_passes[i].loss_parts();
        let places = &flight.offsets;
        // The answers are of this recording alone, because a step that is only prepared has answers as well.
        flight.answers.clear();
        flight.answers.extend(compared.flat_map(|d| d.pupil_passes.clone()).map(|i| (i, places[i], parts(i))));
        flight.is_checked = list.iter().any(|d| d.kernel.writes().any(|r| r == Resource::NotFinite));
        if let Some(losses) = losses.as_ref() {
            work.gpu.recorder.barrier();
            flight.copy_back(work.gpu, losses, verdict);
        }
        if !*is_timed {
            work.gpu.recorder.mark_end();
        }
        flight.groups = groups;
        if !runs {
            return Ok(());
        }
        flight.during.clear();
        if let [first, .., last] = list {
            let _ = write!(flight.during, "{} to {}", first.kernel.name(), last.kernel.name());
        } else {
            flight.during.extend(list.iter().map(|d| d.kernel.name()));
        }
        flight.submission = Some(self.gpu.recorder.send(&flight.during)?);
        self.gpu.recorder.is_cut = false;
        self.gpu.device.pipelines().save();
        if let Some(verdict) = self.verdict.as_mut().filter(|_| flight.is_judged) {
            verdict.is_bad = false;
        }
        if !group.1.is_empty() {
            self.slots = group.1;
        }
        Ok(())
    }

    /// Takes over the recorder's times.
    fn absorb(&mut self) {
        for time in self.gpu.recorder.times.drain(..) {
            if let Some((calls, seconds)) = self.clock.get_mut(time.label) {
                *calls += 1;
                *seconds += time.seconds;
            }
            if let Some(flight) = self.flights.iter_mut().find(|f| f.submission == Some(time.submission)) {
                flight.seconds += time.seconds;
            }
        }
    }

    /// Waits for a flight and returns its result, for a step of `count` pupil passes.
    fn finish_steps(&mut self, at: usize, count: usize) -> Result<StepResult, EngineError> {
        let Flight { submission, during, .. } = &self.flights[at];
        if let Some(submission) = *submission {
            self.gpu.recorder.wait_for(submission, during)?;
        }
        self.absorb();
        let flight = &mut self.flights[at];
        flight.submission = None;
        let waited = flight.begun.take().map_or(0.0, |begun| begun.elapsed().as_secs_f64());
        let seconds = if flight.seconds > 0.0 { flight.seconds } else { waited };
        let losses = match flight.known.take() {
            _ if self.gpu.device.record_only => vec![0.0; count],
            Some(losses) => losses,
            None => flight.losses(count),
        };
        if flight.is_judged
            && losses.iter().any(|loss| !loss.is_finite())
            && let Some(verdict) = &mut self.verdict
        {
            verdict.is_bad = true;
        }
        Ok(StepResult { losses, seconds })
    }
}

impl Drop for VulkanEngine {
    fn drop(&mut self) {
        // Work in flight reads and writes the buffers that are freed now.
        let _ = self.gpu.recorder.idle();
    }
}

impl Engine for VulkanEngine {
    fn describe(&self) -> String {
        let r = &self.gpu.device.report;
        format!("Vulkan {}, {} ({}), {}", r.api, r.name, r.kind, r.driver)
    }

    fn lists(&self) -> &'static str {
        match self.gpu.device.planned_as {
            DeviceKind::Cpu => "kernel by kernel", // A CPU has no special shared memory.
            _ => "with kernels fused to the transforms next to them",
        }
    }

    fn memory(&self) -> Memory {
        Memory::of(self.gpu.device.report.kind)
    }

    fn preferred_storage(&self) -> Storage {
        if self.gpu.device.planned_as == DeviceKind::Cpu { Storage::F32 } else { Storage::F16 }
    }

    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError> {
        if self.memory() != Memory::Device {
            check_shape(shape, shape.storage.bytes() as u64)?;
        }
        // The old buffers are freed first, because both may not fit.
        self.gpu.recorder.idle()?;
        (self.stacks, self.kept, self.tables) = (Stacks::default(), None, None);
        (self.arenas, self.views) = (Arenas::default(), None);
        self.slots.clear();
        self.written.clear();
        self.shape = *shape;
        if let Some(views) = views {
            self.views = Some(Views::of(&mut self.gpu, &views)?);
        }
        for (at, resource) in Resource::OF_SHAPE.into_iter().enumerate() {
            let BufferSize { frames, values, complex } = shape.extent(resource);
            let value = match resource {
                _ if complex => Value::Complex(resource.stored(shape.storage)),
                Resource::Phases if shape.binary_angles => Value::Angle,
                _ if shape.stores_half(resource) => Value::Half,
                _ => Value::Real,
            };
            self.stacks.0[at] = self.stack(Layout { offset: 0, frames, values, value }, &resource.name())?;
        }
        self.verdict = None;
        if shape.purpose != Purpose::View {
            self.verdict = Some(Verdict::new(&self.gpu, shape.frames)?);
        }
        self.gpu.recorder.begin(0)?;
        for stack in self.stacks.0.iter().flatten() {
            self.gpu.recorder.clear(stack.block.all());
        }
        self.gpu.recorder.submit("clearing").map(drop)
    }

    fn take_views(&mut self, views: Arc<Pyramid>) -> Result<(), EngineError> {
        self.gpu.recorder.idle()?;
        self.views = None; // Both may not fit.
        self.views = Some(Views::of(&mut self.gpu, &views)?);
        Ok(())
    }

    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError> {
        if pupil_pass_buffer(buffer).is_some() {
            self.written.insert(buffer, data.to_vec());
            return Ok(());
        }
        let Stack { layout, block } = self.stacks.get(buffer)?;
        if layout.floats() != data.len() {
            return Err(misfit(buffer, layout.floats(), data.len()));
        }
        layout.write(&mut self.gpu, block, data)
    }

    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError> {
        let Some((resource, at, index)) = pupil_pass_buffer(buffer) else {
            let Stack { layout, block } = self.stacks.get(buffer)?;
            if buffer == Buffer::Phases {
                self.gpu.device.count(|counts| counts.phases_read_back += layout.bytes());
            }
            return layout.read(&mut self.gpu, block);
        };
        if let Some(data) = self.written.get(&buffer) {
            return Ok(data.clone());
        }
        let never = || EngineError::mismatch(format!("{buffer:?} was never written"));
        let layout = self.slots.get(index).ok_or_else(never)?[at];
        if layout.floats() == 0 {
            return Ok(Vec::new());
        }
        layout.read(&mut self.gpu, self.arenas.block(resource).ok_or_else(never)?)
    }

    fn keep(&mut self, buffer: Buffer) -> Result<(), EngineError> {
        if !matches!(buffer, Buffer::Phases | Buffer::Shown) {
            return Err(not_kept(buffer));
        }
        let layout = self.stacks.get(buffer)?.layout;
        if self.kept.is_none() {
            self.kept = self.stack(layout, "phases that are kept")?;
        }
        let (Some(kept), from) = (&self.kept, self.stacks.get(buffer)?) else { return Err(nothing_kept()) };
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.copy(&from.block, &kept.block, [(0, 0, layout.bytes())]);
        self.gpu.recorder.submit("keeping phases").map(drop)
    }

    fn kept(&mut self) -> Result<Vec<f32>, EngineError> {
        let Stack { layout, block } = self.kept.as_ref().ok_or_else(nothing_kept)?;
        self.gpu.device.count(|counts| counts.phases_read_back += layout.bytes());
        layout.read(&mut self.gpu, block)
    }

    fn restore(&mut self) -> Result<(), EngineError> {
        let kept = self.kept.as_ref().ok_or_else(nothing_kept)?;
        let phases = self.stacks.get(Buffer::Phases)?;
        self.gpu.recorder.begin(0)?;
        self.gpu.recorder.copy(&kept.block, &phases.block, [(0, 0, phases.layout.bytes())]);
        self.fill_moments();
        self.gpu.recorder.submit("beginning again").map(drop)
    }

    fn look_up(&mut self, of: &LookUp) -> Result<(), EngineError> {
        let nothing = || EngineError::mismatch("no views were loaded");
        let views = self.views.clone().ok_or_else(nothing)?;
        let phases = self.stacks.get(Buffer::Phases)?;
        look_up(&mut self.gpu, &mut self.tables, &views, phases, of)
    }

    fn clear_moments(&mut self) -> Result<(), EngineError> {
        self.gpu.recorder.begin(0)?;
        self.fill_moments();
        self.gpu.recorder.submit("forgetting velocities").map(drop)
    }

    fn splat_drawer(&self) -> Result<Option<Arc<dyn SplatDrawer>>, EngineError> {
        let gpu = &self.gpu.shared;
        Ok(if gpu.draws_views() { Some(Arc::new(VulkanSplats::new(gpu)?)) } else { None })
    }

    fn phases_on_device(&self) -> Option<PhasesOnDevice<'_>> {
        let Stack { layout, block } = self.stacks.get(Buffer::Phases).ok()?;
        Some(PhasesOnDevice {
            block,
            frames: layout.frames,
            values: layout.values,
            binary_angles: layout.value == Value::Angle,
        })
    }

    fn run_part(&mut self, step: &Step, part: Range<usize>) -> Result<Vec<f64>, EngineError> {
        self.launch(step, &[part], false)?;
        Ok(self.finish_steps(self.at, step.pupil_passes.len())?.losses)
    }

    fn begin_step(&mut self, step: &Step, parts: &[Range<usize>]) -> Result<PendingStep, EngineError> {
        self.launch(step, parts, true)?;
        let flight = &mut self.flights[self.at];
        self.begun += 1;
        (flight.number, flight.pupil_passes) = (self.begun, step.pupil_passes.len());
        Ok(PendingStep(State::UnderWay(self.begun)))
    }

    fn end_step(&mut self, begun: PendingStep) -> Result<StepResult, EngineError> {
        let number = match begun.0 {
            State::Over(taken) => return Ok(taken),
            State::UnderWay(number) => number,
        };
        let at = self.flights.iter().position(|f| f.number == number).ok_or_else(not_under_way)?;
        self.flights[at].number = 0;
        self.finish_steps(at, self.flights[at].pupil_passes)
    }

    fn prepare(&mut self, steps: &mut dyn Iterator<Item = Step>, at_once: Option<usize>) -> Result<(), EngineError> {
        self.prepare_steps(steps, at_once)
    }

    fn prepare_later(&mut self, steps: &mut dyn Iterator<Item = Step>, at_once: usize) -> Result<(), EngineError> {
        self.prepare_steps_later(steps, at_once)
    }

    fn time_kernels(&mut self, on: bool) {
        self.is_timed = on;
    }

    fn timings(&self) -> Vec<Timing> {
        let one = |kernel: Kernel| {
            let (calls, seconds) = self.clock[kernel as usize];
            Timing { kernel, calls, seconds, bytes: 0, operations: 0 }
        };
        Kernel::ALL.into_iter().map(one).filter(|t| t.calls > 0).collect()
    }

    fn reset_timings(&mut self) {
        self.clock.fill((0, 0.0));
    }
}
