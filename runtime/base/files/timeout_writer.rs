//! Writes to pipes and devices as long as a reader takes the data.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Time that a pipe may take no data, or wait for its reader.
const PIPE_TIMEOUT: Duration = Duration::from_secs(5);
/// Time that replaces `PIPE_TIMEOUT` after the program was requested to end.
const TO_END: Duration = Duration::from_secs(1);
/// Pause between two attempts.
const PAUSE: Duration = Duration::from_millis(1);

/// Returns the flag that requests the end of the program. A program that catches Ctrl-C sets it. A pipe that takes no
/// data is then given up after one second instead of five.
pub fn asked_to_end() -> &'static Arc<AtomicBool> {
    static ASKED: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    ASKED.get_or_init(Arc::default)
}

/// A file, or a pipe that is given up if it takes no data for `PIPE_TIMEOUT`.
#[derive(Debug)]
pub struct TimeoutWriter(File);

impl TimeoutWriter {
    /// Wraps an open file. A pipe must be open in non-blocking mode.
    pub fn new(file: File) -> Self {
        Self(file)
    }

    /// Opens a pipe or a device that exists.
    ///
    /// # Errors
    /// Returns the errors of the system, and [`ErrorKind::TimedOut`] for a pipe that nobody reads.
    pub fn open(file: &Path) -> io::Result<Self> {
        let mut options = File::options();
        options.write(true);
        #[cfg(unix)]
        {
            std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, rustix::fs::OFlags::NONBLOCK.bits() as i32);
            // A non-blocking open of a pipe without a reader for writing fails with this error.
            let no_reader = Some(rustix::io::Errno::NXIO.raw_os_error());
            Self::wait(|| options.open(file), |e| e.raw_os_error() == no_reader).map(Self)
        }
        #[cfg(not(unix))]
        options.open(file).map(Self)
    }

    fn wait<T>(mut attempt: impl FnMut() -> io::Result<T>, waits: impl Fn(&io::Error) -> bool) -> io::Result<T> {
        let begun = Instant::now();
        loop {
            let patience = if asked_to_end().load(Ordering::Relaxed) { TO_END } else { PIPE_TIMEOUT };
            match attempt() {
                Err(e) if waits(&e) && begun.elapsed() < patience => sleep(PAUSE),
                Err(e) if waits(&e) => {
                    let why = format!("nobody reads it: it took no data for {} s", patience.as_secs());
                    return Err(io::Error::new(ErrorKind::TimedOut, why));
                }
                other => return other,
            }
        }
    }
}

impl Write for TimeoutWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Self::wait(|| self.0.write(bytes), |e| e.kind() == ErrorKind::WouldBlock)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}
