//! Records steps without running them, to measure their demands on a device and on the recording host.

use super::error::SolveError;
use super::problem::Problem;
use super::refine_settings::RefineSettings;
use super::settings::Settings;
use super::steer::Refiner;
use super::step::Steps;
use crate::engine::vulkan::VulkanEngine;
use crate::engine::{Engine, Memory, Storage};
use crate::gpu::{Counts, EngineError, Gpu};
use crate::optics::PupilDistribution;
use crate::plan::{DeviceModel, Estimate, Recording};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A recorded step and the counts of objects made for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DryRunStep {
    /// The commands of the step.
    pub recording: Recording,
    /// Counts of further work for the step.
    pub counts: Counts,
}

/// A series of recorded steps.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DryRun {
    /// The steps. Pipelines and memory are made for the first ones.
    pub steps: Vec<DryRunStep>,
    /// The storage of complex fields.
    pub storage: Storage,
    /// Time that the host takes to make, check and record a step. It is the median of as many further steps.
    pub host: Duration,
}

impl DryRun {
    /// Records steps of a solve, on a device that [only records](crate::gpu::Options::record_only).
    ///
    /// # Errors
    /// [`SolveError`] for wrong settings and for failures of the device.
    pub fn of_solve(problem: &Problem, settings: &Settings, gpu: &Gpu, count: usize) -> Result<Self, SolveError> {
        settings.check()?;
        let planner = problem.planner_of(settings);
        let memory = Memory::of(gpu.device.planned_as);
        let mut engine = VulkanEngine::new(gpu)?;
        engine.load(&planner.shape(settings.optimizer.purpose()), Some(Arc::clone(&problem.pyramid)))?;
        Steps::new(problem, &planner, settings, 1.0, memory).prepare(settings.steps.max(2 * count), &mut engine)?;
        let (mut steps, mut under_way) = (Steps::new(problem, &planner, settings, 1.0, memory), None);
        record_steps(gpu, count, settings.storage, || {
            let step = steps.next(0.5);
            let begun = engine.begin_step(&step, std::slice::from_ref(&(0..step.list.len())))?;
            under_way.replace(begun).map_or(Ok(()), |before| engine.end_step(before).map(drop))
        })
    }

    /// Records steps of a refinement for pupils of `aim`.
    ///
    /// # Errors
    /// [`SolveError`] for wrong settings and for failures of the device.
    pub fn of_refinement(
        problem: Problem,
        frames: usize,
        steering: RefineSettings,
        aim: PupilDistribution,
        gpu: &Gpu,
        count: usize,
    ) -> Result<Self, SolveError> {
        let phases = vec![0.0; frames * problem.optics.height * problem.optics.width];
        let engine = VulkanEngine::new(gpu)?;
        let storage = steering.storage.unwrap_or_else(|| engine.preferred_storage());
        let mut refiner = Refiner::new(problem, &phases, 1.0, steering, Box::new(engine))?;
        refiner.aim(aim)?;
        record_steps(gpu, count, storage, || refiner.advance().map(drop))
    }

    /// Returns the later half of the steps, which reuse most pipelines and memory.
    fn later(&self) -> &[DryRunStep] {
        &self.steps[self.steps.len() / 2..]
    }

    /// Estimates the time of a step of the later half on a device, without the host.
    pub fn estimate(&self, device: &DeviceModel) -> Estimate {
        device.estimate(&self.later().iter().map(|step| &step.recording).collect::<Vec<_>>(), self.storage.bytes())
    }

    /// Returns the mean of a number over the later half of the steps.
    pub fn mean(&self, of: impl Fn(&DryRunStep) -> u64) -> f64 {
        self.later().iter().map(|step| of(step) as f64).sum::<f64>() / self.later().len().max(1) as f64
    }
}

fn record_steps(
    gpu: &Gpu,
    count: usize,
    storage: Storage,
    mut step: impl FnMut() -> Result<(), EngineError>,
) -> Result<DryRun, SolveError> {
    let mut steps = Vec::with_capacity(count);
    for _ in 0..count {
        let before = gpu.counts();
        let (done, recording) = gpu.recorded(&mut step);
        done?;
        steps.push(DryRunStep { recording, counts: gpu.counts().since(before) });
    }
    // The host is timed without recording output because storing the recording takes time as well.
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        let begun = Instant::now();
        step()?;
        times.push(begun.elapsed());
    }
    times.sort();
    Ok(DryRun { steps, storage, host: times.get(times.len() / 2).copied().unwrap_or_default() })
}
