//! Reads TIFF pictures in gray or color, with or without alpha, of 8 or 16 bits or floats.

use super::{FileError, Pixels, Primaries, Samples, read};
use crate::error::Reason;
use crate::reason;
use std::{fs::File, io::BufReader, path::Path};
use tiff::ColorType;
use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::{SampleFormat, Tag};

type Opened = Decoder<BufReader<File>>;

fn open(file: &Path) -> Result<Opened, FileError> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = 1 << 30;
    limits.intermediate_buffer_size = 1 << 30;
    Ok(Decoder::new(read::buffered(file)?).map_err(|e| FileError::damaged(file, e))?.with_limits(limits))
}

/// Returns rows and columns of the first page.
pub(super) fn size(file: &Path) -> Result<[usize; 2], FileError> {
    let (width, height) = open(file)?.dimensions().map_err(|e| FileError::damaged(file, e))?;
    if (1..=65536).contains(&width) && (1..=65536).contains(&height) {
        return Ok([height as usize, width as usize]);
    }
    Err(FileError::content(
        file,
        reason!("pixels", "it has {height} x {width} pixels: 1 to 65536 rows and columns are read"),
    ))
}

/// Returns the EXIF orientation that the tag states. It is 1 without a valid tag.
pub(super) fn orientation(file: &Path) -> Result<u8, FileError> {
    let found = open(file)?.find_tag_unsigned::<u8>(Tag::Orientation).ok().flatten();
    Ok(found.filter(|n| (1..=8).contains(n)).unwrap_or(1))
}

/// Returns true if the values are floats.
pub(super) fn is_float(file: &Path) -> bool {
    let format = open(file).map(|mut tiff| tiff.find_tag_unsigned_vec::<u16>(Tag::SampleFormat));
    let float = SampleFormat::IEEEFP.to_u16();
    format.is_ok_and(|found| found.is_ok_and(|f| f.is_some_and(|f| f.contains(&float))))
}

/// Tags of the chromaticities of white and of red, green and blue.
const WHITE_POINT: Tag = Tag::Unknown(318);
const PRIMARIES: Tag = Tag::Unknown(319);

/// Returns the color primaries that the tags state. If only one of the two is there, the other is the one of sRGB.
fn primaries(tiff: &mut Opened) -> Option<Primaries> {
    let mut rationals = |tag: Tag| match tiff.find_tag(tag) {
        Ok(Some(Value::List(all))) => all.iter().map(rational).collect::<Option<Vec<f64>>>(),
        _ => None,
    };
    let (white, colors) = (rationals(WHITE_POINT), rationals(PRIMARIES));
    let [red, green, blue, usual] = Primaries::SRGB.0;
    let white = white.as_deref().and_then(|v| <[f64; 2]>::try_from(v).ok());
    let colors = colors.as_deref().and_then(|v| <[f64; 6]>::try_from(v).ok());
    if white.is_none() && colors.is_none() {
        return None;
    }
    let [red, green, blue] = colors.map_or([red, green, blue], |[a, b, c, d, e, f]| [[a, b], [c, d], [e, f]]);
    Some(Primaries([red, green, blue, white.unwrap_or(usual)]))
}

fn rational(value: &Value) -> Option<f64> {
    match value {
        Value::Rational(above, below) => Some(f64::from(*above) / f64::from(*below)),
        Value::Float(v) => Some(f64::from(*v)),
        _ => None,
    }
}

/// Reads the picture, which must have one page.
pub(super) fn read(file: &Path) -> Result<Pixels, FileError> {
    let wrong = |reason: Reason| Err(FileError::content(file, reason));
    let [height, width] = size(file)?;
    let mut tiff = open(file)?;
    let kind = tiff.colortype().map_err(|e| FileError::damaged(file, e))?;
    let extra = tiff.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples).ok().flatten().unwrap_or_default();
    let is_alpha = matches!(extra.first(), Some(1 | 2));
    let channels = match kind {
        ColorType::Gray(_) => 1,
        ColorType::GrayA(_) => 2,
        ColorType::Multiband { num_samples: 2, .. } if is_alpha => 2,
        ColorType::RGB(_) => 3,
        ColorType::RGBA(_) => 4,
        ColorType::Multiband { num_samples, .. } => {
            let n = num_samples;
            return wrong(reason!(
                "tiff-channels",
                "it has {n} channels that are not colors: save gray or red, green, blue"
            ));
        }
        other => {
            return wrong(reason!(
                "tiff-colors",
                "its colors are {other:?}: save it as gray or RGB, as by magick -colorspace"
            ));
        }
    };
    if kind.bit_depth() < 8 {
        return wrong(reason!("tiff-bits", "it has {} bits per value: save it with 8 or 16", kind.bit_depth()));
    }
    let profile = tiff.get_tag_u8_vec(Tag::IccProfile).ok();
    let primaries = primaries(&mut tiff);
    let mut decoded = DecodingResult::U8(Vec::new());
    let layout = tiff.read_image_to_buffer(&mut decoded).map_err(|e| FileError::damaged(file, e))?;
    let planes = if layout.complete_len > layout.len { channels } else { 1 };
    if second_page(&mut tiff, [height, width]) {
        return wrong(reason!("pages", "it has several pages: save each as a file of its own"));
    }
    let samples = match decoded {
        DecodingResult::U8(v) => Samples::U8(v),
        DecodingResult::U16(v) => Samples::U16(v),
        DecodingResult::F16(v) => Samples::F32(v.into_iter().map(|v| v.to_f32()).collect()),
        DecodingResult::F32(v) => Samples::F32(v),
        DecodingResult::F64(v) => Samples::F32(v.into_iter().map(|v| v as f32).collect()),
        _ => {
            return wrong(reason!(
                "tiff-values",
                "its values are signed or wider than 16 bits: save 8 or 16 bits without a sign, or floats"
            ));
        }
    };
    let found = samples.count();
    // Planes follow one after the other.
    let (is_whole, pixels) = (found.is_multiple_of(planes), found / planes);
    let place = |i: usize| (0..planes).map(move |plane| plane * pixels + i);
    let samples = if planes > 1 && is_whole { samples.at((0..pixels).flat_map(place)) } else { samples };
    if found != height * width * channels {
        return wrong(reason!(
            "tiff-cut-short",
            "{height} x {width} x {channels} values are stated, and {found} are there"
        ));
    }
    let premultiplied = extra.first() == Some(&1);
    Ok(Pixels { premultiplied, profile, primaries, ..Pixels::new([height, width], channels, samples) })
}

/// Returns true if another page of the same size follows. Smaller copies and thumbnails do not count.
fn second_page(tiff: &mut Opened, [height, width]: [usize; 2]) -> bool {
    // A chain of pages may lead back to itself, so the pages after the second one are not visited.
    tiff.more_images()
        && tiff.next_image().is_ok()
        && tiff.dimensions().is_ok_and(|(w, h)| (h as usize, w as usize) == (height, width))
}
