//! Finds the camera's map from a picture of dots, for any position, rotation, reflection and scale.

use super::fit::dot;
use super::map::CameraMap;
use super::pattern;
use super::picture::Picture;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use eyebox_optics::linear::solve;
use std::f64::consts::PI;

const NEEDED: f64 = 0.7;
/// Largest distance between a bright spot and its dot, share of the spacing.
const NEAR: f64 = 0.3;

/// The bright spots of a picture, (x, y) in its pixels, the clearest first. Dots have a radius of about `radius`
/// pixels.
fn spots(picture: &Picture, radius: f64, most: usize) -> Vec<[f64; 2]> {
    let (height, width) = (picture.height, picture.width);
    let r = (0.7 * radius).round().max(1.0) as usize;
    let smooth = blurred(&blurred(&picture.values, height, width, r), height, width, r);
    let around = blurred(&picture.values, height, width, (3.0 * radius) as usize + 1);
    let reach = (1.6 * radius).ceil() as i64;
    let mut found = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let v = smooth[y * width + x];
            let highest = (-reach..=reach).all(|dy| {
                let row = y as i64 + dy;
                !(0..height as i64).contains(&row)
                    || (x.saturating_sub(reach as usize)..=(x + reach as usize).min(width - 1)).all(|column| {
                        let other = smooth[row as usize * width + column];
                        other < v || other == v && (row as usize * width + column) >= y * width + x
                    })
            });
            if highest && v > around[y * width + x] {
                found.push((v - around[y * width + x], [x as f64, y as f64]));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(most);
    let centroid = |[x, y]: [f64; 2]| {
        let mut at = [x, y];
        for _ in 0..3 {
            let (mut sum, mut weight) = ([0.0; 2], 0.0);
            let r = 1.5 * radius;
            let floor = f64::from(around[at[1].round() as usize * width + at[0].round() as usize]);
            for row in (at[1] - r).ceil().max(0.0) as usize..=((at[1] + r).floor() as usize).min(height - 1) {
                for column in (at[0] - r).ceil().max(0.0) as usize..=((at[0] + r).floor() as usize).min(width - 1) {
                    let off = [column as f64 - at[0], row as f64 - at[1]];
                    // A window without an edge, so that pixels enter and leave with weight 0.
                    let share = (1.0 - (off[0] * off[0] + off[1] * off[1]) / (r * r)).max(0.0);
                    let v = (f64::from(picture.values[row * width + column]) - floor).max(0.0) * share;
                    sum = [sum[0] + v * column as f64, sum[1] + v * row as f64];
                    weight += v;
                }
            }
            if weight > 0.0 {
                at = [sum[0] / weight, sum[1] / weight];
            }
        }
        at
    };
    found.into_iter().map(|(_, at)| centroid(at)).collect()
}

/// The mean over a square of 2 r + 1 pixels, cut off at the edges.
fn blurred(values: &[f32], height: usize, width: usize, r: usize) -> Vec<f32> {
    let line = |from: &[f32], to: &mut [f32]| {
        let mut sums = vec![0.0f64];
        from.iter().for_each(|v| sums.push(sums[sums.len() - 1] + f64::from(*v)));
        for (i, out) in to.iter_mut().enumerate() {
            let (a, b) = (i.saturating_sub(r), (i + r + 1).min(from.len()));
            *out = ((sums[b] - sums[a]) / (b - a) as f64) as f32;
        }
    };
    let mut rows = vec![0.0; values.len()];
    rows.chunks_exact_mut(width).zip(values.chunks_exact(width)).for_each(|(to, from)| line(from, to));
    let turned = pattern::transposed(&rows, width);
    let mut columns = vec![0.0; values.len()];
    columns.chunks_exact_mut(height).zip(turned.chunks_exact(height)).for_each(|(to, from)| line(from, to));
    pattern::transposed(&columns, height)
}

/// The spot nearest to a place, and its distance.
fn nearest(spots: &[[f64; 2]], [x, y]: [f64; 2]) -> (usize, f64) {
    let far = |s: &[f64; 2]| (s[0] - x).hypot(s[1] - y);
    let best = (0..spots.len()).min_by(|a, b| far(&spots[*a]).total_cmp(&far(&spots[*b]))).unwrap_or(0);
    (best, spots.get(best).map_or(f64::INFINITY, far))
}

/// Finds the map by its dots, and its error, camera pixels RMS. The error states why the map cannot be found.
pub(super) fn find(picture: &Picture, slm: [usize; 2]) -> Result<(CameraMap, f64), Reason> {
    let camera = [picture.height, picture.width];
    let (dots, radius) = pattern::dots(slm);
    let spacing = radius / 0.21;
    let mut best: Option<(usize, f64, CameraMap)> = None;
    // The size of the SLM's image is unknown, from half a picture to all of it.
    let whole = camera[1] as f64 / slm[1] as f64;
    for share in [1.0, 0.8, 0.63, 0.5] {
        let spots = spots(picture, radius * whole * share, dots.len() * 5 / 4);
        if (spots.len() as f64) < NEEDED * dots.len() as f64 {
            continue;
        }
        for map in guesses(&dots, &spots, slm, camera, spacing) {
            let Some((count, rms, map)) = refined(&dots, &spots, map, spacing) else { continue };
            let better = best.is_none_or(|(c, r, _)| count > c || count == c && rms < r);
            if better {
                best = Some((count, rms, map));
            }
        }
        if best.is_some_and(|(count, rms, _)| count * 10 >= dots.len() * 9 && rms < 0.1 * spacing) {
            break;
        }
    }
    match best {
        Some((count, rms, map)) if count as f64 >= NEEDED * dots.len() as f64 => Ok((map, rms)),
        Some((count, ..)) => Err(reason!("few-dots", "only {count} of {} dots were found", dots.len())),
        None => Err(reason!("no-dots", "none of {} dots was found", dots.len())),
    }
}

/// The best 12 maps over all rotations, with and without reflection.
fn guesses(dots: &[[f64; 2]], spots: &[[f64; 2]], slm: [usize; 2], camera: [usize; 2], spacing: f64) -> Vec<CameraMap> {
    let middle = |points: &[[f64; 2]]| {
        let sum = points.iter().fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
        sum.map(|s| s / points.len() as f64)
    };
    let spread = |points: &[[f64; 2]], [x, y]: [f64; 2]| {
        (points.iter().map(|p| (p[0] - x).powi(2) + (p[1] - y).powi(2)).sum::<f64>() / points.len() as f64).sqrt()
    };
    let count = spots.len().min(dots.len());
    let (from, to) = (middle(dots), middle(&spots[..count]));
    let zoom = spread(&spots[..count], to) / spread(dots, from);
    let mut all = Vec::new();
    for i in 0..2 * 120 * 5 {
        let mirror = if i % 2 == 0 { 1.0 } else { -1.0 };
        let turn = f64::from(i / 2 % 120) * PI / 60.0;
        let scale = zoom * (0.9 + 0.05 * f64::from(i / 240));
        let (sin, cos) = turn.sin_cos();
        let affine = [mirror * scale * cos, -scale * sin, mirror * scale * sin, scale * cos];
        let at = |d: &[f64; 2]| {
            let (x, y) = (d[0] - from[0], d[1] - from[1]);
            [to[0] + affine[0] * x + affine[1] * y, to[1] + affine[2] * x + affine[3] * y]
        };
        let far = dots.iter().map(|d| (nearest(spots, at(d)).1 / (NEAR * spacing * scale)).min(1.0)).sum::<f64>();
        all.push((far, affine));
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let map = |affine: [f64; 4]| {
        // Pixels become places, which are scaled by half a width.
        let share = slm[1] as f64 / camera[1] as f64;
        let [a, b, d, e] = affine.map(|v| v * share);
        let mut map = CameraMap { numbers: [a, b, 0.0, d, e, 0.0, 0.0, 0.0, 0.0, 0.0], slm, camera };
        let at = map.to_camera(from);
        map.numbers[2] = 2.0 * (to[0] - at[0]) / camera[1] as f64;
        map.numbers[5] = 2.0 * (to[1] - at[1]) / camera[1] as f64;
        map
    };
    all.into_iter().take(12).map(|(_, affine)| map(affine)).collect()
}

/// Refines a map by the spots nearest to its dots, in rounds that are affine, then a homography, then with distortion.
fn refined(dots: &[[f64; 2]], spots: &[[f64; 2]], mut map: CameraMap, spacing: f64) -> Option<(usize, f64, CameraMap)> {
    let mut last = None;
    for (round, free) in
        [&AFFINE[..], &AFFINE, &AFFINE, &ALL[..8], &ALL[..8], &ALL[..9], &ALL[..9]].into_iter().enumerate()
    {
        let reach = NEAR * spacing * map.zoom() * if round < 3 { 1.5 } else { 1.0 };
        let pairs: Vec<_> = dots
            .iter()
            .filter_map(|d| {
                let (at, far) = nearest(spots, map.to_camera(*d));
                (far < reach).then(|| (*d, spots[at]))
            })
            .collect();
        if pairs.len() < 6 {
            return None;
        }
        let rms;
        (map, rms) = nearer(map, &pairs, free)?;
        last = Some((pairs.len(), rms, map));
    }
    last
}

/// One Gauss-Newton step of the map that takes places on the SLM (x, y) to camera pixels (x, y). Returns the map and
/// its error, camera pixels RMS.
pub(super) fn nearer(mut map: CameraMap, pairs: &[([f64; 2], [f64; 2])], free: &[usize]) -> Option<(CameraMap, f64)> {
    let miss = |map: &CameraMap| -> Vec<f64> {
        pairs.iter().flat_map(|(d, s)| (0..2).map(|i| map.to_camera(*d)[i] - s[i]).collect::<Vec<_>>()).collect()
    };
    let now = miss(&map);
    let slopes: Vec<Vec<f64>> = free
        .iter()
        .map(|&p| {
            let mut moved = map;
            moved.numbers[p] += 1e-6;
            miss(&moved).iter().zip(&now).map(|(m, n)| (m - n) / 1e-6).collect()
        })
        .collect();
    let normal: Vec<Vec<f64>> = slopes.iter().map(|a| slopes.iter().map(|b| dot(a, b)).collect()).collect();
    let right: Vec<f64> = slopes.iter().map(|a| -dot(a, &now)).collect();
    for (p, step) in free.iter().zip(solve(&normal, &right)?) {
        map.numbers[*p] += step;
    }
    let left = miss(&map);
    let rms = (dot(&left, &left) / pairs.len() as f64).sqrt();
    rms.is_finite().then_some((map, rms))
}

const AFFINE: [usize; 6] = [0, 1, 2, 3, 4, 5];
pub(super) const ALL: [usize; 9] = [0, 1, 2, 3, 4, 5, 6, 7, 8];

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of the dots through a map, with a background and stray spots.
    fn picture(map: &CameraMap) -> Picture {
        let (dots, radius) = pattern::dots(map.slm);
        let [height, width] = map.camera;
        let value = |i: usize| {
            let at = map.to_slm([(i % width) as f64, (i / width) as f64]);
            let inside = |d: &[f64; 2]| 1.0 / (1.0 + ((at[0] - d[0]).hypot(at[1] - d[1]) - radius).exp());
            let grain = 0.04 * ((i * 7919 % 101) as f64 / 101.0);
            (0.1 + grain + 0.6 * dots.iter().map(inside).sum::<f64>() * (1.0 - 0.5 * (at[0] / 96.0 - 0.5).abs())) as f32
        };
        Picture { height, width, values: (0..height * width).map(value).collect() }
    }

    #[test]
    fn the_map_is_found_however_the_camera_stands() {
        for (mirror, degrees, zoom) in [(1.0, 1.5, 0.9), (-1.0, -3.0, 0.8), (1.0, 182.0, 1.0), (-1.0, 94.0, 0.7)] {
            let (sin, cos) = f64::to_radians(degrees).sin_cos();
            let (a, b) = (zoom * cos, zoom * sin);
            let numbers = [mirror * a, -b, 0.02, mirror * b, a, -0.03, 0.01, -0.02, 0.01, 0.0];
            let truth = CameraMap { numbers, slm: [64, 96], camera: [150, 168] };
            let (map, rms) = find(&picture(&truth), truth.slm).unwrap_or_else(|e| panic!("{degrees}: {e}"));
            for at in [[10.0, 10.0], [80.0, 50.0], [48.0, 32.0]] {
                let (want, got) = (truth.to_camera(at), map.to_camera(at));
                let off = (want[0] - got[0]).hypot(want[1] - got[1]);
                assert!(off < 0.6 && rms < 0.6, "{degrees}: {off} pixels off, {rms} RMS");
            }
        }
        let dark = Picture { height: 100, width: 100, values: vec![0.01; 10_000] };
        assert!(find(&dark, [64, 96]).is_err());
    }
}
