//! What a change of reflectances does to bounced light, from the rays of the bake: elements with what their rays met →
//! patches of neighbouring elements → irradiance per patch before and after.
//!
//! A patch is coarser than an element, because light that has bounced changes less from place to place than it varies:
//! only the change is taken from patches, all detail from the lightmap.

use crate::atlas::Atlas;
use crate::gather::{Bounce, Grouped, NOTHING};
use crate::hierarchy::{Hierarchy, Side, Surfels};
use crate::scene::{Rgb, Scene};
use rayon::prelude::*;
use std::ops::Range;

/// Surfels of one patch at most, unless it is one element.
const SURFELS: usize = 16;
/// Rays that are kept per surfel of a patch, and bounds on their number.
const RAYS_PER_SURFEL: usize = 4;
const FEWEST_RAYS: usize = 64;
const MOST_RAYS: usize = 256;
/// Iterations at most, and the relative change at which they end.
const ITERATIONS: usize = 256;
const CONVERGENCE: f32 = 1e-5;
/// Largest change of the light at one place that is believed.
const MOST_CHANGE: f32 = 100.0;

/// The reflectance of one material in a patch, times the share of the patch that has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflector {
    /// Patch.
    pub patch: u32,
    /// Material of the scene.
    pub material: u32,
    /// Reflectance × share.
    pub reflectance: Rgb,
}

/// Neighbouring elements that reflect as one, and the light that they exchange.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Patches {
    /// What they reflect, by patch.
    pub reflectors: Vec<Reflector>,
    /// First ray of every patch; one more entry than patches.
    pub first_ray: Vec<u32>,
    /// Patch that each ray met, [`NOTHING`] if none.
    pub rays: Vec<u32>,
    /// Irradiance straight from sky and emissive surfaces that rays meet, W/m², by light group.
    pub own: Grouped,
    /// Irradiance straight from lamps, W/m², by light group.
    pub direct: Grouped,
}

/// The lit elements of a bake.
#[derive(Clone, Copy)]
pub struct LitElements<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its layout.
    pub atlas: &'a Atlas,
    /// Texels and patches without a lightmap.
    pub surfels: &'a Surfels<'a>,
    /// The elements.
    pub tree: &'a Hierarchy,
    /// Texels that are receivers of their own.
    pub shut: &'a [u32],
    /// What the elements' rays met.
    pub bounce: &'a Bounce,
    /// Irradiance of elements straight from lamps, W/m², by light group.
    pub direct: &'a Grouped,
}

impl Patches {
    /// Joins the elements of a bake to patches. Gives the patch of every element, too.
    pub fn new(lit: &LitElements) -> (Self, Vec<u32>) {
        let LitElements { tree, shut, bounce, direct, .. } = *lit;
        let ranges = ranges(tree);
        let of_element: Vec<u32> =
            ranges.iter().enumerate().flat_map(|(p, r)| std::iter::repeat_n(p as u32, r.len())).collect();
        let patch_of = |receiver: u32| match shut.get((receiver as usize).wrapping_sub(tree.elements.len())) {
            Some(&texel) => tree.element_of(texel, Side::Front).map_or(NOTHING, |e| of_element[e as usize]),
            None => of_element.get(receiver as usize).copied().unwrap_or(NOTHING),
        };
        let groups = direct.groups();
        let each = bounce.hits.len() / (tree.elements.len() + shut.len()).max(1);
        let mut patches = Self {
            own: Grouped::new(groups, ranges.len()),
            direct: Grouped::new(groups, ranges.len()),
            ..Self::default()
        };
        for (p, range) in ranges.iter().enumerate() {
            let area = |e: u32| tree.nodes[tree.elements[e as usize].node as usize].area;
            let total: f32 = range.clone().map(area).sum::<f32>().max(f32::MIN_POSITIVE);
            for e in range.clone() {
                let share = area(e) / total;
                add(patches.own.of_mut(p), bounce.own.of(e as usize), share);
                add(patches.direct.of_mut(p), direct.of(e as usize), share);
            }
            patches.first_ray.push(patches.rays.len() as u32);
            patches.rays.extend(
                rays(tree, range, &bounce.hits, each).map(|hit| if hit == NOTHING { hit } else { patch_of(hit) }),
            );
            patches.reflectors.extend(reflectors(lit, p as u32, range));
        }
        patches.first_ray.push(patches.rays.len() as u32);
        (patches, of_element)
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.first_ray.len().saturating_sub(1)
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Irradiance of every patch from everything but lamps, W/m², by light group, if the reflectance of each material is
    /// multiplied by what `factor` says.
    pub fn irradiance(&self, factor: impl Fn(usize) -> Rgb) -> Grouped {
        let mut reflectance = vec![Rgb::ZERO; self.len()];
        for r in &self.reflectors {
            reflectance[r.patch as usize] += r.reflectance * factor(r.material as usize);
        }
        let limit = Rgb::splat(crate::scene::MAX_REFLECTANCE);
        reflectance.iter_mut().for_each(|r| *r = r.min(limit));
        let mut irradiance = self.own.clone();
        for _ in 0..ITERATIONS {
            let next = self.bounced(&reflectance, &irradiance);
            let (now, before) = (next.total(), irradiance.total());
            irradiance = next;
            if (now - before).abs() <= CONVERGENCE * now {
                break;
            }
        }
        irradiance
    }

    /// One bounce: own light and what the patches that its rays met reflect of lamps and of `before`.
    fn bounced(&self, reflectance: &[Rgb], before: &Grouped) -> Grouped {
        let mut next = self.own.clone();
        next.rows_mut(self.len()).into_par_iter().enumerate().for_each(|(p, row)| {
            let rays = &self.rays[self.first_ray[p] as usize..self.first_ray[p + 1] as usize];
            for &met in rays.iter().filter(|&&met| met != NOTHING) {
                let met = met as usize;
                let share = reflectance[met] / rays.len() as f32;
                for ((sum, &e), &direct) in row.iter_mut().zip(before.of(met)).zip(self.direct.of(met)) {
                    *sum += share * (e + direct);
                }
            }
        });
        next
    }

    /// By what factor light from everything but lamps changes at every patch, by light group, if the reflectance of each
    /// material is multiplied by what `factor` says.
    pub fn change(&self, factor: impl Fn(usize) -> Rgb) -> Grouped {
        let before = self.irradiance(|_| Rgb::ONE);
        let mut after = self.irradiance(factor);
        for p in 0..self.len() {
            for (after, &before) in after.of_mut(p).iter_mut().zip(before.of(p)) {
                let ratio = |c: usize| if before[c] > 0.0 { (after[c] / before[c]).min(MOST_CHANGE) } else { 1.0 };
                *after = Rgb::from_array(std::array::from_fn(ratio));
            }
        }
        after
    }
}

/// Adds `share` of `part`.
fn add(sum: &mut [Rgb], part: &[Rgb], share: f32) {
    sum.iter_mut().zip(part).for_each(|(sum, &part)| *sum += part * share);
}

/// The elements of every patch: those below the highest nodes with few enough surfels.
fn ranges(tree: &Hierarchy) -> Vec<Range<u32>> {
    let mut before = vec![0usize];
    for element in &tree.elements {
        before.push(before[before.len() - 1] + element.surfels.len());
    }
    let mut ranges = Vec::new();
    let mut node = 0;
    while let Some(n) = tree.nodes.get(node as usize) {
        let surfels = before[n.elements.end as usize] - before[n.elements.start as usize];
        if surfels <= SURFELS || tree.is_leaf(node) {
            ranges.push(n.elements.clone());
            node = n.skip;
        } else {
            node += 1;
        }
    }
    ranges
}

/// Rays of a patch, drawn from its elements in proportion to their areas; each element gives its rays in order, for the
/// first ones of a sequence are as evenly spread as all. Every element has as many as `each`.
fn rays<'a>(
    tree: &'a Hierarchy,
    range: &Range<u32>,
    hits: &'a [u32],
    each: usize,
) -> impl Iterator<Item = u32> + use<'a> {
    let (first, end) = (range.start as usize, range.end as usize);
    let surfels: usize = tree.elements[first..end].iter().map(|e| e.surfels.len()).sum();
    let all = each * (end - first);
    let count = (RAYS_PER_SURFEL * surfels).clamp(FEWEST_RAYS, MOST_RAYS).min(all);
    let (low, high) = (tree.cumulative_area[first], tree.cumulative_area[end]);
    let mut used = vec![0usize; end - first];
    (0..count).map(move |k| {
        let at = low + (high - low) * (k as f64 + 0.5) / count as f64;
        let e = (first + tree.cumulative_area[first + 1..end].partition_point(|&a| a <= at)).min(end - 1);
        let ray = used[e - first] % each;
        used[e - first] += 1;
        hits[e * each + ray]
    })
}

/// What the materials of a patch reflect.
fn reflectors(lit: &LitElements, patch: u32, range: &Range<u32>) -> Vec<Reflector> {
    let LitElements { scene, atlas, surfels, tree, .. } = *lit;
    let (mut found, mut total): (Vec<Reflector>, f32) = (Vec::new(), 0.0);
    for s in range.clone().flat_map(|e| tree.elements[e as usize].surfels.clone()) {
        let (instance, triangle) = surfels.triangle(atlas, s);
        let material = scene.meshes[scene.instances[instance].mesh].primitive_of(triangle).material as u32;
        let (area, reflectance) = (surfels.area(s), surfels.reflectance(s) * surfels.area(s));
        total += area;
        match found.iter_mut().find(|r| r.material == material) {
            Some(r) => r.reflectance += reflectance,
            None => found.push(Reflector { patch, material, reflectance }),
        }
    }
    found.iter_mut().for_each(|r| r.reflectance /= total.max(f32::MIN_POSITIVE));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A closed room of two patches that see each other and themselves alike, lit by a lamp that sends 1 to the first.
    fn room() -> Patches {
        let reflector = |patch, reflectance| Reflector { patch, material: patch, reflectance: Rgb::splat(reflectance) };
        Patches {
            reflectors: vec![reflector(0, 0.5), reflector(1, 0.2)],
            first_ray: vec![0, 2, 4],
            rays: vec![0, 1, 0, 1],
            own: Grouped::new(1, 2),
            direct: Grouped::from_groups(&[vec![Rgb::ONE, Rgb::ZERO]]),
        }
    }

    #[test]
    fn closed_rooms_agree_with_the_closed_form() {
        // E = ½·ρ₀·(1 + E) + ½·ρ₁·E at both.
        let expected = |a: f32, b: f32| 0.5 * a / (1.0 - 0.5 * a - 0.5 * b);
        let check = |factors: [f32; 2]| {
            let e = room().irradiance(|m| Rgb::splat(factors[m]));
            let want = expected(0.5 * factors[0], 0.2 * factors[1]);
            assert!((e.of(0)[0].x / want - 1.0).abs() < 1e-3, "{} instead of {want}", e.of(0)[0].x);
            let change = room().change(|m| Rgb::splat(factors[m]));
            assert!((change.of(1)[0].x / (want / expected(0.5, 0.2)) - 1.0).abs() < 1e-3);
        };
        [[1.0, 1.0], [0.4, 1.0], [1.5, 2.0]].into_iter().for_each(check);
    }
}
