//! Computes the color error at depth edges, because there the colors of a hologram separate first.

use std::f64::consts::PI;

/// Returns CIE L*a*b* (white D65) of linear sRGB.
fn lab([r, g, b]: [f64; 3]) -> [f64; 3] {
    // The matrix of IEC 61966-2-1, each row over the white's own value.
    let [x, y, z] = [
        (0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b) / 0.950_47,
        0.212_672_9 * r + 0.715_152_2 * g + 0.072_175_0 * b,
        (0.019_333_9 * r + 0.119_192_0 * g + 0.950_304_1 * b) / 1.088_83,
    ]
    .map(|t| if t > 216.0 / 24389.0 { t.cbrt() } else { (24389.0 / 27.0 * t + 16.0) / 116.0 });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Returns CIEDE2000 of two colors in L*a*b*, by equations 2 to 22 of Sharma, Wu and Dalal 2005.
fn difference([l1, a1, b1]: [f64; 3], [l2, a2, b2]: [f64; 3]) -> f64 {
    // The seventh power of a chroma, relative to 25.
    let saturation = |c: f64| (c.powi(7) / (c.powi(7) + 25f64.powi(7))).sqrt();
    let g = 0.5 * (1.0 - saturation(0.5 * (a1.hypot(b1) + a2.hypot(b2))));
    let chroma_and_hue = |a: f64, b: f64| {
        let a = (1.0 + g) * a;
        (a.hypot(b), if a == 0.0 && b == 0.0 { 0.0 } else { b.atan2(a).rem_euclid(2.0 * PI) })
    };
    let ((c1, h1), (c2, h2)) = (chroma_and_hue(a1, b1), chroma_and_hue(a2, b2));
    let grey = c1 * c2 == 0.0;
    let turn = match h2 - h1 {
        _ if grey => 0.0,
        d if d > PI => d - 2.0 * PI,
        d if d < -PI => d + 2.0 * PI,
        d => d,
    };
    let (dl, dc, dh) = (l2 - l1, c2 - c1, 2.0 * (c1 * c2).sqrt() * (0.5 * turn).sin());
    let (l, c) = (0.5 * (l1 + l2), 0.5 * (c1 + c2));
    let h = match h1 + h2 {
        sum if grey => sum,
        sum if (h1 - h2).abs() <= PI => 0.5 * sum,
        sum if sum < 2.0 * PI => 0.5 * sum + PI,
        sum => 0.5 * sum - PI,
    };
    let at = |times: f64, degrees: f64| (times * h - degrees.to_radians()).cos();
    let t = 1.0 - 0.17 * at(1.0, 30.0) + 0.24 * at(2.0, 0.0) + 0.32 * at(3.0, -6.0) - 0.20 * at(4.0, 63.0);
    let from_50 = (l - 50.0).powi(2);
    let s_l = 1.0 + 0.015 * from_50 / (20.0 + from_50).sqrt();
    let (s_c, s_h) = (1.0 + 0.045 * c, 1.0 + 0.015 * c * t);
    let rotation = 60f64.to_radians() * (-((h.to_degrees() - 275.0) / 25.0).powi(2)).exp();
    let r_t = -rotation.sin() * 2.0 * saturation(c);
    let (l, c, h) = (dl / s_l, dc / s_c, dh / s_h);
    (l * l + c * c + h * h + r_t * c * h).sqrt()
}

/// Returns CIEDE2000 (Sharma, Wu and Dalal 2005) per pixel between two pictures of red, green and blue planes. The
/// linear channels of the display are used as linear sRGB with its white, D65.
///
/// # Panics
/// Panics if the planes differ in size, which is a mistake of the caller.
pub fn color_difference(seen: [&[f32]; 3], wanted: [&[f32]; 3]) -> Vec<f64> {
    let pixels = seen[0].len();
    assert!(seen.iter().chain(&wanted).all(|p| p.len() == pixels), "all planes have one size");
    let at = |planes: &[&[f32]; 3], i: usize| lab(planes.map(|p| f64::from(p[i])));
    (0..pixels).map(|i| difference(at(&seen, i), at(&wanted, i))).collect()
}

/// Returns the pixels within `reach` pixels (by the larger of the two axes) of an edge. An edge is a difference in
/// depth of more than `step` between neighbors. `depth` is (height, width).
///
/// # Panics
/// Panics if `depth` is not `height` x `width`, which is a mistake of the caller.
pub fn edges(depth: &[f32], height: usize, width: usize, step: f32, reach: usize) -> Vec<bool> {
    assert_eq!(depth.len(), height * width, "the depth map is {height} x {width}");
    let mut near = vec![false; height * width];
    for y in 0..height {
        for x in 0..width {
            let here = depth[y * width + x];
            let parts = |there: f32| (there - here).abs() > step;
            let edge = (x + 1 < width && parts(depth[y * width + x + 1]))
                || (y + 1 < height && parts(depth[(y + 1) * width + x]));
            if !edge {
                continue;
            }
            // The step is between this pixel and the next, so both sides get the same reach.
            let (right, below) = ((x + 1 + reach).min(width), (y + 1 + reach).min(height));
            for row in y.saturating_sub(reach.saturating_sub(1))..below {
                near[row * width + x.saturating_sub(reach.saturating_sub(1))..row * width + right].fill(true);
            }
        }
    }
    near
}

/// Returns a mask at half the resolution, like pictures of [`pool2`](super::pool2). A pixel is set if any of its four
/// pixels is.
pub fn pool_mask(mask: &[bool], height: usize, width: usize) -> Vec<bool> {
    let values: Vec<f32> = mask.iter().map(|&m| f32::from(u8::from(m))).collect();
    super::pool2(&values, height, width).iter().map(|v| *v > 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test data that Sharma, Wu and Dalal published with the formula (Color Research and Application 30, 2005).
    const SHARMA: [([f64; 3], [f64; 3], f64); 34] = [
        ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
        ([50.0, 3.1571, -77.2803], [50.0, 0.0, -82.7485], 2.8615),
        ([50.0, 2.8361, -74.0200], [50.0, 0.0, -82.7485], 3.4412),
        ([50.0, -1.3802, -84.2814], [50.0, 0.0, -82.7485], 1.0000),
        ([50.0, -1.1848, -84.8006], [50.0, 0.0, -82.7485], 1.0000),
        ([50.0, -0.9009, -85.5211], [50.0, 0.0, -82.7485], 1.0000),
        ([50.0, 0.0, 0.0], [50.0, -1.0, 2.0], 2.3669),
        ([50.0, -1.0, 2.0], [50.0, 0.0, 0.0], 2.3669),
        ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0009], 7.1792),
        ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0010], 7.1792),
        ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0011], 7.2195),
        ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0012], 7.2195),
        ([50.0, -0.0010, 2.4900], [50.0, 0.0009, -2.4900], 4.8045),
        ([50.0, -0.0010, 2.4900], [50.0, 0.0010, -2.4900], 4.8045),
        ([50.0, -0.0010, 2.4900], [50.0, 0.0011, -2.4900], 4.7461),
        ([50.0, 2.5, 0.0], [50.0, 0.0, -2.5], 4.3065),
        ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
        ([50.0, 2.5, 0.0], [61.0, -5.0, 29.0], 22.8977),
        ([50.0, 2.5, 0.0], [56.0, -27.0, -3.0], 31.9030),
        ([50.0, 2.5, 0.0], [58.0, 24.0, 15.0], 19.4535),
        ([50.0, 2.5, 0.0], [50.0, 3.1736, 0.5854], 1.0000),
        ([50.0, 2.5, 0.0], [50.0, 3.2972, 0.0], 1.0000),
        ([50.0, 2.5, 0.0], [50.0, 1.8634, 0.5757], 1.0000),
        ([50.0, 2.5, 0.0], [50.0, 3.2592, 0.3350], 1.0000),
        ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
        ([63.0109, -31.0961, -5.8663], [62.8187, -29.7946, -4.0864], 1.2630),
        ([61.2901, 3.7196, -5.3901], [61.4292, 2.2480, -4.9620], 1.8731),
        ([35.0831, -44.1164, 3.7933], [35.0232, -40.0716, 1.5901], 1.8645),
        ([22.7233, 20.0904, -46.6940], [23.0331, 14.9730, -42.5619], 2.0373),
        ([36.4612, 47.8580, 18.3852], [36.2715, 50.5065, 21.2231], 1.4146),
        ([90.8027, -2.0831, 1.4410], [91.1528, -1.6435, 0.0447], 1.4441),
        ([90.9257, -0.5406, -0.9208], [88.6381, -0.8985, -0.7239], 1.5381),
        ([6.7747, -0.2908, -2.4247], [5.8714, -0.0985, -2.2286], 0.6377),
        ([2.0776, 0.0795, -1.1350], [0.9033, -0.0636, -0.5514], 0.9082),
    ];

    #[test]
    fn differences_are_those_published() {
        for (a, b, expected) in SHARMA {
            let found = difference(a, b);
            assert!((found - expected).abs() < 1e-4, "{a:?} {b:?}: {found}, not {expected}");
        }
    }

    #[test]
    fn linear_light_goes_the_whole_way() {
        // scikit-image 0.26 computed deltaE_ciede2000(rgb2lab(a), rgb2lab(b)) of the sRGB-encoded values.
        let seen: [&[f32]; 3] = [&[0.2, 0.9, 0.01], &[0.4, 0.05, 0.02], &[0.1, 0.3, 0.015]];
        let wanted: [&[f32]; 3] = [&[0.25, 0.7, 0.03], &[0.35, 0.2, 0.02], &[0.12, 0.3, 0.01]];
        let found = color_difference(seen, wanted);
        for (found, expected) in found.iter().zip([5.34543506, 11.44801092, 13.95968023]) {
            // Their white differs in the fifth digit.
            assert!((found - expected).abs() < 5e-3, "{found}, not {expected}");
        }
        assert!(color_difference(seen, seen).iter().all(|d| *d == 0.0));
    }

    #[test]
    fn edges_are_where_depth_steps() {
        // A step between columns 3 and 4, and a gentle slope down the rows.
        let depth: Vec<f32> = (0..60).map(|i| if i % 10 > 3 { 1.0 } else { 0.0 } + 0.01 * (i / 10) as f32).collect();
        let mask = edges(&depth, 6, 10, 0.1, 2);
        for (i, m) in mask.iter().enumerate() {
            assert_eq!(*m, (2..6).contains(&(i % 10)), "{i}");
        }
        assert!(edges(&depth, 6, 10, 2.0, 2).iter().all(|m| !m));
        assert_eq!(pool_mask(&mask, 6, 10).iter().filter(|m| **m).count(), 6);
    }
}
