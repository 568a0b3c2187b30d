//! Reads settings as a TOML text over their defaults.

use crate::error::Reason;
use crate::reason;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

/// Reads a TOML text as keys with values.
///
/// # Errors
/// Returns the line that is not TOML, or the key of a number that is not finite.
pub fn keys(text: &str) -> Result<Map<String, Value>, Reason> {
    let given: toml::Table = super::read::toml(text)?;
    let value = |(key, value): (String, toml::Value)| {
        let value = serde_json::to_value(value).map_err(|e| reason!("value", "{key}: {e}"))?;
        // TOML has no null. A number that is not finite becomes one.
        if has_null(&value) {
            return Err(reason!("not-finite", "{key}: every number must be finite"));
        }
        Ok((key, value))
    };
    given.into_iter().map(value).collect()
}

/// Returns the keys of `whole` with the given ones over them. A table replaces only the keys that it has. Keys of
/// `beside` are ignored.
///
/// # Errors
/// Returns a key that is unknown, or whose value has another type.
pub fn overlay<T: DeserializeOwned>(
    mut whole: Map<String, Value>,
    beside: &[&str],
    given: &Map<String, Value>,
) -> Result<T, Reason> {
    for (key, value) in given.iter().filter(|(key, _)| !beside.contains(&&key[..])) {
        let Some(old) = whole.get_mut(key) else {
            let known: Vec<&str> = whole.keys().map(String::as_str).chain(beside.iter().copied()).collect();
            return Err(reason!("no-such-setting", "{key}: no such setting. The settings are {}", known.join(", ")));
        };
        merge(old, value);
        T::deserialize(Value::Object(whole.clone())).map_err(|e| reason!("value", "{key}: {e}"))?;
    }
    T::deserialize(Value::Object(whole)).map_err(|e| e.to_string().into())
}

/// Returns the keys of a value. A value without keys gives an empty map.
pub fn keys_of(value: &impl Serialize) -> Map<String, Value> {
    match serde_json::to_value(value) {
        Ok(Value::Object(keys)) => keys,
        _ => Map::new(),
    }
}

/// Writes keys as a TOML text.
///
/// # Errors
/// Returns the reason if TOML cannot represent a value.
pub fn toml(keys: &Map<String, Value>) -> Result<String, Reason> {
    toml::to_string(keys).map_err(|e| e.to_string().into())
}

/// Puts `new` over `old`. Tables are merged key by key.
pub fn merge(old: &mut Value, new: &Value) {
    match (old, new) {
        (Value::Object(old), Value::Object(new)) => {
            for (key, value) in new {
                merge(old.entry(key.clone()).or_insert(Value::Null), value);
            }
        }
        (old, new) => old.clone_from(new),
    }
}

fn has_null(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::Array(values) => values.iter().any(has_null),
        Value::Object(values) => values.values().any(has_null),
        _ => false,
    }
}
