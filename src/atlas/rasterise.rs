//! Conservative rasterisation: scene and atlas → one surfel per texel that a chart covers at all.
//!
//! Three steps: every chart cuts its triangles along the texel grid (in parallel, exactly); texels are claimed chart by
//! chart; each texel then sums what overlaps it. Everything is ordered by chart, Morton code and overlap, so that the
//! result does not depend on the number of threads.

use super::appearance::mean_appearance;
use super::coverage::cover;
use super::surface::{Surface, on_side_of};
use super::{Atlas, Chart, NO_TEXEL, PageTexels, SurfacePoint, Texels};
use crate::progress::{Cancelled, Counter, Progress, Stage};
use crate::scene::{Appearance, Material, Scene};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// A texel that is covered less than this is left to dilation: charts laid on whole texels overrun them by the rounding
/// of their coordinates, about 1e-4 texels.
pub(super) const MIN_COVERAGE: f32 = 2e-4;
/// A triangle that overlaps a texel less than this is not listed there.
const MIN_OVERLAP: f32 = 1e-6;
/// Surfels that are worked out between two reports of progress.
const BATCH: usize = 1 << 15;

/// The part of a triangle that lies in one texel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fragment {
    /// Morton code of the texel's page position.
    code: u32,
    /// Triangle of the chart's instance.
    pub(super) triangle: u32,
    /// Area in texels.
    pub(super) area: f32,
    /// Centroid relative to the texel's corner.
    pub(super) centroid: Vec2,
}

/// All valid texels of the atlas. A position that two charts claim belongs to the first of them.
pub fn rasterise(scene: &Scene, atlas: &Atlas, progress: &dyn Progress) -> Result<Texels, Cancelled> {
    // Every texel at most twice: when it is cut out and when its surfel is worked out.
    let most: usize = atlas.charts.iter().map(|c| c.x.len() * c.y.len()).sum();
    let counter = Counter::new(progress, Stage::Texels, 2 * most);
    let fragments = fragments(scene, atlas, &counter)?;
    let mut texels = empty_texels(atlas);
    let fragments = claim(atlas, fragments, &mut texels);
    fill(scene, atlas, &fragments, &mut texels, &counter)?;
    progress.report(Stage::Texels, 1.0);
    Ok(texels)
}

/// Per chart, its fragments texel by texel in Morton order, the largest of each texel first.
fn fragments(scene: &Scene, atlas: &Atlas, counter: &Counter) -> Result<Vec<Vec<Fragment>>, Cancelled> {
    let triangles = triangles_by_chart(atlas);
    atlas
        .charts
        .par_iter()
        .zip(&triangles)
        .map(|(chart, triangles)| {
            let fragments = chart_fragments(scene, atlas, chart, triangles);
            counter.advance(chart.x.len() * chart.y.len())?;
            Ok(fragments)
        })
        .collect()
}

/// Triangles of every chart in ascending order.
pub(super) fn triangles_by_chart(atlas: &Atlas) -> Vec<Vec<u32>> {
    let mut triangles = vec![Vec::new(); atlas.charts.len()];
    for layout in atlas.layouts.iter().flatten() {
        for (t, &chart) in layout.charts.iter().enumerate() {
            triangles[chart as usize].push(t as u32);
        }
    }
    triangles
}

/// Cuts the triangles of one chart along the texel grid.
fn chart_fragments(scene: &Scene, atlas: &Atlas, chart: &Chart, triangles: &[u32]) -> Vec<Fragment> {
    let Some(layout) = &atlas.layouts[chart.instance] else { return Vec::new() };
    let mut fragments = Vec::new();
    for &triangle in triangles {
        // A triangle without area in the world has no normal and holds no light.
        if scene.geometric_normal(chart.instance, triangle as usize) == Vec3::ZERO {
            continue;
        }
        let corners = layout.corners[triangle as usize].map(|c| c.as_dvec2());
        cover(corners, &chart.x, &chart.y, |o| {
            let code = morton(o.x as u16, o.y as u16);
            fragments.push(Fragment { code, triangle, area: o.area as f32, centroid: o.centroid.as_vec2() });
        });
    }
    fragments
        .sort_unstable_by(|a, b| a.code.cmp(&b.code).then(b.area.total_cmp(&a.area)).then(a.triangle.cmp(&b.triangle)));
    drop_slivers(fragments)
}

/// Removes texels that are hardly covered and triangles that hardly overlap a texel, but leaves every chart its most
/// covered texel and every texel its largest triangle.
fn drop_slivers(mut fragments: Vec<Fragment>) -> Vec<Fragment> {
    let coverage = |texel: &[Fragment]| texel.iter().map(|f| f.area).sum::<f32>();
    let texels = || fragments.chunk_by(|a, b| a.code == b.code);
    // Ties go to the first in Morton order.
    let best = texels().map(|t| (coverage(t), t[0].code)).reduce(|a, b| if b.0 > a.0 { b } else { a });
    let Some((_, best)) = best else { return fragments };
    let dropped: Vec<u32> =
        texels().filter(|t| coverage(t) < MIN_COVERAGE && t[0].code != best).map(|t| t[0].code).collect();
    let mut previous = None;
    fragments.retain(|f| {
        let first = previous != Some(f.code);
        previous = Some(f.code);
        (first || f.area >= MIN_OVERLAP) && dropped.binary_search(&f.code).is_err()
    });
    fragments.shrink_to_fit();
    fragments
}

/// Texels without content: pages that nothing covers yet.
fn empty_texels(atlas: &Atlas) -> Texels {
    let page = |p: &super::Page| PageTexels {
        width: p.width,
        height: p.height,
        texel: vec![NO_TEXEL; p.width as usize * p.height as usize],
    };
    Texels { pages: atlas.pages.iter().map(page).collect(), ..Texels::default() }
}

/// Gives every texel to the first chart that covers it: sets pages, charts, pixels and triangle runs, and returns the
/// fragments that stay, in the order of the runs.
fn claim(atlas: &Atlas, per_chart: Vec<Vec<Fragment>>, texels: &mut Texels) -> Vec<Fragment> {
    let mut kept = Vec::with_capacity(per_chart.iter().map(Vec::len).sum());
    for (c, fragments) in per_chart.into_iter().enumerate() {
        let page = &mut texels.pages[atlas.charts[c].page];
        let start = texels.pixel.len() as u32;
        for run in fragments.chunk_by(|a, b| a.code == b.code) {
            let [x, y] = from_morton(run[0].code);
            let slot = &mut page.texel[usize::from(y) * page.width as usize + usize::from(x)];
            if *slot != NO_TEXEL {
                continue;
            }
            *slot = texels.pixel.len() as u32;
            texels.pixel.push([x, y]);
            texels.chart.push(c as u32);
            texels.first_triangle.push(kept.len() as u32);
            kept.extend_from_slice(run);
        }
        texels.charts.push(start..texels.pixel.len() as u32);
    }
    texels.first_triangle.push(kept.len() as u32);
    texels.triangles = kept.iter().map(|f| f.triangle).collect();
    kept
}

/// Works out every texel's surfel from its fragments.
fn fill(
    scene: &Scene,
    atlas: &Atlas,
    fragments: &[Fragment],
    texels: &mut Texels,
    counter: &Counter,
) -> Result<(), Cancelled> {
    let surfaces: Vec<Option<Surface>> =
        (0..atlas.layouts.len()).map(|instance| Surface::new(scene, atlas, instance)).collect();
    let any = |has: fn(&Material) -> bool| {
        surfaces.iter().flatten().any(|s| s.mesh.primitives.iter().any(|p| has(&scene.materials[p.material])))
    };
    let kept = Kept { emission: any(Material::emits), opacity: any(Material::lets_light_through) };
    let n = texels.len();
    reserve(texels, n, kept);
    let mut batch = Vec::new();
    for start in (0..n).step_by(BATCH) {
        let end = (start + BATCH).min(n);
        (start..end)
            .into_par_iter()
            .map(|t| {
                let chart = &atlas.charts[texels.chart[t] as usize];
                let surface = surfaces[chart.instance].as_ref().expect("texels come from charts of laid-out instances");
                let run = texels.first_triangle[t] as usize..texels.first_triangle[t + 1] as usize;
                let [x, y] = texels.pixel[t];
                surfel(surface, Vec2::new(f32::from(x), f32::from(y)), &fragments[run])
            })
            .collect_into_vec(&mut batch);
        batch.iter().for_each(|s| push(texels, s, kept));
        counter.advance(end - start)?;
    }
    Ok(())
}

/// Which of the arrays that some scenes do without are filled.
#[derive(Clone, Copy)]
struct Kept {
    emission: bool,
    opacity: bool,
}

/// What one texel holds besides its place.
struct Surfel {
    point: SurfacePoint,
    area: f32,
    coverage: f32,
    appearance: Appearance,
}

/// Sums the fragments of the texel at `pixel`, largest first.
fn surfel(surface: &Surface, pixel: Vec2, fragments: &[Fragment]) -> Surfel {
    let (mut area, mut coverage) = (0.0, 0.0);
    let (mut geometric, mut shading, mut centroid) = (Vec3::ZERO, Vec3::ZERO, Vec2::ZERO);
    for f in fragments {
        let world = f.area * surface.area_per_texel(f.triangle);
        let point = surface.point(f.triangle, surface.nearest(f.triangle, pixel + f.centroid));
        area += world;
        coverage += f.area;
        centroid += f.centroid * f.area;
        geometric += point.geometric_normal * world;
        shading += point.shading_normal * world;
    }

    // The centroid of a concave or torn cover may lie beside it: then the largest part's centroid stands for it.
    let largest = &fragments[0];
    let middle = pixel + centroid / coverage;
    let at = fragments.iter().find_map(|f| surface.barycentric(f.triangle, middle).map(|b| (f.triangle, b)));
    let (triangle, barycentric) =
        at.unwrap_or_else(|| (largest.triangle, surface.nearest(largest.triangle, pixel + largest.centroid)));
    let mut point = surface.point(triangle, barycentric);
    // Normals of a texel that folds back on itself may cancel.
    point.geometric_normal = geometric.try_normalize().unwrap_or(point.geometric_normal);
    point.shading_normal = on_side_of(point.geometric_normal, shading);

    Surfel { point, area, coverage: coverage.min(1.0), appearance: mean_appearance(surface, pixel, fragments) }
}

fn reserve(texels: &mut Texels, n: usize, kept: Kept) {
    texels.position.reserve_exact(n);
    texels.shading_normal.reserve_exact(n);
    texels.geometric_normal.reserve_exact(n);
    texels.area.reserve_exact(n);
    texels.coverage.reserve_exact(n);
    texels.reflectance.reserve_exact(n);
    if kept.emission {
        texels.emission.reserve_exact(n);
    }
    if kept.opacity {
        texels.opacity.reserve_exact(n);
    }
}

fn push(texels: &mut Texels, s: &Surfel, kept: Kept) {
    texels.position.push(s.point.position);
    texels.shading_normal.push(s.point.shading_normal);
    texels.geometric_normal.push(s.point.geometric_normal);
    texels.area.push(s.area);
    texels.coverage.push(s.coverage);
    texels.reflectance.push(s.appearance.reflectance);
    if kept.emission {
        texels.emission.push(s.appearance.emission);
    }
    if kept.opacity {
        texels.opacity.push(s.appearance.opacity);
    }
}

/// Interleaves the bits of a page position, x in the even ones (Morton 1966).
fn morton(x: u16, y: u16) -> u32 {
    spread(x) | spread(y) << 1
}

/// The page position of a Morton code.
fn from_morton(code: u32) -> [u16; 2] {
    [gathered(code), gathered(code >> 1)]
}

/// Moves bit i to bit 2i.
fn spread(v: u16) -> u32 {
    let mut v = u32::from(v);
    v = (v | v << 8) & 0x00ff_00ff;
    v = (v | v << 4) & 0x0f0f_0f0f;
    v = (v | v << 2) & 0x3333_3333;
    (v | v << 1) & 0x5555_5555
}

/// Moves bit 2i to bit i.
fn gathered(mut v: u32) -> u16 {
    v &= 0x5555_5555;
    v = (v | v >> 1) & 0x3333_3333;
    v = (v | v >> 2) & 0x0f0f_0f0f;
    v = (v | v >> 4) & 0x00ff_00ff;
    (v | v >> 8) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morton_codes_round_trip() {
        for (x, y) in [(0, 0), (1, 0), (0, 1), (3, 5), (4095, 17), (32767, 32767)] {
            assert_eq!(from_morton(morton(x, y)), [x, y]);
        }
        assert_eq!([morton(0, 0), morton(1, 0), morton(0, 1), morton(1, 1)], [0, 1, 2, 3]);
    }

    #[test]
    fn slivers_go_but_the_last_texel_stays() {
        let fragment = |code, triangle, area| Fragment { code, triangle, area, centroid: Vec2::ZERO };
        let codes = |f: Vec<Fragment>| f.iter().map(|f| (f.code, f.triangle)).collect::<Vec<_>>();
        let mixed = vec![fragment(0, 0, 1e-5), fragment(1, 0, 0.5), fragment(1, 1, 1e-8)];
        assert_eq!(codes(drop_slivers(mixed)), [(1, 0)]);
        let tiny = vec![fragment(4, 0, 1e-9), fragment(5, 0, 2e-9)];
        assert_eq!(codes(drop_slivers(tiny)), [(5, 0)]);
        assert!(drop_slivers(Vec::new()).is_empty());
    }
}
