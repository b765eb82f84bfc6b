//! Placed nodes with meshes → instances, EXT_mesh_gpu_instancing expanded.

use super::nodes::PlacedNode;
use super::source::Source;
use super::{ImportError, accessors, json};
use crate::scene::Instance;
use crate::warning::Warning;
use glam::{DAffine3, DQuat, DVec3};
use serde_json::Value;

/// Instances of scene mesh `mesh` at `node`, whose mesh space is `world`. Places that cannot be inverted are skipped with a warning.
pub(super) fn place(
    source: &Source,
    node: &PlacedNode,
    world: DAffine3,
    mesh: usize,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Instance>, ImportError> {
    let copies = match source.document.extension("nodes", node.node, "EXT_mesh_gpu_instancing") {
        Some(extension) => gpu_transforms(source, node, extension)?,
        None => vec![(None, DAffine3::IDENTITY)],
    };
    let (mut flat, mut not_finite) = (0, 0);
    let mut instances = Vec::with_capacity(copies.len());
    for (number, local) in copies {
        let transform = (world * local).as_affine3a();
        if !transform.is_finite() {
            not_finite += 1;
            continue;
        }
        let inverse = transform.matrix3.inverse();
        if transform.matrix3.determinant() == 0.0 || !inverse.is_finite() {
            flat += 1;
            continue;
        }
        instances.push(Instance {
            path: number.map_or_else(|| node.path.clone(), |n: u32| format!("{}[{n}]", node.path)),
            node: node.node,
            mesh,
            transform,
            casts_shadows: node.settings.casts_shadows.unwrap_or(true),
            lightmap: node.settings.lightmap,
            group: node.settings.group.clone(),
            gpu_instance: number,
        });
    }
    let path = node.path.as_str();
    if flat > 0 {
        let message = "its scale is zero along an axis, so it has no surface; it is skipped: apply or reset the scale";
        warnings.push(Warning::new("zero_scale", path, counted(message, flat)));
    }
    if not_finite > 0 {
        let message = "its transform is not finite; it is skipped: reset the transform";
        warnings.push(Warning::new("transform", path, counted(message, not_finite)));
    }
    Ok(instances)
}

fn counted(message: &str, count: usize) -> String {
    if count == 1 { message.into() } else { format!("{message} ({count} instances)") }
}

/// Transforms of EXT_mesh_gpu_instancing, below the node's own. Attributes that are absent have their neutral value.
fn gpu_transforms(
    source: &Source,
    node: &PlacedNode,
    extension: &Value,
) -> Result<Vec<(Option<u32>, DAffine3)>, ImportError> {
    let place = || format!("nodes[{}] (`{}`).EXT_mesh_gpu_instancing", node.node, node.path);
    let accessor = |name: &str| -> Result<Option<gltf::Accessor>, ImportError> {
        let Some(attributes) = extension.get("attributes") else { return Ok(None) };
        if attributes.get(name).is_none() {
            return Ok(None);
        }
        let accessor = json::index(attributes, name).and_then(|i| source.gltf.accessors().nth(i));
        accessor.map(Some).ok_or_else(|| ImportError::invalid(place(), format!("{name} is no accessor of the file")))
    };
    let buffers = &source.document.buffers;
    let vectors = |name| accessor(name)?.map(|a| accessors::vec3(&a, buffers)).transpose();
    let translations = vectors("TRANSLATION")?;
    let scales = vectors("SCALE")?;
    let rotations = accessor("ROTATION")?.map(|a| accessors::vec4(&a, buffers)).transpose()?;

    let counts: Vec<usize> = [translations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)]
        .into_iter()
        .chain([rotations.as_ref().map(Vec::len)])
        .flatten()
        .collect();
    let count = counts.first().copied().unwrap_or(0);
    if counts.iter().any(|&c| c != count) {
        return Err(ImportError::invalid(place(), format!("its attributes have different counts {counts:?}")));
    }
    let transforms = (0..count).map(|i| {
        let translation = translations.as_ref().map_or(DVec3::ZERO, |t| t[i].as_dvec3());
        let scale = scales.as_ref().map_or(DVec3::ONE, |s| s[i].as_dvec3());
        let rotation = rotations.as_ref().map_or(DQuat::IDENTITY, |r| DQuat::from_vec4(r[i].as_dvec4()));
        let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
        (Some(i as u32), DAffine3::from_scale_rotation_translation(scale, rotation, translation))
    });
    Ok(transforms.collect())
}
