//! Writes the activity of each thread in the format of Chrome's tracing (`chrome://tracing`, Perfetto).
//!
//! A trace is an array of events, one per line, which these tools also read without its end. A thread of its own writes
//! it while it grows.

use crate::encode::Packed;
use crate::files::GrowingFile;
use crate::mailbox::Mailbox;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::threads::{EntryWriter, Moment};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The number of spans that can wait to be written, which is a second of thousands.
const WAITING: usize = 1 << 14;

#[derive(Debug, Clone)]
enum Entry {
    Track { thread: u64, name: String },
    Span { thread: u64, name: &'static str, position: u64, start_ns: u64, duration_ns: u64 },
    Lit { thread: u64, at_ns: u64, lit: Lit },
    Light { thread: u64, at_ns: u64, light: Light },
}

/// A new set of a refined hologram, with times in ns on the clock of the player.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lit {
    /// The number of the set, and the number of the scene that it shows, if scenes follow each other.
    pub set: u64,
    pub content: Option<u64>,
    /// The freshness of the scene.
    pub supply: &'static str,
    /// The time of the newest sample that it follows.
    pub sample_ns: Option<i64>,
    /// The middle of its light.
    pub light_ns: i64,
    /// The steps over all colors, and the estimated PSNR (dB) of the last of them.
    pub steps: u32,
    pub estimated_db: Option<f64>,
}

/// The light of all sub-frames in one video frame of a refined hologram.
#[derive(Debug, Clone)]
pub(crate) struct Light {
    /// The set, with the light of this video frame.
    pub lit: Lit,
    /// The number of the video frame in the set.
    pub video_frame: u64,
    /// The reason why these sub-frames are lit again, or `None` for their first light.
    pub again: Option<&'static str>,
    /// The packing, which gives the sub-frames of a video frame.
    pub packed: Arc<Packed>,
}

/// A source of tracks with a common origin of time.
#[derive(Debug, Clone)]
pub struct Trace {
    origin: Instant,
    out: Option<Mailbox<Option<Entry>>>,
    /// The beginning of the names of all tracks, such as the eye.
    prefix: &'static str,
    tracks: Arc<AtomicU64>,
    /// The number of spans that found no room.
    lost: Arc<AtomicU64>,
}

/// A trace that is being written.
#[derive(Debug)]
pub struct Written {
    trace: Trace,
    writer: EntryWriter<Entry>,
}

impl Trace {
    /// Creates a trace that keeps nothing.
    pub fn none() -> Self {
        Self { origin: Instant::now(), out: None, prefix: "", tracks: Arc::default(), lost: Arc::default() }
    }

    /// Starts a trace that is written to a file until [`Written::finish`].
    ///
    /// # Errors
    /// Returns [`SessionError::File`] or [`SessionError::Thread`].
    pub fn write(file: &Path) -> Result<Written, SessionError> {
        let trace = Self::none();
        let lost = Arc::clone(&trace.lost);
        let writer = EntryWriter::start("traces", WAITING, GrowingFile::new(file)?, move |out, moment| match moment {
            Moment::Begin => out.add(|out| out.write_all(b"[\n")),
            Moment::Entry(entry) => out.add(|out| writeln!(out, "{},", event(entry))),
            Moment::End => {
                let args = json!({ "name": "eyebox", "lost": lost.load(Ordering::Relaxed) });
                let end = json!({ "name": "process_name", "ph": "M", "pid": 1, "args": args });
                out.add(|out| writeln!(out, "{end}\n]"))
            }
        })?;
        Ok(Written { trace: Self { out: Some(writer.entries.clone()), ..trace }, writer })
    }

    /// Returns a trace whose tracks have names that begin with `prefix`.
    #[must_use]
    pub(crate) fn named(&self, prefix: &'static str) -> Self {
        Self { prefix, ..self.clone() }
    }

    /// Creates a track for a thread.
    pub fn track(&self, name: &'static str) -> Track {
        let track = Track { thread: self.tracks.fetch_add(1, Ordering::Relaxed), trace: self.clone() };
        track.put(Entry::Track { thread: track.thread, name: format!("{}{name}", self.prefix) });
        track
    }
}

impl Written {
    /// Returns the source of its tracks.
    pub fn trace(&self) -> Trace {
        self.trace.clone()
    }

    /// Writes the waiting spans and the end.
    ///
    /// # Errors
    /// Returns the first [`SessionError::File`] that occurred. The entries before it are complete.
    pub fn finish(self) -> Result<(), SessionError> {
        self.writer.finish()
    }
}

fn event(entry: Entry) -> Value {
    let micros = |ns: u64| ns as f64 / 1000.0;
    match entry {
        Entry::Track { thread, name } => {
            json!({ "name": "thread_name", "ph": "M", "pid": 1, "tid": thread, "args": { "name": name } })
        }
        Entry::Span { thread, name, position, start_ns, duration_ns } => json!({
            "name": name, "cat": "playback", "ph": "X", "pid": 1, "tid": thread,
            "ts": micros(start_ns), "dur": micros(duration_ns), "args": { "frame": position },
        }),
        Entry::Lit { thread, at_ns, lit } => json!({
            "name": "set", "cat": "playback", "ph": "i", "s": "t", "pid": 1, "tid": thread, "ts": micros(at_ns),
            "args": arguments(&lit),
        }),
        Entry::Light { thread, at_ns, light } => {
            let Light { lit, video_frame, again, packed } = light;
            let mut args = arguments(&lit);
            let held = packed.slots.iter().filter(|slot| slot.video_frame as u64 == video_frame);
            args["video_frame"] = json!(video_frame);
            args["sub_frames"] = held.map(|slot| json!([slot.color, slot.sub_frame])).collect();
            args["again"] = json!(again);
            json!({
                "name": "light", "cat": "playback", "ph": "i", "s": "t", "pid": 1, "tid": thread, "ts": micros(at_ns),
                "args": args,
            })
        }
    }
}

fn arguments(lit: &Lit) -> Value {
    let ms = |ns: i64| ns as f64 * 1e-6;
    json!({
        "set": lit.set, "content_frame": lit.content, "content": lit.supply, "sample_ms": lit.sample_ns.map(ms),
        "light_ms": ms(lit.light_ns), "steps": lit.steps, "estimated_psnr_db": lit.estimated_db,
    })
}

/// The spans of one thread. They wait in a buffer of fixed size. If it is full, further spans are only counted.
#[derive(Debug)]
pub struct Track {
    thread: u64,
    trace: Trace,
}

impl Track {
    /// Records a span that began at `start` and ends now. The number of its content frame is `position`.
    pub fn span(&mut self, name: &'static str, position: u64, start: Instant) {
        let nanoseconds = |d: Duration| u64::try_from(d.as_nanos()).unwrap_or(u64::MAX);
        let start_ns = nanoseconds(start.saturating_duration_since(self.trace.origin));
        let duration_ns = nanoseconds(start.elapsed());
        self.put(Entry::Span { thread: self.thread, name, position, start_ns, duration_ns });
    }

    /// Records that a new set is about to be lit.
    pub(crate) fn lit(&mut self, lit: Lit) {
        self.put(Entry::Lit { thread: self.thread, at_ns: self.now_ns(), lit });
    }

    pub(crate) fn light(&mut self, light: Light) {
        self.put(Entry::Light { thread: self.thread, at_ns: self.now_ns(), light });
    }

    fn now_ns(&self) -> u64 {
        let now = Instant::now().saturating_duration_since(self.trace.origin);
        u64::try_from(now.as_nanos()).unwrap_or(u64::MAX)
    }

    fn put(&self, entry: Entry) {
        if self.trace.out.as_ref().is_some_and(|out| out.put(Some(entry)).is_err()) {
            self.trace.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_readable_while_it_grows_and_whole_at_its_end() {
        let here = tempfile::tempdir().unwrap();
        let file = here.path().join("t.json");
        let written = Trace::write(&file).unwrap();
        let mut track = written.trace().track("read");
        track.span("decode", 7, Instant::now());
        let text = || std::fs::read_to_string(&file).unwrap_or_default();
        let begun = Instant::now();
        while !text().contains("decode") && begun.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(10));
        }
        let now = text();
        let events: Vec<Value> = serde_json::from_str(&format!("{}]", now.trim_end().trim_end_matches(','))).unwrap();
        assert_eq!((events.len(), &events[1]["args"]["frame"]), (2, &json!(7)));
        written.finish().unwrap();
        let events: Vec<Value> = serde_json::from_str(&text()).unwrap();
        assert_eq!((events.len(), &events[2]["args"]["lost"]), (3, &json!(0)));
    }
}
