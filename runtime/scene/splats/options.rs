//! Reads the options after the question mark of a file of splats, which place the camera.

use eyebox_base::error::Reason;
use eyebox_base::reason;

/// List of the options, for people.
const TAKES: &str = "splats take fov=DEGREES, eye=X,Y,Z, at=X,Y,Z, up=X,Y,Z, camera=NUMBER, range=NEAR,FAR and shift=MM, with & between";

/// Distances of the nearest and the farthest depth of the built-in scene, for a span from -1 to 1.
const BUILTIN_RANGE: [f64; 2] = [1.0 / 1.2, 1.0 / 0.8];

/// The statements about the camera.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Options {
    /// Field of view across the shorter side of the picture, in degrees.
    pub fov: Option<f64>,
    /// Position of the camera in units of the scene.
    pub eye: Option<[f64; 3]>,
    /// A point in the middle of the picture.
    pub at: Option<[f64; 3]>,
    /// A direction that is upwards in the picture.
    pub up: Option<[f64; 3]>,
    /// Distances of the nearest and the farthest depth, in units of the scene.
    pub range: Option<[f64; 2]>,
    /// Index of a camera in `cameras.json`.
    pub camera: Option<usize>,
    /// Position of the middle of the views to the right of the camera, in meters of the pupil plane.
    pub shift: f64,
}

impl Options {
    /// Reads the options from the text of a query.
    pub fn parse(query: &str) -> Result<Self, Reason> {
        let mut options = Self::default();
        for part in query.split('&').filter(|part| !part.is_empty()) {
            let wrong = |must: &str| reason!("option-value", "'{part}': it must be {must}");
            let point = |text: &str| match numbers(text) {
                Some(point) => Ok(Some(point)),
                None => Err(wrong("three numbers with commas between, at most 1e9")),
            };
            match part.split_once('=') {
                Some(("fov", value)) => {
                    let degrees = value.parse().ok().filter(|v| (0.1..=170.0).contains(v));
                    options.fov = Some(degrees.ok_or_else(|| wrong("a number of degrees from 0.1 to 170"))?);
                }
                Some(("eye", value)) => options.eye = point(value)?,
                Some(("at", value)) => options.at = point(value)?,
                Some(("up", value)) => options.up = point(value)?,
                Some(("range", value)) => {
                    let range = numbers(value).filter(|[near, far]| 1e-9 < *near && near < far);
                    options.range = Some(range.ok_or_else(|| wrong("two positive numbers, the nearer first"))?);
                }
                Some(("shift", value)) => {
                    let shift = value.parse::<f64>().ok().filter(|mm| mm.abs() <= 1e4);
                    options.shift = 1e-3 * shift.ok_or_else(|| wrong("millimeters to the right, -10000 to 10000"))?;
                }
                Some(("camera", value)) => {
                    options.camera = Some(value.parse().map_err(|_| wrong("the index of a camera in cameras.json"))?);
                }
                _ => return Err(reason!("option", "'{part}': {TAKES}")),
            }
        }
        if options.camera.is_some() && (options.eye.is_some() || options.at.is_some() || options.up.is_some()) {
            return Err(reason!("two-cameras", "camera=NUMBER is a whole camera, so leave out eye, at and up"));
        }
        Ok(options)
    }

    /// Adds the camera of the built-in scene, unless another one is stated.
    pub fn of_builtin(self) -> Self {
        let eye = self.eye.or((self.at.is_none() && self.camera.is_none()).then_some([0.0; 3]));
        Self { eye, range: self.range.or(Some(BUILTIN_RANGE)), ..self }
    }
}

/// Returns the finite numbers of a text with commas between, if there are as many.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let all: Vec<f64> = text.split(',').map(|v| v.trim().parse().ok()).collect::<Option<_>>()?;
    <[f64; N]>::try_from(all).ok().filter(|all| all.iter().all(|v| v.abs() <= 1e9))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_and_others_refused() {
        let read = Options::parse("fov=35.5&eye=1,-2,3e1&at=0,0,0&up=0,-1,0").unwrap();
        assert_eq!((read.fov, read.eye, read.up), (Some(35.5), Some([1.0, -2.0, 30.0]), Some([0.0, -1.0, 0.0])));
        assert_eq!(Options::parse("camera=3&fov=20").unwrap().camera, Some(3));
        assert_eq!(Options::parse("shift=-31.5").unwrap().shift, -31.5e-3);
        for (query, code) in [
            ("fov=0", "option-value"),
            ("fov=nan", "option-value"),
            ("eye=1,2", "option-value"),
            ("eye=1,2,3,4", "option-value"),
            ("at=1,2,inf", "option-value"),
            ("at=1,2,x", "option-value"),
            ("camera=-1", "option-value"),
            ("range=2,1", "option-value"),
            ("range=0,1", "option-value"),
            ("shift=nan", "option-value"),
            ("grid=3x3", "option"),
            ("camera=1&eye=0,0,0", "two-cameras"),
        ] {
            assert_eq!(Options::parse(query).unwrap_err().code(), code, "{query}");
        }
    }
}
