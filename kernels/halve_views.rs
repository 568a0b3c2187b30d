//! Computes a level of the views' pyramid from the finer one. Values have 16 bits, and the weights are [`Table::area`].

use crate::resample::{self, Table};
use bytemuck::{Pod, Zeroable};

/// Both sizes, and the positions of weights and views.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Args {
    /// Sizes of the finer level and of this one.
    pub sizes: resample::Args,
    /// Values from one view to the next in the finer level, an even number.
    pub in_stride: u32,
    /// Values from one view to the next in this one, an even number.
    pub stride: u32,
    /// Word at which the tables of the rows begin.
    pub rows_at: u32,
    /// Word at which the tables of the columns begin.
    pub columns_at: u32,
}

impl Args {
    /// Returns the arguments and the tables of rows and columns, from a level of one size (rows, columns) to the next.
    /// The tables begin at the word `tables_at`. The arguments are for one view, so the strides are 0.
    pub fn between(finer: (usize, usize), coarser: (usize, usize), tables_at: u32) -> (Self, [Table; 2]) {
        let (rows, columns) = (Table::area(finer.0, coarser.0), Table::area(finer.1, coarser.1));
        let sizes = resample::Args::between(finer, coarser, &rows, &columns);
        let columns_at = tables_at + (coarser.0 * (1 + rows.taps)) as u32;
        let args = Self { sizes, in_stride: 0, stride: 0, rows_at: tables_at, columns_at };
        (args, [rows, columns])
    }
}

/// Packs the tables of both axes for the shader. Each axis has `first`, then the bits of `weights`.
pub fn packed(rows: &Table, columns: &Table) -> Vec<u32> {
    let words = |table: &Table| {
        let weights: Vec<u32> = table.weights.iter().map(|w| w.to_bits()).collect();
        [table.first.clone(), weights].concat()
    };
    [words(rows), words(columns)].concat()
}

/// Writes `values` (height, width) of one view from `finer` (in_height, in_width).
pub fn halve_views(args: &Args, finer: &[u16], rows: &Table, columns: &Table, values: &mut [u16]) {
    let resample::Args { in_height, in_width, height, width, .. } = args.sizes;
    let from: Vec<f32> = finer.iter().take((in_height * in_width) as usize).map(|v| f32::from(*v)).collect();
    let mut image = vec![0.0; (height * width) as usize];
    resample::resample(&args.sizes, &from, rows, columns, &mut image, &mut Vec::new());
    values.iter_mut().zip(&image).for_each(|(to, v)| *to = (v + 0.5) as u16);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compared with the weights in float64, for sizes that halve and sizes that do not.
    #[test]
    fn is_the_mean_around_each_sample() {
        for [in_height, in_width] in [[8, 6], [7, 9], [5, 8]] {
            let [height, width] = [in_height, in_width].map(|n: usize| n.div_ceil(2));
            let (args, [rows, columns]) = Args::between((in_height, in_width), (height, width), 0);
            let finer: Vec<u16> = (0..in_height * in_width).map(|i| (i * 7919 % 65_536) as u16).collect();
            let mut values = vec![0; height * width];
            halve_views(&args, &finer, &rows, &columns, &mut values);
            let weight = |table: &Table, j: usize, t: usize| f64::from(table.weights[j * table.taps + t]);
            for (i, value) in values.iter().enumerate() {
                let (y, x) = (i / width, i % width);
                let mut exact = 0.0;
                for (s, t) in (0..rows.taps).flat_map(|s| (0..columns.taps).map(move |t| (s, t))) {
                    let from_y = (rows.first[y] as usize + s) % in_height;
                    let from_x = (columns.first[x] as usize + t) % in_width;
                    exact +=
                        weight(&rows, y, s) * weight(&columns, x, t) * f64::from(finer[from_y * in_width + from_x]);
                }
                assert!((f64::from(*value) - exact).abs() <= 0.51, "{value} {exact}");
            }
            assert_eq!(packed(&rows, &columns).len(), height * (1 + rows.taps) + width * (1 + columns.taps));
        }
    }
}
