//! Shapes to unwrap: every mesh once per proportion in which the scene shows it.
//!
//! Instances that differ by rotation, reflection and uniform scale share one shape; a stretched instance has one of its
//! own, so that charts are made in the proportions of the world.

use crate::scene::{LightmapRequest, Mesh, Scene};
use glam::{DMat3, DVec3, Mat3, Vec3};
use std::collections::HashMap;

/// A mesh in the proportions of the world.
pub(super) struct Shape {
    /// The scene's mesh.
    pub(super) mesh: usize,
    /// Positions around the middle of the mesh, one per vertex.
    pub(super) positions: Vec<Vec3>,
    /// Unit normals, one per vertex.
    pub(super) normals: Vec<Vec3>,
    /// Triangles of the mesh that have an area.
    pub(super) triangles: Vec<u32>,
    /// Scene instances that show it, each with its factor from the shape's unit to metres.
    pub(super) instances: Vec<(usize, f64)>,
}

impl Shape {
    /// Corner positions of a triangle of the mesh.
    pub(super) fn corners(&self, mesh: &Mesh, triangle: u32) -> [Vec3; 3] {
        mesh.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    /// Area of all triangles, in the shape's unit squared.
    pub(super) fn area(&self, mesh: &Mesh) -> f64 {
        self.triangles.iter().map(|&t| triangle_area(self.corners(mesh, t))).sum()
    }
}

/// Area of a triangle.
pub(super) fn triangle_area([a, b, c]: [Vec3; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(|p| p.as_dvec3());
    (b - a).cross(c - a).length() / 2.0
}

/// The shapes of all instances that want a lightmap, in the order in which instances first show them.
pub(super) fn shapes(scene: &Scene) -> Vec<Shape> {
    let mut shapes: Vec<Shape> = Vec::new();
    let mut known = HashMap::new();
    for (i, instance) in scene.instances.iter().enumerate() {
        let mesh = &scene.meshes[instance.mesh];
        if instance.lightmap == LightmapRequest::None || mesh.triangles.is_empty() {
            continue;
        }
        let linear = Mat3::from(instance.transform.matrix3).as_dmat3();
        let scale = uniform_scale(linear);
        let shape = *known.entry((instance.mesh, proportions(linear, scale))).or_insert_with(|| {
            shapes.push(shape(instance.mesh, mesh, linear * (1.0 / scale)));
            shapes.len() - 1
        });
        shapes[shape].instances.push((i, scale));
    }
    shapes
}

/// The uniform scale that changes volumes as `linear` does.
fn uniform_scale(linear: DMat3) -> f64 {
    let scale = linear.determinant().abs().cbrt();
    if scale.is_finite() && scale > 0.0 { scale } else { 1.0 }
}

/// What is left of a transform without rotation, reflection and uniform scale, rounded so that equal ones compare equal.
fn proportions(linear: DMat3, scale: f64) -> [i64; 6] {
    const STEPS: f64 = 1e4;
    let gram = linear.transpose() * linear * (1.0 / (scale * scale));
    let [x, y, z] = [gram.x_axis, gram.y_axis, gram.z_axis];
    [x.x, y.y, z.z, x.y, x.z, y.z].map(|g| (g * STEPS).round() as i64)
}

fn shape(index: usize, mesh: &Mesh, linear: DMat3) -> Shape {
    let placed: Vec<DVec3> = mesh.positions.iter().map(|p| linear * p.as_dvec3()).collect();
    let (low, high) = placed.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    let middle = (low + high) / 2.0;
    // Turned by the cofactors, which point the same way as the inverse transpose.
    let cofactor = DMat3::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    );
    let mut shape = Shape {
        mesh: index,
        positions: placed.iter().map(|&p| (p - middle).as_vec3()).collect(),
        normals: mesh.normals.iter().map(|n| (cofactor * n.as_dvec3()).normalize_or(DVec3::Y).as_vec3()).collect(),
        triangles: Vec::new(),
        instances: Vec::new(),
    };
    shape.triangles = (0..mesh.triangles.len() as u32).filter(|&t| is_sound(shape.corners(mesh, t))).collect();
    // Nothing sound refers to positions beyond the range of numbers, but unwrappers look at all of them.
    shape.positions.iter_mut().filter(|p| !p.is_finite()).for_each(|p| *p = Vec3::ZERO);
    shape
}

/// True for a triangle with an area that its corners' rounding does not make.
fn is_sound(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners;
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    let area = triangle_area(corners);
    area.is_finite() && area > 1e-7 * f64::from(longest) && area > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Instance;
    use glam::{Affine3A, Quat};

    fn instances_of_shapes(transforms: &[Affine3A]) -> Vec<Vec<(usize, f64)>> {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let place = |&transform: &Affine3A| Instance {
            path: String::new(),
            node: 0,
            mesh: 0,
            transform,
            casts_shadows: true,
            lightmap: LightmapRequest::Default,
            group: None,
            gpu_instance: None,
        };
        let scene = Scene { meshes: vec![mesh], instances: transforms.iter().map(place).collect(), ..Scene::default() };
        shapes(&scene).into_iter().map(|s| s.instances).collect()
    }

    #[test]
    fn rotated_mirrored_and_scaled_instances_share_a_shape() {
        let found = instances_of_shapes(&[
            Affine3A::IDENTITY,
            Affine3A::from_scale_rotation_translation(Vec3::splat(3.0), Quat::from_rotation_x(0.4), Vec3::X),
            Affine3A::from_scale(Vec3::new(-2.0, 2.0, 2.0)),
        ]);
        assert_eq!(found.len(), 1);
        for ((instance, scale), expected) in found[0].iter().zip([(0, 1.0), (1, 3.0), (2, 2.0)]) {
            assert_eq!(*instance, expected.0);
            assert!((scale - expected.1).abs() < 1e-5);
        }
    }

    #[test]
    fn a_stretched_instance_has_a_shape_of_its_own() {
        let stretched = Affine3A::from_scale(Vec3::new(2.0, 1.0, 1.0));
        assert_eq!(instances_of_shapes(&[Affine3A::IDENTITY, stretched, stretched]).len(), 2);
    }
}
