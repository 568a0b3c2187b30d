//! Reads a camera's picture as linear counts, in shares of full scale.

use eyebox_base::error::Reason;
use eyebox_base::files;
use eyebox_base::reason;
use std::path::Path;

/// A pixel may have been saturated from this share of full scale on.
const FULL: f32 = 0.995;

#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub(super) height: usize,
    pub(super) width: usize,
    /// Counts row by row, 1 at full scale.
    pub(super) values: Vec<f32>,
}

/// Reads a picture of the camera's size. `full_scale` is the value at which it saturates. The error states the problem
/// of the picture.
pub(super) fn load(file: &Path, [height, width]: [usize; 2], full_scale: f64) -> Result<Picture, Reason> {
    let size = |rows: usize, columns: usize| {
        reason!(
            "picture-size",
            "sent {}: it has {rows}x{columns} pixels, but the camera has {height}x{width}",
            file.display()
        )
    };
    let one_line = |e: files::FileError| reason!("no-picture", "sent a file that is not a picture ({e})");
    let scale = full_scale.recip();
    let values = if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) {
        let npy = files::read_npy(file).map_err(one_line)?;
        if npy.shape != [height, width] {
            let [rows, columns] = npy.shape[..] else {
                return Err(reason!(
                    "picture-axes",
                    "sent {}: it has {} axes, but pictures have 2",
                    file.display(),
                    npy.shape.len()
                ));
            };
            return Err(size(rows, columns));
        }
        npy.values.iter().map(|v| (f64::from(*v) * scale) as f32).collect()
    } else {
        let grey = files::read_grey(file, [height, width]).map_err(one_line)?;
        let grey = grey.map_err(|[rows, columns]| size(rows, columns))?;
        if grey.levels < 65536 && full_scale > 255.0 {
            return Err(reason!(
                "picture-full-scale",
                "sent {}: it has 8 bits, but its full scale is {full_scale}",
                file.display()
            ));
        }
        grey.values.iter().map(|v| (f64::from(*v) * scale) as f32).collect()
    };
    Ok(Picture { height, width, values })
}

impl Picture {
    /// The value at a place (x, y) between pixels. Outside the picture it is the value of the nearest edge.
    pub(super) fn between(&self, [x, y]: [f64; 2]) -> f64 {
        let axis = |v: f64, n: usize| {
            let v = v.clamp(0.0, (n - 1) as f64);
            let low = (v as usize).min(n.saturating_sub(2));
            (low, (low + 1).min(n - 1), v - low as f64)
        };
        let ((x, right, dx), (y, below, dy)) = (axis(x, self.width), axis(y, self.height));
        let at = |y: usize, x: usize| f64::from(self.values[y * self.width + x]);
        (1.0 - dy) * ((1.0 - dx) * at(y, x) + dx * at(y, right))
            + dy * ((1.0 - dx) * at(below, x) + dx * at(below, right))
    }

    /// True if a pixel may have been saturated.
    pub(super) fn is_full(&self, at: usize) -> bool {
        self.values[at] >= FULL
    }

    pub(super) fn saturated(&self) -> f64 {
        (0..self.values.len()).filter(|at| self.is_full(*at)).count() as f64 / self.values.len().max(1) as f64
    }

    pub(super) fn median(&self) -> f64 {
        f64::from(self.at(self.values.len() / 2))
    }

    /// The value that a thousandth of the pixels exceeds.
    pub(super) fn brightest(&self) -> f32 {
        self.at(self.values.len() * 999 / 1000)
    }

    /// The value at this place of the sorted values.
    fn at(&self, place: usize) -> f32 {
        *self.values.clone().select_nth_unstable_by(place, f32::total_cmp).1
    }
}
