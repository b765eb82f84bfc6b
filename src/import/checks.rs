//! Checks of the whole scene: does anything give light, and do sizes make sense together?

use crate::scene::{Instance, MAX_REFLECTANCE, Material, Mesh, Scene, TextureSlot};
use crate::warning::Warning;
use glam::{Vec2, Vec3};

/// Ratio between the largest and the smallest object from which one of them is taken for a mistake.
const MISMATCH: f32 = 1e6;
/// Extent in metres beyond which f32 positions are coarser than a tenth of a metre.
const HUGE: f32 = 1e6;

/// Texels of a texture that are looked at, and the share of them that may be white without a word.
const MOST_TEXELS: usize = 1 << 16;
const MANY: f32 = 0.2;

/// Warns about what makes a bake useless though the file is sound.
pub(super) fn check(scene: &Scene, warnings: &mut Vec<Warning>) {
    check_light(scene, warnings);
    check_sizes(scene, warnings);
    check_coordinates(scene, warnings);
    check_textured_reflectance(scene, warnings);
}

fn check_light(scene: &Scene, warnings: &mut Vec<Warning>) {
    let emits = scene.materials.iter().any(|m| m.emits());
    if scene.lights.is_empty() && scene.environment.is_black() && !emits {
        let message = "no lamp, no emissive material and no environment: the lightmap will be black; add a light and \
                       include it in the export";
        warnings.push(Warning::new("no_light", scene.name.as_str(), message));
    }
}

/// Textures without coordinates to place them.
fn check_coordinates(scene: &Scene, warnings: &mut Vec<Warning>) {
    for mesh in &scene.meshes {
        for primitive in &mesh.primitives {
            let material = &scene.materials[primitive.material];
            let lacks = |slot: &&TextureSlot| {
                let set = mesh.texcoords.get(slot.set).filter(|set| !set.is_empty());
                let range = primitive.vertices.start as usize..primitive.vertices.end as usize;
                set.is_none_or(|set| set[range].iter().all(|uv| *uv == Vec2::ZERO))
            };
            if let Some(slot) = slots(material).flatten().find(lacks) {
                let message = format!(
                    "mesh: material `{}` has a texture on TEXCOORD_{}, which the mesh lacks; its first texel is used all \
                     over, unwrap the mesh or remove the texture",
                    material.name, slot.set
                );
                warnings.push(Warning::new("no_texcoords", mesh.name.as_str(), message));
            }
        }
    }
}

fn slots(material: &Material) -> impl Iterator<Item = Option<&TextureSlot>> {
    [
        material.base_color_texture.as_ref(),
        material.metallic_texture.as_ref(),
        material.transmission_texture.as_ref(),
        material.emission_texture.as_ref(),
    ]
    .into_iter()
}

/// Base colour textures so bright that the cap of the reflectance changes what they look like.
fn check_textured_reflectance(scene: &Scene, warnings: &mut Vec<Warning>) {
    for material in &scene.materials {
        let Some(slot) = &material.base_color_texture else { continue };
        let texture = &scene.textures[slot.texture];
        let factor = material.base_color * ((1.0 - material.metallic) * (1.0 - material.transmission));
        let step = texture.texels.len().div_ceil(MOST_TEXELS).max(1);
        let looked_at = (0..texture.texels.len()).step_by(step);
        let count = looked_at.len();
        let at = |i: usize| texture.texel((i % texture.width as usize) as u32, (i / texture.width as usize) as u32);
        let capped = looked_at.filter(|&i| (at(i).truncate() * factor).max_element() > MAX_REFLECTANCE).count();
        if capped as f32 > MANY * count as f32 {
            let message = format!(
                "material: {:.0} % of its texture `{}` reflect more than {MAX_REFLECTANCE} and are capped there, or light \
                 would never be absorbed; darken it or lower the factor",
                100.0 * capped as f32 / count as f32,
                texture.name
            );
            warnings.push(Warning::new("reflectance_capped", material.name.as_str(), message));
        }
    }
}

fn check_sizes(scene: &Scene, warnings: &mut Vec<Warning>) {
    let extents: Vec<Vec3> = scene.meshes.iter().map(extent).collect();
    let size = |instance: &Instance| {
        let m = instance.transform.matrix3;
        let extent = extents[instance.mesh];
        (m.x_axis.abs() * extent.x + m.y_axis.abs() * extent.y + m.z_axis.abs() * extent.z).max_element()
    };
    let sizes: Vec<f32> = scene.instances.iter().map(size).collect();
    let by_size = |a: &usize, b: &usize| sizes[*a].total_cmp(&sizes[*b]);
    let all = 0..sizes.len();
    let (Some(smallest), Some(largest)) = (all.clone().min_by(by_size), all.max_by(by_size)) else { return };
    let path = |i: usize| scene.instances[i].path.as_str();
    if sizes[largest] > HUGE {
        let message =
            format!("it is {:.0} km across, too large for exact shadows: scale it down", sizes[largest] / 1e3);
        warnings.push(Warning::new("huge_scale", path(largest), message));
    }
    if sizes[largest] > MISMATCH * sizes[smallest] {
        let message = format!(
            "it is {:.3e} m across and `{}` is {:.3e} m: one of them is probably in wrong units; check their scale",
            sizes[smallest],
            path(largest),
            sizes[largest]
        );
        warnings.push(Warning::new("scale_mismatch", path(smallest), message));
    }
}

/// Size of a mesh's bounding box.
fn extent(mesh: &Mesh) -> Vec3 {
    let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (low, high) = mesh.positions.iter().fold(empty, |(low, high), &p| (low.min(p), high.max(p)));
    high - low
}
