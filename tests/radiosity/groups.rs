//! Light groups: they change nothing, add up, are what their lights give alone, and tell what reflectances do.

use super::rooms::{Baked, Face, Room, baked, baked_with, laid_out, lit, sphere};
use super::{cube, grey};
use glam::Vec3;
use lightkiln::accel::Accel;
use lightkiln::bake::{Counts, Draft, Found, FoundSoFar, Observer, Refinement};
use lightkiln::gather::{Lightmap, Probe};
use lightkiln::progress::Cancelled;
use lightkiln::relight::Patches;
use lightkiln::scene::{Environment, Light, LightGroups, LightShape, Rgb, Scene};
use std::f32::consts::PI;

fn bulb(name: &str, position: Vec3, intensity: Rgb) -> Light {
    Light {
        name: name.into(),
        path: name.into(),
        group: None,
        casts_shadows: true,
        position,
        axes: [Vec3::X, Vec3::Y, Vec3::Z],
        shape: LightShape::Point { intensity, radius: 0.05 },
        profile: None,
        faces_receivers: false,
    }
}

/// A room without a roof, with a box in it, two bulbs, a glowing wall and a sky.
fn mixed() -> Scene {
    let mut room = Room::default();
    let wall = grey(0.0, 0.7);
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y, Vec3::Z * 2.0);
    room.quad(Vec3::ZERO, z, x, wall);
    room.quad(Vec3::ZERO, x, y, wall);
    room.quad(Vec3::ZERO, y, z, grey(0.3, 0.4));
    room.quad(x, z, y, wall);
    room.quad(Vec3::new(0.8, 0.4, 0.8), Vec3::Z * 0.5, Vec3::X * 0.5, wall);
    let mut scene = room.scene();
    scene.materials[2].name = "Glow".into();
    scene.lights.push(bulb("Warm", Vec3::new(0.5, 0.6, 1.5), Rgb::new(1.0, 0.7, 0.3)));
    scene.lights.push(bulb("Cold", Vec3::new(1.6, 0.8, 0.4), Rgb::new(0.3, 0.5, 0.9)));
    scene.environment = Environment::Constant(Rgb::new(0.2, 0.3, 0.4));
    scene
}

fn group(scene: &Scene, b: &Baked, name: &str) -> Vec<Rgb> {
    let number = LightGroups::named(scene).names().iter().position(|n| n == name);
    b.light.groups.group(number.expect("the scene has that group"))
}

/// Root mean square difference by the mean of `want`.
fn difference(got: &[Rgb], want: &[Rgb]) -> f32 {
    let n = 3.0 * got.len() as f32;
    let squares: f32 = got.iter().zip(want).map(|(a, b)| (*a - *b).length_squared()).sum();
    (squares / n).sqrt() / (want.iter().map(|e| e.element_sum()).sum::<f32>() / n)
}

#[test]
fn groups_change_no_bit_and_add_up() {
    let scene = mixed();
    let whole = baked(&scene, 16.0, 0.02);
    let apart = baked_with(&scene, &LightGroups::named(&scene), 16.0, 0.02);
    assert_eq!(apart.light.combined, whole.light.combined);
    assert_eq!(whole.light.groups.groups(), 0);
    assert_eq!(apart.light.groups.groups(), 4);
    for (t, &all) in apart.light.combined.iter().enumerate() {
        let sum: Rgb = apart.light.groups.of(t).iter().sum();
        assert!((sum - all).abs().max_element() <= 1e-5 * all.max_element(), "texel {t}: {sum} instead of {all}");
        let direct: Rgb = apart.light.direct_groups.of(t).iter().sum();
        assert!((direct - apart.light.direct[t]).abs().max_element() <= 1e-5 * all.max_element(), "texel {t}");
    }
}

#[test]
fn a_group_is_what_its_lights_give_alone() {
    let scene = mixed();
    let apart = baked_with(&scene, &LightGroups::named(&scene), 16.0, 0.01);
    let alone = |keep: &str| {
        let mut one = scene.clone();
        one.lights.retain(|l| l.name == keep);
        one.materials.iter_mut().filter(|m| m.name != keep).for_each(|m| m.emission = Rgb::ZERO);
        if keep != "environment" {
            one.environment = Environment::Black;
        }
        baked(&one, 16.0, 0.01).light.combined
    };
    for (name, key) in [("Warm", "Warm"), ("Cold", "Cold"), ("material:Glow", "Glow"), ("environment", "environment")] {
        let miss = difference(&group(&scene, &apart, name), &alone(key));
        assert!(miss < 0.015, "{name}: {miss}");
    }
}

/// A sphere whose upper half glows twice as much as its lower one, with a material for each.
fn glowing_sphere(reflectance: f32) -> Scene {
    let mut scene = sphere(16, |d| grey(if d.y > 0.0 { 2.0 } else { 1.0 }, reflectance));
    for material in &mut scene.materials {
        material.name = if material.emission.x > 1.5 { "Upper".into() } else { "Lower".into() };
    }
    scene
}

#[test]
fn emission_that_rays_meet_belongs_to_its_group() {
    // H = mean(E)/(1 − ρ) on all of a sphere's inside, for each part of E.
    let scene = glowing_sphere(0.6);
    let b = baked_with(&scene, &LightGroups::named(&scene), 8.0, 0.02);
    for (name, radiance) in [("material:Upper", 2.0), ("material:Lower", 1.0)] {
        let want = vec![Rgb::splat(0.5 * PI * radiance / 0.4); b.texels.len()];
        let miss = difference(&group(&scene, &b, name), &want);
        assert!(miss < 0.02, "{name}: {miss}");
    }
}

/// Stops nothing, but keeps what was found at first sight of probes, has everything gathered again once, and may go on from
/// what another has kept.
#[derive(Default)]
struct Follower {
    before: Option<Found>,
    kept: Vec<u8>,
    refined: bool,
}

impl Observer for Follower {
    fn found_before(&mut self) -> Found {
        self.before.take().unwrap_or_default()
    }

    fn found(&mut self, so_far: &FoundSoFar, _: &Counts, _: &mut dyn FnMut() -> Option<Draft>) {
        if self.kept.is_empty() && !so_far.probes.is_empty() {
            self.kept = postcard::to_io(so_far, Vec::new()).expect("memory takes everything");
        }
    }

    fn judge(&mut self, light: &Lightmap, _: &[(u32, Probe)], _: &Counts) -> Result<Option<Refinement>, Cancelled> {
        let half = 0..light.combined.len() as u32 / 2;
        let is_first = !std::mem::replace(&mut self.refined, true);
        Ok(is_first.then(|| Refinement { tiles: vec![half], error: 0.01 }))
    }
}

#[test]
fn groups_outlast_refinements_and_interruptions() {
    let scene = mixed();
    let (atlas, texels) = laid_out(&scene, 12.0);
    let (accel, groups) = (Accel::build(&scene), LightGroups::named(&scene));
    let bake = |follower: &mut Follower| lit(&accel, (&atlas, &texels), &groups, 0.05, follower).lightmap;
    let mut first = Follower::default();
    let light = bake(&mut first);
    assert!(first.refined && !first.kept.is_empty());
    for (t, &all) in light.combined.iter().enumerate() {
        let sum: Rgb = light.groups.of(t).iter().sum();
        assert!((sum - all).abs().max_element() <= 1e-5 * all.max_element(), "texel {t}: {sum} instead of {all}");
    }
    let before = Some(postcard::from_bytes(&first.kept).expect("it was written a moment ago"));
    let again = bake(&mut Follower { before, ..Follower::default() });
    assert_eq!(again.combined, light.combined);
    assert_eq!(again.groups, light.groups);
    assert_eq!(again.direct_groups, light.direct_groups);
}

/// The patches of a scene, with its light kept apart.
fn patches(scene: &Scene, texels_per_metre: f32) -> Patches {
    let (atlas, texels) = laid_out(scene, texels_per_metre);
    let (accel, groups) = (Accel::build(scene), LightGroups::named(scene));
    lit(&accel, (&atlas, &texels), &groups, 0.02, &mut ()).patches.expect("there are groups").patches
}

/// Bounced light changes by `want` if all reflectances change by `factor`: on average to 1 %, and at every patch, which
/// knows what few rays have met, within `tolerance`.
fn check_change(what: &str, patches: &Patches, factor: f32, want: f32, tolerance: f32) {
    let change = patches.change(|_| Rgb::splat(factor));
    for (i, got) in change.values().iter().enumerate() {
        assert!((got.x / want - 1.0).abs() < tolerance, "{what}, value {i}: {got} instead of {want}");
    }
    let mean = change.values().iter().map(|v| v.x).sum::<f32>() / change.values().len() as f32;
    assert!((mean / want - 1.0).abs() < 0.01, "{what}: {mean} instead of {want} on average");
}

#[test]
fn changed_reflectances_agree_with_the_closed_form() {
    // Light that is met goes by 1/(1 − ρ).
    let sphere = patches(&glowing_sphere(0.5), 8.0);
    for factor in [0.4, 1.2, 1.6] {
        check_change("sphere", &sphere, factor, 0.5 / (1.0 - 0.5 * factor), 0.1);
    }
    // Two opposite walls of a cube glow, are sent like lamps, and reflect alone: what they reflect goes by ρ/(1 − F·ρ).
    let (wall, dark) = (grey(1.0, 0.6), Face { radiance: 0.0, reflectance: 0.0 });
    let mut cube = cube([wall, wall, dark, dark, dark, dark]);
    cube.materials.iter_mut().for_each(|m| m.name = "Wall".into());
    let (factor, reflected) = (0.1998249, |reflectance: f32, factor: f32| reflectance / (1.0 - factor * reflectance));
    let want = reflected(0.3, factor) / reflected(0.6, factor);
    check_change("cube", &patches(&cube, 16.0), 0.5, want, 0.05);
}
