//! Reads chains of structures, which begin with a type and a pointer to the next one.

use openxr_sys as xr;
use std::ffi::c_void;

/// Returns the structures of a chain with their types.
///
/// # Safety
/// `first` must be a chain of OpenXR or null, and must stay valid while the iterator is used.
pub unsafe fn links(first: *const c_void) -> impl Iterator<Item = (xr::StructureType, *const c_void)> {
    let mut at = first.cast::<xr::BaseInStructure>();
    std::iter::from_fn(move || {
        // SAFETY: each structure of a chain begins with these two fields.
        let one = unsafe { at.as_ref() }?;
        let found = (one.ty, std::ptr::from_ref(one).cast());
        at = one.next;
        Some(found)
    })
}

/// Returns the structure of this type.
///
/// # Safety
/// The chain must be valid as for [`links`], and `T` must be the structure of the type.
pub unsafe fn link<'a, T>(first: *const c_void, kind: xr::StructureType) -> Option<&'a T> {
    // SAFETY: as stated above.
    let found = unsafe { links(first) }.find(|(ty, _)| *ty == kind)?.1;
    // SAFETY: the type states the structure.
    unsafe { found.cast::<T>().as_ref() }
}
