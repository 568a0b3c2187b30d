//! Keeps running decoders of videos, so that the frames of a sequence are decoded once.
//!
//! A decoder continues at the frame after the last one. A frame before it is decoded from the beginning of the file.

use crate::SceneError;
use crate::formats::decoder::{Decoder, Stated, What};
use crate::formats::video_color::Matrix;
use crate::formats::y4m::{Layout, Video};
use crate::light_field::light::Picture;
use crate::light_field::near::GrayValues;
use eyebox_base::reason;
use eyebox_optics::Color;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

/// Decoders that are kept. A scene needs at most three, for colors, transparency and depths.
const KEPT: usize = 4;

/// A file, as it was when it was opened.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Version {
    /// A forked process has the decoders of its parent, and must not read from them.
    process: u32,
    path: PathBuf,
    changed: Option<SystemTime>,
    length: u64,
}

/// A running decoder, with the position of its video.
struct Running {
    of: (Version, What),
    stated: Stated,
    video: Video,
    /// The number of the frame that comes next.
    next: usize,
    /// The samples of the frame before it.
    last: Option<Arc<Vec<u8>>>,
}

/// A decoded frame and its layout.
struct Frame {
    stated: Stated,
    layout: Layout,
    bytes: Arc<Vec<u8>>,
}

static RUNNING: Mutex<Vec<Running>> = Mutex::new(Vec::new());
static COUNTS: Mutex<Vec<(Version, usize)>> = Mutex::new(Vec::new());

fn version(path: &Path) -> Result<Version, SceneError> {
    let file = std::fs::metadata(path).map_err(|e| SceneError::unreadable(path, &e))?;
    Ok(Version { process: std::process::id(), path: path.into(), changed: file.modified().ok(), length: file.len() })
}

impl Running {
    fn start(of: (Version, What)) -> Result<Self, SceneError> {
        let path = &of.0.path;
        let stated = Stated::of(path)?;
        let mut video = Video::decoded(path, Decoder::start(path, &stated, of.1)?)?;
        video.layout.full = stated.is_gray && stated.is_full;
        Ok(Self { of, stated, video, next: 0, last: None })
    }

    /// Returns a frame that is the last one or a later one.
    fn frame(&mut self, frame: usize) -> Result<Arc<Vec<u8>>, SceneError> {
        while self.next < frame && self.video.skip()? {
            (self.next, self.last) = (self.next + 1, None);
        }
        if let (Some(last), true) = (&self.last, self.next == frame + 1) {
            return Ok(Arc::clone(last));
        }
        if self.next < frame {
            return Err(self.missing(frame));
        }
        let bytes = Arc::new(self.video.frame(0).map_err(|_| self.missing(frame))?);
        (self.next, self.last) = (frame + 1, Some(Arc::clone(&bytes)));
        Ok(bytes)
    }

    fn missing(&self, frame: usize) -> SceneError {
        self.video.layout.corrupt(reason!(
            "no-such-frame",
            "it has {} frames, but frame {frame} is requested (counted from 0)",
            self.next
        ))
    }

    fn holds(&self, of: &(Version, What), frame: usize) -> bool {
        self.of == *of && (self.next <= frame || (self.next == frame + 1 && self.last.is_some()))
    }
}

/// Decodes a frame of a file.
fn frame(path: &Path, what: What, frame: usize) -> Result<Frame, SceneError> {
    let of = (version(path)?, what);
    // A decoder is taken out of the list while it decodes, so that others do not wait for it.
    let kept = {
        let mut running = RUNNING.lock().unwrap_or_else(PoisonError::into_inner);
        let at = running.iter().position(|running| running.holds(&of, frame));
        at.map(|at| running.remove(at))
    };
    let mut decoder = kept.map_or_else(|| Running::start(of), Ok)?;
    let bytes = decoder.frame(frame)?;
    let (stated, layout) = (decoder.stated.clone(), decoder.video.layout.clone());
    let oldest = {
        let mut running = RUNNING.lock().unwrap_or_else(PoisonError::into_inner);
        running.push(decoder);
        (running.len() > KEPT).then(|| running.remove(0))
    };
    // It ends without the lock.
    drop(oldest);
    Ok(Frame { stated, layout, bytes })
}

/// Returns the number of frames, by decoding all.
pub(crate) fn count(path: &Path) -> Result<usize, SceneError> {
    let of = version(path)?;
    let known =
        |counts: &[(Version, usize)]| counts.iter().find(|(version, _)| *version == of).map(|(_, count)| *count);
    if let Some(count) = known(&COUNTS.lock().unwrap_or_else(PoisonError::into_inner)) {
        return Ok(count);
    }
    let mut decoder = Running::start((of.clone(), What::Colors))?;
    let mut count = 0;
    while decoder.video.skip()? {
        count += 1;
    }
    COUNTS.lock().unwrap_or_else(PoisonError::into_inner).push((of, count));
    Ok(count)
}

/// Returns rows and columns of a frame.
pub(crate) fn size(path: &Path) -> Result<[usize; 2], SceneError> {
    Ok(frame(path, What::Colors, 0)?.layout.size)
}

/// Reads the planes of `colors` of a frame in linear light. Transparency is composited over black.
pub(crate) fn read(path: &Path, number: usize, colors: &[Color]) -> Result<Picture, SceneError> {
    let Frame { stated, layout, bytes } = frame(path, What::Colors, number)?;
    let mut planes = layout.planes(&bytes, colors, Matrix::Bt709);
    let mut read_as = stated.read_as;
    if stated.has_alpha {
        let alpha = frame(path, What::Alpha, number)?;
        let shares: Vec<f32> =
            (alpha.bytes.chunks_exact(2)).map(|v| f32::from(u16::from_le_bytes([v[0], v[1]])) / 65535.0).collect();
        planes.par_iter_mut().for_each(|plane| plane.iter_mut().zip(&shares).for_each(|(v, share)| *v *= share));
        read_as += ", over black";
    }
    let [height, width] = layout.size;
    Ok(Picture { height, width, planes, read_as })
}

/// Reads the luma of a frame, as values of 8 or of 16 bits.
pub(crate) fn stored(path: &Path, number: usize) -> Result<GrayValues, SceneError> {
    let Frame { stated, layout, bytes } = frame(path, What::Colors, number)?;
    Ok(layout.stored(&bytes, stated.is_deep))
}

/// Returns the data that identify a frame, which are its size and its samples.
pub(crate) fn stored_parts(path: &Path, number: usize) -> Result<(String, Vec<u8>), SceneError> {
    let Frame { layout, bytes, .. } = frame(path, What::Colors, number)?;
    let [rows, columns] = layout.size;
    Ok((format!("{rows}x{columns}"), bytes.to_vec()))
}

#[cfg(test)]
#[path = "decoded_tests.rs"]
mod tests;
