//! Pipes and devices that are written to, as long as somebody takes what is written.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// How long a pipe may take nothing, and wait for its reader.
const PIPE_TIMEOUT: Duration = Duration::from_secs(5);
/// The same once the program was asked to end.
const TO_END: Duration = Duration::from_secs(1);
/// How often it is asked again.
const PAUSE: Duration = Duration::from_millis(1);

/// Whether the program was asked to end. A program that catches ctrl-C sets it from there: a pipe that takes nothing is then given
/// up after a second and not after five.
pub fn asked_to_end() -> &'static Arc<AtomicBool> {
    static ASKED: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    ASKED.get_or_init(Arc::default)
}

/// A file, or a pipe that is given up when it takes nothing for `PIPE_TIMEOUT`.
#[derive(Debug)]
pub struct TimeoutWriter(File);

impl TimeoutWriter {
    /// A file; a pipe has to be open so that it does not block.
    pub fn new(file: File) -> Self {
        Self(file)
    }

    /// A pipe or a device that is there.
    ///
    /// # Errors
    /// The system's; [`ErrorKind::TimedOut`] for a pipe that nobody reads.
    pub fn open(file: &Path) -> io::Result<Self> {
        let mut options = File::options();
        options.write(true);
        #[cfg(unix)]
        {
            std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, rustix::fs::OFlags::NONBLOCK.bits() as i32);
            // Opened for writing without waiting, a pipe without a reader is no such device.
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
                    let why = format!("nobody reads it: nothing was taken for {} s", patience.as_secs());
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
