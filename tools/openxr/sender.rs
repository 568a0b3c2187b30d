//! The thread that waits for copies, composes pictures and sends them, so that the application waits for none of it.

use crate::layers::{Frame, Place};
use crate::notes::{Notes, Subject, say};
use crate::output::{Connection, Unsent, Unshared};
use crate::vulkan::Room;
use crate::vulkan::own::{Fault, Own};
use eyebox_live_input::{Application, DeviceIds, LiveError};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The time between two attempts to connect to a display.
const RETRY: Duration = Duration::from_millis(250);
/// The longest time that a copy may take.
const COPY_TIMEOUT: Duration = Duration::from_secs(5);

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
    /// True if copies should stay on the device.
    on_device: AtomicBool,
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
    /// `live:NAME-right`, as far as displays listen there. `ours` is the device of the images, if it shares memory.
    ///
    /// # Errors
    /// Returns the error of the system if no thread can be made.
    pub fn start(name: &str, ours: Option<DeviceIds>, notes: Arc<Notes>) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            mail: Mutex::default(),
            arrived: Condvar::new(),
            eyes: AtomicU32::new(0),
            on_device: AtomicBool::new(false),
            edges: Mutex::default(),
            notes,
        });
        let outputs = [(name.to_owned(), 0), (format!("{name}-left"), 0), (format!("{name}-right"), 1)];
        let outputs = outputs.map(|(name, eye)| Output { name, eye, connection: None }).into();
        let its = shared.clone();
        let thread = std::thread::Builder::new()
            .name("eyebox openxr".into())
            .spawn(move || Worker { shared: its, outputs, ours, own: None }.run())?;
        Ok(Self { shared, thread: Mutex::new(Some(thread)) })
    }

    /// Returns for each eye whether a display shows it.
    pub fn eyes(&self) -> [bool; 2] {
        let eyes = self.shared.eyes.load(Ordering::Relaxed);
        [eyes & 1 == 1, eyes & 2 == 2]
    }

    /// Returns the memory for copies.
    pub fn room(&self) -> Room {
        if self.shared.on_device.load(Ordering::Relaxed) { Room::Device } else { Room::Host }
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

struct Worker {
    shared: Arc<Shared>,
    outputs: Vec<Output>,
    /// The device of the application's images, if it shares memory and the layer's own device did not fail.
    ours: Option<DeviceIds>,
    /// The layer's own device, after the first display that shares memory.
    own: Option<Arc<Own>>,
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
        for Output { name, connection, .. } in &mut self.outputs {
            if connection.as_ref().is_some_and(|there| !there.application.is_connected()) {
                gone(connection, name);
            }
            if connection.is_some() {
                continue;
            }
            match Application::connect(name) {
                Ok(application) => {
                    let [rows, columns] = application.offer().size;
                    let mut there = Connection::new(application);
                    let shared = there.share(self.ours, self.own.as_ref());
                    if let Err(Unshared::Live(LiveError::Gone)) = shared {
                        continue;
                    }
                    let place = if let Ok(Some(_)) = shared { " on the device" } else { "" };
                    say(&format!("live:{name} takes frames of {rows} x {columns} pixels{place}"));
                    match shared {
                        Ok(own) => self.own = own.or(self.own.take()),
                        Err(reason) => {
                            let line = || format!("the frames of live:{name} pass through the host, because {reason}");
                            self.shared.notes.once(Subject::Device, line);
                        }
                    }
                    self.shared.on_device.store(self.own.is_some(), Ordering::Relaxed);
                    *connection = Some(there);
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
            let there = connection.as_ref().map(Connection::edges);
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
        let (mut sent, mut left, mut failed) = (false, false, None);
        for Output { name, eye, connection } in &mut self.outputs {
            let (Some(there), Some(layers)) = (connection.as_mut(), &frame.eyes[*eye]) else { continue };
            if !there.application.is_connected() {
                gone(connection, name);
                left = true;
                continue;
            }
            match there.send(layers, frame.shows_ns, self.own.as_ref().filter(|_| failed.is_none()), &self.shared.notes)
            {
                Ok(done) => sent |= done,
                Err(Unsent::Live(error)) => {
                    self.shared.notes.once(Subject::Refused, || format!("live:{name}: {error}"));
                }
                Err(Unsent::Device(fault)) => failed = Some(fault),
            }
        }
        if let Some(fault) = failed {
            self.leave_device(fault);
        }
        if left {
            self.publish();
        }
        sent
    }

    /// Composes on the host from now on, because the layer's device failed.
    fn leave_device(&mut self, fault: Fault) {
        let line = || format!("the layer's device failed ({fault}). Frames pass through the host");
        self.shared.notes.once(Subject::DeviceFailed, line);
        self.shared.on_device.store(false, Ordering::Relaxed);
        self.outputs.iter_mut().filter_map(|output| output.connection.as_mut()).for_each(Connection::leave_device);
        (self.ours, self.own) = (None, None);
    }
}

fn gone(connection: &mut Option<Connection>, name: &str) {
    say(&format!("the display live:{name} is gone"));
    *connection = None;
}
