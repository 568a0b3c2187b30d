//! Makes sets when they are requested in simulated time.

use super::Refining;
use crate::session::feeds::sets::SetMaker;
use crate::session::frame_log::account::RepeatReason;
use crate::session::frame_log::error::SessionError;
use crate::session::playback::scheduler::Target;

impl Refining {
    /// Returns the time at which work on a set can begin in simulated time, if the set can be ready.
    ///
    /// Work begins at the decision on the previous set, or on an earlier one if that time is too short. It cannot begin
    /// before the previous work ends.
    fn free_ns(&self, target: &Target) -> Option<i64> {
        let period_ns = self.options.timing.load().period_ns;
        let need_ns = self.need_ns();
        let ahead_ns = (need_ns.saturating_add(period_ns - 1) / period_ns.max(1)).max(1).saturating_mul(period_ns);
        let free_ns = self.made_ns.max(target.hand_over_ns.saturating_sub(ahead_ns));
        (free_ns.saturating_add(need_ns) <= target.hand_over_ns).then_some(free_ns)
    }

    /// Makes the set that begins at `target` in simulated time, if it can be ready by then.
    fn make_for(&mut self, target: Target) -> Result<(), SessionError> {
        let (round_ns, ends_ns, need_ns) = (self.round_ns(), self.ends_ns(), self.need_ns());
        self.sender.does(RepeatReason::StepTooLong);
        let Some(free_ns) = self.free_ns(&target) else { return Ok(()) };
        // Spare time that holds no whole round passes before the rounds, not after them. Then samples and frames that
        // arrive in this time are lit with this set and not with the next.
        let spare_ns = |from_ns: i64| (target.hand_over_ns - ends_ns - from_ns).max(0) % round_ns.max(1);
        let comes = self.options.scenes.as_ref().is_some_and(|scenes| !scenes.begins_with_one());
        let now_ns = match comes {
            // Refinement has not begun, so the latest time gives the newest frame.
            true if self.waits() => target.hand_over_ns - need_ns,
            true => free_ns + spare_ns(free_ns),
            false => free_ns,
        };
        let steered = self.refines();
        let Some(changed) = self.look_for_scene(&target, now_ns, steered)? else { return Ok(()) };
        let ready_ns = now_ns + self.looked_ns;
        match steered {
            _ if self.waits() => Ok(()),
            true => self.refine_for(target, ready_ns + spare_ns(ready_ns)),
            false if changed => self.show_whole(&target, now_ns),
            false => {
                self.sender.does(RepeatReason::Unchanged);
                Ok(())
            }
        }
    }
}

impl SetMaker for Refining {
    fn can_make(&mut self, target: Target) -> bool {
        self.free_ns(&target).is_some()
    }

    fn make(&mut self, target: Target) -> Result<(), SessionError> {
        self.make_for(target)
    }
}
