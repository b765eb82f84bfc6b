//! Buffers of a document: GLB chunk, data URI or file → bytes.

use super::uri::{Resource, resolve};
use super::{ImportError, meshopt};
use serde_json::Value;
use std::path::Path;

/// Content of every entry of `buffers`, at least `byteLength` long each.
pub(super) fn load(json: &Value, chunk: Option<Vec<u8>>, directory: &Path) -> Result<Vec<Vec<u8>>, ImportError> {
    let mut chunk = chunk;
    let buffers = json.get("buffers").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    buffers.iter().enumerate().map(|(i, buffer)| load_one(i, buffer, &mut chunk, directory)).collect()
}

fn load_one(i: usize, buffer: &Value, chunk: &mut Option<Vec<u8>>, directory: &Path) -> Result<Vec<u8>, ImportError> {
    let place = format!("buffers[{i}]");
    if let Some(length) = meshopt::fallback_length(buffer) {
        return meshopt::fallback_buffer(&place, length);
    }
    let bytes = match buffer.get("uri").and_then(Value::as_str) {
        Some(uri) => {
            match resolve(uri, directory).map_err(|fault| ImportError::invalid(format!("{place}.uri"), fault))? {
                Resource::Inline(bytes) => bytes,
                Resource::File(path) => std::fs::read(&path).map_err(|source| ImportError::MissingBuffer {
                    place: place.clone(),
                    path,
                    source,
                })?,
            }
        }
        // Only the first buffer may be the chunk of a GLB.
        None if i == 0 => {
            chunk.take().ok_or_else(|| ImportError::invalid(&place, "it has neither a URI nor a binary GLB chunk"))?
        }
        None => return Err(ImportError::invalid(place, "it has no URI")),
    };
    let expected = buffer.get("byteLength").and_then(Value::as_u64).unwrap_or(0);
    if (bytes.len() as u64) < expected {
        return Err(ImportError::Truncated { place, expected, actual: bytes.len() as u64 });
    }
    Ok(bytes)
}
