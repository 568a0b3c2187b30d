//! Tests pictures with ICC profiles against the color spaces' own equations in float64.

use super::display;
use crate::*;
use eyebox_optics::Color::{self, Blue, Green, Red};
use image::codecs::{jpeg::JpegEncoder, png::PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageBuffer, ImageEncoder, Luma, Rgb};
use moxcms::{ColorProfile, ToneReprCurve};
use std::path::Path;

const SIZE: [u32; 2] = [24, 32];
const COLORS: [Color; 3] = [Red, Green, Blue];

fn picture() -> DynamicImage {
    let pixel = |x: u32, y: u32| Rgb([(40 + x * 5) as u8, (50 + y * 7) as u8, (60 + (x + y) * 3) as u8]);
    ImageBuffer::from_fn(SIZE[1], SIZE[0], pixel).into()
}

fn gray() -> DynamicImage {
    ImageBuffer::from_fn(SIZE[1], SIZE[0], |x, y| Luma([(x * 7 + y) as u8])).into()
}

fn save(image: &DynamicImage, profile: Option<Vec<u8>>, at: &Path) {
    let file = std::fs::File::create(at).unwrap();
    let (bytes, kind) = (image.as_bytes(), ExtendedColorType::from(image.color()));
    if at.extension().is_some_and(|e| e == "jpg") {
        let mut encoder = JpegEncoder::new_with_quality(file, 100);
        profile.into_iter().for_each(|profile| encoder.set_icc_profile(profile).unwrap());
        encoder.write_image(bytes, SIZE[1], SIZE[0], kind).unwrap();
    } else {
        let mut encoder = PngEncoder::new(file);
        profile.into_iter().for_each(|profile| encoder.set_icc_profile(profile).unwrap());
        encoder.write_image(bytes, SIZE[1], SIZE[0], kind).unwrap();
    }
}

/// Returns the light of a picture, color by color.
fn light(scene: &Path) -> Result<Vec<Vec<f32>>, SceneError> {
    let map = scene.with_file_name("map.png");
    ImageBuffer::from_pixel(SIZE[1], SIZE[0], Luma([9u8])).save(&map).unwrap();
    let display = display(SIZE[0] as usize, SIZE[1] as usize);
    let request = Request { views: 1, depth_map: Some(&map), depth: Some([0.0; 2]), ..Request::new(&display, &COLORS) };
    Ok(load(scene.to_str().unwrap(), &request)?.planes.into_iter().map(|mut views| views.remove(0)).collect())
}

fn largest_difference(a: &[Vec<f32>], b: &[Vec<f32>]) -> f32 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Rows of the matrices from linear light of a color space to sRGB (both D65), from the chromaticities of the spaces.
const P3: [[f64; 3]; 3] =
    [[1.224_940, -0.224_940, 0.0], [-0.042_057, 1.042_057, 0.0], [-0.019_638, -0.078_636, 1.098_274]];
const ADOBE: [[f64; 3]; 3] = [[1.398_356, -0.398_356, 0.0], [0.0, 1.0, 0.0], [0.0, -0.042_941, 1.042_941]];

fn expected(image: &DynamicImage, curve: impl Fn(f64) -> f64, matrix: [[f64; 3]; 3]) -> Vec<Vec<f32>> {
    let pixels: Vec<[f64; 3]> = image.to_rgb8().pixels().map(|p| p.0.map(|v| curve(f64::from(v) / 255.0))).collect();
    let light = |row: [f64; 3], p: &[f64; 3]| (0..3).map(|k| row[k] * p[k]).sum::<f64>().clamp(0.0, 1.0) as f32;
    matrix.iter().map(|row| pixels.iter().map(|p| light(*row, p)).collect()).collect()
}

const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn with_curve(mut profile: ColorProfile, curve: ToneReprCurve) -> Vec<u8> {
    profile.red_trc = Some(curve.clone());
    profile.green_trc = Some(curve.clone());
    profile.blue_trc = Some(curve);
    profile.cicp = None;
    profile.encode().unwrap()
}

#[test]
fn a_profile_decides_what_a_picture_s_values_mean() {
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    let gamma = |g: f64| move |v: f64| v.powf(g);
    let srgb = light_field::light::srgb_to_linear;
    let encoded = |profile: ColorProfile| profile.encode().unwrap();
    let parametric = |g: f32| ToneReprCurve::Parametric(vec![g]);
    let srgb_18 = with_curve(ColorProfile::new_srgb(), parametric(1.8));
    let cases = [
        ("p3.png", picture(), encoded(ColorProfile::new_display_p3()), expected(&picture(), srgb, P3)),
        (
            "adobe.png",
            picture(),
            encoded(ColorProfile::new_adobe_rgb()),
            expected(&picture(), gamma(2.199_218_75), ADOBE),
        ),
        ("gamma18.png", picture(), srgb_18, expected(&picture(), gamma(1.8), IDENTITY)),
        (
            "gray22.png",
            gray(),
            encoded(ColorProfile::new_gray_with_gamma(2.2)),
            expected(&gray(), gamma(2.2), IDENTITY),
        ),
        (
            "gray18.png",
            gray(),
            encoded(ColorProfile::new_gray_with_gamma(1.8)),
            expected(&gray(), gamma(1.8), IDENTITY),
        ),
    ];
    for (name, image, profile, expected) in cases {
        save(&image, Some(profile), &at(name));
        save(&image, None, &at("plain.png"));
        let (found, plain) = (light(&at(name)).unwrap(), light(&at("plain.png")).unwrap());
        let [apart, from_plain] = [&expected, &plain].map(|other| largest_difference(&found, other));
        assert!(apart < 2e-3, "{name}: {apart}");
        assert!(from_plain > 4.0 * apart, "{name}: {from_plain} from sRGB, {apart} from its own equations");
    }
    // A JPEG of the same profile gives the same light, except for its own losses.
    save(&picture(), Some(encoded(ColorProfile::new_display_p3())), &at("p3.jpg"));
    assert!(largest_difference(&light(&at("p3.jpg")).unwrap(), &expected(&picture(), srgb, P3)) < 0.03);
}

#[test]
fn profiles_of_srgb_and_of_linear_light_are_read_by_the_exact_curves() {
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    save(&picture(), None, &at("plain.png"));
    let plain = light(&at("plain.png")).unwrap();
    save(&picture(), Some(ColorProfile::new_srgb().encode().unwrap()), &at("srgb.png"));
    assert_eq!(light(&at("srgb.png")).unwrap(), plain);
    // The curve is a table, as in older profiles.
    let table = (0..1024)
        .map(|i| (light_field::light::srgb_to_linear(f64::from(i) / 1023.0) * 65535.0).round() as u16)
        .collect();
    save(&picture(), Some(with_curve(ColorProfile::new_srgb(), ToneReprCurve::Lut(table))), &at("table.png"));
    assert_eq!(light(&at("table.png")).unwrap(), plain);
    let linear = with_curve(ColorProfile::new_srgb(), ToneReprCurve::Parametric(vec![1.0]));
    save(&picture(), Some(linear), &at("linear.png"));
    assert_eq!(light(&at("linear.png")).unwrap(), expected(&picture(), |v| v, IDENTITY));
}

#[test]
fn a_profile_that_means_nothing_for_the_picture_is_refused_until_the_transfer_is_stated() {
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    save(&picture(), None, &at("plain.png"));
    let plain = light(&at("plain.png")).unwrap();
    let gray = ColorProfile::new_gray_with_gamma(2.2).encode().unwrap();
    let cut = ColorProfile::new_display_p3().encode().unwrap()[..150].to_vec();
    let lab = ColorProfile::new_lab().encode().unwrap();
    for (i, profile) in [gray, cut, lab, vec![0; 400], b"profile".to_vec()].into_iter().enumerate() {
        save(&picture(), Some(profile), &at("wrong.png"));
        let answer = light(&at("wrong.png"));
        assert!(matches!(answer, Err(SceneError::Transfer { .. })), "{i}: {:?}", answer.err());
        assert_eq!(light(&at("wrong.png?srgb")).unwrap(), plain);
    }
}
