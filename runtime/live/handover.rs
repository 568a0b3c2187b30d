//! Sets handed over whole: the newest wins, nobody waits, and the buffers go round.

use super::Stamps;
use crate::encode::VideoFrames;
use crate::playback::{Content, PlaybackError, Readiness, Source};
use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use std::time::Instant;

/// A finished set.
#[derive(Debug)]
pub struct Made {
    /// Its number, from 0.
    pub number: u64,
    /// Its video frames.
    pub frames: VideoFrames,
    /// When what happened to it.
    pub stamps: Stamps,
    /// Where the pupil is expected at its light, metres.
    pub pupil: [f64; 2],
    /// Steps that were taken for it, over all colours.
    pub steps: u32,
}

/// Buffers: one on the screen, one ready, one on its way, one being filled.
const BUFFERS: usize = 4;
const MESSAGES: usize = 32;

/// The side that makes sets.
pub struct Giver {
    out: Sender<Made>,
    oldest: Receiver<Made>,
    free: Receiver<VideoFrames>,
    back: Sender<VideoFrames>,
    tell: Sender<String>,
}

/// The side that shows them: a player's source. What is due is always the newest set there is, so nothing is ever late;
/// a set for which nothing new came is shown again.
pub struct LiveSource {
    arriving: Receiver<Made>,
    back: Sender<VideoFrames>,
    messages: Receiver<String>,
    fresh: Option<Made>,
    on_screen: Option<Made>,
    changed: bool,
    asked: Option<Instant>,
    repeats: u64,
    news: u64,
}

/// Both sides, with buffers like `frames`.
pub fn handover(frames: &VideoFrames) -> (Giver, LiveSource) {
    let (out, arriving) = bounded(1);
    let (back, free) = bounded(BUFFERS);
    (0..BUFFERS).for_each(|_| drop(back.send(frames.clone())));
    let (tell, messages) = bounded(MESSAGES);
    let giver = Giver { out, oldest: arriving.clone(), free, back: back.clone(), tell };
    (
        giver,
        LiveSource {
            arriving,
            back,
            messages,
            fresh: None,
            on_screen: None,
            changed: false,
            asked: None,
            repeats: 0,
            news: 0,
        },
    )
}

impl Giver {
    /// A buffer to fill. There is always one: of those that are handed over, one waits at most.
    pub fn buffer(&self) -> Option<VideoFrames> {
        self.free.try_recv().ok()
    }

    /// Hands a set over; one that waits still, and was never shown, makes room.
    pub fn give(&self, made: Made) {
        let mut made = made;
        while let Err(TrySendError::Full(back)) = self.out.try_send(made) {
            if let Ok(old) = self.oldest.try_recv() {
                let _ = self.back.try_send(old.frames);
            }
            made = back;
        }
    }

    /// Tells the user something; what nobody reads is dropped.
    pub fn tell(&self, message: String) {
        let _ = self.tell.try_send(message);
    }

    /// Tells it if the thread that holds this ends in a panic.
    pub(super) fn last_words(&self, message: &'static str) -> LastWords {
        LastWords { tell: self.tell.clone(), message }
    }
}

impl LiveSource {
    /// The set on the screen, if it was not there when this was last asked.
    pub fn newly_shown(&mut self) -> Option<&Made> {
        std::mem::take(&mut self.changed).then_some(self.on_screen.as_ref()).flatten()
    }

    /// When a player last asked what there is: when it decided.
    pub fn asked(&self) -> Option<Instant> {
        self.asked
    }

    /// Sets that were new when they were decided on, and sets that were shown again.
    pub fn counts(&self) -> [u64; 2] {
        [self.news, self.repeats]
    }
}

impl Content for LiveSource {
    fn readiness(&self, _position: u64) -> Readiness {
        if self.fresh.is_some() || self.on_screen.is_some() { Readiness::Ready } else { Readiness::Unread }
    }

    fn end(&self) -> Option<u64> {
        None
    }
}

impl Source for LiveSource {
    fn poll(&mut self, _useful_from: u64) -> Result<(), PlaybackError> {
        self.asked = Some(Instant::now());
        while let Ok(made) = self.arriving.try_recv() {
            if let Some(old) = self.fresh.replace(made) {
                let _ = self.back.try_send(old.frames);
            }
        }
        Ok(())
    }

    fn settle(&mut self, _position: u64) -> Result<(), PlaybackError> {
        self.poll(0)
    }

    fn show(&mut self, _position: u64) {
        let Some(fresh) = self.fresh.take() else {
            self.repeats += 1;
            return;
        };
        self.news += 1;
        self.changed = true;
        if let Some(old) = self.on_screen.replace(fresh) {
            let _ = self.back.try_send(old.frames);
        }
    }

    fn on_screen(&self) -> Option<(&VideoFrames, u64)> {
        self.on_screen.as_ref().map(|made| (&made.frames, made.number))
    }

    fn seek(&mut self, _index: u64) {}

    fn message(&mut self) -> Option<String> {
        self.messages.try_recv().ok()
    }
}

/// Said when its thread panics.
pub(super) struct LastWords {
    tell: Sender<String>,
    message: &'static str,
}

impl Drop for LastWords {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let _ = self.tell.try_send(self.message.into());
        }
    }
}
