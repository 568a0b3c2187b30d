//! Encodes small pictures for the page as `data:` addresses.

use super::shown::Picture;
use base64::{Engine as _, engine::general_purpose::STANDARD};
use eyebox::low_level::files::{encode_jpeg8, encode_png8, linear_to_srgb};
use eyebox::low_level::optics::Color;

const QUALITY: u8 = 78;

/// Returns the longest side of a picture, in pixels, if `count` holograms share a page. The page must open fast on a
/// phone.
pub fn longest(count: usize) -> usize {
    match count {
        0..=8 => 256,
        9..=20 => 192,
        _ => 128,
    }
}

/// Encodes linear light, one plane per color, as a JPEG in sRGB.
pub fn light(planes: &[(Color, &[f32])], height: usize, width: usize, longest: usize, psnr: Option<f64>) -> Picture {
    let (rgb, height, width) = composed(planes, height, width, longest);
    jpeg(&rgb, height, width, psnr)
}

/// Encodes the same as a PNG, pixel for pixel.
pub(crate) fn light_exact(planes: &[(Color, &[f32])], height: usize, width: usize) -> Picture {
    let (rgb, height, width) = composed(planes, height, width, usize::MAX);
    png(&rgb, height, width)
}

/// Encodes the differences of pairs of planes. The mean absolute difference over colors, times `gain`, runs from black
/// to white through violet and orange.
pub fn error(pairs: &[(&[f32], &[f32])], height: usize, width: usize, longest: usize, gain: f64) -> Picture {
    let share = gain / pairs.len().max(1) as f64;
    let mut sum = vec![0.0f64; height * width];
    for (seen, wanted) in pairs {
        let difference = seen.iter().zip(*wanted).map(|(s, w)| f64::from((s - w).abs()));
        sum.iter_mut().zip(difference).for_each(|(s, d)| *s += share * d);
    }
    let (h, w, sum) = shrink(&sum, height, width, longest);
    let rgb: Vec<u8> = sum.iter().flat_map(|v| ramp(*v)).collect();
    jpeg(&rgb, h, w, None)
}

/// Encodes values from 0 to 1 on the same ramp as a PNG, pixel for pixel.
pub fn map(values: &[f64], height: usize, width: usize) -> Picture {
    let rgb: Vec<u8> = values.iter().flat_map(|v| ramp(*v)).collect();
    png(&rgb, height, width)
}

/// A dark-to-light ramp of even steps in lightness, so that it stays readable without color.
pub(crate) fn ramp(value: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 7] = [
        [0.0, 0.0, 4.0],
        [40.0, 17.0, 89.0],
        [106.0, 23.0, 110.0],
        [174.0, 48.0, 92.0],
        [229.0, 92.0, 48.0],
        [251.0, 166.0, 36.0],
        [252.0, 255.0, 190.0],
    ];
    let at = if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) } * (STOPS.len() - 1) as f64;
    let (i, part) = ((at as usize).min(STOPS.len() - 2), at - (at as usize).min(STOPS.len() - 2) as f64);
    std::array::from_fn(|c| (STOPS[i][c] + part * (STOPS[i + 1][c] - STOPS[i][c])).round() as u8)
}

/// Averages by area until no side is longer than `longest`. Returns (height, width, values).
pub(crate) fn shrink(values: &[f64], height: usize, width: usize, longest: usize) -> (usize, usize, Vec<f64>) {
    let scale = longest as f64 / height.max(width) as f64;
    if scale >= 1.0 {
        return (height, width, values.to_vec());
    }
    let side = |n: usize| ((n as f64 * scale).round() as usize).max(1);
    // The inputs of each output, with their shares.
    let shares = |n: usize, m: usize| -> Vec<Vec<(usize, f64)>> {
        let wide = n as f64 / m as f64;
        let of = |i: usize| {
            let (from, to) = (i as f64 * wide, (i + 1) as f64 * wide);
            let inputs = from as usize..(to.ceil() as usize).min(n);
            inputs.map(|j| (j, (to.min(j as f64 + 1.0) - from.max(j as f64)) / wide)).collect()
        };
        (0..m).map(of).collect()
    };
    let (h, w) = (side(height), side(width));
    let columns = shares(width, w);
    let along: Vec<f64> = values
        .chunks_exact(width)
        .flat_map(|row| columns.iter().map(|c| c.iter().map(|(j, s)| row[*j] * s).sum()))
        .collect();
    let rows = shares(height, h);
    let at = |y: &Vec<(usize, f64)>, x: usize| y.iter().map(|(j, s)| along[j * w + x] * s).sum();
    (h, w, rows.iter().flat_map(|y| (0..w).map(move |x| at(y, x))).collect())
}

/// Returns the red, green and blue levels of the shrunk planes. A single plane becomes gray.
fn composed(planes: &[(Color, &[f32])], height: usize, width: usize, longest: usize) -> (Vec<u8>, usize, usize) {
    let mut channels: [Option<Vec<f64>>; 3] = [None, None, None];
    let (mut h, mut w) = (height, width);
    for (color, plane) in planes {
        let wide: Vec<f64> = plane.iter().map(|v| f64::from(*v)).collect();
        let small;
        (h, w, small) = shrink(&wide, height, width, longest);
        match planes {
            [_] => channels = std::array::from_fn(|_| Some(small.clone())),
            _ => channels[color.channel()] = Some(small),
        }
    }
    let level = |c: &Option<Vec<f64>>, i: usize| c.as_ref().map_or(0, |c| (linear_to_srgb(c[i]) * 255.0).round() as u8);
    let rgb = (0..h * w).flat_map(|i| [0, 1, 2].map(|c| level(&channels[c], i))).collect();
    (rgb, h, w)
}

fn jpeg(rgb: &[u8], height: usize, width: usize, psnr: Option<f64>) -> Picture {
    let mut bytes = Vec::new();
    encode_jpeg8(&mut bytes, height, width, rgb, QUALITY).expect("a vector takes everything");
    Picture { width, height, psnr, data: format!("data:image/jpeg;base64,{}", STANDARD.encode(bytes)) }
}

fn png(rgb: &[u8], height: usize, width: usize) -> Picture {
    let mut bytes = Vec::new();
    encode_png8(&mut bytes, height, width, 3, rgb).expect("a vector takes everything");
    Picture { width, height, psnr: None, data: format!("data:image/png;base64,{}", STANDARD.encode(bytes)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ramp_only_gets_lighter() {
        let lightness = |i: usize| {
            ramp(i as f64 / 100.0).iter().zip([0.2126, 0.7152, 0.0722]).map(|(c, w)| f64::from(*c) * w).sum::<f64>()
        };
        assert!((0..100).all(|i| lightness(i + 1) > lightness(i)));
        assert_eq!((ramp(-1.0), ramp(f64::NAN)), (ramp(0.0), ramp(0.0)));
        assert_eq!(ramp(7.0), [252, 255, 190]);
    }

    #[test]
    fn shrinking_averages_by_area() {
        let (h, w, small) = shrink(&[0.0, 3.0, 6.0, 0.0, 3.0, 6.0, 3.0, 3.0, 3.0], 3, 3, 2);
        // The left column is 2/3 of one and 1/3 of the next.
        let top = [1.0, 5.0];
        assert_eq!((h, w), (2, 2));
        for (found, expected) in small.iter().zip([top[0], top[1], (top[0] + 6.0) / 3.0, (top[1] + 6.0) / 3.0]) {
            assert!((found - expected).abs() < 1e-12, "{small:?}");
        }
        let ramp: Vec<f64> = (0..400 * 7).map(|i| f64::from(i % 7)).collect();
        let (h, w, small) = shrink(&ramp, 400, 7, 192);
        assert!(h == 192 && w == 3 && (small.iter().sum::<f64>() / (192.0 * 3.0) - 3.0).abs() < 1e-9);
        assert_eq!(longest(5), 256);
    }

    #[test]
    fn large_pictures_become_small_and_one_colour_grey() {
        let plane = vec![0.18f32; 300 * 600];
        let picture = light(&[(Color::Green, &plane)], 300, 600, 256, Some(30.0));
        assert_eq!((picture.height, picture.width, picture.psnr), (128, 256, Some(30.0)));
        assert!(picture.data.starts_with("data:image/jpeg;base64,"));
        let (rgb, h, w) = composed(&[(Color::Green, &[0.18; 4])], 2, 2, 256);
        assert_eq!((rgb, h, w), (vec![118; 12], 2, 2));
        let (rgb, ..) = composed(&[(Color::Red, &[0.18]), (Color::Blue, &[1.0])], 1, 1, 256);
        assert_eq!(rgb, [118, 0, 255]);
    }
}
