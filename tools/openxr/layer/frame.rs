//! Collects the copies that a frame uses when the frame ends.

use super::chain::link;
use super::session::{SESSIONS, Session};
use super::swapchain::SWAPCHAINS;
use crate::composition::{Alpha, Cylinder, DepthRange, Format, Pose, Quad};
use crate::layers::{Frame, Layer, Piece, Place, WITHOUT_DEPTH};
use crate::notes::Subject;
use openxr_sys::{self as xr, Handle};
use std::sync::PoisonError;
use std::sync::atomic::Ordering;

pub unsafe extern "system" fn end_frame(session: xr::Session, info: *const xr::FrameEndInfo) -> xr::Result {
    let Some(known) = SESSIONS.get(session.into_raw()) else { return xr::Result::ERROR_HANDLE_INVALID };
    let next = known.next().end_frame;
    // SAFETY: the caller passes a valid structure or null.
    let Some(ended) = (unsafe { info.as_ref() }) else {
        // SAFETY: the arguments are the caller's.
        return unsafe { next(session, info) };
    };
    // SAFETY: the caller passes as many layers as it states.
    let layers = unsafe { layers(ended) };
    known.observe(|| collect(&known, ended, &layers));
    if !known.instance.depth_is_cut {
        // SAFETY: the arguments are the caller's.
        return unsafe { next(session, info) };
    }
    let cut = Cut::new(&layers);
    let pointers = cut.pointers(&layers);
    let mut passed = *ended;
    passed.layers = pointers.as_ptr();
    // SAFETY: the structures are the caller's, or copies that live until the call returns.
    unsafe { next(session, &passed) }
}

type Header = xr::CompositionLayerBaseHeader;

/// Returns the layers of a frame.
///
/// # Safety
/// The structure must have as many layers as it states. They stay valid as long as the structure.
unsafe fn layers(info: &xr::FrameEndInfo) -> Vec<&Header> {
    if info.layer_count == 0 || info.layers.is_null() {
        return Vec::new();
    }
    // SAFETY: as stated above.
    let all = unsafe { std::slice::from_raw_parts(info.layers, info.layer_count as usize) };
    // SAFETY: as stated above.
    all.iter().filter_map(|layer| unsafe { layer.as_ref() }).collect()
}

/// A layer as its own structure.
enum Kind<'a> {
    Projection(&'a xr::CompositionLayerProjection, &'a [xr::CompositionLayerProjectionView]),
    Quad(&'a xr::CompositionLayerQuad),
    Cylinder(&'a xr::CompositionLayerCylinderKHR),
    Other,
}

impl<'a> Kind<'a> {
    fn of(header: &'a Header) -> Self {
        let at = std::ptr::from_ref(header);
        // SAFETY: the type states the structure, which begins with the header. A projection has as many views as it
        // states.
        unsafe {
            match header.ty {
                xr::StructureType::COMPOSITION_LAYER_PROJECTION => {
                    let layer = &*at.cast::<xr::CompositionLayerProjection>();
                    let empty = layer.view_count == 0 || layer.views.is_null();
                    let views: &[xr::CompositionLayerProjectionView] =
                        if empty { &[] } else { std::slice::from_raw_parts(layer.views, layer.view_count as usize) };
                    Kind::Projection(layer, views)
                }
                xr::StructureType::COMPOSITION_LAYER_QUAD => Kind::Quad(&*at.cast()),
                xr::StructureType::COMPOSITION_LAYER_CYLINDER_KHR => Kind::Cylinder(&*at.cast()),
                _ => Kind::Other,
            }
        }
    }
}

/// Collects the copies of a frame for the eyes that have a display, and leaves them for the thread.
fn collect(session: &Session, info: &xr::FrameEndInfo, layers: &[&Header]) {
    let Some(capture) = &session.capture else { return };
    let eyes = capture.sender.eyes();
    if !eyes.contains(&true) {
        return;
    }
    session.account.frames.fetch_add(1, Ordering::Relaxed);
    if layers.is_empty() {
        session.account.empty.fetch_add(1, Ordering::Relaxed);
        session.notes.once(Subject::NoLayers, || "a frame without layers. The last picture stays".into());
        return;
    }
    let kinds: Vec<Kind<'_>> = layers.iter().map(|header| Kind::of(header)).collect();
    let views = kinds.iter().find_map(|kind| match kind {
        Kind::Projection(layer, views) if !views.is_empty() => Some((layer.space, *views)),
        _ => None,
    });
    remark(session, &kinds, views.map(|(_, views)| views));
    let scene = Scene { session, time: info.display_time, views, eyes };
    let mut found = [None, None];
    for (eye, layers) in found.iter_mut().enumerate().filter(|(eye, _)| eyes[*eye]) {
        match scene.seen_by(eye, &kinds) {
            Some(seen) if !seen.is_empty() => *layers = Some(seen),
            // This eye sees no layer, or its view was not copied.
            _ => {
                session.account.incomplete.fetch_add(1, Ordering::Relaxed);
                return;
            }
        }
    }
    capture.sender.send(Frame { shows_ns: monotonic_ns(session, info.display_time), eyes: found });
}

/// Prints the properties of a frame that a user may not expect, each once.
fn remark(session: &Session, kinds: &[Kind<'_>], views: Option<&[xr::CompositionLayerProjectionView]>) {
    let notes = &session.notes;
    let others = kinds.iter().filter(|kind| matches!(kind, Kind::Other)).count();
    if others > 0 {
        notes.once(Subject::Layers, || {
            format!(
                "{others} of {} layers are neither projections, quads nor cylinders. They are left out",
                kinds.len()
            )
        });
    }
    let Some(view) = views.and_then(<[_]>::first) else {
        return notes
            .once(Subject::OnlyQuads, || "no projection. Quads and cylinders are shown at their distances".into());
    };
    let extent = view.sub_image.image_rect.extent;
    let size = [extent.height, extent.width].map(|n| u32::try_from(n).unwrap_or(0));
    let Some(capture) = &session.capture else { return };
    let mut last = capture.view_size.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(before) = last.replace(size).filter(|before| *before != size) {
        notes.once(Subject::Size, || {
            format!("the view has {} x {} pixels now, after {} x {}", size[0], size[1], before[0], before[1])
        });
    }
}

/// The layers of a frame for an eye.
struct Scene<'a> {
    session: &'a Session,
    time: xr::Time,
    /// The space and the views of the first projection.
    views: Option<(xr::Space, &'a [xr::CompositionLayerProjectionView])>,
    eyes: [bool; 2],
}

impl Scene<'_> {
    /// Returns the layers that an eye sees. Returns none if the copy of a projection is missing.
    fn seen_by(&self, eye: usize, kinds: &[Kind<'_>]) -> Option<Vec<Layer>> {
        let (mut seen, mut is_missing) = (Vec::with_capacity(kinds.len()), false);
        for kind in kinds {
            match kind {
                Kind::Projection(layer, views) => {
                    let Some(view) = views.get(eye.min(views.len().saturating_sub(1))) else { continue };
                    // All parts of the frame are registered, so that the next frame has all of them.
                    let (color, depth) = (self.color(&view.sub_image), self.depth(view));
                    let (Some(color), Some(depth)) = (color, depth) else {
                        is_missing = true;
                        continue;
                    };
                    let xr::Fovf { angle_left, angle_right, angle_up, angle_down } = view.fov;
                    let edges = [angle_left, angle_right, angle_up, angle_down].map(|angle| f64::from(angle).tan());
                    let place = Place::View { edges, depth };
                    seen.push(Layer { color, alpha: alpha(layer.layer_flags), place });
                }
                Kind::Quad(layer) if is_visible(layer.eye_visibility, eye) => {
                    let (Some(pose), Some(color)) =
                        (self.placed(layer.space, &layer.pose, eye), self.color(&layer.sub_image))
                    else {
                        continue;
                    };
                    let place = Place::Quad(Quad::new(&pose, [layer.size.width, layer.size.height]));
                    seen.push(Layer { color, alpha: alpha(layer.layer_flags), place });
                }
                Kind::Cylinder(layer) if is_visible(layer.eye_visibility, eye) => {
                    let (Some(pose), Some(color)) =
                        (self.placed(layer.space, &layer.pose, eye), self.color(&layer.sub_image))
                    else {
                        continue;
                    };
                    let cylinder = Cylinder::new(&pose, layer.radius, layer.central_angle, layer.aspect_ratio);
                    seen.push(Layer { color, alpha: alpha(layer.layer_flags), place: Place::Cylinder(cylinder) });
                }
                _ => {}
            }
        }
        (!is_missing).then_some(seen)
    }

    /// Returns the copy of a part of an image of color.
    fn color(&self, image: &xr::SwapchainSubImage) -> Option<Piece> {
        self.piece(image).filter(|piece| !piece.format.is_depth())
    }

    /// Returns the copy of a part of an image.
    fn piece(&self, image: &xr::SwapchainSubImage) -> Option<Piece> {
        let swapchain = SWAPCHAINS.get(image.swapchain.into_raw())?;
        let (format, part) = (swapchain.format?, swapchain.checked(image)?);
        Some(Piece { captured: swapchain.part(&part, self.eyes)?, part, format })
    }

    /// Returns the depth of a view, if the application submits a valid one. Returns none if its copy is missing.
    fn depth(&self, view: &xr::CompositionLayerProjectionView) -> Option<Option<(Piece, DepthRange)>> {
        type Info = xr::CompositionLayerDepthInfoKHR;
        // SAFETY: the chain of a view is valid until the frame ends.
        let found = unsafe { link::<Info>(view.next, xr::StructureType::COMPOSITION_LAYER_DEPTH_INFO_KHR) };
        let notes = &self.session.notes;
        let Some(info) = found else {
            let meters = 1.0 / WITHOUT_DEPTH;
            notes.once(Subject::Depth, || format!("the view has no depth. It is shown at {meters} m"));
            return Some(None);
        };
        let range = DepthRange { depths: [info.min_depth, info.max_depth], distances: [info.near_z, info.far_z] };
        if !range.is_valid() {
            notes.once(Subject::Depth, || {
                format!(
                    "the depths {} to {} for {} m to {} m are not valid. The view is shown without depth",
                    info.min_depth, info.max_depth, info.near_z, info.far_z
                )
            });
            return Some(None);
        }
        // A depth in a format that the layer cannot read was reported when the swapchain was made.
        let swapchain = SWAPCHAINS.get(info.sub_image.swapchain.into_raw());
        if !swapchain.and_then(|swapchain| swapchain.format).is_some_and(Format::is_depth) {
            return Some(None);
        }
        self.piece(&info.sub_image).map(|piece| Some((piece, range)))
    }

    /// Returns a pose in a space as the eye sees it.
    fn placed(&self, space: xr::Space, pose: &xr::Posef, eye: usize) -> Option<Pose> {
        let found = match self.views {
            Some((base, views)) => {
                let view = views.get(eye.min(views.len().saturating_sub(1)))?;
                self.between(space, base).map(|between| own(&view.pose).inverse().after(&between))
            }
            None => self.eye_in(space, eye).map(|eye| eye.inverse()),
        };
        if found.is_none() {
            let line = || "the place of a layer is not known. The layer is left out".into();
            self.session.notes.once(Subject::Space, line);
        }
        Some(found?.after(&own(pose)))
    }

    /// Returns the pose of a space in another one.
    fn between(&self, space: xr::Space, base: xr::Space) -> Option<Pose> {
        if space == base {
            return Some(own(&xr::Posef::IDENTITY));
        }
        let mut location = xr::SpaceLocation {
            ty: xr::SpaceLocation::TYPE,
            next: std::ptr::null_mut(),
            location_flags: xr::SpaceLocationFlags::EMPTY,
            pose: xr::Posef::IDENTITY,
        };
        // SAFETY: the spaces are the application's, and the call writes to `location`.
        let result = unsafe { (self.session.next().locate_space)(space, base, self.time, &mut location) };
        let valid = xr::SpaceLocationFlags::ORIENTATION_VALID | xr::SpaceLocationFlags::POSITION_VALID;
        (result.into_raw() >= 0 && location.location_flags.contains(valid)).then(|| own(&location.pose))
    }

    /// Returns the pose of an eye in a space, for frames without a projection.
    fn eye_in(&self, space: xr::Space, eye: usize) -> Option<Pose> {
        let info = xr::ViewLocateInfo {
            ty: xr::ViewLocateInfo::TYPE,
            next: std::ptr::null(),
            view_configuration_type: self.session.views(),
            display_time: self.time,
            space,
        };
        let mut state = xr::ViewState {
            ty: xr::ViewState::TYPE,
            next: std::ptr::null_mut(),
            view_state_flags: xr::ViewStateFlags::EMPTY,
        };
        let fov = xr::Fovf { angle_left: 0.0, angle_right: 0.0, angle_up: 0.0, angle_down: 0.0 };
        let empty = xr::View { ty: xr::View::TYPE, next: std::ptr::null_mut(), pose: xr::Posef::IDENTITY, fov };
        // Configurations have at most four views today.
        let mut views = [empty; 8];
        let mut count = 0;
        let capacity = views.len() as u32;
        // SAFETY: the session and the space are the application's, and the list has as many elements as stated.
        let result = unsafe {
            let locate = self.session.next().locate_views;
            locate(self.session.handle, &info, &mut state, capacity, &mut count, views.as_mut_ptr())
        };
        let valid = xr::ViewStateFlags::ORIENTATION_VALID | xr::ViewStateFlags::POSITION_VALID;
        let there = result.into_raw() >= 0 && state.view_state_flags.contains(valid) && count > 0;
        there.then(|| own(&views[eye.min(count as usize - 1)].pose))
    }
}

fn own(pose: &xr::Posef) -> Pose {
    let (q, p) = (pose.orientation, pose.position);
    Pose::new([q.x, q.y, q.z, q.w], [p.x, p.y, p.z])
}

fn alpha(flags: xr::CompositionLayerFlags) -> Alpha {
    Alpha {
        blends: flags.contains(xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA),
        unpremultiplied: flags.contains(xr::CompositionLayerFlags::UNPREMULTIPLIED_ALPHA),
        inverted: flags.contains(xr::CompositionLayerFlags::INVERTED_ALPHA),
    }
}

fn is_visible(eyes: xr::EyeVisibility, eye: usize) -> bool {
    match eyes {
        xr::EyeVisibility::LEFT => eye == 0,
        xr::EyeVisibility::RIGHT => eye == 1,
        _ => true,
    }
}

/// Converts a time of the runtime. Without the extension for it, the present time counts.
fn monotonic_ns(session: &Session, time: xr::Time) -> i64 {
    let (seconds, nanoseconds) = match session.next().convert_time {
        Some(convert) => {
            // SAFETY: a time of the system is numbers, which may be 0.
            let mut converted = unsafe { std::mem::zeroed() };
            // SAFETY: the instance is valid, and the call writes to `converted`.
            let result = unsafe { convert(session.instance.handle, time, &mut converted) };
            match result.into_raw() {
                0.. => (converted.tv_sec, converted.tv_nsec),
                _ => now(),
            }
        }
        None => now(),
    };
    seconds.saturating_mul(1_000_000_000).saturating_add(nanoseconds)
}

fn now() -> (i64, i64) {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    (now.tv_sec, now.tv_nsec)
}

/// Copies of the projections of a frame without their depth, for a runtime that does not have the extension.
struct Cut {
    /// The views of each projection.
    _views: Vec<Vec<xr::CompositionLayerProjectionView>>,
    /// The copied projections, by the index of their layer.
    layers: Vec<(usize, Box<xr::CompositionLayerProjection>)>,
}

impl Cut {
    fn new(layers: &[&Header]) -> Self {
        let (mut all_views, mut copies) = (Vec::new(), Vec::new());
        for (index, header) in layers.iter().enumerate() {
            let Kind::Projection(layer, views) = Kind::of(header) else { continue };
            let views: Vec<_> = views.iter().map(without_depth).collect();
            let mut copy = Box::new(*layer);
            copy.views = views.as_ptr();
            all_views.push(views);
            copies.push((index, copy));
        }
        Self { _views: all_views, layers: copies }
    }

    /// Returns the layers of the frame with the copies in their places.
    fn pointers(&self, layers: &[&Header]) -> Vec<*const Header> {
        let copy = |index: usize| self.layers.iter().find(|(of, _)| *of == index);
        let pointer = |(index, header): (usize, &&Header)| match copy(index) {
            Some((_, copy)) => std::ptr::from_ref(&**copy).cast(),
            None => std::ptr::from_ref(*header),
        };
        layers.iter().enumerate().map(pointer).collect()
    }
}

/// Returns a view without the depth at the beginning of its chain. A depth behind other structures stays, because their
/// sizes are not known. Every part of OpenXR must skip structures that it does not know, so that this does no harm.
fn without_depth(view: &xr::CompositionLayerProjectionView) -> xr::CompositionLayerProjectionView {
    let mut view = *view;
    // SAFETY: the chain of a view is valid until the frame ends.
    while let Some(first) = unsafe { view.next.cast::<xr::BaseInStructure>().as_ref() } {
        if first.ty != xr::StructureType::COMPOSITION_LAYER_DEPTH_INFO_KHR {
            break;
        }
        view.next = first.next.cast();
    }
    view
}
