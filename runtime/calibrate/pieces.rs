//! Chooses pieces of a large SLM that are simulated instead of all of it.
//!
//! A camera pixel sees light from a few SLM pixels around the point that it looks at. The small irises have speckles of
//! 5 pixels, and crosstalk reaches no farther. Twelve pieces of 192 x 192 pixels have a fifth of the pixels of 1080 x
//! 1920, and their transforms stay in a cache.

use super::map::CameraMap;
use eyebox_optics::SlmPart;

/// Rows and columns of a piece.
const SIDE: usize = 192;
/// Pixels at the edges of a piece that no used camera pixel looks at, because light from beyond the edge is missing
/// there.
const MARGIN: f64 = 32.0;
/// Number of pieces along the shorter and the longer side of the area that the camera sees.
const COUNT: [usize; 2] = [3, 4];
/// Pixels at the edges of a whole SLM that no used camera pixel looks at, along y and along x.
const RIM: [f64; 2] = [2.0, 3.0];

/// The parts of an SLM that are simulated. It is the whole SLM, unless pieces of the area that the camera sees have far
/// fewer pixels.
pub(super) fn pieces(map: &CameraMap) -> Vec<SlmPart> {
    let slm = map.slm;
    if slm[0] * slm[1] <= COUNT[0] * COUNT[1] * SIDE * SIDE || slm.iter().any(|n| *n < SIDE) {
        return vec![slm.into()];
    }
    let seen = seen(map);
    let is_tall = seen[0][1] - seen[0][0] > seen[1][1] - seen[1][0];
    let counts = if is_tall { [COUNT[1], COUNT[0]] } else { COUNT };
    let firsts = [0, 1].map(|axis| {
        let last = seen[axis][1].saturating_sub(SIDE).max(seen[axis][0]).min(slm[axis] - SIDE);
        let first = seen[axis][0].min(last);
        let at = |i: usize| first + (last - first) * i / (counts[axis] - 1);
        let mut firsts: Vec<usize> = (0..counts[axis]).map(at).collect();
        firsts.dedup();
        firsts
    });
    let piece =
        |row: usize| firsts[1].iter().map(move |column| SlmPart { slm, first: [row, *column], size: [SIDE; 2] });
    firsts[0].iter().flat_map(|row| piece(*row)).collect()
}

/// The range of rows, then of columns, of the SLM that the camera sees.
fn seen(map: &CameraMap) -> [[usize; 2]; 2] {
    let [height, width] = map.camera.map(|n| n as f64);
    const STEPS: usize = 16;
    let places = (0..=STEPS).flat_map(|i| {
        let t = i as f64 / STEPS as f64;
        [[t * width, 0.0], [t * width, height], [0.0, t * height], [width, t * height]]
    });
    let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for place in places {
        let [x, y] = map.to_slm(place);
        for (range, at) in range.iter_mut().zip([y, x]) {
            *range = [range[0].min(at), range[1].max(at)];
        }
    }
    [0, 1].map(|axis| range[axis].map(|at| at.clamp(0.0, map.slm[axis] as f64).round() as usize))
}

/// The piece that predicts the point (x, y) of the SLM, if there is one.
pub(super) fn holding(pieces: &[SlmPart], [x, y]: [f64; 2]) -> Option<usize> {
    let inside = |at: f64, first: usize, size: usize, slm: usize| {
        let [low, high] = if size == slm { RIM } else { [MARGIN; 2] };
        (first as f64 + low..(first + size) as f64 - high).contains(&at)
    };
    pieces.iter().position(|part| {
        inside(y, part.first[0], part.size[0], part.slm[0]) && inside(x, part.first[1], part.size[1], part.slm[1])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(slm: [usize; 2], zoom: f64) -> CameraMap {
        CameraMap { numbers: [zoom, 0.0, 0.0, 0.0, zoom, 0.0, 0.0, 0.0, 0.0, 0.0], slm, camera: slm.map(|n| 2 * n) }
    }

    #[test]
    fn a_large_slm_is_cut_into_pieces_of_what_the_camera_sees() {
        for slm in [[256, 256], [512, 512], [100, 8000]] {
            assert_eq!(pieces(&camera(slm, 0.9)), [SlmPart::from(slm)]);
        }
        for (slm, counts) in [([1080, 1920], [3, 4]), ([1920, 1080], [4, 3])] {
            let all = pieces(&camera(slm, 0.9));
            assert_eq!(all.len(), counts[0] * counts[1]);
            assert_eq!((all[0].first, all[all.len() - 1].first), ([0, 0], slm.map(|n| n - SIDE)));
            // In the middle of a piece, in its margin, and between pieces.
            let at = |i: usize, off: f64| [1, 0].map(|axis| all[i].first[axis] as f64 + off);
            assert_eq!(holding(&all, at(4, 90.0)), Some(4));
            assert_eq!([holding(&all, at(4, 20.0)), holding(&all, [0.0, 0.0])], [None; 2]);
        }
        // The camera sees the middle third.
        let all = pieces(&camera([1080, 1920], 3.0));
        let seen = |part: &SlmPart| part.first[0] >= 355 && part.first[0] + SIDE <= 725 && part.first[1] >= 635;
        assert!(all.len() == 12 && all.iter().all(seen), "{all:?}");
        // A whole SLM has no margin except its rim.
        let whole = [SlmPart::from([256, 256])];
        assert_eq!(
            [[2.0, 2.0], [252.9, 9.0], [1.9, 9.0], [253.0, 9.0]].map(|at| holding(&whole, at)),
            [Some(0), Some(0), None, None]
        );
    }
}
