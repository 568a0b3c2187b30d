//! Blends the layers of a frame, from the back to the front.

use super::alpha::Alpha;
use super::sampling::{Rows, Sheet};
use super::surfaces::Surface;
use super::taps::{Frustum, taps};
use super::texels::{BRIGHTEST, DepthRange};

/// The opacity from which a layer decides the distance of a pixel.
const SOLID: f32 = 0.5;

/// The picture of an eye in linear light, with the distance of each pixel.
pub struct Canvas {
    frustum: Frustum,
    light: Vec<[f32; 3]>,
    dioptres: Vec<f32>,
}

impl Canvas {
    /// Makes a dark picture at infinity.
    pub fn new(frustum: Frustum) -> Self {
        let pixels = frustum.size[0] * frustum.size[1];
        Self { frustum, light: vec![[0.0; 3]; pixels], dioptres: vec![0.0; pixels] }
    }

    /// Makes the picture dark again.
    pub fn clear(&mut self) {
        self.light.fill([0.0; 3]);
        self.dioptres.fill(0.0);
    }

    /// Moves content that is nearer than this many dioptres to this distance. Returns true if there was any.
    pub fn limit(&mut self, dioptres: f32) -> bool {
        let nearest = self.dioptres.iter().copied().fold(0.0, f32::max);
        if nearest > dioptres {
            self.dioptres.iter_mut().for_each(|d| *d = d.min(dioptres));
        }
        nearest > dioptres
    }

    /// Returns the distances in dioptres as (row, column).
    pub fn dioptres(&self) -> &[f32] {
        &self.dioptres
    }

    /// Writes the light as (row, column, color), with these of red, green and blue.
    pub fn samples(&self, colors: [bool; 3], out: &mut Vec<f32>) {
        out.clear();
        match colors {
            [true, true, true] => out.extend_from_slice(self.light.as_flattened()),
            _ => out.extend(self.light.iter().flat_map(|light| (0..3).filter(|i| colors[*i]).map(|i| light[i]))),
        }
        // The weights of samples sum to 1 except for rounding, and light of several layers adds up. The display refuses
        // a frame with light outside of its range.
        out.iter_mut().for_each(|light| *light = light.clamp(0.0, BRIGHTEST));
    }

    /// Blends a view of the application, whose edges have these tangents (left, right, up, down). Without depth, it
    /// is `dioptres` away.
    pub fn project(
        &mut self,
        color: Sheet<'_>,
        edges: [f64; 4],
        alpha: Alpha,
        depth: Option<(Sheet<'_>, DepthRange)>,
        dioptres: f32,
    ) {
        let Frustum { size: [_, width], angle } = self.frustum;
        let [left, right, up, down] = edges;
        let columns = |count| taps(self.frustum.tangents(1), angle, [left, right], count);
        let rows = |count| taps(self.frustum.tangents(0), angle, [up, down], count);
        let (of_columns, of_rows) = (columns(color.size[1]), rows(color.size[0]));
        let depths = depth.map(|(sheet, range)| (sheet, range, columns(sheet.size[1]), rows(sheet.size[0])));
        let mut source = Rows::new(color, &of_columns, alpha);
        let mut line = vec![[0.0; 4]; width];
        for (row, taps) in of_rows.iter().enumerate() {
            let Some(taps) = taps else { continue };
            source.write(taps, &mut line);
            let pixels = row * width..(row + 1) * width;
            blend(&mut self.light[pixels.clone()], &line);
            let distances = &mut self.dioptres[pixels];
            for (column, (distance, light)) in distances.iter_mut().zip(&line).enumerate() {
                if light[3] < SOLID {
                    continue;
                }
                *distance = dioptres;
                // The nearest depth, because a mean of two distances is neither of them.
                if let Some((sheet, range, columns, rows)) = &depths
                    && let (Some(column), Some(row)) = (&columns[column], &rows[row])
                    && let Some(depth) = sheet.depth(row.nearest, column.nearest)
                {
                    *distance = range.dioptres(depth);
                }
            }
        }
    }

    /// Blends an image on a surface in the space of the eye.
    pub fn draw(&mut self, surface: &impl Surface, image: Sheet<'_>, alpha: Alpha) {
        let [rows, columns] = image.size.map(|n| n as f64);
        let across: Vec<f64> = self.frustum.tangents(1).collect();
        let mut line = vec![[0.0; 4]; across.len()];
        for (row, up) in self.frustum.tangents(0).enumerate() {
            let begin = row * across.len();
            for (column, (tangent, light)) in across.iter().zip(&mut line).enumerate() {
                *light = [0.0; 4];
                if let Some(hit) = surface.hit([*tangent, up, -1.0]) {
                    *light = image.between(hit.v * rows - 0.5, hit.u * columns - 0.5, alpha);
                    if light[3] >= SOLID {
                        self.dioptres[begin + column] = (1.0 / hit.distance).clamp(0.0, 100.0) as f32;
                    }
                }
            }
            blend(&mut self.light[begin..begin + across.len()], &line);
        }
    }
}

/// Blends premultiplied light over a row of pixels.
fn blend(light: &mut [[f32; 3]], line: &[[f32; 4]]) {
    for (to, [r, g, b, a]) in light.iter_mut().zip(line) {
        let through = 1.0 - a;
        for (to, from) in to.iter_mut().zip([r, g, b]) {
            *to = from + through * *to;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Format, Pose, Quad};
    use super::*;

    const OPAQUE: Alpha = Alpha { blends: false, unpremultiplied: false, inverted: false };
    const BLENDED: Alpha = Alpha { blends: true, ..OPAQUE };
    const FRUSTUM: Frustum = Frustum { size: [8, 12], angle: 0.05 };

    fn sheet(raw: &[u8], size: [usize; 2], format: Format) -> Sheet<'_> {
        Sheet { raw, format, stride: size[1] * format.bytes(), size }
    }

    fn pattern(size: [usize; 2]) -> Vec<u8> {
        (0..size[0] * size[1]).flat_map(|i| [(i * 7 % 256) as u8, (i * 3 % 256) as u8, (i % 256) as u8, 255]).collect()
    }

    #[test]
    fn a_view_of_the_same_size_arrives_as_it_is() {
        let raw = pattern(FRUSTUM.size);
        let depths: Vec<u8> = (0..96u16).flat_map(|i| (i * 600).to_le_bytes()).collect();
        let range = DepthRange { depths: [0.0, 1.0], distances: [0.25, f32::INFINITY] };
        let mut canvas = Canvas::new(FRUSTUM);
        let depth = sheet(&depths, FRUSTUM.size, Format::D16);
        let color = sheet(&raw, FRUSTUM.size, Format::Rgba8 { srgb: false });
        canvas.project(color, FRUSTUM.edges(), OPAQUE, Some((depth, range)), 1.0);
        let mut samples = Vec::new();
        canvas.samples([true, false, true], &mut samples);
        for i in 0..96 {
            let wanted = [i * 7 % 256, i % 256].map(|v| v as f32 / 255.0);
            assert!((0..2).all(|c| (samples[2 * i + c] - wanted[c]).abs() < 1e-4), "{i}: {wanted:?}");
            let dioptres = 4.0 * (1.0 - i as f32 * 600.0 / 65_535.0);
            assert!((canvas.dioptres()[i] - dioptres).abs() < 4.0 / 65_535.0, "{i}");
        }
    }

    /// An opaque view, a half transparent quad before it, and the view's distance where the quad is thin.
    #[test]
    fn a_quad_is_blended_at_its_place_and_distance() {
        let white = vec![255; 4 * 96];
        let mut canvas = Canvas::new(FRUSTUM);
        canvas.project(sheet(&white, FRUSTUM.size, Format::Rgba8 { srgb: false }), FRUSTUM.edges(), OPAQUE, None, 0.5);
        // Two columns of texels, the left one of opacity 0.8 and the right one of 0.2, 2 m away, 4 x 4 pixels large.
        let texels = [[0u8, 0, 0, 204], [0, 0, 0, 51]].concat();
        let pose = Pose::new([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -2.0]);
        let quad = Quad::new(&pose, [0.4, 0.4]);
        canvas.draw(&quad, sheet(&texels, [1, 2], Format::Rgba8 { srgb: false }), BLENDED);
        let mut samples = Vec::new();
        canvas.samples([true, false, false], &mut samples);
        let at = |row: usize, column: usize| (samples[12 * row + column], canvas.dioptres()[12 * row + column]);
        assert_eq!(at(0, 0), (1.0, 0.5));
        assert_eq!(at(1, 4), (1.0, 0.5));
        let (light, dioptres) = at(3, 4);
        assert!((light - 0.2).abs() < 1e-3 && dioptres == 0.5, "{light}, {dioptres}");
        let (light, dioptres) = at(5, 7);
        assert!((light - 0.8).abs() < 1e-3 && dioptres == 0.5, "{light}, {dioptres}");
        // A quad that shows its back is not seen.
        let mut back = Canvas::new(FRUSTUM);
        let turned = Pose::new([0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -2.0]);
        back.draw(&Quad::new(&turned, [0.4, 0.4]), sheet(&white, [1, 2], Format::Rgba8 { srgb: false }), OPAQUE);
        back.samples([true, true, true], &mut samples);
        assert!(samples.iter().all(|v| *v == 0.0));
    }

    #[test]
    fn opacity_has_three_forms() {
        let texel = [0.5, 0.25, 1.0, 0.25];
        assert_eq!(OPAQUE.premultiplied(texel), [0.5, 0.25, 1.0, 1.0]);
        assert_eq!(BLENDED.premultiplied(texel), texel);
        let straight = Alpha { unpremultiplied: true, ..BLENDED };
        assert_eq!(straight.premultiplied(texel), [0.125, 0.0625, 0.25, 0.25]);
        assert_eq!(Alpha { inverted: true, ..straight }.premultiplied(texel), [0.375, 0.1875, 0.75, 0.75]);
    }
}
