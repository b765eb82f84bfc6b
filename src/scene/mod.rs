//! The resolved scene: geometry, materials, lamps and environment in SI units and linear Rec.709, in the frame of
//! glTF (metres, right-handed, +Y up). Immutable after import; nothing here knows of any file format.

mod environment;
mod groups;
mod light;
mod material;
mod mesh;
mod panorama;
mod profile;
mod shading;
mod sky;
mod texture;

pub use environment::Environment;
pub use groups::{Group, LightGroups, MOST_GROUPS};
pub use light::{
    Falloff, Light, LightShape, NARROWEST_SPREAD, spot_attenuation, spread_attenuation, spread_attenuation_by_tangent,
};
pub use material::{AlphaMode, MAX_REFLECTANCE, Material, TextureSlot};
pub use mesh::{Instance, LightmapRequest, Mesh, Primitive};
pub use panorama::{Cell, Panorama};
pub use profile::{Photometry, Profile};
pub use shading::Appearance;
pub use sky::{BrightCell, BrightRegion, Sky};
pub use texture::{Filter, Texture, Wrap};

use glam::{Vec2, Vec3};

/// Linear Rec.709 triple: reflectance, radiance, radiosity or irradiance, as the place says.
pub type Rgb = Vec3;

/// Everything that takes part in the light transport.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Name for files and reports, usually the file's stem.
    pub name: String,
    /// Unique geometry, in the space of its mesh.
    pub meshes: Vec<Mesh>,
    /// Placed meshes.
    pub instances: Vec<Instance>,
    /// Materials that primitives refer to. Never empty if there are meshes.
    pub materials: Vec<Material>,
    /// Decoded textures that materials refer to.
    pub textures: Vec<Texture>,
    /// Lamps (not emissive surfaces).
    pub lights: Vec<Light>,
    /// Radiance from outside.
    pub environment: Environment,
}

impl Scene {
    /// Triangles over all instances.
    pub fn triangle_count(&self) -> usize {
        self.instances.iter().map(|i| self.meshes[i.mesh].triangles.len()).sum()
    }

    /// World-space corners of triangle `triangle` of `instance`, in mesh order (see [`Instance::flips`]).
    pub fn corners(&self, instance: usize, triangle: usize) -> [Vec3; 3] {
        let i = &self.instances[instance];
        let m = &self.meshes[i.mesh];
        m.triangles[triangle].map(|v| i.transform.transform_point3(m.positions[v as usize]))
    }

    /// Material of triangle `triangle` of mesh `mesh`.
    pub fn material_of(&self, mesh: usize, triangle: usize) -> &Material {
        &self.materials[self.meshes[mesh].primitive_of(triangle).material]
    }

    /// Unit geometric normal of the front face, or zero for a degenerate triangle. World space.
    pub fn geometric_normal(&self, instance: usize, triangle: usize) -> Vec3 {
        let [a, b, c] = self.corners(instance, triangle);
        let n = (b - a).cross(c - a).normalize_or_zero();
        if self.instances[instance].flips() { -n } else { n }
    }

    /// Value of `attribute` (one per mesh vertex) at barycentrics (of the 2nd and 3rd corner).
    pub fn interpolate<T>(&self, mesh: usize, triangle: usize, barycentric: Vec2, attribute: &[T]) -> T
    where
        T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let [a, b, c] = self.meshes[mesh].triangles[triangle].map(|v| attribute[v as usize]);
        a * (1.0 - barycentric.x - barycentric.y) + b * barycentric.x + c * barycentric.y
    }
}
