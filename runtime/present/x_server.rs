//! Handles the loss of an X server, after which Xlib by itself ends the process with its own text.
//!
//! libX11 1.7 and later can return instead (`XSetIOErrorExitHandler`). Every call on the connection then does nothing.
//! Older versions still end the process.

#![allow(unsafe_code)]

use std::ffi::{c_int, c_void};
use std::sync::atomic::{AtomicBool, Ordering};
use winit::raw_window_handle::{HasDisplayHandle, RawDisplayHandle};

static GONE: AtomicBool = AtomicBool::new(false);

/// True if the connection of this process's desktop broke.
pub(super) fn is_gone() -> bool {
    GONE.load(Ordering::Acquire)
}

unsafe extern "C" fn broke(_display: *mut x11_dl::xlib::Display) -> c_int {
    GONE.store(true, Ordering::Release);
    0
}

unsafe extern "C" fn go_on(_display: *mut c_void, _data: *mut c_void) {}

type ExitHandler = unsafe extern "C" fn(*mut c_void, *mut c_void);

/// Makes a broken connection set a flag instead of ending the process, for a connection to an X server.
pub(super) fn survive(desktop: &impl HasDisplayHandle) {
    let Ok(handle) = desktop.display_handle() else { return };
    let RawDisplayHandle::Xlib(handle) = handle.as_raw() else { return };
    let (Some(display), Ok(xlib)) = (handle.display, x11_dl::xlib::Xlib::open()) else { return };
    // SAFETY: the function has had this type since it exists, the display is open, and the handlers use nothing of it.
    // The library stays loaded, because Xlib keeps the handlers.
    unsafe {
        let Ok(library) = libloading::Library::new("libX11.so.6") else { return };
        let set =
            library.get::<unsafe extern "C" fn(*mut c_void, ExitHandler, *mut c_void)>(b"XSetIOErrorExitHandler\0");
        if let Ok(set) = set {
            set(display.as_ptr(), go_on, std::ptr::null_mut());
            (xlib.XSetIOErrorHandler)(Some(broke));
        }
        std::mem::forget(library);
    }
}
