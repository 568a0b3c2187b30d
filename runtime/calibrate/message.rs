//! Defines the messages between eyebox and a camera's command, one JSON object per line.

use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// The longest line that either side writes, bytes.
pub(super) const LONGEST_LINE: usize = 64 << 10;
/// The version of the protocol.
pub(super) const PROTOCOL: u64 = 1;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Hello {
    pub(super) protocol: u64,
    #[serde(default)]
    pub(super) name: String,
    /// Wavelength of each color, nm.
    pub(super) colors: BTreeMap<String, f64>,
    pub(super) slm: Slm,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) iris: Option<IrisRange>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) focus_mm: Option<[f64; 2]>,
    pub(super) camera: CameraKind,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Slm {
    /// Number of rows and columns.
    pub(super) resolution: [usize; 2],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) pitch_um: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) levels: Option<u32>,
    #[serde(default = "levels_only")]
    pub(super) takes: Vec<String>,
    #[serde(default = "one")]
    pub(super) sub_frames: usize,
}

/// The range of the iris's place and diameter, mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct IrisRange {
    pub(super) x_mm: [f64; 2],
    pub(super) y_mm: [f64; 2],
    pub(super) diameter_mm: [f64; 2],
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct CameraKind {
    /// Number of rows and columns.
    pub(super) resolution: [usize; 2],
    pub(super) bits: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) exposure_ms: Option<[f64; 2]>,
    #[serde(default)]
    pub(super) auto_exposure: bool,
    #[serde(default)]
    pub(super) dark: bool,
}

fn levels_only() -> Vec<String> {
    vec!["levels".into()]
}

fn one() -> usize {
    1
}

impl Hello {
    /// Reads and checks an answer to hello.
    pub(super) fn read(answer: &Value) -> Result<Self, Reason> {
        let hello =
            Self::deserialize(answer).map_err(|e| reason!("hello", "answers hello with an invalid object: {e}"))?;
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let ordered = |range: &[f64; 2]| finite(range) && range[0] <= range[1];
        let wrong = |what: &str| Err(reason!("hello", "answers hello with {what}"));
        if hello.protocol != PROTOCOL {
            return Err(reason!(
                "protocol",
                "uses version {} of the protocol, but eyebox uses {PROTOCOL}",
                hello.protocol
            ));
        }
        if hello.colors.is_empty() || hello.colors.values().any(|nm| !(100.0..=20_000.0).contains(nm)) {
            return wrong("no colors, or with a wavelength that is not in nanometers");
        }
        let sides = [hello.slm.resolution, hello.camera.resolution];
        if sides.as_flattened().iter().any(|n| !(1..=65536).contains(n)) {
            return wrong("a resolution with a side outside 1 to 65536 pixels");
        }
        if !(1..=32).contains(&hello.camera.bits) || hello.slm.sub_frames == 0 {
            return wrong("camera bits outside 1 to 32, or with no sub_frames");
        }
        if !hello.slm.takes.iter().any(|kind| kind == "levels" || kind == "phases") {
            return wrong("an SLM that takes neither levels nor phases");
        }
        let iris = hello.iris.iter().flat_map(|i| [&i.x_mm, &i.y_mm, &i.diameter_mm]);
        if !iris.chain(&hello.focus_mm).chain(&hello.camera.exposure_ms).all(ordered) {
            return wrong("a range that is not two finite numbers in ascending order");
        }
        Ok(hello)
    }
}

/// The patterns to show, a `.npy` of shape (sub-frame, row, column).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Show {
    pub(super) file: String,
    pub(super) kind: String,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Request {
    pub(super) id: u64,
    pub(super) r#do: String,
    pub(super) show: Option<Show>,
    pub(super) color: Option<String>,
    pub(super) wavelength_nm: Option<f64>,
    pub(super) iris_mm: Option<[f64; 3]>,
    pub(super) focus_mm: Option<f64>,
    pub(super) exposure_ms: Option<f64>,
    #[serde(default = "one")]
    pub(super) average: usize,
    #[serde(default)]
    pub(super) out: String,
}

impl Request {
    /// True if both request the same picture, regardless of their numbers and the names of their files.
    pub(super) fn is_alike(&self, other: &Self) -> bool {
        let bare = |r: &Self| Self { id: 0, out: String::new(), show: None, ..r.clone() };
        let kind = |r: &Self| r.show.as_ref().map(|s| s.kind.clone());
        bare(self) == bare(other) && kind(self) == kind(other)
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Answer {
    pub(super) file: String,
    pub(super) full_scale: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) exposure_ms: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) iris_mm: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) focus_mm: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) saturated: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) time_s: Option<f64>,
}

impl Answer {
    /// Reads and checks an answer to a capture.
    pub(super) fn read(answer: &Value) -> Result<Self, Reason> {
        let read = Self::deserialize(answer)
            .map_err(|e| reason!("capture", "answers a capture with an invalid object: {e}"))?;
        let positive = |v: f64| v.is_finite() && v > 0.0;
        if !positive(read.full_scale) || read.exposure_ms.is_some_and(|ms| !positive(ms)) {
            return Err(reason!(
                "capture-scale",
                "answers a capture with a full_scale or an exposure_ms that is not a positive number"
            ));
        }
        let stages = read.iris_mm.iter().flatten().chain(&read.focus_mm).chain(&read.saturated).chain(&read.time_s);
        if stages.copied().any(|v| !v.is_finite()) {
            return Err(reason!("capture-not-finite", "answers a capture with a number that is not finite"));
        }
        Ok(read)
    }
}

/// A line on the command's standard output.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum CameraReply {
    /// A line that is not part of the protocol, such as the output of a library.
    Said(String),
    /// The command still works on its answer and needs this many seconds more.
    Wait(f64),
    /// The command failed with this text. It may be sent the request again if `again` is true.
    Failed {
        text: String,
        again: bool,
    },
    Answered(Value),
}

impl CameraReply {
    /// Reads a line that should answer question `id`.
    pub(super) fn read(line: &str, id: u64) -> Result<Self, Reason> {
        if !line.starts_with('{') {
            return Ok(Self::Said(line.to_string()));
        }
        let shown = || line.chars().take(80).collect::<String>().replace(char::is_control, " ");
        let value: Value =
            serde_json::from_str(line).map_err(|e| reason!("not-json", "wrote '{}', not JSON ({e})", shown()))?;
        if value.get("id").and_then(Value::as_u64) != Some(id) {
            return Err(reason!("other-question", "wrote '{}', which does not answer question {id}", shown()));
        }
        if let Some(error) = value.get("error") {
            let text = error.as_str().map_or_else(|| error.to_string(), str::to_string);
            let text = text.replace(char::is_control, " ");
            return Ok(Self::Failed { text, again: value.get("again").and_then(Value::as_bool).unwrap_or(false) });
        }
        match value.get("wait_s") {
            None => Ok(Self::Answered(value)),
            Some(wait) => match wait.as_f64() {
                Some(seconds) if (0.0..=86_400.0).contains(&seconds) => Ok(Self::Wait(seconds)),
                _ => Err(reason!("wait", "wrote '{}', but wait_s must be 0 to 86400 seconds", shown())),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    fn hello() -> Value {
        json!({"id": 0, "protocol": 1, "colors": {"green": 520.0}, "slm": {"resolution": [8, 9], "more": 1},
               "camera": {"resolution": [20, 30], "bits": 12}, "unknown": []})
    }

    #[test]
    fn what_hello_leaves_out_is_the_least() {
        let read = Hello::read(&hello()).unwrap();
        assert_eq!((read.slm.takes, read.slm.sub_frames), (vec!["levels".to_string()], 1));
        assert!(!read.camera.dark && !read.camera.auto_exposure && read.iris.is_none() && read.focus_mm.is_none());
        for (at, wrong) in [
            ("/protocol", json!(2)),
            ("/colors", json!({})),
            ("/camera/bits", json!(0)),
            ("/slm/resolution", json!([0, 9])),
            ("/slm", json!({"resolution": [8, 9], "takes": ["words"]})),
        ] {
            let mut hello = hello();
            *hello.pointer_mut(at).unwrap() = wrong;
            assert!(Hello::read(&hello).is_err(), "{at}");
        }
    }

    #[test]
    fn lines_are_told_apart() {
        let read = |line: &str| CameraReply::read(line, 7);
        assert_eq!(read("Camera SDK 3.1"), Ok(CameraReply::Said("Camera SDK 3.1".into())));
        assert_eq!(read(r#"{"id": 7, "wait_s": 120}"#), Ok(CameraReply::Wait(120.0)));
        let failed = CameraReply::Failed { text: "shutter did not open".into(), again: true };
        assert_eq!(read(r#"{"id": 7, "error": "shutter did not open", "again": true}"#), Ok(failed));
        assert!(matches!(read(r#"{"id": 7, "file": "a.png"}"#), Ok(CameraReply::Answered(_))));
        for wrong in [r#"{"id": 8}"#, "{", r#"{"id": -7}"#, r#"{"file": "a"}"#, r#"{"id": 7, "wait_s": -1}"#] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        let capture = |more: Value| {
            let mut answer = json!({"file": "a.png", "full_scale": 4095});
            answer.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
            Answer::read(&answer)
        };
        assert!(capture(json!({})).is_ok());
        assert!(capture(json!({"full_scale": 0})).is_err() && capture(json!({"exposure_ms": -1})).is_err());
        assert!(capture(json!({"iris_mm": [1, 2]})).is_err());
    }

    proptest! {
        #[test]
        fn no_line_is_too_odd(line in ".*", start in prop::bool::ANY, cut in 0usize..120) {
            let line = if start { format!("{{{line}") } else { line };
            let heard = CameraReply::read(&line, 7);
            let plain = !line.starts_with('{');
            prop_assert!(!plain || heard == Ok(CameraReply::Said(line)));
            let whole = hello().to_string();
            let part: String = whole.chars().take(cut).collect();
            if let Ok(CameraReply::Answered(value)) = CameraReply::read(&part, 0) {
                let _ = Hello::read(&value);
                let _ = Answer::read(&value);
            }
        }
    }
}
