//! Pictures for the page: small, encoded, as `data:` addresses.

use super::figures::Picture;
use base64::{Engine as _, engine::general_purpose::STANDARD};
use eyebox::files::{encode_jpeg8, encode_rgb8, linear_to_srgb};
use eyebox::optics::Color;

/// No picture of the page is longer than this on either side, pixels.
pub const LONGEST: usize = 256;
const QUALITY: u8 = 85;

/// Linear light, one plane per colour, as people see it.
pub fn light(planes: &[(Color, &[f32])], height: usize, width: usize, psnr: Option<f64>) -> Picture {
    let (rgb, height, width) = composed(planes, height, width, LONGEST);
    jpeg(&rgb, height, width, psnr)
}

/// The same, pixel for pixel.
pub fn light_exact(planes: &[(Color, &[f32])], height: usize, width: usize) -> Picture {
    let (rgb, height, width) = composed(planes, height, width, usize::MAX);
    png(&rgb, height, width)
}

/// How far the first planes are from the second: the mean absolute difference over colours times `gain`, from black to
/// white through violet and orange.
pub fn error(pairs: &[(&[f32], &[f32])], height: usize, width: usize, gain: f64) -> Picture {
    let share = gain / pairs.len().max(1) as f64;
    let mut sum = vec![0.0f64; height * width];
    for (seen, wanted) in pairs {
        let difference = seen.iter().zip(*wanted).map(|(s, w)| f64::from((s - w).abs()));
        sum.iter_mut().zip(difference).for_each(|(s, d)| *s += share * d);
    }
    let (h, w, sum) = eyebox::evaluate::reduce(&sum, height, width, LONGEST);
    let rgb: Vec<u8> = sum.iter().flat_map(|v| ramp(*v)).collect();
    jpeg(&rgb, h, w, None)
}

/// Values from 0 to 1 on the same ramp, exactly.
pub fn map(values: &[f64], height: usize, width: usize) -> Picture {
    let rgb: Vec<u8> = values.iter().flat_map(|v| ramp(*v)).collect();
    png(&rgb, height, width)
}

/// A dark-to-light ramp of even steps in lightness, so that it reads the same without colour.
pub fn ramp(value: f64) -> [u8; 3] {
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

/// Red, green, blue levels; one plane alone is grey.
fn composed(planes: &[(Color, &[f32])], height: usize, width: usize, longest: usize) -> (Vec<u8>, usize, usize) {
    let mut channels: [Option<Vec<f64>>; 3] = [None, None, None];
    let (mut h, mut w) = (height, width);
    for (color, plane) in planes {
        let wide: Vec<f64> = plane.iter().map(|v| f64::from(*v)).collect();
        let small;
        (h, w, small) = eyebox::evaluate::reduce(&wide, height, width, longest);
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
    encode_rgb8(&mut bytes, height, width, rgb).expect("a vector takes everything");
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
    fn large_pictures_become_small_and_one_colour_grey() {
        let plane = vec![0.18f32; 300 * 600];
        let picture = light(&[(Color::Green, &plane)], 300, 600, Some(30.0));
        assert_eq!((picture.height, picture.width, picture.psnr), (128, 256, Some(30.0)));
        assert!(picture.data.starts_with("data:image/jpeg;base64,"));
        let (rgb, h, w) = composed(&[(Color::Green, &[0.18; 4])], 2, 2, 256);
        assert_eq!((rgb, h, w), (vec![118; 12], 2, 2));
        let (rgb, ..) = composed(&[(Color::Red, &[0.18]), (Color::Blue, &[1.0])], 1, 1, 256);
        assert_eq!(rgb, [118, 0, 255]);
    }
}
