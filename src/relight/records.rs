//! The contents of the sections of `solution.lk`: patches, layouts and group pages ↔ planes of bytes. Reading fails where
//! numbers are missing, left over, or out of their bounds.

use super::codec::{Planes, put_bytes, put_halves, put_integers};
use super::{GroupPage, Header, PageLayout, Patches, Reflector};
use crate::gather::{Grouped, NOTHING};
use crate::scene::Rgb;
use half::f16;

/// Halves of three channels.
fn put_colors(out: &mut Vec<u8>, values: impl Iterator<Item = Rgb> + Clone) {
    for c in 0..3 {
        put_halves(out, values.clone().map(|v| f16::from_f32(v[c].min(f16::MAX.to_f32()))));
    }
}

fn colors(planes: &mut Planes, count: usize) -> Option<Vec<Rgb>> {
    let [r, g, b] = [planes.halves(count)?, planes.halves(count)?, planes.halves(count)?];
    let value = |i: usize| Rgb::new(r[i].to_f32(), g[i].to_f32(), b[i].to_f32());
    let values: Vec<Rgb> = (0..count).map(value).collect();
    values.iter().all(|v| v.is_finite() && v.min_element() >= 0.0).then_some(values)
}

pub(super) fn encode_patches(p: &Patches) -> Vec<u8> {
    let mut out = Vec::new();
    put_integers(&mut out, [p.reflectors.len() as u32, p.len() as u32, p.rays.len() as u32].into_iter());
    put_integers(&mut out, p.reflectors.iter().map(|r| r.patch));
    put_integers(&mut out, p.reflectors.iter().map(|r| r.material));
    put_colors(&mut out, p.reflectors.iter().map(|r| r.reflectance));
    put_integers(&mut out, p.first_ray.iter().copied());
    put_integers(&mut out, p.rays.iter().copied());
    for g in 0..p.own.groups() {
        put_colors(&mut out, p.own.group(g).into_iter());
        put_colors(&mut out, p.direct.group(g).into_iter());
    }
    out
}

pub(super) fn decode_patches(content: &[u8], header: &Header) -> Option<Patches> {
    let mut planes = Planes(content);
    let counts = planes.integers(3)?;
    let [reflectors, patches, rays] = [0, 1, 2].map(|i| counts[i] as usize);
    let (of_patch, of_material) = (planes.integers(reflectors)?, planes.integers(reflectors)?);
    let reflectance = colors(&mut planes, reflectors)?;
    let first_ray = planes.integers(patches.checked_add(1)?)?;
    let rays = planes.integers(rays)?;
    let (mut own, mut direct) = (Vec::new(), Vec::new());
    for _ in 0..header.known.groups.len() {
        own.push(colors(&mut planes, patches)?);
        direct.push(colors(&mut planes, patches)?);
    }
    let sound = planes.is_done()
        && of_patch.iter().all(|&p| (p as usize) < patches)
        && of_material.iter().all(|&m| (m as usize) < header.known.materials.len())
        && first_ray.is_sorted()
        && first_ray.first() == Some(&0)
        && first_ray.last().is_some_and(|&last| last as usize == rays.len())
        && rays.iter().all(|&p| p == NOTHING || (p as usize) < patches);
    let reflector = |i: usize| Reflector { patch: of_patch[i], material: of_material[i], reflectance: reflectance[i] };
    sound.then(|| Patches {
        reflectors: (0..reflectors).map(reflector).collect(),
        first_ray,
        rays,
        own: Grouped::from_groups(&own),
        direct: Grouped::from_groups(&direct),
    })
}

pub(super) fn encode_layout(layout: &PageLayout) -> Vec<u8> {
    let mut out = Vec::new();
    let counts = [layout.width, layout.height, layout.places.len() as u32, layout.material.len() as u32];
    put_integers(&mut out, counts.into_iter());
    put_integers(&mut out, layout.places.iter().copied());
    put_bytes(&mut out, layout.valid.iter().map(|&v| u8::from(v)));
    put_integers(&mut out, layout.chart.iter().copied());
    put_integers(&mut out, layout.patch.iter().copied());
    put_integers(&mut out, layout.material.iter().copied());
    put_colors(&mut out, layout.reflectance.iter().copied());
    out
}

pub(super) fn decode_layout(content: &[u8]) -> Option<PageLayout> {
    let mut planes = Planes(content);
    let counts = planes.integers(4)?;
    let (count, materials) = (counts[2] as usize, counts[3] as usize);
    let layout = PageLayout {
        width: counts[0],
        height: counts[1],
        places: planes.integers(count)?,
        valid: planes.bytes(count)?.iter().map(|&v| v == 1).collect(),
        chart: planes.integers(count)?,
        patch: planes.integers(count)?,
        material: planes.integers(materials)?,
        reflectance: colors(&mut planes, materials)?,
    };
    (planes.is_done() && (materials == 0 || materials == count)).then_some(layout)
}

pub(super) fn encode_group_page(page: &GroupPage) -> Vec<u8> {
    let mut out = Vec::with_capacity(9 * page.irradiance.len());
    for c in 0..3 {
        put_halves(&mut out, page.irradiance.iter().map(|v| v[c]));
    }
    for c in 0..3 {
        put_bytes(&mut out, page.direct.iter().map(|v| v[c]));
    }
    out
}

pub(super) fn decode_group_page(content: &[u8], count: usize) -> Option<GroupPage> {
    let mut planes = Planes(content);
    let [r, g, b] = [planes.halves(count)?, planes.halves(count)?, planes.halves(count)?];
    let [x, y, z] = [planes.bytes(count)?, planes.bytes(count)?, planes.bytes(count)?];
    let irradiance: Vec<[f16; 3]> = (0..count).map(|i| [r[i], g[i], b[i]]).collect();
    let sound = irradiance.as_flattened().iter().all(|v| v.is_finite() && *v >= f16::ZERO);
    let direct = (0..count).map(|i| [x[i], y[i], z[i]]).collect();
    (sound && planes.is_done()).then_some(GroupPage { irradiance, direct })
}
