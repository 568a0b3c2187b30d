//! The switch that finds a wrong kernel: a list runs on one engine up to a kernel, and on another from it on.

use super::{Buffer, Engine, EngineError, Kernel, Purpose, Scope, Shape, Step, Timing};
use crate::scene::Pyramid;
use std::ops::Range;
use std::sync::Arc;

/// Two engines as one. State lives on the first; the second has it from the kernel on, and gives it back.
pub struct Handover {
    first: Box<dyn Engine>,
    second: Box<dyn Engine>,
    from: Kernel,
    shape: Option<Shape>,
}

impl Handover {
    /// `from` is the first kernel that runs on `second`, in every list that has it.
    pub fn new(first: Box<dyn Engine>, second: Box<dyn Engine>, from: Kernel) -> Self {
        Self { first, second, from, shape: None }
    }

    /// Buffers of the whole shape.
    fn shared(&self) -> Vec<Buffer> {
        let mut buffers = vec![Buffer::Phases, Buffer::Field];
        match self.shape.map(|s| s.purpose) {
            Some(Purpose::Project) => buffers.extend([Buffer::Change, Buffer::Hits, Buffer::Momentum]),
            Some(Purpose::Adam) => buffers.extend([Buffer::Change, Buffer::Hits, Buffer::Momentum, Buffer::Second]),
            _ => {}
        }
        buffers
    }
}

/// Lane buffers that the kernels of `part` have written and not overwritten by another group of lanes.
fn lane_buffers(step: &Step, part: Range<usize>) -> Vec<Buffer> {
    let over_lanes = |d: &&super::Dispatch| d.kernel.scope() == Scope::Lanes;
    let Some(last) = step.list[part.clone()].iter().filter(over_lanes).next_back() else { return Vec::new() };
    let mut buffers = Vec::new();
    for dispatch in step.list[part].iter().filter(|d| over_lanes(d) && d.lanes == last.lanes) {
        for slot in 0..dispatch.lanes.len() {
            buffers.extend(match dispatch.kernel {
                Kernel::Transfer => Some(Buffer::Transfer(slot)),
                Kernel::Photograph => Some(Buffer::Accumulator(slot)),
                Kernel::Resample => Some(Buffer::Target(slot)),
                Kernel::PassPupil => Some(Buffer::Window(slot)),
                Kernel::Intensity => Some(Buffer::Image(slot)),
                _ => None,
            });
        }
    }
    buffers
}

impl Engine for Handover {
    fn describe(&self) -> String {
        format!("{} up to {}, then {}", self.first.describe(), self.from.name(), self.second.describe())
    }

    fn load(&mut self, shape: &Shape, views: Option<Arc<Pyramid>>) -> Result<(), EngineError> {
        self.shape = Some(*shape);
        self.first.load(shape, views.clone())?;
        self.second.load(shape, views)
    }

    fn write(&mut self, buffer: Buffer, data: &[f32]) -> Result<(), EngineError> {
        self.first.write(buffer, data)
    }

    fn read(&mut self, buffer: Buffer) -> Result<Vec<f32>, EngineError> {
        self.first.read(buffer)
    }

    fn run_part(&mut self, step: &Step, part: Range<usize>) -> Result<Vec<f64>, EngineError> {
        let cut =
            step.list[part.clone()].iter().position(|d| d.kernel == self.from).map_or(part.end, |i| part.start + i);
        let mut losses = self.first.run_part(step, part.start..cut)?;
        if cut == part.end {
            return Ok(losses);
        }
        // A list may begin in the middle of a group of lanes: what ran before it counts as well.
        for buffer in self.shared().into_iter().chain(lane_buffers(step, 0..cut)) {
            let data = self.first.read(buffer)?;
            self.second.write(buffer, &data)?;
        }
        let rest = self.second.run_part(step, cut..part.end)?;
        for (loss, other) in losses.iter_mut().zip(rest) {
            *loss += other;
        }
        for buffer in self.shared().into_iter().chain(lane_buffers(step, 0..part.end)) {
            let data = self.second.read(buffer)?;
            self.first.write(buffer, &data)?;
        }
        Ok(losses)
    }

    fn timings(&self) -> Vec<Timing> {
        let mut all = self.first.timings();
        all.extend(self.second.timings());
        all.sort_by_key(|t| t.kernel as usize);
        all
    }

    fn reset_timings(&mut self) {
        self.first.reset_timings();
        self.second.reset_timings();
    }
}
