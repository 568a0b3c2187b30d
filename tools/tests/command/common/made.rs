//! Holograms that nobody solved, and views.

use eyebox::files::write_png;
use eyebox::hologram::{ColorHologram, Hologram};
use eyebox::optics::{Color, Display};
use eyebox::scene;
use std::path::Path;

/// So many sub-frames of 36 x 64 in the display's colours; another for every `salt`.
pub fn hologram(display: &Display, frames: usize, salt: usize) -> Hologram {
    let color = |(i, w): (usize, &eyebox::optics::Wavelength)| ColorHologram {
        color: Some(w.color),
        wavelength: w.wavelength,
        exposure: 0.4,
        efficiency: 0.4,
        phases: (0..frames * 36 * 64).map(|k| ((k * 7919 + i * 31 + salt * 977) % 6283) as f32 * 1e-3 - 3.0).collect(),
    };
    Hologram {
        height: 36,
        width: 64,
        ..Hologram::on(display, frames, display.wavelengths.iter().enumerate().map(color).collect())
    }
}

/// 3 x 3 views of a scene, 64 x 64, as `view_R_C.png` in a folder; by their names in the order that `place` says.
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
