//! Lenient reads of raw JSON, for extensions: a value of the wrong type reads as absent.

use serde_json::Value;

pub(super) fn string<'a>(object: &'a Value, key: &str) -> Option<&'a str> {
    object.get(key)?.as_str()
}

pub(super) fn boolean(object: &Value, key: &str) -> Option<bool> {
    object.get(key)?.as_bool()
}

/// May overflow to infinity: the caller checks.
pub(super) fn number(object: &Value, key: &str) -> Option<f32> {
    object.get(key)?.as_f64().map(|x| x as f32)
}

pub(super) fn index(object: &Value, key: &str) -> Option<usize> {
    usize::try_from(object.get(key)?.as_u64()?).ok()
}

/// An array of exactly `N` numbers.
pub(super) fn numbers<const N: usize>(object: &Value, key: &str) -> Option<[f32; N]> {
    let values = object.get(key)?.as_array()?;
    if values.len() != N {
        return None;
    }
    let mut out = [0.0; N];
    for (out, value) in out.iter_mut().zip(values) {
        *out = value.as_f64()? as f32;
    }
    Some(out)
}

/// Three numbers, or one that stands for all three.
pub(super) fn triple(object: &Value, key: &str) -> Option<[f32; 3]> {
    numbers(object, key).or_else(|| number(object, key).map(|x| [x; 3]))
}
