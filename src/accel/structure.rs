//! From the scene's triangles to the wide hierarchy.
//!
//! Meshes that many instances share are built once, in their own space, and referred to by the instances; all other
//! triangles go into the world's hierarchy itself.

use super::alpha::alpha_test;
use super::assemble::assemble;
use super::bounds::{Bounds, INSTANCE, Reference};
use super::bvh8::{AlphaTest, Bvh8, Child, MAX_INSTANCES, Placed, StoredTriangle, Tag, Tri4};
use super::pages::with_large_pages;
use crate::scene::{Mesh, Scene};
use rayon::prelude::*;

/// Meshes of fewer triangles are never shared: entering a shared structure costs as much as testing them.
const SMALLEST_SHARED: usize = 256;

/// Builds over every triangle that rays meet and whose instance is among those that `casts` (true) or does not cast (false)
/// shadows. Meshes are shared where that saves more than `saving` copies of triangles.
pub(super) fn build(scene: &Scene, casts: bool, saving: usize) -> Bvh8 {
    assert!(scene.instances.len() <= MAX_INSTANCES, "more instances than ids");
    let chosen: Vec<bool> = scene.instances.iter().map(|i| i.casts_shadows == casts).collect();
    let shared = shared_meshes(scene, &chosen, saving);
    let parts: Vec<Option<Bvh8>> =
        shared.par_iter().enumerate().map(|(mesh, &shared)| shared.then(|| mesh_structure(scene, mesh))).collect();
    let triangles = WorldTriangles::new(scene, &chosen, &shared);
    let mut references = triangles.references();
    let mut placed = Vec::new();
    for (index, instance) in scene.instances.iter().enumerate().filter(|&(index, _)| chosen[index]) {
        let Some(part) = &parts[instance.mesh] else { continue };
        let boxes = part.outer_boxes().into_iter().filter(Bounds::is_finite);
        let corners = boxes.flat_map(|b| b.corners()).map(|p| instance.transform.transform_point3(p));
        let bounds = Bounds::of_points(corners);
        if let Some(root) = part.root.filter(|_| bounds.is_finite()) {
            // Twice, because the transform rounds as well.
            references.push(Reference::new(bounds.padded().padded(), INSTANCE | placed.len() as u32));
            placed.push(Placed { to_local: instance.transform.inverse(), root, instance: index as u32 });
        }
    }
    let world = assemble(references, &|id| triangles.stored(id));
    if placed.is_empty() { world } else { join(scene, world, parts, placed) }
}

/// Which meshes are built once for all their `chosen` instances.
fn shared_meshes(scene: &Scene, chosen: &[bool], saving: usize) -> Vec<bool> {
    let mut uses = vec![0usize; scene.meshes.len()];
    scene.instances.iter().zip(chosen).filter(|(_, chosen)| **chosen).for_each(|(i, _)| uses[i.mesh] += 1);
    let shared = |(mesh, uses): (&Mesh, usize)| {
        let triangles = mesh.triangles.len();
        triangles >= SMALLEST_SHARED && uses.saturating_sub(1).saturating_mul(triangles) > saving
    };
    scene.meshes.iter().zip(uses).map(shared).collect()
}

/// The structure of one mesh in its own space.
fn mesh_structure(scene: &Scene, mesh: usize) -> Bvh8 {
    let geometry = &scene.meshes[mesh];
    let corners = |triangle: u32| geometry.triangles[triangle as usize].map(|v| geometry.positions[v as usize]);
    let references = (0..geometry.triangles.len() as u32).filter_map(|triangle| {
        let corners = corners(triangle);
        let solid = alpha_test(scene, mesh, triangle as usize).is_some();
        (solid && corners.iter().all(|c| c.is_finite()))
            .then(|| Reference::new(Bounds::of_points(corners).padded(), triangle))
    });
    let stored = |triangle: u32| {
        let alpha = alpha_test(scene, mesh, triangle as usize).unwrap_or(AlphaTest::None);
        StoredTriangle { corners: corners(triangle), tag: Tag::new(0, false, alpha), triangle }
    };
    assemble(references.collect(), &stored)
}

/// The world's structure followed by those of the shared meshes.
fn join(scene: &Scene, world: Bvh8, parts: Vec<Option<Bvh8>>, mut placed: Vec<Placed>) -> Bvh8 {
    let all = || std::iter::once(&world).chain(parts.iter().flatten());
    let mut joined = Bvh8 {
        nodes: with_large_pages(all().map(|part| part.nodes.len()).sum()),
        blocks: with_large_pages(all().map(|part| part.blocks.len()).sum()),
        ..Bvh8::EMPTY
    };
    joined.blocks.push(Tri4::new([]));
    let mut append = |part: Bvh8| {
        let shift = joined.append(part.nodes, part.blocks.into_iter().skip(1));
        part.root.map(|root| root.shifted(shift))
    };
    let root = append(world);
    let roots: Vec<Option<Child>> = parts.into_iter().map(|part| part.and_then(&mut append)).collect();
    for p in &mut placed {
        let mesh = scene.instances[p.instance as usize].mesh;
        p.root = roots[mesh].expect("only meshes with a root are placed");
    }
    Bvh8 { placed, root, ..joined }
}

/// The triangles of the chosen instances whose meshes are not shared, numbered through.
struct WorldTriangles<'a> {
    scene: &'a Scene,
    /// First number of every instance, and the end.
    first: Vec<u32>,
}

impl<'a> WorldTriangles<'a> {
    fn new(scene: &'a Scene, chosen: &[bool], shared: &[bool]) -> Self {
        let mut first = Vec::with_capacity(scene.instances.len() + 1);
        let mut count = 0usize;
        for (instance, &chosen) in scene.instances.iter().zip(chosen) {
            first.push(count as u32);
            if chosen && !shared[instance.mesh] {
                count += scene.meshes[instance.mesh].triangles.len();
            }
            assert!(count < INSTANCE as usize, "more triangles than ids");
        }
        first.push(count as u32);
        Self { scene, first }
    }

    /// Boxes of all triangles that are finite and not wholly transparent.
    fn references(&self) -> Vec<Reference> {
        let of_instance = |instance: usize| {
            let first = self.first[instance];
            let mesh = self.scene.instances[instance].mesh;
            (0..self.first[instance + 1] - first).into_par_iter().filter_map(move |triangle| {
                let corners = self.scene.corners(instance, triangle as usize);
                let solid = alpha_test(self.scene, mesh, triangle as usize).is_some();
                (solid && corners.iter().all(|c| c.is_finite()))
                    .then(|| Reference::new(Bounds::of_points(corners).padded(), first + triangle))
            })
        };
        (0..self.scene.instances.len()).into_par_iter().flat_map(of_instance).collect()
    }

    fn stored(&self, id: u32) -> StoredTriangle {
        // Instances without triangles share their first number with the next.
        let index = self.first.partition_point(|&first| first <= id) - 1;
        let instance = &self.scene.instances[index];
        let triangle = id - self.first[index];
        let alpha = alpha_test(self.scene, instance.mesh, triangle as usize).unwrap_or(AlphaTest::None);
        StoredTriangle {
            corners: self.scene.corners(index, triangle as usize),
            tag: Tag::new(index, instance.flips(), alpha),
            triangle,
        }
    }
}
