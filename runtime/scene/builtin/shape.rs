//! Defines the shapes of a scene and their projection into a view.
//!
//! Scene units are x and y in half the display's shorter side from its center (+y down), and z in half the depth span
//! (+1 is the nearest). A view displaced from the axis sees the point (x, y, z) at `(x - z mx, y - z my)`, by parallel
//! rays tilted by `m`. Each shape solves exactly for the point that a ray meets first.

/// Half the shorter side, in half depth spans, of the paper's display at 512 pixels. This factor makes a sphere round.
pub(super) const ROUND: f32 = 2.048 / 3.0;

/// The point at which a ray of a view meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hit {
    /// The place on the surface from the axis, which is the place in its texture.
    pub x: f32,
    pub y: f32,
    /// Share of the pixel that the shape covers, without the coverage of its texture.
    pub coverage: f32,
}

/// A surface in space.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shape {
    /// A flat surface that faces the display at one depth. Its texture ends it.
    Card { z: f32 },
    /// A plane whose depth grows downwards, `z = at_zero + slope y`. Its texture ends it.
    Slope { at_zero: f32, slope: f32 },
    /// An ellipsoid with these half axes in x and y. In z it is as thick as it is wide.
    Ball { center: [f32; 3], radii: [f32; 2] },
    /// A turned body with an upright axis at x and z, whose radius is a function of y. Its texture ends it above and
    /// below.
    Turned { axis: [f32; 2], radius: fn(f32) -> f32 },
}

impl Shape {
    /// Returns the surface point that the ray through `(x, y)` of the view tilted by `m` meets. A pixel is `pixel`
    /// wide.
    #[inline]
    pub fn meet(&self, x: f32, y: f32, m: [f32; 2], pixel: f32) -> Option<Hit> {
        match *self {
            Self::Card { z } => Some(Hit { x: x + z * m[0], y: y + z * m[1], coverage: 1.0 }),
            Self::Slope { at_zero, slope } => {
                let on_y = (y + at_zero * m[1]) / (1.0 - slope * m[1]);
                Some(Hit { x: x + (at_zero + slope * on_y) * m[0], y: on_y, coverage: 1.0 })
            }
            Self::Ball { center: [cx, cy, cz], radii: [rx, ry] } => {
                let depth = rx * ROUND;
                let (a, b) = (x + cz * m[0] - cx, y + cz * m[1] - cy);
                let [wx, wy, wz] = [rx, ry, depth].map(|r| 1.0 / (r * r));
                // With t = z - cz along the ray, qa t^2 + 2 qb t + qc = 0.
                let qa = m[0] * m[0] * wx + m[1] * m[1] * wy + wz;
                let qb = a * m[0] * wx + b * m[1] * wy;
                let qc = a * a * wx + b * b * wy - 1.0;
                let inside = qb * qb - qa * qc;
                // The distance to the outline is to first order.
                let (da, db) = ((qb * m[0] - qa * a) * wx * 2.0, (qb * m[1] - qa * b) * wy * 2.0);
                let coverage = edge(inside, (da * da + db * db).sqrt(), pixel)?;
                let t = (inside.max(0.0).sqrt() - qb) / qa;
                Some(Hit { x: a + t * m[0] + cx, y: b + t * m[1] + cy, coverage })
            }
            Self::Turned { axis: [cx, cz], radius } => {
                let mut hit = Hit { x, y: y + cz * m[1], coverage: 1.0 };
                // The height determines the radius and the radius the height. Tilts are a few hundredths, so three
                // rounds leave less than a thousandth of a pixel.
                for _ in 0..3 {
                    let r = radius(hit.y);
                    if r <= 0.0 {
                        return None;
                    }
                    let a = x + cz * m[0] - cx;
                    let (wx, wz) = (1.0 / (r * r), 1.0 / (r * r * ROUND * ROUND));
                    let qa = m[0] * m[0] * wx + wz;
                    let qb = a * m[0] * wx;
                    let inside = qb * qb - qa * (a * a * wx - 1.0);
                    hit.coverage = edge(inside, 2.0 * ((qb * m[0] - qa * a) * wx).abs(), pixel)?;
                    let t = (inside.max(0.0).sqrt() - qb) / qa;
                    hit.x = a + t * m[0] + cx;
                    hit.y = y + (cz + t) * m[1];
                }
                Some(hit)
            }
        }
    }

    /// Returns the farthest and the nearest depth over the heights from `top` to `bottom`.
    pub fn depths(&self, top: f32, bottom: f32) -> [f32; 2] {
        match *self {
            Self::Card { z } => [z, z],
            Self::Slope { at_zero, slope } => {
                let ends = [at_zero + slope * top, at_zero + slope * bottom];
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            }
            Self::Ball { center, radii } => [center[2], center[2] + radii[0] * ROUND],
            Self::Turned { axis, .. } => [axis[1], axis[1]],
        }
    }
}

/// Returns the coverage of a pixel whose center is `value / slope` inside an outline. It returns `None` for a pixel
/// completely outside.
fn edge(value: f32, slope: f32, pixel: f32) -> Option<f32> {
    let coverage = 0.5 + value / (slope * pixel).max(1e-12);
    (coverage > 0.0).then_some(coverage.min(1.0))
}

/// A blade is a thin, bent, tapering strip, and its ends have different depths.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blade {
    /// Position x, y, z of its root.
    pub root: [f32; 3],
    /// Position x, y, z of its tip, above the root.
    pub tip: [f32; 3],
    /// Sideways displacement of its middle.
    pub bend: f32,
    /// Half its width at the root.
    pub width: f32,
    /// Colors at the root and at the tip.
    pub colors: [[f32; 3]; 2],
}

/// One row of a blade in a view.
#[derive(Debug, Clone, Copy)]
pub(super) struct BladeRow {
    /// Middle of the row.
    pub x: f32,
    /// Half the width of the row.
    pub half: f32,
    /// Position along the blade, 0 at the root and 1 at the tip.
    pub along: f32,
}

impl Blade {
    /// Returns the heights (top, bottom) of the blade in the view tilted by `m`.
    pub fn rows(&self, m: [f32; 2]) -> [f32; 2] {
        let [a, b] = [self.root, self.tip].map(|p| p[1] - p[2] * m[1]);
        [a.min(b), a.max(b)]
    }

    /// Returns the blade at height `y` of the view.
    pub fn row(&self, y: f32, m: [f32; 2]) -> Option<BladeRow> {
        let [from, to] = [self.root, self.tip].map(|p| p[1] - p[2] * m[1]);
        let t = (y - from) / (to - from);
        if !(0.0..=1.0).contains(&t) {
            return None;
        }
        let lerp = |k: usize| self.root[k] + (self.tip[k] - self.root[k]) * t;
        let x = lerp(0) + 4.0 * self.bend * t * (1.0 - t) - lerp(2) * m[0];
        // The width is full at the root and zero at the tip.
        Some(BladeRow { x, half: self.width * (1.0 - t * t), along: t })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the depth of a hit on the ray through `(x, y)` of the view tilted by `m`, which goes back to (x + z m).
    /// A hit must be on the ray and on the surface.
    fn depth_of(hit: Hit, x: f32, y: f32, m: [f32; 2]) -> f32 {
        let z = (hit.x - x) / m[0];
        assert!((z - (hit.y - y) / m[1]).abs() < 1e-3, "{hit:?} is not on the ray");
        z
    }

    const M: [f32; 2] = [0.03, -0.05];

    #[test]
    fn rays_meet_surfaces_where_they_are() {
        let card = Shape::Card { z: 0.7 }.meet(0.1, 0.2, M, 1e-3).unwrap();
        assert!((depth_of(card, 0.1, 0.2, M) - 0.7).abs() < 1e-4);

        let slope = Shape::Slope { at_zero: -0.3, slope: 2.0 }.meet(0.1, 0.2, M, 1e-3).unwrap();
        assert!((depth_of(slope, 0.1, 0.2, M) - (-0.3 + 2.0 * slope.y)).abs() < 1e-4);

        let (center, radii) = ([0.2f32, -0.1, 0.4], [0.5f32, 0.3]);
        let ball = Shape::Ball { center, radii };
        for (x, y) in [(0.2, -0.1), (0.5, 0.0), (-0.1, -0.25)] {
            let hit = ball.meet(x, y, M, 1e-3).unwrap();
            let z = depth_of(hit, x, y, M);
            let sum =
                ((hit.x - 0.2) / 0.5).powi(2) + ((hit.y + 0.1) / 0.3).powi(2) + ((z - 0.4) / (0.5 * ROUND)).powi(2);
            assert!((sum - 1.0).abs() < 2e-3 && z > 0.4, "{sum} {z}");
            assert_eq!(hit.coverage, 1.0);
        }
        // The outline is at the place for the depth of the center and half covered, and there is nothing beyond it.
        let edge = |dx: f32| ball.meet(0.2 - 0.4 * M[0] + dx, -0.1 - 0.4 * M[1], M, 1e-2);
        assert!((edge(0.5).unwrap().coverage - 0.5).abs() < 0.05);
        assert!(edge(0.52).is_none() && edge(-0.52).is_none() && edge(0.48).unwrap().coverage == 1.0);

        let turned = Shape::Turned { axis: [0.2, -0.5], radius: |y| 0.3 + 0.1 * y };
        let hit = turned.meet(0.3, 0.1, M, 1e-3).unwrap();
        let z = depth_of(hit, 0.3, 0.1, M);
        let r = 0.3 + 0.1 * hit.y;
        let sum = ((hit.x - 0.2) / r).powi(2) + ((z + 0.5) / (r * ROUND)).powi(2);
        assert!((sum - 1.0).abs() < 2e-3 && z > -0.5, "{sum} {z}");
    }

    #[test]
    fn a_blade_is_displaced_by_the_depth_of_each_end() {
        let blade =
            Blade { root: [0.1, 0.9, 0.8], tip: [0.3, -0.2, -0.4], bend: 0.0, width: 0.02, colors: [[1.0; 3]; 2] };
        let [top, bottom] = blade.rows(M);
        let at_root = blade.row(bottom - 1e-4, M).unwrap();
        let at_tip = blade.row(top + 1e-4, M).unwrap();
        assert!((bottom - (0.9 - 0.8 * M[1])).abs() < 1e-5 && (at_root.x - (0.1 - 0.8 * M[0])).abs() < 1e-3);
        assert!((top - (-0.2 + 0.4 * M[1])).abs() < 1e-5 && (at_tip.x - (0.3 + 0.4 * M[0])).abs() < 1e-3);
        assert!((at_root.half - 0.02).abs() < 1e-4 && at_tip.half < 1e-3);
        assert!(blade.row(bottom + 0.01, M).is_none());
    }
}
