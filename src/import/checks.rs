//! Checks of the whole scene: does anything give light, and do sizes make sense together?

use crate::scene::{Instance, Mesh, Scene};
use crate::warning::Warning;
use glam::Vec3;

/// Ratio between the largest and the smallest object from which one of them is taken for a mistake.
const MISMATCH: f32 = 1e6;
/// Extent in metres beyond which f32 positions are coarser than a tenth of a metre.
const HUGE: f32 = 1e6;

/// Warns about what makes a bake useless though the file is sound.
pub(super) fn check(scene: &Scene, warnings: &mut Vec<Warning>) {
    check_light(scene, warnings);
    check_sizes(scene, warnings);
}

fn check_light(scene: &Scene, warnings: &mut Vec<Warning>) {
    let emits = scene.materials.iter().any(|m| m.emits());
    if scene.lights.is_empty() && scene.environment.is_black() && !emits {
        let message = "no lamp, no emissive material and no environment: the lightmap will be black; add a light and \
                       include it in the export";
        warnings.push(Warning::new("no_light", scene.name.as_str(), message));
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
