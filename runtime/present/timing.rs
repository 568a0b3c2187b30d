//! Measures when pictures light up, with the best source of times that a device has.
//!
//! The best sources are `VK_EXT_present_timing` and `VK_GOOGLE_display_timing`, the display's own times. The next are
//! `VK_KHR_present_wait2` and `VK_KHR_present_wait`, which return when a picture is out. The last extension is
//! `VK_EXT_display_control`, a fence at the next first pixel, for direct displays only. Otherwise the source is the time
//! at which acquiring an image had to wait.
//!
//! The thread that presents also waits, right after it presented. It has nothing else to do until the next picture, and
//! two threads must not use a swapchain at once.

#![allow(unsafe_code)]

mod past_times;

use ash::{ext, google, khr, vk};
use eyebox_base::steady;
use eyebox_compute::gpu::presentation::{
    self, PRESENT_TIMING, PRESENT_WAIT2, PresentTimingInfo, PresentWait2Info, TimingCalls, WITH_PRESENT_ID2,
    WITH_PRESENT_TIMING, WITH_PRESENT_WAIT2, WaitForPresent2,
};
use past_times::{MOST, PastTimes};
use std::collections::VecDeque;
use std::ffi::CStr;
use std::time::{Duration, Instant};

/// The time at which a picture lit up, as far as it can be measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct PresentTiming {
    /// The number of the picture.
    pub id: u64,
    /// The time that the display reports, or the time at which the screen took the picture, in nanoseconds of the
    /// system's monotonic clock.
    pub time_ns: u64,
}

/// A call that took this long waited for the screen, and ended when the screen advanced. After a shorter call, the
/// light may be older.
const WAITED: Duration = Duration::from_micros(500);
/// Time for which the thread that presents waits for a picture to light up. A picture that takes longer is checked
/// again after the next one.
const PATIENCE_NS: u64 = 25_000_000;

/// The support of a surface for times of light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct SurfaceTimes {
    /// True if it supports `VK_KHR_present_wait2`.
    pub(super) wait2: bool,
    /// The stage of `VK_EXT_present_timing` that is nearest to the light.
    pub(super) stage: Option<u32>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TimingMethod {
    /// The extension `VK_EXT_present_timing`, with the time of this stage.
    PresentTiming(u32),
    DisplayTiming,
    PresentWait2,
    /// The extensions `VK_KHR_present_id` and `VK_KHR_present_wait`.
    PresentWait,
    FirstPixel,
    /// The time at which acquiring an image had to wait.
    Acquire,
}

impl TimingMethod {
    /// The best of the enabled sources. `direct` is true for a display that no desktop drives.
    pub(super) fn best(is_on: impl Fn(&CStr) -> bool, surface: SurfaceTimes, direct: bool) -> Self {
        // The times of the first two sources are of the clock that all programs share.
        let timed = |extension: &CStr| steady::IS_SYSTEM_WIDE && is_on(extension);
        if let Some(stage) = surface.stage.filter(|_| timed(PRESENT_TIMING)) {
            Self::PresentTiming(stage)
        } else if timed(google::display_timing::NAME) {
            Self::DisplayTiming
        } else if surface.wait2 && is_on(PRESENT_WAIT2) {
            Self::PresentWait2
        } else if is_on(khr::present_id::NAME) && is_on(khr::present_wait::NAME) {
            Self::PresentWait
        } else if direct && is_on(ext::display_control::NAME) {
            Self::FirstPixel
        } else {
            Self::Acquire
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::PresentTiming(_) => "VK_EXT_present_timing",
            Self::DisplayTiming => "VK_GOOGLE_display_timing",
            Self::PresentWait2 => "VK_KHR_present_wait2",
            Self::PresentWait => "VK_KHR_present_wait",
            Self::FirstPixel => "VK_EXT_display_control",
            Self::Acquire => "the time of acquiring",
        }
    }

    /// The flags of a swapchain whose pictures this source times.
    pub(super) fn flags(self) -> vk::SwapchainCreateFlagsKHR {
        match self {
            Self::PresentTiming(_) => WITH_PRESENT_ID2 | WITH_PRESENT_TIMING,
            Self::PresentWait2 => WITH_PRESENT_ID2 | WITH_PRESENT_WAIT2,
            _ => vk::SwapchainCreateFlagsKHR::empty(),
        }
    }
}

/// The calls of a device for one of these sources.
enum Calls {
    PresentTiming(PastTimes),
    PresentWait2(WaitForPresent2),
    DisplayTiming(vk::PFN_vkGetPastPresentationTimingGOOGLE),
    PresentWait(vk::PFN_vkWaitForPresentKHR),
    FirstPixel(vk::PFN_vkRegisterDisplayEventEXT, vk::DisplayKHR, Option<vk::Fence>),
    Acquire,
}

pub(super) struct TimingSource {
    device: ash::Device,
    method: TimingMethod,
    calls: Calls,
    lit: VecDeque<PresentTiming>,
    /// Queued pictures, oldest first, whose light is unconfirmed.
    waiting: VecDeque<u64>,
    newest: Option<u64>,
    /// A picture was presented, and no wait followed yet.
    armed: bool,
}

impl TimingSource {
    /// Makes a source for a device on which the extensions of `method` are enabled.
    pub(super) fn new(
        instance: &ash::Instance,
        device: &ash::Device,
        method: TimingMethod,
        display: vk::DisplayKHR,
    ) -> Self {
        let newer = match method {
            TimingMethod::PresentTiming(stage) => TimingCalls::load(instance, device)
                .map(|calls| Calls::PresentTiming(PastTimes::new(device.handle(), calls, stage))),
            TimingMethod::PresentWait2 => presentation::wait_for_present2(instance, device).map(Calls::PresentWait2),
            _ => None,
        };
        let calls = match method {
            // A driver without the functions of its extensions is an error of the driver.
            TimingMethod::PresentTiming(_) | TimingMethod::PresentWait2 => newer.unwrap_or(Calls::Acquire),
            TimingMethod::DisplayTiming => Calls::DisplayTiming(
                google::display_timing::Device::new(instance, device).fp().get_past_presentation_timing_google,
            ),
            TimingMethod::PresentWait => {
                Calls::PresentWait(khr::present_wait::Device::new(instance, device).fp().wait_for_present_khr)
            }
            TimingMethod::FirstPixel => Calls::FirstPixel(
                ext::display_control::Device::new(instance, device).fp().register_display_event_ext,
                display,
                None,
            ),
            TimingMethod::Acquire => Calls::Acquire,
        };
        let method = if matches!(calls, Calls::Acquire) { TimingMethod::Acquire } else { method };
        let (lit, waiting) = (VecDeque::with_capacity(64), VecDeque::with_capacity(MOST));
        Self { device: device.clone(), method, calls, lit, waiting, newest: None, armed: false }
    }

    pub(super) fn method(&self) -> TimingMethod {
        self.method
    }

    /// Records that an image was acquired, in a call that began at `start`.
    pub(super) fn acquired(&mut self, start: Instant) {
        let waited =
            self.method == TimingMethod::Acquire && start.elapsed() >= WAITED && self.lit.len() < self.lit.capacity();
        // An acquire that had to wait ended when the screen advanced to the picture before.
        if let Some(id) = self.newest.filter(|_| waited) {
            self.lit.push_back(PresentTiming { id, time_ns: steady::now_ns() });
        }
    }

    pub(super) fn presented(&mut self, id: u64) {
        (self.newest, self.armed) = (Some(id), true);
        match self.method {
            // A picture whose time was not requested is not waited for.
            TimingMethod::PresentTiming(_) if self.waiting.len() < MOST => self.waiting.push_back(id),
            _ => {}
        }
        let waits = [TimingMethod::PresentWait2, TimingMethod::PresentWait, TimingMethod::FirstPixel];
        if waits.contains(&self.method) {
            if self.waiting.len() == MOST {
                self.waiting.pop_front();
            }
            self.waiting.push_back(id);
        }
        if let Calls::FirstPixel(register, display, fence) = &mut self.calls {
            let info = vk::DisplayEventInfoEXT::default().display_event(vk::DisplayEventTypeEXT::FIRST_PIXEL_OUT);
            let mut made = vk::Fence::null();
            // SAFETY: the display is the one that the device shows on, and a fence that was not waited for is
            // destroyed.
            unsafe {
                if let Some(old) = fence.take() {
                    self.device.destroy_fence(old, None);
                }
                let answer = register(self.device.handle(), *display, &info, std::ptr::null(), &mut made);
                *fence = (answer == vk::Result::SUCCESS).then_some(made);
            }
        }
    }

    /// Returns the request for the time of the next picture, if its time comes from `VK_EXT_present_timing`. A driver
    /// refuses pictures with requests beyond the size of its queue, so there is none if the queue may be full.
    pub(super) fn request(&self) -> Option<PresentTimingInfo> {
        match &self.calls {
            Calls::PresentTiming(past) if self.waiting.len() < MOST => past.request(),
            _ => None,
        }
    }

    /// Prepares a swapchain that was made. If its driver has no times on the clock of the system, the time of acquiring
    /// is the source from now on.
    pub(super) fn begin(&mut self, swapchain: vk::SwapchainKHR) {
        if let Calls::PresentTiming(past) = &mut self.calls
            && !past.begin(swapchain)
        {
            (self.method, self.calls) = (TimingMethod::Acquire, Calls::Acquire);
        }
    }

    /// Notes that the swapchain was replaced. Pictures that the old one had queued stay unconfirmed.
    pub(super) fn renewed(&mut self) {
        self.waiting.clear();
        self.armed = false;
    }

    /// The next picture with a known time of light.
    pub(super) fn next(&mut self, swapchain: vk::SwapchainKHR) -> Option<PresentTiming> {
        if self.lit.is_empty() && std::mem::take(&mut self.armed) {
            self.ask(swapchain);
        }
        self.lit.pop_front()
    }

    fn ask(&mut self, swapchain: vk::SwapchainKHR) {
        let start = Instant::now();
        match &mut self.calls {
            Calls::Acquire => {}
            Calls::DisplayTiming(past) => {
                let mut times = [vk::PastPresentationTimingGOOGLE::default(); MOST];
                let mut count = MOST as u32;
                // SAFETY: there is room for as many as it says.
                let _ = unsafe { past(self.device.handle(), swapchain, &mut count, times.as_mut_ptr()) };
                let newest = self.newest.unwrap_or(0);
                for p in times.iter().take(count as usize) {
                    // The number whose lower half this is, not after the newest.
                    let back = (newest as u32).wrapping_sub(p.present_id);
                    let id = newest.saturating_sub(u64::from(back));
                    self.lit.push_back(PresentTiming { id, time_ns: p.actual_present_time });
                }
            }
            Calls::PresentTiming(past) => past.take(swapchain, |number, time_ns| {
                let id = number.saturating_sub(1);
                self.waiting.retain(|waiting| *waiting > id);
                self.lit.extend(time_ns.map(|time_ns| PresentTiming { id, time_ns }));
            }),
            Calls::PresentWait2(wait) => {
                let (wait, device) = (*wait, self.device.handle());
                self.wait_for_pictures(start, |present_id, timeout| {
                    let info = PresentWait2Info { present_id, timeout, ..PresentWait2Info::default() };
                    // SAFETY: As for `VK_KHR_present_wait`.
                    unsafe { wait(device, swapchain, &info) }
                });
            }
            Calls::PresentWait(wait) => {
                let (wait, device) = (*wait, self.device.handle());
                // SAFETY: The swapchain is the device's and used by this thread alone, and it was given this number.
                self.wait_for_pictures(start, |number, patience| unsafe { wait(device, swapchain, number, patience) });
            }
            Calls::FirstPixel(_, _, fence) => {
                let Some(made) = fence.take() else { return };
                // SAFETY: the fence is the device's and is destroyed once.
                let answer = unsafe {
                    let answer = self.device.wait_for_fences(&[made], true, PATIENCE_NS);
                    self.device.destroy_fence(made, None);
                    answer
                };
                // Each refresh shows one picture, the oldest.
                if answer.is_ok()
                    && let Some(id) = self.waiting.pop_front()
                    && start.elapsed() >= WAITED
                {
                    self.lit.push_back(PresentTiming { id, time_ns: steady::now_ns() });
                }
            }
        }
    }

    /// Waits for pictures that are under way, by a function of a picture's number and of the longest time to wait, ns.
    ///
    /// The oldest picture lights up at the display's next refresh, for any number of pictures behind it. Therefore each
    /// picture needs only one wait.
    fn wait_for_pictures(&mut self, start: Instant, wait: impl Fn(u64, u64) -> vk::Result) {
        let mut patience = PATIENCE_NS;
        while let Some(id) = self.waiting.front().copied() {
            let answer = wait(present_number(id), patience);
            if answer == vk::Result::TIMEOUT {
                break;
            }
            if answer != vk::Result::SUCCESS && answer != vk::Result::SUBOPTIMAL_KHR {
                // The next acquire reports the reason.
                self.waiting.clear();
                break;
            }
            self.waiting.pop_front();
            if patience > 0 && start.elapsed() >= WAITED {
                self.lit.push_back(PresentTiming { id, time_ns: steady::now_ns() });
            }
            patience = 0;
        }
    }

    /// # Safety
    /// The device is idle, and this is not used any more.
    pub(super) unsafe fn destroy(&mut self) {
        if let Calls::FirstPixel(_, _, fence) = &mut self.calls
            && let Some(fence) = fence.take()
        {
            // SAFETY: the caller guarantees this.
            unsafe { self.device.destroy_fence(fence, None) };
        }
    }

    /// Waits for pictures with another function than the driver's.
    #[cfg(all(test, target_os = "linux"))]
    pub(super) fn pretend_present_wait(&mut self, wait: vk::PFN_vkWaitForPresentKHR) {
        (self.method, self.calls) = (TimingMethod::PresentWait, Calls::PresentWait(wait));
    }

    /// Replaces the driver's function of `VK_KHR_present_wait2`.
    #[cfg(all(test, target_os = "linux"))]
    pub(super) fn pretend_present_wait2(&mut self, wait: WaitForPresent2) {
        (self.method, self.calls) = (TimingMethod::PresentWait2, Calls::PresentWait2(wait));
    }

    /// Replaces the driver's functions of `VK_EXT_present_timing`.
    #[cfg(all(test, target_os = "linux"))]
    pub(super) fn pretend_present_timing(&mut self, calls: TimingCalls, stage: u32, swapchain: vk::SwapchainKHR) {
        let past = PastTimes::new(self.device.handle(), calls, stage);
        (self.method, self.calls) = (TimingMethod::PresentTiming(stage), Calls::PresentTiming(past));
        self.begin(swapchain);
    }
}

/// The number of a picture for `VK_KHR_present_id`, which uses 0 for no number.
pub(super) fn present_number(id: u64) -> u64 {
    id.saturating_add(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_of_what_is_on_is_taken() {
        let all = [
            PRESENT_TIMING,
            google::display_timing::NAME,
            PRESENT_WAIT2,
            khr::present_id::NAME,
            khr::present_wait::NAME,
            ext::display_control::NAME,
        ];
        let surface = SurfaceTimes { wait2: true, stage: Some(4) };
        let of = |surface: SurfaceTimes, on: &[&CStr], direct| {
            TimingMethod::best(|name| on.contains(&name), surface, direct)
        };
        let best = |on: &[&CStr], direct| of(surface, on, direct);
        // If the clock of programs is not the system's, the driver's times are useless.
        let times = [TimingMethod::PresentTiming(4), TimingMethod::DisplayTiming];
        let [first, second] = if steady::IS_SYSTEM_WIDE { times } else { [TimingMethod::PresentWait2; 2] };
        assert_eq!(best(&all, true), first);
        assert_eq!(best(&all[1..], true), second);
        assert_eq!(best(&all[2..], true), TimingMethod::PresentWait2);
        assert_eq!(best(&all[3..], true), TimingMethod::PresentWait);
        assert_eq!(best(&all[4..], true), TimingMethod::FirstPixel);
        assert_eq!(best(&all[4..], false), TimingMethod::Acquire);
        // A device may have extensions that a surface does not support.
        let older = if steady::IS_SYSTEM_WIDE { TimingMethod::DisplayTiming } else { TimingMethod::PresentWait };
        assert_eq!(of(SurfaceTimes::default(), &all, false), older);
        assert_eq!(of(SurfaceTimes::default(), &all[2..], false), TimingMethod::PresentWait);
        assert_eq!(best(&[], true), TimingMethod::Acquire);
    }
}
