//! Computes field of view, eyebox, depths and etendue of a display in common units.

use super::{Color, Display, dioptres};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// The field of view, eyebox, depths and etendue of a display.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Reach {
    /// Angular size of the picture in degrees, (up, across), `2 asin(extent / 2 f)`.
    pub field_of_view_degrees: [f64; 2],
    /// Pixels per degree in the middle of the picture.
    pub pixels_per_degree: f64,
    /// Side in mm of the eyebox that all colors serve, for one source.
    pub eyebox_mm: f64,
    /// Side in mm of each color's own eyebox.
    pub eyebox_mm_by_color: BTreeMap<Color, f64>,
    /// The farthest and the nearest depth in mm. Beyond them, content moves by more than half the picture's shorter
    /// side as the pupil goes from the middle of the eyebox to its edge, and wraps around (OPTICS 2).
    pub depth_mm: [f64; 2],
    /// The farthest and the nearest depth in diopters.
    pub depth_dioptres: [f64; 2],
    /// Area of the eyebox times the solid angle of the picture (small angles), mm2 sr.
    pub etendue_mm2_sr: f64,
    /// The values with switchable sources, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sources: Option<SourcesReach>,
    /// The values without the mask, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub without_mask: Option<WithoutMask>,
}

/// The eyebox of a display without the static mask in front of its SLM. The field of view stays the same.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct WithoutMask {
    /// Mask pixels per SLM pixel along an axis.
    pub factor: usize,
    /// Side in mm of the eyebox that all colors serve.
    pub eyebox_mm: f64,
    /// Area of the eyebox times the solid angle of the picture, mm2 sr.
    pub etendue_mm2_sr: f64,
}

/// The eyebox of a display with its switchable sources. The field of view stays the same.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct SourcesReach {
    /// Number of switchable sources.
    pub sources: usize,
    /// Sides in mm of the rectangle around their eyeboxes, (up, across).
    pub eyebox_mm: [f64; 2],
    /// Area of that rectangle that the eyeboxes cover, mm2.
    pub area_mm2: f64,
    /// The covered area times the solid angle of the picture, mm2 sr.
    pub etendue_mm2_sr: f64,
    /// The longest switching time of a source in microseconds.
    pub switching_us: f64,
    /// Duration of a sub-frame in microseconds.
    pub sub_frame_us: f64,
    /// Share of light that remains in the sub-frames of the source that loses most, if the sources take turns. It is 1
    /// if they are not switched between sub-frames.
    pub lit_share: f64,
}

impl Display {
    /// Computes what the display can show. Content at depth z moves by `z w / (2 f)` from the middle to the edge of the
    /// eyebox of width w. Therefore it moves by half a picture of extent e at `z = e f / w` (behind a relay `N p^2 /
    /// wavelength`).
    pub fn reach(&self) -> Reach {
        let (f, pixel, (rows, columns)) = (self.focal_length, self.picture_pixel(), self.picture_size());
        let extent = [rows, columns].map(|n| n as f64 * pixel);
        let depth = extent[0].min(extent[1]) * f / self.eyebox_min();
        let solid = extent[0] * extent[1] / (f * f);
        let (whole, area) = self.whole_eyebox();
        let sources = &self.sources.each;
        let sources = (!sources.is_empty()).then(|| SourcesReach {
            sources: sources.len(),
            eyebox_mm: [whole.size[1] * 1e3, whole.size[0] * 1e3],
            area_mm2: area * 1e6,
            etendue_mm2_sr: area * solid * 1e6,
            switching_us: self.sources.switching_us(),
            sub_frame_us: self.sub_frame_us(),
            lit_share: self.least_lit(),
        });
        let factor = self.mask_factor();
        let without_mask = self.mask.as_ref().map(|_| {
            let eyebox_mm = self.source_eyebox_min() * 1e3 / factor as f64;
            WithoutMask { factor, eyebox_mm, etendue_mm2_sr: eyebox_mm.powi(2) * solid }
        });
        let own = |w: &super::Wavelength| Some((w.color, self.optics(w.color).ok()?.eyebox() * 1e3));
        Reach {
            field_of_view_degrees: extent.map(|e| 2.0 * (e / (2.0 * f)).min(1.0).asin().to_degrees()),
            pixels_per_degree: (f / pixel).to_radians(),
            eyebox_mm: self.source_eyebox_min() * 1e3,
            eyebox_mm_by_color: self.wavelengths.iter().filter_map(own).collect(),
            depth_mm: [-depth * 1e3, depth * 1e3],
            depth_dioptres: [-dioptres(depth, f), dioptres(depth, f)],
            etendue_mm2_sr: self.source_eyebox_min().powi(2) * solid * 1e6,
            sources,
            without_mask,
        }
    }
}

impl fmt::Display for Reach {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let [up, across] = self.field_of_view_degrees;
        let colors: Vec<String> = self.eyebox_mm_by_color.iter().map(|(c, mm)| format!("{c} {mm:.1}")).collect();
        write!(
            out,
            "{across:.2} degrees wide, {up:.2} high, {:.0} pixels a degree; eyebox {:.1} mm ({}); depths {:.1} to {:.1} mm \
             ({:.2} to {:.2} D); etendue {:.3} mm2 sr",
            self.pixels_per_degree,
            self.eyebox_mm,
            colors.join(", "),
            self.depth_mm[0],
            self.depth_mm[1],
            self.depth_dioptres[0],
            self.depth_dioptres[1],
            self.etendue_mm2_sr,
        )?;
        if let Some(WithoutMask { factor, eyebox_mm, etendue_mm2_sr }) = &self.without_mask {
            write!(
                out,
                "; behind a mask of {factor} x {factor} pixels on each of the SLM's: without it an eyebox of {eyebox_mm:.1} mm \
                 and {etendue_mm2_sr:.3} mm2 sr"
            )?;
        }
        let Some(sources) = &self.sources else { return Ok(()) };
        let SourcesReach { sources, eyebox_mm: [up, across], area_mm2, etendue_mm2_sr, switching_us, .. } = sources;
        let times = area_mm2 / self.eyebox_mm.powi(2);
        write!(
            out,
            "; with its {sources} sources: eyebox {across:.1} x {up:.1} mm, {times:.1} times the area of one, field of view the \
             same, etendue {etendue_mm2_sr:.3} mm2 sr"
        )?;
        let Some(SourcesReach { sub_frame_us, lit_share, .. }) = self.sources.as_ref().filter(|_| *switching_us > 0.0)
        else {
            return Ok(());
        };
        let of = format!("switching takes up to {switching_us:.0} of the {sub_frame_us:.0} us of a sub-frame");
        match lit_share {
            share if *share < 1.0 => write!(out, "; {of}: {:.0} % of the light is left in turn", share * 100.0),
            _ => write!(out, "; {of} if a set has other sources than the set before"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_display_in_degrees() {
        let reach = Display::preset("paper").unwrap().reach();
        // The extent is 15.36 x 8.64 mm at 400 mm.
        let [up, across] = reach.field_of_view_degrees;
        assert!((across - 2.2003).abs() < 1e-3 && (up - 1.2377).abs() < 1e-3, "{across} {up}");
        assert!((reach.pixels_per_degree - 872.66).abs() < 0.01 && (reach.eyebox_mm - 22.0).abs() < 1e-9);
        // The depth is N p^2 / wavelength of the shorter side and the shortest wavelength.
        assert!((reach.depth_mm[1] - 1080.0 * 64e-12 / 440e-9 * 1e3).abs() < 1e-6);
        assert!((reach.depth_dioptres[1] - 0.98182).abs() < 1e-4);
        let line = reach.to_string();
        assert!(
            ["2.20 degrees", "1.24", "873 pixels"].iter().all(|part| line.contains(part)) && !line.contains('\n'),
            "{line}"
        );
        assert!(
            ["22.0 mm", "red 33.0", "green 26.0", "blue 22.0", "157.1"].iter().all(|part| line.contains(part)),
            "{line}"
        );
    }

    /// Eyebox times field of view is N wavelength along an axis. A mask multiplies it by the number of its pixels.
    #[test]
    fn a_mask_makes_the_etendue_larger() {
        let plain = Display::preset("small").unwrap();
        let text = format!("{}\n[mask]\nfactor = 3\nseed = 1\n", plain.to_toml());
        let masked = Display::from_toml(&text, "masked").unwrap();
        let (plain, masked) = (plain.reach(), masked.reach());
        let along = 256.0 * 440e-9 * 1e3;
        assert!((plain.etendue_mm2_sr - along * along).abs() < 1e-9 && plain.without_mask.is_none());
        assert!((masked.etendue_mm2_sr / plain.etendue_mm2_sr - 9.0).abs() < 1e-9);
        assert!((masked.eyebox_mm - 66.0).abs() < 1e-9 && masked.field_of_view_degrees == plain.field_of_view_degrees);
        let without = masked.without_mask.unwrap();
        assert!((without.eyebox_mm - plain.eyebox_mm).abs() < 1e-9 && without.factor == 3);
        let line = masked.to_string();
        assert!(line.contains("3 x 3 pixels") && line.contains("22.0 mm"), "{line}");
    }

    #[test]
    fn a_far_field_display_has_the_eyebox_of_its_slm() {
        let reach = Display::preset("far-field").unwrap().reach();
        assert!(reach.eyebox_mm_by_color.values().all(|mm| (mm - 4.096).abs() < 1e-9));
        // The angle is 2 asin(wavelength / 2 p) of the shortest wavelength.
        let angle = 2.0 * (440e-9f64 / 16e-6).asin().to_degrees();
        assert!(reach.field_of_view_degrees.iter().all(|a| (a - angle).abs() < 1e-9));
    }
}
