//! Reads frames of YUV4MPEG2 videos (`.y4m`), of colors or of depths.
//!
//! `clip.y4m?frame=12` is the thirteenth frame, and `clip.y4m` alone is the first. The values are Y'CbCr of the stated
//! matrix (`clip.y4m?matrix=bt709`, or `XCOLORMATRIX=BT709` in the file), or of the format's matrix
//! ([`Matrix::usual`]). The range is limited unless the file has `XCOLORRANGE=FULL`. Samples are 4:2:0, 4:2:2, 4:4:4 or
//! gray, of 8 to 16 bits. The decoded values are sRGB.

use crate::formats::video_color::{Matrix, check_aspect, check_interlacing};
use crate::light_field::light::Picture;
use crate::light_field::near::{GrayValues, Kind};
use crate::{SceneError, srgb_to_linear};
use eyebox_base::error::Reason;
use eyebox_base::files::{FileError, FileKind, Wanted, read};
use eyebox_base::reason;
use eyebox_optics::Color;
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes of the longest line before the frames, or before one frame.
const LINE: u64 = 1024;
/// Most pixels of a frame.
const MOST_PIXELS: usize = 1 << 25;

/// Returns the file and the number of the frame that a path names. It returns `None` if the path names no video.
pub(crate) fn named(path: &Path) -> Option<(PathBuf, Option<usize>)> {
    let is_video = |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("y4m"));
    if is_video(path) {
        return Some((path.into(), None));
    }
    let (file, query) = path.to_str()?.rsplit_once('?')?;
    let mut frame = None;
    for part in query.split('&') {
        match part.split_once('=')? {
            ("frame", number) => frame = Some(number.parse().ok()?),
            ("matrix", name) => drop(Matrix::named(name).ok()?),
            _ => return None,
        }
    }
    is_video(Path::new(file)).then(|| (file.into(), frame))
}

/// Returns the name of a frame. `video` may state its matrix.
pub(crate) fn frame(video: &Path, frame: usize) -> String {
    let next = if Matrix::stated(video).is_some() { '&' } else { '?' };
    format!("{}{next}frame={frame}", video.display())
}

/// Returns the number of frames of a video.
pub(crate) fn count(video: &Path) -> Result<usize, SceneError> {
    let mut video = Video::open(video)?;
    let mut count = 0;
    while video.skip()? {
        count += 1;
    }
    Ok(count)
}

/// Returns rows and columns of a frame.
pub(crate) fn size(video: &Path) -> Result<[usize; 2], SceneError> {
    Ok(Video::open(video)?.size)
}

/// Reads the planes of `colors` of a frame in linear light. `matrix` is the stated matrix.
pub(crate) fn read(
    video: &Path,
    frame: usize,
    colors: &[Color],
    matrix: Option<Matrix>,
) -> Result<Picture, SceneError> {
    let mut video = Video::open(video)?;
    let bytes = video.frame(frame)?;
    let [height, width] = video.size;
    let matrix = match matrix.or(video.matrix) {
        Some(matrix) => matrix,
        None if video.chroma.is_none() => Matrix::Bt601,
        None => Matrix::usual(&video.name, video.size, video.of_ffmpeg)?,
    };
    let row = |y: usize| -> Vec<[f32; 3]> { (0..width).map(|x| video.light(&bytes, y, x, matrix)).collect() };
    let light: Vec<[f32; 3]> = (0..height).into_par_iter().flat_map_iter(row).collect();
    let planes = colors.iter().map(|color| light.iter().map(|pixel| pixel[color.channel()]).collect()).collect();
    let range = if video.full { "full" } else { "limited" };
    let read_as = match video.chroma {
        Some(_) => format!("{matrix}, {range} range, sRGB"),
        None => format!("gray, {range} range, sRGB"),
    };
    Ok(Picture { height, width, planes, read_as })
}

/// Reads the luma of a frame, as values of 8 or of 16 bits.
pub(crate) fn stored(video: &Path, frame: usize) -> Result<GrayValues, SceneError> {
    let mut video = Video::open(video)?;
    let bytes = video.frame(frame)?;
    let [height, width] = video.size;
    let (kind, full) = if video.bits > 8 { (Kind::Words, 65535.0) } else { (Kind::Bytes, 255.0) };
    let values = (0..height * width).map(|i| (video.luma(&bytes, i).clamp(0.0, 1.0) * full).round()).collect();
    Ok(GrayValues { height, width, kind, values, range: Some([0.0, full]) })
}

/// Returns the data from which a frame is decoded, which are the first line of its file and its samples.
pub(crate) fn stored_parts(video: &Path, frame: usize) -> Result<(String, Vec<u8>), SceneError> {
    let unreadable = |e: std::io::Error| SceneError::unreadable(video, &e);
    let mut head = String::new();
    let file = read::open(video).map_err(unreadable)?;
    BufReader::new(file.take(LINE)).read_line(&mut head).map_err(unreadable)?;
    Ok((head, Video::open(video)?.frame(frame)?))
}

/// An open video, positioned at the header of a frame.
struct Video {
    name: String,
    from: BufReader<File>,
    length: u64,
    /// Rows and columns of pixels.
    size: [usize; 2],
    /// Luma pixels along y and x per color-difference sample. It is `None` for gray videos.
    chroma: Option<[usize; 2]>,
    /// True if color differences are at the position of the left of two pixels, and not between them.
    left: bool,
    bits: u32,
    full: bool,
    /// The matrix that the header states.
    matrix: Option<Matrix>,
    /// True if ffmpeg wrote the header. It keeps the matrix of its source and does not state it.
    of_ffmpeg: bool,
}

impl Video {
    fn open(path: &Path) -> Result<Self, SceneError> {
        let unreadable = |e: std::io::Error| SceneError::unreadable(path, &e);
        let file = read::open(path).map_err(unreadable)?;
        let length = file.metadata().map_err(unreadable)?.len();
        let name = path.display().to_string();
        let mut video = Self {
            name,
            from: BufReader::new(file),
            length,
            size: [0; 2],
            chroma: Some([2, 2]),
            left: false,
            bits: 8,
            full: false,
            matrix: None,
            of_ffmpeg: false,
        };
        let kind = FileKind::of(path).map_err(unreadable)?;
        if kind != FileKind::Y4m {
            return Err(FileError::of_kind(path, kind, Wanted::Scene).into());
        }
        let head = video.line()?;
        let words = head
            .strip_prefix("YUV4MPEG2 ")
            .ok_or_else(|| video.corrupt(reason!("not-y4m", "it does not start with YUV4MPEG2")))?;
        for word in words.split_ascii_whitespace() {
            let (key, value) = word.split_at(word.chars().next().map_or(0, char::len_utf8));
            let number = || value.parse().ok().filter(|n| (1..=65536).contains(n));
            match key {
                "W" => video.size[1] = number().unwrap_or(0),
                "H" => video.size[0] = number().unwrap_or(0),
                "C" => video.space(value)?,
                "I" => check_interlacing(value).map_err(|reason| video.corrupt(reason))?,
                "A" => check_aspect(value).map_err(|reason| video.corrupt(reason))?,
                "X" if value == "COLORRANGE=FULL" => video.full = true,
                "X" if value.starts_with("YSCSS=") => video.of_ffmpeg = true,
                "X" => {
                    if let Some(name) = value.strip_prefix("COLORMATRIX=") {
                        video.matrix = Some(Matrix::named(name).map_err(|reason| video.corrupt(reason))?);
                    }
                }
                _ => {}
            }
        }
        let [height, width] = video.size;
        if height == 0 || width == 0 || height * width > MOST_PIXELS {
            return Err(video.corrupt(reason!(
                "video-size",
                "its first line is {head:?}, but W and H must be columns and rows of at most {} Mpx",
                MOST_PIXELS >> 20
            )));
        }
        Ok(video)
    }

    /// Reads the format of the samples, such as `420jpeg`, `444p10` or `mono16`.
    fn space(&mut self, text: &str) -> Result<(), SceneError> {
        let (kind, bits) = match text.strip_prefix("mono") {
            Some(bits) => ("mono", bits),
            None => text.split_at(text.len().min(3)),
        };
        self.chroma = match kind {
            "mono" => None,
            "420" => Some([2, 2]),
            "422" => Some([1, 2]),
            "444" => Some([1, 1]),
            _ => {
                return Err(
                    self.corrupt(reason!("video-chroma", "samples are C{text}, but must be C420, C422, C444 or Cmono"))
                );
            }
        };
        self.left = matches!(bits, "mpeg2" | "paldv") || kind == "422";
        self.bits = match bits.strip_prefix('p').unwrap_or(bits) {
            "" | "jpeg" | "mpeg2" | "paldv" | "aldv" => 8,
            bits => match bits.parse() {
                Ok(bits @ 8..=16) => bits,
                _ => {
                    return Err(self.corrupt(reason!("video-bits", "samples are C{text}, but must have 8 to 16 bits")));
                }
            },
        };
        Ok(())
    }

    fn corrupt(&self, reason: Reason) -> SceneError {
        SceneError::Corrupt { file: self.name.clone(), reason }
    }

    fn failed(&self, error: &std::io::Error) -> SceneError {
        SceneError::unreadable(Path::new(&self.name), error)
    }

    /// Returns the next line without its end. It is empty at the end of the file.
    fn line(&mut self) -> Result<String, SceneError> {
        let mut line = Vec::new();
        let read = self.from.by_ref().take(LINE).read_until(b'\n', &mut line);
        read.map_err(|e| self.failed(&e))?;
        if line.pop().is_some_and(|last| last != b'\n') {
            return Err(self.corrupt(reason!("not-video", "it is not a video, because a line has no end")));
        }
        Ok(String::from_utf8_lossy(&line).into_owned())
    }

    /// Returns rows and columns of a plane.
    fn plane(&self, chroma: bool) -> [usize; 2] {
        match self.chroma.filter(|_| chroma) {
            Some(times) => [0, 1].map(|i| self.size[i].div_ceil(times[i])),
            None => self.size,
        }
    }

    /// Returns the bytes of a frame.
    fn bytes(&self) -> usize {
        let pixels = |chroma| self.plane(chroma).iter().product::<usize>();
        let samples = pixels(false) + if self.chroma.is_some() { 2 * pixels(true) } else { 0 };
        samples * if self.bits > 8 { 2 } else { 1 }
    }

    /// Goes to the samples of a frame, and returns true if there is one.
    fn begin(&mut self) -> Result<bool, SceneError> {
        let line = self.line()?;
        if line.is_empty() {
            return Ok(false);
        }
        if line.split(' ').next() != Some("FRAME") {
            return Err(self.corrupt(reason!(
                "frame-start",
                "a frame does not start with FRAME, so the one before has another size"
            )));
        }
        let at = self.from.stream_position().map_err(|e| self.failed(&e))?;
        if at + self.bytes() as u64 > self.length {
            return Err(self.corrupt(reason!(
                "frame-cut-short",
                "its last frame is cut short, so copy it again, or take an earlier frame by ?frame=N"
            )));
        }
        Ok(true)
    }

    fn skip(&mut self) -> Result<bool, SceneError> {
        let there = self.begin()?;
        if there {
            let bytes = self.bytes() as i64;
            self.from.seek(SeekFrom::Current(bytes)).map_err(|e| self.failed(&e))?;
        }
        Ok(there)
    }

    /// Reads the samples of a frame.
    fn frame(&mut self, frame: usize) -> Result<Vec<u8>, SceneError> {
        for before in 0..=frame {
            let is_there = if before < frame { self.skip()? } else { self.begin()? };
            if !is_there {
                return Err(self.corrupt(reason!(
                    "no-such-frame",
                    "it has {before} frames, but frame {frame} is requested (counted from 0)"
                )));
            }
        }
        let mut bytes = vec![0; self.bytes()];
        self.from.read_exact(&mut bytes).map_err(|e| self.failed(&e))?;
        Ok(bytes)
    }

    /// Returns a sample in units of 8 bits, with a fraction.
    fn sample(&self, bytes: &[u8], i: usize) -> f32 {
        if self.bits == 8 {
            f32::from(bytes[i])
        } else {
            f32::from(u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]])) / (1u32 << (self.bits - 8)) as f32
        }
    }

    /// Returns the luma of a pixel, 0 to 1.
    fn luma(&self, bytes: &[u8], i: usize) -> f32 {
        let value = self.sample(bytes, i);
        let most = 256.0 - (0.5f32).powi(self.bits as i32 - 8);
        if self.full { value / most } else { (value - 16.0) / 219.0 }
    }

    /// Returns a color difference at a pixel, -0.5 to 0.5, interpolated between the samples around it.
    fn difference(&self, bytes: &[u8], which: usize, y: usize, x: usize) -> f32 {
        let Some(times) = self.chroma else { return 0.0 };
        let [rows, columns] = self.plane(true);
        let start = self.size[0] * self.size[1] + which * rows * columns;
        // A sample is in the middle of its pixels, or at the left one.
        let place = |at: usize, times: usize, n: usize, left: bool| {
            let shift = if left || times == 1 { 0.0 } else { 0.25 };
            let at = (at as f32 / times as f32 - shift).clamp(0.0, n as f32 - 1.0);
            (at as usize, (at as usize + 1).min(n - 1), at.fract())
        };
        let (top, bottom, fy) = place(y, times[0], rows, false);
        let (left, right, fx) = place(x, times[1], columns, self.left);
        let at = |y: usize, x: usize| self.sample(bytes, start + y * columns + x);
        let row = |y: usize| (1.0 - fx) * at(y, left) + fx * at(y, right);
        let value = (1.0 - fy) * row(top) + fy * row(bottom) - 128.0;
        value / if self.full { 255.0 } else { 224.0 }
    }

    /// Returns red, green and blue of a pixel in linear light.
    fn light(&self, bytes: &[u8], y: usize, x: usize, matrix: Matrix) -> [f32; 3] {
        let luma = self.luma(bytes, y * self.size[1] + x);
        let differences = [0, 1].map(|which| self.difference(bytes, which, y, x));
        matrix.rgb(luma, differences).map(|v| srgb_to_linear(f64::from(v.clamp(0.0, 1.0))) as f32)
    }
}

#[cfg(test)]
#[path = "video_tests.rs"]
mod tests;
