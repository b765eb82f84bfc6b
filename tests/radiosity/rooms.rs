//! Closed rooms made of quads and spheres, one material per face.

use glam::{Affine3A, Vec2, Vec3};
use lightkiln::accel::Accel;
use lightkiln::atlas::{self, Atlas, AtlasSettings, Texels};
use lightkiln::bake::{self, Lighting, Lit, Observer};
use lightkiln::gather::Lightmap;
use lightkiln::output::report::StageClock;
use lightkiln::progress::Silent;
use lightkiln::scene::{Instance, LightGroups, LightmapRequest, Material, Mesh, Primitive, Rgb, Scene};

/// Emitted radiance (W/(m²·sr)) and reflectance of a face.
#[derive(Clone, Copy)]
pub(crate) struct Face {
    pub(crate) radiance: f32,
    pub(crate) reflectance: f32,
}

/// Collects faces to one mesh with a material each.
#[derive(Default)]
pub(crate) struct Room {
    mesh: Mesh,
    materials: Vec<Material>,
}

impl Room {
    /// Adds triangles that share a material; their front is the side they wind counter-clockwise on.
    pub(crate) fn face(&mut self, triangles: &[[Vec3; 3]], face: Face) {
        let (v, t) = (self.mesh.positions.len() as u32, self.mesh.triangles.len() as u32);
        for corners in triangles {
            let first = self.mesh.positions.len() as u32;
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            self.mesh.positions.extend(corners);
            self.mesh.normals.extend([normal; 3]);
            self.mesh.triangles.push([first, first + 1, first + 2]);
        }
        self.mesh.primitives.push(Primitive {
            source: self.materials.len(),
            vertices: v..self.mesh.positions.len() as u32,
            triangles: t..self.mesh.triangles.len() as u32,
            material: self.materials.len(),
        });
        self.materials.push(Material {
            base_color: Rgb::splat(face.reflectance),
            emission: Rgb::splat(face.radiance),
            ..Material::default()
        });
    }

    /// Adds a parallelogram whose front is the side that `u × v` points to.
    pub(crate) fn quad(&mut self, o: Vec3, u: Vec3, v: Vec3, face: Face) {
        self.face(&[[o, o + u, o + u + v], [o, o + u + v, o + v]], face);
    }

    /// Adds a box seen from inside; faces in the order −x, +x, −y, +y, −z, +z.
    pub(crate) fn inside_of_box(&mut self, low: Vec3, size: Vec3, faces: [Face; 6]) {
        let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
        self.quad(low, y, z, faces[0]);
        self.quad(low + x, z, y, faces[1]);
        self.quad(low, z, x, faces[2]);
        self.quad(low + y, x, z, faces[3]);
        self.quad(low, x, y, faces[4]);
        self.quad(low + z, y, x, faces[5]);
    }

    /// The scene with this one mesh.
    pub(crate) fn scene(mut self) -> Scene {
        self.mesh.texcoords = vec![vec![Vec2::ZERO; self.mesh.positions.len()]];
        self.mesh.source_vertices = (0..self.mesh.positions.len() as u32).collect();
        let instance = Instance {
            path: "Room".into(),
            node: 0,
            mesh: 0,
            transform: Affine3A::IDENTITY,
            casts_shadows: true,
            lightmap: LightmapRequest::Default,
            group: None,
            gpu_instance: None,
        };
        Scene { meshes: vec![self.mesh], instances: vec![instance], materials: self.materials, ..Scene::default() }
    }
}

/// Adds the mesh of another scene to a scene, as an instance that may cast no shadow.
pub(crate) fn add(scene: &mut Scene, other: Scene, casts_shadows: bool) {
    let shift = scene.materials.len();
    for mut mesh in other.meshes {
        mesh.primitives.iter_mut().for_each(|p| p.material += shift);
        scene.meshes.push(mesh);
    }
    scene.materials.extend(other.materials);
    let mesh = scene.meshes.len() - 1;
    scene.instances.extend(other.instances.into_iter().map(|i| Instance { mesh, casts_shadows, ..i }));
}

/// A sphere of radius 1 seen from inside, `rings` × 2·`rings` quads; `face` chooses by the direction of the centre.
pub(crate) fn sphere(rings: usize, face: impl Fn(Vec3) -> Face) -> Scene {
    let mut room = Room::default();
    let at = |i: usize, j: usize| {
        let (st, ct) = (std::f32::consts::PI * j as f32 / rings as f32).sin_cos();
        let (sp, cp) = (std::f32::consts::PI * i as f32 / rings as f32).sin_cos();
        Vec3::new(st * cp, ct, st * sp)
    };
    for j in 0..rings {
        for i in 0..2 * rings {
            let q = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
            let triangles: Vec<[Vec3; 3]> = [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]
                .into_iter()
                .filter(|t| (t[1] - t[0]).cross(t[2] - t[0]).length() > 1e-6)
                .collect();
            room.face(&triangles, face((q[0] + q[2]).normalize()));
        }
    }
    room.scene()
}

/// A baked scene.
pub(crate) struct Baked {
    pub(crate) atlas: Atlas,
    pub(crate) texels: Texels,
    pub(crate) light: Lightmap,
}

pub(crate) fn laid_out(scene: &Scene, texels_per_metre: f32) -> (Atlas, Texels) {
    let settings = AtlasSettings { texels_per_metre: Some(texels_per_metre), ..AtlasSettings::default() };
    let (atlas, _) = atlas::build(scene, &settings, &Silent).expect("the room can be unwrapped");
    let texels = atlas::rasterise(scene, &atlas, &Silent).expect("nobody cancels");
    (atlas, texels)
}

pub(crate) fn baked(scene: &Scene, texels_per_metre: f32, error: f32) -> Baked {
    baked_with(scene, &LightGroups::none(scene), texels_per_metre, error)
}

/// The same with light kept apart.
pub(crate) fn baked_with(scene: &Scene, groups: &LightGroups, texels_per_metre: f32, error: f32) -> Baked {
    let (atlas, texels) = laid_out(scene, texels_per_metre);
    let accel = Accel::build(scene);
    let light = lit(&accel, (&atlas, &texels), groups, error, &mut ()).lightmap;
    Baked { atlas, texels, light }
}

/// What the lighting stages end with.
pub(crate) fn lit(
    accel: &Accel,
    (atlas, texels): (&Atlas, &Texels),
    groups: &LightGroups,
    error: f32,
    observer: &mut dyn Observer,
) -> Lit {
    let clock = &StageClock::start();
    let lighting = Lighting { accel, atlas, texels, groups, error, first: None, clock, progress: &Silent };
    bake::light(&lighting, observer).expect("nobody cancels")
}

impl Baked {
    /// Irradiance of the texels that `choose` (by position and normal) takes, mean of channels, with their areas.
    pub(crate) fn where_at(&self, choose: impl Fn(Vec3, Vec3) -> bool) -> Vec<(f32, f32)> {
        let t = &self.texels;
        (0..t.len())
            .filter(|&i| choose(t.position[i], t.geometric_normal[i]))
            .map(|i| (self.light.combined[i].element_sum() / 3.0, t.area[i]))
            .collect()
    }
}

/// Area-weighted mean.
pub(crate) fn mean(values: &[(f32, f32)]) -> f32 {
    assert!(!values.is_empty(), "some texels are chosen");
    values.iter().map(|(e, a)| e * a).sum::<f32>() / values.iter().map(|(_, a)| a).sum::<f32>()
}
