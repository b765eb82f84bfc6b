//! Known truths of radiosity, held by the whole chain from geometry to texels.

mod audit;
mod edges;
mod groups;
mod lamps;
mod leaves;
mod rooms;
mod secondary;
mod shadowless;
mod sky;
mod states;
mod sunk;

use glam::Vec3;
use lightkiln::accel::Accel;
use lightkiln::hierarchy::{self, Surfels};
use lightkiln::progress::Silent;
use lightkiln::scene::{Light, LightShape, Rgb, Scene};
use lightkiln::solve::{self, Elements, SolveSettings};
use lightkiln::transport::Exchange;
use rooms::{Baked, Face, Room, baked, mean, sphere};
use std::f32::consts::PI;

fn grey(radiance: f32, reflectance: f32) -> Face {
    Face { radiance, reflectance }
}

fn cube(faces: [Face; 6]) -> Scene {
    let mut room = Room::default();
    room.inside_of_box(Vec3::ZERO, Vec3::ONE, faces);
    room.scene()
}

/// Every texel within `tolerance` of `want`, relatively.
fn assert_uniform(b: &Baked, want: f32, tolerance: f32, what: &str) {
    for (i, e) in b.light.combined.iter().enumerate() {
        let miss = (e.element_sum() / 3.0 / want - 1.0).abs();
        assert!(miss < tolerance, "{what}: texel {i} at {} has {e}, not {want}", b.texels.position[i]);
    }
}

#[test]
fn furnace_cube_is_uniform() {
    for reflectance in [0.5, 0.8] {
        let b = baked(&cube([grey(1.0, reflectance); 6]), 24.0, 0.02);
        assert_uniform(&b, PI / (1.0 - reflectance), 0.005, "cube");
    }
}

#[test]
fn furnace_sphere_is_uniform() {
    let b = baked(&sphere(12, |_| grey(1.0, 0.5)), 8.0, 0.02);
    assert_uniform(&b, 2.0 * PI, 0.005, "sphere");
}

#[test]
fn furnace_of_a_corner_room_is_uniform() {
    // An L: two boxes that share a wall which is left out of both.
    let g = grey(1.0, 0.7);
    let mut room = Room::default();
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    for o in [Vec3::ZERO, x, z] {
        room.quad(o, z, x, g);
        room.quad(o + y, x, z, g);
    }
    room.quad(Vec3::ZERO, y, 2.0 * z, g);
    room.quad(Vec3::ZERO, 2.0 * x, y, g);
    room.quad(2.0 * x, z, y, g);
    room.quad(x + z, z, y, g);
    room.quad(2.0 * z, y, x, g);
    room.quad(x + z, y, x, g);
    let b = baked(&room.scene(), 16.0, 0.02);
    assert_uniform(&b, PI / 0.3, 0.005, "corner room");
}

#[test]
fn sphere_has_uniform_irradiance_whatever_its_walls() {
    // H = mean(E)/(1 − mean ρ) for any E(x) and ρ(x).
    let face = |d: Vec3| if d.y > 0.0 { grey(1.0, 0.8) } else { grey(0.2, 0.3) };
    let b = baked(&sphere(24, face), 10.0, 0.01);
    let all = b.where_at(|_, _| true);
    let want = PI * 0.6 / (1.0 - 0.55);
    assert!((mean(&all) / want - 1.0).abs() < 0.01, "mean {} not {want}", mean(&all));
    let rms = (all.iter().map(|(e, _)| (e / want - 1.0).powi(2)).sum::<f32>() / all.len() as f32).sqrt();
    assert!(rms < 0.015, "rms {rms}");
}

#[test]
fn facing_plates() {
    let mut room = Room::default();
    let size = 60.0;
    let o = Vec3::new(-size / 2.0, 0.0, -size / 2.0);
    room.quad(o, Vec3::Z * size, Vec3::X * size, grey(1.0 / PI, 0.5));
    room.quad(o + Vec3::Y, Vec3::X * size, Vec3::Z * size, grey(0.0, 0.5));
    let b = baked(&room.scene(), 2.0, 0.01);
    let near = |up: f32| move |p: Vec3, n: Vec3| n.y * up > 0.5 && p.x.hypot(p.z) < 3.0;
    let (lower, upper) = (mean(&b.where_at(near(1.0))), mean(&b.where_at(near(-1.0))));
    // B = E + ρH with B₁ = 4/3 and B₂ = 2/3.
    assert!((lower - 2.0 / 3.0).abs() < 0.01, "lower plate receives {lower}, upper {upper}");
    assert!((upper - 4.0 / 3.0).abs() < 0.02, "upper plate receives {upper}");
}

#[test]
fn cube_with_one_emitting_face() {
    for reflectance in [0.5, 0.8] {
        let mut faces = [grey(0.0, reflectance); 6];
        faces[2].radiance = 1.0 / PI;
        let b = baked(&cube(faces), 24.0, 0.01);
        let received = |normal: &dyn Fn(Vec3) -> bool| mean(&b.where_at(|_, n| normal(n)));
        let (own, side, opposite) =
            (received(&|n| n.y > 0.5), received(&|n| n.y.abs() < 0.5), received(&|n| n.y < -0.5));
        let absorbed = (1.0 - reflectance) * (own + 4.0 * side + opposite);
        assert!((absorbed - 1.0).abs() < 0.005, "ρ {reflectance}: emitted 1, absorbed {absorbed}");
    }
}

#[test]
fn six_constant_patches() {
    // Patch form factors by quadrature of the analytic kernel, then the flat system.
    let (opposite, side) = (0.1998249f32, 0.2000438f32);
    for (rho, want) in [(0.5, [1.0909091, 0.1818363, 0.1817458]), (0.8f32, [1.5517242, 0.6896812, 0.6895511])] {
        let mut b = [1.0, 0.0, 0.0];
        for _ in 0..400 {
            b = [
                1.0 + rho * (4.0 * side * b[1] + opposite * b[2]),
                rho * (side * b[0] + (2.0 * side + opposite) * b[1] + side * b[2]),
                rho * (opposite * b[0] + 4.0 * side * b[1]),
            ];
        }
        for (got, want) in b.into_iter().zip(want) {
            assert!((got - want).abs() < 2e-5, "ρ {rho}: {got} not {want}");
        }
    }
}

#[test]
fn a_thin_wall_lets_nothing_through() {
    let mut room = Room::default();
    room.inside_of_box(Vec3::ZERO, Vec3::new(2.0, 1.0, 1.0), [grey(0.0, 0.7); 6]);
    let (y, z) = (Vec3::Y, Vec3::Z);
    room.quad(Vec3::X * 0.9995, z, y, grey(0.0, 0.7));
    room.quad(Vec3::X * 1.0005, y, z, grey(0.0, 0.7));
    let mut scene = room.scene();
    scene.lights.push(Light {
        name: "Bulb".into(),
        path: "Bulb".into(),
        group: None,
        casts_shadows: true,
        position: Vec3::new(0.5, 0.8, 0.5),
        axes: [Vec3::X, Vec3::NEG_Z, Vec3::Y],
        shape: LightShape::Point { intensity: Rgb::ONE, radius: 0.02 },
        profile: None,
        faces_receivers: false,
    });
    let b = baked(&scene, 20.0, 0.02);
    // A texel that the wall crosses holds the mean of both its sides: one texel is left out.
    let (lit, dark) = (b.where_at(|p, _| p.x < 0.94), b.where_at(|p, _| p.x > 1.06));
    assert!(mean(&dark) < 1e-4 * mean(&lit), "{} behind the wall, {} before it", mean(&dark), mean(&lit));
    let worst = dark.iter().map(|v| v.0).fold(0.0, f32::max);
    assert!(worst < 1e-2 * mean(&lit), "a texel behind the wall has {worst}");
}

#[test]
fn threads_do_not_change_a_bit() {
    let mut faces = [grey(0.0, 0.6); 6];
    faces[1].radiance = 2.0;
    let scene = cube(faces);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        pool.install(|| baked(&scene, 16.0, 0.03).light.combined)
    };
    assert_eq!(run(1), run(2));
}

/// The coarse system of a room.
fn with_system(scene: &Scene, check: impl Fn(&Exchange, &solve::Survey)) {
    let b = baked(scene, 8.0, 0.5);
    let accel = Accel::build(scene);
    let covered = vec![false; b.texels.len()];
    let surfels = Surfels::new(scene, &b.atlas, &b.texels, &covered, &covered, &covered);
    let surfaces = surfels.surfaces(&b.atlas);
    let tree = hierarchy::build(&surfels, &surfaces, &vec![false; surfaces.len()], 4);
    let sky = |_: Vec3, _: Vec3, direction: Vec3, _: f32| scene.environment.radiance(direction);
    let survey = solve::survey(&accel, &surfels, &tree, sky, 64, &Silent).expect("nobody cancels");
    check(&Exchange { hierarchy: &tree, surfels: &surfels, accel: &accel }, &survey);
}

#[test]
fn absorbed_light_is_emitted_light() {
    with_system(&cube([grey(0.0, 0.5); 6]), |exchange, survey| {
        let n = exchange.hierarchy.elements.len();
        let wave = |i: usize, k: f32| 0.5 + 0.4 * (i as f32 * k).sin();
        let elements = Elements {
            reflectance: (0..n).map(|i| Rgb::splat(wave(i, 0.37))).collect(),
            emittance: (0..n).map(|i| Rgb::splat(wave(i, 0.11))).collect(),
            direct: vec![Rgb::ZERO; n],
        };
        let settings = SolveSettings { convergence: 1e-6, ..SolveSettings::for_error(0.02) };
        let s = solve::solve(exchange, &elements, survey, &settings, &Silent).expect("nobody cancels");
        let area = |i: usize| exchange.hierarchy.nodes[exchange.hierarchy.elements[i].node as usize].area as f64;
        let emitted: f64 = (0..n).map(|i| area(i) * elements.emittance[i].x as f64).sum();
        let absorbed: f64 =
            (0..n).map(|i| area(i) * ((1.0 - elements.reflectance[i].x) * s.irradiance[i].x) as f64).sum();
        assert!((absorbed / emitted - 1.0).abs() < 1e-3, "absorbed {absorbed}, emitted {emitted}");
    });
}

#[test]
fn pull_keeps_power_and_transfer_keeps_constants() {
    with_system(&cube([grey(0.0, 0.5); 6]), |exchange, survey| {
        let tree = exchange.hierarchy;
        let values: Vec<Rgb> = (0..tree.elements.len()).map(|i| Rgb::splat((i % 7) as f32)).collect();
        let nodes = solve::pull(tree, &values);
        let power: f64 =
            tree.elements.iter().zip(&values).map(|(e, v)| tree.nodes[e.node as usize].area as f64 * v.x as f64).sum();
        let root = nodes[0].x as f64 * tree.nodes[0].area as f64;
        assert!((root / power - 1.0).abs() < 1e-5, "root {root}, elements {power}");
        assert!(solve::pull(tree, &vec![Rgb::ONE; values.len()]).iter().all(|v| (v.x - 1.0).abs() < 1e-5));

        let elements = Elements {
            reflectance: vec![Rgb::ZERO; values.len()],
            emittance: vec![Rgb::ONE; values.len()],
            direct: vec![Rgb::ZERO; values.len()],
        };
        let s = solve::solve(exchange, &elements, survey, &SolveSettings::for_error(0.02), &Silent)
            .expect("nobody cancels");
        assert!(s.irradiance.iter().all(|e| (e.x - 1.0).abs() < 5e-3));
    });
}
