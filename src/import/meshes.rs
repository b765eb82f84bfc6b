//! The meshes that a scene shows: each loaded once, with the materials in use, and placed as instances.

use super::geometry::{self, MeshRequest};
use super::nodes::PlacedNode;
use super::skins::Skeleton;
use super::source::Source;
use super::{ImportError, instances};
use crate::progress::Counter;
use crate::scene::{Mesh, Scene};
use crate::warning::Warning;
use glam::DAffine3;
use rayon::prelude::*;
use std::collections::HashMap;

/// Meshes of the placed nodes, each once.
pub(super) struct ShownMeshes<'a> {
    requests: Vec<MeshRequest<'a>>,
    /// Position in `requests` per placed node.
    of_node: Vec<Option<usize>>,
}

/// A glTF material in use.
pub(super) struct UsedMaterial {
    /// Its index, none for the default material.
    pub(super) source: Option<usize>,
    /// A primitive with vertex colours uses it.
    pub(super) painted: bool,
    /// Path of the first node that shows it, for messages.
    pub(super) path: String,
}

/// What makes two nodes show the same geometry: mesh, bits of the morph weights, skin.
type MeshKey = (usize, Vec<u32>, Option<usize>);

impl<'a> ShownMeshes<'a> {
    /// Looks through the placed nodes. Morph targets and skins are taken at rest, with a warning each.
    pub(super) fn collect(
        source: &'a Source,
        placed: &'a [PlacedNode],
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, ImportError> {
        let nodes: Vec<_> = source.gltf.nodes().collect();
        let meshes: Vec<_> = source.gltf.meshes().collect();
        let skeleton = Skeleton::new(placed);
        let mut shown = Self { requests: Vec::new(), of_node: Vec::with_capacity(placed.len()) };
        let mut known: HashMap<MeshKey, usize> = HashMap::new();
        for placed in placed {
            let node = &nodes[placed.node];
            let Some(mesh) = node.mesh().map(|mesh| meshes[mesh.index()].clone()) else {
                shown.of_node.push(None);
                continue;
            };
            let mut weights = node.weights().or(mesh.weights()).unwrap_or(&[]);
            if mesh.primitives().any(|p| p.morph_targets().len() > 0) {
                let message = "its morph targets are baked at their default weights: apply the shape that is wanted";
                warnings.push(Warning::new("morph_rest_pose", placed.path.as_str(), message));
            } else {
                weights = &[];
            }
            let skin = skeleton.skin_of(source, placed, warnings)?;
            let key = (mesh.index(), weights.iter().map(|w| w.to_bits()).collect(), skin.as_ref().map(|s| s.index));
            let next = shown.requests.len();
            let number = *known.entry(key).or_insert(next);
            if number == next {
                shown.requests.push(MeshRequest { mesh, weights, skin, path: &placed.path });
            }
            shown.of_node.push(Some(number));
        }
        Ok(shown)
    }

    /// Number of different meshes.
    pub(super) fn len(&self) -> usize {
        self.requests.len()
    }

    /// Materials of the meshes by index, the default one first.
    pub(super) fn materials(&self, source: &Source) -> Vec<UsedMaterial> {
        let mut used: Vec<Option<UsedMaterial>> = Vec::new();
        used.resize_with(source.gltf.materials().len() + 1, || None);
        for request in &self.requests {
            for primitive in request.mesh.primitives() {
                let index = primitive.material().index();
                let painted = primitive.get(&gltf::Semantic::Colors(0)).is_some();
                let first = || UsedMaterial { source: index, painted, path: request.path.to_owned() };
                used[index.map_or(0, |i| i + 1)].get_or_insert_with(first).painted |= painted;
            }
        }
        used.into_iter().flatten().collect()
    }

    /// Reads all meshes. Their materials are positions in `materials`.
    pub(super) fn load(
        &self,
        source: &Source,
        materials: &[UsedMaterial],
        counter: &Counter,
        warnings: &mut Vec<Warning>,
    ) -> Result<Vec<Mesh>, ImportError> {
        let number: HashMap<_, _> = materials.iter().enumerate().map(|(i, used)| (used.source, i)).collect();
        let material_of = |source: Option<usize>| number[&source];
        let loaded: Vec<_> = self
            .requests
            .par_iter()
            .map(|request| {
                counter.advance(1)?;
                geometry::load(request, &source.document.buffers, &material_of)
            })
            .collect::<Result<_, ImportError>>()?;
        let (meshes, faults): (Vec<_>, Vec<_>) = loaded.into_iter().unzip();
        warnings.extend(faults.into_iter().flatten());
        Ok(meshes)
    }

    /// Adds the meshes that have triangles, and their instances, to the scene.
    pub(super) fn place(
        &self,
        source: &Source,
        placed: &[PlacedNode],
        meshes: Vec<Mesh>,
        scene: &mut Scene,
        warnings: &mut Vec<Warning>,
    ) -> Result<(), ImportError> {
        let mut kept = Vec::with_capacity(meshes.len());
        for (mesh, request) in meshes.into_iter().zip(&self.requests) {
            if mesh.triangles.is_empty() {
                let message = format!("mesh `{}` has no triangle left and is skipped: give it faces", mesh.name);
                warnings.push(Warning::new("empty_mesh", request.path, message));
                kept.push(None);
            } else {
                kept.push(Some(scene.meshes.len()));
                scene.meshes.push(mesh);
            }
        }
        for (node, request) in placed.iter().zip(&self.of_node) {
            let Some((request, mesh)) = request.and_then(|request| Some((request, kept[request]?))) else { continue };
            // A skin moves the vertices to world space by itself.
            let world = if self.requests[request].skin.is_some() { DAffine3::IDENTITY } else { node.world };
            scene.instances.extend(instances::place(source, node, world, mesh, warnings)?);
        }
        Ok(())
    }
}
