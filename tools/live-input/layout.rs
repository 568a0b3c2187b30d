//! Defines the place of each number (docs/live-input.md) in words of 8 bytes, and converts words to values.
//!
//! The functions are pure. They check copies, which no other process changes.

use crate::content::{HEADER, PAGE};
use crate::{
    Content, Dioptres, FrameFault, FrameInfo, Kind, LiveError, MOST, Offer, Pupil, Request, Sample, Transfer, Wanted,
};

pub(crate) const MAGIC: u64 = u64::from_le_bytes(*b"EYELIVE1");
pub(crate) const VERSION: u32 = 1;
/// The words of the region's own numbers.
pub(crate) const OFFER_WORDS: usize = 13;
/// The word with the held slot.
pub(crate) const HELD: usize = 128 / 8;
/// The word that is 1 if the display has memory of a device to share.
pub(crate) const SHARES: usize = 104 / 8;
/// The word by which the application requests that memory.
pub(crate) const WANTED: usize = 136 / 8;
/// The first word of the description of that memory.
pub(crate) const DEVICE: usize = 1024 / 8;
/// The first word of the request, which is its sequence.
pub(crate) const REQUEST: usize = 192 / 8;
pub(crate) const REQUEST_WORDS: usize = 15;
/// The words of a slot before its samples. The first is its sequence.
pub(crate) const SLOT_HEADER: usize = HEADER / 8;
/// The words of the header that have a meaning.
pub(crate) const HEADER_WORDS: usize = 48;
/// The place of the dioptres in the header.
const DIOPTRES: usize = 16;
/// The largest allowed step of frame numbers.
pub(crate) const STEP: u64 = 1 << 32;

/// A copy of one header.
pub(crate) type Header = [u64; HEADER_WORDS];

/// Returns the first word of a slot.
pub(crate) fn slot_word(offer: &Offer, slot: usize) -> usize {
    (PAGE + slot * offer.slot_stride()) / 8
}

pub(crate) fn pair(low: u32, high: u32) -> u64 {
    u64::from(low) | u64::from(high) << 32
}

pub(crate) fn halves(word: u64) -> [u32; 2] {
    [word as u32, (word >> 32) as u32]
}

fn color_bits(colors: [bool; 3]) -> u32 {
    colors.iter().enumerate().map(|(i, c)| u32::from(*c) << i).sum()
}

/// Returns the words at the beginning of a region.
pub(crate) fn offer_words(offer: &Offer) -> [u64; OFFER_WORDS] {
    let kinds = offer.kinds.iter().fold(0, |bits, kind| bits | *kind as u32);
    [
        MAGIC,
        pair(VERSION, offer.slots),
        offer.region_bytes(),
        PAGE as u64,
        offer.slot_stride() as u64,
        offer.slot_bytes() as u64,
        pair(offer.size[0], offer.size[1]),
        pair(offer.views[0], offer.views[1]),
        pair(offer.layers, color_bits(offer.colors)),
        pair(kinds, 0),
        offer.pixel_angle.to_bits(),
        offer.eyebox_mm[0].to_bits(),
        offer.eyebox_mm[1].to_bits(),
    ]
}

/// Reads the offer of a display from the words at the beginning of its region.
///
/// # Errors
/// Returns [`LiveError::Damaged`] or [`LiveError::Offer`] for invalid words.
pub(crate) fn read_offer(words: &[u64; OFFER_WORDS], length: u64) -> Result<Offer, LiveError> {
    let damaged = |reason: String| Err(LiveError::Damaged(reason));
    let [version, slots] = halves(words[1]);
    if words[0] != MAGIC || version != VERSION {
        return damaged(format!("no live input of version {VERSION}"));
    }
    let [layers, colors] = halves(words[8]);
    let kinds = halves(words[9])[0];
    let offer = Offer {
        size: halves(words[6]),
        colors: [0, 1, 2].map(|i| colors >> i & 1 == 1),
        kinds: Kind::ALL.into_iter().filter(|kind| kinds & *kind as u32 != 0).collect(),
        views: halves(words[7]),
        layers,
        slots,
        pixel_angle: f64::from_bits(words[10]),
        eyebox_mm: [f64::from_bits(words[11]), f64::from_bits(words[12])],
    };
    offer.check()?;
    if offer_words(&offer) != *words || offer.region_bytes() != length {
        return damaged(format!("its numbers do not fit {length} bytes, or each other"));
    }
    Ok(offer)
}

/// Returns the words of a request after its sequence.
pub(crate) fn request_words(request: &Request) -> [u64; REQUEST_WORDS - 1] {
    let Request { pupil, wanted, .. } = request;
    [
        request.number,
        request.lit_ns as u64,
        request.period_ns,
        pupil.center_mm[0].to_bits(),
        pupil.center_mm[1].to_bits(),
        pupil.diameter_mm.to_bits(),
        pupil.focus_dioptres.to_bits(),
        pupil.velocity_mm_s[0].to_bits(),
        pupil.velocity_mm_s[1].to_bits(),
        pair(wanted.kind as u32, u32::from(pupil.tracked)),
        pair(wanted.views[0], wanted.views[1]),
        wanted.pitch_mm.to_bits(),
        wanted.center_mm[0].to_bits(),
        wanted.center_mm[1].to_bits(),
    ]
}

/// Reads a request from these words. Returns `None` if its kind is unknown.
pub(crate) fn read_request(words: &[u64; REQUEST_WORDS - 1]) -> Option<Request> {
    let float = |i: usize| f64::from_bits(words[i]);
    let [kind, tracked] = halves(words[9]);
    let pupil = Pupil {
        center_mm: [float(3), float(4)],
        diameter_mm: float(5),
        focus_dioptres: float(6),
        velocity_mm_s: [float(7), float(8)],
        tracked: tracked == 1,
    };
    let kind = Kind::ALL.into_iter().find(|k| *k as u32 == kind)?;
    let wanted = Wanted { kind, views: halves(words[10]), pitch_mm: float(11), center_mm: [float(12), float(13)] };
    Some(Request { number: words[0], lit_ns: words[1] as i64, period_ns: words[2], pupil, wanted })
}

/// Returns a slot's header. Its sequence, the first word, is 0.
pub(crate) fn header_words(offer: &Offer, info: &FrameInfo, number: u64) -> Header {
    let mut words = [0; HEADER_WORDS];
    let (mut grid, mut pitch_mm, mut layers) = ([1, 1], 0.0f64, 0);
    match &info.content {
        Content::Views { grid: views, pitch_mm: pitch } => (grid, pitch_mm) = (*views, *pitch),
        Content::ColorAndDepth => {}
        Content::Layers(dioptres) => {
            layers = dioptres.count;
            for (word, two) in words[DIOPTRES..].iter_mut().zip(dioptres.values.chunks_exact(2)) {
                *word = pair(two[0].to_bits(), two[1].to_bits());
            }
        }
    }
    let start = [
        number,
        info.request,
        info.content_time_ns as u64,
        pair(info.content.kind() as u32, info.sample as u32),
        pair(info.transfer as u32, color_bits(offer.colors)),
        pair(offer.size[0], offer.size[1]),
        pair(grid[0], grid[1]),
        pitch_mm.to_bits(),
        info.center_mm[0].to_bits(),
        info.center_mm[1].to_bits(),
        pair(layers, u32::from(info.on_device)),
        offer.bytes(&info.content, info.sample)[0] as u64,
    ];
    words[1..=start.len()].copy_from_slice(&start);
    words
}

/// Reads a copied header, if all of it is valid for this offer. `shared` is true if the display shares memory of a
/// device.
///
/// # Errors
/// Returns the first [`FrameFault`] of the header.
pub(crate) fn read_header(words: &Header, offer: &Offer, shared: bool) -> Result<FrameInfo, FrameFault> {
    let number = |what, found: u32, least: u32, most: u32| match (least..=most).contains(&found) {
        true => Ok(found),
        false => Err(FrameFault::Number { what, found: found.into(), least: least.into(), most: most.into() }),
    };
    let code = |what, found: u32, must| FrameFault::Code { what, found: found.into(), must };
    let length = |what, word: usize, least: f64| {
        let (found, must) = (f64::from_bits(words[word]), "a finite number, at most a meter");
        let right = found.is_finite() && found >= least && found <= 1000.0;
        if right { Ok(found) } else { Err(FrameFault::Length { what, found, must }) }
    };
    let ([kind, sample], [transfer, colors]) = (halves(words[4]), halves(words[5]));
    let kind = offer.kinds.iter().find(|k| **k as u32 == kind);
    let kind = *kind.ok_or(code("kind", halves(words[4])[0], "one that the display takes"))?;
    let sample = Sample::ALL.into_iter().find(|s| *s as u32 == sample).ok_or(code("sample", sample, "1 to 4"))?;
    let transfer = match (transfer, sample) {
        (1, _) => Transfer::Linear,
        (2, Sample::U8 | Sample::U16) => Transfer::Srgb,
        (2, _) => return Err(code("transfer", transfer, "1, linear, for floats")),
        _ => return Err(code("transfer", transfer, "1, linear, or 2, sRGB")),
    };
    let own = color_bits(offer.colors);
    number("colors", colors, own, own)?;
    let [rows, columns] = halves(words[6]);
    number("rows", rows, offer.size[0], offer.size[0])?;
    number("columns", columns, offer.size[1], offer.size[1])?;
    let most = if kind == Kind::Views { offer.views } else { [1, 1] };
    let [view_rows, view_columns] = halves(words[7]);
    let grid = [number("rows of views", view_rows, 1, most[0])?, number("columns of views", view_columns, 1, most[1])?];
    let most_place = u32::from(shared && kind != Kind::Layers);
    let on_device = number("the place of the samples", halves(words[11])[1], 0, most_place)? == 1;
    let least_layers = u32::from(kind == Kind::Layers);
    let layers = number("layers", halves(words[11])[0], least_layers, least_layers * offer.layers)?;
    let center_mm = [length("the camera's x, mm,", 9, -1000.0)?, length("the camera's y, mm,", 10, -1000.0)?];
    let content = match kind {
        Kind::Views => Content::Views { grid, pitch_mm: length("the view pitch, mm,", 8, 1e-6)? },
        Kind::ColorAndDepth => Content::ColorAndDepth,
        Kind::Layers => Content::Layers(dioptres(words, layers)?),
    };
    let bytes = offer.bytes(&content, sample)[0] as u64;
    if words[12] != bytes {
        return Err(FrameFault::Number { what: "bytes", found: words[12], least: bytes, most: bytes });
    }
    let (request, content_time_ns) = (words[2], words[3] as i64);
    Ok(FrameInfo { content, sample, transfer, request, content_time_ns, center_mm, on_device })
}

fn dioptres(words: &Header, layers: u32) -> Result<Dioptres, FrameFault> {
    let mut values = [0.0; MOST as usize];
    for (two, word) in values.chunks_exact_mut(2).zip(&words[DIOPTRES..]) {
        two.copy_from_slice(&halves(*word).map(f32::from_bits));
    }
    let all = Dioptres { count: layers, values };
    let mut before = f32::NEG_INFINITY;
    for found in all.as_slice() {
        if !(found.abs() <= 100.0 && *found > before) {
            let must = "-100 to 100, and more than the layer behind";
            return Err(FrameFault::Length { what: "a layer's dioptres", found: f64::from(*found), must });
        }
        before = *found;
    }
    // Values after the last layer have no meaning.
    Ok(Dioptres::new(all.as_slice()))
}
