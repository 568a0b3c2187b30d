//! Fits the camera's map of a large SLM by the places of its pieces.
//!
//! Dots of a large SLM are many pixels wide, and an uneven beam shifts their centers by several pixels. This is more
//! than the width of a speckle, so no slope leads to the right place. Each piece is searched for near the place that
//! the model predicts. The map goes through the places that were found.

use super::classified::Sorted;
use super::dots::{ALL, nearer};
use super::error::CalibrateError;
use super::map::CameraMap;
use super::orders::Random;
use super::parameters::Parameters;
use super::slopes::shifts;
use super::views::View;

/// Shifts that are tried in each round, as the reach in steps and the step in SLM pixels. A speckle of a small iris is
/// 5 pixels wide.
const ROUNDS: [(i32, f64); 2] = [(5, 2.0), (3, 0.7)];
/// Number of camera pixels per piece.
const PIXELS: usize = 2000;
/// Number of pictures that are searched. They are those with the irises nearest to the axis.
const PICTURES: usize = 2;
const STEPS: usize = 6;
/// The least number of pieces that must be found.
const FEWEST: usize = 6;
/// A place that is this many SLM pixels off the map through all places is dropped.
const FAR: f64 = 3.0;

/// A place on the SLM (x, y) and the camera pixel (x, y) that was found to look at it.
type Found = ([f64; 2], [f64; 2]);

/// Returns the map on which the model predicts the pieces. It is the map of the dots if the whole SLM is simulated or
/// too few pieces are found.
pub(super) fn map(sorted: &mut Sorted, start: &Parameters) -> Result<CameraMap, CalibrateError> {
    let count = sorted.pictures.views.len();
    let mut at = start.clone();
    if sorted.pictures.are_whole() {
        return Ok(at.map);
    }
    let middles = add_views(sorted)?;
    let which: Vec<usize> = (count..sorted.pictures.views.len()).collect();
    for (reach, step) in ROUNDS {
        let shifts = shifts(&sorted.pictures, &at, &which, reach, step);
        tracing::debug!("shifts of the pieces, pixels: {shifts:.1?}");
        let found: Vec<Found> = (middles.iter().zip(shifts))
            .filter_map(|([x, y], shift)| shift.map(|[dx, dy]| ([x + dx, y + dy], at.map.to_camera([*x, *y]))))
            .collect();
        let Some(map) = through(at.map, found) else { break };
        at.map = map;
    }
    sorted.pictures.views.truncate(count);
    Ok(at.map)
}

/// Adds a view of each piece in the pictures that are searched. Returns the middles of the pieces (x, y), view by view.
fn add_views(sorted: &mut Sorted) -> Result<Vec<[f64; 2]>, CalibrateError> {
    let mut small = Random::new(sorted).small;
    let far = |v: &usize| {
        let pupil = sorted.pictures.views[*v].pupil();
        pupil.x.hypot(pupil.y)
    };
    small.sort_by(|a, b| far(a).total_cmp(&far(b)));
    let mut middles = Vec::new();
    for v in small.into_iter().take(PICTURES) {
        let view = &sorted.pictures.views[v];
        let picture = view.picture(sorted.camera)?;
        let mut pieces = Vec::new();
        for (part, slm) in sorted.pictures.parts.iter().enumerate() {
            let pixels = sorted.pixels_of(&picture, part, PIXELS);
            let counts: Vec<f64> = pixels.iter().map(|p| f64::from(picture.values[*p])).collect();
            let place = |p: &usize| [(p % picture.width) as f64, (p / picture.width) as f64];
            let looks = view.looks.iter().enumerate().map(|(i, (look, window))| {
                let here = if i == part { pixels.iter().map(place).collect() } else { Vec::new() };
                (look.of(here), *window)
            });
            let variance = vec![view.variance.iter().sum::<f64>() / view.variance.len() as f64; counts.len()];
            pieces.push(View { looks: looks.collect(), counts, variance, file: view.file.clone(), ..*view });
            let middle = |axis: usize| slm.first[axis] as f64 + slm.size[axis] as f64 / 2.0;
            middles.push([middle(1), middle(0)]);
        }
        sorted.pictures.views.extend(pieces);
    }
    Ok(middles)
}

/// The map that takes each place to the camera pixel that looks at it, or none if too few agree.
fn through(start: CameraMap, mut found: Vec<Found>) -> Option<CameraMap> {
    loop {
        if found.len() < FEWEST {
            return None;
        }
        let mut map = start;
        for _ in 0..STEPS {
            map = nearer(map, &found, &ALL)?.0;
        }
        let off = |(place, pixel): &Found| {
            let [x, y] = map.to_slm(*pixel);
            (x - place[0]).hypot(y - place[1])
        };
        let rms = (found.iter().map(|f| off(f).powi(2)).sum::<f64>() / found.len() as f64).sqrt();
        tracing::debug!("{} pieces, {rms:.2} pixels off", found.len());
        let count = found.len();
        found.retain(|f| off(f) < FAR.max(1.5 * rms));
        if found.len() == count {
            return Some(map);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_goes_through_the_pieces_that_were_found() {
        let dots = CameraMap {
            numbers: [-0.8687, 0.0771, -0.0411, 0.0761, 0.868, 0.0305, 0.0141, -0.01, 0.0068, 0.0],
            slm: [1080, 1920],
            camera: [1836, 3456],
        };
        let off = [0.0016, -0.0003, 0.0005, 0.0008, -0.0009, -0.0004, -0.0011, 0.0023, 0.0058, 0.0];
        let truth = CameraMap { numbers: std::array::from_fn(|i| dots.numbers[i] + off[i]), ..dots };
        let places = (0..12).map(|i| [96.0 + 576.0 * f64::from(i % 4), 96.0 + 444.0 * f64::from(i / 4)]);
        let mut found: Vec<Found> = places.map(|place| (place, truth.to_camera(place))).collect();
        let far = |map: CameraMap| {
            let off =
                |(place, pixel): &Found| (map.to_slm(*pixel)[0] - place[0]).hypot(map.to_slm(*pixel)[1] - place[1]);
            found.iter().map(off).fold(0.0, f64::max)
        };
        let map = through(dots, found.clone()).expect("a map");
        assert!(far(dots) > 3.0 && far(map) < 0.1, "{} pixels off, then {}", far(dots), far(map));
        // A piece that was found elsewhere is dropped, and too few pieces give no map.
        let wrong = found[5].0;
        found[5].0 = [wrong[0] + 10.0, wrong[1] - 8.0];
        let without = through(dots, found.clone()).expect("a map");
        found[5].0 = wrong;
        let far = |map: CameraMap| (map.to_slm(found[5].1)[0] - wrong[0]).hypot(map.to_slm(found[5].1)[1] - wrong[1]);
        assert!(far(without) < 0.3, "{}", far(without));
        assert!(through(dots, found[..FEWEST - 1].to_vec()).is_none());
    }
}
