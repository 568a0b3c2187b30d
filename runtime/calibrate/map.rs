//! From the SLM's image to the camera's picture: a homography and radial distortion (OPTICS 10).

/// The map. Both images' places run from -1 to 1 across their widths, y in the same unit, from the centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CameraMap {
    /// The homography row by row, the ninth is 1; then k1, k2.
    pub(super) numbers: [f64; 10],
    /// Rows and columns of the SLM and of the camera.
    pub(super) slm: [usize; 2],
    pub(super) camera: [usize; 2],
}

/// How often the inverse is improved.
const ROUNDS: usize = 12;

impl CameraMap {
    /// Place in the picture of a place in the SLM's image.
    fn forth(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [a, b, c, d, e, f, g, h, k1, k2] = self.numbers;
        let w = g * x + h * y + 1.0;
        let (u, v) = ((a * x + b * y + c) / w, (d * x + e * y + f) / w);
        let r2 = u * u + v * v;
        let bent = 1.0 + k1 * r2 + k2 * r2 * r2;
        [u * bent, v * bent]
    }

    /// Camera pixel (x, y) of a pixel of the SLM.
    pub(super) fn to_camera(self, at: [f64; 2]) -> [f64; 2] {
        pixel(self.forth(place(at, self.slm)), self.camera)
    }

    /// Pixel of the SLM (x, y) of a camera pixel.
    pub(super) fn to_slm(self, at: [f64; 2]) -> [f64; 2] {
        let [a, b, c, d, e, f, g, h, k1, k2] = self.numbers;
        let [u, v] = place(at, self.camera);
        let (mut x, mut y) = (u, v);
        if k1 != 0.0 || k2 != 0.0 {
            for _ in 0..ROUNDS {
                let r2 = x * x + y * y;
                let bent = 1.0 + k1 * r2 + k2 * r2 * r2;
                (x, y) = (u / bent, v / bent);
            }
        }
        // The adjugate: what it lacks of the inverse is a factor of all three.
        let [p, q, w] = [
            (e - f * h) * x + (c * h - b) * y + (b * f - c * e),
            (f * g - d) * x + (a - c * g) * y + (c * d - a * f),
            (d * h - e * g) * x + (b * g - a * h) * y + (a * e - b * d),
        ];
        pixel([p / w, q / w], self.slm)
    }

    /// Camera pixels per pixel of the SLM, about its middle.
    pub(super) fn zoom(self) -> f64 {
        let middle = [self.slm[1] as f64 / 2.0, self.slm[0] as f64 / 2.0];
        let at = |dx: f64, dy: f64| self.to_camera([middle[0] + dx, middle[1] + dy]);
        let ([ax, ay], [bx, by], [cx, cy]) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0));
        ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)).abs().sqrt()
    }
}

/// Place of a pixel (x, y) in an image of rows and columns.
fn place([x, y]: [f64; 2], [rows, columns]: [usize; 2]) -> [f64; 2] {
    let (rows, columns) = (rows as f64, columns as f64);
    [(2.0 * x + 1.0 - columns) / columns, (2.0 * y + 1.0 - rows) / columns]
}

fn pixel([x, y]: [f64; 2], [rows, columns]: [usize; 2]) -> [f64; 2] {
    let (rows, columns) = (rows as f64, columns as f64);
    [(x * columns + columns - 1.0) / 2.0, (y * columns + rows - 1.0) / 2.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_back_is_that_of_the_way_forth() {
        let numbers = [-0.9, 0.03, 0.02, -0.03, 0.91, -0.05, 0.02, -0.01, 0.03, -0.01];
        let map = CameraMap { numbers, slm: [40, 54], camera: [160, 200] };
        for at in [[0.0, 0.0], [53.0, 39.0], [20.5, 11.25]] {
            let back = map.to_slm(map.to_camera(at));
            assert!((back[0] - at[0]).abs() + (back[1] - at[1]).abs() < 1e-6, "{at:?}: {back:?}");
        }
        assert!((map.zoom() - 0.905 * 200.0 / 54.0).abs() < 0.05, "{}", map.zoom());
    }
}
