//! Seams and dilation on a plane that the atlas cuts in two.

use glam::{Affine3A, Vec2, Vec3};
use lightkiln::atlas::{Atlas, Chart, Layout, Page, PageImage, Texels, rasterise};
use lightkiln::post::{PostSettings, convert, finish};
use lightkiln::progress::{Cancelled, Progress, Silent, Stage};
use lightkiln::scene::{Instance, LightmapRequest, Material, Mesh, Primitive, Rgb, Scene};
use lightkiln::units::Quantity;

/// The square 0..2 × 0..1 in x and z, as two quads that share the edge x = 1. `fold` turns the normals of the second.
fn plane(fold: bool) -> Scene {
    let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
    let positions = vec![
        corner(0.0, 0.0),
        corner(0.0, 1.0),
        corner(1.0, 1.0),
        corner(1.0, 0.0),
        corner(1.0, 0.0),
        corner(1.0, 1.0),
        corner(2.0, 1.0),
        corner(2.0, 0.0),
    ];
    let second = if fold { Vec3::new(1.0, 1.0, 0.0).normalize() } else { Vec3::Y };
    let mesh = Mesh {
        name: "plane".into(),
        normals: [[Vec3::Y; 4], [second; 4]].concat(),
        source_vertices: (0..8).collect(),
        triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
        primitives: vec![Primitive { source: 0, vertices: 0..8, triangles: 0..4, material: 0 }],
        positions,
        ..Mesh::default()
    };
    let instance = Instance {
        path: "plane".into(),
        node: 0,
        mesh: 0,
        transform: Affine3A::IDENTITY,
        casts_shadows: true,
        lightmap: LightmapRequest::Default,
        group: None,
        gpu_instance: None,
    };
    Scene { meshes: vec![mesh], instances: vec![instance], materials: vec![Material::default()], ..Scene::default() }
}

/// The quads as charts of 9.4 texels across, at offsets that share no fraction, the second one turned by 90°.
fn cut(scene: &Scene) -> Atlas {
    const TEXELS: f32 = 9.4;
    let mesh = &scene.meshes[0];
    let place = |triangle: usize, vertex: u32| {
        let p = mesh.positions[vertex as usize];
        match triangle {
            0 | 1 => Vec2::new(4.3, 5.1) + Vec2::new(p.x, p.z) * TEXELS,
            _ => Vec2::new(20.7, 4.6) + Vec2::new(p.z, 2.0 - p.x) * TEXELS,
        }
    };
    let corners = mesh.triangles.iter().enumerate().map(|(t, vertices)| vertices.map(|v| place(t, v))).collect();
    let chart = |x, y| Chart { instance: 0, page: 0, x, y };
    Atlas {
        pages: vec![Page { width: 40, height: 24 }],
        charts: vec![chart(4..14, 5..15), chart(20..31, 4..14)],
        layouts: vec![Some(Layout { corners, charts: vec![0, 0, 1, 1] })],
        padding: 4,
        unwrapper: "keep",
    }
}

struct Case {
    scene: Scene,
    atlas: Atlas,
    texels: Texels,
}

impl Case {
    fn new(fold: bool) -> Self {
        let scene = plane(fold);
        let atlas = cut(&scene);
        let texels = rasterise(&scene, &atlas, &Silent).expect("nobody cancels");
        assert!(texels.charts.iter().all(|c| c.len() >= 100));
        Self { scene, atlas, texels }
    }

    fn finish(&self, value: impl Fn(Vec3) -> Rgb, seams: bool) -> PageImage {
        let values: Vec<Rgb> = self.texels.position.iter().map(|&p| value(p)).collect();
        self.finish_values(&values, seams)
    }

    fn finish_values(&self, values: &[Rgb], seams: bool) -> PageImage {
        let settings = PostSettings { seams, ..PostSettings::default() };
        let pages = finish(&self.atlas, &self.texels, &self.scene, values, &settings, &Silent);
        pages.expect("nobody cancels").remove(0)
    }

    /// Root mean square difference across the edge x = 1.
    fn mismatch(&self, page: &PageImage) -> f32 {
        let layout = self.atlas.layouts[0].as_ref().expect("the plane has a layout");
        let ends = [[layout.corners[1][2], layout.corners[0][2]], [layout.corners[2][0], layout.corners[2][1]]];
        let count = 100;
        let sum: f32 = (0..count)
            .map(|i| {
                let t = (i as f32 + 0.5) / count as f32;
                let [a, b] = ends.map(|[p, q]| bilinear(page, p.lerp(q, t)));
                (a - b).length_squared()
            })
            .sum();
        (sum / count as f32).sqrt()
    }
}

fn bilinear(page: &PageImage, position: Vec2) -> Rgb {
    let p = position - 0.5;
    let f = p - p.floor();
    let at = |dx: u32, dy: u32| page.rgb[((p.y as u32 + dy) * page.width + p.x as u32 + dx) as usize];
    at(0, 0).lerp(at(1, 0), f.x).lerp(at(0, 1).lerp(at(1, 1), f.x), f.y)
}

fn gradient(p: Vec3) -> Rgb {
    Rgb::new(1.0 + p.x, 2.0 - 0.5 * p.x + p.z, (3.0 * p.x).sin() + 1.5)
}

#[test]
fn lookups_agree_across_a_mended_seam() {
    let case = Case::new(false);
    let before = case.mismatch(&case.finish(gradient, false));
    let after = case.mismatch(&case.finish(gradient, true));
    assert!(before > 0.01, "the cut shows without mending: {before}");
    assert!(after < 0.1 * before, "{after} after, {before} before");
}

#[test]
fn mending_keeps_close_to_what_was_baked() {
    let case = Case::new(false);
    let (raw, mended) = (case.finish(gradient, false), case.finish(gradient, true));
    for (i, (a, b)) in raw.rgb.iter().zip(&mended.rgb).enumerate() {
        if raw.valid[i] {
            // A texel spans 0.106 m, over which no channel changes by more than 0.32.
            assert!((*a - *b).abs().max_element() < 0.16, "texel {i}: {a} became {b}");
        }
    }
}

#[test]
fn creases_stay_as_they_are() {
    let case = Case::new(true);
    assert_eq!(case.finish(gradient, true), case.finish(gradient, false));
}

#[test]
fn light_that_jumps_at_the_edge_does_not_bleed() {
    let case = Case::new(false);
    // A wall on the edge: one side lit, the other dark.
    let lit = |chart: u32| if chart == 0 { Rgb::splat(10.0) } else { Rgb::splat(1e-5) };
    let values: Vec<Rgb> = case.texels.chart.iter().map(|&c| lit(c)).collect();
    let page = case.finish_values(&values, true);
    let texels = &case.texels.pages[0].texel;
    for (i, value) in page.rgb.iter().enumerate().filter(|(i, _)| page.valid[*i]) {
        assert_eq!(*value, lit(case.texels.chart[texels[i] as usize]), "texel {i}");
    }
}

#[test]
fn constants_stay_constant_and_reach_past_the_padding() {
    let case = Case::new(false);
    let constant = Rgb::new(0.3, 1.7, 11.0);
    let page = case.finish(|_| constant, true);
    let padding = case.atlas.padding.max(4) as i64;
    let (width, height) = (i64::from(page.width), i64::from(page.height));
    let near_chart = |x: i64, y: i64| {
        let around = (y - padding..=y + padding).flat_map(|y| (x - padding..=x + padding).map(move |x| (x, y)));
        around
            .filter(|&(x, y)| x >= 0 && y >= 0 && x < width && y < height)
            .any(|(x, y)| page.valid[(y * width + x) as usize])
    };
    for (i, value) in page.rgb.iter().enumerate() {
        let (x, y) = (i as i64 % width, i as i64 / width);
        if near_chart(x, y) {
            assert!((*value - constant).abs().max_element() < 1e-5, "texel {x}, {y}: {value}");
        }
        assert!(value.is_finite());
    }
}

#[test]
fn quantities_differ_by_pi_and_reflectance() {
    let mut case = Case::new(false);
    case.texels.reflectance.fill(Rgb::new(0.25, 0.5, 0.75));
    let irradiance = vec![case.finish(|_| Rgb::ONE, true)];
    let settings = PostSettings::default();
    let first_valid = irradiance[0].valid.iter().position(|&v| v).expect("charts cover something");
    let check = |quantity, expected: Rgb| {
        let pages = convert(&irradiance, &case.atlas, &case.texels, quantity, &settings);
        assert!((pages[0].rgb[first_valid] - expected).abs().max_element() < 1e-6, "{quantity:?}");
        assert_eq!(pages[0].valid, irradiance[0].valid);
    };
    check(Quantity::Irradiance, Rgb::ONE);
    check(Quantity::Radiance, Rgb::splat(std::f32::consts::FRAC_1_PI));
    check(Quantity::Radiosity, Rgb::new(0.25, 0.5, 0.75));
}

struct Stopped;

impl Progress for Stopped {
    fn report(&self, _: Stage, _: f64) {}
    fn is_cancelled(&self) -> bool {
        true
    }
}

#[test]
fn cancelling_ends_it() {
    let case = Case::new(false);
    let values = vec![Rgb::ONE; case.texels.len()];
    let result = finish(&case.atlas, &case.texels, &case.scene, &values, &PostSettings::default(), &Stopped);
    assert_eq!(result, Err(Cancelled));
}
