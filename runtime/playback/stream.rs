//! Reading ahead and encoding ahead, on two threads, through rings of buffers that are made once.
//!
//! The reader fills phase buffers from the file, checked; the encoder turns them into video frames; the present thread
//! takes those without ever waiting, and gives the buffers back. In the steady state nothing is allocated. A reader that
//! is late leaves out what is no longer of use, so that it catches up.

use super::player::Source;
use super::ring::Ring;
use super::scheduler::{Content, Readiness};
use super::{Lane, Marks, PlaybackError, Trace, mark_corner};
use crate::encode::{Encoder, PhaseSet, VideoFrames};
use crate::engine::EngineError;
use crate::engine::vulkan::{Options as VulkanOptions, VulkanEncoder};
use crate::hologram::Sequence;
use crossbeam_channel::{Receiver, Sender, unbounded};
use std::collections::{BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How a stream is made.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Sets that wait encoded, beside the one on the screen; at least 2.
    pub ahead: usize,
    /// Whether the file begins again when it is over.
    pub looped: bool,
    /// Whether to wait for a sequence that is still being written.
    pub follow: bool,
    /// The frame of the file to begin with.
    pub first: u64,
    /// Threads that encode on the CPU; 0 for as many as there are cores.
    pub threads: usize,
    /// A corner mark.
    pub marks: Marks,
    /// Traces what the threads do.
    pub trace: Trace,
}

/// What encodes.
pub enum StreamEncoder {
    /// All cores of the CPU.
    Cpu(Encoder),
    /// A Vulkan device; the CPU, which gives the same bytes, once that is lost.
    Vulkan(Encoder, VulkanOptions),
}

/// How often a thread that waits looks whether it is to stop.
const PATIENCE: Duration = Duration::from_millis(20);
/// Holograms under way between file and encoder.
const PHASES: usize = 3;

/// A position of an epoch: positions begin anew with every seek, and what belongs to an older epoch means nothing.
const EPOCH_SHIFT: u32 = 48;

fn tagged(epoch: u64, position: u64) -> u64 {
    (epoch << EPOCH_SHIFT) | position.min((1 << EPOCH_SHIFT) - 1)
}

fn of_epoch(value: u64, epoch: u64) -> Option<u64> {
    (value >> EPOCH_SHIFT == epoch & 0xffff).then_some(value & ((1 << EPOCH_SHIFT) - 1))
}

struct Shared {
    stop: AtomicBool,
    epoch: AtomicU64,
    seek_to: AtomicU64,
    /// Positions read, useful, and the end; each with its epoch.
    read: AtomicU64,
    useful: AtomicU64,
    end: AtomicU64,
    failure: Mutex<Option<PlaybackError>>,
}

impl Shared {
    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    fn fail(&self, error: PlaybackError) {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        self.stop.store(true, Ordering::Release);
    }
}

struct Phases {
    epoch: u64,
    position: u64,
    index: u64,
    damaged: bool,
    values: Vec<f32>,
}

struct Encoded {
    epoch: u64,
    position: u64,
    index: u64,
    frames: Option<VideoFrames>,
}

/// A file under way to the display.
pub struct Stream {
    shared: Arc<Shared>,
    epoch: u64,
    arriving: Ring<Encoded>,
    free: Ring<VideoFrames>,
    messages: Receiver<String>,
    validation: Option<Arc<Mutex<Vec<String>>>>,
    ready: VecDeque<Encoded>,
    on_screen: Option<(VideoFrames, u64)>,
    threads: Vec<JoinHandle<Lane>>,
}

impl Stream {
    /// Starts reading and encoding.
    ///
    /// # Errors
    /// [`PlaybackError::Encode`] where the holograms do not have the encoder's shape; [`PlaybackError::Engine`] where the
    /// Vulkan device cannot be had; [`PlaybackError::Thread`].
    pub fn start(sequence: Sequence, encoder: StreamEncoder, options: Options) -> Result<Self, PlaybackError> {
        match encoder {
            StreamEncoder::Cpu(encoder) => Self::with(sequence, encoder, None, options),
            StreamEncoder::Vulkan(encoder, device) => {
                let device = VulkanEncoder::open(&device, encoder.plan())?;
                Self::with(sequence, encoder, Some(device), options)
            }
        }
    }

    /// With a device that encodes as long as it is there.
    pub(super) fn with(
        sequence: Sequence,
        encoder: Encoder,
        device: Option<VulkanEncoder>,
        options: Options,
    ) -> Result<Self, PlaybackError> {
        let ahead = options.ahead.clamp(2, 64);
        let shape = sequence.shape();
        let validation = device.as_ref().map(VulkanEncoder::messages);
        let mut probe = encoder.frames();
        {
            // A shape that does not fit is refused here, not on a thread.
            let each = shape[1] * shape[2] * shape[3];
            let zeros = vec![0.0; each];
            let colors: Vec<&[f32]> = vec![&zeros; shape[0]];
            encoder.check(&PhaseSet::trusted(&colors), &probe)?;
        }
        let shared = Arc::new(Shared {
            stop: AtomicBool::new(false),
            epoch: AtomicU64::new(0),
            seek_to: AtomicU64::new(options.first),
            read: AtomicU64::new(0),
            useful: AtomicU64::new(0),
            end: AtomicU64::new(u64::MAX),
            failure: Mutex::new(None),
        });
        let free_phases = Ring::new(PHASES);
        for _ in 0..PHASES {
            let _ = free_phases.put(vec![0.0; sequence.values()]);
        }
        // One more waits to be exchanged for the one on the screen.
        let free = Ring::new(ahead + 2);
        for _ in 0..ahead + 1 {
            let _ = free.put(std::mem::replace(&mut probe, encoder.frames()));
        }
        let _ = free.put(probe);
        let (to_encode, arriving) = (Ring::new(PHASES - 1), Ring::new(ahead + 2));
        let (tell, messages) = unbounded();
        let (lane, state) = (options.trace.lane("read"), Arc::clone(&shared));
        let reader = Reader {
            sequence,
            options,
            shared: state,
            free: free_phases.clone(),
            out: to_encode.clone(),
            tell: tell.clone(),
            lane,
        };
        let read = spawn("reads holograms", move || reader.run())?;
        let (lane, state) = (options.trace.lane("encode"), Arc::clone(&shared));
        let encoding = Encoding {
            shape,
            marks: options.marks,
            shared: state,
            encode: to_encode,
            free_phases,
            free_frames: free.clone(),
            out: arriving.clone(),
            tell,
            lane,
        };
        let threads = options.threads;
        let encode = spawn("encodes", move || encoding.start(&encoder, device, threads))?;
        let ready = VecDeque::with_capacity(2 * ahead + 8);
        let threads = vec![read, encode];
        Ok(Self { shared, epoch: 0, arriving, free, messages, validation, ready, on_screen: None, threads })
    }

    /// What the validation layer says of the device that encodes, to the last; none where the CPU does.
    pub fn validation(&self) -> Option<Arc<Mutex<Vec<String>>>> {
        self.validation.clone()
    }

    /// Ends the threads: what they did.
    pub fn stop(mut self) -> Vec<Lane> {
        self.shared.stop.store(true, Ordering::Release);
        self.threads.drain(..).filter_map(|t| t.join().ok()).collect()
    }

    fn take(&mut self, item: Encoded) {
        if item.epoch == self.epoch {
            self.ready.push_back(item);
        } else {
            self.give_back(item.frames);
        }
    }

    fn give_back(&self, frames: Option<VideoFrames>) {
        if let Some(frames) = frames {
            // There is room for all of them.
            let _ = self.free.put(frames);
        }
    }

    fn failure(&self) -> Result<(), PlaybackError> {
        // A thread that ended though nobody stopped it died.
        if !self.shared.stopped() && !self.threads.iter().any(JoinHandle::is_finished) {
            return Ok(());
        }
        let failure = self.shared.failure.lock().unwrap_or_else(PoisonError::into_inner).take();
        Err(failure.unwrap_or(PlaybackError::Thread { what: "reads and encodes", reason: "has ended".into() }))
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        self.threads.drain(..).for_each(|t| drop(t.join()));
    }
}

impl Content for Stream {
    fn readiness(&self, position: u64) -> Readiness {
        match self.ready.iter().find(|e| e.position == position) {
            Some(Encoded { frames: Some(_), .. }) => Readiness::Ready,
            Some(_) => Readiness::Damaged,
            None if of_epoch(self.shared.read.load(Ordering::Acquire), self.epoch).is_some_and(|r| position < r) => {
                Readiness::Read
            }
            None => Readiness::Unread,
        }
    }

    fn end(&self) -> Option<u64> {
        let end = self.shared.end.load(Ordering::Acquire);
        if end == u64::MAX { None } else { of_epoch(end, self.epoch) }
    }
}

impl Source for Stream {
    fn poll(&mut self, useful_from: u64) -> Result<(), PlaybackError> {
        self.shared.useful.store(tagged(self.epoch, useful_from), Ordering::Release);
        while self.ready.len() < self.ready.capacity() {
            let Some(item) = self.arriving.take() else { break };
            self.take(item);
        }
        // Of what is too old, the newest may still be shown when nothing newer comes.
        while self.ready.get(1).is_some_and(|second| second.position < useful_from) {
            if let Some(old) = self.ready.pop_front() {
                self.give_back(old.frames);
            }
        }
        self.failure()
    }

    fn settle(&mut self, position: u64) -> Result<(), PlaybackError> {
        loop {
            self.poll(position)?;
            let known = matches!(self.readiness(position), Readiness::Ready | Readiness::Damaged);
            let newer = self.ready.back().is_some_and(|e| e.position > position);
            if known || newer || self.end().is_some_and(|end| position >= end) {
                return Ok(());
            }
            if let Some(item) = self.arriving.take_within(PATIENCE) {
                self.take(item);
            }
        }
    }

    fn show(&mut self, position: u64) {
        while let Some(item) = self.ready.pop_front() {
            if item.position == position {
                let index = item.index;
                if let Some(frames) = item.frames {
                    let before = self.on_screen.replace((frames, index));
                    self.give_back(before.map(|b| b.0));
                }
                return;
            }
            self.give_back(item.frames);
        }
    }

    fn on_screen(&self) -> Option<(&VideoFrames, u64)> {
        self.on_screen.as_ref().map(|(frames, index)| (frames, *index))
    }

    fn seek(&mut self, index: u64) {
        while let Some(item) = self.ready.pop_front() {
            self.give_back(item.frames);
        }
        self.epoch = (self.epoch + 1) & 0xffff;
        self.shared.seek_to.store(index, Ordering::Release);
        self.shared.epoch.store(self.epoch, Ordering::Release);
    }

    fn message(&mut self) -> Option<String> {
        self.messages.try_recv().ok()
    }
}

/// Has every thread of the pool take work from another once: what that needs is made the first time, which on a busy
/// machine may be long after the first picture.
fn meet() {
    let all = std::sync::Barrier::new(rayon::current_num_threads());
    let wait = || {
        all.wait();
    };
    rayon::scope(|scope| (0..rayon::current_num_threads()).for_each(|_| scope.spawn(|_| wait())));
}

fn spawn(what: &'static str, run: impl FnOnce() -> Lane + Send + 'static) -> Result<JoinHandle<Lane>, PlaybackError> {
    std::thread::Builder::new()
        .name(format!("eyebox {what}"))
        .spawn(run)
        .map_err(|e| PlaybackError::Thread { what, reason: format!("could not be started ({e})") })
}

struct Reader {
    sequence: Sequence,
    options: Options,
    shared: Arc<Shared>,
    free: Ring<Vec<f32>>,
    out: Ring<Phases>,
    tell: Sender<String>,
    lane: Lane,
}

impl Reader {
    fn run(mut self) -> Lane {
        let (mut epoch, mut position) = (0, 0u64);
        let mut index = self.options.first;
        let mut told = BTreeSet::new();
        let mut held: Option<Vec<f32>> = None;
        let mut said_end = false;
        while !self.shared.stopped() {
            let now = self.shared.epoch.load(Ordering::Acquire);
            if now != epoch {
                (epoch, position, index) = (now, 0, self.shared.seek_to.load(Ordering::Acquire));
            }
            let useful = of_epoch(self.shared.useful.load(Ordering::Acquire), epoch).unwrap_or(0);
            if useful > position {
                index = index.saturating_add(useful - position);
                position = useful;
            }
            let mut count = self.sequence.count();
            if index >= count {
                count = self.sequence.refresh();
            }
            if index >= count {
                let waits = self.options.follow && !self.sequence.is_complete();
                if self.options.looped && count > 0 && !waits {
                    index %= count;
                } else {
                    if !waits && self.shared.end.load(Ordering::Acquire) != tagged(epoch, position) {
                        // Those that were left out were not there: the end is the file's.
                        let end = position - (index - count).min(position);
                        // Said before it is known, and so before anybody stops listening.
                        said_end = said_end || self.say_where_it_ends();
                        self.shared.end.store(tagged(epoch, end), Ordering::Release);
                    }
                    std::thread::sleep(PATIENCE / 4);
                    continue;
                }
            }
            let Some(mut values) = held.take().or_else(|| self.free.take_within(PATIENCE)) else { continue };
            if self.shared.epoch.load(Ordering::Acquire) != epoch {
                held = Some(values);
                continue;
            }
            let start = Instant::now();
            let read = self.sequence.read_into(index, &mut values);
            self.lane.span("decode", index, start);
            let damaged = read.is_err();
            if let Some(error) = read.err().filter(|_| told.insert(index)) {
                let _ = self.tell.send(format!("hologram {index} is left out: {error}"));
            }
            self.shared.read.store(tagged(epoch, position + 1), Ordering::Release);
            let mut item = Phases { epoch, position, index, damaged, values };
            while let Err(back) = self.out.put_within(item, PATIENCE) {
                if self.shared.stopped() {
                    break;
                }
                item = back;
            }
            (position, index) = (position + 1, index + 1);
        }
        self.lane
    }

    fn say_where_it_ends(&mut self) -> bool {
        if !self.sequence.is_complete() {
            let (path, count) = (self.sequence.path().display(), self.sequence.count());
            let of = self.sequence.planned().map(|n| format!(" of {n}")).unwrap_or_default();
            let _ = self.tell.send(format!("{path}: it is unfinished and ends after {count}{of} holograms"));
        }
        true
    }
}

struct Encoding {
    shape: [usize; 4],
    marks: Marks,
    shared: Arc<Shared>,
    encode: Ring<Phases>,
    free_phases: Ring<Vec<f32>>,
    free_frames: Ring<VideoFrames>,
    out: Ring<Encoded>,
    tell: Sender<String>,
    lane: Lane,
}

impl Encoding {
    fn start(mut self, encoder: &Encoder, mut device: Option<VulkanEncoder>, threads: usize) -> Lane {
        let tell = self.tell.clone();
        let encode = |colors: &[&[f32]], frames: &mut VideoFrames| {
            match device.as_mut().map(|device| device.encode(colors, frames.bytes_mut())) {
                Some(Ok(())) => return Ok(()),
                Some(Err(EngineError::DeviceLost { device: name, during })) => {
                    device = None;
                    let _ = tell.send(format!("{name} was lost while it ran {during}: the CPU encodes from here on"));
                }
                Some(Err(error)) => return Err(error.into()),
                None => {}
            }
            Ok(encoder.encode_into(&PhaseSet::trusted(colors), frames)?)
        };
        let failed = match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            // On a thread of the pool: calls from outside would allocate.
            Ok(pool) => pool.install(|| {
                meet();
                self.run(encode)
            }),
            Err(e) => Err(PlaybackError::Thread { what: "encodes", reason: format!("could not be started ({e})") }),
        };
        if let Err(error) = failed {
            self.shared.fail(error);
        }
        self.lane
    }

    fn run(
        &mut self,
        mut encode: impl FnMut(&[&[f32]], &mut VideoFrames) -> Result<(), PlaybackError>,
    ) -> Result<(), PlaybackError> {
        let each = self.shape[1] * self.shape[2] * self.shape[3];
        while !self.shared.stopped() {
            let Some(mut item) = self.encode.take_within(PATIENCE) else { continue };
            let epoch = self.shared.epoch.load(Ordering::Acquire);
            let useful = of_epoch(self.shared.useful.load(Ordering::Acquire), epoch).unwrap_or(0);
            // What comes too late is left out if something newer waits.
            let useless = item.epoch != epoch || (item.position < useful && !self.encode.is_empty());
            let mut frames = None;
            if !useless && !item.damaged {
                frames = self.wait_for_frames();
                let Some(frames) = &mut frames else { break };
                let start = Instant::now();
                mark_corner(&mut item.values, self.shape, self.marks, item.position);
                // One to three colours as a rule; never more than fit here.
                let mut colors: [&[f32]; 16] = [&[]; 16];
                let count = self.shape[0].min(colors.len());
                colors.iter_mut().zip(item.values.chunks_exact(each)).for_each(|(c, values)| *c = values);
                encode(&colors[..count], frames)?;
                self.lane.span("encode", item.index, start);
            }
            let Phases { epoch, position, index, values, .. } = item;
            let _ = self.free_phases.put(values);
            if useless {
                continue;
            }
            let mut done = Encoded { epoch, position, index, frames };
            while let Err(back) = self.out.put_within(done, PATIENCE) {
                if self.shared.stopped() {
                    break;
                }
                done = back;
            }
        }
        Ok(())
    }

    fn wait_for_frames(&self) -> Option<VideoFrames> {
        loop {
            match self.free_frames.take_within(PATIENCE) {
                Some(frames) => return Some(frames),
                None if self.shared.stopped() => return None,
                None => {}
            }
        }
    }
}
