//! The thread that waits for copies, composes pictures and sends them, so that the application waits for none of it.

use crate::composition::{Alpha, Canvas, Cylinder, DepthRange, Format, Frustum, Quad, Sheet};
use crate::notes::{Notes, Subject, say};
use crate::vulkan::{Captured, Part};
use eyebox_live_input::{Application, Content, FrameInfo, LiveError, Offer, Sample, Transfer};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The time between two attempts to connect to a display.
const RETRY: Duration = Duration::from_millis(250);
/// The longest time that a copy may take.
const COPY_TIMEOUT: Duration = Duration::from_secs(5);
/// The distance of a view without depth, in dioptres. The usual displays of headsets focus at about 2 m, too.
pub const WITHOUT_DEPTH: f32 = 0.5;

/// A part of a copied image.
pub struct Piece {
    pub captured: Arc<Captured>,
    pub part: Part,
    pub format: Format,
}

impl Piece {
    /// Returns the texels, after the copy is done.
    fn sheet(&self) -> Option<Sheet<'_>> {
        let (raw, stride) = self.captured.bytes(&self.part, self.format.bytes())?;
        let size = [self.part.height as usize, self.part.width as usize];
        Some(Sheet { raw, format: self.format, stride, size })
    }
}

/// The place of a layer's image.
pub enum Place {
    /// The view of the eye, whose edges have these tangents (left, right, up, down), with its depth.
    View {
        edges: [f64; 4],
        depth: Option<(Piece, DepthRange)>,
    },
    Quad(Quad),
    Cylinder(Cylinder),
}

/// A layer of a frame, for one eye.
pub struct Layer {
    pub color: Piece,
    pub alpha: Alpha,
    pub place: Place,
}

/// A frame of an application.
pub struct Frame {
    /// The time at which the application expects it to be shown, in nanoseconds of `CLOCK_MONOTONIC`.
    pub shows_ns: i64,
    /// The layers for the left and the right eye, from the back to the front.
    pub eyes: [Option<Vec<Layer>>; 2],
}

/// The frames of a session until now.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames that were sent to a display.
    pub sent: u64,
    /// Frames that a newer one replaced before they were composed.
    pub replaced: u64,
    /// Frames that no display took.
    pub unsent: u64,
}

#[derive(Default)]
struct Mail {
    frame: Option<Frame>,
    counts: Counts,
    stops: bool,
}

struct Shared {
    mail: Mutex<Mail>,
    arrived: Condvar,
    /// The eyes with a display, as 1 left + 2 right.
    eyes: AtomicU32,
    /// The tangents of the edges of the display of each eye.
    edges: Mutex<[Option<[f64; 4]>; 2]>,
    notes: Arc<Notes>,
}

impl Shared {
    fn mail(&self) -> MutexGuard<'_, Mail> {
        self.mail.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The other side of the thread.
pub struct Sender {
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Sender {
    /// Starts a thread that sends the left eye to `live:NAME` and `live:NAME-left`, and the right eye to
    /// `live:NAME-right`, as far as displays listen there.
    ///
    /// # Errors
    /// Returns the error of the system if no thread can be made.
    pub fn start(name: &str, notes: Arc<Notes>) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            mail: Mutex::default(),
            arrived: Condvar::new(),
            eyes: AtomicU32::new(0),
            edges: Mutex::default(),
            notes,
        });
        let outputs = [(name.to_owned(), 0), (format!("{name}-left"), 0), (format!("{name}-right"), 1)];
        let outputs = outputs.map(|(name, eye)| Output { name, eye, connection: None }).into();
        let its = shared.clone();
        let thread = std::thread::Builder::new()
            .name("eyebox openxr".into())
            .spawn(move || Worker { shared: its, outputs }.run())?;
        Ok(Self { shared, thread: Mutex::new(Some(thread)) })
    }

    /// Returns for each eye whether a display shows it.
    pub fn eyes(&self) -> [bool; 2] {
        let eyes = self.shared.eyes.load(Ordering::Relaxed);
        [eyes & 1 == 1, eyes & 2 == 2]
    }

    /// Returns the tangents of the edges of the display of each eye.
    pub fn edges(&self) -> [Option<[f64; 4]>; 2] {
        *self.shared.edges.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Leaves a frame for the thread. It replaces a frame that still waits.
    pub fn send(&self, frame: Frame) {
        let mut mail = self.shared.mail();
        let before = mail.frame.replace(frame);
        mail.counts.replaced += u64::from(before.is_some());
        drop(mail);
        self.shared.arrived.notify_one();
    }

    /// Ends the thread after the frame that waits, and returns the counts.
    pub fn stop(&self) -> Counts {
        self.shared.mail().stops = true;
        self.shared.arrived.notify_one();
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread {
            let _ = thread.join();
        }
        self.shared.mail().counts
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        self.stop();
    }
}

/// A display that may be there.
struct Output {
    name: String,
    eye: usize,
    connection: Option<Connection>,
}

/// A display that is there.
struct Connection {
    application: Application,
    canvas: Canvas,
    samples: Vec<f32>,
}

impl Connection {
    fn new(application: Application) -> Self {
        let canvas = Canvas::new(frustum(&application));
        Self { application, canvas, samples: Vec::new() }
    }

    /// Composes and sends the layers.
    fn send(&mut self, layers: &[Layer], shows_ns: i64, notes: &Notes) -> Result<(), LiveError> {
        self.canvas.clear();
        layers.iter().for_each(|layer| draw(&mut self.canvas, layer));
        let nearest = nearest(self.application.offer());
        if self.canvas.limit(nearest) {
            let meters = 1.0 / nearest;
            let line = || format!("content nearer than {meters:.2} m is shown at this distance, the display's limit");
            notes.once(Subject::Near, line);
        }
        self.canvas.samples(self.application.offer().colors, &mut self.samples);
        let request = self.application.request().map_or(0, |request| request.number);
        let info = FrameInfo {
            request,
            content_time_ns: shows_ns,
            ..FrameInfo::new(Content::ColorAndDepth, Sample::F32, Transfer::Linear)
        };
        self.application.send(&info, bytemuck::cast_slice(&self.samples), self.canvas.dioptres()).map(drop)
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

fn frustum(application: &Application) -> Frustum {
    let offer = application.offer();
    Frustum { size: offer.size.map(|n| n as usize), angle: offer.pixel_angle }
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

struct Worker {
    shared: Arc<Shared>,
    outputs: Vec<Output>,
}

impl Worker {
    fn run(mut self) {
        let mut tried: Option<Instant> = None;
        loop {
            if tried.is_none_or(|tried| tried.elapsed() >= RETRY) {
                self.connect();
                tried = Some(Instant::now());
            }
            let mail = self.shared.mail();
            let idle = |mail: &mut Mail| mail.frame.is_none() && !mail.stops;
            let waited = self.shared.arrived.wait_timeout_while(mail, RETRY, idle);
            let (mut mail, _) = waited.unwrap_or_else(PoisonError::into_inner);
            let (frame, stops) = (mail.frame.take(), mail.stops);
            drop(mail);
            if let Some(frame) = frame {
                let sent = self.send(&frame);
                let mut mail = self.shared.mail();
                mail.counts.sent += u64::from(sent);
                mail.counts.unsent += u64::from(!sent);
            }
            // A frame that arrived with the request to stop was the last one.
            if stops && self.shared.mail().frame.is_none() {
                return;
            }
        }
    }

    /// Connects to displays that are there now, and notices displays that are gone.
    fn connect(&mut self) {
        for output in &mut self.outputs {
            let Output { name, connection, .. } = output;
            if connection.as_ref().is_some_and(|there| !there.application.is_connected()) {
                gone(connection, name);
            }
            if connection.is_some() {
                continue;
            }
            match Application::connect(name) {
                Ok(application) => {
                    let [rows, columns] = application.offer().size;
                    say(&format!("live:{name} takes frames of {rows} x {columns} pixels"));
                    *connection = Some(Connection::new(application));
                    self.shared.notes.again(Subject::Refused);
                }
                Err(LiveError::NoDisplay { .. }) => {}
                Err(error) => self.shared.notes.once(Subject::Refused, || format!("live:{name}: {error}")),
            }
        }
        self.publish();
    }

    /// Publishes the eyes that have displays.
    fn publish(&self) {
        let mut edges = [None; 2];
        for Output { eye, connection, .. } in &self.outputs {
            let there = connection.as_ref().map(|there| frustum(&there.application).edges());
            edges[*eye] = edges[*eye].or(there);
        }
        let eyes = u32::from(edges[0].is_some()) | u32::from(edges[1].is_some()) << 1;
        *self.shared.edges.lock().unwrap_or_else(PoisonError::into_inner) = edges;
        self.shared.eyes.store(eyes, Ordering::Relaxed);
    }

    /// Sends a frame to all displays. Returns true if at least one took it.
    fn send(&mut self, frame: &Frame) -> bool {
        let pieces = frame.eyes.iter().flatten().flatten().flat_map(|layer| {
            let depth = if let Place::View { depth: Some((piece, _)), .. } = &layer.place { Some(piece) } else { None };
            std::iter::once(&layer.color).chain(depth)
        });
        if !pieces.into_iter().all(|piece| piece.captured.wait(COPY_TIMEOUT)) {
            self.shared
                .notes
                .once(Subject::Vulkan, || "the copy of a frame did not end. The last picture stays".into());
            return false;
        }
        let (mut sent, mut left) = (false, false);
        for Output { name, eye, connection } in &mut self.outputs {
            let (Some(there), Some(layers)) = (connection.as_mut(), &frame.eyes[*eye]) else { continue };
            if !there.application.is_connected() {
                gone(connection, name);
                left = true;
                continue;
            }
            match there.send(layers, frame.shows_ns, &self.shared.notes) {
                Ok(()) => sent = true,
                Err(error) => self.shared.notes.once(Subject::Refused, || format!("live:{name}: {error}")),
            }
        }
        if left {
            self.publish();
        }
        sent
    }
}

fn gone(connection: &mut Option<Connection>, name: &str) {
    say(&format!("the display live:{name} is gone"));
    *connection = None;
}
