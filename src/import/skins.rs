//! Skins at rest: joint matrices from the node transforms of the file.

use super::nodes::PlacedNode;
use super::source::Source;
use super::{ImportError, accessors, json};
use crate::warning::Warning;
use glam::DAffine3;
use std::collections::HashMap;

/// A skin with its joints placed.
pub(super) struct PosedSkin {
    /// Index of the skin.
    pub(super) index: usize,
    /// Mesh space to world space per joint.
    pub(super) joints: Vec<DAffine3>,
}

/// World transforms of all placed nodes, by node.
pub(super) struct Skeleton {
    world: HashMap<usize, DAffine3>,
}

impl Skeleton {
    pub(super) fn new(placed: &[PlacedNode]) -> Self {
        Self { world: placed.iter().map(|node| (node.node, node.world)).collect() }
    }

    /// The skin of a node, if it has one that can be posed.
    pub(super) fn skin_of(
        &self,
        source: &Source,
        node: &PlacedNode,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<PosedSkin>, ImportError> {
        let raw = &source.document.array("nodes")[node.node];
        if raw.get("skin").is_none() || raw.get("mesh").is_none() {
            return Ok(None);
        }
        let skin = json::index(raw, "skin").map(|index| self.pose(source, index)).transpose()?.flatten();
        let message = match skin {
            Some(_) => "its skin is baked in the rest pose: apply the pose that is wanted",
            None => "its skin refers to joints that are not in the scene and is left out: export it with its armature",
        };
        warnings.push(Warning::new("skin_rest_pose", node.path.as_str(), message));
        Ok(skin)
    }

    fn pose(&self, source: &Source, index: usize) -> Result<Option<PosedSkin>, ImportError> {
        let Some(skin) = source.document.array("skins").get(index) else { return Ok(None) };
        let nodes = skin.get("joints").and_then(|joints| joints.as_array()).map_or(&[][..], Vec::as_slice);
        let node = |joint: &serde_json::Value| usize::try_from(joint.as_u64()?).ok();
        let Some(worlds) = nodes.iter().map(|joint| self.world.get(&node(joint)?).copied()).collect::<Option<Vec<_>>>()
        else {
            return Ok(None);
        };
        let inverse_bind = match json::index(skin, "inverseBindMatrices").map(|i| source.gltf.accessors().nth(i)) {
            Some(Some(accessor)) => accessors::affine(&accessor, &source.document.buffers)?,
            Some(None) => return Ok(None),
            None => vec![DAffine3::IDENTITY; worlds.len()],
        };
        let joints: Vec<_> = worlds.iter().zip(&inverse_bind).map(|(world, bind)| *world * *bind).collect();
        Ok((joints.len() == worlds.len() && !joints.is_empty()).then_some(PosedSkin { index, joints }))
    }
}
