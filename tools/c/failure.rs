//! Turns failures into statuses, codes and sentences.

use eyebox::error::ErrorData;
use eyebox::hologram::HologramError;
use eyebox::reconstruction::ReconstructionError;
use eyebox::session::SessionError;
use eyebox::{Error, ErrorKind};
use serde::Serialize;
use std::any::Any;
use std::cell::RefCell;
use std::ffi::c_char;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard};
use std::thread::LocalKey;

/// The result of a function. If it is not EYEBOX_STATUS_OK, `eyebox_last_error` returns the cause.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EyeboxStatus {
    /// The call succeeded without an error.
    Ok = 0,
    /// A pointer is null although the function requires it, or is misaligned.
    Pointer = 1,
    /// A number, a text or the length of an array is outside the range of the function.
    Argument = 2,
    /// The error is about the display, or about a pupil in front of it.
    Display = 3,
    /// The error is about the scene, its file or its views.
    Scene = 4,
    /// The error is about the settings, or about the solve or refinement that they describe.
    Solve = 5,
    /// The error is about the hologram, its file, or the scene or display that it names.
    Hologram = 6,
    /// The error is about the encoding, or about the phases to encode.
    Encode = 7,
    /// The error is about the engine or its device, or the process was forked.
    Engine = 8,
    /// The error is a fault of eyebox itself. Please report it. The program may free the handles of the failed call,
    /// but must not use them for anything else.
    Internal = 9,
    /// The error is about the session, or about the display on which it shows.
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
    Library(Error),
    #[error("{color}: a loss was no finite number at step {step}: take smaller gains or rates, or storage = \"fp32\"")]
    NotFinite { color: String, step: usize },
    #[error("a fault of eyebox itself: {0}")]
    Panic(String),
    #[error(
        "this process was forked after eyebox had started threads, which exist in its parent alone: call it before \
         fork, or after exec"
    )]
    Forked,
    #[error("an earlier call with this handle met a fault of eyebox: free it")]
    Broken,
}

impl<E: Into<Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Library(error.into())
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
            Self::Library(error) => status_of(error),
            Self::Forked => EyeboxStatus::Engine,
            Self::NotFinite { .. } => EyeboxStatus::Solve,
            Self::Panic(_) | Self::Broken => EyeboxStatus::Internal,
        }
    }
}

/// Returns the status of an error of the library.
fn status_of(error: &Error) -> EyeboxStatus {
    match error {
        // A hologram that lacks its scene or its display had this status before `ErrorKind` existed. Programs compare
        // statuses, so it stays.
        Error::Session(SessionError::Hologram(_)) => return EyeboxStatus::Hologram,
        Error::Hologram(of) | Error::Reconstruction(ReconstructionError::Hologram(of))
            if !matches!(of, HologramError::Optics(_) | HologramError::Scene(_)) =>
        {
            return EyeboxStatus::Hologram;
        }
        _ => {}
    }
    match error.kind() {
        ErrorKind::Display => EyeboxStatus::Display,
        ErrorKind::Scene => EyeboxStatus::Scene,
        ErrorKind::Solve => EyeboxStatus::Solve,
        ErrorKind::Hologram | ErrorKind::File => EyeboxStatus::Hologram,
        ErrorKind::Encode => EyeboxStatus::Encode,
        ErrorKind::Engine => EyeboxStatus::Engine,
        ErrorKind::Calibrate | ErrorKind::Session => EyeboxStatus::Session,
    }
}

/// The bytes of the texts of a failure, with the zero byte at the end.
const TEXT: usize = 2048;
const CODE: usize = 128;

/// A text of at most `N` - 1 bytes with a zero byte at its end. It needs no memory of its own, so that a failure can be
/// stated when memory is short.
#[derive(Clone, Copy, PartialEq)]
struct FixedText<const N: usize>([u8; N]);

impl<const N: usize> FixedText<N> {
    const EMPTY: Self = Self([0; N]);

    /// Returns the text up to its first zero byte, and without its end if it is too long.
    fn new(text: &str) -> Self {
        let text = text.split('\0').next().unwrap_or_default();
        let mut bytes = [0; N];
        let length = text.floor_char_boundary(N - 1);
        bytes[..length].copy_from_slice(&text.as_bytes()[..length]);
        Self(bytes)
    }
}

thread_local! {
    /// The sentence of the last failure.
    static LAST: RefCell<FixedText<TEXT>> = const { RefCell::new(FixedText::EMPTY) };
    /// The code of the last failure.
    static LAST_CODE: RefCell<FixedText<CODE>> = const { RefCell::new(FixedText::EMPTY) };
    /// The sentence that the caller has a pointer to. Only `eyebox_last_error` replaces it.
    static GIVEN: RefCell<FixedText<TEXT>> = const { RefCell::new(FixedText::EMPTY) };
    /// The code that the caller has a pointer to. Only `eyebox_last_error_code` replaces it.
    static GIVEN_CODE: RefCell<FixedText<CODE>> = const { RefCell::new(FixedText::EMPTY) };
}

/// Returns the cause of the last failed call of this thread, as one sentence in UTF-8 of at most 2047 bytes. It is empty
/// before the first failure. eyebox owns the text. It stays valid and unchanged until the same thread ends, or calls `eyebox_last_error`
/// after another failure.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_last_error() -> *const c_char {
    give(&LAST, &GIVEN)
}

/// Returns the code of the last failed call of this thread, such as `scene/missing-view`. It is empty before the first
/// failure. The code of an error never changes, but its sentence may change. eyebox owns the text. It stays valid until
/// the same thread ends, or calls `eyebox_last_error_code` after another failure.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_last_error_code() -> *const c_char {
    give(&LAST_CODE, &GIVEN_CODE)
}

type Text<const N: usize> = LocalKey<RefCell<FixedText<N>>>;

fn give<const N: usize>(last: &'static Text<N>, given: &'static Text<N>) -> *const c_char {
    let give = |given: &RefCell<FixedText<N>>| {
        let mut given = given.borrow_mut();
        *given = last.with_borrow(|last| *last);
        given.0.as_ptr().cast()
    };
    given.try_with(give).unwrap_or(c"".as_ptr())
}

/// The id of the process that first started threads, or 0 if none has.
static THREADED: AtomicU32 = AtomicU32::new(0);

/// Records that this process starts threads. Functions that start threads call it first.
pub(crate) fn starts_threads() {
    let _ = THREADED.compare_exchange(0, std::process::id(), Ordering::SeqCst, Ordering::SeqCst);
}

/// Runs a call, and turns its failure or panic into a status, a code and a sentence.
pub(crate) fn answer(call: impl FnOnce() -> Result<(), Failure>) -> EyeboxStatus {
    let answered = if [0, std::process::id()].contains(&THREADED.load(Ordering::SeqCst)) {
        catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| Err(Failure::Panic(in_words(&*panic))))
    } else {
        // The call may own a handle to free, whose threads or device exist only in the parent process.
        std::mem::forget(call);
        Err(Failure::Forked)
    };
    let Err(failure) = answered else { return EyeboxStatus::Ok };
    let text = failure.to_string().replace('\0', " ");
    let code = ErrorData::of(&failure).code;
    // A thread that is ending has no place for the texts, so a failed access is ignored.
    let _ = LAST.try_with(|last| *last.borrow_mut() = FixedText::new(&text));
    let _ = LAST_CODE.try_with(|last| *last.borrow_mut() = FixedText::new(&code));
    failure.status()
}

/// Takes a handle back from the caller and frees it.
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

/// Locks a value that calls of several threads share. It is unusable after a panic during an earlier call.
pub(crate) fn lock<T: ?Sized>(shared: &Mutex<T>) -> Result<MutexGuard<'_, T>, Failure> {
    shared.lock().map_err(|_| Failure::Broken)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::encode::EncodeError;
    use eyebox::engine::EngineError;
    use eyebox::optics::OpticsError;
    use eyebox::produce::ProduceError;
    use eyebox::reconstruction::EvaluateError;
    use eyebox::scene::SceneError;
    use eyebox::solve::SolveError;
    use std::ffi::CStr;

    /// Programs compare statuses and log codes, so neither may change.
    #[test]
    fn errors_of_the_library_have_a_status_and_a_code() {
        let optics = || OpticsError::Size { height: 0, width: 0 };
        let scene = || SceneError::Matrix { file: "a.y4m".into() };
        let engine = || EngineError::Stopped;
        let reason = |code: &'static str| eyebox::error::Reason::new(code, "a sentence");
        let mismatch = || EncodeError::Mismatch { display: "a".into(), reason: reason("frames") };
        let cases: [(Failure, EyeboxStatus, &str); 27] = [
            (optics().into(), EyeboxStatus::Display, "optics/size"),
            (scene().into(), EyeboxStatus::Scene, "scene/matrix"),
            (engine().into(), EyeboxStatus::Engine, "engine/stopped"),
            (mismatch().into(), EyeboxStatus::Encode, "encode/mismatch/frames"),
            (EvaluateError::Dark.into(), EyeboxStatus::Hologram, "evaluate/dark"),
            (SolveError::from(scene()).into(), EyeboxStatus::Solve, "scene/matrix"),
            (SolveError::from(engine()).into(), EyeboxStatus::Solve, "engine/stopped"),
            (SolveError::Text(reason("toml")).into(), EyeboxStatus::Solve, "solve/text/toml"),
            (ProduceError::from(optics()).into(), EyeboxStatus::Display, "optics/size"),
            (ProduceError::from(scene()).into(), EyeboxStatus::Scene, "scene/matrix"),
            (ProduceError::from(engine()).into(), EyeboxStatus::Engine, "engine/stopped"),
            (ProduceError::from(HologramError::NoDisplay).into(), EyeboxStatus::Solve, "hologram/no-display"),
            (ProduceError::from(ReconstructionError::from(engine())).into(), EyeboxStatus::Engine, "engine/stopped"),
            (ProduceError::from(ReconstructionError::from(optics())).into(), EyeboxStatus::Solve, "optics/size"),
            (ProduceError::Job(reason("no-scene")).into(), EyeboxStatus::Solve, "produce/job/no-scene"),
            (HologramError::from(optics()).into(), EyeboxStatus::Display, "optics/size"),
            (HologramError::from(scene()).into(), EyeboxStatus::Scene, "scene/matrix"),
            (HologramError::NoDisplay.into(), EyeboxStatus::Hologram, "hologram/no-display"),
            (HologramError::NoScene { of_array: true }.into(), EyeboxStatus::Hologram, "hologram/no-scene"),
            (ReconstructionError::from(optics()).into(), EyeboxStatus::Display, "optics/size"),
            (ReconstructionError::from(engine()).into(), EyeboxStatus::Engine, "engine/stopped"),
            (ReconstructionError::from(EvaluateError::Dark).into(), EyeboxStatus::Hologram, "evaluate/dark"),
            (SessionError::from(HologramError::from(optics())).into(), EyeboxStatus::Hologram, "optics/size"),
            (SessionError::from(mismatch()).into(), EyeboxStatus::Encode, "encode/mismatch/frames"),
            (SessionError::from(engine()).into(), EyeboxStatus::Engine, "engine/stopped"),
            (SessionError::from(SolveError::from(scene())).into(), EyeboxStatus::Solve, "scene/matrix"),
            (SessionError::from(reason("no-color")).into(), EyeboxStatus::Session, "session/setting/no-color"),
        ];
        for (failure, status, code) in cases {
            assert_eq!((failure.status(), &*ErrorData::of(&failure).code), (status, code), "{failure:?}");
        }
    }

    #[test]
    fn a_panic_is_a_code_and_what_it_was_in_is_no_more_used() {
        let shared = Mutex::new(0);
        let status = answer(|| {
            let _held = lock(&shared)?;
            panic!("on purpose")
        });
        assert_eq!(status, EyeboxStatus::Internal);
        // SAFETY: The function returns a text that ends with a zero byte.
        let said = unsafe { CStr::from_ptr(eyebox_last_error()) };
        assert_eq!(said.to_str().unwrap(), "a fault of eyebox itself: on purpose");
        assert_eq!(answer(|| lock(&shared).map(drop)), EyeboxStatus::Internal);
        let other = std::thread::spawn(|| {
            // SAFETY: The function returns a text that ends with a zero byte.
            unsafe { CStr::from_ptr(eyebox_last_error()) }.to_owned()
        });
        assert!(other.join().unwrap().is_empty());
    }
}
