//! Computes the 24 patterns that show the planes of a video frame.

use super::error::PlmError;
use super::values::{Leds, Pattern};
use eyebox_optics::PlaneTrigger;

/// Bit planes of a video frame. The controller numbers them G0 to G7, R0 to R7, B0 to B7.
pub const PLANES: usize = 24;

/// Share of a video frame that patterns leave free, because the clocks of the video source and of the controller
/// differ. Two crystals of 50 ppm each differ by this at most.
const CLOCK_TOLERANCE: f64 = 100e-6;

/// Returns the plane that shows a bit of an RGB pixel, and the bit that a plane shows. Bits 0 to 7 are red, 8 to 15 green
/// and 16 to 23 blue. The first two channels exchange their places, so the function is its own inverse.
pub fn plane_of_bit(bit: usize) -> usize {
    [8, 0, 16][bit / 8 % 3] + bit % 8
}

/// The outputs for light sources of a hologram with three colors of eight planes in the order green, red, blue.
pub fn usual_leds() -> [Leds; PLANES] {
    std::array::from_fn(|plane| [Leds::GREEN, Leds::RED, Leds::BLUE][plane / 8])
}

/// Returns the exposure of each plane (us) at a rate. The sum of all exposures and dark times must fit a video frame,
/// otherwise the controller aborts it.
///
/// # Errors
/// [`PlmError::Rate`] if it is not 1 to 1000 Hz.
pub fn exposure_us(rate_hz: f64) -> Result<u32, PlmError> {
    if !(1.0..=1000.0).contains(&rate_hz) {
        return Err(PlmError::Rate { rate_hz });
    }
    let frame_us = 1e6 / rate_hz * (1.0 - CLOCK_TOLERANCE);
    Ok((frame_us / PLANES as f64).floor() as u32)
}

/// Returns the definitions of the patterns. The first one waits for the video frame.
pub(super) fn patterns(exposure_us: u32, leds: &[Leds; PLANES], marked: PlaneTrigger) -> [Pattern; PLANES] {
    std::array::from_fn(|plane| Pattern {
        index: plane as u16,
        exposure_us,
        dark_us: 0,
        clears: false,
        depth: 1,
        leds: leds[plane],
        waits: plane == 0,
        trigger_out_2: match marked {
            PlaneTrigger::Frame => plane == 0,
            PlaneTrigger::Off => false,
            _ => true,
        },
        plane: plane as u8,
    })
}

/// Returns the data that sets the number of patterns and repeats them for ever.
pub(super) fn count(patterns: u16) -> [u8; 6] {
    let [low, high] = patterns.to_le_bytes();
    [low, high, 0, 0, 0, 0]
}
