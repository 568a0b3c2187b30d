//! Helpers that read the results and failures of functions.

use eyebox_c::*;
use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;

/// The failure of a call.
#[derive(Debug)]
pub struct Refusal {
    /// The status that the function returned.
    pub status: EyeboxStatus,
    pub code: String,
    /// The sentence of the error.
    pub message: String,
}

impl Refusal {
    /// Reads the last failure of this thread, for which a function returned `status`.
    pub fn last(status: EyeboxStatus) -> Self {
        Self { status, code: text(eyebox_last_error_code()), message: said() }
    }

    /// Asserts the code, which is the first word of `what`. The sentence must contain the other words, such as
    /// arguments and numbers.
    #[track_caller]
    pub fn is(&self, what: &str) {
        let mut words = what.split(' ');
        assert_eq!(words.next(), Some(&self.code[..]), "{self:?}");
        assert!(words.all(|word| self.message.contains(word)), "{what}: {self:?}");
    }
}

/// Asserts that a call failed, as [`Refusal::is`] does.
#[track_caller]
pub fn refused<T>(answer: Result<T, Refusal>, what: &str) {
    answer.err().expect("a failure").is(what);
}

/// Returns the result that a function wrote, or its failure.
pub fn made<T>(call: impl FnOnce(&mut MaybeUninit<T>) -> EyeboxStatus) -> Result<T, Refusal> {
    let mut place = MaybeUninit::zeroed();
    match call(&mut place) {
        // SAFETY: The function wrote the result.
        EyeboxStatus::Ok => Ok(unsafe { place.assume_init() }),
        status => Err(Refusal::last(status)),
    }
}

/// Returns the handle that a function made, or its failure.
pub fn handle<T>(call: impl FnOnce(&mut MaybeUninit<*mut T>) -> EyeboxStatus) -> Result<Box<T>, Refusal> {
    // SAFETY: Handles are boxes.
    made(call).map(|made| unsafe { Box::from_raw(made) })
}

/// Returns the sentence of the last failure.
pub fn said() -> String {
    text(eyebox_last_error())
}

fn text(of: *const c_char) -> String {
    // SAFETY: The text ends with a zero byte.
    unsafe { CStr::from_ptr(of) }.to_str().unwrap().to_owned()
}
