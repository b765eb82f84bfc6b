//! Bytes that a document refers to: in a data URI, a buffer view or a file of their own.

use super::json;
use super::uri::{Resource, resolve};
use crate::document::Document;
use serde_json::Value;
use std::borrow::Cow;

/// Content of an object with `uri` or `bufferView`, or of a plain string that is the URI. Fails with the reason.
pub(super) fn bytes<'a>(document: &'a Document, object: &Value) -> Result<Cow<'a, [u8]>, String> {
    if let Some(uri) = object.as_str().or_else(|| json::string(object, "uri")) {
        return match resolve(uri, &document.directory)? {
            Resource::Inline(bytes) => Ok(bytes.into()),
            Resource::File(path) => {
                std::fs::read(&path).map(Cow::from).map_err(|e| format!("`{}` cannot be read ({e})", path.display()))
            }
        };
    }
    let view = json::index(object, "bufferView").and_then(|view| document.array("bufferViews").get(view));
    let view = view.ok_or("it has neither a URI nor a buffer view")?;
    let buffer = json::index(view, "buffer").and_then(|buffer| document.buffers.get(buffer));
    let start = json::index(view, "byteOffset").unwrap_or(0);
    let end = json::index(view, "byteLength").and_then(|length| length.checked_add(start));
    let bytes = buffer.zip(end).and_then(|(buffer, end)| buffer.get(start..end));
    bytes.map(Cow::from).ok_or_else(|| "its buffer view is out of range".into())
}

/// What to call the object in messages: its name, its file or where it is embedded.
pub(super) fn name(object: &Value) -> String {
    let uri = object.as_str().or_else(|| json::string(object, "uri"));
    // A data URI is no name that anyone wants to read.
    let file = uri.filter(|uri| !uri.starts_with("data:"));
    let named = json::string(object, "name").filter(|name| !name.is_empty());
    match (named.or(file), json::index(object, "bufferView")) {
        (Some(name), _) => name.to_owned(),
        (None, Some(view)) => format!("buffer view {view}"),
        (None, None) => "embedded file".into(),
    }
}
