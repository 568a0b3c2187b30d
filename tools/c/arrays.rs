//! Checks the pointers of the caller before anything is read or written.

use crate::failure::Failure;
use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;
use std::slice;

/// Returns a handle, or an error if it is null.
pub(crate) fn given<'a, T: ?Sized>(handle: Option<&'a T>, what: &'static str) -> Result<&'a T, Failure> {
    handle.ok_or(Failure::Null(what))
}

/// The memory of the caller for a result, or `None` if its pointer is null.
pub(crate) type Out<'a, T> = Option<&'a mut MaybeUninit<T>>;

/// Writes a result into the memory of the caller.
pub(crate) fn put<T>(out: Out<T>, make: impl FnOnce() -> Result<T, Failure>) -> Result<(), Failure> {
    let out = out.ok_or(Failure::Null("the place for the result"))?;
    out.write(make()?);
    Ok(())
}

/// Writes a new handle into the memory of the caller, or null if `make` fails.
pub(crate) fn hand_over<T>(out: Out<*mut T>, make: impl FnOnce() -> Result<T, Failure>) -> Result<(), Failure> {
    let out = out.ok_or(Failure::Null("the place for the handle"))?;
    out.write(std::ptr::null_mut());
    out.write(Box::into_raw(Box::new(make()?)));
    Ok(())
}

/// Returns a text of the caller, which must not be null and must be UTF-8.
///
/// # Safety
/// If the pointer is not null, the text ends with a zero byte and does not change while the result is in use.
pub(crate) unsafe fn text<'a>(text: *const c_char, what: &'static str) -> Result<&'a str, Failure> {
    if text.is_null() {
        return Err(Failure::Null(what));
    }
    // SAFETY: This function requires a text that ends with a zero byte.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|e| Failure::argument(what, format!("no UTF-8 from byte {} on", e.valid_up_to()), "UTF-8"))
}

/// Refuses an array that is null, not aligned, or of another length than `wanted`.
fn check<T>(at: *const T, count: usize, wanted: Option<usize>, what: &'static str) -> Result<(), Failure> {
    if at.is_null() {
        return Err(Failure::Null(what));
    }
    if !at.is_aligned() {
        return Err(Failure::Misaligned(what));
    }
    let right = || wanted.map_or("fewer than memory holds".to_string(), |n| format!("{n} values"));
    let possible = isize::MAX as usize / size_of::<T>().max(1);
    if count > possible || wanted.is_some_and(|n| n != count) {
        return Err(Failure::argument(what, format!("{count} values"), right()));
    }
    Ok(())
}

/// Returns an array of the caller with `wanted` values, or with any number of values if `wanted` is `None`.
///
/// # Safety
/// If the pointer is not null, it leads to `count` values that do not change while the result is in use.
pub(crate) unsafe fn array<'a, T>(
    at: *const T,
    count: usize,
    wanted: Option<usize>,
    what: &'static str,
) -> Result<&'a [T], Failure> {
    check(at, count, wanted, what)?;
    // SAFETY: The pointer was checked above, and this function requires `count` values behind it.
    Ok(unsafe { slice::from_raw_parts(at, count) })
}

/// Returns memory of the caller for `wanted` values.
///
/// # Safety
/// If the pointer is not null, it leads to memory for `count` values. Other code neither reads nor writes this memory
/// while the result is in use.
pub(crate) unsafe fn room<'a, T: Copy>(
    at: *mut T,
    count: usize,
    wanted: usize,
    what: &'static str,
) -> Result<&'a mut [MaybeUninit<T>], Failure> {
    check(at, count, Some(wanted), what)?;
    // SAFETY: The pointer was checked above, and this function requires memory for `count` values behind it.
    Ok(unsafe { slice::from_raw_parts_mut(at.cast(), count) })
}
