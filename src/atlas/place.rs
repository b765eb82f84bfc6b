//! Charts of every instance to pages: density → whole texels → packing → atlas.

use super::build::{AtlasError, AtlasSettings, Unwrapper, UvMode, listed};
use super::flatten::{FlatChart, flatten};
use super::pack::{Place, Spacing, cropped, pack};
use super::shape::{Shape, shapes};
use super::unwrap::{Unwrapped, existing};
use super::{Atlas, Chart, Layout, Page, uvunwrap, xatlas};
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::{LightmapRequest, Scene};
use crate::warning::Warning;
use glam::{DVec2, Vec2};
use rayon::prelude::*;

/// More texels than this on all pages are refused: texels are counted in 32 bits, and memory ends long before.
const MOST_TEXELS: f64 = (1u64 << 30) as f64;
/// Halvings in the search for the density that fills one page: finer than a texel on any page.
const SEARCH_STEPS: usize = 14;

/// Unwraps, or takes the islands there are, and packs every instance for itself.
pub(super) fn build(
    scene: &Scene,
    settings: &AtlasSettings,
    progress: &dyn Progress,
) -> Result<(Atlas, Vec<Warning>), AtlasError> {
    let shapes = shapes(scene);
    let (unwrapped, unwrapper) = match (settings.uv, settings.unwrapper) {
        (UvMode::Pack, _) => (existing_islands(scene, &shapes)?, "pack"),
        (_, Unwrapper::Xatlas) => (xatlas::unwrap(scene, &shapes, progress)?, "xatlas"),
        (_, Unwrapper::Fast) => (uvunwrap::unwrap(scene, &shapes, progress)?, "uvunwrap"),
    };
    if progress.is_cancelled() {
        return Err(Cancelled.into());
    }
    let charts: Vec<Vec<FlatChart>> = shapes
        .par_iter()
        .zip(&unwrapped)
        .map(|(shape, unwrapped)| flatten(&scene.meshes[shape.mesh], shape, unwrapped))
        .collect();
    let mut warnings = if settings.uv == UvMode::Pack { lone_triangles(scene, &shapes, &charts) } else { Vec::new() };

    let placed = placed_instances(scene, &shapes, &charts);
    let spacing = Spacing::of(settings.padding);
    let packed = match (settings.resolution, settings.texels_per_metre) {
        (Some(page), None) => fill_one_page(&placed, page, spacing, progress)?,
        (Some(page), Some(density)) => on_pages(&placed, density.into(), page, spacing, true)?,
        (None, density) => {
            let density = density.unwrap_or(AtlasSettings::DENSITY);
            on_pages(&placed, density.into(), settings.max_page, spacing, false)?
        }
    };
    progress.report(Stage::Atlas, 1.0);
    warnings.extend(packed.warnings(scene, &placed));
    let mut atlas = packed.atlas(scene, &placed, settings);
    atlas.unwrapper = unwrapper;
    Ok((atlas, warnings))
}

/// The islands of TEXCOORD_1, or of TEXCOORD_0 without it.
fn existing_islands(scene: &Scene, shapes: &[Shape]) -> Result<Vec<Unwrapped>, AtlasError> {
    let set = |mesh: usize| {
        let sets = &scene.meshes[mesh].texcoords;
        [1, 0].into_iter().find(|&s| sets.get(s).is_some_and(|set| !set.is_empty()))
    };
    let nodes: Vec<String> = shapes
        .iter()
        .filter(|s| set(s.mesh).is_none())
        .flat_map(|s| s.instances.iter().map(|&(i, _)| scene.instances[i].path.clone()))
        .collect();
    if !nodes.is_empty() {
        return Err(AtlasError::MissingTexcoords { set: "TEXCOORD_1 or TEXCOORD_0", nodes });
    }
    Ok(existing(scene, shapes, set))
}

/// Warns of meshes whose triangles lie apart in their texture coordinates or have no area there.
fn lone_triangles(scene: &Scene, shapes: &[Shape], charts: &[Vec<FlatChart>]) -> Vec<Warning> {
    let warning = |(shape, charts): (&Shape, &Vec<FlatChart>)| {
        let lone = charts.iter().filter(|c| c.triangles.len() == 1).count();
        let total = shape.triangles.len();
        let message = format!(
            "{lone} of {total} triangles are islands of their own or have no area in the texture coordinates: \
             bake with `--uv auto` for fewer seams"
        );
        (lone > 8 && 2 * lone > total)
            .then(|| Warning::new("texcoord_scattered", scene.meshes[shape.mesh].name.clone(), message))
    };
    shapes.iter().zip(charts).filter_map(warning).collect()
}

/// One instance with the charts of its shape.
struct Placed<'a> {
    instance: usize,
    /// Metres per unit of the shape.
    scale: f64,
    /// World area, m².
    area: f64,
    charts: &'a [FlatChart],
    request: LightmapRequest,
}

impl Placed<'_> {
    /// Texels per metre, if `density` is the bake's.
    fn density(&self, density: f64) -> f64 {
        match self.request {
            LightmapRequest::TexelsPerMetre(own) if own > 0.0 && own.is_finite() => own.into(),
            LightmapRequest::Resolution(side) if side > 0 && self.area > 0.0 => f64::from(side) / self.area.sqrt(),
            _ => density,
        }
    }
}

/// All instances that have charts, in the order of the scene.
fn placed_instances<'a>(scene: &Scene, shapes: &[Shape], charts: &'a [Vec<FlatChart>]) -> Vec<Placed<'a>> {
    let mut placed: Vec<Placed> = Vec::new();
    for (shape, charts) in shapes.iter().zip(charts).filter(|(_, c)| !c.is_empty()) {
        let area = shape.area(&scene.meshes[shape.mesh]);
        placed.extend(shape.instances.iter().map(|&(instance, scale)| {
            let request = scene.instances[instance].lightmap;
            Placed { instance, scale, area: area * scale * scale, charts, request }
        }));
    }
    placed.sort_by_key(|p| p.instance);
    placed
}

/// Everything in texels: sizes and places of all charts, instance by instance.
struct Packed {
    rectangles: Vec<(u32, u32)>,
    places: Vec<Place>,
    pages: Vec<Page>,
    /// Instances of which a chart had to shrink to fit the page, as indices of the placed ones.
    shrunk: Vec<usize>,
    /// True if one page was asked for and did not do.
    overflow: bool,
}

/// Sizes of all charts in whole texels, at most `most` each, and which instances had charts that would be larger.
fn rectangles(placed: &[Placed], density: f64, most: u32) -> (Vec<(u32, u32)>, Vec<usize>) {
    let (mut rectangles, mut shrunk) = (Vec::new(), Vec::new());
    for (i, p) in placed.iter().enumerate() {
        let texels = p.density(density) * p.scale;
        for chart in p.charts {
            let size = chart.size.as_dvec2() * texels;
            let fit = (f64::from(most) / size.max_element()).min(1.0);
            if fit < 1.0 && shrunk.last() != Some(&i) {
                shrunk.push(i);
            }
            // The nearest whole number: borders then lie between texels, and the density is right on average.
            let whole = |s: f64| ((s * fit).round() as u32).clamp(1, most);
            rectangles.push((whole(size.x), whole(size.y)));
        }
    }
    (rectangles, shrunk)
}

/// Packs at a given density: on pages of exactly `page`², or, unless they are `fixed`, on the smallest page that does
/// and on several of `page`² only where one does not.
fn on_pages(placed: &[Placed], density: f64, page: u32, spacing: Spacing, fixed: bool) -> Result<Packed, AtlasError> {
    let texels: f64 = placed.iter().map(|p| p.area * p.density(density).powi(2)).sum();
    if texels.is_nan() || texels > MOST_TEXELS {
        return Err(AtlasError::TooManyTexels { texels, most: MOST_TEXELS });
    }
    let (rectangles, shrunk) = rectangles(placed, density, spacing.usable(page));
    let packed = |places: Vec<Place>, pages: Vec<Page>| Packed {
        rectangles: rectangles.clone(),
        places,
        pages,
        shrunk: shrunk.clone(),
        overflow: false,
    };
    if !fixed {
        let mut side = smallest_side(&rectangles, spacing);
        while side <= page {
            if let Some(places) = pack(&rectangles, side, spacing, 1) {
                let pages = cropped(&rectangles, &places, side, spacing);
                return Ok(packed(places, pages));
            }
            side = (side + side / 32 + 1).next_multiple_of(4);
        }
    }
    let places = pack(&rectangles, page, spacing, usize::MAX).expect("no rectangle exceeds the usable page");
    let pages = if fixed {
        let count = places.iter().map(|p| p.page + 1).max().unwrap_or(0);
        vec![Page { width: page, height: page }; count]
    } else {
        cropped(&rectangles, &places, page, spacing)
    };
    Ok(packed(places, pages))
}

/// A page side, in multiples of four, below which the rectangles cannot fit.
fn smallest_side(rectangles: &[(u32, u32)], spacing: Spacing) -> u32 {
    let area: f64 =
        rectangles.iter().map(|r| f64::from(r.0 + spacing.between) * f64::from(r.1 + spacing.between)).sum();
    let longest = rectangles.iter().map(|r| r.0.max(r.1)).max().unwrap_or(0);
    (area.sqrt() as u32).max(longest + 2 * spacing.border).next_multiple_of(4).max(4)
}

/// Packs at the greatest density at which everything fits one page of `page`²; if none does, on several.
fn fill_one_page(
    placed: &[Placed],
    page: u32,
    spacing: Spacing,
    progress: &dyn Progress,
) -> Result<Packed, AtlasError> {
    let area: f64 = placed.iter().map(|p| p.area).sum();
    let usable = spacing.usable(page);
    let attempt = |density: f64| {
        let (rectangles, shrunk) = rectangles(placed, density, usable);
        // A chart that had to shrink shows that the density is more than fits, unless its own request is to blame.
        if shrunk.iter().any(|&i| placed[i].density(1.0) != placed[i].density(2.0)) {
            return None;
        }
        let places = pack(&rectangles, page, spacing, 1)?;
        Some(Packed { rectangles, places, pages: vec![Page { width: page, height: page }], shrunk, overflow: false })
    };
    if area <= 0.0 {
        return on_pages(placed, 1.0, page, spacing, true);
    }
    // More than the whole page never fits; a 2⁻¹⁴th part of that is all padding.
    let mut above = f64::from(page) / area.sqrt() * 1.01;
    let mut below = above / f64::from(1 << 14);
    let Some(mut best) = attempt(below) else {
        return Ok(Packed { overflow: true, ..on_pages(placed, below, page, spacing, true)? });
    };
    for _ in 0..SEARCH_STEPS {
        if progress.is_cancelled() {
            return Err(Cancelled.into());
        }
        let middle = (below * above).sqrt();
        match attempt(middle) {
            Some(packed) => (best, below) = (packed, middle),
            None => above = middle,
        }
    }
    Ok(best)
}

impl Packed {
    fn warnings(&self, scene: &Scene, placed: &[Placed]) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let paths: Vec<String> =
            self.shrunk.iter().map(|&i| scene.instances[placed[i].instance].path.clone()).collect();
        if let Some(first) = paths.first() {
            let message = format!(
                "charts of {} are larger than a page and were shrunk, so their texels are larger than asked for: \
                 split the meshes, or raise the page's size",
                listed(&paths)
            );
            warnings.push(Warning::new("chart_shrunk", first.clone(), message));
        }
        if self.overflow {
            let message = format!(
                "{} charts do not fit one page at any density, so there are {} pages: raise the resolution",
                self.rectangles.len(),
                self.pages.len()
            );
            warnings.push(Warning::new("page_overflow", scene.name.clone(), message));
        }
        warnings
    }

    /// Charts in page order, and the place of every triangle.
    fn atlas(&self, scene: &Scene, placed: &[Placed], settings: &AtlasSettings) -> Atlas {
        // Charts are packed instance by instance; a stable sort by page makes their final order.
        let owners: Vec<usize> = placed.iter().enumerate().flat_map(|(i, p)| vec![i; p.charts.len()]).collect();
        let mut order: Vec<usize> = (0..owners.len()).collect();
        order.sort_by_key(|&c| self.places[c].page);
        let mut number = vec![0u32; order.len()];
        let mut charts = Vec::with_capacity(order.len());
        for c in order {
            number[c] = charts.len() as u32;
            let (place, (width, height)) = (self.places[c], self.rectangles[c]);
            charts.push(Chart {
                instance: placed[owners[c]].instance,
                page: place.page,
                x: place.x..place.x + width,
                y: place.y..place.y + height,
            });
        }

        let mut layouts = vec![None; scene.instances.len()];
        let mut first = 0;
        for p in placed {
            let range = first..first + p.charts.len();
            first = range.end;
            let triangles = scene.meshes[scene.instances[p.instance].mesh].triangles.len();
            layouts[p.instance] = Some(layout(p.charts, &number[range], &charts, triangles));
        }
        Atlas { pages: self.pages.clone(), charts, layouts, padding: settings.padding, unwrapper: "" }
    }
}

/// Where the triangles of one instance lie: its flat charts stretched to their rectangles. Triangles without area have
/// no chart; they collapse onto a corner of the first.
fn layout(flat: &[FlatChart], numbers: &[u32], charts: &[Chart], triangles: usize) -> Layout {
    let origin = |number: u32| {
        let chart = &charts[number as usize];
        DVec2::new(chart.x.start.into(), chart.y.start.into())
    };
    let anchor = origin(numbers[0]).as_vec2();
    let mut layout = Layout { corners: vec![[anchor; 3]; triangles], charts: vec![numbers[0]; triangles] };
    for (f, &number) in flat.iter().zip(numbers) {
        let chart = &charts[number as usize];
        let size = DVec2::new(chart.x.len() as f64, chart.y.len() as f64);
        let extent = f.size.as_dvec2().max(DVec2::splat(f64::MIN_POSITIVE));
        // In double precision the far border comes out on the whole number.
        let at = |c: Vec2| (origin(number) + c.as_dvec2() * size / extent).as_vec2();
        for (&t, corners) in f.triangles.iter().zip(&f.corners) {
            layout.corners[t as usize] = corners.map(at);
            layout.charts[t as usize] = number;
        }
    }
    layout
}
