//! Tests flips, rotations, offsets and cells of whole pictures.

use super::*;

/// Returns the hologram's pixel that each pixel of the SLM shows, by moving whole pictures.
fn turned(picture: &[f32], h: usize, w: usize, flip: (bool, bool), rotation: u32, [down, right]: [i32; 2]) -> Vec<f32> {
    let at = |p: &[f32], w: usize, y: usize, x: usize| p[y * w + x];
    let mut now: Vec<f32> = picture.to_vec();
    let (mut h, mut w) = (h, w);
    if flip.0 {
        now = (0..h * w).map(|i| at(&now, w, i / w, w - 1 - i % w)).collect();
    }
    if flip.1 {
        now = (0..h * w).map(|i| at(&now, w, h - 1 - i / w, i % w)).collect();
    }
    for _ in 0..rotation / 90 {
        // Clockwise rotation makes the first column, read upwards, the first row.
        now = (0..h * w).map(|i| at(&now, w, h - 1 - i % h, i / h)).collect();
        (h, w) = (w, h);
    }
    let back = |i: usize, by: i32, n: usize| (i as i64 - i64::from(by)).rem_euclid(n as i64) as usize;
    (0..h * w).map(|i| at(&now, w, back(i / w, down, h), back(i % w, right, w))).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Any rotation of a hologram is the rotation of the picture, and the inverse rotation gives the picture.
    #[test]
    fn turns_are_those_of_whole_pictures(
        h in 1usize..14, w in 1usize..40, mirrored: bool, overturned: bool, quarter in 0u32..4,
        down in -50i32..50, right in -50i32..50, correct: bool,
    ) {
        let here = here();
        let names = [["none", "vertical"], ["horizontal", "both"]];
        let flip = names[usize::from(mirrored)][usize::from(overturned)];
        let rotation = 90 * quarter;
        let [sh, sw] = if quarter % 2 == 1 { [w, h] } else { [h, w] };
        let mut text = format!("flip = \"{flip}\"\nrotation_deg = {rotation}\noffset_px = [{down}, {right}]\n");
        let phases = noise(h * w, (h * w) as u64);
        let mut sum = phases.clone();
        if correct {
            // In the hologram's orientation, the correction is rotated with it.
            let extra: Vec<f32> = (0..h * w).map(|i| (i % 7) as f32 * 0.5).collect();
            crate::files::write_npy(&here.path().join("c.npy"), &[h, w], &extra).unwrap();
            text += "[[encoding.correction]]\nfile = \"c.npy\"\nsign = 1\n";
            sum = sum.iter().zip(&extra).map(|(p, e)| (f64::from(*p) + f64::from(*e)) as f32).collect();
        }
        let display = with(&text, here.path(), [sh, sw], 256);
        let frames = encode(&display, &ALL[..1], 1, &[phases]);
        let wanted = turned(&sum, h, w, (mirrored, overturned), rotation, [down, right]);
        for (level, phase) in frames.frame(0).iter().zip(&wanted) {
            let exact = (f64::from(*phase) / TAU).rem_euclid(1.0) * 256.0;
            let off = (exact - f64::from(*level) + 128.0).rem_euclid(256.0) - 128.0;
            // The sum above was rounded to float32, which for 1e6 is an error of 1.3 levels.
            prop_assert!(off.abs() <= 0.51 || correct && phase.abs() > 1e4, "{exact} became {level}");
        }
        // The inverse is the other rotation, then the flip undone by hand.
        let mut undone = with(&format!("rotation_deg = {}", (360 - rotation) % 360), here.path(), [h, w], 256);
        undone.name = "back".into();
        let only = with(&format!("rotation_deg = {rotation}"), here.path(), [sh, sw], 256);
        let plain = with("", here.path(), [h, w], 256);
        let phases = noise(h * w, 3);
        let there = encode(&only, &ALL[..1], 1, std::slice::from_ref(&phases));
        let levels: Vec<f32> = there.frame(0).iter().map(|l| (f64::from(*l) / 256.0 * TAU) as f32).collect();
        prop_assert_eq!(encode(&undone, &ALL[..1], 1, &[levels]), encode(&plain, &ALL[..1], 1, &[phases]));
    }

    /// A correction in the SLM's orientation stays in place for any rotation of the hologram.
    #[test]
    fn a_correction_of_the_slm_is_not_turned(h in 1usize..9, w in 1usize..9, quarter in 0u32..4, right in -9i32..9) {
        let here = here();
        let image: Vec<f32> = (0..h * w).map(|i| (i as f32) * 0.1).collect();
        crate::files::write_npy(&here.path().join("c.npy"), &[h, w], &image).unwrap();
        let text = format!(
            "rotation_deg = {}\noffset_px = [1, {right}]\nflip = \"both\"\n[[encoding.correction]]\nfile = \"c.npy\"\n\
             sign = -1\norientation = \"slm\"\n", 90 * quarter
        );
        let frames = encode(&with(&text, here.path(), [h, w], 256), &ALL[..1], 1, &[vec![0.0; h * w]]);
        for (level, c) in frames.frame(0).iter().zip(&image) {
            prop_assert!(is_nearest(*level, -*c, even(256), 256));
        }
    }

    /// Tests cells of any shape and any flip of the video frame, pixel by pixel.
    #[test]
    fn cells_are_undone(
        h in 1usize..6, w in 1usize..40, shape in prop::sample::select(vec![(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (4, 1), (1, 4)]),
        mirrored: bool, overturned: bool, bit in 0usize..8,
    ) {
        let (rows, columns): (usize, usize) = shape;
        let bits = (rows * columns) as u32;
        let (levels, here) = (1u32 << bits, here());
        let cells: Vec<Vec<u32>> = (0..rows).map(|r| (0..columns).map(|c| bits - 1 - (r * columns + c) as u32).collect()).collect();
        let flip = [["none", "vertical"], ["horizontal", "both"]][usize::from(mirrored)][usize::from(overturned)];
        let text = format!("packing = \"planes8\"\ncells = {cells:?}\nflip_video = \"{flip}\"");
        let display = with(&text, here.path(), [h, w], levels);
        let phases = noise(8 * h * w, 5);
        let frames = encode(&display, &ALL[..1], 8, std::slice::from_ref(&phases));
        let (vh, vw) = (rows * h, columns * w);
        prop_assert_eq!((frames.height, frames.width), (vh, vw));
        for y in 0..h {
            for x in 0..w {
                let mut level = 0;
                for (r, row) in cells.iter().enumerate() {
                    for (c, cell) in row.iter().enumerate() {
                        let (vy, vx) = (y * rows + r, x * columns + c);
                        let vy = if overturned { vh - 1 - vy } else { vy };
                        let vx = if mirrored { vw - 1 - vx } else { vx };
                        level |= (frames.frame(0)[vy * vw + vx] >> bit & 1) << cell;
                    }
                }
                prop_assert!(is_nearest(level, phases[(bit * h + y) * w + x], even(levels), levels));
            }
        }
    }
}
