//! Holds the screen saver and power saving of an X server off, and puts the timeouts of power saving back.

use super::report::{LinkCheck, LinkPart, LinkState};
use super::x_record::Record;
use crate::interference::Interference;
use x11rb::connection::RequestConnection as _;
use x11rb::protocol::dpms::{self, ConnectionExt as _, DPMSMode};
use x11rb::protocol::screensaver::{self, ConnectionExt as _};
use x11rb::protocol::xproto::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;

/// The version of MIT-SCREEN-SAVER that can suspend the saver.
const SUSPENDS: (u16, u16) = (1, 1);

/// The screen saver and power saving of a server.
pub(super) struct Power {
    root: u32,
    has_saver: bool,
    can_suspend: bool,
    is_suspended: bool,
    /// The record of the timeouts, if the server has power saving.
    record: Option<Record>,
    is_set: bool,
}

impl Power {
    pub(super) fn new(server: &RustConnection, root: u32) -> Self {
        let has = |name| server.extension_information(name).ok().flatten().is_some();
        let has_saver = has(screensaver::X11_EXTENSION_NAME);
        let version = || {
            let (major, minor) = (SUSPENDS.0 as u8, SUSPENDS.1 as u8);
            let reply = server.screensaver_query_version(major, minor).ok()?.reply().ok()?;
            Some((reply.server_major_version, reply.server_minor_version))
        };
        let can_suspend = has_saver && version().is_some_and(|v| v >= SUSPENDS);
        let record = has(dpms::X11_EXTENSION_NAME).then(|| Record::new(server, root, "_EYEBOX_POWER_SAVING")).flatten();
        Self { root, has_saver, can_suspend, is_suspended: false, record, is_set: false }
    }

    /// Suspends the screen saver and the timers of power saving until the connection ends.
    pub(super) fn suspend(&mut self, server: &RustConnection) {
        let suspended = || server.screensaver_suspend(1).ok()?.check().ok();
        self.is_suspended = self.can_suspend && suspended().is_some();
    }

    /// Puts back the timeouts that a killed session left, and returns true if there were any.
    pub(super) fn recover(&mut self, server: &RustConnection) -> bool {
        let Some(left) = self.record.as_ref().and_then(|record| record.left(server)) else { return false };
        self.load_recorded(server, &left);
        true
    }

    /// Checks the screen saver.
    pub(super) fn check_saver(&self, server: &RustConnection) -> LinkCheck {
        let part = LinkPart::ScreenSaver;
        let state = || server.screensaver_query_info(self.root).ok()?.reply().ok();
        if self.has_saver && state().is_some_and(|info| info.state == u8::from(screensaver::State::ON)) {
            return LinkCheck::judged(part, Some(Interference::ScreenSaver));
        }
        let timeout = server.get_screen_saver().ok().and_then(|cookie| cookie.reply().ok()).map(|r| r.timeout);
        let state = match timeout {
            Some(0) => LinkState::Right,
            _ if self.is_suspended => LinkState::SetRight,
            _ if self.can_suspend => LinkState::SetWhileShown,
            _ => LinkState::Unknown,
        };
        LinkCheck::new(part, state)
    }

    /// Checks power saving, and switches its timeouts off if an owner for the record is given.
    pub(super) fn check_power(&mut self, server: &RustConnection, owner: Option<u32>) -> LinkCheck {
        let part = LinkPart::PowerSaving;
        let Some(record) = &self.record else { return LinkCheck::new(part, LinkState::Right) };
        let Some(info) = server.dpms_info().ok().and_then(|cookie| cookie.reply().ok()) else {
            return LinkCheck::new(part, LinkState::Unknown);
        };
        let mut state = LinkState::Right;
        if let Some(timeouts) = timeouts(server).filter(|t| info.state && t.iter().any(|t| *t > 0)) {
            state = LinkState::SetWhileShown;
            if let Some(owner) = owner
                && record.write(server, owner, &timeouts).is_some()
            {
                self.is_set = true;
                state = set_timeouts(server, [0; 3]).map_or(LinkState::Unknown, |()| LinkState::SetRight);
            }
        } else if self.is_set {
            state = LinkState::SetRight;
        }
        if info.state && info.power_level != DPMSMode::ON {
            return LinkCheck::judged(part, Some(Interference::PowerSaving));
        }
        LinkCheck::new(part, state)
    }

    /// Puts the timeouts of power saving back, unless another program has set them since. The screen saver continues
    /// when the connection ends.
    pub(super) fn put_back(&mut self, server: &RustConnection) {
        if let Some(was) = self.record.as_ref().filter(|_| self.is_set).and_then(|record| record.read(server)) {
            self.load_recorded(server, &was);
        }
        self.is_set = false;
    }

    fn load_recorded(&self, server: &RustConnection, recorded: &[u16]) {
        if let ([standby, suspend, off], Some([0, 0, 0])) = (recorded, timeouts(server)) {
            let _ = set_timeouts(server, [*standby, *suspend, *off]);
        }
        if let Some(record) = &self.record {
            record.remove(server);
        }
    }
}

fn timeouts(server: &RustConnection) -> Option<[u16; 3]> {
    let reply = server.dpms_get_timeouts().ok()?.reply().ok()?;
    Some([reply.standby_timeout, reply.suspend_timeout, reply.off_timeout])
}

fn set_timeouts(server: &RustConnection, [standby, suspend, off]: [u16; 3]) -> Option<()> {
    server.dpms_set_timeouts(standby, suspend, off).ok()?.check().ok()
}
