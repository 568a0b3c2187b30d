//! Each fault of a link is applied to the test picture and found alone.

use super::draw::{Layout, TestPictureError, test_picture};
use super::judge::{CaptureReport, LinkFault, judge_capture};

const SIZES: [[usize; 2]; 3] = [[270, 480], [97, 259], [339, 300]];

fn picture(size: [usize; 2]) -> Vec<u8> {
    test_picture(size).expect("a picture")
}

fn judged(size: [usize; 2], captured: &[u8]) -> CaptureReport {
    judge_capture(size, captured, size).expect("a capture")
}

fn levels(picture: &[u8], of: impl Fn(usize, f64) -> f64) -> Vec<u8> {
    picture.iter().enumerate().map(|(i, v)| of(i % 3, f64::from(*v)).round().clamp(0.0, 255.0) as u8).collect()
}

/// Samples of a picture at other places.
fn moved(picture: &[u8], width: usize, size: [usize; 2], from: impl Fn(usize, usize) -> (usize, usize)) -> Vec<u8> {
    let pixel = |i: usize| {
        let (row, column) = from(i / size[1], i % size[1]);
        let at = 3 * (row * width + column);
        picture[at..at + 3].to_vec()
    };
    (0..size[0] * size[1]).flat_map(pixel).collect()
}

/// A link that sends YCbCr of BT.709 with 8 bits and limited range, and shares colors of `block` rows and columns.
fn subsampled(rgb: &[u8], [height, width]: [usize; 2], block: [usize; 2]) -> Vec<u8> {
    let (kr, kb) = (0.2126, 0.0722);
    let ycc: Vec<[f64; 3]> = rgb
        .chunks_exact(3)
        .map(|p| {
            let [r, g, b] = [0, 1, 2].map(|c| f64::from(p[c]) / 255.0);
            let y = kr * r + (1.0 - kr - kb) * g + kb * b;
            [y, (b - y) / (2.0 - 2.0 * kb), (r - y) / (2.0 - 2.0 * kr)]
        })
        .collect();
    let mean = |row: usize, column: usize, c: usize| {
        let (top, left) = (row / block[0] * block[0], column / block[1] * block[1]);
        let cells = (top..(top + block[0]).min(height))
            .flat_map(|r| (left..(left + block[1]).min(width)).map(move |x| r * width + x));
        let (sum, count) = cells.fold((0.0, 0.0), |(s, n), i| (s + ycc[i][c], n + 1.0));
        (224.0 * sum / count).round() / 224.0
    };
    let pixel = |i: usize| {
        let (row, column) = (i / width, i % width);
        let y = (219.0 * ycc[i][0]).round() / 219.0;
        let (cb, cr) = (mean(row, column, 1), mean(row, column, 2));
        let (r, b) = (y + (2.0 - 2.0 * kr) * cr, y + (2.0 - 2.0 * kb) * cb);
        let g = (y - kr * r - kb * b) / (1.0 - kr - kb);
        [r, g, b].map(|v| (255.0 * v).round().clamp(0.0, 255.0) as u8)
    };
    (0..height * width).flat_map(pixel).collect()
}

#[test]
fn an_exact_link_has_no_fault() {
    for size in SIZES {
        let report = judged(size, &picture(size));
        assert_eq!(report, CaptureReport { faults: Vec::new(), merged_levels: Some(0) }, "{size:?}");
    }
    let least = [96, 258];
    assert_eq!(test_picture([95, 300]), Err(TestPictureError::TooSmall { size: [95, 300], fewest: least }));
}

#[test]
fn every_level_has_its_columns() {
    for size in SIZES {
        let (layout, picture) = (Layout::new(size).expect("a layout"), picture(size));
        for level in 0..256 {
            let columns = layout.level(level);
            assert!(!columns.is_empty());
            for column in columns {
                let at = 3 * (layout.levels(0).start * size[1] + column);
                assert_eq!(picture[at..at + 3], [level as u8; 3], "{size:?}");
            }
        }
    }
}

#[test]
fn a_limited_range_merges_36_pairs() {
    for size in SIZES {
        let report = judged(size, &levels(&picture(size), |_, v| 16.0 + 219.0 * v / 255.0));
        assert_eq!(report, CaptureReport { faults: vec![LinkFault::LimitedRange], merged_levels: Some(36) });
    }
}

#[test]
fn a_ramp_shifts_levels() {
    for size in SIZES {
        let report = judged(size, &levels(&picture(size), |c, v| v * [1.0, 0.8, 0.6][c]));
        assert_eq!(report.faults, [LinkFault::Levels { shift: [0.0, 51.0, 102.0] }]);
        let curved = judged(size, &levels(&picture(size), |_, v| 255.0 * (v / 255.0).powf(2.2)));
        assert_eq!(curved.faults, [LinkFault::Levels { shift: [72.0; 3] }]);
    }
}

#[test]
fn shared_colors_are_found() {
    for size in SIZES {
        for (block, rows) in [([1, 2], false), ([2, 2], true)] {
            let report = judged(size, &subsampled(&picture(size), size, block));
            assert_eq!(report.faults, [LinkFault::ChromaSubsampled { rows }], "{size:?} {block:?}");
        }
        // YCbCr of the full resolution rounds, and 36 pairs of levels are equal.
        let report = judged(size, &subsampled(&picture(size), size, [1, 1]));
        assert_eq!(report, CaptureReport { faults: Vec::new(), merged_levels: Some(36) }, "{size:?}");
    }
}

#[test]
fn dither_is_found_and_noise_of_a_camera_is_refused() {
    for size in SIZES {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24) - 0.5
        };
        // Six bits with a random threshold.
        let dithered: Vec<u8> = picture(size)
            .iter()
            .map(|v| (((f64::from(*v) / 4.0 + random()).round() * 4.0).clamp(0.0, 255.0)) as u8)
            .collect();
        let report = judged(size, &dithered);
        // A quarter of the pixels are off. A median of few rows hides some of them.
        assert!(matches!(report.faults[..], [LinkFault::Dither { share, .. }, ..] if share > 0.1), "{report:?}");
        let plus: Vec<u8> = picture(size).iter().map(|v| v.saturating_add(u8::from(random() > 0.3))).collect();
        let report = judged(size, &plus);
        assert!(matches!(report.faults[..], [LinkFault::Dither { levels: 1.0, .. }]), "{report:?}");
        let noisy: Vec<u8> = picture(size).iter().map(|v| v.saturating_add((20.0 * (random() + 0.5)) as u8)).collect();
        let refused = judge_capture(size, &noisy, size);
        assert!(matches!(refused, Err(TestPictureError::NotACapture { noise, .. }) if noise > 3.0), "{refused:?}");
    }
}

#[test]
fn scaling_is_found() {
    for size in SIZES {
        let [height, width] = size;
        let all = picture(size);
        // A border of 1/20 on each side.
        let (top, left) = (height / 20, width / 20);
        let (rows, columns) = (height - 2 * top, width - 2 * left);
        let scaled = moved(&all, width, [rows, columns], |r, c| {
            (r * (height - 1) / (rows - 1), c * (width - 1) / (columns - 1))
        });
        let mut bordered = vec![0; all.len()];
        for row in 0..rows {
            let at = 3 * ((row + top) * width + left);
            bordered[at..at + 3 * columns].copy_from_slice(&scaled[3 * row * columns..3 * (row + 1) * columns]);
        }
        let inside = Some([top, left, top + rows - 1, left + columns - 1]);
        assert_eq!(judged(size, &bordered).faults, [LinkFault::Scaled { size, inside }]);
        // A capture with another number of pixels.
        let small = [rows, columns];
        let report = judge_capture(size, &scaled, small).expect("a capture");
        let inside = Some([0, 0, rows - 1, columns - 1]);
        assert_eq!(report.faults, [LinkFault::Scaled { size: small, inside }]);
        // The picture is moved by one column.
        let shifted = moved(&all, width, size, |r, c| (r, c.saturating_sub(1)));
        assert!(matches!(judged(size, &shifted).faults[..], [LinkFault::Scaled { .. }, ..]));
    }
}

#[test]
fn turned_and_mirrored_pictures_and_swapped_channels_are_found() {
    for size in SIZES {
        let [height, width] = size;
        let all = picture(size);
        for (degrees, mirrored) in [(90, false), (180, false), (270, false), (0, true), (90, true), (180, true)] {
            let turned_size = if degrees % 180 == 90 { [width, height] } else { size };
            let turned = moved(&all, width, turned_size, |r, c| {
                let c = if mirrored { turned_size[1] - 1 - c } else { c };
                match degrees {
                    90 => (height - 1 - c, r),
                    180 => (height - 1 - r, width - 1 - c),
                    270 => (c, width - 1 - r),
                    _ => (r, c),
                }
            });
            let report = judge_capture(size, &turned, turned_size).expect("a capture");
            assert_eq!(report.faults, [LinkFault::Turned { degrees, mirrored }], "{size:?}");
            assert_eq!(report.merged_levels, Some(0));
        }
        for order in ["rbg", "grb", "bgr"] {
            let place = |name: char| "rgb".find(name).expect("a channel");
            let to: Vec<usize> = order.chars().map(place).collect();
            let mut swapped = all.clone();
            for (pixel, was) in swapped.chunks_exact_mut(3).zip(all.chunks_exact(3)) {
                (0..3).for_each(|c| pixel[to[c]] = was[c]);
            }
            assert_eq!(judged(size, &swapped).faults, [LinkFault::ChannelsSwapped { order: order.into() }]);
        }
    }
}

#[test]
fn mixed_colors_and_other_pictures() {
    let size = SIZES[0];
    let mixed: Vec<u8> = picture(size)
        .chunks_exact(3)
        .flat_map(|p| [p[0], ((9 * u32::from(p[1]) + u32::from(p[0])) / 10) as u8, p[2]])
        .collect();
    assert!(matches!(judged(size, &mixed).faults[..], [.., LinkFault::ColorsMixed { levels }] if levels > 20.0));
    let gradient: Vec<u8> = (0..size[0] * size[1]).flat_map(|i| [(i / size[1] / 5) as u8; 3]).collect();
    let refused = judge_capture(size, &gradient, size);
    assert!(matches!(refused, Err(TestPictureError::NotACapture { likeness, .. }) if likeness < 0.9), "{refused:?}");
    assert_eq!(judge_capture(size, &[1, 2, 3], [2, 2]), Err(TestPictureError::Bytes { size: [2, 2], bytes: 3 }));
    assert!(judge_capture(size, &[1, 2, 3], [1, 1]).is_err());
}
