//! Records each video frame of every new set as a picture, and a line for every video frame.
//!
//! In real time it has a thread of its own, so that the display does not wait for the disk.

use crate::files::{FileError, encode_png8, write_file};
use crate::mailbox::Mailbox;
use crate::session::frame_log::account::Cause;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::threads::spawn;
use crate::session::playback::player::PresentedFrame;
use eyebox_base::reason;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Duration;

/// A folder with `shown.csv` and `set-INDEX-VIDEOFRAME.png`.
pub(crate) struct Recorder {
    folder: PathBuf,
    list: BufWriter<File>,
    size: [usize; 3],
}

impl Recorder {
    /// Creates the folder, which must be new or empty, for pictures of (rows, columns, channels).
    fn new(folder: &Path, size: [usize; 3]) -> Result<Self, FileError> {
        fs::create_dir_all(folder).map_err(|e| FileError::write(folder, e))?;
        let mut entries = fs::read_dir(folder).map_err(|e| FileError::read(folder, e))?;
        if entries.next().is_some() {
            let reason = reason!("not-empty", "is not empty, but a recording needs a new or an empty folder");
            return Err(FileError::Taken { path: folder.display().to_string(), reason });
        }
        let file = folder.join("shown.csv");
        let mut list = BufWriter::new(File::create(&file).map_err(|e| FileError::write(&file, e))?);
        writeln!(list, "video_frame,display_time_ns,set,video_frame_of_set,new,late_because,picture")
            .map_err(|e| FileError::write(&file, e))?;
        Ok(Self { folder: folder.to_path_buf(), list, size })
    }

    /// Returns the name of a picture, of the idle picture or of a frame of the file.
    fn picture_name(index: Option<u64>, video_frame: u64) -> String {
        match index {
            Some(index) => format!("set-{index:06}-{video_frame:02}.png"),
            None => format!("idle-{video_frame:02}.png"),
        }
    }

    fn add(&mut self, frame: &PresentedFrame<'_>) -> Result<(), SessionError> {
        let name = Self::picture_name(frame.index, frame.video_frame);
        let picture = self.folder.join(&name);
        let set = frame.index.map(|i| i.to_string()).unwrap_or_default();
        let late = frame.late.map_or("", Cause::name);
        let PresentedFrame { vblank, predicted_display_time_ns: time, video_frame, new, .. } = *frame;
        writeln!(self.list, "{vblank},{time},{set},{video_frame},{},{late},{name}", u8::from(new))
            .map_err(|e| FileError::write(&self.folder.join("shown.csv"), e))?;
        if !picture.exists() {
            let [height, width, channels] = self.size;
            write_file(&picture, |out| encode_png8(out, height, width, channels, frame.picture))?;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<(), SessionError> {
        let file = self.folder.join("shown.csv");
        self.list.flush().and_then(|()| self.list.get_ref().sync_all()).map_err(|e| FileError::write(&file, e))?;
        Ok(())
    }
}

/// The number of pictures that can wait for the disk.
const WAITING: usize = 16;
/// The interval at which the thread checks for its end.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// A video frame on its way to the disk, as the frame without its picture, and the picture.
type RecordedFrame = (PresentedFrame<'static>, Vec<u8>);

pub(crate) enum Recording {
    /// On a simulated clock, every video frame is written as it is shown.
    Inline(Box<Recorder>),
    /// On a real clock, as many video frames are written as the disk allows.
    Behind {
        send: Mailbox<RecordedFrame>,
        free: Mailbox<Vec<u8>>,
        thread: JoinHandle<Result<(), SessionError>>,
        left_out: u64,
    },
}

impl Recording {
    /// Starts a recording in a new or empty folder, with pictures of (rows, columns, channels).
    pub(crate) fn start(folder: &Path, size: [usize; 3], simulated: bool) -> Result<Self, SessionError> {
        let mut recorder = Recorder::new(folder, size)?;
        if simulated {
            return Ok(Self::Inline(Box::new(recorder)));
        }
        let (send, free) = (Mailbox::<RecordedFrame>::new(WAITING), Mailbox::new(WAITING));
        (0..WAITING).for_each(|_| drop(free.put(vec![0; size.iter().product()])));
        let (receive, back) = (send.clone(), free.clone());
        let run = move || {
            loop {
                match receive.take_within(POLL_INTERVAL) {
                    Some((frame, picture)) => {
                        recorder.add(&PresentedFrame { picture: &picture, ..frame })?;
                        let _ = back.put(picture);
                    }
                    None if receive.is_alone() => return recorder.finish(),
                    None => {}
                }
            }
        };
        Ok(Self::Behind { send, free, thread: spawn("records", run)?, left_out: 0 })
    }

    pub(crate) fn add(&mut self, frame: &PresentedFrame<'_>) -> Result<(), SessionError> {
        match self {
            Self::Inline(recorder) => recorder.add(frame)?,
            Self::Behind { send, free, left_out, .. } => match free.take() {
                Some(mut picture) => {
                    picture.copy_from_slice(frame.picture);
                    // The mailbox has a place for every buffer.
                    let _ = send.put((PresentedFrame { picture: &[], ..*frame }, picture));
                }
                None => *left_out += 1,
            },
        }
        Ok(())
    }

    /// Writes everything to the disk. Returns the number of video frames that were skipped.
    pub(crate) fn finish(self) -> Result<u64, SessionError> {
        match self {
            Self::Inline(recorder) => recorder.finish().map(|()| 0),
            Self::Behind { send, thread, left_out, .. } => {
                drop(send);
                let failed = || SessionError::Thread { what: "records", reason: "failed".into() };
                thread.join().map_err(|_| failed())??;
                Ok(left_out)
            }
        }
    }
}
