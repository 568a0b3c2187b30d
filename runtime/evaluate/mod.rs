//! What an eye sees, what it should see, and how far apart the two are.
//!
//! May import `optics`, `scene`, `plan` and `engine`.

mod look;

pub use look::{photographs, views};

/// stand-in
pub fn psnr(image: &[f32], target: &[f32], exposure: f64) -> f64 {
    let sum: f64 = image.iter().zip(target).map(|(i, t)| (f64::from(*i) * exposure - f64::from(*t)).powi(2)).sum();
    -10.0 * (sum / image.len() as f64).log10()
}

/// stand-in
pub fn pool2(image: &[f32], h: usize, w: usize) -> Vec<f32> {
    if h < 2 || w < 2 {
        return image.to_vec();
    }
    let mut out = Vec::with_capacity(h / 2 * (w / 2));
    for y in 0..h / 2 {
        for x in 0..w / 2 {
            let at = |dy: usize, dx: usize| image[(2 * y + dy) * w + 2 * x + dx];
            out.push(0.25 * (at(0, 0) + at(0, 1) + at(1, 0) + at(1, 1)));
        }
    }
    out
}

/// stand-in
pub fn fit_exposure<'a>(pairs: impl IntoIterator<Item = (&'a [f32], &'a [f32])>) -> f64 {
    let (mut it, mut ii) = (0.0, 0.0);
    for (image, target) in pairs {
        for (i, t) in image.iter().zip(target) {
            it += f64::from(*i) * f64::from(*t);
            ii += f64::from(*i) * f64::from(*i);
        }
    }
    if ii > 0.0 { it / ii } else { 1.0 }
}

/// stand-in
#[derive(Debug)]
pub struct Summary {
    /// .
    pub mean: f64,
    /// .
    pub median: f64,
    /// .
    pub worst: f64,
    /// .
    pub best: f64,
    /// .
    pub sd: f64,
}

impl Summary {
    /// stand-in
    pub fn of(v: &[f64]) -> Self {
        let mut s = v.to_vec();
        s.sort_by(f64::total_cmp);
        let mean = v.iter().sum::<f64>() / v.len() as f64;
        let sd = (v.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / v.len() as f64).sqrt();
        Self { mean, median: s[s.len() / 2], worst: s[0], best: s[s.len() - 1], sd }
    }
}

/// stand-in
pub fn ssim(_a: &[f32], _b: &[f32], _h: usize, _w: usize) -> Result<f64, ()> {
    Err(())
}
