//! Geometry and its placements.

use glam::{Affine3A, Vec2, Vec3, Vec4};
use std::ops::Range;

/// Triangles in the mesh's own space. Vertices of all primitives are concatenated.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Name in messages.
    pub name: String,
    /// Index of the mesh in the source file.
    pub source: usize,
    /// Vertex positions, finite.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, one per vertex.
    pub normals: Vec<Vec3>,
    /// Texture coordinate sets, indexed by TEXCOORD_n; a set is empty or has one entry per vertex, zero in primitives
    /// that lack it.
    pub texcoords: Vec<Vec<Vec2>>,
    /// Vertex colours (linear, straight alpha), empty if there are none.
    pub colors: Vec<Vec4>,
    /// Vertex indices; no triangle is degenerate in mesh space.
    pub triangles: Vec<[u32; 3]>,
    /// For each vertex, its index within its source primitive. Vertices of primitives without normals are unshared, so
    /// several may have the same source; vertices that no triangle uses are left out.
    pub source_vertices: Vec<u32>,
    /// Runs of triangles and vertices with one material each, in order and without gaps.
    pub primitives: Vec<Primitive>,
    /// True if every edge is shared by two consistently wound triangles: the mesh encloses a volume.
    pub closed: bool,
}

/// A run of triangles with one material.
#[derive(Clone, Debug)]
pub struct Primitive {
    /// Index of the primitive in the source mesh.
    pub source: usize,
    /// Its vertices within the mesh.
    pub vertices: Range<u32>,
    /// Its triangles within the mesh.
    pub triangles: Range<u32>,
    /// Index into [`super::Scene::materials`].
    pub material: usize,
}

impl Mesh {
    /// The primitive that triangle `triangle` belongs to.
    pub fn primitive_of(&self, triangle: usize) -> &Primitive {
        &self.primitives[self.primitive_index(triangle)]
    }

    /// Its index in [`Mesh::primitives`].
    pub fn primitive_index(&self, triangle: usize) -> usize {
        self.primitives.partition_point(|p| p.triangles.end as usize <= triangle)
    }
}

/// What lightmap an instance gets.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum LightmapRequest {
    /// At the density of the whole bake.
    #[default]
    Default,
    /// Its own density in texels per metre.
    TexelsPerMetre(f32),
    /// So dense that its charts fill about this many texels squared.
    Resolution(u32),
    /// None: it casts, emits and bounces only.
    None,
}

/// A mesh placed in the world.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Path of node names from the scene's root, `Kitchen/Table`.
    pub path: String,
    /// Index of the node in the source file.
    pub node: usize,
    /// Index into [`super::Scene::meshes`].
    pub mesh: usize,
    /// Mesh space to world space; finite and invertible.
    pub transform: Affine3A,
    /// False: it hides no light source. It still receives, reflects and emits light, and what it reflects hides what lies
    /// behind it.
    pub casts_shadows: bool,
    /// Which lightmap it gets.
    pub lightmap: LightmapRequest,
    /// Light group of its emission.
    pub group: Option<String>,
    /// Index within the node's EXT_mesh_gpu_instancing, if it has that.
    pub gpu_instance: Option<u32>,
}

impl Instance {
    /// True if the transform mirrors, so that the front face winds clockwise in world space.
    pub fn flips(&self) -> bool {
        self.transform.matrix3.determinant() < 0.0
    }

    /// World-space unit direction of a mesh-space normal.
    pub fn transform_normal(&self, n: Vec3) -> Vec3 {
        let m = self.transform.matrix3;
        // The cofactor matrix turns normals rightly for any invertible transform, scaled by the determinant.
        let cofactor = m.inverse().transpose();
        Vec3::from(cofactor * glam::Vec3A::from(n)).normalize_or_zero()
    }
}
