//! Maps the SLM's image to the camera's picture by a homography and radial distortion (OPTICS 10).

use eyebox_optics::PictureWarp;

/// The map. In both images x runs from -1 to 1 over the width, and y has the same unit. The origin is the center.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CameraMap {
    /// The homography row by row, whose ninth number is 1, then k1 and k2.
    pub(super) numbers: [f64; 10],
    /// Rows and columns of the SLM, then of the camera.
    pub(super) slm: [usize; 2],
    pub(super) camera: [usize; 2],
}

impl CameraMap {
    /// The camera pixel (x, y) of a pixel of the SLM.
    pub(super) fn to_camera(self, at: [f64; 2]) -> [f64; 2] {
        pixel(PictureWarp::by_camera(self.numbers).forth(place(at, self.slm)), self.camera)
    }

    /// The pixel of the SLM (x, y) of a camera pixel.
    pub(super) fn to_slm(self, at: [f64; 2]) -> [f64; 2] {
        pixel(PictureWarp::by_camera(self.numbers).back(place(at, self.camera)), self.slm)
    }

    /// Camera pixels per pixel of the SLM, near its middle.
    pub(super) fn zoom(self) -> f64 {
        let [[a, b], [d, e]] = self.slopes();
        (a * e - b * d).abs().sqrt()
    }

    /// Camera pixels (x, then y) per pixel of the SLM along x and along y, near its middle.
    pub(super) fn slopes(self) -> [[f64; 2]; 2] {
        let middle = self.slm.map(|n| (n as f64 - 1.0) / 2.0);
        let at = |dx: f64, dy: f64| self.to_camera([middle[1] + dx, middle[0] + dy]);
        let along = |dx: f64, dy: f64| {
            let (after, before) = (at(dx, dy), at(-dx, -dy));
            [after[0] - before[0], after[1] - before[1]]
        };
        let (x, y) = (along(0.5, 0.0), along(0.0, 0.5));
        [[x[0], y[0]], [x[1], y[1]]]
    }
}

/// The place of a pixel (x, y) in an image of rows and columns.
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
