//! What functions put into places, for tests.

use eyebox_c::*;
use std::ffi::CStr;
use std::mem::MaybeUninit;

/// What a function puts into its place, or its sentence.
pub fn made<T>(call: impl FnOnce(&mut MaybeUninit<T>) -> EyeboxStatus) -> Result<T, String> {
    let mut place = MaybeUninit::zeroed();
    match call(&mut place) {
        // SAFETY: the function put it there.
        EyeboxStatus::Ok => Ok(unsafe { place.assume_init() }),
        status => Err(format!("{status:?}: {}", said())),
    }
}

/// A handle.
pub fn handle<T>(call: impl FnOnce(&mut MaybeUninit<*mut T>) -> EyeboxStatus) -> Result<Box<T>, String> {
    // SAFETY: handles are boxes.
    made(call).map(|made| unsafe { Box::from_raw(made) })
}

/// The last failure's sentence.
pub fn said() -> String {
    // SAFETY: a text that ends with zero.
    unsafe { CStr::from_ptr(eyebox_last_error()) }.to_str().unwrap().to_owned()
}
