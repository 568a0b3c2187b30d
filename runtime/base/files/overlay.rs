//! Settings as text: what is said there lies over what is by default.

use crate::error::Reason;
use crate::reason;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

/// `default` with what the TOML `text` says, and the `beside` keys that are not its own but may stand there too, with their
/// values. `plain` makes numbers of texts with units, by the key.
///
/// # Errors
/// What is wrong, with its key: one that is not known, a value of another kind, a number that is not finite.
pub fn overlay<T: Serialize + DeserializeOwned>(
    default: &T,
    beside: &[&str],
    plain: &dyn Fn(&str, Value) -> Result<Value, Reason>,
    text: &str,
) -> Result<(T, Map<String, Value>), Reason> {
    let given: toml::Table = super::read::toml(text)?;
    let Ok(Value::Object(mut whole)) = serde_json::to_value(default) else {
        return Err(reason!("not-keys", "settings are keys with values"));
    };
    let mut all = Map::new();
    for (key, value) in given {
        let value = serde_json::to_value(value).map_err(|e| reason!("value", "{key}: {e}"))?;
        // TOML has no null: it is what becomes of a number that is not finite.
        if has_null(&value) {
            return Err(reason!("not-finite", "{key}: every number must be finite"));
        }
        let value = plain(&key, value).map_err(|reason| reason.within(&key))?;
        if !beside.contains(&&key[..]) {
            if !whole.contains_key(&key) {
                let known: Vec<&str> = whole.keys().map(String::as_str).chain(beside.iter().copied()).collect();
                return Err(reason!("no-such-setting", "{key}: no such setting: there are {}", known.join(", ")));
            }
            whole.insert(key.clone(), value.clone());
            T::deserialize(Value::Object(whole.clone())).map_err(|e| reason!("value", "{key}: {e}"))?;
        }
        all.insert(key, value);
    }
    let read = T::deserialize(Value::Object(whole)).map_err(|e| e.to_string())?;
    Ok((read, all))
}

fn has_null(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::Array(values) => values.iter().any(has_null),
        Value::Object(values) => values.values().any(has_null),
        _ => false,
    }
}
