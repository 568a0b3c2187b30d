//! Implements the application's side of live input.

use crate::layout::{self, HELD, REQUEST, SLOT_HEADER};
use crate::region::Region;
use crate::{Content, DeviceIds, DeviceMemory, FrameFault, FrameInfo, LiveError, Offer, Request, socket};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::atomic::{Ordering, fence};
use std::time::{Duration, Instant};

/// The longest time in which a display must answer. It answers at its next look for frames.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);

/// A connection to a display. The display notices if it is dropped.
#[derive(Debug)]
pub struct Application {
    stream: UnixStream,
    region: Region,
    offer: Offer,
    newest: Option<usize>,
    frames: u64,
    seen: u64,
    /// True if the display shares memory of a device.
    shares: bool,
}

impl Application {
    /// Connects to the display that takes frames under this name.
    ///
    /// # Errors
    /// Returns [`LiveError`] if no such display exists, it belongs to another user, it already has an application, or
    /// it does not answer for ten seconds.
    pub fn connect(name: &str) -> Result<Self, LiveError> {
        Self::connect_in(&socket::folder(), name)
    }

    /// Connects in the same way in another folder, with the same errors.
    pub fn connect_in(folder: &Path, name: &str) -> Result<Self, LiveError> {
        crate::supported()?;
        let stream = UnixStream::connect(socket::path_of(folder, name)?)
            .map_err(|e| LiveError::NoDisplay { name: name.into(), reason: e.to_string() })?;
        socket::check_peer(&stream)?;
        let (fd, bytes) = socket::greeted(&stream, ANSWER_TIMEOUT)?;
        stream.set_nonblocking(true).map_err(|error| LiveError::System { what: "a socket", error })?;
        let region = Region::received(fd, bytes)?;
        if bytes < 4096 {
            return Err(LiveError::Damaged(format!("{bytes} bytes are too few for a region")));
        }
        let offer = layout::read_offer(&region.load(0), bytes)?;
        Ok(Self { stream, region, offer, newest: None, frames: 0, seen: 0, shares: false })
    }

    #[cfg(test)]
    pub(crate) fn region(&self) -> &Region {
        &self.region
    }

    /// Returns the offer of the display.
    pub fn offer(&self) -> &Offer {
        &self.offer
    }

    /// Returns the device whose memory the display can share, if it has one. An application on the same device can use
    /// it.
    pub fn device(&self) -> Option<DeviceIds> {
        let offers = self.region.word(layout::SHARES).load(Ordering::Acquire) == 1;
        let words = self.region.load(layout::DEVICE);
        offers.then(|| DeviceIds::of(&words))
    }

    /// Requests memory of that device, and waits for it. Returns its description and its file descriptor, or `None` if
    /// the display gives none after all. From then on frames may be [on the device](FrameInfo::on_device).
    ///
    /// # Errors
    /// Returns [`LiveError::Gone`] if the display is gone, [`LiveError::Damaged`] for invalid memory, and
    /// [`LiveError::System`] if no answer arrives in time.
    pub fn share(&mut self, patience: Duration) -> Result<Option<(DeviceMemory, OwnedFd)>, LiveError> {
        let until = Instant::now() + patience;
        self.region.word(layout::WANTED).store(1, Ordering::Release);
        socket::nudge(&self.stream);
        loop {
            let (there, fd) = socket::listen_for_fd(&self.stream);
            if let Some(fd) = fd {
                let words = self.region.load(layout::DEVICE);
                let memory = DeviceMemory::of(&words, self.offer.slots, self.offer.slot_bytes() as u64);
                let damaged = || LiveError::Damaged("the device's shared memory does not hold its slots".into());
                self.shares = true;
                return memory.map(|memory| Some((memory, fd))).ok_or_else(damaged);
            }
            if !there {
                return Err(LiveError::Gone);
            }
            if self.device().is_none() {
                return Ok(None);
            }
            if !socket::wait_until(&self.stream, until) {
                let error = std::io::ErrorKind::TimedOut.into();
                return Err(LiveError::System { what: "the memory of the display's device", error });
            }
        }
    }

    /// Returns the request of the display for now, or `None` before its first request.
    pub fn request(&self) -> Option<Request> {
        let sequence = self.region.word(REQUEST);
        for _ in 0..1000 {
            let before = sequence.load(Ordering::Acquire);
            let words = self.region.load(REQUEST + 1);
            fence(Ordering::Acquire);
            if before.is_multiple_of(2) && before == sequence.load(Ordering::Relaxed) {
                return if before == 0 { None } else { layout::read_request(&words) };
            }
            std::hint::spin_loop();
        }
        None
    }

    /// Waits for a request that no earlier wait returned. Returns false if none arrived in time.
    ///
    /// # Errors
    /// Returns [`LiveError::Gone`] if the display is gone.
    pub fn wait(&mut self, patience: Duration) -> Result<bool, LiveError> {
        let until = Instant::now() + patience;
        loop {
            if !self.is_connected() {
                return Err(LiveError::Gone);
            }
            if let Some(number) = self.request().map(|r| r.number).filter(|number| *number != self.seen) {
                self.seen = number;
                return Ok(true);
            }
            if !socket::wait_until(&self.stream, until) {
                return Ok(false);
            }
        }
    }

    /// Returns true while the display is connected.
    pub fn is_connected(&self) -> bool {
        socket::listen(&self.stream)
    }

    /// Begins a frame in a slot that the display does not read. The slot keeps its old content until it is written.
    ///
    /// # Errors
    /// Returns [`LiveError::Frame`] if the display would refuse the frame.
    pub fn begin(&mut self, info: &FrameInfo) -> Result<Slot<'_>, LiveError> {
        let words = layout::header_words(&self.offer, info, self.frames + 1);
        let info = layout::read_header(&words, &self.offer, self.shares)?;
        let index = self.take_slot();
        let start = layout::slot_word(&self.offer, index);
        self.region.store(start + 1, &words[1..]);
        Ok(Slot { application: self, index, start, info })
    }

    /// Makes the sequence of a free slot odd. With three slots, one is the newest and one may be held.
    fn take_slot(&mut self) -> usize {
        for index in (0..self.offer.slots as usize).cycle() {
            let held = |order| self.region.word(HELD).load(order) == index as u64 + 1;
            if self.newest == Some(index) || held(Ordering::Relaxed) {
                continue;
            }
            let sequence = self.region.word(layout::slot_word(&self.offer, index));
            let before = sequence.load(Ordering::Relaxed);
            // The sequence of a slot that was begun and never published is odd already.
            sequence.store(before | 1, Ordering::Relaxed);
            fence(Ordering::SeqCst);
            if !held(Ordering::SeqCst) || before % 2 == 1 {
                return index;
            }
            sequence.store(before, Ordering::Release);
        }
        unreachable!("the slots go round")
    }

    /// Sends a frame with its samples, and with the dioptres for color and depth. Returns its number.
    ///
    /// # Errors
    /// Returns [`LiveError::Frame`] if the display would refuse the frame, or if the number of samples is wrong. The
    /// display checks the values.
    pub fn send(&mut self, info: &FrameInfo, samples: &[u8], dioptres: &[f32]) -> Result<u64, LiveError> {
        let bytes = self.offer.samples(&info.content) * info.sample.bytes();
        let depths = if info.content == Content::ColorAndDepth { self.offer.pixels() } else { 0 };
        for (what, found, must) in [("bytes", samples.len(), bytes), ("depths", dioptres.len(), depths)] {
            let [found, must] = [found as u64, must as u64];
            if found != must {
                return Err(FrameFault::Number { what, found, least: must, most: must }.into());
            }
        }
        let depth = self.offer.bytes(&info.content, info.sample)[1];
        let mut slot = self.begin(info)?;
        slot.write(0, samples);
        for (i, two) in dioptres.chunks(2).enumerate() {
            let mut word = [0; 8];
            for (to, value) in word.as_chunks_mut::<4>().0.iter_mut().zip(two) {
                *to = value.to_le_bytes();
            }
            slot.write(depth + 8 * i, &word[..4 * two.len()]);
        }
        Ok(slot.publish())
    }
}

/// A frame that is being written. If it is dropped, it is discarded and its slot is used again.
#[derive(Debug)]
pub struct Slot<'a> {
    application: &'a mut Application,
    index: usize,
    start: usize,
    info: FrameInfo,
}

impl Slot<'_> {
    /// Writes a part of the samples.
    ///
    /// # Panics
    /// Panics if `at`, in bytes from the first sample, is no multiple of 8, or if the samples do not end within the
    /// frame.
    pub fn write(&mut self, at: usize, samples: &[u8]) {
        let room = self.application.offer.bytes(&self.info.content, self.info.sample)[0];
        assert!(
            at.is_multiple_of(8) && samples.len() <= room.saturating_sub(at),
            "{} bytes at {at} of {room}",
            samples.len()
        );
        self.application.region.store_bytes(self.start + SLOT_HEADER + at / 8, samples);
    }

    /// Returns the index of the slot, which is the place of its samples [on the device](FrameInfo::on_device).
    pub fn index(&self) -> usize {
        self.index
    }

    /// Publishes the frame after all of its samples are written. If the samples are on a device, the application must
    /// have waited for its queue. Returns the number of the frame.
    pub fn publish(self) -> u64 {
        let application = self.application;
        let sequence = application.region.word(self.start);
        sequence.store(sequence.load(Ordering::Relaxed).wrapping_add(1), Ordering::Release);
        application.newest = Some(self.index);
        application.frames += 1;
        socket::nudge(&application.stream);
        application.frames
    }
}
