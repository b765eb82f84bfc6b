//! Vertex data of the source document: accessor → packed elements, as bytes, whatever they mean.

use super::{GlbError, index};
use crate::document::Document;
use serde_json::Value;

/// Elements of an accessor without gaps.
#[derive(Clone, Debug)]
pub(super) struct Packed {
    /// `count × size` bytes.
    pub(super) bytes: Vec<u8>,
    /// Bytes per element.
    pub(super) size: usize,
}

/// glTF component types by their number.
pub(super) fn component_size(component_type: usize) -> Option<usize> {
    match component_type {
        5120 | 5121 => Some(1),
        5122 | 5123 => Some(2),
        5125 | 5126 => Some(4),
        _ => None,
    }
}

/// Components of an accessor type.
pub(super) fn component_count(kind: &str) -> Option<usize> {
    match kind {
        "SCALAR" => Some(1),
        "VEC2" => Some(2),
        "VEC3" => Some(3),
        "VEC4" | "MAT2" => Some(4),
        "MAT3" => Some(9),
        "MAT4" => Some(16),
        _ => None,
    }
}

/// Bytes of an element. Columns of matrices start at multiples of four bytes.
fn element_size(kind: &str, component: usize) -> Option<usize> {
    let columns = match kind {
        "MAT2" => 2,
        "MAT3" => 3,
        "MAT4" => 4,
        _ => return Some(component_count(kind)? * component),
    };
    Some(columns * (columns * component).next_multiple_of(4))
}

/// All elements of accessor `accessor`.
pub(super) fn pack(document: &Document, accessor: usize) -> Result<Packed, GlbError> {
    try_pack(document, accessor).ok_or(GlbError::Accessor(accessor))
}

fn try_pack(document: &Document, accessor: usize) -> Option<Packed> {
    let json = document.array("accessors").get(accessor)?;
    let component = component_size(index(json, "componentType")?)?;
    let size = element_size(json.get("type")?.as_str()?, component)?;
    let count = index(json, "count")?;
    let mut bytes = match index(json, "bufferView") {
        Some(view) => {
            let offset = index(json, "byteOffset").unwrap_or(0);
            let (data, stride) = view_bytes(document, view)?;
            strided(data.get(offset..)?, stride.unwrap_or(size), size, count)?
        }
        None => vec![0; count.checked_mul(size)?],
    };
    if let Some(sparse) = json.get("sparse") {
        apply_sparse(document, sparse, size, &mut bytes)?;
    }
    Some(Packed { bytes, size })
}

/// Content and stride of a buffer view.
fn view_bytes(document: &Document, view: usize) -> Option<(&[u8], Option<usize>)> {
    let json = document.array("bufferViews").get(view)?;
    let offset = index(json, "byteOffset").unwrap_or(0);
    let end = offset.checked_add(index(json, "byteLength")?)?;
    Some((document.buffers.get(index(json, "buffer")?)?.get(offset..end)?, index(json, "byteStride")))
}

fn strided(data: &[u8], stride: usize, size: usize, count: usize) -> Option<Vec<u8>> {
    if stride == size {
        return Some(data.get(..count.checked_mul(size)?)?.to_vec());
    }
    let mut bytes = Vec::with_capacity(count.checked_mul(size)?);
    for i in 0..count {
        let start = i.checked_mul(stride)?;
        bytes.extend_from_slice(data.get(start..start + size)?);
    }
    Some(bytes)
}

/// Replaces the elements that a sparse accessor lists.
fn apply_sparse(document: &Document, sparse: &Value, size: usize, bytes: &mut [u8]) -> Option<()> {
    let count = index(sparse, "count")?;
    let part = |name: &str| {
        let json = sparse.get(name)?;
        let (data, _) = view_bytes(document, index(json, "bufferView")?)?;
        data.get(index(json, "byteOffset").unwrap_or(0)..)
    };
    let width = component_size(index(sparse.get("indices")?, "componentType")?)?;
    let (indices, values) = (part("indices")?, part("values")?);
    for i in 0..count {
        let target = little_endian(indices.get(i * width..(i + 1) * width)?).checked_mul(size)?;
        bytes.get_mut(target..target + size)?.copy_from_slice(values.get(i * size..(i + 1) * size)?);
    }
    Some(())
}

fn little_endian(bytes: &[u8]) -> usize {
    bytes.iter().rev().fold(0, |n, &b| n << 8 | usize::from(b))
}

impl Packed {
    /// Element `i`, or none beyond the end.
    pub(super) fn element(&self, i: usize) -> Option<&[u8]> {
        self.bytes.get(i.checked_mul(self.size)?..(i + 1) * self.size)
    }
}

/// One component of an element as a number.
pub(super) fn component(bytes: &[u8], component_type: usize, i: usize) -> Option<f64> {
    let size = component_size(component_type)?;
    let b = bytes.get(i * size..(i + 1) * size)?;
    Some(match component_type {
        5120 => f64::from(b[0] as i8),
        5122 => f64::from(i16::from_le_bytes([b[0], b[1]])),
        5126 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        _ => little_endian(b) as f64,
    })
}
