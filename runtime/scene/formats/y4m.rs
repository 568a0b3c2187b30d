//! Reads files and streams of YUV4MPEG2, frame by frame.

use crate::formats::decoder::Decoder;
use crate::formats::video_color::{Matrix, check_aspect, check_interlacing};
use crate::light_field::near::{GrayValues, Kind};
use crate::{SceneError, srgb_to_linear};
use eyebox_base::error::Reason;
use eyebox_base::files::{FileError, FileKind, Wanted, read};
use eyebox_base::reason;
use eyebox_optics::Color;
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek};
use std::path::Path;

/// Bytes of the longest line before the frames, or before one frame.
const LINE: u64 = 1024;
/// Most pixels of a frame.
const MOST_PIXELS: usize = 1 << 25;

/// The storage of the samples of each frame.
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    pub name: String,
    /// Rows and columns of pixels.
    pub size: [usize; 2],
    /// Luma pixels along y and x per color-difference sample. It is `None` for gray videos.
    pub chroma: Option<[usize; 2]>,
    /// True if color differences are at the position of the left of two pixels, and not between them.
    left: bool,
    pub bits: u32,
    pub full: bool,
    /// The matrix that the header states.
    pub matrix: Option<Matrix>,
    /// True if ffmpeg wrote the header. It keeps the matrix of its source and does not state it.
    pub of_ffmpeg: bool,
}

/// The source of a video's bytes.
enum From {
    File { file: BufReader<File>, length: u64 },
    Decoder(Decoder),
}

/// An open video, positioned at the header of a frame.
pub(crate) struct Video {
    pub layout: Layout,
    /// The first line, without its end.
    pub head: String,
    from: From,
}

impl Layout {
    /// Reads the first line of a video.
    fn parse(name: String, head: &str) -> Result<Self, SceneError> {
        let (size, chroma, matrix) = ([0; 2], Some([2, 2]), None);
        let mut layout = Self { name, size, chroma, left: false, bits: 8, full: false, matrix, of_ffmpeg: false };
        let words = head
            .strip_prefix("YUV4MPEG2 ")
            .ok_or_else(|| layout.corrupt(reason!("not-y4m", "it does not start with YUV4MPEG2")))?;
        for word in words.split_ascii_whitespace() {
            let (key, value) = word.split_at(word.chars().next().map_or(0, char::len_utf8));
            let number = || value.parse().ok().filter(|n| (1..=65536).contains(n));
            match key {
                "W" => layout.size[1] = number().unwrap_or(0),
                "H" => layout.size[0] = number().unwrap_or(0),
                "C" => layout.space(value)?,
                "I" => check_interlacing(value).map_err(|reason| layout.corrupt(reason))?,
                "A" => check_aspect(value).map_err(|reason| layout.corrupt(reason))?,
                "X" if value == "COLORRANGE=FULL" => layout.full = true,
                "X" if value.starts_with("YSCSS=") => layout.of_ffmpeg = true,
                "X" => {
                    if let Some(name) = value.strip_prefix("COLORMATRIX=") {
                        layout.matrix = Some(Matrix::named(name).map_err(|reason| layout.corrupt(reason))?);
                    }
                }
                _ => {}
            }
        }
        let [height, width] = layout.size;
        if height == 0 || width == 0 || height * width > MOST_PIXELS {
            return Err(layout.corrupt(reason!(
                "video-size",
                "its first line is {head:?}, but W and H must be columns and rows of at most {} Mpx",
                MOST_PIXELS >> 20
            )));
        }
        Ok(layout)
    }

    pub fn corrupt(&self, reason: Reason) -> SceneError {
        SceneError::Corrupt { file: self.name.clone(), reason }
    }

    /// Reads the format of the samples, such as `420jpeg`, `444p10` or `mono16`.
    fn space(&mut self, text: &str) -> Result<(), SceneError> {
        let (kind, bits) = match text.strip_prefix("mono") {
            Some(bits) => ("mono", bits),
            // The header may have any bytes, and a character more than one.
            None => text.split_at_checked(3).unwrap_or((text, "")),
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

    /// Returns rows and columns of a plane.
    pub fn plane(&self, chroma: bool) -> [usize; 2] {
        match self.chroma.filter(|_| chroma) {
            Some(times) => [0, 1].map(|i| self.size[i].div_ceil(times[i])),
            None => self.size,
        }
    }

    /// Returns the bytes of a frame.
    pub fn bytes(&self) -> usize {
        let pixels = |chroma| self.plane(chroma).iter().product::<usize>();
        let samples = pixels(false) + if self.chroma.is_some() { 2 * pixels(true) } else { 0 };
        samples * if self.bits > 8 { 2 } else { 1 }
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
    pub fn luma(&self, bytes: &[u8], i: usize) -> f32 {
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

    /// Returns the planes of `colors` of a frame in linear light.
    pub fn planes(&self, bytes: &[u8], colors: &[Color], matrix: Matrix) -> Vec<Vec<f32>> {
        let [height, width] = self.size;
        let row = |y: usize| -> Vec<[f32; 3]> { (0..width).map(|x| self.light(bytes, y, x, matrix)).collect() };
        let light: Vec<[f32; 3]> = (0..height).into_par_iter().flat_map_iter(row).collect();
        colors.iter().map(|color| light.iter().map(|pixel| pixel[color.channel()]).collect()).collect()
    }

    /// Returns the luma of a frame, as values of 16 bits if the source `is_deep`, and otherwise of 8.
    pub fn stored(&self, bytes: &[u8], is_deep: bool) -> GrayValues {
        let [height, width] = self.size;
        let (kind, full) = if is_deep { (Kind::Words, 65535.0) } else { (Kind::Bytes, 255.0) };
        let values = (0..height * width).map(|i| (self.luma(bytes, i).clamp(0.0, 1.0) * full).round()).collect();
        GrayValues { height, width, kind, values, range: Some([0.0, full]) }
    }
}

impl Video {
    /// Opens a `.y4m` file.
    pub fn open(path: &Path) -> Result<Self, SceneError> {
        let unreadable = |e: std::io::Error| SceneError::unreadable(path, &e);
        let file = read::open(path).map_err(unreadable)?;
        let length = file.metadata().map_err(unreadable)?.len();
        let kind = FileKind::of(path).map_err(unreadable)?;
        if kind != FileKind::Y4m {
            return Err(FileError::of_kind(path, kind, Wanted::Scene).into());
        }
        Self::begun(path, From::File { file: BufReader::new(file), length })
    }

    /// Reads the video that a decoder makes of a file.
    pub fn decoded(path: &Path, decoder: Decoder) -> Result<Self, SceneError> {
        Self::begun(path, From::Decoder(decoder))
    }

    fn begun(path: &Path, mut from: From) -> Result<Self, SceneError> {
        let name = path.display().to_string();
        let head = from.line(&name)?;
        if let (true, From::Decoder(decoder)) = (head.is_empty(), &mut from) {
            decoder.check_end(path)?;
        }
        Ok(Self { layout: Layout::parse(name, &head)?, head, from })
    }

    /// Goes to the samples of a frame, and returns true if there is one.
    fn begin(&mut self) -> Result<bool, SceneError> {
        let line = self.from.line(&self.layout.name)?;
        if line.is_empty() {
            self.from.check_end(&self.layout.name)?;
            return Ok(false);
        }
        if line.split(' ').next() != Some("FRAME") {
            return Err(self.layout.corrupt(reason!(
                "frame-start",
                "a frame does not start with FRAME, so the one before has another size"
            )));
        }
        if let From::File { file, length } = &mut self.from {
            let at = file.stream_position().map_err(|e| failed(&self.layout.name, &e))?;
            if at + self.layout.bytes() as u64 > *length {
                return Err(self.layout.corrupt(reason!(
                    "frame-cut-short",
                    "its last frame is cut short, so copy it again, or take an earlier frame by ?frame=N"
                )));
            }
        }
        Ok(true)
    }

    pub fn skip(&mut self) -> Result<bool, SceneError> {
        let there = self.begin()?;
        if there {
            let bytes = self.layout.bytes() as u64;
            self.from.skip(bytes).map_err(|e| failed(&self.layout.name, &e))?;
        }
        Ok(there)
    }

    /// Reads the samples of a frame, counted from the current one.
    pub fn frame(&mut self, frame: usize) -> Result<Vec<u8>, SceneError> {
        for before in 0..=frame {
            let is_there = if before < frame { self.skip()? } else { self.begin()? };
            if !is_there {
                return Err(self.layout.corrupt(reason!(
                    "no-such-frame",
                    "it has {before} frames, but frame {frame} is requested (counted from 0)"
                )));
            }
        }
        let mut bytes = vec![0; self.layout.bytes()];
        self.from.reader().read_exact(&mut bytes).map_err(|e| failed(&self.layout.name, &e))?;
        Ok(bytes)
    }
}

fn failed(name: &str, error: &std::io::Error) -> SceneError {
    SceneError::unreadable(Path::new(name), error)
}

impl From {
    fn reader(&mut self) -> &mut dyn BufRead {
        match self {
            Self::File { file, .. } => file,
            Self::Decoder(decoder) => decoder.reader(),
        }
    }

    /// Returns the next line without its end. It is empty at the end of the video.
    fn line(&mut self, name: &str) -> Result<String, SceneError> {
        let mut line = Vec::new();
        let read = self.reader().take(LINE).read_until(b'\n', &mut line);
        read.map_err(|e| failed(name, &e))?;
        if line.pop().is_some_and(|last| last != b'\n') {
            let reason = reason!("not-video", "it is not a video, because a line has no end");
            return Err(SceneError::Corrupt { file: name.into(), reason });
        }
        Ok(String::from_utf8_lossy(&line).into_owned())
    }

    fn skip(&mut self, bytes: u64) -> std::io::Result<()> {
        match self {
            Self::File { file, .. } => file.seek_relative(bytes as i64),
            Self::Decoder(decoder) => {
                let skipped = std::io::copy(&mut decoder.reader().take(bytes), &mut std::io::sink())?;
                if skipped == bytes { Ok(()) } else { Err(std::io::ErrorKind::UnexpectedEof.into()) }
            }
        }
    }

    /// Checks at the end of the frames that a decoder has decoded all.
    fn check_end(&mut self, name: &str) -> Result<(), SceneError> {
        match self {
            Self::File { .. } => Ok(()),
            Self::Decoder(decoder) => decoder.check_end(Path::new(name)),
        }
    }
}
