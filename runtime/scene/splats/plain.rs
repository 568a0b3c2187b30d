//! Reads splats from `.splat` files, which have records of 32 bytes without a header.
//!
//! A record has the center and the standard deviations as float32, then red, green, blue and opacity as 8 bits. The last
//! four bytes are the quaternion (w, x, y, z), with 128 for 0.

use crate::SceneError;
use crate::splats::cloud::{Cloud, spread};
use crate::splats::file::{self, Opened};
use eyebox_base::reason;
use std::io::Read;
use std::path::Path;

/// Bytes of a record.
const RECORD: usize = 32;

/// Reads the splats of a `.splat` file.
///
/// # Errors
/// [`SceneError::Corrupt`] for a file that is not valid, and [`SceneError::Memory`].
pub(crate) fn read(path: &Path, mut opened: Opened) -> Result<Cloud, SceneError> {
    if !opened.length.is_multiple_of(RECORD as u64) {
        let reason = reason!(
            "record",
            "it has {} bytes, which are no whole number of records of {RECORD} bytes, so it is no .splat file or is cut",
            opened.length
        );
        return Err(SceneError::Corrupt { file: path.display().to_string(), reason });
    }
    let count = file::checked_count(path, opened.length / RECORD as u64, RECORD as u64, opened.length)?;
    let mut cloud = file::room(path, count, 0)?;
    let mut record = [0; RECORD];
    for _ in 0..count {
        opened.file.read_exact(&mut record).map_err(|e| file::broken(path, &e))?;
        let float = |i: usize| f32::from_le_bytes(std::array::from_fn(|k| record[4 * i + k]));
        cloud.places.push([0, 1, 2].map(float));
        cloud.spreads.push(spread([3, 4, 5].map(float), [28, 29, 30, 31].map(|i| f32::from(record[i]) - 128.0)));
        cloud.colors.push([24, 25, 26].map(|i| f32::from(record[i]) / 255.0));
        cloud.opacities.push(f32::from(record[27]) / 255.0);
    }
    Ok(cloud)
}
