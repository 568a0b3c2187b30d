//! Measures the speckle contrast of an even surface, and its reduction by sub-frames (OPTICS 8).

use super::energy::variation;

/// Returns the contrast of an image of an even surface, which is the standard deviation over the mean. It is 1 for
/// fully developed speckle.
pub fn contrast(image: &[f32]) -> f64 {
    variation(&image.iter().map(|v| f64::from(*v)).collect::<Vec<_>>())
}

/// Returns the contrast of the mean of `count` images, averaged over all sets into which `images` can be cut without
/// using an image twice. Returns none if there are fewer than `count` images.
///
/// For independent images it is `1 / sqrt(count)` of the contrast of one (Goodman, *Speckle Phenomena in Optics*,
/// 2007).
pub fn averaged_contrast(images: &[Vec<f32>], count: usize) -> Option<f64> {
    let sets = images.chunks_exact(count.max(1));
    let number = sets.len();
    let of = |set: &[Vec<f32>]| {
        let mut mean = vec![0.0f64; set[0].len()];
        for image in set {
            mean.iter_mut().zip(image).for_each(|(m, v)| *m += f64::from(*v));
        }
        variation(&mean)
    };
    (number > 0).then(|| sets.map(of).sum::<f64>() / number as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn independent_images_follow_the_root_and_equal_ones_do_not() {
        // Exponential intensities, which fully developed speckle has.
        let mut state = 7u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            -(((state >> 40) as f64 + 0.5) / 16_777_216.0).ln() as f32
        };
        let images: Vec<Vec<f32>> = (0..32).map(|_| (0..4000).map(|_| draw()).collect()).collect();
        assert!((contrast(&images[0]) - 1.0).abs() < 0.05);
        for count in [1, 2, 4, 8, 16] {
            let found = averaged_contrast(&images, count).unwrap();
            assert!((found * (count as f64).sqrt() - 1.0).abs() < 0.05, "{count}: {found}");
        }
        let same = vec![images[0].clone(); 8];
        assert!((averaged_contrast(&same, 8).unwrap() - contrast(&images[0])).abs() < 1e-9);
        assert_eq!(averaged_contrast(&same, 9), None);
    }

    #[test]
    fn an_even_image_has_none() {
        assert_eq!(contrast(&[0.4; 100]), 0.0);
        assert!((contrast(&[0.0, 1.0]) - 1.0).abs() < 1e-12);
    }
}
