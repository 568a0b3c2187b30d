//! Swapchains, whose images are copied when the application releases them.

use super::dispatch::Table;
use super::session::{SESSIONS, Session};
use crate::composition::Format;
use crate::notes::Subject;
use crate::vulkan::{Captured, Copier, Part, Source};
use ash::vk;
use openxr_sys::{self as xr, Handle};
use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The swapchains of the process.
pub static SWAPCHAINS: Table<Swapchain> = Table::new();

/// Images that are released less often than this are copied even without a display, because the same image may still
/// be in use when a display arrives.
const RARE: Duration = Duration::from_millis(200);
/// The longest wait for copies before images are destroyed.
const FINISH: Duration = Duration::from_secs(5);

/// A swapchain of an application.
pub struct Swapchain {
    pub session: Arc<Session>,
    /// The format, or none if the layer cannot read the images.
    pub format: Option<Format>,
    has_stencil: bool,
    /// Width, height and layers of an image.
    size: [u32; 3],
    is_static: bool,
    state: Mutex<State>,
}

/// The parts of a swapchain that change with frames.
#[derive(Default)]
struct State {
    copier: Option<Copier>,
    images: Vec<u64>,
    /// The images that the application holds, with the oldest first.
    acquired: VecDeque<u32>,
    /// The copy of the image that was released last.
    latest: Option<Arc<Captured>>,
    released: Option<Instant>,
    /// The parts that frames use for the eyes with a display.
    wanted: Vec<Part>,
    eyes: [bool; 2],
}

impl Swapchain {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the copy of a part of the image that was released last, for these eyes. Later copies contain the part.
    pub fn part(&self, part: &Part, eyes: [bool; 2]) -> Option<Arc<Captured>> {
        let mut state = self.state();
        if state.eyes != eyes {
            state.eyes = eyes;
            state.wanted.clear();
        }
        match state.wanted.iter_mut().find(|wanted| wanted.layer == part.layer) {
            Some(wanted) => *wanted = wanted.around(part),
            None => state.wanted.push(*part),
        }
        state.latest.clone().filter(|latest| latest.has(part))
    }

    /// Checks a rectangle of an application.
    pub fn checked(&self, image: &xr::SwapchainSubImage) -> Option<Part> {
        let xr::Rect2Di { offset, extent } = image.image_rect;
        let number = |v: i32| u32::try_from(v).ok();
        let [x, y] = [number(offset.x)?, number(offset.y)?];
        let [width, height] = [number(extent.width)?, number(extent.height)?];
        let part = Part { layer: image.image_array_index, x, y, width, height };
        let [across, down, layers] = self.size;
        let whole = Part { layer: part.layer, x: 0, y: 0, width: across, height: down };
        (part.layer < layers && width > 0 && height > 0 && whole.contains(&part)).then_some(part)
    }

    /// Copies the image that is about to be released, if a display may need it.
    fn copy(&self) {
        let (Some(capture), Some(format)) = (&self.session.capture, self.format) else { return };
        let mut state = self.state();
        let now = Instant::now();
        let is_rare = state.released.replace(now).is_none_or(|before| now - before > RARE) || self.is_static;
        let eyes = capture.sender.eyes();
        let is_wanted = eyes.contains(&true) && eyes == state.eyes && !state.wanted.is_empty();
        if !is_wanted && !is_rare {
            state.latest = None;
            return;
        }
        let [width, height, layers] = self.size;
        let whole = |layer| Part { layer, x: 0, y: 0, width, height };
        let parts: Vec<Part> =
            if is_wanted && !self.is_static { state.wanted.clone() } else { (0..layers).map(whole).collect() };
        let image = state.acquired.front().and_then(|index| state.images.get(*index as usize)).copied();
        let (Some(image), State { copier: Some(copier), .. }) = (image, &mut *state) else { return };
        let is_depth = format.is_depth();
        let source = Source { image, is_depth, has_stencil: self.has_stencil, texel: format.bytes() };
        match capture.submitting(|| copier.copy(&source, &parts, capture.sender.room())) {
            Ok(Some(captured)) => state.latest = Some(Arc::new(captured)),
            // The newest copy stays, so that a frame shows the image before.
            Ok(None) => drop(self.session.account.crowded.fetch_add(1, Ordering::Relaxed)),
            Err(error) => {
                state.copier = None;
                let line = || format!("an image cannot be copied ({error}). The last picture stays");
                self.session.notes.once(Subject::Vulkan, line);
            }
        }
    }
}

/// Returns the format, and whether it has a stencil.
fn format_of(format: i64) -> Option<(Format, bool)> {
    let raw = i32::try_from(format).ok()?;
    Some(match vk::Format::from_raw(raw) {
        vk::Format::R8G8B8A8_SRGB => (Format::Rgba8 { srgb: true }, false),
        vk::Format::R8G8B8A8_UNORM => (Format::Rgba8 { srgb: false }, false),
        vk::Format::B8G8R8A8_SRGB => (Format::Bgra8 { srgb: true }, false),
        vk::Format::B8G8R8A8_UNORM => (Format::Bgra8 { srgb: false }, false),
        vk::Format::A2B10G10R10_UNORM_PACK32 => (Format::Rgb10A2, false),
        vk::Format::R16G16B16A16_SFLOAT => (Format::Rgba16Float, false),
        vk::Format::D16_UNORM => (Format::D16, false),
        vk::Format::X8_D24_UNORM_PACK32 => (Format::D24, false),
        vk::Format::D24_UNORM_S8_UINT => (Format::D24, true),
        vk::Format::D32_SFLOAT => (Format::D32, false),
        vk::Format::D32_SFLOAT_S8_UINT => (Format::D32, true),
        _ => return None,
    })
}

pub unsafe extern "system" fn create_swapchain(
    session: xr::Session,
    info: *const xr::SwapchainCreateInfo,
    created: *mut xr::Swapchain,
) -> xr::Result {
    let Some(known) = SESSIONS.get(session.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
    let create = known.next().create_swapchain;
    // SAFETY: the arguments are the caller's.
    let unchanged = || unsafe { create(session, info, created) };
    // SAFETY: the caller passes a valid structure or null.
    let Some(wanted) = (unsafe { info.as_ref() }).filter(|_| known.capture.is_some()) else { return unchanged() };
    let found = format_of(wanted.format).filter(|_| wanted.sample_count == 1 && wanted.face_count == 1);
    let mut readable = *wanted;
    readable.usage_flags |= xr::SwapchainUsageFlags::TRANSFER_SRC;
    // SAFETY: the structure differs from the caller's by one flag.
    let result = if found.is_some() { unsafe { create(session, &readable, created) } } else { unchanged() };
    let (result, format) = match result.into_raw() {
        0.. => (result, found),
        // A runtime may refuse the additional usage.
        _ => (unchanged(), None),
    };
    if result.into_raw() < 0 {
        return result;
    }
    // SAFETY: the call succeeded, so the handle is there.
    let handle = unsafe { *created };
    known.observe(|| {
        if format.is_none() {
            let line = || {
                let samples = wanted.sample_count;
                format!(
                    "images of Vulkan's format {} with {samples} samples cannot be read. They are left out",
                    wanted.format
                )
            };
            known.notes.once(Subject::Format, line);
        }
        let copier = known.capture.as_ref().map(|capture| Copier::new(&capture.device));
        let images = if format.is_some() { images(&known, handle) } else { Vec::new() };
        let swapchain = Swapchain {
            session: known.clone(),
            format: format.map(|(format, _)| format),
            has_stencil: format.is_some_and(|(_, stencil)| stencil),
            size: [wanted.width, wanted.height, wanted.array_size],
            is_static: wanted.create_flags.contains(xr::SwapchainCreateFlags::STATIC_IMAGE),
            state: Mutex::new(State { copier, images, ..State::default() }),
        };
        SWAPCHAINS.put(handle.into_raw(), swapchain);
    });
    result
}

/// Returns the images of a swapchain.
fn images(session: &Session, swapchain: xr::Swapchain) -> Vec<u64> {
    let enumerate = session.next().enumerate_swapchain_images;
    let mut count = 0;
    // SAFETY: a capacity of 0 only returns the number.
    let counted = unsafe { enumerate(swapchain, 0, &mut count, std::ptr::null_mut()) };
    if counted.into_raw() < 0 {
        return Vec::new();
    }
    let empty = xr::SwapchainImageVulkanKHR {
        ty: xr::StructureType::SWAPCHAIN_IMAGE_VULKAN_KHR,
        next: std::ptr::null_mut(),
        image: 0,
    };
    let mut all = vec![empty; count as usize];
    // SAFETY: the list has as many elements as stated, of the structure for Vulkan.
    let listed = unsafe { enumerate(swapchain, count, &mut count, all.as_mut_ptr().cast()) };
    if listed.into_raw() < 0 { Vec::new() } else { all.iter().map(|image| image.image).collect() }
}

pub unsafe extern "system" fn destroy_swapchain(swapchain: xr::Swapchain) -> xr::Result {
    let next = next_of(swapchain);
    forget(swapchain.into_raw());
    // SAFETY: the argument is the caller's.
    next.map_or(xr::Result::ERROR_HANDLE_INVALID, |next| unsafe { (next.destroy_swapchain)(swapchain) })
}

/// Waits for the copies of a swapchain, and frees its buffers.
pub fn forget(swapchain: u64) {
    if let Some(known) = SWAPCHAINS.take(swapchain) {
        let mut state = known.state();
        state.latest = None;
        if let Some(copier) = state.copier.take() {
            copier.finish(FINISH);
        }
    }
}

/// Returns the functions below a swapchain. A swapchain that the layer does not store belongs to the only instance.
fn next_of(swapchain: xr::Swapchain) -> Option<super::dispatch::Next> {
    match SWAPCHAINS.get(swapchain.into_raw()) {
        Some(known) => Some(*known.session.next()),
        None => super::instance::INSTANCES.any().map(|instance| instance.next),
    }
}

pub unsafe extern "system" fn acquire_swapchain_image(
    swapchain: xr::Swapchain,
    info: *const xr::SwapchainImageAcquireInfo,
    index: *mut u32,
) -> xr::Result {
    let Some(next) = next_of(swapchain) else { return xr::Result::ERROR_HANDLE_INVALID };
    // SAFETY: the arguments are the caller's.
    let result = unsafe { (next.acquire_swapchain_image)(swapchain, info, index) };
    if let (0.., Some(known)) = (result.into_raw(), SWAPCHAINS.get(swapchain.into_raw())) {
        // SAFETY: the call succeeded, so the index is there.
        known.state().acquired.push_back(unsafe { *index });
    }
    result
}

pub unsafe extern "system" fn release_swapchain_image(
    swapchain: xr::Swapchain,
    info: *const xr::SwapchainImageReleaseInfo,
) -> xr::Result {
    let known = SWAPCHAINS.get(swapchain.into_raw());
    let Some(next) = next_of(swapchain) else { return xr::Result::ERROR_HANDLE_INVALID };
    if let Some(known) = &known {
        known.session.observe(|| known.copy());
    }
    // SAFETY: the arguments are the caller's.
    let result = unsafe { (next.release_swapchain_image)(swapchain, info) };
    if let (0.., Some(known)) = (result.into_raw(), &known) {
        // The oldest image that the application holds is the one that it releases.
        known.state().acquired.pop_front();
    }
    result
}
