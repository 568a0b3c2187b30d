//! Holograms that nobody solved.

use eyebox::hologram::{ColorHologram, Hologram};
use eyebox::optics::Display;

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
