//! Adds corrections and gratings to the phase of every pixel.
//!
//! Sums are in 2^-32 turns. So adding wraps exactly, and subtracting the same value leaves no error.

use super::{EncodeError, turning::Turning};
use crate::files::{FileError, FileKind, read_grey, read_npy};
use crate::optics::{Color, Correction, Display, Grating, Orientation};
use eyebox_base::reason;

/// Returns the sum of all corrections and gratings of this color, per pixel of the SLM. It is empty if there are none.
///
/// # Errors
/// Returns [`EncodeError::File`] for a file that cannot be read, or has the wrong size.
pub(super) fn offsets(display: &Display, color: Color, turning: &Turning) -> Result<Vec<u32>, EncodeError> {
    let ours = |of: Option<Color>| of.is_none_or(|c| c == color);
    let corrections: Vec<_> = display.encoding.correction.iter().filter(|c| ours(c.color)).collect();
    let gratings: Vec<_> = display.encoding.grating.iter().filter(|g| ours(g.color)).collect();
    if corrections.is_empty() && gratings.is_empty() {
        return Ok(Vec::new());
    }
    let (height, width) = (display.height, display.width);
    let mut sum = vec![0u32; height * width];
    for correction in corrections {
        let along = match correction.orientation {
            Orientation::Hologram => turning.hologram,
            Orientation::Slm => [height, width],
        };
        let image = read(correction, along)?;
        for (i, sum) in sum.iter_mut().enumerate() {
            let [row, column] = match correction.orientation {
                Orientation::Hologram => turning.source(i / width, i % width),
                Orientation::Slm => [i / width, i % width],
            };
            let value = image[row * along[1] + column];
            *sum = if correction.sign < 0 { sum.wrapping_sub(value) } else { sum.wrapping_add(value) };
        }
    }
    for grating in gratings {
        for (i, sum) in sum.iter_mut().enumerate() {
            *sum = sum.wrapping_add(blaze(grating, turning.source(i / width, i % width)));
        }
    }
    Ok(sum)
}

/// Converts a number of turns to 2^-32 turns, wrapped.
pub(super) fn units(turns: f64) -> u32 {
    ((turns - turns.floor()) * 4_294_967_296.0).round() as u64 as u32
}

/// Returns the grating's phase at a pixel. It is zero at the first pixel.
fn blaze(grating: &Grating, [row, column]: [usize; 2]) -> u32 {
    // Right angles are exact.
    let (down, right) = match grating.direction_deg.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        angle => angle.to_radians().sin_cos(),
    };
    units((down * row as f64 + right * column as f64) / grating.period_px)
}

fn read(correction: &Correction, [height, width]: [usize; 2]) -> Result<Vec<u32>, EncodeError> {
    let file = &correction.file;
    let size = |h: usize, w: usize| -> Result<(), EncodeError> {
        if [h, w] == [height, width] {
            return Ok(());
        }
        let what = match correction.orientation {
            Orientation::Hologram => "a correction in the hologram's orientation must have the hologram's size",
            Orientation::Slm => "a correction in the SLM's orientation must have the SLM's size",
        };
        Err(FileError::content(
            file,
            reason!("correction-size", "has {h}x{w} pixels, not {height}x{width}, and {what}"),
        )
        .into())
    };
    if FileKind::of(file).map_err(|e| FileError::read(file, e))? == FileKind::Npy {
        let array = read_npy(file)?;
        let [h, w] = array.shape[..] else {
            let reason = reason!("correction-shape", "has the shape {:?}, not (row, column)", array.shape);
            return Err(FileError::content(file, reason).into());
        };
        size(h, w)?;
        let two_pi = match (array.integers, correction.two_pi_level) {
            (false, None) => std::f64::consts::TAU,
            (_, Some(level)) => level,
            (true, None) => {
                let reason = reason!(
                    "correction-integers",
                    "holds integers. Set two_pi_level to their level of 2 pi, or store radians as floats"
                );
                return Err(FileError::content(file, reason).into());
            }
        };
        return Ok(array.values.iter().map(|v| units(f64::from(*v) / two_pi)).collect());
    }
    let picture = read_grey(file, [height, width])?.map_err(|[h, w]| size(h, w).expect_err("sizes differ"))?;
    let two_pi = correction.two_pi_level.unwrap_or(f64::from(picture.levels));
    Ok(picture.values.iter().map(|v| units(f64::from(*v) / two_pi)).collect())
}
