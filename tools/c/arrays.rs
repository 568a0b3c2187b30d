//! Pointers of the caller's: looked at before anything is read or written.

use crate::failure::Failure;
use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;
use std::slice;

/// A handle that has to be there.
pub(crate) fn given<'a, T: ?Sized>(handle: Option<&'a T>, what: &'static str) -> Result<&'a T, Failure> {
    handle.ok_or(Failure::Null(what))
}

/// A place for a result.
pub(crate) type Out<'a, T> = Option<&'a mut MaybeUninit<T>>;

/// Puts a result into its place.
pub(crate) fn put<T>(out: Out<T>, make: impl FnOnce() -> Result<T, Failure>) -> Result<(), Failure> {
    let out = out.ok_or(Failure::Null("the place for the result"))?;
    out.write(make()?);
    Ok(())
}

/// Puts a new handle into its place, or null where there is none.
pub(crate) fn hand_over<T>(out: Out<*mut T>, make: impl FnOnce() -> Result<T, Failure>) -> Result<(), Failure> {
    let out = out.ok_or(Failure::Null("the place for the handle"))?;
    out.write(std::ptr::null_mut());
    out.write(Box::into_raw(Box::new(make()?)));
    Ok(())
}

/// A text of the caller's.
///
/// # Safety
/// Where it is not null, it ends with a zero byte, and stands as it is while the result is in use.
pub(crate) unsafe fn text<'a>(text: *const c_char, what: &'static str) -> Result<&'a str, Failure> {
    if text.is_null() {
        return Err(Failure::Null(what));
    }
    // SAFETY: the caller's promise.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|e| Failure::argument(what, format!("no UTF-8 from byte {} on", e.valid_up_to()), "UTF-8"))
}

/// Refuses an array that is not there, not aligned, or of another length than is wanted.
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

/// An array of the caller's, of `wanted` values.
///
/// # Safety
/// Where it is not null, `count` values are there, and stand as they are while the result is in use.
pub(crate) unsafe fn array<'a, T>(
    at: *const T,
    count: usize,
    wanted: Option<usize>,
    what: &'static str,
) -> Result<&'a [T], Failure> {
    check(at, count, wanted, what)?;
    // SAFETY: looked at above; the rest is the caller's promise.
    Ok(unsafe { slice::from_raw_parts(at, count) })
}

/// Memory of the caller's for `wanted` values.
///
/// # Safety
/// Where it is not null, there is room for `count` values, which nobody else reads or writes while the result is in use.
pub(crate) unsafe fn room<'a, T: Copy>(
    at: *mut T,
    count: usize,
    wanted: usize,
    what: &'static str,
) -> Result<&'a mut [MaybeUninit<T>], Failure> {
    check(at, count, Some(wanted), what)?;
    // SAFETY: looked at above; the rest is the caller's promise.
    Ok(unsafe { slice::from_raw_parts_mut(at.cast(), count) })
}
