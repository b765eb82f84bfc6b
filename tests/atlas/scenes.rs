//! Scenes built by hand.

use glam::{Affine2, Affine3A, Vec2, Vec3};
use lightkiln::scene::{
    Filter, Instance, LightmapRequest, Material, Mesh, Primitive, Scene, Texture, TextureSlot, Wrap,
};

/// A mesh of one material with flat normals; every triangle has vertices of its own.
pub(crate) fn mesh(triangles: &[[Vec3; 3]], uv: impl Fn(usize, usize) -> Vec2) -> Mesh {
    let mut mesh = Mesh { name: "mesh".into(), texcoords: vec![Vec::new(), Vec::new()], ..Mesh::default() };
    for (t, corners) in triangles.iter().enumerate() {
        let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        let first = mesh.positions.len() as u32;
        for (k, &p) in corners.iter().enumerate() {
            mesh.positions.push(p);
            mesh.normals.push(n);
            mesh.texcoords[1].push(uv(t, k));
        }
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    let (vertices, triangles) = (0..mesh.positions.len() as u32, 0..mesh.triangles.len() as u32);
    mesh.primitives.push(Primitive { source: 0, vertices, triangles, material: 0 });
    mesh
}

/// A 1 × 1 m quad in XY facing +Z whose TEXCOORD_1 spans `low` to `high`, v down.
pub(crate) fn quad(low: Vec2, high: Vec2) -> Mesh {
    let corner = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
    let index = [[0, 1, 2], [0, 2, 3]];
    mesh(&index.map(|t| t.map(|i| corner[i])), |t, k| {
        let p = corner[index[t][k]];
        low + (high - low) * Vec2::new(p.x, 1.0 - p.y)
    })
}

/// A scene of meshes, each placed by the transforms that come with it.
pub(crate) fn scene(placed: Vec<(Mesh, Vec<Affine3A>)>) -> Scene {
    let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
    for (mesh, transforms) in placed {
        for transform in transforms {
            scene.instances.push(Instance {
                path: format!("node{}", scene.instances.len()),
                node: scene.instances.len(),
                mesh: scene.meshes.len(),
                transform,
                casts_shadows: true,
                lightmap: LightmapRequest::Default,
                group: None,
                gpu_instance: None,
            });
        }
        scene.meshes.push(mesh);
    }
    scene
}

/// A unit cube around the origin with one square of TEXCOORD_1 for all six sides.
pub(crate) fn cube() -> Mesh {
    let sides = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z];
    let mut triangles = Vec::new();
    for n in sides {
        let (u, v) = n.any_orthonormal_pair();
        let at = |x: f32, y: f32| (n + u * x + v * y) / 2.0;
        let corner = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
        triangles.push([corner[0], corner[1], corner[2]]);
        triangles.push([corner[0], corner[2], corner[3]]);
    }
    let square = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    mesh(&triangles, |t, k| square[[[0, 1, 2], [0, 2, 3]][t % 2][k]])
}

/// A unit sphere of `2 n²` quads, halved; its poles are degenerate triangles, as exporters leave them.
pub(crate) fn sphere(n: usize) -> Mesh {
    let at = |i: usize, j: usize| {
        let (a, b) = (i as f32 / n as f32 * std::f32::consts::PI, j as f32 / n as f32 * std::f32::consts::PI);
        Vec3::new(a.sin() * b.cos(), a.cos(), -a.sin() * b.sin())
    };
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..2 * n {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut sphere = mesh(&triangles, |_, _| Vec2::ZERO);
    sphere.normals = sphere.positions.clone();
    sphere
}

/// Cubes, a sphere, single triangles of all sizes and a quad, some stretched, mirrored, turned or large.
pub(crate) fn zoo() -> Scene {
    let turned = Affine3A::from_rotation_y(0.3);
    let triangle =
        |size: f32| mesh(&[[Vec3::ZERO, Vec3::X * size, Vec3::Y * size]], |_, k| [Vec2::ZERO, Vec2::X, Vec2::Y][k]);
    scene(vec![
        (cube(), vec![Affine3A::IDENTITY, turned, Affine3A::from_scale(Vec3::new(-4.0, 1.0, 0.5))]),
        (sphere(12), vec![turned, Affine3A::from_scale(Vec3::splat(0.2))]),
        (triangle(1.0), vec![turned]),
        (triangle(0.01), vec![turned]),
        (triangle(1e-4), vec![turned]),
        (mesh(&[], |_, _| Vec2::ZERO), vec![turned]),
        (quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::from_scale(Vec3::new(9.0, 0.02, 1.0))]),
    ])
}

/// A chessboard of `n` × `n` white and black texels.
pub(crate) fn chessboard(n: u32) -> Texture {
    let texels = (0..n * n).map(|i| if (i % n + i / n).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 0] }).collect();
    Texture { name: "chessboard".into(), width: n, height: n, texels }
}

/// A quad on 4 × 4 lightmap texels under a texture of `n` × `n`.
pub(crate) fn textured(n: u32) -> Scene {
    let mut quad = quad(Vec2::ZERO, Vec2::ONE);
    quad.texcoords[0] = quad.texcoords[1].clone();
    let mut s = scene(vec![(quad, vec![Affine3A::IDENTITY])]);
    s.textures.push(chessboard(n));
    let (wrap, filter) = ([Wrap::Repeat; 2], Filter::Nearest);
    s.materials[0].base_color = Vec3::splat(0.5);
    s.materials[0].base_color_texture =
        Some(TextureSlot { texture: 0, set: 0, transform: Affine2::IDENTITY, wrap, filter });
    s
}
