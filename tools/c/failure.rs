//! What can go wrong, as codes and sentences.

use eyebox::encode::EncodeError;
use eyebox::engine::EngineError;
use eyebox::error::ErrorData;
use eyebox::hologram::HologramError;
use eyebox::optics::OpticsError;
use eyebox::produce::ProduceError;
use eyebox::reconstruction::EvaluateError;
use eyebox::reconstruction::ReconstructionError;
use eyebox::scene::SceneError;
use eyebox::session::SessionError;
use eyebox::solve::SolveError;
use serde::Serialize;
use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard};
use std::thread::LocalKey;

/// What a function answers. `eyebox_last_error` says the rest.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EyeboxStatus {
    /// It did what was asked.
    Ok = 0,
    /// A pointer that has to lead somewhere is null, or misaligned.
    Pointer = 1,
    /// A number, a text or the length of an array is not one that the function takes.
    Argument = 2,
    /// The display, or a pupil before it.
    Display = 3,
    /// The scene, its file or its views.
    Scene = 4,
    /// The settings, or the solve or refinement that they ask for.
    Solve = 5,
    /// The hologram, or its file.
    Hologram = 6,
    /// The encoding, or what is to be encoded.
    Encode = 7,
    /// The engine or its device.
    Engine = 8,
    /// A fault of eyebox itself, please report it. Handles that the call was given may be freed, and no more.
    Internal = 9,
    /// The session, or what it shows on.
    Session = 10,
}

#[derive(Debug, thiserror::Error, Serialize)]
#[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
pub(crate) enum Failure {
    #[error("{0} is null")]
    Null(&'static str),
    #[error("{0} is not aligned for what it leads to")]
    Misaligned(&'static str),
    #[error("{what} is {value}: it must be {right}")]
    Argument { what: &'static str, value: String, right: String },
    #[error(transparent)]
    Optics(#[from] OpticsError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Produce(#[from] ProduceError),
    #[error(transparent)]
    Solve(#[from] SolveError),
    #[error(transparent)]
    Hologram(#[from] HologramError),
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    #[error(transparent)]
    Encode(#[from] EncodeError),
    #[error(transparent)]
    Engine(#[from] EngineError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error("{color}: a loss was no finite number at step {step}: take smaller gains or rates, or storage = \"fp32\"")]
    NotFinite { color: String, step: usize },
    #[error("a fault of eyebox itself: {0}")]
    Panic(String),
    #[error(
        "this process was forked after eyebox had started threads, which exist in its parent alone: call it before fork, or after exec"
    )]
    Forked,
    #[error("an earlier call with this handle met a fault of eyebox: free it")]
    Broken,
}

impl From<ReconstructionError> for Failure {
    fn from(error: ReconstructionError) -> Self {
        error.unwrapped()
    }
}

impl Failure {
    pub(crate) fn argument(what: &'static str, value: impl ToString, right: impl ToString) -> Self {
        Self::Argument { what, value: value.to_string(), right: right.to_string() }
    }

    fn status(&self) -> EyeboxStatus {
        match self {
            Self::Null(_) | Self::Misaligned(_) => EyeboxStatus::Pointer,
            Self::Argument { .. } => EyeboxStatus::Argument,
            Self::Session(SessionError::Hologram(_)) => EyeboxStatus::Hologram,
            Self::Session(SessionError::Encode(_)) => EyeboxStatus::Encode,
            Self::Session(SessionError::Engine(_)) => EyeboxStatus::Engine,
            Self::Session(SessionError::Solve(_)) => EyeboxStatus::Solve,
            Self::Session(_) => EyeboxStatus::Session,
            Self::Optics(_) | Self::Produce(ProduceError::Optics(_)) | Self::Hologram(HologramError::Optics(_)) => {
                EyeboxStatus::Display
            }
            Self::Scene(_) | Self::Produce(ProduceError::Scene(_)) | Self::Hologram(HologramError::Scene(_)) => {
                EyeboxStatus::Scene
            }
            Self::Engine(_) | Self::Forked | Self::Produce(ProduceError::Engine(_)) => EyeboxStatus::Engine,
            Self::Produce(_) | Self::Solve(_) | Self::NotFinite { .. } => EyeboxStatus::Solve,
            Self::Hologram(_) | Self::Evaluate(_) => EyeboxStatus::Hologram,
            Self::Encode(_) => EyeboxStatus::Encode,
            Self::Panic(_) | Self::Broken => EyeboxStatus::Internal,
        }
    }
}

thread_local! {
    /// The text of the last failure.
    static LAST: RefCell<CString> = RefCell::default();
    /// Code of the last failure.
    static LAST_CODE: RefCell<CString> = RefCell::default();
    /// The text that the caller has: nothing but `eyebox_last_error` replaces it.
    static GIVEN: RefCell<CString> = RefCell::default();
    /// Code that the caller holds. Only `eyebox_last_error_code` replaces it.
    static GIVEN_CODE: RefCell<CString> = RefCell::default();
}

/// Returns why the last call of this thread that failed did so: one sentence in UTF-8, empty before the first failure. The text stays
/// valid and unchanged, whatever else fails, until the same thread calls `eyebox_last_error` after another failure, or ends.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_last_error() -> *const c_char {
    give(&LAST, &GIVEN)
}

/// Returns the code of the last failed call of this thread, such as `scene/missing-view`. The code of an error never changes, its
/// sentence may. The code is empty before the first failure. The text stays valid until the same thread calls
/// `eyebox_last_error_code` after another failure, or ends.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_last_error_code() -> *const c_char {
    give(&LAST_CODE, &GIVEN_CODE)
}

type Text = LocalKey<RefCell<CString>>;

fn give(last: &'static Text, given: &'static Text) -> *const c_char {
    let give = |given: &RefCell<CString>| {
        let mut given = given.borrow_mut();
        // The same text stays where it is: one expression may ask for it twice.
        last.with_borrow(|last| {
            if *last != *given {
                given.clone_from(last)
            }
        });
        given.as_ptr()
    };
    given.try_with(give).unwrap_or(c"".as_ptr())
}

/// The process that started threads first; 0 before.
static THREADED: AtomicU32 = AtomicU32::new(0);

/// To be called before anything that starts threads.
pub(crate) fn starts_threads() {
    let _ = THREADED.compare_exchange(0, std::process::id(), Ordering::SeqCst, Ordering::SeqCst);
}

/// Runs a call, and makes a code and a sentence of its failure or panic.
pub(crate) fn answer(call: impl FnOnce() -> Result<(), Failure>) -> EyeboxStatus {
    let answered = if [0, std::process::id()].contains(&THREADED.load(Ordering::SeqCst)) {
        catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| Err(Failure::Panic(in_words(&*panic))))
    } else {
        // What it holds, a handle that is to be freed, has threads or a device of the parent's.
        std::mem::forget(call);
        Err(Failure::Forked)
    };
    let Err(failure) = answered else { return EyeboxStatus::Ok };
    let text = failure.to_string().replace('\0', " ");
    // A thread that is ending has no place for it any more.
    let code = ErrorData::of(&failure).code;
    for (place, text) in [(&LAST, text), (&LAST_CODE, code)] {
        let _ = place.try_with(|last| *last.borrow_mut() = CString::new(text).unwrap_or_default());
    }
    failure.status()
}

/// Takes a handle back.
pub(crate) fn free<T>(handle: Option<Box<T>>) {
    answer(|| {
        drop(handle);
        Ok(())
    });
}

fn in_words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(ToString::to_string);
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic".into())
}

/// What calls of several threads take in turn.
pub(crate) fn lock<T: ?Sized>(shared: &Mutex<T>) -> Result<MutexGuard<'_, T>, Failure> {
    shared.lock().map_err(|_| Failure::Broken)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    #[test]
    fn a_panic_is_a_code_and_what_it_was_in_is_no_more_used() {
        let shared = Mutex::new(0);
        let status = answer(|| {
            let _held = lock(&shared)?;
            panic!("on purpose")
        });
        assert_eq!(status, EyeboxStatus::Internal);
        // SAFETY: it is what the function says.
        let said = unsafe { CStr::from_ptr(eyebox_last_error()) };
        assert_eq!(said.to_str().unwrap(), "a fault of eyebox itself: on purpose");
        assert_eq!(answer(|| lock(&shared).map(drop)), EyeboxStatus::Internal);
        let other = std::thread::spawn(|| {
            // SAFETY: it is what the function says.
            unsafe { CStr::from_ptr(eyebox_last_error()) }.to_owned()
        });
        assert_eq!(other.join().unwrap(), CString::default());
    }
}
