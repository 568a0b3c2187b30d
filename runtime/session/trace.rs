//! What each thread did when, in the format of Chrome's tracing (`chrome://tracing`, Perfetto).

use super::error::SessionError;
use crate::files::write_file;
use serde_json::json;
use std::path::Path;
use std::time::Instant;

#[derive(Debug, Clone, Copy)]
struct Span {
    name: &'static str,
    position: u64,
    start_ns: u64,
    duration_ns: u64,
}

/// Hands out tracks of one beginning.
#[derive(Debug, Clone, Copy)]
pub struct Trace {
    origin: Instant,
    spans: usize,
}

impl Trace {
    /// Lanes that keep so many spans each; none for 0.
    pub fn new(spans: usize) -> Self {
        Self { origin: Instant::now(), spans }
    }

    /// A track for a thread.
    pub(crate) fn track(&self, name: &'static str) -> Track {
        Track { name, origin: self.origin, spans: Vec::with_capacity(self.spans), lost: 0 }
    }

    /// Writes tracks to a file.
    ///
    /// # Errors
    /// [`SessionError::File`].
    pub fn write(file: &Path, tracks: &[Track]) -> Result<(), SessionError> {
        let micros = |ns: u64| ns as f64 / 1000.0;
        write_file(file, |out| {
            write!(out, "{{\"displayTimeUnit\":\"ms\",\"traceEvents\":[")?;
            let mut comma = "";
            for (thread, track) in tracks.iter().enumerate() {
                let name = json!({
                    "name": "thread_name", "ph": "M", "pid": 1, "tid": thread, "args": { "name": track.name, "lost": track.lost },
                });
                write!(out, "{comma}\n{name}")?;
                comma = ",";
                for span in &track.spans {
                    let event = json!({
                        "name": span.name, "cat": "playback", "ph": "X", "pid": 1, "tid": thread,
                        "ts": micros(span.start_ns), "dur": micros(span.duration_ns), "args": { "frame": span.position },
                    });
                    write!(out, ",\n{event}")?;
                }
            }
            writeln!(out, "\n]}}")
        })?;
        Ok(())
    }
}

/// The spans of one thread, in a buffer that is made once: when it is full, further ones are only counted.
#[derive(Debug)]
pub struct Track {
    name: &'static str,
    origin: Instant,
    spans: Vec<Span>,
    lost: u64,
}

impl Track {
    /// Something that began at `start` and ends now, for a content frame by its number.
    pub fn span(&mut self, name: &'static str, position: u64, start: Instant) {
        if self.spans.capacity() == 0 {
            return;
        }
        if self.spans.len() == self.spans.capacity() {
            self.lost += 1;
            return;
        }
        let nanoseconds = |d: std::time::Duration| u64::try_from(d.as_nanos()).unwrap_or(u64::MAX);
        let start_ns = nanoseconds(start.saturating_duration_since(self.origin));
        self.spans.push(Span { name, position, start_ns, duration_ns: nanoseconds(start.elapsed()) });
    }
}
