//! Finds the faults that can be fixed on the bench, by the PSNR that they cost although the model has them.

use super::error::CalibrateError;
use eyebox_optics::{Color, Display, ModelTerms};
use serde::Serialize;

/// A fault that costs less than this, dB, is not worth fixing.
const WORTH_DB: f64 = 0.2;

/// A fault that is worth fixing on the bench.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mend {
    /// The fault, a term of the model or an aberration of its wavefront.
    pub fault: &'static str,
    /// PSNR that the fault costs, mean over pupils, dB. It is the gain of a display without the fault over this one,
    /// both solved with their full models.
    pub costs_db: f64,
    /// The part that has to be turned or moved.
    pub remedy: &'static str,
}

/// A fault, its remedy, and the change that removes it from a model.
struct Fault {
    name: &'static str,
    remedy: &'static str,
    mend: fn(&mut ModelTerms),
}

/// Faults that can be fixed on a bench. Pixels (crosstalk, fill) cannot be fixed, and no screw adjusts higher orders of
/// the wavefront.
const FAULTS: [Fault; 10] = [
    Fault {
        name: "level",
        remedy: "the driver's table: set the voltage or the gamma of full drive to one turn at this wavelength",
        mend: |model| model.level = None,
    },
    Fault {
        name: "bend",
        remedy: "the driver's table: make the phase proportional to the level",
        mend: |model| model.bend = None,
    },
    Fault {
        name: "lag",
        remedy: "the time of a sub-frame: show fewer per second, or warm the SLM",
        mend: |model| model.lag = None,
    },
    Fault {
        name: "source",
        remedy: "the beam: center it on the SLM, collimate it, and expand it so that it is even over the SLM",
        mend: |model| model.source = None,
    },
    Fault {
        name: "undiffracted",
        remedy: "the polarization in front of the SLM: rotate it. Otherwise tilt the SLM so that its reflection misses \
                 the eyebox, or block it by a filter",
        mend: |model| model.undiffracted = None,
    },
    Fault {
        name: "defocus",
        remedy: "the distances of the relay: move the camera or the second lens along the axis",
        mend: |model| model.wavefront.retain(|j, _| *j != 4),
    },
    Fault {
        name: "astigmatism",
        remedy: "the tilt of the relay's lenses about the axis, and of the SLM",
        mend: |model| model.wavefront.retain(|j, _| ![3, 5].contains(j)),
    },
    Fault {
        name: "coma",
        remedy: "the center of the relay's lenses: move them sideways onto the axis",
        mend: |model| model.wavefront.retain(|j, _| ![7, 8].contains(j)),
    },
    Fault {
        name: "spherical",
        remedy: "the relay's lenses: turn them around (flatter side to the nearer image), or use better corrected ones",
        mend: |model| model.wavefront.retain(|j, _| *j != 12),
    },
    Fault { name: "iris", remedy: "the zero and the scale of the iris's stage", mend: |model| model.iris = None },
];

/// Faults of a display that are worth fixing, the most expensive first. `decibels` returns the PSNR that a display
/// reaches.
pub(super) fn measure(
    display: &Display,
    color: Color,
    now_db: f64,
    decibels: &mut dyn FnMut(&Display) -> Result<f64, CalibrateError>,
) -> Result<Vec<Mend>, CalibrateError> {
    let mut all = Vec::new();
    for fault in &FAULTS {
        let mended = display.with_model_of(color, fault.mend);
        if mended.model(color) == display.model(color) {
            continue;
        }
        let costs_db = decibels(&mended)? - now_db;
        if costs_db >= WORTH_DB {
            all.push(Mend { fault: fault.name, costs_db, remedy: fault.remedy });
        }
    }
    all.sort_by(|a, b| b.costs_db.total_cmp(&a.costs_db));
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_with_a_remedy_come_in_the_order_of_what_they_cost() {
        let text = "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n\
                    [model.green]\nfill = 0.9\nlag = 0.1\nundiffracted = [0.2, 0.1, 1.0, 0.0, 0.0]\nsource = [0.1, 0.0, 0.0, 0.0, 0.0]\n\
                    [model.green.wavefront]\n4 = 0.1\n7 = 0.2\n8 = 0.1\n15 = 0.3\n";
        let display = Display::from_toml(text, "test").expect("a display");
        let mut models = Vec::new();
        let mends = measure(&display, Color::Green, 20.0, &mut |mended| {
            let model = mended.model(Color::Green);
            models.push(model.clone());
            // The assumed cost of each fault.
            Ok(20.0
                + f64::from(u8::from(model.lag == 0.0)) * 0.5
                + f64::from(u8::from(model.undiffracted.is_empty())) * 1.5
                + f64::from(u8::from(!model.wavefront.contains_key(&7))) * 0.25
                + f64::from(u8::from(model.source == [0.0; 5])) * 0.19)
        })
        .expect("numbers");
        let named: Vec<&str> = mends.iter().map(|m| m.fault).collect();
        assert_eq!(named, ["undiffracted", "lag", "coma"]);
        // Only faults of the display are removed, one at a time.
        assert_eq!(models.len(), 5);
        assert!(models.iter().all(|model| model.fill == 0.9 && model.wavefront.contains_key(&15)));
        assert!(models.iter().any(|model| model.wavefront.len() == 2 && !model.wavefront.contains_key(&8)));
    }
}
