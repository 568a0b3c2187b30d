//! Represents errors as data. Each error has a stable code and the fields that its sentence names.
//!
//! Every error enum of eyebox serializes as `{"code": "variant-name", "fields": {...}}`. [`ErrorData::of`] follows the
//! wrapped errors down to the innermost one. A variant for many faults holds a [`Reason`], which has its own code.

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value};
use std::borrow::Cow;
use std::fmt;

/// The reason for an error, with a code for programs and a sentence for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reason(Box<Parts>);

/// The parts are in a box because errors are returned by value and must stay small.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Parts {
    code: Cow<'static, str>,
    text: String,
}

impl Reason {
    /// Makes a reason from a code in kebab-case and a sentence.
    pub fn new(code: impl Into<Cow<'static, str>>, text: impl ToString) -> Self {
        Self(Box::new(Parts { code: code.into(), text: text.to_string() }))
    }

    /// Returns the code. It is empty if a decoder or the operating system wrote the sentence.
    pub fn code(&self) -> &str {
        &self.0.code
    }

    /// Returns the sentence for people.
    pub fn text(&self) -> &str {
        &self.0.text
    }

    /// Returns the same reason with the name of a place in front of its sentence.
    #[must_use]
    pub fn within(self, place: impl fmt::Display) -> Self {
        self.reworded(|text| format!("{place}: {text}"))
    }

    /// Returns the same reason with another sentence, which `text` makes from the present one.
    #[must_use]
    pub fn reworded(self, text: impl FnOnce(&str) -> String) -> Self {
        Self::new(self.0.code, text(&self.0.text))
    }

    /// Makes a reason from another error. The code is the last part of that error's code.
    pub fn of(error: &(impl Serialize + fmt::Display)) -> Self {
        let mut code = ErrorData::of(error).code;
        Self::new(code.split_off(code.rfind('/').map_or(0, |at| at + 1)), error)
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0.text)
    }
}

impl std::error::Error for Reason {}

/// Key of a serialized [`Reason`], which differs from a plain text field of the name `reason`.
const MARK: &str = "$reason";

/// Makes a reason without a code from a sentence of a decoder or of the operating system.
impl From<String> for Reason {
    fn from(text: String) -> Self {
        Self::new("", text)
    }
}

impl Serialize for Reason {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(1))?;
        map.serialize_entry(MARK, &self.0.code)?;
        map.end()
    }
}

/// Makes a [`Reason`] of its code and the arguments of [`format!`].
#[macro_export]
macro_rules! reason {
    ($code:literal, $($text:tt)+) => { $crate::error::Reason::new($code, ::std::format!($($text)+)) };
}

/// Serializes an error of another library as its sentence.
///
/// # Errors
/// The serializer's own errors are returned.
pub fn as_text<T: fmt::Display, S: Serializer>(error: &T, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(error)
}

/// An error in the form that a program reads.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ErrorData {
    /// Code of the error, such as `scene/missing-view` or `file/content/not-finite`.
    pub code: String,
    /// Fields of the error under the names that the library gives them.
    pub fields: Map<String, Value>,
}

impl ErrorData {
    /// Returns the code and the fields of the innermost error that `error` wraps.
    pub fn of(error: &impl Serialize) -> Self {
        let (mut path, mut content) = (Vec::new(), serde_json::to_value(error).unwrap_or_default());
        while let Some(code) = variant(&content) {
            path.push(code.to_owned());
            content = content["fields"].take();
        }
        let mut code = path[path.len().saturating_sub(2)..].join("/");
        let mut fields = match content {
            Value::Object(map) => map,
            Value::Null => Map::new(),
            value => Map::from_iter([("value".to_owned(), value)]),
        };
        // A variant is a reason itself or has a field `reason`.
        let own = match fields.get("reason").and_then(|reason| reason.get(MARK)) {
            Some(_) => fields.remove("reason").map(|mut reason| reason[MARK].take()),
            None => fields.remove(MARK),
        };
        if let Some(own) = own.as_ref().and_then(Value::as_str).filter(|own| !own.is_empty()) {
            code = format!("{code}/{own}");
        }
        Self { code, fields }
    }
}

/// Returns the code of a serialized error enum.
fn variant(value: &Value) -> Option<&str> {
    let map = value.as_object()?;
    if map.keys().all(|key| key == "code" || key == "fields") { map.get("code")?.as_str() } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize)]
    #[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
    enum Inner {
        NoSuchFile { path: String },
        Content { file: String, reason: Reason },
        Job(Reason),
        Ended,
    }

    #[derive(Serialize)]
    #[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
    enum Outer {
        File(Inner),
    }

    #[derive(Serialize)]
    #[serde(tag = "code", content = "fields", rename_all = "kebab-case")]
    enum Command {
        Scene(Outer),
    }

    #[test]
    fn the_innermost_error_and_its_reason_are_the_code() {
        let of = |inner| ErrorData::of(&Command::Scene(Outer::File(inner)));
        let found = of(Inner::NoSuchFile { path: "a".into() });
        assert_eq!(found.code, "file/no-such-file");
        assert_eq!(Value::Object(found.fields), serde_json::json!({"path": "a"}));
        let found = of(Inner::Content { file: "b".into(), reason: reason!("not-finite", "{} is {}", 3, f64::NAN) });
        assert_eq!(found.code, "file/content/not-finite");
        assert_eq!(Value::Object(found.fields), serde_json::json!({"file": "b"}));
        assert_eq!(of(Inner::Job(reason!("two-scenes", "one is enough"))).code, "file/job/two-scenes");
        assert_eq!(of(Inner::Content { file: "b".into(), reason: "said".to_owned().into() }).code, "file/content");
        assert_eq!(of(Inner::Ended).code, "file/ended");
        assert_eq!(ErrorData::of(&Outer::File(Inner::Ended)).code, "file/ended");
        assert_eq!(ErrorData::of(&Inner::Ended).code, "ended");
    }
}
