//! The atlas and its texels: invariants that hold for any scene, and what is said about bad texture coordinates.

use glam::{Affine3A, Mat3, Quat, Vec2, Vec3};
use lightkiln::atlas::{Atlas, AtlasError, AtlasSettings, NO_TEXEL, Texels, Unwrapper, UvMode, build, rasterise};
use lightkiln::progress::{Cancelled, Progress, Silent, Stage};
use lightkiln::scene::{Instance, LightmapRequest, Material, Mesh, Primitive, Scene};
use lightkiln::warning::Warning;

/// A mesh of one material with flat normals; every triangle has vertices of its own.
fn mesh(triangles: &[[Vec3; 3]], uv: impl Fn(usize, usize) -> Vec2) -> Mesh {
    let mut mesh = Mesh { name: "mesh".into(), texcoords: vec![Vec::new(), Vec::new()], ..Mesh::default() };
    for (t, corners) in triangles.iter().enumerate() {
        let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        let first = mesh.positions.len() as u32;
        for (k, &p) in corners.iter().enumerate() {
            mesh.positions.push(p);
            mesh.normals.push(n);
            mesh.texcoords[1].push(uv(t, k));
        }
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    let (vertices, triangles) = (0..mesh.positions.len() as u32, 0..mesh.triangles.len() as u32);
    mesh.primitives.push(Primitive { source: 0, vertices, triangles, material: 0 });
    mesh
}

/// A 1 × 1 m quad in XY facing +Z whose TEXCOORD_1 spans `low` to `high`, v down.
fn quad(low: Vec2, high: Vec2) -> Mesh {
    let corner = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
    let index = [[0, 1, 2], [0, 2, 3]];
    mesh(&index.map(|t| t.map(|i| corner[i])), |t, k| {
        let p = corner[index[t][k]];
        low + (high - low) * Vec2::new(p.x, 1.0 - p.y)
    })
}

/// A scene of meshes, each placed by the transforms that come with it.
fn scene(placed: Vec<(Mesh, Vec<Affine3A>)>) -> Scene {
    let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
    for (mesh, transforms) in placed {
        for transform in transforms {
            scene.instances.push(Instance {
                path: format!("node{}", scene.instances.len()),
                node: scene.instances.len(),
                mesh: scene.meshes.len(),
                transform,
                casts_shadows: true,
                lightmap: LightmapRequest::Default,
                group: None,
            });
        }
        scene.meshes.push(mesh);
    }
    scene
}

fn keep(resolution: u32) -> AtlasSettings {
    AtlasSettings { uv: UvMode::Keep, resolution: Some(resolution), ..AtlasSettings::default() }
}

/// Atlas, warnings and texels; what holds for every scene is checked on the way.
fn bake(scene: &Scene, settings: &AtlasSettings) -> (Atlas, Vec<Warning>, Texels) {
    let (atlas, warnings) = build(scene, settings, &Silent).expect("the scene can be laid out");
    let texels = rasterise(scene, &atlas, &Silent).expect("nobody cancels");
    check_invariants(scene, &atlas, &texels);
    (atlas, warnings, texels)
}

fn check_invariants(scene: &Scene, atlas: &Atlas, texels: &Texels) {
    let n = texels.len();
    assert_eq!(texels.first_triangle.len(), n + 1);
    assert_eq!(texels.charts.len(), atlas.charts.len());
    assert!(atlas.charts.is_sorted_by_key(|c| (c.page, c.instance)), "charts are ordered by page, then instance");
    let mut next = 0;
    for (c, range) in texels.charts.iter().enumerate() {
        assert_eq!(range.start, next, "charts follow each other");
        next = range.end;
        let codes: Vec<u64> = range.clone().map(|t| morton(texels.pixel[t as usize])).collect();
        assert!(codes.is_sorted(), "texels of a chart are in Morton order");
        assert!(range.clone().all(|t| texels.chart[t as usize] == c as u32));
    }
    assert_eq!(next as usize, n);
    for t in 0..n {
        let [x, y] = texels.pixel[t];
        let chart = &atlas.charts[texels.chart[t] as usize];
        assert!(chart.x.contains(&u32::from(x)) && chart.y.contains(&u32::from(y)), "a texel lies in its chart");
        let at = Vec2::new(f32::from(x), f32::from(y)) + 0.5;
        assert_eq!(texels.pages[chart.page].at(at), Some(t as u32));
        assert!(texels.coverage[t] > 0.0 && texels.coverage[t] <= 1.0);
        assert!(texels.area[t] > 0.0 && texels.area[t].is_finite());
        assert!((texels.geometric_normal[t].length() - 1.0).abs() < 1e-4);
        assert!((texels.shading_normal[t].length() - 1.0).abs() < 1e-4);
        assert!(texels.shading_normal[t].dot(texels.geometric_normal[t]) > 0.0);
        let surface = texels
            .triangles_of(t as u32)
            .iter()
            .map(|&k| distance(texels.position[t], scene.corners(chart.instance, k as usize)))
            .fold(f32::INFINITY, f32::min);
        let scale = 1.0 + texels.position[t].abs().max_element();
        assert!(surface <= 1e-5 * scale, "texel {t} lies {surface} m off its triangles");
    }
    let claimed: usize = texels.pages.iter().map(|p| p.texel.iter().filter(|&&t| t != NO_TEXEL).count()).sum();
    assert_eq!(claimed, n);
}

fn morton([x, y]: [u16; 2]) -> u64 {
    (0..16).map(|b| (u64::from(x >> b & 1) << (2 * b)) | (u64::from(y >> b & 1) << (2 * b + 1))).sum()
}

/// Distance of a point from a triangle, by descent over its barycentrics' clamped projection and its three sides.
fn distance(p: Vec3, [a, b, c]: [Vec3; 3]) -> f32 {
    let (u, v) = (b - a, c - a);
    let n = u.cross(v);
    let w = p - a;
    let (s, t) = (w.cross(v).dot(n) / n.length_squared(), u.cross(w).dot(n) / n.length_squared());
    if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
        return w.dot(n.normalize()).abs();
    }
    let to_side = |a: Vec3, b: Vec3| {
        let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        p.distance(a + (b - a) * along)
    };
    to_side(a, b).min(to_side(b, c)).min(to_side(c, a))
}

/// World area of the triangles that have a lightmap.
fn world_area(scene: &Scene) -> f64 {
    let area = |i: usize| {
        (0..scene.meshes[scene.instances[i].mesh].triangles.len())
            .map(|t| {
                let [a, b, c] = scene.corners(i, t);
                f64::from((b - a).cross(c - a).length()) / 2.0
            })
            .sum::<f64>()
    };
    (0..scene.instances.len()).filter(|&i| scene.instances[i].lightmap != LightmapRequest::None).map(area).sum()
}

fn total_area(texels: &Texels) -> f64 {
    texels.area.iter().map(|&a| f64::from(a)).sum()
}

fn close(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * b.abs(), "{a} is not {b}");
}

fn codes(warnings: &[Warning]) -> Vec<&'static str> {
    warnings.iter().map(|w| w.code).collect()
}

#[test]
fn a_quad_on_whole_texels_covers_exactly_those() {
    // 3/32 … 21/32 of 32 texels are whole numbers; a third of 96 is one up to rounding.
    for (low, high, side, texels_across) in
        [(3.0 / 32.0, 21.0 / 32.0, 32, 18), (1.0 / 3.0, 2.0 / 3.0, 96, 32), (0.1, 0.7, 1000, 600)]
    {
        let (atlas, warnings, texels) =
            bake(&scene(vec![(quad(Vec2::splat(low), Vec2::splat(high)), vec![Affine3A::IDENTITY])]), &keep(side));
        assert_eq!(warnings, []);
        assert_eq!((atlas.pages.len(), atlas.charts.len()), (1, 1));
        assert_eq!(texels.len(), texels_across * texels_across);
        assert!(texels.coverage.iter().all(|&c| (c - 1.0).abs() < 1e-5));
        close(total_area(&texels), 1.0, 1e-4);
    }
}

#[test]
fn texel_centres_lie_where_the_coordinates_say() {
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY])]);
    let (_, _, texels) = bake(&s, &keep(4));
    let t = texels.pages[0].at(Vec2::new(1.5, 0.5)).expect("the page is full") as usize;
    assert!(texels.position[t].distance(Vec3::new(0.375, 0.875, 0.0)) < 1e-6);
    assert_eq!(texels.geometric_normal[t], Vec3::Z);
    close(f64::from(texels.area[t]), 1.0 / 16.0, 1e-6);
}

#[test]
fn area_is_conserved_for_any_placement() {
    let place = [
        Affine3A::IDENTITY,
        Affine3A::from_scale(Vec3::new(3.0, 0.5, 2.0)),
        Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)),
        Affine3A::from_scale_rotation_translation(
            Vec3::new(100.0, -80.0, 3.0),
            Quat::from_rotation_x(0.7),
            Vec3::new(50.0, -20.0, 7.0),
        ),
        Affine3A::from_mat3(Mat3::from_cols(Vec3::X, Vec3::new(0.7, 1.0, 0.0), Vec3::Z)),
    ];
    for transform in place {
        // Neither on whole texels nor along the axes.
        let corners = [Vec2::new(0.113, 0.271), Vec2::new(0.871, 0.159), Vec2::new(0.613, 0.933)];
        let triangle = [Vec3::ZERO, Vec3::new(2.0, 0.1, 0.3), Vec3::new(0.4, 1.7, -0.2)];
        let s = scene(vec![(mesh(&[triangle], |_, k| corners[k]), vec![transform])]);
        let (_, _, texels) = bake(&s, &keep(64));
        close(total_area(&texels), world_area(&s), 1e-3);
    }
}

#[test]
fn a_mirrored_instance_keeps_its_front() {
    let mirror = Affine3A::from_scale(Vec3::new(1.0, 1.0, -1.0));
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![mirror])]);
    let (_, _, texels) = bake(&s, &keep(8));
    assert!(texels.geometric_normal.iter().all(|n| n.distance(-Vec3::Z) < 1e-6));
    assert!(texels.shading_normal.iter().all(|n| n.distance(-Vec3::Z) < 1e-6));
}

#[test]
fn shading_normals_turn_to_the_front() {
    let mut upside_down = quad(Vec2::ZERO, Vec2::ONE);
    upside_down.normals.iter_mut().for_each(|n| *n = Vec3::new(0.6, 0.0, -0.8));
    let (_, _, texels) = bake(&scene(vec![(upside_down, vec![Affine3A::IDENTITY])]), &keep(8));
    assert!(texels.shading_normal.iter().all(|n| n.distance(Vec3::new(-0.6, 0.0, 0.8)) < 1e-5));
}

#[test]
fn samples_lie_in_their_texel_and_cover_what_the_chart_covers() {
    let corners = [Vec2::new(0.05, 0.1), Vec2::new(0.95, 0.2), Vec2::new(0.3, 0.9)];
    let triangle = [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 0.0, -3.0)];
    let s = scene(vec![(mesh(&[triangle], |_, k| corners[k]), vec![Affine3A::from_rotation_z(0.3)])]);
    let (atlas, _, texels) = bake(&s, &keep(16));
    const GRID: usize = 40;
    for t in 0..texels.len() as u32 {
        let mut hits = 0;
        for i in 0..GRID * GRID {
            let offset = (Vec2::new((i % GRID) as f32, (i / GRID) as f32) + 0.5) / GRID as f32;
            let Some(point) = texels.sample(&s, &atlas, t, offset) else { continue };
            hits += 1;
            assert!(distance(point.position, s.corners(0, 0)) < 1e-5);
            // Back through the triangle's barycentrics to the page.
            let [a, b, c] = s.corners(0, 0);
            let n = (b - a).cross(c - a);
            let w = point.position - a;
            let b = Vec2::new(w.cross(c - a).dot(n), (b - a).cross(w).dot(n)) / n.length_squared();
            let (page, at) = atlas.locate(0, 0, b).expect("the instance is laid out");
            let [x, y] = texels.pixel[t as usize];
            assert_eq!(page, 0);
            assert!(at.distance(Vec2::new(f32::from(x), f32::from(y)) + offset) < 2e-3);
        }
        let share = hits as f32 / (GRID * GRID) as f32;
        assert!((share - texels.coverage[t as usize]).abs() < 0.04, "{share} of texel {t} was hit");
    }
}

#[test]
fn a_chart_below_a_texel_keeps_one() {
    for size in [0.3, 1e-3, 1e-5] {
        let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let uv = [Vec2::ZERO, Vec2::X, Vec2::Y].map(|c| Vec2::splat(0.535) + c * size / 64.0);
        let s = scene(vec![(mesh(&[triangle], |_, k| uv[k]), vec![Affine3A::IDENTITY])]);
        assert_eq!(bake(&s, &keep(64)).2.len(), 1, "a chart of {size} texels");
    }
}

#[test]
fn repeats_are_identical_on_any_number_of_threads() {
    let place = (0..5).map(|i| Affine3A::from_translation(Vec3::X * i as f32)).collect();
    let s = scene(vec![(quad(Vec2::splat(0.13), Vec2::splat(0.77)), place)]);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        pool.install(|| bake(&s, &keep(50)))
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn emission_is_there_only_if_something_emits() {
    let mut s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY])]);
    let (_, _, texels) = bake(&s, &keep(8));
    assert!(texels.emission.is_empty());
    assert!(texels.reflectance.iter().all(|r| r.distance(Vec3::splat(0.98)) < 1e-5), "white is capped");
    s.materials[0].emission = Vec3::new(1.0, 2.0, 3.0);
    let (_, _, texels) = bake(&s, &keep(8));
    assert_eq!(texels.emission.len(), texels.len());
    assert!(texels.emission.iter().all(|e| e.distance(Vec3::new(1.0, 2.0, 3.0)) < 1e-5));
}

/// A unit cube around the origin with one square of TEXCOORD_1 for all six sides.
fn cube() -> Mesh {
    let sides = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z];
    let mut triangles = Vec::new();
    for n in sides {
        let (u, v) = n.any_orthonormal_pair();
        let at = |x: f32, y: f32| (n + u * x + v * y) / 2.0;
        let corner = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
        triangles.push([corner[0], corner[1], corner[2]]);
        triangles.push([corner[0], corner[2], corner[3]]);
    }
    let square = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    mesh(&triangles, |t, k| square[[[0, 1, 2], [0, 2, 3]][t % 2][k]])
}

/// A unit sphere of `2 n²` quads, halved; its poles are degenerate triangles, as exporters leave them.
fn sphere(n: usize) -> Mesh {
    let at = |i: usize, j: usize| {
        let (a, b) = (i as f32 / n as f32 * std::f32::consts::PI, j as f32 / n as f32 * std::f32::consts::PI);
        Vec3::new(a.sin() * b.cos(), a.cos(), -a.sin() * b.sin())
    };
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..2 * n {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut sphere = mesh(&triangles, |_, _| Vec2::ZERO);
    sphere.normals = sphere.positions.clone();
    sphere
}

/// Cubes, a sphere, single triangles of all sizes and a quad, some stretched, mirrored, turned or large.
fn zoo() -> Scene {
    let turned = Affine3A::from_rotation_y(0.3);
    let triangle =
        |size: f32| mesh(&[[Vec3::ZERO, Vec3::X * size, Vec3::Y * size]], |_, k| [Vec2::ZERO, Vec2::X, Vec2::Y][k]);
    scene(vec![
        (cube(), vec![Affine3A::IDENTITY, turned, Affine3A::from_scale(Vec3::new(-4.0, 1.0, 0.5))]),
        (sphere(12), vec![turned, Affine3A::from_scale(Vec3::splat(0.2))]),
        (triangle(1.0), vec![turned]),
        (triangle(0.01), vec![turned]),
        (triangle(1e-4), vec![turned]),
        (mesh(&[], |_, _| Vec2::ZERO), vec![turned]),
        (quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::from_scale(Vec3::new(9.0, 0.02, 1.0))]),
    ])
}

fn auto(unwrapper: Unwrapper) -> AtlasSettings {
    AtlasSettings { unwrapper, ..AtlasSettings::default() }
}

/// Fails if charts lie upon each other or themselves, or are nearer than the padding.
fn check_apart(atlas: &Atlas, texels: &Texels) {
    let reach = atlas.padding as i64;
    for t in 0..texels.len() {
        let chart = texels.chart[t];
        let page = &texels.pages[atlas.charts[chart as usize].page];
        let [x, y] = texels.pixel[t].map(i64::from);
        for (dx, dy) in (-reach..=reach).flat_map(|dx| (-reach..=reach).map(move |dy| (dx, dy))) {
            if let Some(other) = page.at(Vec2::new((x + dx) as f32, (y + dy) as f32)) {
                assert_eq!(texels.chart[other as usize], chart, "charts keep their distance");
            }
        }
    }
    let mut flat = vec![0.0; atlas.charts.len()];
    for layout in atlas.layouts.iter().flatten() {
        for ([a, b, c], &chart) in layout.corners.iter().zip(&layout.charts) {
            flat[chart as usize] += f64::from((*b - *a).perp_dot(*c - *a).abs()) / 2.0;
        }
    }
    for (range, flat) in texels.charts.iter().zip(flat) {
        assert!(!range.is_empty(), "every chart has a texel");
        let covered: f64 = range.clone().map(|t| f64::from(texels.coverage[t as usize])).sum();
        assert!(covered > 0.99 * flat - 0.01, "a chart of {flat} texels covers only {covered}");
    }
}

#[test]
fn unwrapped_charts_are_apart_and_keep_their_area() {
    for unwrapper in [Unwrapper::Xatlas, Unwrapper::Fast] {
        for padding in [1, 2, 5] {
            let s = zoo();
            let (atlas, warnings, texels) = bake(&s, &AtlasSettings { padding, ..auto(unwrapper) });
            assert_eq!(warnings, []);
            check_apart(&atlas, &texels);
            close(total_area(&texels), world_area(&s), 1e-3);
            assert!(
                s.instances
                    .iter()
                    .zip(&atlas.layouts)
                    .all(|(i, l)| l.is_some() != s.meshes[i.mesh].triangles.is_empty())
            );
        }
    }
}

#[test]
fn density_is_per_metre_of_the_world() {
    for unwrapper in [Unwrapper::Xatlas, Unwrapper::Fast] {
        for scale in [Vec3::ONE, Vec3::new(5.0, 1.0, 1.0), Vec3::splat(3.0)] {
            let s = scene(vec![(cube(), vec![Affine3A::from_scale(scale)])]);
            let (_, _, texels) = bake(&s, &AtlasSettings { texels_per_metre: Some(20.0), ..auto(unwrapper) });
            assert_eq!(texels.len() as f64, 400.0 * world_area(&s).round(), "sides are whole texels");
            assert!(texels.area.iter().all(|&a| (a * 400.0 - 1.0).abs() < 1e-3));
        }
    }
}

#[test]
fn a_resolution_alone_is_filled_by_one_page() {
    for resolution in [64, 300] {
        let (atlas, warnings, texels) =
            bake(&zoo(), &AtlasSettings { resolution: Some(resolution), ..auto(Unwrapper::Fast) });
        assert_eq!((codes(&warnings), atlas.pages.len()), (vec![], 1));
        assert_eq!((atlas.pages[0].width, atlas.pages[0].height), (resolution, resolution));
        assert!(resolution < 100 || texels.len() as f64 > 0.5 * f64::from(resolution * resolution));
    }
}

#[test]
fn resolution_and_density_make_as_many_pages_as_needed() {
    let settings = AtlasSettings { resolution: Some(64), texels_per_metre: Some(32.0), ..auto(Unwrapper::Fast) };
    let s = scene(vec![(cube(), vec![Affine3A::IDENTITY; 4])]);
    let (atlas, warnings, texels) = bake(&s, &settings);
    assert_eq!(codes(&warnings), [""; 0]);
    assert!(atlas.pages.len() > 6 && atlas.pages.iter().all(|p| (p.width, p.height) == (64, 64)));
    check_apart(&atlas, &texels);
    assert_eq!(texels.len(), 4 * 6 * 32 * 32);
}

#[test]
fn requests_override_the_density() {
    let mut s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::from_scale(Vec3::splat(2.0)); 4])]);
    s.instances[1].lightmap = LightmapRequest::TexelsPerMetre(5.0);
    s.instances[2].lightmap = LightmapRequest::Resolution(7);
    s.instances[3].lightmap = LightmapRequest::None;
    let (atlas, _, texels) = bake(&s, &AtlasSettings { texels_per_metre: Some(10.0), ..auto(Unwrapper::Fast) });
    let sizes: Vec<usize> = texels.charts.iter().map(|c| c.len()).collect();
    assert_eq!(sizes, [400, 100, 49]);
    assert!(atlas.layouts[3].is_none());
}

#[test]
fn what_is_larger_than_a_page_shrinks_with_a_warning() {
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::from_scale(Vec3::splat(100.0))])]);
    let settings = AtlasSettings { max_page: 128, ..auto(Unwrapper::Fast) };
    let (atlas, warnings, _) = bake(&s, &settings);
    assert_eq!(codes(&warnings), ["chart_shrunk"]);
    assert!(warnings[0].place == "node0" && atlas.pages[0].width <= 128);
}

#[test]
fn an_absurd_scale_is_refused() {
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::from_scale(Vec3::splat(1e7))])]);
    for unwrapper in [Unwrapper::Xatlas, Unwrapper::Fast] {
        let error = build(&s, &auto(unwrapper), &Silent).expect_err("10¹⁶ texels are too many");
        assert!(error.to_string().contains("--texels-per-metre"), "{error}");
    }
    let tiny = scene(vec![(cube(), vec![Affine3A::from_scale(Vec3::splat(1e-7))])]);
    assert!(!bake(&tiny, &AtlasSettings::default()).2.is_empty());
}

#[test]
fn a_wide_range_of_scales_fits_one_page() {
    let place = vec![Affine3A::from_scale(Vec3::splat(1000.0)), Affine3A::from_scale(Vec3::splat(1e-3))];
    let (atlas, _, texels) =
        bake(&scene(vec![(cube(), place)]), &AtlasSettings { resolution: Some(128), ..auto(Unwrapper::Xatlas) });
    check_apart(&atlas, &texels);
}

#[test]
fn repeats_of_every_mode_are_identical() {
    let settings = [
        auto(Unwrapper::Xatlas),
        auto(Unwrapper::Fast),
        AtlasSettings { resolution: Some(256), ..auto(Unwrapper::Xatlas) },
        AtlasSettings { uv: UvMode::Pack, ..AtlasSettings::default() },
    ];
    for settings in settings {
        assert_eq!(bake(&zoo(), &settings), bake(&zoo(), &settings));
    }
}

#[test]
fn pack_keeps_islands_and_gives_every_instance_its_own() {
    // Two quads that lie upon each other in TEXCOORD_1, far from the density and the proportions of the world.
    let s = scene(vec![
        (quad(Vec2::splat(0.1), Vec2::new(0.2, 0.9)), vec![Affine3A::IDENTITY, Affine3A::from_scale(Vec3::splat(2.0))]),
        (quad(Vec2::splat(-7.0), Vec2::splat(3.0)), vec![Affine3A::IDENTITY]),
    ]);
    let settings = AtlasSettings { uv: UvMode::Pack, texels_per_metre: Some(10.0), ..AtlasSettings::default() };
    let (atlas, warnings, texels) = bake(&s, &settings);
    assert_eq!((codes(&warnings), atlas.unwrapper), (vec![], "pack"));
    check_apart(&atlas, &texels);
    assert_eq!(texels.charts.iter().map(|c| c.len()).collect::<Vec<_>>(), [100, 400, 100]);
}

#[test]
fn pack_takes_stacked_islands_apart() {
    let s = scene(vec![(cube(), vec![Affine3A::IDENTITY])]);
    let (atlas, _, texels) = bake(&s, &AtlasSettings { uv: UvMode::Pack, ..AtlasSettings::default() });
    assert_eq!(atlas.charts.len(), 6);
    check_apart(&atlas, &texels);
    close(total_area(&texels), 6.0, 1e-3);
}

#[test]
fn pack_falls_back_to_the_first_set_and_lays_flat_what_has_none() {
    let mut first = quad(Vec2::ZERO, Vec2::ONE);
    first.texcoords.swap(0, 1);
    // Every triangle of the sphere has one point of TEXCOORD_1 only.
    let s = scene(vec![(first, vec![Affine3A::IDENTITY]), (sphere(6), vec![Affine3A::IDENTITY])]);
    let settings = AtlasSettings { uv: UvMode::Pack, ..AtlasSettings::default() };
    let (atlas, warnings, texels) = bake(&s, &settings);
    assert_eq!(codes(&warnings), ["texcoord_scattered"]);
    check_apart(&atlas, &texels);
    close(total_area(&texels), world_area(&s), 1e-3);

    let mut bare = quad(Vec2::ZERO, Vec2::ONE);
    bare.texcoords.clear();
    let error = build(&scene(vec![(bare, vec![Affine3A::IDENTITY])]), &settings, &Silent);
    assert!(matches!(error, Err(AtlasError::MissingTexcoords { nodes, .. }) if nodes == ["node0"]));
}

#[test]
fn degenerate_geometry_is_survived() {
    let one = vec![Affine3A::IDENTITY];
    let mut needles: Vec<[Vec3; 3]> =
        (0..40).map(|i| [Vec3::ZERO, Vec3::X, Vec3::new(0.5, 10f32.powi(-i), 0.0)]).collect();
    // One edge with three sheets, and the same triangle from both sides.
    needles.extend([[Vec3::ZERO, Vec3::X, Vec3::Z], [Vec3::ZERO, Vec3::X, -Vec3::Z], [Vec3::X, Vec3::ZERO, Vec3::Z]]);
    let mut soup = mesh(&needles, |_, k| [Vec2::ZERO, Vec2::X, Vec2::Y][k]);
    soup.normals.iter_mut().for_each(|n| *n = n.normalize_or(Vec3::Y));
    let s = scene(vec![(soup, one)]);
    for settings in
        [auto(Unwrapper::Xatlas), auto(Unwrapper::Fast), AtlasSettings { uv: UvMode::Pack, ..AtlasSettings::default() }]
    {
        let (atlas, _, texels) = bake(&s, &settings);
        assert!(!texels.is_empty());
        check_apart(&atlas, &texels);
    }
}

#[test]
fn keep_names_the_nodes_without_coordinates() {
    let mut bare = quad(Vec2::ZERO, Vec2::ONE);
    bare.texcoords.clear();
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY]), (bare, vec![Affine3A::IDENTITY; 2])]);
    let error = build(&s, &keep(64), &Silent).expect_err("two nodes have no coordinates");
    assert!(matches!(&error, AtlasError::MissingTexcoords { nodes, .. } if nodes == &["node1", "node2"]));
    let text = error.to_string();
    assert!(text.contains("`node1`, `node2`") && text.contains("--uv auto"), "{text}");
}

#[test]
fn keep_warns_of_overlap_between_and_within_instances() {
    let one = Affine3A::IDENTITY;
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::splat(0.5)), vec![one, one])]);
    let (_, warnings, texels) = bake(&s, &keep(16));
    assert_eq!(codes(&warnings), ["texcoord_overlap"]);
    assert!(warnings[0].message.contains("64 texels") && warnings[0].message.contains("`node0`, `node1`"));
    assert_eq!(texels.charts, [0..64, 64..64], "the first chart keeps them");

    let folded = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let other = folded.map(|p| p + Vec3::Z);
    let s = scene(vec![(mesh(&[folded, other], |_, k| folded[k].truncate()), vec![one])]);
    let (_, warnings, _) = bake(&s, &keep(16));
    assert!(codes(&warnings).contains(&"texcoord_overlap"));
}

#[test]
fn keep_warns_of_charts_that_share_texels_at_their_border() {
    let one = vec![Affine3A::IDENTITY];
    let left = quad(Vec2::ZERO, Vec2::new(0.5, 1.0));
    let right = quad(Vec2::new(0.5, 0.0), Vec2::ONE);
    let s = scene(vec![(left, one.clone()), (right, one)]);
    assert_eq!(codes(&bake(&s, &keep(16)).1), [""; 0], "on whole texels nothing is shared");
    let (_, warnings, texels) = bake(&s, &keep(15));
    assert_eq!(codes(&warnings), ["texcoord_meeting"]);
    assert_eq!(texels.charts, [0..120, 120..225]);
}

#[test]
fn keep_warns_of_coordinates_outside_the_page_and_without_area() {
    let one = vec![Affine3A::IDENTITY];
    let s = scene(vec![(quad(Vec2::splat(0.5), Vec2::splat(1.5)), one.clone())]);
    let (_, warnings, texels) = bake(&s, &keep(16));
    assert_eq!(codes(&warnings), ["texcoord_outside"]);
    assert_eq!((warnings[0].place.as_str(), texels.len()), ("node0", 64));

    let s = scene(vec![(quad(Vec2::splat(f32::NAN), Vec2::splat(1e30)), one.clone())]);
    let (_, warnings, texels) = bake(&s, &keep(16));
    assert!(codes(&warnings).contains(&"texcoord_outside"));
    assert!(texels.is_empty());

    let s = scene(vec![(quad(Vec2::splat(0.5), Vec2::new(0.5, 0.9)), one)]);
    let (_, warnings, texels) = bake(&s, &keep(16));
    assert_eq!(codes(&warnings), ["texcoord_degenerate"]);
    assert!(texels.is_empty());
}

#[test]
fn without_a_resolution_keep_finds_one_for_the_density() {
    let settings = AtlasSettings { uv: UvMode::Keep, texels_per_metre: Some(40.0), ..AtlasSettings::default() };
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::splat(0.5)), vec![Affine3A::IDENTITY])]);
    assert_eq!(bake(&s, &settings).0.pages[0].width, 128);
}

#[test]
fn what_wants_no_lightmap_gets_none() {
    let mut s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY; 2])]);
    s.instances[0].lightmap = LightmapRequest::None;
    let (atlas, warnings, texels) = bake(&s, &keep(8));
    assert_eq!((codes(&warnings), texels.len()), (vec![], 64));
    assert!(atlas.layouts[0].is_none() && atlas.locate(0, 0, Vec2::ZERO).is_none());
}

#[test]
fn nothing_to_light_is_no_error() {
    let empty = mesh(&[], |_, _| Vec2::ZERO);
    for s in [Scene::default(), scene(vec![(empty, vec![Affine3A::IDENTITY])])] {
        assert!(bake(&s, &keep(8)).2.is_empty());
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let bad = [
        AtlasSettings { resolution: Some(0), ..AtlasSettings::default() },
        AtlasSettings { resolution: Some(1 << 20), ..AtlasSettings::default() },
        AtlasSettings { texels_per_metre: Some(0.0), ..AtlasSettings::default() },
        AtlasSettings { texels_per_metre: Some(f32::NAN), ..AtlasSettings::default() },
        AtlasSettings { max_page: 0, ..AtlasSettings::default() },
        AtlasSettings { padding: 4000, ..AtlasSettings::default() },
    ];
    for settings in bad {
        assert!(matches!(build(&Scene::default(), &settings, &Silent), Err(AtlasError::InvalidSetting { .. })));
    }
}

#[test]
fn cancelling_ends_it() {
    struct Impatient;
    impl Progress for Impatient {
        fn report(&self, _: Stage, _: f64) {}
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let s = scene(vec![(quad(Vec2::ZERO, Vec2::ONE), vec![Affine3A::IDENTITY])]);
    for settings in
        [keep(8), auto(Unwrapper::Xatlas), auto(Unwrapper::Fast), AtlasSettings { uv: UvMode::Pack, ..keep(8) }]
    {
        assert!(matches!(build(&s, &settings, &Impatient), Err(AtlasError::Cancelled(_))));
    }
    let (atlas, _) = build(&s, &keep(8), &Silent).expect("the scene can be laid out");
    assert_eq!(rasterise(&s, &atlas, &Impatient), Err(Cancelled));
}
