//! Ray queries against brute force, on both instruction sets.

use glam::{Affine3A, DVec3, Vec2, Vec3, Vec4};
use lightkiln::accel::{Accel, AccelSettings, Hit, Ray, offset_origin};
use lightkiln::scene::{
    AlphaMode, Filter, Instance, LightmapRequest, Material, Mesh, Primitive, Rgb, Scene, Texture, TextureSlot, Wrap,
};

/// A small reproducible generator of numbers in 0..1 (Steele et al., SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    fn signed(&mut self) -> f32 {
        2.0 * self.next() - 1.0
    }

    fn point(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let p = self.point();
            if (0.01..1.0).contains(&p.length_squared()) {
                return p.normalize();
            }
        }
    }
}

fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        normals: vec![Vec3::Y; positions.len()],
        primitives: vec![Primitive {
            source: 0,
            vertices: 0..positions.len() as u32,
            triangles: 0..triangles.len() as u32,
            material: 0,
        }],
        positions,
        triangles,
        ..Default::default()
    }
}

fn instance(mesh: usize, transform: Affine3A) -> Instance {
    Instance {
        path: String::new(),
        node: 0,
        mesh,
        transform,
        casts_shadows: true,
        lightmap: LightmapRequest::Default,
        group: None,
        gpu_instance: None,
    }
}

fn scene(meshes: Vec<Mesh>, instances: Vec<Instance>) -> Scene {
    Scene { meshes, instances, materials: vec![Material::default()], ..Default::default() }
}

/// Separate triangles of about `size` within a cube of half-width 1.
fn soup(count: usize, size: f32, random: &mut Random) -> Mesh {
    let mut positions = Vec::new();
    for _ in 0..count {
        let centre = random.point();
        positions.extend((0..3).map(|_| centre + size * random.point()));
    }
    mesh(positions, (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

/// A closed sphere of `2·bands·bands` quads with poles that share one vertex each.
fn sphere(bands: u32) -> Mesh {
    let around = 2 * bands;
    let mut positions = vec![Vec3::Y];
    for i in 1..bands {
        let theta = std::f32::consts::PI * i as f32 / bands as f32;
        for j in 0..around {
            let phi = std::f32::consts::TAU * j as f32 / around as f32;
            positions.push(Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()));
        }
    }
    positions.push(-Vec3::Y);
    let last = positions.len() as u32 - 1;
    let at = |i: u32, j: u32| 1 + (i - 1) * around + j % around;
    let mut triangles = Vec::new();
    for j in 0..around {
        triangles.push([0, at(1, j + 1), at(1, j)]);
        triangles.push([last, at(bands - 1, j), at(bands - 1, j + 1)]);
        for i in 1..bands - 1 {
            triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            triangles.push([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    mesh(positions, triangles)
}

fn ray(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
}

/// Distance to one triangle in double precision, with how close the ray passes to its edges (barycentric).
fn intersect(ray: &Ray, corners: [Vec3; 3]) -> Option<(f64, f64)> {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let (o, d): (DVec3, DVec3) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (ab, ac) = (b - a, c - a);
    let p = d.cross(ac);
    let det = ab.dot(p);
    if det == 0.0 {
        return None;
    }
    let v = (o - a).dot(p) / det;
    let q = (o - a).cross(ab);
    let w = d.dot(q) / det;
    let t = ac.dot(q) / det;
    let margin = v.min(w).min(1.0 - v - w);
    (margin >= -1e-4 && t > ray.t_min as f64 && t < ray.t_max as f64).then_some((t, margin))
}

/// Nearest distance by trying every triangle; None if the answer hangs on rounding.
fn brute_force(scene: &Scene, ray: &Ray) -> Option<Option<f64>> {
    let mut best: Option<f64> = None;
    for (i, instance) in scene.instances.iter().enumerate().filter(|(_, i)| i.casts_shadows) {
        for triangle in 0..scene.meshes[instance.mesh].triangles.len() {
            if let Some((t, margin)) = intersect(ray, scene.corners(i, triangle)) {
                if margin.abs() < 1e-4 || t < 1e-4 || (t - ray.t_max as f64).abs() < 1e-4 {
                    return None;
                }
                best = Some(best.map_or(t, |b: f64| b.min(t)));
            }
        }
    }
    Some(best)
}

/// Every mesh that is used twice is built once.
const SHARED: AccelSettings = AccelSettings { sharing_saves: 0 };

/// Compares random rays with brute force, and the two instruction sets with each other.
fn check(scene: &Scene, settings: &AccelSettings, rays: impl Iterator<Item = Ray>) {
    let accel = Accel::build_with(scene, settings);
    let portable = Accel::build_with(scene, settings).portable();
    let mut compared = 0;
    for ray in rays {
        let hit = accel.closest(&ray);
        assert_eq!(hit, portable.closest(&ray), "{ray:?}");
        assert_eq!(accel.occluded(&ray), portable.occluded(&ray), "{ray:?}");
        assert_eq!(accel.occluded(&ray), hit.is_some(), "{ray:?}");
        assert_eq!(accel.transmittance(&ray), if hit.is_some() { Rgb::ZERO } else { Rgb::ONE });
        let Some(truth) = brute_force(scene, &ray) else { continue };
        assert_eq!(hit.map(|h| h.t).is_some(), truth.is_some(), "{ray:?}: {hit:?}, expected {truth:?}");
        if let (Some(hit), Some(t)) = (hit, truth) {
            assert!((hit.t as f64 - t).abs() <= 1e-4 * (1.0 + t), "{ray:?}: {hit:?}, expected {t}");
            check_hit(scene, &ray, &hit);
        }
        compared += 1;
    }
    assert!(compared > 100, "only {compared} rays could be compared");
}

/// The hit's triangle, barycentrics and normal agree with its distance.
fn check_hit(scene: &Scene, ray: &Ray, hit: &Hit) {
    let corners = scene.corners(hit.instance as usize, hit.triangle as usize);
    let [a, b, c] = corners;
    let on_triangle = a + (b - a) * hit.barycentric.x + (c - a) * hit.barycentric.y;
    let on_ray = ray.origin + ray.direction * hit.t;
    let size = corners.iter().fold(1.0f32, |s, p| s.max(p.length()));
    assert!(on_triangle.distance(on_ray) < 2e-4 * size, "{on_triangle} and {on_ray} differ");
    let normal = scene.geometric_normal(hit.instance as usize, hit.triangle as usize);
    assert!(hit.normal.distance(normal) < 1e-3, "{} is not {normal}", hit.normal);
}

fn random_rays(count: usize, scale: f32, seed: u64) -> impl Iterator<Item = Ray> {
    let mut random = Random(seed);
    (0..count).map(move |i| {
        let mut r = ray(1.5 * scale * random.point(), random.direction());
        if i % 3 == 1 {
            r.t_max = random.next() * scale;
        }
        if i % 3 == 2 {
            r.t_min = random.next() * scale;
        }
        r
    })
}

#[test]
fn agrees_with_brute_force_on_triangle_soups() {
    let mut random = Random(1);
    for (count, size) in [(1, 1.0), (2, 0.5), (5, 0.5), (300, 0.2), (2000, 0.05)] {
        let s = scene(vec![soup(count, size, &mut random)], vec![instance(0, Affine3A::IDENTITY)]);
        check(&s, &AccelSettings::default(), random_rays(1000, 1.0, 2));
    }
}

#[test]
fn agrees_with_brute_force_far_from_and_near_to_the_origin() {
    let mut random = Random(3);
    for scale in [1e-6, 1e-3, 1e4, 1e9] {
        let transform = Affine3A::from_scale(Vec3::splat(scale));
        let s = scene(vec![soup(200, 0.2, &mut random)], vec![instance(0, transform)]);
        let (accel, portable) = (Accel::build(&s), Accel::build(&s).portable());
        let mut hits = 0;
        for r in random_rays(1000, scale, 4) {
            let hit = accel.closest(&r);
            assert_eq!(hit, portable.closest(&r));
            assert_eq!(accel.occluded(&r), hit.is_some());
            // In units of the scene, so that brute force's margins apply.
            let unit = Ray { origin: r.origin / scale, t_min: r.t_min / scale, t_max: r.t_max / scale, ..r };
            let unit_scene = scene(vec![s.meshes[0].clone()], vec![instance(0, Affine3A::IDENTITY)]);
            let Some(truth) = brute_force(&unit_scene, &unit) else { continue };
            assert_eq!(hit.is_some(), truth.is_some(), "scale {scale}: {r:?}");
            if let (Some(hit), Some(t)) = (hit, truth) {
                assert!(((hit.t / scale) as f64 - t).abs() < 1e-4 * (1.0 + t));
                hits += 1;
            }
        }
        assert!(hits > 50, "{hits} hits at scale {scale}");
    }
}

#[test]
fn mirrored_and_sheared_instances_keep_distance_and_front_face() {
    let mut random = Random(5);
    let turned = Affine3A::from_rotation_y(0.7) * Affine3A::from_translation(Vec3::new(0.3, -0.2, 0.1));
    let instances = vec![
        instance(0, Affine3A::from_scale(Vec3::new(-0.5, 0.5, 0.5))),
        instance(0, turned * Affine3A::from_scale(Vec3::new(0.4, -1.0, -0.3))),
        instance(0, turned * Affine3A::from_scale(Vec3::new(-0.4, -1.0, -0.3))),
    ];
    let s = scene(vec![soup(300, 0.3, &mut random)], instances);
    for settings in [AccelSettings::default(), SHARED] {
        check(&s, &settings, random_rays(1500, 1.0, 6));
    }
    let size = |settings| Accel::build_with(&s, settings).size();
    assert!(2 * size(&SHARED) < size(&AccelSettings::default()), "sharing saves nothing");
}

#[test]
fn a_forest_fits_into_memory() {
    // 10,000 trees of 5,000 triangles, which copied would take 3.5 GB.
    let mut random = Random(21);
    let tree = soup(5000, 0.1, &mut random);
    let place = |i: usize| Affine3A::from_translation(Vec3::new((i % 100) as f32, 0.0, (i / 100) as f32) * 4.0);
    let mut s = scene(vec![tree], (0..10_000).map(|i| instance(0, place(i))).collect());
    for casts in [true, false] {
        s.instances.iter_mut().for_each(|i| i.casts_shadows = casts);
        let accel = Accel::build(&s);
        assert!(accel.size() < 20 << 20, "{} bytes", accel.size());
        let down = |i: usize| ray(Vec3::from(place(i).translation) + 5.0 * Vec3::Y, Vec3::NEG_Y);
        let met: Vec<u32> =
            (0..10_000).step_by(97).filter_map(|i| accel.surface(&down(i))).map(|h| h.instance).collect();
        assert!(met.len() > 50 && met.iter().all(|i| i % 97 == 0), "{met:?}");
    }
}

#[test]
fn shared_and_copied_meshes_give_the_same_hits() {
    let mut random = Random(15);
    let mut instances = vec![instance(1, Affine3A::from_scale(Vec3::splat(3.0)))];
    for _ in 0..40 {
        let size = Vec3::new(random.signed(), random.signed(), random.signed()) * 0.5;
        let place = Affine3A::from_translation(3.0 * random.point()) * Affine3A::from_rotation_x(6.0 * random.next());
        instances.push(instance(0, place * Affine3A::from_scale(size)));
    }
    instances[7].casts_shadows = false;
    let s = scene(vec![sphere(16), soup(400, 0.1, &mut random)], instances);
    let (copied, shared) = (Accel::build(&s), Accel::build_with(&s, &SHARED));
    assert!(shared.size() < copied.size() / 3);
    let (mut hits, mut differences) = (0, 0);
    for r in random_rays(5000, 3.0, 16) {
        let (a, b) = (copied.closest(&r), shared.closest(&r));
        hits += usize::from(a.is_some());
        match (a, b) {
            (None, None) => {}
            (Some(a), Some(b)) if (a.instance, a.triangle) == (b.instance, b.triangle) => {
                assert!((a.t - b.t).abs() < 1e-3 * (1.0 + a.t), "{a:?} {b:?}");
                assert!(a.normal.distance(b.normal) < 1e-3, "{a:?} {b:?}");
            }
            // The ray runs along an edge, and rounding decides.
            _ => differences += 1,
        }
    }
    assert!(hits > 200 && differences < 5, "{differences} of {hits} hits differ");
}

#[test]
fn no_ray_leaves_a_shared_closed_mesh() {
    let place = Affine3A::from_translation(Vec3::new(30.0, -20.0, 10.0)) * Affine3A::from_rotation_z(0.3);
    let s = scene(vec![sphere(24)], vec![instance(0, place), instance(0, place * Affine3A::from_scale(-Vec3::ONE))]);
    let accel = Accel::build_with(&s, &SHARED);
    let mut random = Random(17);
    for position in &s.meshes[0].positions {
        let origin = place.transform_point3(0.5 * random.point());
        let r = ray(origin, (place.transform_point3(*position) - origin).normalize());
        assert!(accel.occluded(&r) && accel.closest(&r).is_some(), "{r:?} slips through");
    }
}

#[test]
fn masks_hold_in_shared_meshes() {
    let mut s = card_scene(AlphaMode::Mask(0.5));
    // A copy of the card for every layer, so that there is enough to share.
    let m = &mut s.meshes[0];
    m.triangles = m.triangles.iter().copied().cycle().take(512).collect();
    m.primitives[0].triangles = 0..512;
    s.instances = vec![s.instances[0].clone(); 3];
    s.instances[2].transform = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    let accel = Accel::build_with(&s, &SHARED);
    for (x, solid) in [(0.3, true), (0.7, false), (5.3, true), (5.7, false)] {
        assert_eq!(accel.occluded(&down(x, 0.4)), solid);
        assert_eq!(accel.closest(&down(x, 0.4)).map(|h| h.instance), solid.then_some(if x > 5.0 { 2 } else { 0 }));
    }
}

#[test]
fn no_ray_leaves_a_closed_mesh() {
    let placements = [
        Affine3A::IDENTITY,
        Affine3A::from_scale(Vec3::splat(300.0)),
        Affine3A::from_translation(Vec3::new(1000.0, -500.0, 250.0)),
        Affine3A::from_rotation_z(0.3) * Affine3A::from_scale(Vec3::new(1.0, 1e-3, 1.0)),
    ];
    for transform in placements {
        let s = scene(vec![sphere(24)], vec![instance(0, transform)]);
        let accels = [Accel::build(&s), Accel::build(&s).portable()];
        let mut random = Random(7);
        let mesh = &s.meshes[0];
        for [a, b, c] in &mesh.triangles {
            let corner = |v: u32| transform.transform_point3(mesh.positions[v as usize]);
            let (a, b, c) = (corner(*a), corner(*b), corner(*c));
            let targets = [a, b, c, (a + b) / 2.0, b.lerp(c, random.next()), c.lerp(a, random.next())];
            let origins = [Vec3::ZERO, 0.5 * random.point(), 0.5 * random.direction()];
            for (target, origin) in targets.iter().flat_map(|t| origins.map(|o| (*t, transform.transform_point3(o)))) {
                let r = ray(origin, (target - origin).normalize());
                for accel in &accels {
                    assert!(accel.closest(&r).is_some(), "{r:?} slips through {target}");
                    assert!(accel.occluded(&r), "{r:?} slips through {target}");
                }
            }
        }
    }
}

#[test]
fn axis_parallel_rays_meet_the_edges_of_flat_grids() {
    // Rays along −y into grid lines and grid points, where planes, edges and directions coincide.
    let n = 16u32;
    let positions = (0..=n).flat_map(|z| (0..=n).map(move |x| Vec3::new(x as f32, 0.0, z as f32))).collect();
    let at = |x, z| z * (n + 1) + x;
    let quads = (0..n).flat_map(|z| (0..n).map(move |x| (x, z)));
    let triangles = quads
        .flat_map(|(x, z)| [[at(x, z), at(x, z + 1), at(x + 1, z)], [at(x + 1, z), at(x, z + 1), at(x + 1, z + 1)]])
        .collect();
    let s = scene(vec![mesh(positions, triangles)], vec![instance(0, Affine3A::IDENTITY)]);
    for accel in [Accel::build(&s), Accel::build(&s).portable()] {
        for i in 1..2 * n {
            for j in 1..2 * n {
                let r = ray(Vec3::new(i as f32 / 2.0, 3.0, j as f32 / 2.0), -Vec3::Y);
                let hit = accel.closest(&r).expect("the grid has no gaps");
                assert_eq!((hit.t, hit.normal), (3.0, Vec3::Y));
            }
        }
        // Within the plane there is nothing to meet.
        assert_eq!(accel.closest(&ray(Vec3::new(-1.0, 0.0, 3.0), Vec3::X)), None);
    }
}

#[test]
fn an_empty_scene_is_clear() {
    let nothing = Scene::default();
    let accel = Accel::build(&nothing);
    let r = ray(Vec3::ZERO, Vec3::X);
    assert_eq!(accel.closest(&r), None);
    assert!(!accel.occluded(&r));
    assert_eq!(accel.transmittance(&r), Rgb::ONE);
}

#[test]
fn of_coincident_triangles_the_first_is_hit() {
    let triangle = mesh(vec![Vec3::ZERO, Vec3::X, Vec3::Z], vec![[0, 2, 1]; 50]);
    let s = scene(vec![triangle], vec![instance(0, Affine3A::IDENTITY); 3]);
    for accel in [Accel::build(&s), Accel::build(&s).portable()] {
        let hit = accel.closest(&ray(Vec3::new(0.2, 1.0, 0.2), -Vec3::Y)).expect("it is in the way");
        assert_eq!((hit.instance, hit.triangle, hit.t), (0, 0, 1.0));
    }
}

#[test]
fn nested_and_piled_up_geometry_is_traversed() {
    // Triangles that grow geometrically defeat balanced splits; thousands of coincident ones defeat all splits.
    let mut positions = Vec::new();
    for i in 0..250 {
        let size = 1e-12 * 1.1f32.powi(i);
        positions.extend([size * Vec3::X, size * Vec3::Y, size * Vec3::Z]);
    }
    positions.extend([2.0 * Vec3::X, 2.0 * Vec3::Y, 2.0 * Vec3::Z].repeat(20_000));
    let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let s = scene(vec![mesh(positions, triangles)], vec![instance(0, Affine3A::IDENTITY)]);
    for accel in [Accel::build(&s), Accel::build(&s).portable()] {
        let r = ray(Vec3::splat(5.0), -Vec3::ONE.normalize());
        assert_eq!(accel.closest(&r).map(|h| h.triangle), Some(250));
        let back = ray(Vec3::ZERO, Vec3::ONE.normalize());
        assert_eq!(accel.closest(&back).map(|h| h.triangle), Some(0));
        let last = Ray { t_max: accel.closest(&r).expect("just hit").t, ..r };
        assert!(!accel.occluded(&last));
    }
}

#[test]
fn rays_that_are_not_rays_meet_nothing() {
    let s = scene(vec![sphere(8)], vec![instance(0, Affine3A::IDENTITY)]);
    for accel in [Accel::build(&s), Accel::build(&s).portable()] {
        let good = ray(Vec3::ZERO, Vec3::X);
        assert!(accel.occluded(&good));
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for axis in 0..3 {
                let (mut r, mut q) = (good, good);
                r.origin[axis] = bad;
                q.direction[axis] = bad;
                assert!(accel.closest(&r).is_none() && accel.closest(&q).is_none());
            }
        }
        let short = |t_min, t_max| Ray { t_min, t_max, ..good };
        for r in [short(f32::NAN, 1.0), short(0.0, f32::NAN), short(2.0, 2.0), short(3.0, 2.0), short(0.0, 0.0)] {
            assert!(!accel.occluded(&r) && accel.closest(&r).is_none());
        }
        assert!(accel.closest(&Ray { direction: Vec3::ZERO, ..good }).is_none());
        // Far outside, and with a direction whose reciprocal overflows, a query still ends.
        for origin in [1e20, 1e30, f32::MAX] {
            accel.closest(&ray(Vec3::splat(origin), Vec3::X));
            accel.occluded(&ray(Vec3::splat(-origin), Vec3::new(1e-30, 1e-38, 0.0)));
        }
    }
}

#[test]
fn ends_of_the_segment_do_not_count() {
    let wall =
        mesh(vec![Vec3::new(-9.0, -9.0, 2.0), Vec3::new(9.0, -9.0, 2.0), Vec3::new(0.0, 9.0, 2.0)], vec![[0, 1, 2]]);
    let s = scene(vec![wall], vec![instance(0, Affine3A::IDENTITY)]);
    let accel = Accel::build(&s);
    let segment = |t_min, t_max| Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_min, t_max };
    assert!(accel.occluded(&segment(0.0, 2.1)));
    assert!(!accel.occluded(&segment(0.0, 2.0)));
    assert!(!accel.occluded(&segment(2.0, 3.0)));
    assert!(accel.closest(&segment(0.0, 2.0)).is_none());
}

#[test]
fn instances_that_cast_no_shadow_are_not_met() {
    let mut s = scene(vec![sphere(8)], vec![instance(0, Affine3A::IDENTITY); 2]);
    s.instances[0].casts_shadows = false;
    let r = ray(Vec3::ZERO, Vec3::X);
    assert_eq!(Accel::build(&s).closest(&r).map(|h| h.instance), Some(1));
    s.instances[1].casts_shadows = false;
    let accel = Accel::build(&s);
    assert!(accel.closest(&r).is_none() && !accel.occluded(&r));
}

#[test]
fn surfaces_without_shadow_are_met_where_they_are_surfaces() {
    let sphere_of = |radius: f32| instance(0, Affine3A::from_scale(Vec3::splat(radius)));
    let mut s = scene(vec![sphere(8)], vec![sphere_of(1.0), sphere_of(2.0)]);
    s.instances[0].casts_shadows = false;
    let met = |s: &Scene, r: Ray| Accel::build(s).surface(&r).map(|h| h.instance);
    // From outside the near front hides nothing that casts a shadow; from inside its back is only there on both sides.
    assert_eq!(met(&s, ray(Vec3::X * 1.5, -Vec3::X)), Some(0));
    assert_eq!(met(&s, ray(Vec3::X * 3.0, -Vec3::X)), Some(1));
    assert_eq!(met(&s, ray(Vec3::ZERO, Vec3::X)), Some(1));
    s.materials[0].double_sided = true;
    assert_eq!(met(&s, ray(Vec3::ZERO, Vec3::X)), Some(0));
}

#[test]
fn non_finite_geometry_is_left_out() {
    let mut m = sphere(8);
    m.positions[0] = Vec3::NAN;
    let s = scene(vec![m], vec![instance(0, Affine3A::IDENTITY)]);
    let accel = Accel::build(&s);
    assert!(accel.occluded(&ray(Vec3::ZERO, Vec3::X)));
    assert!(!accel.occluded(&ray(Vec3::ZERO, Vec3::Y)));
}

/// A unit square in the plane y = 0, texture coordinates equal to x and z.
fn card() -> Mesh {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 0.0, 1.0), Vec3::Z];
    let mut m = mesh(corners.to_vec(), vec![[0, 2, 1], [0, 3, 2]]);
    m.texcoords = vec![corners.iter().map(|p| Vec2::new(p.x, p.z)).collect()];
    m
}

fn card_scene(alpha_mode: AlphaMode) -> Scene {
    let mut s = scene(vec![card()], vec![instance(0, Affine3A::IDENTITY)]);
    // Left texel opaque, right texel clear.
    s.textures = vec![Texture {
        name: "leaf".into(),
        width: 2,
        height: 1,
        texels: vec![[255, 255, 255, 255], [255, 255, 255, 0]],
    }];
    s.materials[0].alpha_mode = alpha_mode;
    s.materials[0].base_color_texture = Some(TextureSlot {
        texture: 0,
        set: 0,
        transform: glam::Affine2::IDENTITY,
        wrap: [Wrap::Clamp; 2],
        filter: Filter::Nearest,
    });
    s
}

fn down(x: f32, z: f32) -> Ray {
    ray(Vec3::new(x, 1.0, z), -Vec3::Y)
}

#[test]
fn rays_pass_the_holes_of_masked_surfaces() {
    let s = card_scene(AlphaMode::Mask(0.5));
    for accel in [Accel::build(&s), Accel::build(&s).portable()] {
        for z in [0.1, 0.4, 0.6, 0.9] {
            for (x, solid) in [(0.1, true), (0.45, true), (0.55, false), (0.9, false)] {
                let r = down(x, z);
                assert_eq!(accel.occluded(&r), solid, "at {x}, {z}");
                assert_eq!(accel.closest(&r).is_some(), solid, "at {x}, {z}");
                assert_eq!(accel.transmittance(&r), if solid { Rgb::ZERO } else { Rgb::ONE });
            }
        }
    }
}

#[test]
fn constant_masks_are_solid_or_absent() {
    for (alpha, solid) in [(0.4, false), (0.5, true)] {
        let mut s = scene(vec![card()], vec![instance(0, Affine3A::IDENTITY)]);
        s.materials[0].alpha_mode = AlphaMode::Mask(0.5);
        s.materials[0].alpha = alpha;
        assert_eq!(Accel::build(&s).occluded(&down(0.3, 0.3)), solid);
    }
}

#[test]
fn vertex_alpha_takes_part_in_the_mask() {
    let mut s = scene(vec![card()], vec![instance(0, Affine3A::IDENTITY)]);
    s.materials[0].alpha_mode = AlphaMode::Mask(0.5);
    s.meshes[0].colors = s.meshes[0].positions.iter().map(|p| Vec4::new(1.0, 1.0, 1.0, 1.0 - p.x)).collect();
    let accel = Accel::build(&s);
    assert!(accel.occluded(&down(0.4, 0.3)));
    assert!(!accel.occluded(&down(0.6, 0.3)));
}

#[test]
fn blended_surfaces_tint_what_passes() {
    let mut s = scene(vec![card()], vec![instance(0, Affine3A::IDENTITY), instance(0, Affine3A::IDENTITY)]);
    s.instances[1].transform = Affine3A::from_translation(-Vec3::Y);
    s.materials[0].alpha_mode = AlphaMode::Blend;
    s.materials[0].alpha = 0.5;
    s.materials[0].base_color = Rgb::new(1.0, 0.5, 0.0);
    let accel = Accel::build(&s);
    // On the diagonal, which belongs to both triangles but to one surface.
    let r = down(0.3, 0.3);
    let once = Rgb::new(0.5, 0.375, 0.25);
    assert!(accel.transmittance(&Ray { t_max: 1.5, ..r }).distance(once) < 1e-6);
    assert!(accel.transmittance(&r).distance(once * once) < 1e-6);
    assert!(accel.occluded(&r), "blended surfaces are solid to plain occlusion");

    let clear = card_scene(AlphaMode::Blend);
    let accel = Accel::build(&clear);
    assert_eq!(accel.transmittance(&down(0.9, 0.3)), Rgb::ONE);
    assert_eq!(accel.transmittance(&down(0.1, 0.3)), Rgb::ZERO);
}

#[test]
fn any_number_of_threads_builds_the_same() {
    let mut random = Random(11);
    let s = scene(vec![soup(60_000, 0.05, &mut random)], vec![instance(0, Affine3A::IDENTITY)]);
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be had");
    let one = pool(1).install(|| Accel::build(&s));
    let two = pool(2).install(|| Accel::build(&s));
    assert_eq!(one.digest(), two.digest());
}

#[test]
fn rays_from_offset_origins_do_not_meet_their_own_surface() {
    for (scale, shift) in [(1.0, Vec3::ZERO), (0.01, Vec3::ZERO), (30.0, Vec3::new(500.0, -300.0, 900.0))] {
        let transform = Affine3A::from_translation(shift) * Affine3A::from_scale(Vec3::splat(scale));
        let s = scene(vec![sphere(16)], vec![instance(0, transform)]);
        let accel = Accel::build(&s);
        let mut random = Random(13);
        for _ in 0..2000 {
            let inside = transform.transform_point3(0.3 * random.point());
            let r = ray(inside, random.direction());
            let hit = accel.closest(&r).expect("the sphere is closed");
            // Leave outwards: the sphere is convex, so nothing is in the way.
            let outwards = if hit.normal.dot(r.direction) > 0.0 { hit.normal } else { -hit.normal };
            let origin = offset_origin(r.origin + r.direction * hit.t, outwards);
            let direction = (outwards + 0.99 * random.direction()).normalize();
            assert!(!accel.occluded(&ray(origin, direction)));
        }
    }
}
