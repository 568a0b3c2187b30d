//! Holograms without a solve, views and pictures for tests.

use eyebox::low_level::files::write_png;
use eyebox::low_level::hologram::{ColorHologram, Hologram};
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::scene;
use std::path::Path;

/// Makes a hologram of 36 x 64 pixels with `frames` sub-frames in the display's colors. Each `salt` gives other phases.
pub fn hologram(display: &Display, frames: usize, salt: usize) -> Hologram {
    hologram_of([36, 64], display, frames, salt)
}

/// Makes the same with these rows and columns.
pub fn hologram_of([height, width]: [usize; 2], display: &Display, frames: usize, salt: usize) -> Hologram {
    let color = |(i, w): (usize, &eyebox::low_level::optics::Wavelength)| ColorHologram {
        color: Some(w.color),
        wavelength: w.wavelength,
        exposure: 0.4,
        efficiency: 0.4,
        phases: (0..frames * height * width)
            .map(|k| ((k * 7919 + i * 31 + salt * 977) % 6283) as f32 * 1e-3 - 3.0)
            .collect(),
    };
    Hologram {
        height,
        width,
        ..Hologram::on(display, frames, display.wavelengths.iter().enumerate().map(color).collect())
    }
}

/// Writes 3 x 3 views of a scene, 64 x 64 pixels each, as `view_R_C.png` into a folder. The function `place` returns R
/// and C for the row and the column of a view.
pub fn views(folder: &Path, scene: &str, place: impl Fn(usize, usize) -> [usize; 2]) {
    let display = Display { height: 64, width: 64, ..Display::preset("paper").expect("a preset") };
    let colors = [Color::Green];
    let field = scene::load(scene, &scene::Request { views: 3, ..scene::Request::new(&display, &colors) });
    std::fs::create_dir_all(folder).expect("a folder");
    for (i, view) in field.expect("a scene").planes[0].iter().enumerate() {
        let [r, c] = place(i / 3, i % 3);
        write_png(&folder.join(format!("view_{r}_{c}.png")), 64, 64, &[view]).expect("written");
    }
}

/// Writes an uncompressed TIFF with interleaved little-endian samples. Format 1 is unsigned and format 3 is floating
/// point.
pub fn tiff(file: &Path, [height, width]: [u32; 2], [channels, bits, format]: [u16; 3], bytes: &[u8]) {
    let photometric = if channels >= 3 { 2 } else { 1 };
    let entries: [(u16, u16, u32); 9] = [
        (256, 4, width),
        (257, 4, height),
        (258, 3, u32::from(bits)),
        (259, 3, 1),
        (262, 3, photometric),
        (273, 4, 8),
        (277, 3, u32::from(channels)),
        (279, 4, bytes.len() as u32),
        (339, 3, u32::from(format)),
    ];
    let start = 8 + bytes.len() as u32;
    let beyond = start + 2 + 12 * 9 + 4;
    let mut out = [&b"II*\0"[..], &start.to_le_bytes(), bytes, &9u16.to_le_bytes()].concat();
    for (tag, kind, value) in entries {
        // Bits and format have one value per channel. The values of several channels are behind the table.
        let count = if (tag == 258 || tag == 339) && channels > 1 { u32::from(channels) } else { 1 };
        let value = match (tag, count > 1) {
            (258, true) => beyond,
            (339, true) => beyond + 2 * u32::from(channels),
            _ => value,
        };
        out.extend([&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value.to_le_bytes()].concat());
    }
    out.extend([0; 4]);
    (0..channels).for_each(|_| out.extend(bits.to_le_bytes()));
    (0..channels).for_each(|_| out.extend(format.to_le_bytes()));
    std::fs::write(file, out).expect("written");
}
