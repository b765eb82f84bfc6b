//! glTF meshes → triangle meshes: topologies, missing and broken attributes, morph targets at rest.

use super::accessors;
use super::skins::PosedSkin;
use super::triangles::{Faults, corners, keep_sound};
use super::{ImportError, deform, topology};
use crate::scene::{Mesh, Primitive};
use crate::warning::Warning;
use glam::{Vec2, Vec3, Vec4};
use gltf::Semantic;
use gltf::mesh::Mode;

/// Highest TEXCOORD_n that is looked for, plus one.
const MAX_TEXCOORDS: u32 = 8;

/// What [`load`] needs to know about a mesh beside the file.
pub(super) struct MeshRequest<'a> {
    /// The mesh.
    pub(super) mesh: gltf::Mesh<'a>,
    /// Morph target weights.
    pub(super) weights: &'a [f32],
    /// Joints that move it to world space.
    pub(super) skin: Option<PosedSkin>,
    /// Path of the first node that shows it, for messages.
    pub(super) path: &'a str,
}

/// One mesh. `material_of` maps a glTF material to the scene's. A mesh with nothing to show has no triangles.
pub(super) fn load(
    request: &MeshRequest,
    buffers: &[Vec<u8>],
    material_of: &(dyn Fn(Option<usize>) -> usize + Sync),
) -> Result<(Mesh, Vec<Warning>), ImportError> {
    let name = request.mesh.name().map_or_else(|| format!("mesh{}", request.mesh.index()), str::to_owned);
    let mut mesh = Mesh { name, source: request.mesh.index(), ..Mesh::default() };
    let mut faults = Faults::default();
    for primitive in request.mesh.primitives() {
        if let Some(part) = load_primitive(&primitive, request, buffers, &mut faults)? {
            append(&mut mesh, part, primitive.index(), material_of(primitive.material().index()));
        }
    }
    mesh.closed = topology::is_closed(&mesh.positions, &mesh.triangles);
    let warnings = faults.warnings(request.path, &mesh.name);
    Ok((mesh, warnings))
}

/// Vertices and triangles of one primitive.
struct Part {
    source_vertices: Vec<u32>,
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    texcoords: Vec<Vec<Vec2>>,
    colors: Vec<Vec4>,
    triangles: Vec<[u32; 3]>,
}

fn load_primitive(
    primitive: &gltf::Primitive,
    request: &MeshRequest,
    buffers: &[Vec<u8>],
    faults: &mut Faults,
) -> Result<Option<Part>, ImportError> {
    if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
        faults.not_surfaces += 1;
        return Ok(None);
    }
    let Some(accessor) = primitive.get(&Semantic::Positions) else {
        faults.without_positions += 1;
        return Ok(None);
    };
    let mut positions = accessors::vec3(&accessor, buffers)?;
    let mut normals = match primitive.get(&Semantic::Normals) {
        Some(accessor) => accessors::vec3(&accessor, buffers)?,
        None => Vec::new(),
    };
    faults.check_length(&mut normals, positions.len());
    deform::apply_morphs(primitive, request.weights, buffers, &mut positions, &mut normals)?;
    if let Some(skin) = &request.skin {
        deform::apply_skin(primitive, skin, buffers, &mut positions, &mut normals)?;
    }

    let indices = match primitive.indices() {
        Some(accessor) => accessors::indices(&accessor, buffers)?,
        None => (0..positions.len() as u32).collect(),
    };
    let triangles = keep_sound(corners(&indices, primitive.mode()), &positions, faults);
    if triangles.is_empty() {
        return Ok(None);
    }

    let unshare = normals.is_empty();
    let (source_vertices, triangles) =
        if unshare { unshared(&triangles) } else { compact(&triangles, positions.len()) };
    let positions = select(&positions, &source_vertices);
    let normals = if unshare {
        flat_normals(&positions, &triangles)
    } else {
        sound_normals(select(&normals, &source_vertices), &positions, &triangles, faults)
    };
    let (texcoords, colors) = vertex_attributes(primitive, accessor.count(), &source_vertices, buffers, faults)?;
    Ok(Some(Part { source_vertices, positions, normals, texcoords, colors, triangles }))
}

/// Texture coordinates and colours of the chosen vertices.
fn vertex_attributes(
    primitive: &gltf::Primitive,
    count: usize,
    source_vertices: &[u32],
    buffers: &[Vec<u8>],
    faults: &mut Faults,
) -> Result<(Vec<Vec<Vec2>>, Vec<Vec4>), ImportError> {
    let mut texcoords = Vec::new();
    for set in 0..MAX_TEXCOORDS {
        let Some(accessor) = primitive.get(&Semantic::TexCoords(set)) else { continue };
        let mut values = accessors::vec2(&accessor, buffers)?;
        faults.check_length(&mut values, count);
        let mut values = select(&values, source_vertices);
        for value in &mut values {
            if !value.is_finite() {
                *value = Vec2::ZERO;
                faults.bad_texcoords += 1;
            }
        }
        texcoords.resize(set as usize, Vec::new());
        texcoords.push(values);
    }
    let mut colors = match primitive.get(&Semantic::Colors(0)) {
        Some(accessor) => accessors::colors(&accessor, buffers)?,
        None => Vec::new(),
    };
    faults.check_length(&mut colors, count);
    let mut colors = select(&colors, source_vertices);
    for color in &mut colors {
        *color = if color.is_finite() { color.max(Vec4::ZERO) } else { Vec4::ONE };
    }
    Ok((texcoords, colors))
}

/// `values` at `indices`; empty if there are no values.
fn select<T: Copy>(values: &[T], indices: &[u32]) -> Vec<T> {
    if values.is_empty() {
        return Vec::new();
    }
    indices.iter().map(|&i| values[i as usize]).collect()
}

/// A vertex of its own for every corner: source vertices and the renumbered triangles.
fn unshared(triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 3]>) {
    let renumbered = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    (triangles.as_flattened().to_vec(), renumbered)
}

/// The vertices in use, in their order, and the renumbered triangles.
fn compact(triangles: &[[u32; 3]], vertices: usize) -> (Vec<u32>, Vec<[u32; 3]>) {
    let mut number = vec![u32::MAX; vertices];
    for &v in triangles.as_flattened() {
        number[v as usize] = 0;
    }
    let mut sources = Vec::new();
    for (v, number) in number.iter_mut().enumerate() {
        if *number == 0 {
            *number = sources.len() as u32;
            sources.push(v as u32);
        }
    }
    (sources, triangles.iter().map(|t| t.map(|v| number[v as usize])).collect())
}

/// Twice the area times the unit normal. In f64, so that small triangles do not underflow.
fn area_normal(positions: &[Vec3], triangle: [u32; 3]) -> glam::DVec3 {
    let [a, b, c] = triangle.map(|v| positions[v as usize].as_dvec3());
    (b - a).cross(c - a)
}

/// Normals of unshared vertices.
fn flat_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    triangles.iter().flat_map(|&t| [area_normal(positions, t).normalize_or_zero().as_vec3(); 3]).collect()
}

/// Unit normals; those that have no direction become the mean of their triangles' normals, weighted by area.
fn sound_normals(normals: Vec<Vec3>, positions: &[Vec3], triangles: &[[u32; 3]], faults: &mut Faults) -> Vec<Vec3> {
    let mut normals: Vec<Vec3> = normals.into_iter().map(Vec3::normalize_or_zero).collect();
    let missing = normals.iter().filter(|n| **n == Vec3::ZERO).count();
    if missing == 0 {
        return normals;
    }
    faults.bad_normals += missing;
    let mut sums = vec![glam::DVec3::ZERO; normals.len()];
    for &t in triangles {
        for v in t {
            sums[v as usize] += area_normal(positions, t);
        }
    }
    for (normal, sum) in normals.iter_mut().zip(sums) {
        if *normal == Vec3::ZERO {
            // Faces that cancel leave no direction at all: up is as good as any.
            *normal = sum.normalize_or(glam::DVec3::Y).as_vec3();
        }
    }
    normals
}

/// Adds a primitive's vertices and triangles to the mesh.
fn append(mesh: &mut Mesh, part: Part, source: usize, material: usize) {
    let first_vertex = mesh.positions.len();
    let first_triangle = mesh.triangles.len() as u32;
    let end = first_vertex + part.positions.len();
    mesh.source_vertices.extend(part.source_vertices);
    mesh.positions.extend(part.positions);
    mesh.normals.extend(part.normals);
    for (set, values) in part.texcoords.into_iter().enumerate() {
        if mesh.texcoords.len() <= set {
            mesh.texcoords.push(Vec::new());
        }
        if !values.is_empty() {
            mesh.texcoords[set].resize(first_vertex, Vec2::ZERO);
            mesh.texcoords[set].extend(values);
        }
    }
    for set in mesh.texcoords.iter_mut().filter(|set| !set.is_empty()) {
        set.resize(end, Vec2::ZERO);
    }
    if !part.colors.is_empty() {
        mesh.colors.resize(first_vertex, Vec4::ONE);
        mesh.colors.extend(part.colors);
    } else if !mesh.colors.is_empty() {
        mesh.colors.resize(end, Vec4::ONE);
    }
    mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|v| v + first_vertex as u32)));
    mesh.primitives.push(Primitive {
        source,
        vertices: first_vertex as u32..end as u32,
        triangles: first_triangle..mesh.triangles.len() as u32,
        material,
    });
}
