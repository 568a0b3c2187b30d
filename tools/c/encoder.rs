//! What the SLM receives.

use crate::arrays::{given, hand_over, put, room};
use crate::display::colors;
use crate::failure::{Failure, answer, free};
use crate::{EyeboxDisplay, EyeboxHologram, EyeboxStatus};
use eyebox::encode::{Encoder, PhaseSet};
use std::ffi::c_void;
use std::mem::MaybeUninit;

/// An encoder: phases of one shape to the video frames of one display. It never changes.
pub struct EyeboxEncoder(Encoder);

/// The video frames of a hologram: (frame, row, column, channel), 8 bits each, in the order in which they are shown.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxVideo {
    /// How many.
    pub frames: usize,
    /// Rows of a frame.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// 1 (grey) or 3 (red, green, blue).
    pub channels: usize,
    /// Bytes of all of them.
    pub bytes: usize,
}

/// An encoder for a display, for holograms of these colours (a sum of EYEBOX_RED, EYEBOX_GREEN and EYEBOX_BLUE; 0 for all of the
/// display's) and so many sub-frames. The display's calibration is read now, once.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_encoder_new(
    display: Option<&EyeboxDisplay>,
    colors: u32,
    frames: usize,
    encoder: Option<&mut MaybeUninit<*mut EyeboxEncoder>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(encoder, || {
            let display = &given(display, "display")?.0;
            if !(1..=4096).contains(&frames) {
                return Err(Failure::argument("frames", frames, "1 to 4096"));
            }
            Ok(EyeboxEncoder(Encoder::new(display, &self::colors(display, colors)?, frames)?))
        })
    })
}

/// The sizes of what `eyebox_encode` writes.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_encoder_video(
    encoder: Option<&EyeboxEncoder>,
    video: Option<&mut MaybeUninit<EyeboxVideo>>,
) -> EyeboxStatus {
    answer(|| {
        put(video, || {
            let encoder = &given(encoder, "encoder")?.0;
            let [frames, rows, columns, channels] = encoder.video_shape();
            Ok(EyeboxVideo { frames, rows, columns, channels, bytes: encoder.bytes() })
        })
    })
}

/// Encodes a hologram into memory of the caller's, of as many bytes as `eyebox_encoder_video` says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_encode(
    encoder: Option<&EyeboxEncoder>,
    hologram: Option<&EyeboxHologram>,
    video: *mut c_void,
    bytes: usize,
) -> EyeboxStatus {
    answer(|| {
        let (encoder, hologram) = (&given(encoder, "encoder")?.0, &given(hologram, "hologram")?.hologram);
        if hologram.named_colors() != encoder.colors() {
            let right = format!("those of the encoder, {:?}", encoder.colors());
            return Err(Failure::argument("the hologram's colours", format!("{:?}", hologram.named_colors()), right));
        }
        let size = [hologram.height, hologram.width];
        if size != encoder.hologram_size() {
            let right = format!("{:?}, as the display takes them", encoder.hologram_size());
            return Err(Failure::argument("the hologram's rows and columns", format!("{size:?}"), right));
        }
        // SAFETY: the header asks callers for as much memory as they say.
        let video = unsafe { room(video.cast::<u8>(), bytes, encoder.bytes(), "video") }?;
        video.fill(MaybeUninit::new(0));
        // SAFETY: every byte was just written.
        let video = unsafe { &mut *(std::ptr::from_mut(video) as *mut [u8]) };
        let phases: Vec<&[f32]> = hologram.colors.iter().map(|c| &c.phases[..]).collect();
        Ok(encoder.encode_bytes(&PhaseSet::new(&phases, size)?, video)?)
    })
}

/// Frees an encoder.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_encoder_free(encoder: Option<Box<EyeboxEncoder>>) {
    free(encoder);
}
