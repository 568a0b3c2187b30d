//! Finds the scene that each of two eyes sees.

use crate::formats::options::{parts, with_length};
use crate::formats::video;
use crate::read::source::Source;
use crate::splats::format::Format;
use crate::splats::options::Options;
use crate::{Request, SceneError, builtin};
use eyebox_base::reason;
use std::path::Path;

/// Returns the sources of one scene for the left and the right eye. `eyes` are their places along x from the middle of
/// the scene in meters.
///
/// A built-in scene, splats and a picture with a depth map are seen from both places. A folder has a folder `left` and a
/// folder `right`, each with the views of one eye.
///
/// # Errors
/// [`SceneError::Options`] for a scene that has views of one eye only. The errors of finding the scene.
pub fn of_two_eyes(source: &str, request: &Request, eyes: [f64; 2]) -> Result<[String; 2], SceneError> {
    let (file, query) = parts(source);
    if Format::of(file).is_some() {
        let shift = Options::parse(query).map_err(|reason| SceneError::Options { scene: source.into(), reason })?.shift;
        return Ok(eyes.map(|eye| format!("{}?{}", file.display(), with_length(query, "shift", shift + eye))));
    }
    if let Some(name) = source.strip_prefix("builtin:") {
        return builtin::from_places(name, request, eyes);
    }
    let folder = Path::new(source);
    let both = ["left", "right"].map(|eye| folder.join(eye));
    if both.iter().all(|eye| eye.is_dir()) {
        return Ok(both.map(|eye| eye.display().to_string()));
    }
    match Source::of(source)? {
        Source::Picture(path) if video::named(path).is_none() => {
            Ok(eyes.map(|eye| format!("{}?{}", file.display(), with_length(query, "camera", eye))))
        }
        _ => Err(SceneError::Options {
            scene: source.into(),
            reason: reason!(
                "one-eye",
                "it has views of one eye only. Two eyes need a built-in scene, splats, a picture with a depth map, or a \
                 folder with a folder `left` and a folder `right`"
            ),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load;
    use eyebox_base::error::ErrorData;
    use eyebox_optics::{Color, Display};

    const IPD: f64 = 63e-3;
    const EYES: [f64; 2] = [-0.5 * IPD, 0.5 * IPD];

    /// Returns the shift along x (pixels) by which `b` has the most in common with `a`, to a hundredth of a pixel.
    fn shift(a: &[f32], b: &[f32], width: usize, most: i32) -> f64 {
        let height = a.len() / width;
        let product = |by: i32| -> f64 {
            let mut sum = 0.0;
            for y in height / 4..3 * height / 4 {
                for x in width / 4..3 * width / 4 {
                    let other = (x as i32 + by).clamp(0, width as i32 - 1) as usize;
                    sum -= f64::from(a[y * width + x] - b[y * width + other]).powi(2);
                }
            }
            sum
        };
        let best = (-most..=most).max_by(|a, b| product(*a).total_cmp(&product(*b))).unwrap();
        let [before, at, after] = [-1, 0, 1].map(|i| product(best + i));
        f64::from(best) + 0.5 * (before - after) / (before - 2.0 * at + after)
    }

    /// A plane at some dioptres is seen by both eyes in directions that differ by the vergence towards it.
    #[test]
    fn the_rendered_vergence_is_that_of_the_depth() {
        let display = Display { height: 512, width: 512, ..Display::preset("headset").unwrap() };
        let pixel = display.picture_pixel() / display.focal_length;
        for dioptres in [-0.15, 0.1, 0.18] {
            let depth_mm = dioptres * display.focal_length.powi(2) * 1e3;
            let request = Request { views: 1, ..Request::new(&display, &[Color::Green]) };
            let sources = of_two_eyes(&format!("builtin:plane?depth={depth_mm}"), &request, EYES).unwrap();
            let [left, right] = sources.map(|source| load(&source, &request).unwrap().planes[0].swap_remove(0));
            // Near content is farther to the right for the left eye.
            let found = -shift(&left, &right, 512, 126) * pixel;
            let expected = 2.0 * (0.5 * IPD * dioptres).atan();
            let arcmin = (found - expected).to_degrees() * 60.0;
            assert!(arcmin.abs() < 2.0, "{dioptres} D: {arcmin} arcmin off, {} seen", found.to_degrees() * 60.0);
        }
    }

    /// Splats at the near end of the depths have the vergence of this end. Those of an eye are the views from its place.
    #[test]
    fn splats_are_seen_from_both_places() {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = Vec::new();
        for i in 0..300u32 {
            let value = |which: u32| (i * 7919 + which * 104_729) % 1000;
            let place = [value(0) as f32 / 800.0 - 0.6, value(1) as f32 / 800.0 - 0.6, 2.0];
            bytes.extend(place.iter().chain(&[0.02; 3]).flat_map(|v| v.to_le_bytes()));
            bytes.extend([(value(2) % 256) as u8, (value(3) % 256) as u8, 90, 255, 255, 128, 128, 128]);
        }
        let file = folder.path().join("a.splat");
        std::fs::write(&file, bytes).unwrap();
        let display = Display { height: 512, width: 512, ..Display::preset("headset").unwrap() };
        let dioptres = 0.15;
        let depth = Some([0.0, dioptres * display.focal_length.powi(2)]);
        let request = Request { views: 1, depth, ..Request::new(&display, &[Color::Green]) };
        let source = format!("{}?eye=0,0,0&range=2,8&shift=1", file.display());
        let both = of_two_eyes(&source, &request, EYES).unwrap();
        assert!(both[0].ends_with("?eye=0,0,0&range=2,8&shift=-30.5"), "{}", both[0]);
        let [left, right] = both.map(|source| load(&source, &request).unwrap().planes[0].swap_remove(0));
        let found = -shift(&left, &right, 512, 126) * display.picture_pixel() / display.focal_length;
        let expected = 2.0 * (0.5 * IPD * dioptres).atan();
        let arcmin = (found - expected).to_degrees() * 60.0;
        assert!(arcmin.abs() < 2.0, "{arcmin} arcmin off, {} seen", found.to_degrees() * 60.0);
        let middle = crate::SplatViews::new(&source, &request).unwrap();
        assert_eq!(middle.views(Color::Green, &[(EYES[1], 0.0)]), [right]);
    }

    #[test]
    fn scenes_are_seen_from_both_places() {
        let display = Display { height: 64, width: 64, ..Display::preset("headset").unwrap() };
        let request = Request { views: 3, ..Request::new(&display, &[Color::Green]) };
        let [left, right] = of_two_eyes("builtin:still-life?brightness=0.5", &request, EYES).unwrap();
        assert!(left.contains("brightness=0.5&span=") && left.ends_with("camera=-31.5"), "{left}");
        assert!(right.ends_with("camera=31.5"), "{right}");
        let [a, b] = [&left, &right].map(|source| load(source, &request).unwrap());
        assert_eq!(a.depth, b.depth);
        assert_ne!(a.planes, b.planes);
        // A camera that is already moved stays the middle of both.
        let [moved, _] = of_two_eyes("builtin:still-life?camera=1&span=0.1", &request, EYES).unwrap();
        assert_eq!(moved, "builtin:still-life?span=0.1&camera=-30.5");
    }

    #[test]
    fn pictures_and_folders_of_two_eyes() {
        let folder = tempfile::tempdir().unwrap();
        let display = Display { height: 32, width: 32, ..Display::preset("headset").unwrap() };
        let (picture, map) = (folder.path().join("a.png"), folder.path().join("depth.png"));
        let ramp: Vec<u8> = (0..32 * 32).map(|i| ((i % 32) * 8) as u8).collect();
        for file in [&picture, &map] {
            image::save_buffer(file, &ramp, 32, 32, image::ColorType::L8).unwrap();
        }
        let request = Request { views: 3, depth_map: Some(&map), ..Request::new(&display, &[Color::Green]) };
        let source = picture.display().to_string();
        let both = of_two_eyes(&source, &request, EYES).unwrap();
        assert_eq!(both[1], format!("{source}?camera=31.5"));
        let [left, right] = both.map(|source| load(&source, &request).unwrap());
        assert_ne!(left.planes, right.planes);
        // The outermost views of both eyes are within the picture.
        let moved = left.disparity.unwrap()[1] * (EYES[1] / left.view_pitch.unwrap() + 1.0);
        assert!(moved > 1.0 && moved < 9.0, "{moved} pixels");

        let views = folder.path().join("scene");
        for eye in ["left", "right"] {
            std::fs::create_dir_all(views.join(eye)).unwrap();
        }
        let found = of_two_eyes(&views.display().to_string(), &request, EYES).unwrap();
        assert_eq!(found, ["left", "right"].map(|eye| views.join(eye).display().to_string()));
        std::fs::remove_dir(views.join("right")).unwrap();
        let error = of_two_eyes(&views.display().to_string(), &request, EYES).unwrap_err();
        assert_eq!(ErrorData::of(&error).code, "options/one-eye");
    }
}
