//! The outermost layer: a file on disk → glTF JSON and the binary chunk.

use super::ImportError;
use serde_json::Value;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;

const GLB_HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// JSON of an asset and, from a GLB, its binary chunk.
pub(super) struct Container {
    pub(super) json: Value,
    pub(super) chunk: Option<Vec<u8>>,
}

/// Reads a .glb or .gltf file; which of them it is, its first bytes tell and not its name.
pub(super) fn read(path: &Path) -> Result<Container, ImportError> {
    if path.is_dir() {
        return Err(ImportError::Folder(path.into()));
    }
    let bytes = fs::read(path).map_err(|source| match source.kind() {
        ErrorKind::NotFound => ImportError::NotFound(path.into()),
        _ => ImportError::Io { path: path.into(), source },
    })?;
    let container = if bytes.starts_with(b"glTF") {
        let (json, chunk) = split_glb(path, &bytes)?;
        Container { json: parse(path, json)?, chunk: chunk.map(<[u8]>::to_vec) }
    } else {
        let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&bytes);
        if text.trim_ascii_start().first() != Some(&b'{') {
            let fault = if bytes.is_empty() { "it is empty" } else { "it begins neither with `glTF` nor with `{`" };
            return Err(ImportError::NotGltf { path: path.into(), fault: fault.into() });
        }
        Container { json: parse(path, text)?, chunk: None }
    };
    check_version(path, &container.json)?;
    Ok(container)
}

/// The JSON and the BIN chunk of a GLB. Chunks of other types are skipped, as the specification asks.
fn split_glb<'a>(path: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>), ImportError> {
    let truncated = |place: &str, expected: usize, actual: usize| ImportError::Truncated {
        place: format!("{place} of `{}`", path.display()),
        expected: expected as u64,
        actual: actual as u64,
    };
    if bytes.len() < GLB_HEADER {
        return Err(truncated("the GLB header", GLB_HEADER, bytes.len()));
    }
    let version = word(bytes, 4);
    if version != 2 {
        return Err(ImportError::Version { path: path.into(), version: version.to_string() });
    }
    let length = word(bytes, 8) as usize;
    if length > bytes.len() {
        return Err(truncated("the content", length, bytes.len()));
    }

    let (mut json, mut binary) = (None, None);
    let mut rest = &bytes[GLB_HEADER..];
    while rest.len() >= CHUNK_HEADER {
        let length = word(rest, 0) as usize;
        let kind = &rest[4..CHUNK_HEADER];
        let body = &rest[CHUNK_HEADER..];
        if length > body.len() {
            return Err(truncated("a GLB chunk", length, body.len()));
        }
        match kind {
            b"JSON" if json.is_none() => json = Some(&body[..length]),
            b"BIN\0" if binary.is_none() => binary = Some(&body[..length]),
            _ => {}
        }
        rest = &body[length..];
    }
    let json = json.ok_or_else(|| ImportError::NotGltf { path: path.into(), fault: "it has no JSON chunk".into() })?;
    Ok((json, binary))
}

/// Little-endian word at byte `at`.
fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn parse(path: &Path, json: &[u8]) -> Result<Value, ImportError> {
    serde_json::from_slice(json).map_err(|e| ImportError::Json { path: path.into(), fault: e.to_string() })
}

/// Accepts every 2.x: minor versions are compatible forwards.
fn check_version(path: &Path, json: &Value) -> Result<(), ImportError> {
    let Some(asset) = json.get("asset") else {
        let fault = "its JSON has no `asset`".into();
        return Err(ImportError::NotGltf { path: path.into(), fault });
    };
    match asset.get("version").and_then(Value::as_str) {
        Some(version) if version == "2" || version.starts_with("2.") => Ok(()),
        Some(version) => Err(ImportError::Version { path: path.into(), version: version.into() }),
        None => Err(ImportError::NotGltf { path: path.into(), fault: "its `asset` states no version".into() }),
    }
}
