//! Keeping what was shown, on a thread of its own: the display does not wait for the disk.

use crate::Failure;
use eyebox::playback::{Cause, Moment, PlaybackError, Recorder};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// A moment on its way to the disk.
struct Kept {
    vblank: u64,
    predicted_display_time_ns: i64,
    index: Option<u64>,
    video_frame: u64,
    new: bool,
    late: Option<Cause>,
    picture: Vec<u8>,
}

/// Pictures that wait for the disk.
const WAITING: usize = 16;

/// Records on its thread.
pub struct Record {
    send: SyncSender<Kept>,
    free: Receiver<Vec<u8>>,
    thread: JoinHandle<Result<(), PlaybackError>>,
    left_out: u64,
}

impl Record {
    /// Into a new or an empty folder: pictures of (rows, columns, channels).
    pub fn start(folder: &Path, size: [usize; 3]) -> Result<Self, Failure> {
        let mut recorder = Recorder::new(folder, size)?;
        let (send, receive) = sync_channel::<Kept>(WAITING);
        let (back, free) = sync_channel(WAITING);
        (0..WAITING).for_each(|_| drop(back.send(vec![0; size.iter().product()])));
        let thread = std::thread::Builder::new()
            .name("eyebox records".into())
            .spawn(move || {
                for kept in receive {
                    recorder.add(&Moment {
                        vblank: kept.vblank,
                        predicted_display_time_ns: kept.predicted_display_time_ns,
                        index: kept.index,
                        video_frame: kept.video_frame,
                        new: kept.new,
                        late: kept.late,
                        picture: &kept.picture,
                    })?;
                    let _ = back.try_send(kept.picture);
                }
                recorder.finish()
            })
            .map_err(|e| Failure::Asked(format!("no thread to record with: {e}")))?;
        Ok(Self { send, free, thread, left_out: 0 })
    }

    /// Keeps a moment, unless the disk is behind.
    pub fn add(&mut self, moment: &Moment<'_>) {
        let Ok(mut picture) = self.free.try_recv() else {
            self.left_out += 1;
            return;
        };
        picture.copy_from_slice(moment.picture);
        let Moment { vblank, predicted_display_time_ns, index, video_frame, new, late, .. } = *moment;
        let kept = Kept { vblank, predicted_display_time_ns, index, video_frame, new, late, picture };
        // There is a place for every buffer.
        if self.send.try_send(kept).is_err() {
            self.left_out += 1;
        }
    }

    /// Brings all to the disk: how many moments were not kept.
    pub fn finish(self) -> Result<u64, Failure> {
        drop(self.send);
        match self.thread.join() {
            Ok(done) => done?,
            Err(_) => return Err(Failure::Asked("the recording's thread ended by a fault of its own".into())),
        }
        Ok(self.left_out)
    }
}
