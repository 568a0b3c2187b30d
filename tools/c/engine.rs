//! The functions for engines.

use crate::EyeboxStatus;
use crate::arrays::{given, hand_over, put, text};
use crate::failure::{Failure, answer, free, starts_threads};
use eyebox::engine::{Backend, Choice, Engine};
use eyebox::gpu::Options;
use std::ffi::{CString, c_char};
use std::mem::MaybeUninit;
use std::sync::Mutex;

/// An engine, which computes on the CPU or on a Vulkan device. Calls with one engine wait for each other.
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

/// Opens an engine. "cpu" computes on the CPU. "vulkan" computes on a Vulkan device, which may be a device in software.
/// "auto" chooses a real GPU if one computes correctly, and otherwise the CPU. Free the engine with
/// `eyebox_engine_free`. Fails with EYEBOX_STATUS_ARGUMENT if `choice` is another text. Fails with EYEBOX_STATUS_ENGINE
/// if there is no usable device.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_engine_open(
    choice: *const c_char,
    engine: Option<&mut MaybeUninit<*mut EyeboxEngine>>,
) -> EyeboxStatus {
    answer(|| {
        starts_threads();
        hand_over(engine, || {
            // SAFETY: The header requires texts that end with a zero byte.
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

/// Writes a pointer to a sentence into `reason`. The sentence names the device of the engine and the reason for this
/// choice. The engine owns it, and it stays valid until the engine is freed.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_engine_reason(
    engine: Option<&EyeboxEngine>,
    reason: Option<&mut MaybeUninit<*const c_char>>,
) -> EyeboxStatus {
    answer(|| put(reason, || Ok(given(engine, "engine")?.reason.as_ptr())))
}

/// Frees an engine. Refiners and sessions that were made with it continue to work. Null is allowed and has no effect.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_engine_free(engine: Option<Box<EyeboxEngine>>) {
    free(engine);
}
