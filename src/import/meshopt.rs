//! EXT_meshopt_compression undone: compressed buffer views → the plain bytes of their fallback buffer.
//!
//! A compressed view states where its plain bytes belong: in a fallback buffer that has a length but no content. It is
//! filled in here, after which nothing in the document is compressed any more.

use super::{ImportError, extensions, json};
use draco_gltf::{MeshoptFilter, MeshoptMode, meshopt};
use rayon::prelude::*;
use serde_json::Value;
use std::ops::Range;

/// The extension and its successor, which is the same but for a newer bitstream that is read too.
const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Largest fallback buffer that is filled; a longer one is a damaged length.
const MAX_FALLBACK: u64 = 4 << 30;

/// Length of a buffer that has no content because it is only a place for decompressed views.
pub(super) fn fallback_length(buffer: &Value) -> Option<u64> {
    let (_, extension) = extension_of(buffer)?;
    let fallback = json::boolean(extension, "fallback") == Some(true) && buffer.get("uri").is_none();
    fallback.then(|| buffer.get("byteLength").and_then(Value::as_u64)).flatten()
}

/// Zeros for a fallback buffer.
pub(super) fn fallback_buffer(place: &str, length: u64) -> Result<Vec<u8>, ImportError> {
    if length > MAX_FALLBACK {
        return Err(ImportError::invalid(format!("{place}.byteLength"), format!("{length} bytes are too many")));
    }
    Ok(vec![0; length as usize])
}

/// Decompresses all views and takes the extension out of `document`.
pub(super) fn decode(document: &mut Value, buffers: &mut [Vec<u8>]) -> Result<(), ImportError> {
    let views = document.get("bufferViews").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let compressed: Vec<_> =
        views.iter().enumerate().filter_map(|(i, view)| Some((i, view, extension_of(view)?.1))).collect();
    if compressed.is_empty() {
        return Ok(());
    }
    let all = document.get("buffers").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let is_fallback = |buffer: usize| all.get(buffer).is_some_and(|buffer| fallback_length(buffer).is_some());
    let decoded: Vec<_> = compressed
        .par_iter()
        // A view into a buffer with content is a plain copy that needs no decoding.
        .filter(|(_, view, _)| json::index(view, "buffer").is_some_and(is_fallback))
        .map(|&(i, view, extension)| decode_view(i, view, extension, buffers))
        .collect::<Result<_, ImportError>>()?;
    for (buffer, range, bytes) in decoded {
        buffers[buffer][range].copy_from_slice(&bytes);
    }

    for array in ["bufferViews", "buffers"] {
        for object in document.get_mut(array).and_then(Value::as_array_mut).into_iter().flatten() {
            NAMES.iter().for_each(|name| extensions::remove(object, name));
        }
    }
    NAMES.iter().for_each(|name| extensions::undeclare(document, name));
    Ok(())
}

fn extension_of(object: &Value) -> Option<(&'static str, &Value)> {
    let extensions = object.get("extensions")?;
    NAMES.iter().find_map(|name| Some((*name, extensions.get(name)?)))
}

/// The plain bytes of a view, and the buffer and range that they belong to.
fn decode_view(
    i: usize,
    view: &Value,
    extension: &Value,
    buffers: &[Vec<u8>],
) -> Result<(usize, Range<usize>, Vec<u8>), ImportError> {
    let place = || format!("bufferViews[{i}].EXT_meshopt_compression");
    let fault = |fault: String| ImportError::invalid(place(), fault);
    let target = range(view, buffers).ok_or_else(|| fault("its view ends past its buffer".into()))?;
    let source = range(extension, buffers).ok_or_else(|| fault("its data ends past its buffer".into()))?;
    let count = json::index(extension, "count").ok_or_else(|| fault("it has no count".into()))?;
    let stride = json::index(extension, "byteStride").ok_or_else(|| fault("it has no byteStride".into()))?;
    let mode =
        MeshoptMode::from_name(json::string(extension, "mode").unwrap_or("")).map_err(|e| fault(e.to_string()))?;
    let filter = json::string(extension, "filter").unwrap_or("NONE");
    let filter = MeshoptFilter::from_name(filter).map_err(|e| fault(e.to_string()))?;
    let length = target.1.len();
    if stride == 0 || count.checked_mul(stride) != Some(length) {
        return Err(fault(format!("{count} elements of {stride} bytes do not fill its {length} bytes")));
    }
    let mut bytes = vec![0; length];
    meshopt::decode_buffer_view(&mut bytes, &buffers[source.0][source.1], mode, filter, count, stride)
        .map_err(|e| fault(e.to_string()))?;
    Ok((target.0, target.1, bytes))
}

/// Buffer and byte range of an object with `buffer`, `byteOffset` and `byteLength`, if they are in range.
fn range(object: &Value, buffers: &[Vec<u8>]) -> Option<(usize, Range<usize>)> {
    let buffer = json::index(object, "buffer")?;
    let start = json::index(object, "byteOffset").unwrap_or(0);
    let end = start.checked_add(json::index(object, "byteLength")?)?;
    (end <= buffers.get(buffer)?.len()).then_some((buffer, start..end))
}
