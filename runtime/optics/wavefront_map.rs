//! Converts a measured map of the relay's wavefront to the polynomials of the model (OPTICS 10).

use super::model::{ModelOf, ModelSections};
use super::{Color, linear::least_squares, zernike};
use eyebox_base::error::Reason;
use eyebox_base::files::read_npy_with_gaps;
use eyebox_base::reason;
use std::path::Path;

/// Number of fitted polynomials, all up to the tenth order.
const COUNT: usize = 66;
/// The largest remainder of the fit, waves RMS.
const MOST_LEFT: f64 = 0.1;
/// Places along each axis that are enough for the fit.
const ENOUGH: usize = 192;

/// Replaces the maps that sections name by polynomials. The maps are relative to the folder `beside` of the display
/// file. `nm` is a color's wavelength.
pub(super) fn resolve(
    sections: &mut ModelSections,
    beside: &Path,
    nm: impl Fn(Color) -> Option<f64>,
) -> Result<(), Reason> {
    for (of, terms) in sections {
        let Some(name) = terms.wavefront_map.take() else { continue };
        let said = |reason: Reason| reason.within(format!("wavefront_map {name}"));
        let wrong = |reason: Reason| Err(said(reason));
        let color = [Color::Red, Color::Green, Color::Blue].into_iter().find(|c| ModelOf::from(*c) == *of);
        let Some(nm) = color.and_then(&nm) else {
            return wrong(reason!("map-of-all-colors", "a map is of one color: put it in that color's section"));
        };
        if !terms.wavefront.is_empty() {
            return wrong(reason!("map-and-wavefront", "the section also has a wavefront: leave out one of them"));
        }
        let map = read_npy_with_gaps(&beside.join(&name)).map_err(|e| e.to_string())?;
        let [rows, columns] = map.shape[..] else {
            return wrong(reason!("map-axes", "it has {} axes, but rows and columns are needed", map.shape.len()));
        };
        if rows != columns || rows < 16 {
            return wrong(reason!(
                "map-size",
                "{rows} x {columns} values: it must be a square of the eyebox, 16 x 16 or more"
            ));
        }
        let (waves, left) = fit(&map.values, rows, 1e3 / nm).ok_or_else(|| said(Reason::new("map-too-small", FEW)))?;
        if left > MOST_LEFT {
            return wrong(reason!(
                "map-not-smooth",
                "polynomials to the tenth order leave {left:.2} waves RMS of it, more than {MOST_LEFT}: check that it is in \
                 micrometers and has no jumps"
            ));
        }
        tracing::info!("{name}: polynomials to the tenth order leave {left:.4} waves RMS");
        let known = (0u32..).zip(waves).skip(1).filter(|(_, waves)| waves.abs() > 1e-6);
        terms.wavefront = known.collect();
    }
    Ok(())
}

const FEW: &str = "too few of its values are inside the eyebox's disc to distinguish the polynomials";

/// The coefficients and their RMS remainder for a square map of `n` x `n` values times `scale`. Values that are not
/// finite are unknown.
fn fit(values: &[f32], n: usize, scale: f64) -> Option<([f64; COUNT], f64)> {
    let stride = n.div_ceil(ENOUGH);
    let place = |i: usize| (2.0 * i as f64 + 1.0) / n as f64 - 1.0;
    let all = (0..n).step_by(stride).flat_map(|row| (0..n).step_by(stride).map(move |column| (row, column)));
    let inside = |(row, column): (usize, usize)| {
        let (x, y, value) = (place(column), place(row), f64::from(values[row * n + column]) * scale);
        (x * x + y * y <= 1.0 && value.is_finite()).then(|| (std::array::from_fn(|j| zernike(j as u32, x, y)), value))
    };
    let rows: Vec<([f64; COUNT], f64)> = all.filter_map(inside).collect();
    if rows.len() < 2 * COUNT {
        return None;
    }
    let waves: [f64; COUNT] = least_squares(rows.iter().copied())?;
    let off =
        |(row, value): &([f64; COUNT], f64)| (row.iter().zip(&waves).map(|(z, w)| z * w).sum::<f64>() - value).powi(2);
    let left = (rows.iter().map(off).sum::<f64>() / rows.len() as f64).sqrt();
    Some((waves, left))
}

#[cfg(test)]
mod tests {
    use crate::{Color, Display};
    use eyebox_base::error::ErrorData;
    use eyebox_base::files::write_npy;

    const BENCH: &str =
        "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 500 }\n";

    #[test]
    fn a_map_is_its_polynomials() {
        let dir = tempfile::tempdir().unwrap();
        let n = 40;
        let write = |name: &str, value: &dyn Fn(f64, f64) -> f64| {
            let at = |i: usize| (2.0 * i as f64 + 1.0) / n as f64 - 1.0;
            let values: Vec<f32> = (0..n * n).map(|i| value(at(i % n), at(i / n)) as f32).collect();
            write_npy(&dir.path().join(name), &[n, n], &values).unwrap();
        };
        // Micrometers of path, of which 0.1 and -0.05 are 0.2 and -0.1 waves. Values outside the disc are unknown.
        write("good.npy", &|x, y| {
            let known = 0.1 * super::zernike(7, x, y) - 0.05 * super::zernike(12, x, y) + 3.0;
            if x * x + y * y < 0.95 { known } else { f64::NAN }
        });
        write("rough.npy", &|x, y| 0.5 * (40.0 * x).sin() * (37.0 * y).cos());
        let load = |section: &str| {
            let file = dir.path().join("bench.toml");
            Display::from_toml(&format!("{BENCH}{section}"), file.to_str().unwrap())
        };
        let display = load("[model.green]\nwavefront_map = \"good.npy\"\n").unwrap();
        let waves = display.model(Color::Green).wavefront;
        assert!((waves[&7] - 0.2).abs() < 1e-4 && (waves[&12] + 0.1).abs() < 1e-4, "{waves:?}");
        assert!(waves.iter().all(|(j, w)| [7, 12].contains(j) || w.abs() < 1e-3), "{waves:?}");
        // The written file has numbers.
        assert!(!display.to_toml().contains("wavefront_map"));
        for (section, says) in [
            ("[model.green]\nwavefront_map = \"rough.npy\"\n", "display-file/map-not-smooth"),
            ("[model.green]\nwavefront_map = \"none.npy\"\n", "display-file"),
            ("[model.all]\nwavefront_map = \"good.npy\"\n", "display-file/map-of-all-colors"),
            (
                "[model.green]\nwavefront_map = \"good.npy\"\nwavefront = { 4 = 0.1 }\n",
                "display-file/map-and-wavefront",
            ),
        ] {
            let error = load(section).unwrap_err();
            assert_eq!(ErrorData::of(&error).code, says, "{error}");
        }
    }
}
