//! A lightmap within seconds: few shadow rays per texel, one bounce solution on coarse elements, no probes. Resolved
//! scene and texels → irradiance and the error to expect.

use super::elements::{elements, hierarchy, lamps};
use super::light::relative;
use super::observer::Counts;
use crate::accel::Accel;
use crate::atlas::{Atlas, Texels};
use crate::gather::{self, DirectSettings, Footprint, Grouped, Lamps, Lightmap, LitScene, Portals, Smooth};
use crate::hierarchy::Surfels;
use crate::output::report::StageClock;
use crate::output::{Milestone, State};
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::{LightGroups, Rgb};

/// Texels along a side of an element.
const ELEMENT_SIDE: u32 = 8;
/// Rays per element that look for backs of double-sided surfaces.
const BACK_RAYS: u32 = 4;
/// Shadow rays per lamp of an element that has no texels of its own.
const ELEMENT_RAYS: u32 = 2;
/// Rays per element to the sky through openings.
const SKY_RAYS: u32 = 8;
/// Rays per element of the first bounce.
const BOUNCE_RAYS: usize = 24;
/// Times the noise and the change by smoothing that the error comes to: what both do not see is about as large.
const UNSEEN: f32 = 2.0;

/// A first lightmap.
pub struct Preview {
    /// Irradiance of every texel.
    pub lightmap: Lightmap,
    /// Irradiance of every texel from everything but lamps.
    pub rest: Smooth,
    /// What it is, and the error to expect.
    pub state: State,
    /// What it took.
    pub counts: Counts,
}

/// Irradiance of every texel, roughly; direct light also by `groups`.
pub fn preview(
    accel: &Accel,
    atlas: &Atlas,
    texels: &Texels,
    groups: &LightGroups,
    clock: &StageClock,
    progress: &dyn Progress,
) -> Result<Preview, Cancelled> {
    let mut counts = Counts::default();
    let scene = accel.scene();
    let footprint = clock.measure(Stage::Texels, || Footprint::rough(accel, atlas, texels, progress))?;
    let (emission, lamps) = lamps(scene, groups);
    let (lamps, mut direct) = clock.measure(Stage::Direct, || {
        let portals = Portals::find(accel, &footprint, texels.len() as u32, groups.of_environment(), progress)?;
        let lamps = Lamps::new(lamps, portals, accel);
        let direct =
            gather::texel_direct(&lamps, groups.len(), atlas, texels, &footprint, &DirectSettings::rough(), progress)?;
        Ok((lamps, direct))
    })?;
    counts.rays.insert("shadow".into(), direct.rays);

    let rest = clock.measure(Stage::Solve, || {
        let surfels = Surfels::new(scene, atlas, texels, footprint.covered(), footprint.parted(), footprint.crossed());
        let (tree, _) = hierarchy(accel, atlas, &surfels, (ELEMENT_SIDE, BACK_RAYS), None, progress)?;
        let sky = gather::element_sky(&lamps, &surfels, &tree.elements, SKY_RAYS);
        let sky = gather::smooth(atlas, texels, &tree, &sky, ELEMENT_SIDE, progress)?;
        direct.irradiance.iter_mut().zip(&sky.irradiance).for_each(|(e, &sky)| *e += sky);
        direct.noise = direct.noise.hypot(sky.change);
        let (elements, direct_groups) =
            elements(scene, atlas, &surfels, &tree, &emission, &lamps, &direct, ELEMENT_RAYS);
        let shut = gather::shut_texels(&surfels, &tree);
        let lit = LitScene {
            accel,
            atlas,
            surfels: &surfels,
            hierarchy: &tree,
            emission: &emission,
            footprint: &footprint,
            lamps: &lamps,
            direct: &direct,
            element_direct: &elements.direct,
            element_direct_groups: &direct_groups,
            groups,
            shut: &shut,
        };
        let guess = (vec![Rgb::ZERO; tree.elements.len()], Grouped::default());
        let bounce = gather::bounce(lit, &elements.reflectance, guess, BOUNCE_RAYS, progress)?;
        counts.solver.nodes = tree.nodes.len() as u64;
        counts.solver.elements = tree.elements.len() as u64;
        counts.rays.insert("bounce".into(), bounce.rays);
        counts.rays.insert("survey".into(), u64::from(BACK_RAYS) * tree.elements.len() as u64);
        gather::smooth(atlas, texels, &tree, &bounce.irradiance, ELEMENT_SIDE, progress)
    })?;
    let combined: Vec<Rgb> = direct.irradiance.iter().zip(&rest.irradiance).map(|(&d, &i)| d + i).collect();
    let squares = f64::from(UNSEEN * direct.noise.hypot(rest.change)).powi(2) * texels.len() as f64;
    let state = State { reached: Milestone::Preview, predicted_error: relative(squares, &combined) };
    let usable = (0..texels.len() as u32).map(|t| !footprint.is_hidden(t)).collect();
    let (direct, direct_groups) = (direct.irradiance, direct.groups);
    let lightmap = Lightmap { direct, combined, direct_groups, usable, ..Lightmap::default() };
    Ok(Preview { lightmap, rest, state, counts })
}
