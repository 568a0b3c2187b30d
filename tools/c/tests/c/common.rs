//! What functions put into places, for tests.

use eyebox_c::*;
use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;

/// Failure of a call.
#[derive(Debug)]
pub struct Refusal {
    /// Answer of the function.
    pub status: EyeboxStatus,
    /// Code of the error.
    pub code: String,
    /// Sentence of the error.
    pub message: String,
}

impl Refusal {
    /// Reads the last failure of this thread, which a function answered with `status`.
    pub fn last(status: EyeboxStatus) -> Self {
        Self { status, code: text(eyebox_last_error_code()), message: said() }
    }

    /// Asserts the code, which is the first word of `what`. The sentence must hold the other words, such as arguments and numbers.
    #[track_caller]
    pub fn is(&self, what: &str) {
        let mut words = what.split(' ');
        assert_eq!(words.next(), Some(&self.code[..]), "{self:?}");
        assert!(words.all(|word| self.message.contains(word)), "{what}: {self:?}");
    }
}

/// Asserts [a failure](Refusal::is).
#[track_caller]
pub fn refused<T>(answer: Result<T, Refusal>, what: &str) {
    answer.err().expect("a failure").is(what);
}

/// Result of a function, or its failure.
pub fn made<T>(call: impl FnOnce(&mut MaybeUninit<T>) -> EyeboxStatus) -> Result<T, Refusal> {
    let mut place = MaybeUninit::zeroed();
    match call(&mut place) {
        // SAFETY: the function put it there.
        EyeboxStatus::Ok => Ok(unsafe { place.assume_init() }),
        status => Err(Refusal::last(status)),
    }
}

/// A handle.
pub fn handle<T>(call: impl FnOnce(&mut MaybeUninit<*mut T>) -> EyeboxStatus) -> Result<Box<T>, Refusal> {
    // SAFETY: handles are boxes.
    made(call).map(|made| unsafe { Box::from_raw(made) })
}

/// The last failure's sentence.
pub fn said() -> String {
    text(eyebox_last_error())
}

fn text(of: *const c_char) -> String {
    // SAFETY: a text that ends with zero.
    unsafe { CStr::from_ptr(of) }.to_str().unwrap().to_owned()
}
