//! Lightmap coordinates that the scene brings along: TEXCOORD_1 of every mesh × resolution = page coordinates.

use super::build::{AtlasError, AtlasSettings, listed};
use super::coverage::cover;
use super::islands::{Islands, islands};
use super::rasterise::{MIN_COVERAGE, triangles_by_chart};
use super::{Atlas, Chart, Layout, Page};
use crate::progress::{Cancelled, Counter, Progress, Stage};
use crate::scene::{LightmapRequest, Mesh, Scene};
use crate::warning::Warning;
use glam::Vec2;
use rayon::prelude::*;
use std::num::NonZeroU32;
use std::ops::Range;

/// The set that holds lightmap coordinates.
const SET: usize = 1;
/// Coordinates this far outside 0..1 are the rounding of a border.
const BORDER_TOLERANCE: f32 = 1e-5;

/// All instances on one page, each where its mesh's TEXCOORD_1 says.
pub(super) fn build(
    scene: &Scene,
    settings: &AtlasSettings,
    progress: &dyn Progress,
) -> Result<(Atlas, Vec<Warning>), AtlasError> {
    let wanted: Vec<usize> =
        (0..scene.instances.len()).filter(|&i| scene.instances[i].lightmap != LightmapRequest::None).collect();
    check_present(scene, &wanted)?;
    let side = settings.resolution.unwrap_or_else(|| side_for_density(scene, &wanted, settings));
    // Once for the islands, once for the overlaps.
    let triangles = wanted.iter().map(|&i| scene.meshes[scene.instances[i].mesh].triangles.len()).sum::<usize>();
    let counter = Counter::new(progress, Stage::Atlas, 2 * triangles);
    let mesh_islands = mesh_islands(scene, &wanted, &counter)?;

    let mut atlas = Atlas {
        pages: vec![Page { width: side, height: side }],
        charts: Vec::new(),
        layouts: vec![None; scene.instances.len()],
        padding: settings.padding,
        unwrapper: "keep",
    };
    let mut warnings = Vec::new();
    for i in wanted {
        let placed = &scene.instances[i];
        let mesh = &scene.meshes[placed.mesh];
        let Some(islands) = &mesh_islands[placed.mesh] else { continue };
        let uv = &mesh.texcoords[SET];
        let first = atlas.charts.len() as u32;
        let corners = mesh.triangles.iter().map(|t| t.map(|v| page_coordinate(uv[v as usize], side))).collect();
        let layout = Layout { corners, charts: islands.of.iter().map(|c| first + c).collect() };
        atlas.charts.extend(chart_extents(&layout, islands.count, first, side).map(|(x, y)| Chart {
            instance: i,
            page: 0,
            x,
            y,
        }));
        warnings.extend(defects(&placed.path, mesh, &layout));
        atlas.layouts[i] = Some(layout);
    }
    warnings.extend(overlaps(scene, &atlas, &counter)?);
    progress.report(Stage::Atlas, 1.0);
    Ok((atlas, warnings))
}

/// Fails if any instance that wants a lightmap has triangles but no coordinates.
fn check_present(scene: &Scene, wanted: &[usize]) -> Result<(), AtlasError> {
    let lacks = |mesh: &Mesh| !mesh.triangles.is_empty() && mesh.texcoords.get(SET).is_none_or(Vec::is_empty);
    let nodes: Vec<String> = wanted
        .iter()
        .map(|&i| &scene.instances[i])
        .filter(|i| lacks(&scene.meshes[i.mesh]))
        .map(|i| i.path.clone())
        .collect();
    if nodes.is_empty() { Ok(()) } else { Err(AtlasError::MissingTexcoords { set: "TEXCOORD_1", nodes }) }
}

/// The smallest power of two at which the scene has the wanted density on average.
fn side_for_density(scene: &Scene, wanted: &[usize], settings: &AtlasSettings) -> u32 {
    let density = f64::from(settings.texels_per_metre.unwrap_or(AtlasSettings::DENSITY));
    let (mut world, mut page) = (0.0, 0.0);
    for &i in wanted {
        let mesh = &scene.meshes[scene.instances[i].mesh];
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = scene.corners(i, t);
            world += f64::from((b - a).cross(c - a).length());
            let [a, b, c] = triangle.map(|v| mesh.texcoords[SET][v as usize].as_dvec2());
            page += (b - a).perp_dot(c - a).abs();
        }
    }
    let side = density * (world / page).sqrt();
    let largest = f64::from(settings.max_page);
    if side.is_finite() { (side.min(largest).ceil() as u32).next_power_of_two().min(settings.max_page) } else { 1 }
}

/// Islands of every mesh that a wanted instance shows.
fn mesh_islands(scene: &Scene, wanted: &[usize], counter: &Counter) -> Result<Vec<Option<Islands>>, Cancelled> {
    let mut shown = vec![false; scene.meshes.len()];
    wanted.iter().for_each(|&i| shown[scene.instances[i].mesh] = true);
    scene
        .meshes
        .par_iter()
        .zip(shown)
        .map(|(mesh, shown)| {
            if !shown || mesh.triangles.is_empty() {
                return Ok(None);
            }
            counter.advance(mesh.triangles.len())?;
            Ok(Some(islands(mesh, &mesh.texcoords[SET])))
        })
        .collect()
}

/// Page coordinate of a texture coordinate. One that rounding put beside the border between two texels is laid on it.
fn page_coordinate(uv: Vec2, side: u32) -> Vec2 {
    // A float in 0.5..1 is exact to 2⁻²⁵; twice as much allows for one operation of whoever made the coordinates.
    let tolerance = f64::from(side) / f64::from(1 << 23);
    let snapped = |c: f32| {
        let p = f64::from(c) * f64::from(side);
        let whole = p.round();
        (if (p - whole).abs() <= tolerance { whole } else { p }) as f32
    };
    Vec2::new(snapped(uv.x), snapped(uv.y))
}

/// Columns and rows that each of `count` charts covers on a page of `side`², at least one texel each.
fn chart_extents(
    layout: &Layout,
    count: usize,
    first: u32,
    side: u32,
) -> impl Iterator<Item = (Range<u32>, Range<u32>)> {
    let mut boxes = vec![(Vec2::INFINITY, Vec2::NEG_INFINITY); count];
    for (corners, &chart) in layout.corners.iter().zip(&layout.charts) {
        let (low, high) = &mut boxes[(chart - first) as usize];
        for &c in corners.iter().filter(|c| c.is_finite()) {
            (*low, *high) = (low.min(c), high.max(c));
        }
    }
    let range = move |low: f32, high: f32| {
        let start = (low.max(0.0).floor() as u32).min(side - 1);
        start..(high.max(0.0).ceil() as u32).clamp(start + 1, side)
    };
    boxes.into_iter().map(move |(low, high)| (range(low.x, high.x), range(low.y, high.y)))
}

/// What is wrong with the coordinates of one instance by itself.
fn defects(path: &str, mesh: &Mesh, layout: &Layout) -> Vec<Warning> {
    let outside = |t: &&[u32; 3]| {
        t.iter().any(|&v| {
            let uv = mesh.texcoords[SET][v as usize];
            !(uv.min_element() >= -BORDER_TOLERANCE && uv.max_element() <= 1.0 + BORDER_TOLERANCE)
        })
    };
    let outside = mesh.triangles.iter().filter(outside).count();
    let flat = layout.corners.iter().filter(|[a, b, c]| (*b - *a).perp_dot(*c - *a) == 0.0).count();
    let total = mesh.triangles.len();
    let mut warnings = Vec::new();
    if outside > 0 {
        let message = format!(
            "TEXCOORD_1 of {outside} of {total} triangles leaves 0–1; what lies outside gets no texels: \
             move it inside, or bake with `--uv pack`"
        );
        warnings.push(Warning::new("texcoord_outside", path, message));
    }
    if flat > 0 {
        let message = format!(
            "{flat} of {total} triangles have no area in TEXCOORD_1 and get no texels: \
             unwrap them, or bake with `--uv auto`"
        );
        warnings.push(Warning::new("texcoord_degenerate", path, message));
    }
    warnings
}

/// Two warnings at most: texels where charts lie upon each other, and texels in which charts only meet.
fn overlaps(scene: &Scene, atlas: &Atlas, counter: &Counter) -> Result<Vec<Warning>, Cancelled> {
    // What rounding may add to a texel that is covered once.
    const EXCESS: f32 = 1.0 + 1e-2;
    let Page { width, height } = atlas.pages[0];
    let mut claims = vec![Claim::default(); width as usize * height as usize];
    for (c, (chart, triangles)) in atlas.charts.iter().zip(triangles_by_chart(atlas)).enumerate() {
        let Some(layout) = &atlas.layouts[chart.instance] else { continue };
        for &t in &triangles {
            cover(layout.corners[t as usize].map(|p| p.as_dvec2()), &chart.x, &chart.y, |o| {
                claims[(o.y * width + o.x) as usize].add(c as u32, o.area as f32);
            });
        }
        counter.advance(triangles.len())?;
    }

    let (mut overlap, mut meeting) = (Conflict::default(), Conflict::default());
    for claim in &claims {
        if claim.coverage > EXCESS {
            overlap.add(claim);
        } else if claim.second.is_some() {
            meeting.add(claim);
        }
    }
    let overlap = overlap.warning(scene, atlas, "texcoord_overlap", |texels, names| {
        format!(
            "TEXCOORD_1 overlaps in {texels} texels, first of {names}; the first chart keeps them: \
             lay the charts side by side, or bake with `--uv pack`"
        )
    });
    let meeting = meeting.warning(scene, atlas, "texcoord_meeting", |texels, names| {
        format!(
            "charts of TEXCOORD_1 meet inside {texels} texels, first of {names}; the first chart keeps them: \
             leave two texels between charts, or bake with `--uv pack`"
        )
    });
    Ok(overlap.into_iter().chain(meeting).collect())
}

/// Who wants one texel.
#[derive(Clone, Copy, Default)]
struct Claim {
    coverage: f32,
    first: u32,
    second: Option<NonZeroU32>,
}

impl Claim {
    fn add(&mut self, chart: u32, area: f32) {
        if self.coverage == 0.0 {
            self.first = chart;
        } else if chart != self.first && area >= MIN_COVERAGE {
            // A later chart is never number 0.
            self.second = self.second.or(NonZeroU32::new(chart));
        }
        self.coverage += area;
    }
}

/// Texels that are wanted more than once, and by whom the first of them.
#[derive(Default)]
struct Conflict {
    texels: usize,
    charts: Option<(u32, u32)>,
}

impl Conflict {
    fn add(&mut self, claim: &Claim) {
        self.texels += 1;
        self.charts.get_or_insert((claim.first, claim.second.map_or(claim.first, NonZeroU32::get)));
    }

    fn warning(
        &self,
        scene: &Scene,
        atlas: &Atlas,
        code: &'static str,
        message: impl Fn(usize, &str) -> String,
    ) -> Option<Warning> {
        let path = |chart: u32| scene.instances[atlas.charts[chart as usize].instance].path.clone();
        let (a, b) = self.charts?;
        let mut paths = vec![path(a), path(b)];
        paths.dedup();
        Some(Warning::new(code, path(a), message(self.texels, &listed(&paths))))
    }
}
