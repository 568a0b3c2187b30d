//! Sessions, each with the application's device and the thread that sends.

use super::chain::{link, links};
use super::dispatch::{Next, Table};
use super::instance::{INSTANCES, Instance};
use crate::notes::{Notes, Subject, say};
use crate::sender::Sender;
use crate::vulkan::{Binding, Device};
use openxr_sys::{self as xr, Handle};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicI32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// The sessions of the process.
pub static SESSIONS: Table<Session> = Table::new();

/// The name of the display, as `live:NAME`. The second one is used if the variable is not set.
const NAME: &str = "EYEBOX_OPENXR_NAME";
const USUAL_NAME: &str = "openxr";
/// The field of view for which applications render, `display` or any other value for the one of the runtime.
const FIELD_OF_VIEW: &str = "EYEBOX_OPENXR_FOV";

/// A session of an application.
pub struct Session {
    pub instance: Arc<Instance>,
    pub handle: xr::Session,
    pub notes: Arc<Notes>,
    /// The device and the thread, or none if the layer cannot read the application's images.
    pub capture: Option<Capture>,
    /// True if the application renders for the field of view of the display.
    narrows: bool,
    views: AtomicI32,
    pub account: Account,
}

/// The parts of a session that read images.
pub struct Capture {
    pub device: Arc<Device>,
    pub sender: Sender,
    /// Held while the layer submits. The application keeps its own threads away.
    pub queue: Mutex<()>,
    /// Rows and columns of the application's view in the last frame.
    pub view_size: Mutex<Option<[u32; 2]>>,
}

/// The frames of a session, and the time that the layer took on the application's threads.
#[derive(Debug, Default)]
pub struct Account {
    /// Frames that ended while a display was there.
    pub frames: AtomicU64,
    /// Frames whose images were not copied, because the display was not there at their release.
    pub incomplete: AtomicU64,
    /// Frames without a layer.
    pub empty: AtomicU64,
    /// Copies that were left out because all buffers were in use.
    pub crowded: AtomicU64,
    spent_ns: AtomicU64,
}

impl Session {
    /// Returns the functions below.
    pub fn next(&self) -> &Next {
        &self.instance.next
    }

    /// Runs the layer's own work in a call. The application does not end if it fails, and its time is counted.
    pub fn observe<T>(&self, work: impl FnOnce() -> T) -> Option<T> {
        let begun = Instant::now();
        let done = catch_unwind(AssertUnwindSafe(work));
        let spent = u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.account.spent_ns.fetch_add(spent, Ordering::Relaxed);
        if done.is_err() {
            self.notes.once(Subject::Panic, || "a fault in the layer. The last picture stays".into());
        }
        done.ok()
    }

    /// Returns the view configuration with which the application began.
    pub fn views(&self) -> xr::ViewConfigurationType {
        xr::ViewConfigurationType::from_raw(self.views.load(Ordering::Relaxed))
    }

    /// Prints the frames of the session.
    pub(super) fn conclude(&self, sent: u64, replaced: u64, unsent: u64) {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let Account { frames, incomplete, empty, crowded, spent_ns } = &self.account;
        let frames = count(frames);
        if frames > 0 {
            let each_ms = count(spent_ns) as f64 / frames as f64 * 1e-6;
            say(&format!(
                "{frames} frames ended, {sent} sent, {replaced} replaced by a newer one, {unsent} without a display, {} not copied, {} empty, {} copies left out, {each_ms:.3} ms per frame on the application's threads",
                count(incomplete),
                count(empty),
                count(crowded)
            ));
        }
    }
}

pub unsafe extern "system" fn create_session(
    instance: xr::Instance,
    info: *const xr::SessionCreateInfo,
    created: *mut xr::Session,
) -> xr::Result {
    let Some(instance) = INSTANCES.get(instance.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
    // SAFETY: the arguments are the caller's.
    let result = unsafe { (instance.next.create_session)(instance.handle, info, created) };
    if result != xr::Result::SUCCESS {
        return result;
    }
    let notes = Arc::new(Notes::default());
    // SAFETY: the call below the layer accepted the structures, and returned a handle.
    let (binding, handle) = unsafe { (binding(&*info), *created) };
    let capture = catch_unwind(|| binding.and_then(|binding| begin(binding, &notes)));
    let capture = capture.unwrap_or_else(|_| Err("a fault in the layer".into()));
    let capture = capture.map_err(|reason| notes.once(Subject::Api, || reason)).ok();
    let narrows = std::env::var_os(FIELD_OF_VIEW).is_some_and(|value| value == "display");
    let views = AtomicI32::new(xr::ViewConfigurationType::PRIMARY_STEREO.into_raw());
    let account = Account::default();
    SESSIONS.put(handle.into_raw(), Session { instance, handle, notes, capture, narrows, views, account });
    result
}

fn begin(binding: Binding, notes: &Arc<Notes>) -> Result<Capture, String> {
    let device = Arc::new(Device::of(binding)?);
    let name = std::env::var(NAME).ok().filter(|name| !name.is_empty()).unwrap_or_else(|| USUAL_NAME.into());
    let sender = Sender::start(&name, device.ids(), notes.clone()).map_err(|error| format!("no thread: {error}"))?;
    Ok(Capture { device, sender, queue: Mutex::new(()), view_size: Mutex::new(None) })
}

/// Returns the handles of Vulkan with which a session begins.
///
/// # Errors
/// Returns a message that names the graphics interface of the application.
///
/// # Safety
/// The structure and its chain must be valid.
unsafe fn binding(info: &xr::SessionCreateInfo) -> Result<Binding, String> {
    type Bound = xr::GraphicsBindingVulkanKHR;
    // SAFETY: as stated above.
    if let Some(bound) = unsafe { link::<Bound>(info.next, xr::StructureType::GRAPHICS_BINDING_VULKAN_KHR) } {
        return Ok(Binding {
            instance: bound.instance as u64,
            physical_device: bound.physical_device as u64,
            device: bound.device as u64,
            family: bound.queue_family_index,
            queue: bound.queue_index,
        });
    }
    // SAFETY: as stated above.
    let found = unsafe { links(info.next) }.find_map(|(kind, _)| interface(kind));
    Err(match found {
        Some(name) => format!("{name} applications cannot send frames. Use the Vulkan renderer of the application"),
        None => "the application has no graphics, so that it has no frames to send".into(),
    })
}

/// Returns the name of a graphics interface other than Vulkan.
fn interface(kind: xr::StructureType) -> Option<&'static str> {
    use xr::StructureType as Kind;
    let open_gl = [
        Kind::GRAPHICS_BINDING_OPENGL_XLIB_KHR,
        Kind::GRAPHICS_BINDING_OPENGL_XCB_KHR,
        Kind::GRAPHICS_BINDING_OPENGL_WAYLAND_KHR,
        Kind::GRAPHICS_BINDING_OPENGL_WIN32_KHR,
    ];
    match kind {
        kind if open_gl.contains(&kind) => Some("OpenGL"),
        Kind::GRAPHICS_BINDING_OPENGL_ES_ANDROID_KHR | Kind::GRAPHICS_BINDING_EGL_MNDX => Some("OpenGL ES"),
        Kind::GRAPHICS_BINDING_D3D11_KHR => Some("Direct3D 11"),
        Kind::GRAPHICS_BINDING_D3D12_KHR => Some("Direct3D 12"),
        Kind::GRAPHICS_BINDING_METAL_KHR => Some("Metal"),
        _ => None,
    }
}

pub unsafe extern "system" fn begin_session(session: xr::Session, info: *const xr::SessionBeginInfo) -> xr::Result {
    let Some(known) = SESSIONS.get(session.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
    // SAFETY: the arguments are the caller's.
    let result = unsafe { (known.next().begin_session)(session, info) };
    if result.into_raw() >= 0 {
        // SAFETY: the call below the layer accepted the structure.
        let views = unsafe { (*info).primary_view_configuration_type };
        known.views.store(views.into_raw(), Ordering::Relaxed);
    }
    result
}

/// Locates the views of the runtime. If the variable requests it, they have the field of view of the display, so that
/// the application uses all of its pixels for the display.
pub unsafe extern "system" fn locate_views(
    session: xr::Session,
    info: *const xr::ViewLocateInfo,
    state: *mut xr::ViewState,
    capacity: u32,
    count: *mut u32,
    views: *mut xr::View,
) -> xr::Result {
    let Some(known) = SESSIONS.get(session.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
    // SAFETY: the arguments are the caller's.
    let result = unsafe { (known.next().locate_views)(session, info, state, capacity, count, views) };
    if let (true, Some(capture)) = (known.narrows && result.into_raw() >= 0 && capacity > 0, &known.capture) {
        // SAFETY: the call below the layer wrote this many views.
        let views = unsafe { std::slice::from_raw_parts_mut(views, (*count).min(capacity) as usize) };
        for (view, edges) in views.iter_mut().zip(capture.sender.edges()) {
            if let Some([left, right, up, down]) = edges.map(|edges| edges.map(|tangent| tangent.atan() as f32)) {
                view.fov = xr::Fovf { angle_left: left, angle_right: right, angle_up: up, angle_down: down };
            }
        }
    }
    result
}

impl Capture {
    /// Runs work that submits to the application's queue.
    pub fn submitting<T>(&self, work: impl FnOnce() -> T) -> T {
        let _held = self.queue.lock().unwrap_or_else(PoisonError::into_inner);
        work()
    }
}
