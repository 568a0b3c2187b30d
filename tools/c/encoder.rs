//! The functions that encode holograms as the video frames of an SLM.

use crate::arrays::{given, hand_over, put, room};
use crate::display::colors;
use crate::failure::{Failure, answer, free};
use crate::{EyeboxDisplay, EyeboxHologram, EyeboxStatus};
use eyebox::encode::{Encoder, PhaseSet};
use std::ffi::c_void;
use std::mem::MaybeUninit;

/// An encoder. It turns phases of one shape into the video frames of one display. It never changes.
pub struct EyeboxEncoder(Encoder);

/// The shape of the video frames of a hologram. Their bytes are an array (frame, row, column, channel) of 8-bit values.
/// The frames are in the order in which the display shows them.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxVideo {
    /// Number of video frames.
    pub frames: usize,
    /// Rows of each video frame (pixels).
    pub rows: usize,
    /// Columns of each video frame (pixels).
    pub columns: usize,
    /// Number of channels, which is 1 (gray) or 3 (red, green, blue).
    pub channels: usize,
    /// Size of the memory that a call fills, in bytes. It holds all video frames for `eyebox_encode`, and one video
    /// frame for `eyebox_session_tick`.
    pub bytes: usize,
}

/// Makes an encoder for a display and for holograms with the given colors and number of sub-frames. Set `colors` to a
/// sum of EYEBOX_RED, EYEBOX_GREEN and EYEBOX_BLUE, or to 0 for all colors of the display. Set `frames` to the number
/// of sub-frames per color, 1 to 4096. This function reads the calibration files of the display, and later calls do
/// not. Free the encoder with `eyebox_encoder_free`.
///
/// Fails with EYEBOX_STATUS_DISPLAY if the display lacks a color. Fails with EYEBOX_STATUS_ENCODE if the display cannot
/// show these colors and sub-frames, or if its calibration is wrong.
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

/// Writes the shape and size of the video frames of `eyebox_encode` into `video`.
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

/// Encodes a hologram into `video`, which is memory of the caller with the number of `bytes` from
/// `eyebox_encoder_video`. Fails with EYEBOX_STATUS_ARGUMENT if the hologram has other colors or another size than the
/// encoder, or if `bytes` differs. Fails with EYEBOX_STATUS_ENCODE if the number of sub-frames differs.
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
            let right = format!("the colors of the encoder, {:?}", encoder.colors());
            return Err(Failure::argument("the hologram's colors", format!("{:?}", hologram.named_colors()), right));
        }
        let size = [hologram.height, hologram.width];
        if size != encoder.hologram_size() {
            let right = format!("{:?}, as the display takes them", encoder.hologram_size());
            return Err(Failure::argument("the hologram's rows and columns", format!("{size:?}"), right));
        }
        // SAFETY: The header requires memory of the stated size.
        let video = unsafe { room(video.cast::<u8>(), bytes, encoder.bytes(), "video") }?;
        video.fill(MaybeUninit::new(0));
        // SAFETY: The line above wrote every byte.
        let video = unsafe { &mut *(std::ptr::from_mut(video) as *mut [u8]) };
        let phases: Vec<&[f32]> = hologram.colors.iter().map(|c| &c.phases[..]).collect();
        Ok(encoder.encode_bytes(&PhaseSet::new(&phases, size)?, video)?)
    })
}

/// Frees an encoder. Null is allowed and has no effect.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_encoder_free(encoder: Option<Box<EyeboxEncoder>>) {
    free(encoder);
}
