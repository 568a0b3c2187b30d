//! Implements the display's side of live input.

use crate::device::{self, Nobody};
use crate::layout::{self, HELD, Header, REQUEST, SLOT_HEADER, STEP};
use crate::region::Region;
use crate::samples::{Curve, Stored, decode, decode_depth};
use crate::{
    Content, DeviceIds, FrameFault, FrameInfo, LiveError, Offer, Request, Sample, Transfer, ViewTaker, socket,
};
use std::fs::{File, TryLockError};
use std::os::fd::AsFd;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{Ordering, fence};
use std::time::Duration;

/// The number of copies that are tried of a frame that changes during the copy.
const TRIES: u32 = 4;
/// The number of callers that are answered at a time.
const CALLERS: u32 = 4;

/// A complete frame in linear light with 1 as full scale, whose values are all checked.
#[derive(Debug, Clone)]
pub struct Frame {
    number: u64,
    info: FrameInfo,
    light: Vec<f32>,
    dioptres: Vec<f32>,
    channels: usize,
    is_taken: bool,
}

impl Frame {
    /// Makes a frame with room for all content of the offer.
    fn new(offer: &Offer) -> Self {
        let light = offer.largest().map(|content| offer.samples(&content)).max().unwrap_or(0);
        let depth = offer.largest().any(|content| content == Content::ColorAndDepth);
        Self {
            number: 0,
            info: FrameInfo::new(Content::ColorAndDepth, Sample::U8, Transfer::Linear),
            light: Vec::with_capacity(light),
            dioptres: Vec::with_capacity(if depth { offer.pixels() } else { 0 }),
            channels: 1,
            is_taken: false,
        }
    }

    /// Returns the application's number of the frame, or 0 before the first.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Returns the description of the frame.
    pub fn info(&self) -> &FrameInfo {
        &self.info
    }

    /// Returns (view, row, column) or (layer, row, column) of a channel. Channels are the offer's colors in the order
    /// red, green, blue, followed by opacity for layers. The slice is empty if there is no such channel.
    pub fn channel(&self, channel: usize) -> &[f32] {
        let length = self.light.len() / self.channels;
        self.light.get(channel * length..(channel + 1) * length).unwrap_or(&[])
    }

    /// Returns true if a [`ViewTaker`] has the light and the distances, so that they are not here.
    pub fn is_taken(&self) -> bool {
        self.is_taken
    }

    /// Returns the distance of each pixel in dioptres, as (row, column). Empty unless the content is color and depth
    /// that no [`ViewTaker`] has.
    pub fn dioptres(&self) -> &[f32] {
        &self.dioptres
    }
}

/// The result of a look for frames.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Latest {
    /// The frame is newer than all before.
    New,
    /// The application sent nothing new (`application late`).
    Late,
    /// No application is connected, or it is gone (`application gone`).
    Gone,
    /// The newest frame was refused.
    Refused(FrameFault),
}

/// The numbers of frames and applications until now.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Applications that were accepted.
    pub applications: u64,
    /// Applications that were refused, because there was one or they belonged to another user.
    pub turned_away: u64,
    /// Frames that were accepted.
    pub frames: u64,
    /// Frames that were refused.
    pub refused: u64,
    /// Copies that were discarded because the slot changed during the copy.
    pub torn: u64,
}

#[derive(Debug)]
struct Connection {
    stream: UnixStream,
    region: Region,
    /// The number of the newest accepted frame.
    last: u64,
    /// The refused sequence of each slot, so that each frame is refused only once.
    refused: [u64; 8],
    /// True if the application has memory of a device.
    shares: bool,
}

/// Takes frames under a name. The socket is removed when the display is dropped.
#[derive(Debug)]
pub struct Display {
    offer: Offer,
    path: PathBuf,
    listener: UnixListener,
    /// The lock that is held while the socket exists.
    lock: File,
    /// The region for the next application.
    prepared: Option<Region>,
    connection: Option<Connection>,
    request: Option<Request>,
    requests: u64,
    /// The samples of a slot as they were stored.
    raw: Vec<u8>,
    /// The target of decoding. A fault in the middle therefore does not change the caller's frame.
    spare: Frame,
    curve: Curve,
    counts: Counts,
}

impl Display {
    /// Opens a display that takes frames under this name.
    ///
    /// # Errors
    /// Returns [`LiveError`] for an invalid name or offer, an unsafe folder, another display with this name, or too
    /// little memory.
    pub fn open(name: &str, offer: Offer) -> Result<Self, LiveError> {
        Self::open_in(&socket::folder(), name, offer)
    }

    /// Opens a display in the same way in another folder, with the same errors.
    pub fn open_in(folder: &Path, name: &str, offer: Offer) -> Result<Self, LiveError> {
        crate::supported()?;
        offer.check()?;
        let path = socket::path_of(folder, name)?;
        socket::safe_folder(folder)?;
        let system = |what| move |error| LiveError::System { what, error };
        let lock = File::options().create(true).truncate(false).write(true).open(path.with_extension("lock"));
        let lock = lock.map_err(system("the lock of a live input"))?;
        lock.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => LiveError::Taken(name.into()),
            TryLockError::Error(error) => LiveError::System { what: "the lock of a live input", error },
        })?;
        // The owner of the lock may remove the socket of a dead display.
        let _ = std::fs::remove_file(&path);
        let listener = UnixListener::bind(&path).map_err(system("the socket of a live input"))?;
        listener.set_nonblocking(true).map_err(system("the socket of a live input"))?;
        let prepared = Some(Region::new(offer.region_bytes())?);
        Ok(Self {
            raw: vec![0; offer.slot_bytes()],
            spare: Frame::new(&offer),
            curve: Curve::new(),
            counts: Counts::default(),
            connection: None,
            request: None,
            requests: 0,
            lock,
            prepared,
            listener,
            path,
            offer,
        })
    }

    /// Returns the offer of the display.
    pub fn offer(&self) -> &Offer {
        &self.offer
    }

    /// Returns a frame with room for all content, for [`latest`](Self::latest).
    pub fn frame(&self) -> Frame {
        Frame::new(&self.offer)
    }

    /// Returns the numbers of frames and applications until now.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Returns true if an application is connected.
    pub fn is_connected(&self) -> bool {
        self.connection.is_some()
    }

    /// Publishes a request with the time of the next set and the content that suits. Returns the number of the request.
    /// Its own number is ignored.
    pub fn ask(&mut self, request: &Request) -> u64 {
        self.requests += 1;
        self.request = Some(Request { number: self.requests, ..*request });
        if let Some(connection) = &self.connection {
            self.write_request(&connection.region);
            socket::nudge(&connection.stream);
        }
        self.requests
    }

    fn write_request(&self, region: &Region) {
        let Some(request) = &self.request else { return };
        // The sequence is computed from values here, because the application may have written any value into the
        // region.
        let sequence = region.word(REQUEST);
        sequence.store(2 * self.requests - 1, Ordering::Relaxed);
        fence(Ordering::Release);
        region.store(REQUEST + 1, &layout::request_words(request));
        sequence.store(2 * self.requests, Ordering::Release);
    }

    /// Waits until an application connects, sends a frame or leaves, which [`latest`](Self::latest) then finds. Returns
    /// false if nothing happened in time.
    pub fn wait(&self, patience: Duration) -> bool {
        let connection = self.connection.as_ref();
        let mut fds = vec![self.listener.as_fd()];
        fds.extend(connection.map(|c| c.stream.as_fd()));
        socket::wait(&fds, patience)
    }

    /// Puts the newest complete frame into `frame` if it is newer than the last. Otherwise `frame` does not change. The
    /// method also accepts and disconnects applications. It never waits. For a frame of [`frame`](Self::frame), it
    /// allocates memory only if an application connects or leaves.
    pub fn latest(&mut self, frame: &mut Frame) -> Latest {
        self.latest_with(frame, &mut Nobody, &mut || {})
    }

    /// Works as [`latest`](Self::latest), but offers the samples of views, and of color and depth, to `taker`.
    pub fn latest_to(&mut self, frame: &mut Frame, taker: &mut dyn ViewTaker) -> Latest {
        self.latest_with(frame, taker, &mut || {})
    }

    /// Works in the same way. A test can run code in the middle of each copy.
    pub(crate) fn latest_with(
        &mut self,
        frame: &mut Frame,
        taker: &mut dyn ViewTaker,
        middle: &mut dyn FnMut(),
    ) -> Latest {
        let Some(mut connection) = self.connection.take() else {
            self.answer_callers(taker);
            return Latest::Gone;
        };
        if connection.shares && taker.device().is_none() {
            taker.unshare();
            return Latest::Gone;
        }
        self.share(&mut connection, taker);
        // This check comes before the look for frames, so that the last frame before the end is used.
        let closed = !socket::listen(&connection.stream);
        let found = match self.take(&mut connection, taker, middle) {
            Ok(true) => {
                std::mem::swap(frame, &mut self.spare);
                self.counts.frames += 1;
                Latest::New
            }
            Ok(false) if closed => Latest::Gone,
            Ok(false) => Latest::Late,
            Err(fault) => {
                self.counts.refused += 1;
                Latest::Refused(fault)
            }
        };
        if found != Latest::Gone {
            self.connection = Some(connection);
        } else if connection.shares {
            taker.unshare();
        }
        // The next application waits until the last frame of this one is used.
        if !closed || found == Latest::Gone {
            self.answer_callers(taker);
        }
        found
    }

    /// Gives memory of a device to an application that requests it.
    fn share(&self, connection: &mut Connection, taker: &mut dyn ViewTaker) {
        let Connection { stream, region, shares, .. } = connection;
        let offers = region.word(layout::SHARES);
        if *shares || region.word(layout::WANTED).load(Ordering::Acquire) == 0 || offers.load(Ordering::Relaxed) == 0 {
            return;
        }
        let shared = taker.device().and_then(|_| taker.share(self.offer.slots, self.offer.slot_bytes() as u64));
        match shared.filter(|(_, fd)| device::is_fixed(fd)) {
            Some((memory, fd)) => {
                region.store(layout::DEVICE, &memory.words());
                *shares = socket::nudge_with(stream, &fd);
            }
            None => {
                offers.store(0, Ordering::Release);
                socket::nudge(stream);
            }
        }
        if !*shares {
            taker.unshare();
        }
    }

    fn answer_callers(&mut self, taker: &dyn ViewTaker) {
        for _ in 0..CALLERS {
            let Ok((stream, _)) = self.listener.accept() else {
                return;
            };
            match self.take_in(stream, taker.device()) {
                Ok(()) => self.counts.applications += 1,
                Err(()) => self.counts.turned_away += 1,
            }
        }
    }

    fn take_in(&mut self, stream: UnixStream, device: Option<DeviceIds>) -> Result<(), ()> {
        let turned = |reason: &str| socket::refuse(&stream, reason);
        socket::check_peer(&stream).map_err(|error| turned(&error.to_string()))?;
        if self.connection.is_some() {
            turned("it already has an application, and accepts one at a time");
            return Err(());
        }
        let bytes = self.offer.region_bytes();
        let region = match self.prepared.take() {
            Some(region) => region,
            None => Region::new(bytes).map_err(|error| turned(&error.to_string()))?,
        };
        region.store(0, &layout::offer_words(&self.offer));
        if let Some(ids) = device {
            region.store(layout::DEVICE, &ids.words());
            region.word(layout::SHARES).store(1, Ordering::Release);
        }
        self.write_request(&region);
        stream.set_nonblocking(true).map_err(|_| ())?;
        if !socket::welcome(&stream, region.fd(), bytes) {
            return Err(());
        }
        self.connection = Some(Connection { stream, region, last: 0, refused: [0; 8], shares: false });
        Ok(())
    }

    /// Copies and decodes the newest complete frame into the spare one, if it is newer than the last.
    fn take(
        &mut self,
        connection: &mut Connection,
        taker: &mut dyn ViewTaker,
        middle: &mut dyn FnMut(),
    ) -> Result<bool, FrameFault> {
        for _ in 0..TRIES {
            let Some((slot, before)) = self.newest(connection) else {
                return Ok(false);
            };
            let region = &connection.region;
            let sequence = region.word(layout::slot_word(&self.offer, slot));
            region.word(HELD).store(slot as u64 + 1, Ordering::Relaxed);
            fence(Ordering::SeqCst);
            let still = sequence.load(Ordering::Acquire) == before;
            let copied = if still { self.copy(connection, slot, taker) } else { Err(FrameFault::Torn) };
            middle();
            fence(Ordering::Acquire);
            let whole = sequence.load(Ordering::Relaxed) == before;
            region.word(HELD).store(0, Ordering::Release);
            if !(still && whole) {
                self.counts.torn += 1;
                continue;
            }
            let taken = copied.and_then(|(number, info)| self.decode(number, info, taker));
            match taken {
                Ok(()) => connection.last = self.spare.number,
                Err(_) => connection.refused[slot] = before,
            }
            return taken.map(|()| true);
        }
        Err(FrameFault::Torn)
    }

    /// Returns the slot of the newest frame that is newer than the last, and its sequence.
    fn newest(&self, connection: &Connection) -> Option<(usize, u64)> {
        let slots = (0..self.offer.slots as usize).filter_map(|slot| {
            let start = layout::slot_word(&self.offer, slot);
            let sequence = connection.region.word(start).load(Ordering::Acquire);
            let number = connection.region.word(start + 1).load(Ordering::Relaxed);
            let whole = sequence != 0 && sequence.is_multiple_of(2) && sequence != connection.refused[slot];
            (whole && number > connection.last).then_some((number, slot, sequence))
        });
        slots.max().map(|(_, slot, sequence)| (slot, sequence))
    }

    /// Copies a slot and returns the number and the description of its frame. All checks use the copy.
    fn copy(
        &mut self,
        connection: &Connection,
        slot: usize,
        taker: &mut dyn ViewTaker,
    ) -> Result<(u64, FrameInfo), FrameFault> {
        let Connection { region, last, shares, .. } = connection;
        let start = layout::slot_word(&self.offer, slot);
        let header: Header = region.load(start);
        let info = layout::read_header(&header, &self.offer, *shares)?;
        let (found, least, most) = (header[1], last.saturating_add(1), last.saturating_add(STEP));
        if !(least..=most).contains(&found) {
            return Err(FrameFault::Number { what: "frame number", found, least, most });
        }
        let bytes = self.offer.bytes(&info.content, info.sample)[0];
        if info.on_device {
            let on_device = taker.take_shared(slot, &mut self.raw[..bytes.next_multiple_of(4)], &info)?;
            return Ok((found, FrameInfo { on_device, ..info }));
        }
        region.load_bytes(start + SLOT_HEADER, &mut self.raw[..bytes]);
        Ok((found, info))
    }

    /// Decodes the copied samples into the spare frame, or passes them to the taker.
    fn decode(&mut self, number: u64, info: FrameInfo, taker: &mut dyn ViewTaker) -> Result<(), FrameFault> {
        let frame = &mut self.spare;
        let colors = self.offer.channels();
        let channels = colors + usize::from(matches!(info.content, Content::Layers(_)));
        let [bytes, depth] = self.offer.bytes(&info.content, info.sample);
        let is_offered = !info.on_device && !matches!(info.content, Content::Layers(_));
        let taken =
            is_offered.then(|| taker.take(&self.raw[..bytes.next_multiple_of(4)], &info)).flatten().transpose()?;
        frame.is_taken = info.on_device || taken.is_some();
        (frame.number, frame.info, frame.channels) = (number, info, channels);
        if frame.is_taken {
            frame.light.clear();
            frame.dioptres.clear();
            return Ok(());
        }
        // Both have room for the largest frame.
        frame.light.resize(self.offer.samples(&info.content), 0.0);
        frame.dioptres.resize(if bytes > depth { self.offer.pixels() } else { 0 }, 0.0);
        let stored = Stored { sample: info.sample, transfer: info.transfer, channels, colors };
        decode(&self.raw[..depth], &stored, &self.curve, &mut frame.light)?;
        decode_depth(&self.raw[depth..bytes], channels, &mut frame.dioptres)
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
        // A child process that has not started its program has a copy of the open file, and closing would leave the lock
        // to this copy.
        let _ = self.lock.unlock();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    /// A child process holds copies of all open files until it starts its program.
    #[test]
    fn a_name_is_free_once_its_display_is_dropped() {
        let folder = std::env::temp_dir().join(format!("eyebox-name-{}", std::process::id()));
        let open = || {
            let (size, colors, kinds) = ([4, 4], [true; 3], vec![Kind::Views]);
            let (views, layers, slots, pixel_angle, eyebox_mm) = ([1, 1], 1, 3, 1e-3, [1.0; 2]);
            Display::open_in(
                &folder,
                "name",
                Offer { size, colors, kinds, views, layers, slots, pixel_angle, eyebox_mm },
            )
        };
        let display = open().unwrap();
        let _copy = display.lock.try_clone().unwrap();
        assert!(matches!(open(), Err(LiveError::Taken(_))));
        drop(display);
        assert!(open().is_ok());
        std::fs::remove_dir_all(folder).unwrap();
    }
}
