//! Reads the times of presented pictures from `VK_EXT_present_timing`.

#![allow(unsafe_code)]

use ash::vk;
use eyebox_compute::gpu::presentation::{
    PastTiming, PastTimingInfo, PastTimings, PresentTimingInfo, StageTime, TimeDomains, TimingCalls,
};

/// The most pictures whose light may be unconfirmed.
pub(super) const MOST: usize = 16;
/// The most time domains of a swapchain that are read.
const DOMAINS: usize = 8;

/// The source of times of one swapchain.
pub(super) struct PastTimes {
    device: vk::Device,
    calls: TimingCalls,
    /// The stage whose time is requested.
    stage: u32,
    /// The number of the monotonic clock of the system among the swapchain's time domains.
    domain: Option<u64>,
}

impl PastTimes {
    pub(super) fn new(device: vk::Device, calls: TimingCalls, stage: u32) -> Self {
        Self { device, calls, stage, domain: None }
    }

    /// Prepares a new swapchain. Returns false if its driver has no times on the clock of the system.
    pub(super) fn begin(&mut self, swapchain: vk::SwapchainKHR) -> bool {
        let (mut domains, mut ids) = ([vk::TimeDomainKHR::default(); DOMAINS], [0; DOMAINS]);
        let (list, numbers) = (domains.as_mut_ptr(), ids.as_mut_ptr());
        let mut all = TimeDomains { count: DOMAINS as u32, domains: list, ids: numbers, ..TimeDomains::default() };
        // SAFETY: The swapchain was made for times, and both arrays have room for `count` values.
        let [sized, read] = unsafe {
            let sized = (self.calls.set_queue_size)(self.device, swapchain, MOST as u32);
            [sized, (self.calls.domains)(self.device, swapchain, &mut all, std::ptr::null_mut())]
        };
        let is_read = sized == vk::Result::SUCCESS && matches!(read, vk::Result::SUCCESS | vk::Result::INCOMPLETE);
        let count = if is_read { (all.count as usize).min(DOMAINS) } else { 0 };
        let monotonic = domains[..count].iter().position(|domain| *domain == vk::TimeDomainKHR::CLOCK_MONOTONIC);
        self.domain = monotonic.map(|at| ids[at]);
        self.domain.is_some()
    }

    /// Returns the request for the time of one picture.
    pub(super) fn request(&self) -> Option<PresentTimingInfo> {
        let request = |time_domain_id| PresentTimingInfo { time_domain_id, stages: self.stage, ..Default::default() };
        self.domain.map(request)
    }

    /// Calls `each` with the number of each picture whose result is complete, and its time in nanoseconds if it has one.
    pub(super) fn take(&self, swapchain: vk::SwapchainKHR, mut each: impl FnMut(u64, Option<u64>)) {
        let mut times = [StageTime::default(); MOST];
        let first = times.as_mut_ptr();
        let mut timings: [PastTiming; MOST] = std::array::from_fn(|i| PastTiming {
            stage_count: 1,
            // SAFETY: The element is inside the array.
            stages: unsafe { first.add(i) },
            ..PastTiming::default()
        });
        let mut all = PastTimings { count: MOST as u32, timings: timings.as_mut_ptr(), ..PastTimings::default() };
        let info = PastTimingInfo { swapchain, ..PastTimingInfo::default() };
        // SAFETY: The swapchain was made for times, and there is room for `count` results of one stage each.
        let answer = unsafe { (self.calls.past)(self.device, &info, &mut all) };
        if !matches!(answer, vk::Result::SUCCESS | vk::Result::INCOMPLETE) {
            return;
        }
        for (i, timing) in timings.iter().take(all.count as usize).enumerate() {
            // SAFETY: The element is inside the array, which the driver no longer writes.
            let StageTime { stage, time } = unsafe { *first.add(i) };
            let is_known = timing.stage_count > 0 && stage == self.stage && time > 0;
            let is_ours = timing.is_complete == vk::TRUE && Some(timing.time_domain_id) == self.domain;
            each(timing.present_id, Some(time).filter(|_| is_known && is_ours));
        }
    }
}
