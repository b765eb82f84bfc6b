//! How rays must treat triangles: where alpha opens holes, and which of them light passes in part.

use super::bvh8::AlphaTest;
use crate::scene::{AlphaMode, Scene};

/// How rays must treat a triangle, none if it is transparent everywhere.
pub(super) fn alpha_test(scene: &Scene, mesh: usize, triangle: usize) -> Option<AlphaTest> {
    let material = scene.material_of(mesh, triangle);
    let varies = material.base_color_texture.is_some() || !scene.meshes[mesh].colors.is_empty();
    if material.transmission > 0.0 {
        return Some(AlphaTest::Blend);
    }
    match material.alpha_mode {
        AlphaMode::Opaque => Some(AlphaTest::None),
        AlphaMode::Mask(_) if varies => Some(AlphaTest::Mask),
        AlphaMode::Mask(cutoff) => (material.alpha >= cutoff).then_some(AlphaTest::None),
        AlphaMode::Blend if varies => Some(AlphaTest::Blend),
        AlphaMode::Blend if material.alpha >= 1.0 => Some(AlphaTest::None),
        AlphaMode::Blend => (material.alpha > 0.0).then_some(AlphaTest::Blend),
    }
}
