//! Ends sessions with their swapchains.

use super::session::SESSIONS;
use super::swapchain::{self, SWAPCHAINS};
use openxr_sys::{self as xr, Handle};

pub unsafe extern "system" fn destroy_session(session: xr::Session) -> xr::Result {
    let Some(known) = SESSIONS.get(session.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
    forget(session.into_raw());
    // SAFETY: the argument is the caller's.
    unsafe { (known.next().destroy_session)(session) }
}

/// Ends the thread of a session, and frees what the layer made on the application's device.
pub fn forget(session: u64) {
    let Some(known) = SESSIONS.take(session) else { return };
    let of_session = |swapchain: &swapchain::Swapchain| swapchain.session.handle == known.handle;
    SWAPCHAINS.handles(of_session).into_iter().for_each(swapchain::forget);
    if let Some(capture) = &known.capture {
        let counts = capture.sender.stop();
        known.conclude(counts.sent, counts.replaced, counts.unsent);
    }
}
