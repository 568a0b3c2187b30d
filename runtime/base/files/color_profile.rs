//! Converts pictures with an ICC profile of another color space to sRGB.

use super::{ColorSpace, Pixels, Samples, linear_to_srgb};
use crate::error::Reason;
use crate::reason;
use moxcms::{ColorProfile, DataColorSpace, Layout, ProfileText, TransformOptions};

/// Difference of sRGB values up to which color spaces count as the same, so that pictures are read by the exact curve.
/// sRGB profiles of different makers differ by less.
const SAME: f32 = 0.006;
/// Values per channel at which a profile is compared with sRGB.
const LATTICE: usize = 9;
/// Number of pixels that are converted at once.
const BLOCK: usize = 1 << 16;

/// Determines the color space of a picture, and converts its values to sRGB if it is another one. `full` is the stored
/// value of white. Colors outside of sRGB are clipped to it. Returns `None` for a picture without a profile.
///
/// # Errors
/// Returns a reason that states the fault of the profile.
pub fn color_space(picture: &Pixels, full: f32) -> Result<Option<ColorSpace>, Reason> {
    let Some(bytes) = &picture.profile else { return Ok(None) };
    let profile =
        ColorProfile::new_from_slice(bytes).map_err(|e| reason!("damaged-profile", "a damaged ICC profile ({e})"))?;
    let name = name(&profile);
    let is_gray = match profile.color_space {
        DataColorSpace::Gray => true,
        DataColorSpace::Rgb => false,
        other => return Err(reason!("color-space", "the ICC profile {name} of the color space {other:?}")),
    };
    if is_gray && picture.has_color() {
        return Err(reason!("gray-profile", "the ICC profile {name} of gray for a picture in color"));
    }
    let transform =
        Transform::new(&profile, is_gray).map_err(|e| reason!("profile", "the ICC profile {name} ({e})"))?;
    if transform.agrees_with(|v| v)? {
        return Ok(Some(ColorSpace::Srgb));
    }
    if transform.agrees_with(|v| linear_to_srgb(f64::from(v)) as f32)? {
        return Ok(Some(ColorSpace::Linear));
    }
    let (channels, has_alpha) = (picture.channels, picture.has_alpha());
    // White can be stated in the file. Full opacity is the largest value of the type.
    let share = |i: usize, v: f32, most: f32| {
        let is_alpha = has_alpha && (i + 1).is_multiple_of(channels);
        (v / if is_alpha { most } else { full }).min(1.0)
    };
    let mut values: Vec<f32> = match &picture.samples {
        Samples::U8(v) => v.iter().enumerate().map(|(i, v)| share(i, (*v).into(), 255.0)).collect(),
        Samples::U16(v) => v.iter().enumerate().map(|(i, v)| share(i, (*v).into(), 65535.0)).collect(),
        // Floats may exceed white, and profiles do not define that range.
        Samples::F32(_) => return Err(reason!("profile-of-floats", "the ICC profile {name} for floats")),
    };
    // A gray picture can have a color profile. The gray axis of the profile then applies.
    let colors = if picture.has_color() { 3 } else { 1 };
    for block in values.chunks_mut(BLOCK * channels) {
        let stored: Vec<f32> = block.chunks(channels).flat_map(|p| [p[0], p[colors / 2], p[colors - 1]]).collect();
        let converted = transform.colors(&stored)?;
        for (pixel, converted) in block.chunks_mut(channels).zip(converted.chunks(3)) {
            pixel[..colors].copy_from_slice(&converted[..colors]);
        }
    }
    Ok(Some(ColorSpace::Other { name, values }))
}

/// The conversion from a profile's color space to sRGB.
struct Transform {
    inner: std::sync::Arc<moxcms::TransformF32Executor>,
    is_gray: bool,
}

impl Transform {
    fn new(profile: &ColorProfile, is_gray: bool) -> Result<Self, moxcms::CmsError> {
        let layout = if is_gray { Layout::Gray } else { Layout::Rgb };
        let options = TransformOptions { prefer_fixed_point: false, ..TransformOptions::default() };
        let inner = profile.create_transform_f32(layout, &ColorProfile::new_srgb(), Layout::Rgb, options)?;
        Ok(Self { inner, is_gray })
    }

    /// Converts pixels of three values each. If the profile is gray, the first of the three counts.
    fn colors(&self, stored: &[f32]) -> Result<Vec<f32>, Reason> {
        let mut converted = vec![0.0; stored.len()];
        let done = if self.is_gray {
            let gray: Vec<f32> = stored.chunks(3).map(|p| p[0]).collect();
            self.inner.transform(&gray, &mut converted)
        } else {
            self.inner.transform(stored, &mut converted)
        };
        done.map_err(|e| reason!("profile", "an ICC profile that cannot be applied ({e})"))?;
        Ok(converted)
    }

    /// Returns true if each color comes out as `expected` of its own three values.
    fn agrees_with(&self, expected: impl Fn(f32) -> f32) -> Result<bool, Reason> {
        let level = |i: usize| (i % LATTICE) as f32 / (LATTICE - 1) as f32;
        let lattice: Vec<f32> = if self.is_gray {
            (0..LATTICE).flat_map(|i| [level(i); 3]).collect()
        } else {
            (0..LATTICE.pow(3)).flat_map(|i| [i, i / LATTICE, i / LATTICE.pow(2)].map(level)).collect()
        };
        let converted = self.colors(&lattice)?;
        Ok(converted.iter().zip(&lattice).all(|(found, stored)| (found - expected(*stored)).abs() <= SAME))
    }
}

/// Returns the name of a profile in quotation marks.
fn name(profile: &ColorProfile) -> String {
    let text = match &profile.description {
        Some(ProfileText::PlainString(text)) => text.as_str(),
        Some(ProfileText::Localizable(texts)) => texts.first().map_or("", |text| text.value.as_str()),
        Some(ProfileText::Description(text)) => text.ascii_string.as_str(),
        None => "",
    };
    let text: String = text.chars().filter(|c| !c.is_control()).take(60).collect();
    if text.is_empty() { "without a name".into() } else { format!("\"{text}\"") }
}
