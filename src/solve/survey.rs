//! What every element sees, counted by rays: sky, surfaces, and backs that matter.

use crate::accel::{Accel, Hit, Ray, offset_origin};
use crate::atlas::Atlas;
use crate::hierarchy::{Hierarchy, Side, Surface, Surfels};
use crate::math::{Sequence, cosine_hemisphere, hash2, hash3, unit_float};
use crate::progress::{Cancelled, Progress};
use crate::scene::Rgb;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::PI;
use std::sync::atomic::{AtomicBool, Ordering};

/// Views of all elements.
pub struct Survey {
    /// Irradiance from the sky, W/m².
    pub sky: Vec<Rgb>,
    /// Share of the (cosine-weighted) view that surfaces fill which can send light back.
    pub lit: Vec<f32>,
    /// Rays cast.
    pub rays: u64,
}

/// Casts `rays` stratified rays from every element. `sky_radiance` is the radiance that a ray sees which leaves the
/// scene, from the position and unit normal that it starts from, its direction, and the solid angle that it stands for,
/// sr.
pub fn survey(
    accel: &Accel,
    surfels: &Surfels,
    tree: &Hierarchy,
    sky_radiance: impl Fn(Vec3, Vec3, Vec3, f32) -> Rgb + Sync,
    rays: u32,
    progress: &dyn Progress,
) -> Result<Survey, Cancelled> {
    let views: Vec<(Rgb, f32)> = (0..tree.elements.len() as u32)
        .into_par_iter()
        .map(|e| {
            let (mut sky, mut lit) = (Rgb::ZERO, 0);
            let centre = |s: u32, _: Vec2| surfels.position(s);
            look(accel, surfels, tree, e, rays, centre, |(position, normal), direction, of_sky, hit| {
                if let Some(passed) = of_sky {
                    sky += passed * sky_radiance(position, normal, direction, 2.0 * PI / rays as f32);
                }
                lit += hit.is_some_and(|(hit, side)| side == Side::Front || is_two_sided(accel, hit)) as u32;
            });
            if progress.is_cancelled() {
                return Err(Cancelled);
            }
            Ok((sky * (PI / rays as f32), lit as f32 / rays as f32))
        })
        .collect::<Result<_, Cancelled>>()?;
    let count = views.len() as u64 * rays as u64;
    let (sky, lit) = views.into_iter().unzip();
    Ok(Survey { sky, lit, rays: count })
}

/// Marks the surfaces whose back can be seen from some element, by `rays` rays each. Backs inside closed meshes and
/// backs that are no surfaces are not marked.
pub fn hidden_backs(
    accel: &Accel,
    atlas: &Atlas,
    surfels: &Surfels,
    tree: &Hierarchy,
    surfaces: &[Surface],
    rays: u32,
    progress: &dyn Progress,
) -> Result<Vec<bool>, Cancelled> {
    let seen: Vec<AtomicBool> = surfaces.iter().map(|_| AtomicBool::new(false)).collect();
    let scene = accel.scene();
    (0..tree.elements.len() as u32).into_par_iter().try_for_each(|e| {
        // What crosses a texel shows its back to a part of it, which its middle may not see.
        let start = |s: u32, u: Vec2| match surfels.is_clear(s) || s as usize >= surfels.texels.len() {
            true => surfels.position(s),
            false => surfels.texels.surface(scene, atlas, s).sample(u).map_or(surfels.position(s), |p| p.position),
        };
        look(accel, surfels, tree, e, rays, start, |_, _, _, hit| {
            let Some((hit, Side::Back)) = hit else { return };
            let closed = scene.meshes[scene.instances[hit.instance as usize].mesh].closed;
            if closed || !is_two_sided(accel, hit) {
                return;
            }
            if let Some(s) = surfels.at(atlas, hit.instance as usize, hit.triangle as usize, hit.barycentric) {
                let surface = surfaces.partition_point(|x| x.surfels.end <= s);
                seen[surface].store(true, Ordering::Relaxed);
            }
        });
        if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    })?;
    Ok(seen.into_iter().map(AtomicBool::into_inner).collect())
}

fn is_two_sided(accel: &Accel, hit: &Hit) -> bool {
    let scene = accel.scene();
    scene.material_of(scene.instances[hit.instance as usize].mesh, hit.triangle as usize).double_sided
}

/// Calls `visit` for every ray with the middle and normal of the surfel that it starts from, its direction, what
/// translucent surfaces leave of the sky if it is seen, and the surface that is met. It is seen behind surfaces that cast
/// no shadow. `start` says where on a surfel, by a point of the unit square.
fn look(
    accel: &Accel,
    surfels: &Surfels,
    tree: &Hierarchy,
    element: u32,
    rays: u32,
    start: impl Fn(u32, Vec2) -> Vec3,
    mut visit: impl FnMut((Vec3, Vec3), Vec3, Option<Rgb>, Option<(&Hit, Side)>),
) {
    let sampler = tree.sampler(surfels, element);
    let sequence = Sequence::new(hash2(element, 0x5ee));
    for i in 0..rays {
        let (surfel, side) = sampler.draw(sequence.second(i).x);
        let normal = tree.normal(surfels, surfel, side);
        let direction = cosine_hemisphere(normal, sequence.first(i));
        let inside = Vec2::new(sequence.second(i).y, unit_float(hash3(element, i, 0x1d5)));
        let origin = offset_origin(start(surfel, inside), normal);
        let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
        let (of_sky, hit) = follow(accel, ray, hash3(element, i, 0x7a1));
        visit(
            (surfels.position(surfel), normal),
            direction,
            of_sky,
            hit.as_ref().map(|h| (h, if h.normal.dot(direction) <= 0.0 { Side::Front } else { Side::Back })),
        );
    }
}

/// What is left of the sky along a ray, if it gets there, and the surface that it meets. Translucent surfaces stop it by
/// chance: the more of the light passes, the more rays do, and those that pass carry its colour.
fn follow(accel: &Accel, mut ray: Ray, seed: u32) -> (Option<Rgb>, Option<Hit>) {
    let (mut passed, mut met) = (Rgb::ONE, None);
    let mut layers = 0;
    while let Some(hit) = accel.surface(&ray) {
        if accel.casts_shadow(&hit) {
            layers += 1;
            let through = accel.transmission_at(&hit).filter(|_| layers < Accel::MOST_LAYERS).unwrap_or(Rgb::ZERO);
            let chance = through.element_sum() / 3.0;
            if unit_float(hash2(seed, layers)) >= chance {
                return (None, met.or(Some(hit)));
            }
            passed *= through / chance;
        } else {
            met = met.or(Some(hit));
        }
        ray = accel.behind(&ray, &hit);
    }
    (Some(passed), met)
}
