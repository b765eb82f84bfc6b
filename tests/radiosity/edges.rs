//! Lamps and emissive planes that a half-plane hides in part: what is left against the closed form of the visible part.

use super::grey;
use super::rooms::{Room, add, baked};
use glam::{DVec3, Vec3};
use lightkiln::scene::{Light, LightShape, LightmapRequest, Rgb, Scene};
use std::f32::consts::PI;

/// Texels of the floor per metre.
const DENSITY: f32 = 16.0;
/// Points along a texel's side at which an expected value is averaged.
const PARTS: usize = 8;
/// Where the half-plane begins that hides what lies beyond it, metres along x.
const EDGE: f64 = 0.1;

/// A source over the floor: the square of ±`half` at `height`, hidden in part by the half-plane at `screen`, metres.
#[derive(Clone, Copy, Debug)]
struct Place {
    half: f64,
    height: f64,
    screen: f64,
}

/// How far texels are off, over the most that arrives unblocked.
#[derive(Debug)]
struct Miss {
    largest: f64,
    rms: f64,
    mean: f64,
}

/// Form factor from a point to a rectangle in a parallel plane, `height` above, with a corner right above the point and
/// another at the offset `a`, `b`; odd in both.
fn corner_factor(a: f64, b: f64, height: f64) -> f64 {
    let (a, b) = (a / height, b / height);
    let (p, q) = (a.hypot(1.0), b.hypot(1.0));
    (a / p * (b / p).atan() + b / q * (a / q).atan()) / (2.0 * std::f64::consts::PI)
}

impl Place {
    /// A floor below, and the screen. What is not asked for gets no texels.
    fn scene(&self, half_floor: f32) -> Scene {
        let mut room = Room::default();
        let low = Vec3::new(-half_floor, 0.0, -half_floor);
        room.quad(low, Vec3::Z * 2.0 * half_floor, Vec3::X * 2.0 * half_floor, grey(0.0, 0.0));
        let mut scene = room.scene();
        let mut screen = Room::default();
        let low = Vec3::new(EDGE as f32, self.screen as f32, -20.0);
        screen.quad(low, Vec3::X * 20.0, Vec3::Z * 40.0, grey(0.0, 0.0));
        add(&mut scene, screen.scene(), true);
        scene
    }

    /// Irradiance from unit radiance.
    fn irradiance(&self, p: DVec3) -> f64 {
        // The screen's shadow on the plane of the source.
        let seen = (p.x + (EDGE - p.x) * self.height / self.screen).clamp(-self.half, self.half);
        let at = |x: f64, z: f64| corner_factor(x - p.x, z - p.z, self.height);
        let (low, high) = (-self.half, self.half);
        std::f64::consts::PI * (at(seen, high) - at(low, high) - at(seen, low) + at(low, low))
    }

    /// Bakes the scene: the texels of the floor miss what is expected by less than `allowed`.
    fn check(&self, scene: Scene, error: f32, allowed: Miss) {
        let miss = self.miss(scene, error);
        let holds = miss.largest < allowed.largest && miss.rms < allowed.rms && miss.mean.abs() < allowed.mean;
        assert!(holds, "{self:?} at {error}: {miss:?}, allowed {allowed:?}");
    }

    /// Bakes the scene and compares the texels of the floor.
    fn miss(&self, mut scene: Scene, error: f32) -> Miss {
        scene.instances.iter_mut().skip(1).for_each(|i| i.lightmap = LightmapRequest::None);
        let b = baked(&scene, DENSITY, error);
        let place = |i: usize| ((i as f64 + 0.5) / PARTS as f64 - 0.5) / f64::from(DENSITY);
        let expected = |p: DVec3| {
            let around = (0..PARTS * PARTS).map(|i| p + DVec3::new(place(i % PARTS), 0.0, place(i / PARTS)));
            around.map(|p| self.irradiance(p)).sum::<f64>() / (PARTS * PARTS) as f64
        };
        let floor: Vec<usize> = (0..b.texels.len()).filter(|&i| b.texels.coverage[i] > 0.99).collect();
        assert!(floor.len() > 200, "{} texels", floor.len());
        let want: Vec<f64> = floor.iter().map(|&i| expected(b.texels.position[i].as_dvec3())).collect();
        let most = want.iter().copied().fold(0.0, f64::max);
        let miss = |(&i, want): (&usize, &f64)| (f64::from(b.light.direct[i].x) - want) / most;
        let misses: Vec<f64> = floor.iter().zip(&want).map(miss).collect();
        let count = misses.len() as f64;
        Miss {
            largest: misses.iter().map(|m| m.abs()).fold(0.0, f64::max),
            rms: (misses.iter().map(|m| m * m).sum::<f64>() / count).sqrt(),
            mean: misses.iter().sum::<f64>() / count,
        }
    }
}

/// The square of unit radiance as a mesh of `parts` × `parts` quads.
fn panel(place: Place, parts: usize) -> Scene {
    let step = (2.0 * place.half) as f32 / parts as f32;
    let corner = |i: usize, j: usize| {
        Vec3::new(i as f32 * step - place.half as f32, place.height as f32, j as f32 * step - place.half as f32)
    };
    let quads = (0..parts * parts).map(|k| (k % parts, k / parts));
    let triangles: Vec<[Vec3; 3]> = quads
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let mut room = Room::default();
    room.face(&triangles, grey(1.0, 0.0));
    room.scene()
}

/// The square of unit radiance as a lamp.
fn lamp(place: Place) -> Light {
    let size = [2.0 * place.half as f32; 2];
    Light {
        name: "Lamp".into(),
        path: "Lamp".into(),
        group: None,
        casts_shadows: true,
        position: Vec3::Y * place.height as f32,
        // Shines straight down.
        axes: [Vec3::X, Vec3::NEG_Z, Vec3::Y],
        shape: LightShape::Rect { radiance: Rgb::ONE, size, spread: PI },
        profile: None,
        faces_receivers: false,
    }
}

#[test]
fn near_emissive_planes_shine_as_much_as_is_seen_of_them() {
    let place = Place { half: 2.0, height: 0.5, screen: 0.2 };
    for parts in [1, 4, 12] {
        let mut scene = place.scene(0.75);
        add(&mut scene, panel(place, parts), true);
        // As a lamp each, bundles of triangles bring noise of their own.
        place.check(scene, 0.005, Miss { largest: 0.04, rms: 0.0075, mean: 0.001 });
    }
}

#[test]
fn near_area_lamps_shine_as_much_as_is_seen_of_them() {
    let place = Place { half: 2.0, height: 0.5, screen: 0.2 };
    let mut scene = place.scene(0.75);
    scene.lights.push(lamp(place));
    place.check(scene, 0.005, Miss { largest: 0.02, rms: 0.004, mean: 0.001 });
}

#[test]
fn penumbrae_end_where_the_lamp_is_wholly_seen_or_hidden() {
    for (half, screen) in [(0.25, 1.0), (0.5, 1.0), (0.1, 0.4)] {
        let place = Place { half, height: 2.0, screen };
        // Noise in penumbrae may reach twice the error.
        for (error, largest) in [(0.02, 0.038), (0.005, 0.012)] {
            let mut scene = place.scene(1.0);
            scene.lights.push(lamp(place));
            place.check(scene, error, Miss { largest, rms: f64::from(0.4 * error), mean: 0.001 });
        }
    }
}
