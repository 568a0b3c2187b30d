//! Poses as OpenXR has them, with +x right, +y up and -z forward.

/// A rotation and a translation. It maps a point of its own space to the space around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// A unit quaternion as x, y, z, w.
    pub rotation: [f64; 4],
    /// The origin of its own space, in m.
    pub origin: [f64; 3],
}

impl Pose {
    /// Takes a pose as an application gives it. A rotation that is not a unit quaternion is scaled to one.
    pub fn new(rotation: [f32; 4], origin: [f32; 3]) -> Self {
        let q = rotation.map(f64::from);
        let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        let rotation = if length > 0.0 && length.is_finite() { q.map(|v| v / length) } else { [0.0, 0.0, 0.0, 1.0] };
        Self { rotation, origin: origin.map(f64::from) }
    }

    /// Rotates a vector without moving it.
    pub fn turn(&self, v: [f64; 3]) -> [f64; 3] {
        let [x, y, z, w] = self.rotation;
        let axis = [x, y, z];
        let t = cross(axis, v).map(|c| 2.0 * c);
        let u = cross(axis, t);
        std::array::from_fn(|i| v[i] + w * t[i] + u[i])
    }

    /// Maps a point to the space around.
    pub fn place(&self, point: [f64; 3]) -> [f64; 3] {
        let turned = self.turn(point);
        std::array::from_fn(|i| turned[i] + self.origin[i])
    }

    /// Returns the opposite mapping.
    pub fn inverse(&self) -> Self {
        let [x, y, z, w] = self.rotation;
        let back = Self { rotation: [-x, -y, -z, w], origin: [0.0; 3] };
        Self { origin: back.turn(self.origin).map(|v| -v), ..back }
    }

    /// Returns the mapping that applies `inner` first.
    pub fn after(&self, inner: &Self) -> Self {
        let ([x, y, z, w], [a, b, c, d]) = (self.rotation, inner.rotation);
        let rotation = [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ];
        Self { rotation, origin: self.place(inner.origin) }
    }
}

/// Returns the cross product.
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the scalar product.
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        (0..3).all(|i| (a[i] - b[i]).abs() < 1e-6)
    }

    #[test]
    fn poses_follow_each_other_and_have_inverses() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        // A quarter turn to the left about +y maps forward (-z) to left (-x).
        let left = Pose::new([0.0, half, 0.0, half], [1.0, 2.0, 3.0]);
        assert!(near(left.turn([0.0, 0.0, -1.0]), [-1.0, 0.0, 0.0]));
        let tilted = Pose::new([0.2, -0.4, 0.1, 0.8], [-0.3, 0.0, 0.7]);
        let point = [0.5, -1.5, 2.5];
        assert!(near(left.after(&tilted).place(point), left.place(tilted.place(point))));
        assert!(near(tilted.inverse().place(tilted.place(point)), point));
    }
}
