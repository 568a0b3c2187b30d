//! Intersects the rays of an eye with quads and cylinders. All coordinates are in the space of the eye's view.

use super::geometry::{Pose, cross, dot};

/// The place where a ray meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The horizontal position in the image, from 0 at the left to 1.
    pub u: f64,
    /// The vertical position in the image, from 0 at the top to 1.
    pub v: f64,
    /// The distance along the axis of the view in m. It may be infinite.
    pub distance: f64,
}

/// A surface with an image.
pub trait Surface {
    /// Returns the place where the ray from the eye meets the image. The ray's z is -1, so that its length counts
    /// distances along the axis.
    fn hit(&self, ray: [f64; 3]) -> Option<Hit>;
}

/// A rectangle that is seen from its front.
#[derive(Debug, Clone, Copy)]
pub struct Quad {
    center: [f64; 3],
    /// The directions to the right and up, divided by the width and the height.
    right: [f64; 3],
    up: [f64; 3],
    normal: [f64; 3],
}

impl Quad {
    /// Places a quad of this width and height in m.
    pub fn new(pose: &Pose, [width, height]: [f32; 2]) -> Self {
        let [right, up] = [pose.turn([1.0, 0.0, 0.0]), pose.turn([0.0, 1.0, 0.0])];
        let normal = cross(right, up);
        let [width, height] = [width, height].map(f64::from);
        Self { center: pose.origin, right: right.map(|v| v / width), up: up.map(|v| v / height), normal }
    }
}

/// Returns the words of a surface for a device, or none if a ray cannot meet it.
fn finite<const N: usize>(words: [f64; N]) -> Option<[f32; 15]> {
    let mut all = [0.0; 15];
    all.iter_mut().zip(words).for_each(|(to, word)| *to = word as f32);
    all.iter().all(|word| word.is_finite()).then_some(all)
}

impl Quad {
    /// Returns the normal, the right and the up direction, each followed by its product with the center.
    pub fn words(&self) -> Option<[f32; 15]> {
        let Self { center, right, up, normal } = self;
        let with = |v: &[f64; 3]| [v[0], v[1], v[2], dot(*center, *v)];
        let ([a, b, c, d], [e, f, g, h], [i, j, k, l]) = (with(normal), with(right), with(up));
        finite([a, b, c, d, e, f, g, h, i, j, k, l])
    }
}

impl Surface for Quad {
    fn hit(&self, ray: [f64; 3]) -> Option<Hit> {
        let facing = dot(ray, self.normal);
        let distance = dot(self.center, self.normal) / facing;
        // The front faces the eye, and the quad is before it.
        if !(facing < 0.0 && distance > 0.0) {
            return None;
        }
        let from_center: [f64; 3] = std::array::from_fn(|i| ray[i] * distance - self.center[i]);
        let (u, v) = (0.5 + dot(from_center, self.right), 0.5 - dot(from_center, self.up));
        inside(u, v, distance)
    }
}

fn inside(u: f64, v: f64, distance: f64) -> Option<Hit> {
    let unit = 0.0..=1.0;
    (unit.contains(&u) && unit.contains(&v)).then_some(Hit { u, v, distance })
}

/// A part of a cylinder around +y, which is seen from the inside.
#[derive(Debug, Clone, Copy)]
pub struct Cylinder {
    /// The mapping from the eye to the cylinder.
    to_own: Pose,
    radius: f64,
    central_angle: f64,
    /// Height of the image, in radii.
    height: f64,
}

impl Cylinder {
    /// Places a cylinder. `aspect_ratio` is the width of the image along the arc, divided by its height. A radius of
    /// 0 or infinity means a cylinder at infinity.
    pub fn new(pose: &Pose, radius: f32, central_angle: f32, aspect_ratio: f32) -> Self {
        let (radius, central_angle) = (f64::from(radius), f64::from(central_angle));
        let radius = if radius > 0.0 { radius } else { f64::INFINITY };
        Self { to_own: pose.inverse(), radius, central_angle, height: central_angle / f64::from(aspect_ratio) }
    }
}

impl Cylinder {
    /// Returns the rotation from the eye (row by row), the eye's place, the radius (0 for infinity), the central angle,
    /// and the height in radii.
    pub fn words(&self) -> Option<[f32; 15]> {
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| self.to_own.turn(axis));
        let [right, up, back] = self.to_own.origin;
        let radius = if self.radius.is_finite() { self.radius } else { 0.0 };
        let Self { central_angle, height, .. } = *self;
        let there = central_angle != 0.0 && height != 0.0;
        let rows = [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]];
        let [a, b, c, d, e, f, g, h, i] = rows;
        finite([a, b, c, d, e, f, g, h, i, right, up, back, radius, central_angle, height]).filter(|_| there)
    }
}

impl Surface for Cylinder {
    fn hit(&self, ray: [f64; 3]) -> Option<Hit> {
        let direction = self.to_own.turn(ray);
        let across = direction[0].hypot(direction[2]);
        let (point, distance) = if self.radius.is_finite() {
            let origin = self.to_own.origin;
            // The farther of the two places on the cylinder is on its inside.
            let along = (origin[0] * direction[0] + origin[2] * direction[2]) / (across * across);
            let away = (origin[0] * origin[0] + origin[2] * origin[2] - self.radius * self.radius) / (across * across);
            let distance = -along + (along * along - away).sqrt();
            let point: [f64; 3] = std::array::from_fn(|i| (origin[i] + distance * direction[i]) / self.radius);
            (point, distance)
        } else {
            (direction.map(|v| v / across), f64::INFINITY)
        };
        // A NaN, for a ray that misses, is not inside.
        let u = 0.5 + point[0].atan2(-point[2]) / self.central_angle;
        let v = 0.5 - point[1] / self.height;
        if distance > 0.0 { inside(u, v, distance) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-6
    }

    #[test]
    fn a_turned_quad_is_met_at_its_distance() {
        // The quad is turned by 45 degrees about +y, so that its right side is nearer.
        let turn = std::f32::consts::FRAC_PI_8;
        let pose = Pose::new([0.0, -turn.sin(), 0.0, turn.cos()], [0.0, 0.0, -2.0]);
        let quad = Quad::new(&pose, [2.0, 1.0]);
        let center = quad.hit([0.0, 0.0, -1.0]).expect("the center");
        assert!(close(center.u, 0.5) && close(center.v, 0.5) && close(center.distance, 2.0));
        let t = 0.2;
        let hit = quad.hit([t, 0.1, -1.0]).expect("a place to the right");
        let distance = 2.0 / (1.0 + t);
        assert!(close(hit.distance, distance), "{hit:?}");
        assert!(close(hit.u, 0.5 + t * distance * 2f64.sqrt() / 2.0) && close(hit.v, 0.5 - 0.1 * distance), "{hit:?}");
        assert!(quad.hit([0.9, 0.0, -1.0]).is_none());
    }

    #[test]
    fn a_cylinder_is_met_from_its_inside() {
        let pose = Pose::new([0.0, 0.0, 0.0, 1.0], [0.0, 0.5, 1.0]);
        let cylinder = Cylinder::new(&pose, 3.0, std::f32::consts::FRAC_PI_2, 2.0);
        let center = cylinder.hit([0.0, 0.0, -1.0]).expect("the center");
        let height = 3.0 * std::f64::consts::FRAC_PI_4;
        assert!(close(center.u, 0.5) && close(center.distance, 2.0) && close(center.v, 0.5 + 0.5 / height));
        let edge = cylinder.hit([1.0, 0.0, -1.0]).expect("the right edge");
        // The circle around z = 1 has the place x = s, z = -s.
        let s = f64::from(17f32.sqrt() - 1.0) / 2.0;
        assert!(close(edge.distance, s) && close(edge.u, 0.5 + s.atan2(s + 1.0) / std::f64::consts::FRAC_PI_2));
        let far = Cylinder::new(&pose, 0.0, std::f32::consts::FRAC_PI_2, 2.0);
        let hit = far.hit([0.5, 0.0, -1.0]).expect("at infinity");
        assert!(hit.distance.is_infinite() && close(hit.u, 0.5 + 0.5f64.atan() / std::f64::consts::FRAC_PI_2));
        assert!(far.hit([2.0, 0.0, -1.0]).is_none() && cylinder.hit([0.0, 3.0, -1.0]).is_none());
    }
}
