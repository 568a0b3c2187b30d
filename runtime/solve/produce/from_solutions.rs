//! From solutions to a hologram.

use crate::hologram::{ColorHologram, Hologram, Metadata};
use crate::optics::{Color, Display, OpticsError, Padding};
use crate::scene::LightField;
use crate::solve::{Settings, Solution};

impl Hologram {
    /// The hologram of solved colours of a scene on a display, and how it was made.
    ///
    /// # Errors
    /// A colour that the display does not have.
    pub fn from_solutions(
        field: &LightField,
        display: &Display,
        settings: &Settings,
        padding: Padding,
        solutions: &[(Color, Solution)],
    ) -> Result<Self, OpticsError> {
        let color = |(color, s): &(Color, Solution)| {
            let wavelength = display.optics(*color)?.wavelength;
            let Solution { exposure, efficiency, .. } = *s;
            Ok(ColorHologram { color: Some(*color), wavelength, exposure, efficiency, phases: s.phases.clone() })
        };
        let (views, cell) = field.own_views(display);
        let colors = solutions.iter().map(color).collect::<Result<_, _>>()?;
        Ok(Self {
            seed: settings.seed,
            version: env!("CARGO_PKG_VERSION").into(),
            scene: field.name.clone(),
            metadata: Metadata {
                solve: Some(settings.clone()),
                padded: Some([padding.rows, padding.columns]),
                views: Some(views),
                view_pitch_mm: Some(cell * 1e3),
                eyebox_mm: Some(display.eyebox_min() * 1e3),
                model: display.model.clone(),
                source: display.source.clone(),
                mask: display.mask.clone(),
                sources: display.sources.clone(),
                picture: display.picture,
                prescription: display.prescription.clone(),
                viewing: display.viewing,
                display_file: display.file.clone(),
                ..Metadata::default()
            },
            ..Self::on(display, settings.frames, colors)
        })
    }
}
