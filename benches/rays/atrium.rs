//! The scene that rays are timed in: a two-storey colonnade with arches, drapes, railings and finely displaced busts.
//! About 430,000 triangles of very unequal size, in metres.

use glam::{Affine3A, Vec3};
use lightkiln::scene::{Instance, LightmapRequest, Material, Mesh, Primitive, Scene};
use std::f32::consts::{PI, TAU};

/// Length and width of the hall, and height of a storey.
pub(crate) const SIZE: Vec3 = Vec3::new(30.0, 5.0, 12.0);

/// Builds the scene; `detail` multiplies the number of triangles by about its square.
pub(crate) fn atrium(detail: f32) -> Scene {
    let n = |x: f32| (x * detail).ceil().max(2.0) as u32;
    let mut m = Mesh::default();
    for storey in 0..2 {
        let floor = storey as f32 * SIZE.y;
        for i in 0..12 {
            for side in [-1.0, 1.0] {
                let foot = Vec3::new((i as f32 - 5.5) * SIZE.x / 12.0, floor, side * SIZE.z * 0.3);
                column(&mut m, foot, n(40.0), n(20.0));
                arch(&mut m, foot + Vec3::Y * 3.6, SIZE.x / 12.0, n(24.0));
                railing(&mut m, foot + Vec3::Y * 0.1, SIZE.x / 12.0);
            }
        }
        drapes(&mut m, floor, n(90.0), n(40.0));
    }
    for i in 0..6 {
        bust(&mut m, Vec3::new((i as f32 - 2.5) * 4.5, 1.2, (i % 2) as f32 * 3.0 - 1.5), i as f32, n(80.0));
    }
    hall(&mut m, n(12.0));
    finish(m)
}

fn finish(mut m: Mesh) -> Scene {
    m.name = "atrium".into();
    m.normals = vec![Vec3::Y; m.positions.len()];
    m.primitives = vec![Primitive {
        source: 0,
        vertices: 0..m.positions.len() as u32,
        triangles: 0..m.triangles.len() as u32,
        material: 0,
    }];
    let instance = Instance {
        path: "atrium".into(),
        node: 0,
        mesh: 0,
        transform: Affine3A::IDENTITY,
        casts_shadows: true,
        lightmap: LightmapRequest::None,
        group: None,
        gpu_instance: None,
    };
    Scene { meshes: vec![m], instances: vec![instance], materials: vec![Material::default()], ..Default::default() }
}

/// A grid of quads over (u, v) in the unit square.
fn sheet(m: &mut Mesh, columns: u32, rows: u32, at: impl Fn(f32, f32) -> Vec3) {
    let first = m.positions.len() as u32;
    for j in 0..=rows {
        m.positions.extend((0..=columns).map(|i| at(i as f32 / columns as f32, j as f32 / rows as f32)));
    }
    let index = |i, j| first + j * (columns + 1) + i;
    for (i, j) in (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))) {
        let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i, j + 1), index(i + 1, j + 1)];
        m.triangles.extend([[a, b, c], [b, d, c]]);
    }
}

/// A fluted column with a base and a capital.
fn column(m: &mut Mesh, foot: Vec3, around: u32, up: u32) {
    sheet(m, around * 2, up, |u, v| {
        let flutes = 0.02 * (u * TAU * 16.0).cos().abs();
        let ends = 0.12 * ((v - 0.5).abs() * 2.0).powi(12);
        let radius = 0.28 - 0.05 * v + ends - flutes;
        foot + Vec3::new(radius * (u * TAU).cos(), 3.6 * v, radius * (u * TAU).sin())
    });
}

/// Half a ring from this column to the next.
fn arch(m: &mut Mesh, foot: Vec3, span: f32, along: u32) {
    sheet(m, along, 16, |u, v| {
        let radius = span / 2.0 + 0.2 * (v * TAU).cos();
        let along = Vec3::new(-(u * PI).cos() * radius, (u * PI).sin() * radius * 0.9, 0.0);
        foot + Vec3::new(span / 2.0, 0.0, 0.25 * (v * TAU).sin()) + along
    });
}

/// Thin bars, whose triangles are long and narrow, partly askew.
fn railing(m: &mut Mesh, foot: Vec3, span: f32) {
    for bar in 0..14 {
        let x = span * bar as f32 / 14.0;
        let lean = if bar % 2 == 0 { 0.3 } else { -0.3 };
        sheet(m, 6, 1, |u, v| foot + Vec3::new(x + v * lean + 0.02 * (u * TAU).cos(), v, 0.02 * (u * TAU).sin()));
    }
    sheet(m, 6, 1, |u, v| foot + Vec3::new(span * v, 1.0 + 0.04 * (u * TAU).cos(), 0.04 * (u * TAU).sin()));
}

/// Cloth between the columns.
fn drapes(m: &mut Mesh, floor: f32, columns: u32, rows: u32) {
    for i in 0..5 {
        let x = (i as f32 - 2.0) * 5.0;
        sheet(m, columns, rows, |u, v| {
            let wave = 0.25 * (u * 25.0 + 3.0 * v).sin() * v + 0.1 * (u * 61.0).sin() * v;
            Vec3::new(x + 3.0 * (u - 0.5), floor + 3.8 - 2.2 * v, 2.6 + wave)
        });
    }
}

/// A sphere with bumps upon bumps.
fn bust(m: &mut Mesh, centre: Vec3, seed: f32, bands: u32) {
    sheet(m, bands * 2, bands, |u, v| {
        let d = Vec3::new((v * PI).sin() * (u * TAU).cos(), (v * PI).cos(), (v * PI).sin() * (u * TAU).sin());
        let bump = |f: f32| (d.x * f + seed).sin() * (d.y * f * 1.3 + seed).sin() * (d.z * f * 0.7).cos();
        centre + d * (0.8 + 0.2 * bump(4.0) + 0.06 * bump(13.0) + 0.02 * bump(41.0))
    });
}

/// Floors, walls, galleries and the roof beams: few large triangles.
fn hall(m: &mut Mesh, parts: u32) {
    let Vec3 { x, y, z } = SIZE;
    let span = |a: Vec3, b: Vec3, c: Vec3| move |u: f32, v: f32| a + (b - a) * u + (c - a) * v;
    let corner = |sx: f32, h: f32, sz: f32| Vec3::new(sx * x / 2.0, h, sz * z / 2.0);
    sheet(m, parts * 4, parts * 2, span(corner(-1.0, 0.0, -1.0), corner(-1.0, 0.0, 1.0), corner(1.0, 0.0, -1.0)));
    for side in [-1.0, 1.0] {
        sheet(m, 8, 4, span(corner(-1.0, 0.0, side), corner(1.0, 0.0, side), corner(-1.0, 2.0 * y, side)));
        sheet(m, 4, 4, span(corner(side, 0.0, -1.0), corner(side, 0.0, 1.0), corner(side, 2.0 * y, -1.0)));
        sheet(m, 8, 2, span(corner(-1.0, y, side), corner(1.0, y, side), corner(-1.0, y, side * 0.55)));
    }
    for beam in 0..20 {
        let along = (beam as f32 / 19.0 - 0.5) * x;
        let from = Vec3::new(along, 2.0 * y, -z / 2.0);
        sheet(m, 1, 1, span(from, from + Vec3::new(0.3, 0.0, 0.0), from + Vec3::new(0.0, 0.0, z)));
        sheet(m, 1, 1, span(from, from - Vec3::new(0.0, 0.4, 0.0), from + Vec3::new(0.0, 0.0, z)));
    }
}
