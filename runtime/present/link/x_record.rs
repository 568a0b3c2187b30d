//! Records in the X server what a session changes, so that the next session can put it back.
//!
//! A record is a property of the root window. It lives as long as the ramp or the timeouts that it records, because a
//! server that ends takes both. A file would outlive the server. While a session runs, it owns a selection of the same
//! name, which the server clears when the connection ends in any way. A record without an owner is of a session that
//! was killed.

use x11rb::connection::Connection as _;
use x11rb::errors::ReplyOrIdError;
use x11rb::protocol::xproto::{AtomEnum, ConnectionExt as _, CreateWindowAux, PropMode, WindowClass};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// The most numbers of a record, which is a ramp of 4096 entries with three channels.
const MOST: u32 = 3 * 4096;

/// A window that owns the selections of a session. Nothing shows it.
pub(super) fn owner(server: &RustConnection, root: u32) -> Result<u32, ReplyOrIdError> {
    let window = server.generate_id()?;
    let input = WindowClass::INPUT_ONLY;
    server.create_window(0, window, root, 0, 0, 1, 1, 0, input, 0, &CreateWindowAux::new())?.check()?;
    Ok(window)
}

/// A record of 16-bit numbers on the root window.
pub(super) struct Record {
    root: u32,
    /// The name of the property and of the selection.
    atom: u32,
}

impl Record {
    pub(super) fn new(server: &RustConnection, root: u32, name: &str) -> Option<Self> {
        let atom = server.intern_atom(false, name.as_bytes()).ok()?.reply().ok()?.atom;
        Some(Self { root, atom })
    }

    /// Returns the recorded numbers.
    pub(super) fn read(&self, server: &RustConnection) -> Option<Vec<u16>> {
        let property = server.get_property(false, self.root, self.atom, AtomEnum::CARDINAL, 0, MOST / 2 + 1);
        let values: Vec<u16> = property.ok()?.reply().ok()?.value16()?.collect();
        (!values.is_empty()).then_some(values)
    }

    /// Returns the numbers that a killed session left.
    pub(super) fn left(&self, server: &RustConnection) -> Option<Vec<u16>> {
        let owner = server.get_selection_owner(self.atom).ok()?.reply().ok()?.owner;
        self.read(server).filter(|_| owner == x11rb::NONE)
    }

    /// Writes the numbers before they are changed, and waits until the server has them.
    pub(super) fn write(&self, server: &RustConnection, owner: u32, values: &[u16]) -> Option<()> {
        server.set_selection_owner(owner, self.atom, x11rb::CURRENT_TIME).ok()?.check().ok()?;
        let replace = PropMode::REPLACE;
        server.change_property16(replace, self.root, self.atom, AtomEnum::CARDINAL, values).ok()?.check().ok()
    }

    /// Removes the record after the numbers are put back.
    pub(super) fn remove(&self, server: &RustConnection) {
        if let Ok(deleted) = server.delete_property(self.root, self.atom) {
            let _ = deleted.check();
        }
    }
}
