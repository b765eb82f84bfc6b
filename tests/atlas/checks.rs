//! What holds for every atlas, and measures of one.

use glam::{Vec2, Vec3};
use lightkiln::atlas::{Atlas, AtlasSettings, NO_TEXEL, Texels, Unwrapper, UvMode, build, rasterise};
use lightkiln::progress::Silent;
use lightkiln::scene::{LightmapRequest, Scene};
use lightkiln::warning::Warning;

pub(crate) fn keep(resolution: u32) -> AtlasSettings {
    AtlasSettings { uv: UvMode::Keep, resolution: Some(resolution), ..AtlasSettings::default() }
}

/// Atlas, warnings and texels; what holds for every scene is checked on the way.
pub(crate) fn bake(scene: &Scene, settings: &AtlasSettings) -> (Atlas, Vec<Warning>, Texels) {
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
pub(crate) fn distance(p: Vec3, [a, b, c]: [Vec3; 3]) -> f32 {
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
pub(crate) fn world_area(scene: &Scene) -> f64 {
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

pub(crate) fn total_area(texels: &Texels) -> f64 {
    texels.area.iter().map(|&a| f64::from(a)).sum()
}

pub(crate) fn close(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * b.abs(), "{a} is not {b}");
}

pub(crate) fn codes(warnings: &[Warning]) -> Vec<&'static str> {
    warnings.iter().map(|w| w.code).collect()
}

pub(crate) fn auto(unwrapper: Unwrapper) -> AtlasSettings {
    AtlasSettings { unwrapper, ..AtlasSettings::default() }
}

/// Fails if charts lie upon each other or themselves, or are nearer than the padding.
pub(crate) fn check_apart(atlas: &Atlas, texels: &Texels) {
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
