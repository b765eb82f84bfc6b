//! Deformations of a mesh at rest: morph targets, then the skin.

use super::skins::PosedSkin;
use super::{ImportError, accessors};
use glam::{DAffine3, DMat3, DVec3, Vec3, Vec4};
use gltf::Semantic;

/// Adds the weighted displacements of the morph targets.
pub(super) fn apply_morphs(
    primitive: &gltf::Primitive,
    weights: &[f32],
    buffers: &[Vec<u8>],
    positions: &mut [Vec3],
    normals: &mut [Vec3],
) -> Result<(), ImportError> {
    for (target, &weight) in primitive.morph_targets().zip(weights) {
        if weight == 0.0 {
            continue;
        }
        displace(positions, target.positions(), weight, buffers)?;
        displace(normals, target.normals(), weight, buffers)?;
    }
    Ok(())
}

/// Adds `weight` times the displacements, if there are any.
fn displace(
    values: &mut [Vec3],
    displacements: Option<gltf::Accessor>,
    weight: f32,
    buffers: &[Vec<u8>],
) -> Result<(), ImportError> {
    if let Some(accessor) = displacements {
        for (value, delta) in values.iter_mut().zip(accessors::vec3(&accessor, buffers)?) {
            *value += delta * weight;
        }
    }
    Ok(())
}

/// Moves vertices by the weighted mean of their joints. Vertices without weights stay where they are.
pub(super) fn apply_skin(
    primitive: &gltf::Primitive,
    skin: &PosedSkin,
    buffers: &[Vec<u8>],
    positions: &mut [Vec3],
    normals: &mut [Vec3],
) -> Result<(), ImportError> {
    let attribute = |semantic| primitive.get(&semantic).map(|a| accessors::vec4(&a, buffers)).transpose();
    let mut sets = Vec::new();
    for set in 0.. {
        match attribute(Semantic::Joints(set))?.zip(attribute(Semantic::Weights(set))?) {
            Some(pair) => sets.push(pair),
            None => break,
        }
    }
    for (v, position) in positions.iter_mut().enumerate() {
        let influences = sets.iter().filter_map(|(joints, weights)| Some((*joints.get(v)?, *weights.get(v)?)));
        let Some(transform) = blend(influences, skin) else { continue };
        *position = transform.transform_point3(position.as_dvec3()).as_vec3();
        if let Some(normal) = normals.get_mut(v) {
            *normal = (cofactor(transform.matrix3) * normal.as_dvec3()).normalize_or_zero().as_vec3();
        }
    }
    Ok(())
}

/// Linear blend of the joints' transforms. Joint numbers arrive as floats, which hold every one of them exactly.
fn blend(influences: impl Iterator<Item = (Vec4, Vec4)>, skin: &PosedSkin) -> Option<DAffine3> {
    let mut sum = DAffine3::ZERO;
    let mut total = 0.0;
    for (joints, weights) in influences {
        for (joint, weight) in joints.to_array().into_iter().zip(weights.to_array()) {
            let weight = f64::from(weight);
            if let Some(joint) = skin.joints.get(joint as usize).filter(|_| weight > 0.0) {
                sum.matrix3 += joint.matrix3 * weight;
                sum.translation += joint.translation * weight;
                total += weight;
            }
        }
    }
    (total > 0.0).then(|| DAffine3 { matrix3: sum.matrix3 * (1.0 / total), translation: sum.translation / total })
}

/// Turns normals rightly even where the matrix cannot be inverted.
fn cofactor(m: DMat3) -> DMat3 {
    let columns: [DVec3; 3] = [m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis)];
    DMat3::from_cols(columns[0], columns[1], columns[2])
}
