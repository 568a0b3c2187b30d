//! Measures perceived differences in just-objectionable differences (JOD) with ColorVideoVDP.
//!
//! The metric is by Mantiuk et al., ACM Transactions on Graphics 43, 2024, from the crate `colorvideovdp`. A picture of
//! 10 JOD has no visible difference, and a picture has 1 JOD less if three of four observers prefer the other.
//!
//! The light of a display is its white times the picture (linear sRGB, as for
//! [`color_difference`](super::color_difference)), added to its black. Values brighter than white are kept, because no
//! display panel clips a hologram's speckle.

use super::EvaluateError;
use crate::optics::{Color, Viewing};
use colorvideovdp::{
    Color as Space, Cvvdp, DisplayModel, Error, Geometry, Image, Options, Photometry, Prediction, TemporalPadding,
};

/// Pictures with fewer rows or columns have no JOD.
const LEAST: usize = 4;
/// The brightest light that the metric distinguishes, in units of white.
const HEADROOM: f64 = 16.0;
/// The metric's own floor in cd/m2. Dimmer light counts as this.
const FLOOR: f64 = 0.005;
/// The memory limit of one evaluation, which needs about 50 bytes per pixel and channel.
const MEMORY: usize = 6 << 30;

/// The planes of a picture as red, green and blue. Each is linear light (row, column) with 1 as white.
pub type Rgb<'a> = [&'a [f32]; 3];

/// Arranges planes by their colors as a picture. A single plane makes a gray picture. Colors without a name are red,
/// green and blue in their order. `black`, a plane of zeros, replaces missing colors.
pub fn rgb<'a>(planes: &[(Option<Color>, &'a [f32])], black: &'a [f32]) -> Rgb<'a> {
    if let [(_, one)] = planes {
        return [one; 3];
    }
    let mut rgb: Rgb = [black; 3];
    for (i, (color, plane)) in planes.iter().enumerate() {
        rgb[color.map_or(i.min(2), Color::channel)] = plane;
    }
    rgb
}

/// The result for one picture or one video.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// The quality in JOD, 10 at most. It is below 0 for pictures with little in common.
    pub jod: f64,
    /// The loss in JOD per pixel, (row, column), as the mean over the frames of a video. It is empty if it was not
    /// requested.
    pub lost: Vec<f32>,
}

/// Compares pictures of one display, viewed from one position.
pub struct JodMetric {
    metric: Cvvdp,
    viewing: Viewing,
}

impl JodMetric {
    /// Creates the metric for a number of pixels per degree. With `maps`, it also computes [`Judged::lost`].
    ///
    /// # Errors
    /// Returns [`EvaluateError::Jod`] for an impossible viewing or number of pixels per degree.
    pub fn new(viewing: &Viewing, pixels_per_degree: f64, maps: bool) -> Result<Self, EvaluateError> {
        viewing.check().map_err(|reason| EvaluateError::Jod { reason })?;
        let peak = HEADROOM * viewing.luminance_cd_m2;
        let photometry = Photometry::new(peak, peak / FLOOR, 0.0, 0.0, 1.0).map_err(refused)?;
        // The resolution of the panel has no effect, because the pixels per degree are given.
        let geometry = Geometry::from_ppd([LEAST; 2], pixels_per_degree).map_err(refused)?;
        let display = DisplayModel::new("eyebox", photometry, geometry, "BT.709-linear").map_err(refused)?;
        let options = Options::default().with_distortion_map(maps).with_memory_limit_bytes(MEMORY);
        // A repeating video repeats also before its first frame.
        let options = options.with_temporal_padding(TemporalPadding::Symmetric);
        Ok(Self { metric: Cvvdp::new(display, options).map_err(refused)?, viewing: *viewing })
    }

    /// Compares the picture `seen` with the picture `wanted`, both `height` x `width`. Returns none for pictures of
    /// under 4 rows or columns, and if the metric would need more than 6 GiB.
    ///
    /// # Errors
    /// Returns [`EvaluateError::Sizes`], or [`EvaluateError::Jod`] for pictures with values that are not finite.
    pub fn picture(
        &self,
        seen: &Rgb,
        wanted: &Rgb,
        height: usize,
        width: usize,
    ) -> Result<Option<Judged>, EvaluateError> {
        let Some([seen, wanted]) = self.images([seen, wanted], height, width)? else { return Ok(None) };
        judged(self.metric.predict_image(&seen, &wanted, Space::Display), height * width)
    }

    /// Compares a video of `rate_hz` frames per second with one static picture.
    ///
    /// # Errors
    /// Returns the errors of [`picture`](Self::picture), and [`EvaluateError::Jod`] for a rate that is not above 0 and
    /// at most 16384.
    pub fn video(
        &self,
        seen: &[Rgb],
        wanted: &Rgb,
        height: usize,
        width: usize,
        rate_hz: f64,
    ) -> Result<Option<Judged>, EvaluateError> {
        let mut frames = Vec::with_capacity(seen.len());
        let Some([still]) = self.images([wanted], height, width)? else { return Ok(None) };
        for frame in seen {
            let Some([frame]) = self.images([frame], height, width)? else { return Ok(None) };
            frames.push(frame);
        }
        let still = vec![still; frames.len()];
        judged(self.metric.predict_video(&frames, &still, rate_hz as f32, Space::Display), height * width)
    }

    /// Returns pictures in cd/m2, or none if they are too small.
    fn images<const N: usize>(
        &self,
        pictures: [&Rgb; N],
        height: usize,
        width: usize,
    ) -> Result<Option<[Image; N]>, EvaluateError> {
        let size = height.saturating_mul(width);
        if let Some(plane) = pictures.iter().flat_map(|p| p.iter()).find(|p| p.len() != size) {
            return Err(EvaluateError::Sizes { one: plane.len(), other: size });
        }
        if height < LEAST || width < LEAST {
            return Ok(None);
        }
        let (white, black) = (self.viewing.luminance_cd_m2 as f32, self.viewing.black_cd_m2 as f32);
        let light = |v: f32| white * v.max(0.0) + black;
        let image = |[red, green, blue]: &Rgb| {
            let pixels = red.iter().zip(*green).zip(*blue);
            // `max(NaN, 0)` is 0, but NaN must stay NaN, so that it is refused.
            let pixel = |v: f32| if v.is_nan() { v } else { light(v) };
            let data = pixels.flat_map(|((r, g), b)| [pixel(*r), pixel(*g), pixel(*b)]).collect();
            Image::new(width, height, 3, data).map_err(refused)
        };
        let mut images = Vec::with_capacity(N);
        for picture in pictures {
            images.push(image(picture)?);
        }
        Ok(images.try_into().ok())
    }
}

fn refused(error: Error) -> EvaluateError {
    EvaluateError::Jod { reason: error.to_string().into() }
}

fn judged(found: colorvideovdp::Result<Prediction>, pixels: usize) -> Result<Option<Judged>, EvaluateError> {
    let found = match found {
        Ok(found) => found,
        Err(Error::MemoryLimitExceeded { .. } | Error::AllocationFailed | Error::SizeOverflow) => return Ok(None),
        Err(other) => return Err(refused(other)),
    };
    let lost = found.distortion_map.map_or_else(Vec::new, |map| {
        let mut lost = vec![0.0f32; pixels];
        for frame in map.data.chunks_exact(pixels) {
            lost.iter_mut().zip(frame).for_each(|(sum, raw)| *sum += raw * 10.0 / map.frames as f32);
        }
        lost
    });
    Ok(Some(Judged { jod: f64::from(found.jod), lost }))
}

/// Returns a picture of the loss as red, green and blue, to be written unchanged. It is the picture `wanted` in pale
/// gray. The loss covers it in colors from transparent through yellow to dark red at 8 JOD.
pub fn lost_picture(wanted: &Rgb, lost: &[f32]) -> [Vec<f32>; 3] {
    const MOST: f32 = 8.0;
    /// Colors from no loss to [`MOST`], encoded.
    const RAMP: [[f32; 3]; 4] = [[1.0, 0.95, 0.35], [1.0, 0.62, 0.1], [0.86, 0.15, 0.1], [0.4, 0.0, 0.13]];
    let mut out = [const { Vec::new() }; 3];
    for (i, lost) in lost.iter().enumerate() {
        let light = 0.2126 * wanted[0][i] + 0.7152 * wanted[1][i] + 0.0722 * wanted[2][i];
        let grey = 0.35 + 0.5 * light.clamp(0.0, 1.0).powf(1.0 / 2.2);
        let share = (lost / MOST).clamp(0.0, 1.0);
        let at = share * (RAMP.len() - 1) as f32;
        let (low, part) = ((at as usize).min(RAMP.len() - 2), at - (at as usize).min(RAMP.len() - 2) as f32);
        let cover = (share * 6.0).min(1.0);
        for (c, out) in out.iter_mut().enumerate() {
            let heat = RAMP[low][c] * (1.0 - part) + RAMP[low + 1][c] * part;
            // The values are encoded here, because writing encodes linear light once more.
            out.push((grey * (1.0 - cover) + (0.35 + 0.75 * grey) * heat * cover).powf(2.2));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole numbers, so that Python computes the same pictures.
    fn noise(height: usize, width: usize, salt: usize) -> Vec<f32> {
        let of = |i: usize| ((((i * 7919 + salt * 104_729) % 65521).pow(2) % 65521) % 1001) as f64 / 1000.0 - 0.5;
        (0..height * width).map(|i| of(i) as f32).collect()
    }

    fn base(height: usize, width: usize, kind: usize) -> [Vec<f32>; 3] {
        let value = |y: usize, x: usize| match kind {
            0 => ((3 * y + 2 * x) % 256) as f64 / 255.0,
            1 => ((x / 8 + y / 8) % 2) as f64 * 0.6 + 0.2,
            2 => ((x * x + y * y) / 16 % 64) as f64 / 63.0,
            _ => ((x / 16 * 37 + y / 16 * 91) % 101) as f64 / 100.0,
        };
        let mut rgb = [const { Vec::new() }; 3];
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let v = value(y, x);
            let pixel = [v, v * 0.75 + 0.25 * (y % 64) as f64 / 63.0, v * 0.5 + 0.5 * (x % 128) as f64 / 127.0];
            rgb.iter_mut().zip(pixel).for_each(|(plane, v)| plane.push(v as f32));
        }
        rgb
    }

    fn distorted(rgb: &[Vec<f32>; 3], width: usize, kind: usize, amount: f64) -> [Vec<f32>; 3] {
        let (height, part) = (rgb[0].len() / width, amount as f32);
        let rolled = |plane: &[f32], by: usize| -> Vec<f32> {
            plane.chunks_exact(width).flat_map(|row| (0..width).map(|x| row[(x + width - by) % width])).collect()
        };
        std::array::from_fn(|c| {
            let plane = &rgb[c];
            let add = |noise: Vec<f32>| plane.iter().zip(noise).map(|(v, n)| v + part * n).collect();
            match kind {
                0 => add(noise(height, width, 3)),
                1 => plane.iter().map(|v| v * part).collect(),
                2 => rolled(plane, amount as usize),
                3 => add(noise(height, width, c + 5)),
                _ => {
                    let moved: Vec<Vec<f32>> = (0..4).map(|by| rolled(plane, by)).collect();
                    (0..plane.len()).map(|i| (moved[0][i] + moved[1][i] + moved[2][i] + moved[3][i]) * 0.25).collect()
                }
            }
        })
    }

    fn borrow(rgb: &[Vec<f32>; 3]) -> Rgb<'_> {
        [&rgb[0], &rgb[1], &rgb[2]]
    }

    fn metric(pixels_per_degree: f64, white: f64, black: f64, maps: bool) -> JodMetric {
        let viewing = Viewing::default().with(Some(white), Some(black), None).unwrap();
        JodMetric::new(&viewing, pixels_per_degree, maps).unwrap()
    }

    /// Rows, columns, picture, distortion and its amount, pixels per degree, white and black in cd/m2. The last value
    /// is the JOD of the original in Python (cvvdp 0.5.7 with torch 2.15 on a CPU).
    type Recorded = (usize, usize, usize, usize, f64, f64, f64, f64, f64);
    const RECORDED: [Recorded; 20] = [
        (64, 96, 0, 0, 0.05, 60.0, 200.0, 0.2, 9.68293),
        (64, 96, 0, 0, 0.20, 60.0, 200.0, 0.2, 8.12967),
        (64, 96, 0, 0, 0.60, 60.0, 200.0, 0.2, 6.01235),
        (64, 96, 0, 0, 0.20, 30.0, 200.0, 0.2, 6.95080),
        (64, 96, 0, 0, 0.20, 120.0, 200.0, 0.2, 9.43273),
        (64, 96, 0, 0, 0.20, 873.0, 200.0, 0.2, 9.99830),
        (64, 96, 0, 0, 0.20, 60.0, 20.0, 0.2, 9.30729),
        (64, 96, 0, 0, 0.20, 60.0, 1000.0, 0.0, 7.83114),
        (80, 72, 1, 1, 0.80, 60.0, 200.0, 0.2, 10.00000),
        (80, 72, 1, 1, 1.30, 45.0, 200.0, 2.0, 9.99848),
        (80, 72, 1, 2, 2.00, 60.0, 200.0, 0.2, 6.21696),
        (80, 72, 2, 3, 0.10, 60.0, 200.0, 0.2, 9.71650),
        (80, 72, 2, 3, 0.40, 30.0, 200.0, 0.2, 7.99912),
        (80, 72, 2, 4, 0.00, 60.0, 200.0, 0.2, 6.13973),
        (80, 72, 2, 4, 0.00, 20.0, 200.0, 0.2, 5.46229),
        (128, 128, 3, 0, 0.10, 60.0, 200.0, 0.2, 9.67283),
        (128, 128, 3, 1, 0.50, 60.0, 200.0, 0.2, 10.00000),
        (128, 128, 3, 2, 3.00, 90.0, 500.0, 0.1, 5.61686),
        (128, 128, 3, 3, 0.80, 60.0, 80.0, 0.2, 7.45122),
        (33, 47, 0, 4, 0.00, 60.0, 200.0, 0.2, 6.56437),
    ];

    #[test]
    fn twenty_pictures_have_the_jod_of_the_original() {
        for (height, width, kind, distortion, amount, ppd, white, black, jod) in RECORDED {
            let wanted = base(height, width, kind);
            let seen = distorted(&wanted, width, distortion, amount);
            let found = metric(ppd, white, black, false).picture(&borrow(&seen), &borrow(&wanted), height, width);
            let found = found.unwrap().unwrap().jod;
            assert!((found - jod).abs() < 1e-3, "{kind} {distortion} {amount} {ppd}: {found:.5}, not {jod:.5}");
        }
    }

    /// The same original, with its symmetric padding in time. Faster flicker is less visible, but always more visible
    /// than its mean.
    #[test]
    fn sub_frames_are_the_video_that_the_original_sees() {
        let wanted = base(64, 96, 0);
        let frames: Vec<[Vec<f32>; 3]> = (0..16)
            .map(|f| {
                let grain = noise(64, 96, 11 + f % 8);
                std::array::from_fn(|c| wanted[c].iter().zip(&grain).map(|(v, n)| v + 0.6 * n).collect())
            })
            .collect();
        let frames: Vec<Rgb> = frames.iter().map(borrow).collect();
        for (rate, jod) in RECORDED_VIDEOS {
            let found = metric(60.0, 200.0, 0.2, false).video(&frames, &borrow(&wanted), 64, 96, rate).unwrap();
            let found = found.unwrap().jod;
            assert!((found - jod).abs() < 1e-3, "{rate} Hz: {found:.5}, not {jod:.5}");
        }
    }

    const RECORDED_VIDEOS: [(f64, f64); 3] = [(60.0, 6.49039), (240.0, 6.81755), (480.0, 6.81903)];

    #[test]
    fn what_is_lost_is_where_it_is_lost() {
        let wanted = base(64, 96, 3);
        let mut seen = wanted.clone();
        let grain = noise(64, 96, 1);
        for plane in &mut seen {
            for (i, v) in plane.iter_mut().enumerate().filter(|(i, _)| i % 96 >= 64) {
                *v += 0.5 * grain[i];
            }
        }
        let judged = metric(60.0, 200.0, 0.2, true).picture(&borrow(&seen), &borrow(&wanted), 64, 96).unwrap().unwrap();
        let mean = |from: usize, to: usize| {
            let of = (0..64 * 96).filter(|i| (from..to).contains(&(i % 96))).map(|i| f64::from(judged.lost[i]));
            of.sum::<f64>() / (64 * (to - from)) as f64
        };
        assert!(mean(72, 96) > 1.0 && mean(0, 40) < 0.1, "{} {}", mean(72, 96), mean(0, 40));
        let picture = lost_picture(&borrow(&wanted), &judged.lost);
        // Gray without a loss, and a warm color with a large loss.
        let spread = |i: usize| picture[0][i] - picture[2][i];
        assert!(spread(96 * 32 + 8).abs() < 0.05 && spread(96 * 32 + 88) > 0.2);
    }

    #[test]
    fn pictures_that_cannot_be_judged_have_no_jod_or_say_why() {
        let metric = metric(60.0, 200.0, 0.2, false);
        let (small, odd) = (vec![0.5f32; 9], vec![0.5f32; 12]);
        assert_eq!(metric.picture(&[&small; 3], &[&small; 3], 3, 3).unwrap(), None);
        assert!(matches!(metric.picture(&[&small; 3], &[&odd; 3], 3, 3), Err(EvaluateError::Sizes { .. })));
        let mut broken = vec![0.5f32; 64];
        let whole = broken.clone();
        broken[7] = f32::NAN;
        let said = metric.picture(&[&broken; 3], &[&whole; 3], 8, 8).unwrap_err();
        assert!(matches!(said, EvaluateError::Jod { .. }), "{said}");
        assert!(metric.video(&[[&whole; 3]], &[&whole; 3], 8, 8, 0.0).is_err());
        assert!(JodMetric::new(&Viewing::default(), f64::NAN, false).is_err());
        let grey = rgb(&[(Some(Color::Green), &whole)], &[]);
        assert_eq!(grey, [&whole[..]; 3]);
        let black = vec![0.0; 64];
        let two = rgb(&[(Some(Color::Blue), &whole), (Some(Color::Red), &broken[..])], &black);
        assert!(std::ptr::eq(two[2], &whole[..]) && std::ptr::eq(two[1], &black[..]));
    }
}
