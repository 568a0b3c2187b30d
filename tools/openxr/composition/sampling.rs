//! Reads samples of a part of a copied image.

use super::alpha::Alpha;
use super::taps::Taps;
use super::texels::{Format, read_colors, read_depth};

/// A rectangle of a copied image.
#[derive(Debug, Clone, Copy)]
pub struct Sheet<'a> {
    /// The bytes from the first texel of the rectangle.
    pub raw: &'a [u8],
    /// The format of the texels.
    pub format: Format,
    /// The bytes from one row to the next.
    pub stride: usize,
    /// Rows and columns of the rectangle.
    pub size: [usize; 2],
}

impl Sheet<'_> {
    /// Returns the bytes of a row, or none outside of the copy.
    fn row(&self, row: usize) -> &[u8] {
        let begin = row * self.stride;
        self.raw.get(begin..begin + self.size[1] * self.format.bytes()).unwrap_or(&[])
    }

    /// Returns the depth at a row and a column.
    pub fn depth(&self, row: usize, column: usize) -> Option<f32> {
        read_depth(self.format, self.row(row), column)
    }

    /// Returns the light between four texels, premultiplied, at a row and a column of the rectangle.
    pub fn between(&self, row: f64, column: f64, alpha: Alpha) -> [f32; 4] {
        let mut sum = [0.0; 4];
        for (row, of_row) in neighbors(row, self.size[0]) {
            let raw = self.row(row);
            for (column, of_column) in neighbors(column, self.size[1]) {
                let at = column * self.format.bytes();
                let mut texel = [[0.0; 4]];
                read_colors(self.format, raw.get(at..).unwrap_or(&[]), &mut texel);
                let light = alpha.premultiplied(texel[0]);
                let weight = of_row * of_column;
                sum.iter_mut().zip(light).for_each(|(sum, v)| *sum += weight * v);
            }
        }
        sum
    }
}

/// Returns the two samples next to a position, with their weights. The edge continues outside.
fn neighbors(at: f64, count: usize) -> [(usize, f32); 2] {
    let at = at.clamp(0.0, count.saturating_sub(1) as f64);
    let first = at.floor() as usize;
    let share = (at - at.floor()) as f32;
    [(first, 1.0 - share), ((first + 1).min(count.saturating_sub(1)), share)]
}

/// Rows of a sheet, resampled along columns. Each row is resampled once, because pixels need its neighbors again.
pub struct Rows<'a> {
    sheet: Sheet<'a>,
    columns: &'a [Option<Taps>],
    alpha: Alpha,
    texels: Vec<[f32; 4]>,
    /// The last rows, with their indices.
    kept: Vec<(usize, Vec<[f32; 4]>)>,
}

impl<'a> Rows<'a> {
    /// Reads the rows of a sheet with these taps of columns.
    pub fn new(sheet: Sheet<'a>, columns: &'a [Option<Taps>], alpha: Alpha) -> Self {
        Self { sheet, columns, alpha, texels: vec![[0.0; 4]; sheet.size[1]], kept: Vec::new() }
    }

    /// Writes the light of a row of pixels, premultiplied.
    pub fn write(&mut self, taps: &Taps, out: &mut [[f32; 4]]) {
        out.fill([0.0; 4]);
        // Rows before the first one are not needed again, whichever way the picture goes.
        let needed = taps.first..taps.first + taps.weights.len();
        let mut free: Vec<Vec<[f32; 4]>> = Vec::new();
        self.kept.retain_mut(|(row, light)| {
            let keep = needed.contains(row);
            if !keep {
                free.push(std::mem::take(light));
            }
            keep
        });
        for (row, weight) in needed.zip(&taps.weights) {
            let place = self.kept.iter().position(|(kept, _)| *kept == row);
            let place = place.unwrap_or_else(|| {
                let light = self.resampled(row, free.pop().unwrap_or_default());
                self.kept.push((row, light));
                self.kept.len() - 1
            });
            for (to, from) in out.iter_mut().zip(&self.kept[place].1) {
                for i in 0..4 {
                    to[i] += weight * from[i];
                }
            }
        }
    }

    fn resampled(&mut self, row: usize, mut light: Vec<[f32; 4]>) -> Vec<[f32; 4]> {
        read_colors(self.sheet.format, self.sheet.row(row), &mut self.texels);
        self.texels.iter_mut().for_each(|texel| *texel = self.alpha.premultiplied(*texel));
        light.clear();
        light.extend(self.columns.iter().map(|taps| {
            let mut sum = [0.0; 4];
            if let Some(Taps { first, weights, .. }) = taps {
                for (texel, weight) in self.texels[(*first).min(self.texels.len())..].iter().zip(weights) {
                    for i in 0..4 {
                        sum[i] += weight * texel[i];
                    }
                }
            }
            sum
        }));
        light
    }
}
