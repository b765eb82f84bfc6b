//! Vertex data: accessors of any component type → floats and indices.
//!
//! Every accessor has passed [`super::core`], so the reads here stay within their buffers.

use super::ImportError;
use glam::{DAffine3, DMat4, Vec2, Vec3, Vec4};
use gltf::Accessor;
use gltf::accessor::{DataType, Dimensions, Item, Iter};

/// An accessor component as a float: as it is, or normalised to 0..1 (unsigned) or −1..1 (signed).
trait Component: Item + Copy {
    fn plain(self) -> f32;
    fn normalized(self) -> f32;
}

macro_rules! component {
    ($($type:ty: $scale:expr),*) => {$(
        impl Component for $type {
            fn plain(self) -> f32 {
                self as f32
            }
            fn normalized(self) -> f32 {
                (self as f32 / $scale).max(-1.0)
            }
        }
    )*};
}
component!(i8: 127.0, u8: 255.0, i16: 32767.0, u16: 65535.0, u32: u32::MAX as f32, f32: 1.0);

fn items<T: Item>(accessor: &Accessor, buffers: &[Vec<u8>]) -> Vec<T> {
    if accessor.count() == 0 {
        return Vec::new();
    }
    Iter::new(accessor.clone(), |buffer: gltf::Buffer| buffers.get(buffer.index()).map(Vec::as_slice))
        .map_or_else(Vec::new, Iterator::collect)
}

macro_rules! vectors {
    ($name:ident, $n:literal, $vector:ty) => {
        fn $name(accessor: &Accessor, buffers: &[Vec<u8>]) -> Vec<$vector> {
            fn read<T: Component>(accessor: &Accessor, buffers: &[Vec<u8>]) -> Vec<$vector> {
                let convert = if accessor.normalized() { T::normalized } else { T::plain };
                let items = items::<[T; $n]>(accessor, buffers);
                items.into_iter().map(|item| <$vector>::from_array(item.map(convert))).collect()
            }
            match accessor.data_type() {
                DataType::I8 => read::<i8>(accessor, buffers),
                DataType::U8 => read::<u8>(accessor, buffers),
                DataType::I16 => read::<i16>(accessor, buffers),
                DataType::U16 => read::<u16>(accessor, buffers),
                DataType::U32 => read::<u32>(accessor, buffers),
                DataType::F32 => read::<f32>(accessor, buffers),
            }
        }
    };
}
vectors!(read2, 2, Vec2);
vectors!(read3, 3, Vec3);
vectors!(read4, 4, Vec4);

fn expect_type(accessor: &Accessor, expected: Dimensions) -> Result<(), ImportError> {
    if accessor.dimensions() == expected {
        return Ok(());
    }
    let place = format!("accessors[{}].type", accessor.index());
    Err(ImportError::invalid(place, format!("it is {:?}, where {expected:?} is needed", accessor.dimensions())))
}

/// Elements of a VEC2 accessor.
pub(super) fn vec2(accessor: &Accessor, buffers: &[Vec<u8>]) -> Result<Vec<Vec2>, ImportError> {
    expect_type(accessor, Dimensions::Vec2)?;
    Ok(read2(accessor, buffers))
}

/// Elements of a VEC3 accessor.
pub(super) fn vec3(accessor: &Accessor, buffers: &[Vec<u8>]) -> Result<Vec<Vec3>, ImportError> {
    expect_type(accessor, Dimensions::Vec3)?;
    Ok(read3(accessor, buffers))
}

/// Elements of a VEC4 accessor.
pub(super) fn vec4(accessor: &Accessor, buffers: &[Vec<u8>]) -> Result<Vec<Vec4>, ImportError> {
    expect_type(accessor, Dimensions::Vec4)?;
    Ok(read4(accessor, buffers))
}

/// Vertex colours of a VEC3 (opaque) or VEC4 accessor.
pub(super) fn colors(accessor: &Accessor, buffers: &[Vec<u8>]) -> Result<Vec<Vec4>, ImportError> {
    if accessor.dimensions() == Dimensions::Vec3 {
        return Ok(read3(accessor, buffers).into_iter().map(|c| c.extend(1.0)).collect());
    }
    vec4(accessor, buffers)
}

/// Elements of a MAT4 accessor of floats, as affine transforms.
pub(super) fn affine(accessor: &Accessor, buffers: &[Vec<u8>]) -> Result<Vec<DAffine3>, ImportError> {
    expect_type(accessor, Dimensions::Mat4)?;
    if accessor.data_type() != DataType::F32 {
        let place = format!("accessors[{}].componentType", accessor.index());
        return Err(ImportError::invalid(place, "matrices are floats"));
    }
    let matrix = |m: [[f32; 4]; 4]| DAffine3::from_mat4(DMat4::from_cols_array_2d(&m.map(|c| c.map(f64::from))));
    Ok(items(accessor, buffers).into_iter().map(matrix).collect())
}

/// Elements of a SCALAR accessor of unsigned integers.
pub(super) fn indices(accessor: &Accessor, buffers: &[Vec<u8>]) -> Result<Vec<u32>, ImportError> {
    expect_type(accessor, Dimensions::Scalar)?;
    match accessor.data_type() {
        DataType::U8 => Ok(items::<u8>(accessor, buffers).into_iter().map(u32::from).collect()),
        DataType::U16 => Ok(items::<u16>(accessor, buffers).into_iter().map(u32::from).collect()),
        DataType::U32 => Ok(items(accessor, buffers)),
        other => {
            let place = format!("accessors[{}].componentType", accessor.index());
            Err(ImportError::invalid(place, format!("indices are {other:?}, which is no unsigned integer")))
        }
    }
}
