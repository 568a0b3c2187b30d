//! Displays that take frames, each with the place where its frames are composed.

use crate::composition::{Canvas, Frustum};
use crate::layers::{Layer, Place, WITHOUT_DEPTH};
use crate::notes::{Notes, Subject};
use crate::vulkan::own::{Composer, Fault, Layout, Memory, Own, Seen, SeenPlace, Shape, Target};
use eyebox_live_input::{Application, Content, DeviceIds, FrameInfo, LiveError, Offer, Sample, Transfer};
use std::sync::Arc;
use std::time::Duration;

/// The longest time in which a display gives its memory. It answers at its next look for frames.
const SHARE_TIMEOUT: Duration = Duration::from_secs(5);

/// The reasons for which a display's frames pass through the host.
#[derive(Debug, thiserror::Error)]
pub enum Unshared {
    #[error("the application's device does not share memory (VK_KHR_external_memory_fd)")]
    Application,
    #[error("the display is on another device than the application")]
    OtherDevice,
    #[error("the display's device has no memory left to share")]
    NoMemory,
    #[error(transparent)]
    Live(#[from] LiveError),
    #[error(transparent)]
    Device(#[from] Fault),
}

/// The reasons for which a frame is not sent.
#[derive(Debug, thiserror::Error)]
pub enum Unsent {
    #[error(transparent)]
    Live(#[from] LiveError),
    #[error(transparent)]
    Device(#[from] Fault),
}

/// A display that is there.
pub struct Connection {
    pub application: Application,
    canvas: Canvas,
    samples: Vec<f32>,
    /// Composes on the layer's device, if there is one.
    composer: Option<Composer>,
    /// True if the display's device has the frames. Otherwise they pass through the host.
    shares: bool,
}

impl Connection {
    pub fn new(application: Application) -> Self {
        let canvas = Canvas::new(frustum(application.offer()));
        Self { application, canvas, samples: Vec::new(), composer: None, shares: false }
    }

    /// Returns the tangents of the edges of the display.
    pub fn edges(&self) -> [f64; 4] {
        frustum(self.application.offer()).edges()
    }

    /// Requests memory of the display's device, if it has one. `ours` is the device of the application's images, and
    /// `own` is the layer's own device there if it is open. Returns the layer's device, or none if the display has no
    /// device.
    ///
    /// # Errors
    /// Returns [`Unshared`] if frames have to pass through the host although the display has a device.
    pub fn share(&mut self, ours: Option<DeviceIds>, own: Option<&Arc<Own>>) -> Result<Option<Arc<Own>>, Unshared> {
        let Some(theirs) = self.application.device() else { return Ok(None) };
        let ours = ours.ok_or(Unshared::Application)?;
        if ours != theirs {
            return Err(Unshared::OtherDevice);
        }
        let own = own.map_or_else(|| Own::open(ours), |own| Ok(own.clone()))?;
        let (memory, fd) = self.application.share(SHARE_TIMEOUT)?.ok_or(Unshared::NoMemory)?;
        let layout = Layout {
            memory_bytes: memory.memory_bytes,
            buffer_bytes: memory.buffer_bytes,
            memory_type: memory.memory_type,
            usage: memory.usage,
        };
        let target = Target::Slots { memory: Memory::import(&own, fd, &layout)?, stride: memory.slot_stride };
        self.composer = Some(Composer::new(&own, shape(self.application.offer()), target)?);
        self.shares = true;
        Ok(Some(own))
    }

    /// Composes on the host from now on.
    pub fn leave_device(&mut self) {
        (self.composer, self.shares) = (None, false);
    }

    /// Composes and sends the layers, on the layer's device if it is open. Returns false if the host cannot read
    /// the copies of the view.
    ///
    /// # Errors
    /// Returns [`Unsent`] if the display refuses the frame, or the device fails.
    pub fn send(
        &mut self,
        layers: &[Layer],
        shows_ns: i64,
        own: Option<&Arc<Own>>,
        notes: &Notes,
    ) -> Result<bool, Unsent> {
        let request = self.application.request().map_or(0, |request| request.number);
        let info = FrameInfo {
            request,
            content_time_ns: shows_ns,
            on_device: self.shares && own.is_some(),
            ..FrameInfo::new(Content::ColorAndDepth, Sample::F32, Transfer::Linear)
        };
        match own {
            Some(own) => self.send_from_device(&info, layers, own, notes).map(|()| true),
            None => self.send_from_host(&info, layers, notes).map_err(Unsent::Live),
        }
    }

    fn send_from_device(
        &mut self,
        info: &FrameInfo,
        layers: &[Layer],
        own: &Arc<Own>,
        notes: &Notes,
    ) -> Result<(), Unsent> {
        let Self { application, composer, .. } = self;
        let seen = seen(own, layers)?;
        let composer = match composer {
            Some(composer) => composer,
            // The display has no memory of this device, so that the host reads the picture.
            None => {
                let shape = shape(application.offer());
                let target = Target::host(own, shape.bytes()[0])?;
                composer.insert(Composer::new(own, shape, target)?)
            }
        };
        let nearest = nearest(application.offer());
        if info.on_device {
            let slot = application.begin(info)?;
            note_near(composer.compose(slot.index(), &seen)?, nearest, notes);
            slot.publish();
        } else {
            note_near(composer.compose(0, &seen)?, nearest, notes);
            let (light, dioptres) = composer.samples();
            application.send(info, bytemuck::cast_slice(light), dioptres)?;
        }
        Ok(())
    }

    fn send_from_host(&mut self, info: &FrameInfo, layers: &[Layer], notes: &Notes) -> Result<bool, LiveError> {
        if !layers.iter().all(is_readable) {
            return Ok(false);
        }
        self.canvas.clear();
        layers.iter().for_each(|layer| draw(&mut self.canvas, layer));
        let nearest = nearest(self.application.offer());
        note_near(self.canvas.limit(nearest), nearest, notes);
        self.canvas.samples(self.application.offer().colors, &mut self.samples);
        self.application.send(info, bytemuck::cast_slice(&self.samples), self.canvas.dioptres()).map(|_| true)
    }
}

fn note_near(was_near: bool, nearest: f32, notes: &Notes) {
    if was_near {
        let meters = 1.0 / nearest;
        let line = || format!("content nearer than {meters:.2} m is shown at this distance, the display's limit");
        notes.once(Subject::Near, line);
    }
}

/// The share of a picture by which the eye may displace content. `eyebox show` refuses frames above it.
const DISPLACEMENT: f64 = 0.25;

/// Returns the dioptres of the nearest content that a display shows.
fn nearest(offer: &Offer) -> f32 {
    let pixels = DISPLACEMENT * f64::from(offer.size[0].min(offer.size[1]));
    let reach_m = offer.eyebox_mm[0].max(offer.eyebox_mm[1]) / 2.0 * 1e-3;
    (pixels * offer.pixel_angle / reach_m) as f32
}

fn frustum(offer: &Offer) -> Frustum {
    Frustum { size: offer.size.map(|n| n as usize), angle: offer.pixel_angle }
}

fn shape(offer: &Offer) -> Shape {
    Shape { frustum: frustum(offer), colors: offer.colors, nearest: nearest(offer) }
}

/// Returns true if the host can read the copies of a view. A copy that the layer's device received before it failed
/// cannot be read. Other layers are left out.
fn is_readable(layer: &Layer) -> bool {
    let Place::View { depth, .. } = &layer.place else { return true };
    layer.color.sheet().is_some() && depth.as_ref().is_none_or(|(depth, _)| depth.sheet().is_some())
}

fn draw(canvas: &mut Canvas, layer: &Layer) {
    let Some(color) = layer.color.sheet() else { return };
    match &layer.place {
        Place::View { edges, depth } => {
            let depth = depth.as_ref().and_then(|(piece, range)| Some((piece.sheet()?, *range)));
            canvas.project(color, *edges, layer.alpha, depth, WITHOUT_DEPTH);
        }
        Place::Quad(quad) => canvas.draw(quad, color, layer.alpha),
        Place::Cylinder(cylinder) => canvas.draw(cylinder, color, layer.alpha),
    }
}

/// Returns the layers with their texels for the layer's device.
fn seen<'a>(own: &Arc<Own>, layers: &'a [Layer]) -> Result<Vec<Seen<'a>>, Fault> {
    let mut all = Vec::with_capacity(layers.len());
    for layer in layers {
        let Some(color) = layer.color.texels(own)? else { continue };
        let place = match &layer.place {
            Place::View { edges, depth } => {
                let depth = match depth {
                    Some((piece, range)) => piece.texels(own)?.map(|texels| (texels, *range)),
                    None => None,
                };
                SeenPlace::View { edges: *edges, depth, dioptres: WITHOUT_DEPTH }
            }
            Place::Quad(quad) => SeenPlace::Quad(quad),
            Place::Cylinder(cylinder) => SeenPlace::Cylinder(cylinder),
        };
        all.push(Seen { color, alpha: layer.alpha, place });
    }
    Ok(all)
}
