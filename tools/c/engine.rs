//! Engines.

use crate::EyeboxStatus;
use crate::arrays::{given, hand_over, put, text};
use crate::failure::{Failure, answer, free, starts_threads};
use eyebox::engine::{Backend, Choice, Engine};
use eyebox::gpu::Options;
use std::ffi::{CString, c_char};
use std::mem::MaybeUninit;
use std::sync::Mutex;

/// Where is computed: on the CPU, or on a Vulkan device. Calls with one engine wait for each other.
pub struct EyeboxEngine {
    pub(crate) backend: Backend,
    pub(crate) engine: Mutex<Box<dyn Engine>>,
    reason: CString,
}

impl EyeboxEngine {
    pub(crate) fn on(backend: Backend) -> Result<Self, Failure> {
        let engine = Mutex::new(backend.engine()?);
        let reason = CString::new(backend.reason().replace('\0', " ")).unwrap_or_default();
        Ok(Self { backend, engine, reason })
    }
}

/// Opens an engine: "cpu"; "vulkan", a device in software included; or "auto": a real GPU where there is one that computes as it
/// should, else the CPU.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_engine_open(
    choice: *const c_char,
    engine: Option<&mut MaybeUninit<*mut EyeboxEngine>>,
) -> EyeboxStatus {
    answer(|| {
        starts_threads();
        hand_over(engine, || {
            // SAFETY: the header asks callers for texts that end with zero.
            let choice = match unsafe { text(choice, "choice") }? {
                "auto" => Choice::Auto,
                "cpu" => Choice::Cpu,
                "vulkan" => Choice::Vulkan,
                other => return Err(Failure::argument("choice", other, "auto, cpu or vulkan")),
            };
            EyeboxEngine::on(Backend::open(choice, &Options::default())?)
        })
    })
}

/// What computes, and why that and nothing else, in a sentence that stands as long as the engine.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_engine_reason(
    engine: Option<&EyeboxEngine>,
    reason: Option<&mut MaybeUninit<*const c_char>>,
) -> EyeboxStatus {
    answer(|| put(reason, || Ok(given(engine, "engine")?.reason.as_ptr())))
}

/// Frees an engine; refiners that were made with it go on.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_engine_free(engine: Option<Box<EyeboxEngine>>) {
    free(engine);
}
