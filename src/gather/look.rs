//! How much of one lamp every texel sees: by few rays where a texel and its neighbours agree that they see all or nothing
//! of it, by many in penumbrae, whose ends are followed outward until nothing more of them is found.

use super::alike::Alike;
use super::direct::{DirectSettings, aim, unoccluded, yardstick};
use super::footprint::Footprint;
use super::visibility::{Lamps, Seen, Visibility};
use crate::atlas::{Atlas, NO_TEXEL, Texels};
use crate::math::hash2;
use crate::progress::{Cancelled, Counter};
use crate::scene::Rgb;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Texels per parallel task.
pub(super) const CHUNK: usize = 1024;
/// The same where each casts many rays.
pub(super) const FEW: usize = 64;
/// Texels to each side whose view of a lamp tells whether a texel's own needs a closer look.
const AROUND: i64 = 2;
/// The same at the ends of penumbrae.
pub(super) const NEXT: i64 = 1;
/// Times the rays that a texel casts if its neighbourhood disagrees.
pub(super) const CLOSER: u32 = 4;
/// Share of the rays of a penumbra that show whether a texel beside it is in it.
const EDGE: u32 = 8;
/// Share of a lamp that is hidden or seen so little that next door it may seem to be neither.
const END: f32 = 0.25;
/// Times the rays of a penumbra that a texel casts alone which it casts where it shares what it sees.
const SPARED: u32 = 2;

/// One lamp and its receivers.
pub(super) struct Look<'a> {
    pub(super) lamps: &'a Lamps<'a>,
    /// Number of the lamp.
    pub(super) lamp: usize,
    pub(super) atlas: &'a Atlas,
    pub(super) texels: &'a Texels,
    pub(super) footprint: &'a Footprint<'a>,
    pub(super) settings: &'a DirectSettings,
    /// What the lamps before have brought to every texel, W/m².
    pub(super) so_far: &'a [Rgb],
    /// Mean irradiance of the scene, W/m².
    pub(super) mean: f32,
    /// Rays cast.
    pub(super) rays: &'a AtomicU64,
    pub(super) counter: &'a Counter<'a>,
}

impl Look<'_> {
    /// Writes to `free` what would arrive at every texel unblocked, W/m², and to `seen` what a few rays find.
    pub(super) fn glance(&self, seen: &mut [Visibility], free: &mut [Rgb]) -> Result<(), Cancelled> {
        let chunks = seen.par_chunks_mut(CHUNK).zip(free.par_chunks_mut(CHUNK)).enumerate();
        chunks.try_for_each(|(chunk, (seen, free))| {
            let mut cast = 0;
            for (i, (seen, free)) in seen.iter_mut().zip(free).enumerate() {
                let texel = (chunk * CHUNK + i) as u32;
                (*seen, *free) = (Visibility::default(), Rgb::ZERO);
                let Some(sender) = self.lamps.get(self.lamp, &self.footprint.centre(texel)) else { continue };
                *free = unoccluded(sender, self.texels, self.footprint, texel);
                if *free == Rgb::ZERO {
                    continue;
                }
                let base = if self.lamps.is_sky(self.lamp) {
                    self.settings.sky(free.max_element(), yardstick(self.so_far[texel as usize], self.mean))
                } else if self.footprint.is_touched(texel) {
                    CLOSER * self.settings.base
                } else {
                    self.settings.base
                };
                if let Some(test) = self.tester(texel) {
                    cast += test(base, seen);
                }
            }
            self.rays.fetch_add(cast, Ordering::Relaxed);
            self.counter.advance(seen.len())
        })
    }

    /// Looks closer at penumbrae and what is next to them.
    pub(super) fn closer(&self, seen: &mut [Visibility], free: &[Rgb]) -> Result<(), Cancelled> {
        let is_edge = |&t: &u32| {
            let t = t as usize;
            free[t] != Rgb::ZERO && (seen[t].seen() == Seen::Part || self.disagrees(seen, t as u32))
        };
        let mut wanted: Vec<u32> = (0..seen.len() as u32).into_par_iter().filter(is_edge).collect();
        let mut is_end = false;
        while !wanted.is_empty() {
            let chunk = |texels: &[u32]| {
                let mut cast = 0;
                let mut look = |&t: &u32| {
                    let mut look = seen[t as usize];
                    cast += self.at_texel(t, &mut look, free[t as usize], is_end);
                    look
                };
                let looked = texels.iter().map(&mut look).collect();
                self.rays.fetch_add(cast, Ordering::Relaxed);
                self.counter.advance(0).map(|()| looked)
            };
            let looked: Vec<Vec<Visibility>> = wanted.par_chunks(FEW).map(chunk).collect::<Result<_, Cancelled>>()?;
            wanted.iter().zip(looked.into_iter().flatten()).for_each(|(&t, look)| seen[t as usize] = look);
            wanted = self.ends(seen, &wanted);
            is_end = true;
        }
        Ok(())
    }

    /// What tries samples of the lamp from a texel until there are so many, and returns the rays that took.
    pub(super) fn tester(&self, texel: u32) -> Option<impl Fn(u32, &mut Visibility) -> u64> {
        let sender = self.lamps.get(self.lamp, &self.footprint.centre(texel))?;
        let (usable, aim) = (self.footprint.usable(texel), aim(sender, self.texels, self.footprint, texel));
        let seed = hash2(texel, self.lamp as u32);
        Some(move |count, seen: &mut Visibility| self.lamps.test(&aim, seed, count, |u| usable.point(u), seen))
    }

    /// Looks closer from a texel: at the end of a penumbra closer than beside one. Returns the rays cast.
    fn at_texel(&self, texel: u32, seen: &mut Visibility, free: Rgb, is_end: bool) -> u64 {
        let Some(test) = self.tester(texel) else { return 0 };
        let fewer = if self.is_shared(texel) { SPARED } else { 1 };
        let penumbra = |seen: &Visibility| (self.penumbra(texel, free, seen) / fewer).max(CLOSER * self.settings.base);
        let count = match seen.seen() {
            // Those around help to tell how much it is.
            Seen::Part => CLOSER * seen.tried / fewer,
            _ if is_end => penumbra(seen).min(self.settings.at_end()),
            _ => (CLOSER * seen.tried).max(penumbra(seen) / EDGE),
        };
        let mut cast = test(count, seen);
        if seen.seen() == Seen::Part {
            cast += test(penumbra(seen), seen);
        }
        cast
    }

    /// Rays of a texel that sees part of the lamp.
    pub(super) fn penumbra(&self, texel: u32, free: Rgb, seen: &Visibility) -> u32 {
        let around = yardstick(self.so_far[texel as usize] + free * seen.share(), self.mean);
        self.settings.penumbra(free.max_element(), around)
    }

    /// True if a texel puts what it sees of the lamp together with those around: through openings the sky is seen in part
    /// from all over a room.
    pub(super) fn is_shared(&self, texel: u32) -> bool {
        self.lamps.is_sky(self.lamp) && self.alike().is_shared(texel)
    }

    pub(super) fn alike(&self) -> Alike<'_> {
        Alike { atlas: self.atlas, texels: self.texels, footprint: self.footprint }
    }

    /// True if a neighbour on the same chart sees the lamp differently. Looking no farther than next door would leave many
    /// texels that see almost all of a lamp with the few rays that happened to miss what blocks it.
    fn disagrees(&self, seen: &[Visibility], texel: u32) -> bool {
        let own = seen[texel as usize].seen();
        around(self.atlas, self.texels, texel, AROUND).any(|n| seen[n as usize].seen() != own)
    }

    /// The texels next to where a penumbra that was `found` is about to end, as far as they seem to see all or nothing of
    /// the lamp.
    fn ends(&self, seen: &[Visibility], found: &[u32]) -> Vec<u32> {
        let beyond = |&t: &u32| {
            let look = &seen[t as usize];
            let share = look.share().max_element();
            let end = match look.seen() {
                Seen::Part if share > 1.0 - END => Some(Seen::Open),
                Seen::Part if share < END => Some(Seen::Blocked),
                _ => None,
            };
            let next = |n: &u32| end.is_some_and(|end| seen[*n as usize].seen() == end);
            around(self.atlas, self.texels, t, NEXT).filter(next).collect::<Vec<u32>>()
        };
        let mut ends: Vec<u32> = found.par_iter().flat_map_iter(beyond).collect();
        ends.par_sort_unstable();
        ends.dedup();
        ends
    }
}

/// The texels within `reach` on the same chart, with the texel itself.
fn around(atlas: &Atlas, texels: &Texels, texel: u32, reach: i64) -> impl Iterator<Item = u32> {
    let t = texel as usize;
    let chart = texels.chart[t] as usize;
    let range = &texels.charts[chart];
    let page = &texels.pages[atlas.charts[chart].page];
    let [x, y] = texels.pixel[t].map(i64::from);
    let span = move |at: i64, size: u32| (at - reach).max(0)..=(at + reach).min(i64::from(size) - 1);
    let rows = span(y, page.height);
    let places = rows.flat_map(move |y| span(x, page.width).map(move |x| (y * i64::from(page.width) + x) as usize));
    places.map(|place| page.texel[place]).filter(|&n| n != NO_TEXEL && range.contains(&n))
}
