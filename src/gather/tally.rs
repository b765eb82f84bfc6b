//! Keeps light apart by group while paths are followed: values per item and group, and what takes down a path's light.
//!
//! Everything that decides where rays go looks at the whole. Groups only add up beside it, so that a bake with groups
//! casts the same rays and gives the same whole as one without.

use crate::scene::{Group, MOST_GROUPS, Rgb};
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// One value per item and light group; those of an item stand side by side. Holds nothing where light is not kept apart.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Grouped {
    groups: usize,
    values: Vec<Rgb>,
}

impl Grouped {
    /// Zeros for `items` items.
    pub fn new(groups: usize, items: usize) -> Self {
        Self { groups, values: vec![Rgb::ZERO; groups * items] }
    }

    /// Number of groups, zero if light is not kept apart.
    pub fn groups(&self) -> usize {
        self.groups
    }

    /// All values, item by item.
    pub fn values(&self) -> &[Rgb] {
        &self.values
    }

    /// The groups' values of one item.
    pub fn of(&self, item: usize) -> &[Rgb] {
        &self.values[item * self.groups..(item + 1) * self.groups]
    }

    /// The same, to be changed.
    pub fn of_mut(&mut self, item: usize) -> &mut [Rgb] {
        &mut self.values[item * self.groups..(item + 1) * self.groups]
    }

    /// The groups' values of each of all `items`, to be changed side by side.
    pub fn rows_mut(&mut self, items: usize) -> Vec<&mut [Rgb]> {
        let (mut rest, groups) = (self.values.as_mut_slice(), self.groups);
        let row = |_| {
            let (row, more) = std::mem::take(&mut rest).split_at_mut(groups);
            rest = more;
            row
        };
        (0..items).map(row).collect()
    }

    /// The same for more or fewer items; those that are new are zero.
    pub(super) fn resized(mut self, items: usize) -> Self {
        self.values.resize(items * self.groups, Rgb::ZERO);
        self
    }

    /// From the values of all items, group by group.
    pub fn from_groups(columns: &[Vec<Rgb>]) -> Self {
        let items = columns.first().map_or(0, Vec::len);
        let values = (0..items).flat_map(|i| columns.iter().map(move |column| column[i])).collect();
        Self { groups: columns.len(), values }
    }

    /// Sum of all values and channels.
    pub fn total(&self) -> f32 {
        self.values.iter().map(|v| v.element_sum()).sum()
    }

    /// The values of one group.
    pub fn group(&self, group: usize) -> Vec<Rgb> {
        self.values.iter().skip(group).step_by(self.groups.max(1)).copied().collect()
    }

    /// Adds one value per item to a group.
    pub(super) fn add(&mut self, group: Group, part: &[Rgb]) {
        if self.groups > 0 {
            let rows = self.values.par_chunks_mut(self.groups);
            rows.zip(part).for_each(|(row, &value)| row[usize::from(group)] += value);
        }
    }

    /// Adds value by value.
    pub fn add_all(&mut self, other: &Self) {
        self.values.par_iter_mut().zip(&other.values).for_each(|(a, &b)| *a += b);
    }
}

/// Makes `groups` add up to `whole`, as they do but for rounding.
pub(super) fn share_out(whole: Rgb, groups: &mut [Rgb]) {
    groups.iter_mut().for_each(|g| *g = g.max(Rgb::ZERO));
    let sum: Rgb = groups.iter().sum();
    let scale = Rgb::from_array(std::array::from_fn(|c| if sum[c] > 0.0 { whole[c] / sum[c] } else { 0.0 }));
    groups.iter_mut().for_each(|g| *g *= scale);
}

/// Takes down, by group, what a path brings.
pub(super) trait Tally {
    /// False: nothing is taken down, and nothing need be looked up for it.
    const COUNTS: bool;

    /// Light of one group.
    fn add(&mut self, group: Group, light: Rgb);

    /// What a place reflects of every group, times `weight`.
    fn reflected(&mut self, weight: Rgb, groups: &[[f16; 3]]);

    /// What lamps of every group bring to a place, times `weight`.
    fn lit(&mut self, weight: Rgb, groups: &[Rgb]);
}

/// Where light is not kept apart.
impl Tally for () {
    const COUNTS: bool = false;

    fn add(&mut self, _: Group, _: Rgb) {}

    fn reflected(&mut self, _: Rgb, _: &[[f16; 3]]) {}

    fn lit(&mut self, _: Rgb, _: &[Rgb]) {}
}

/// Sums per group.
pub(super) struct Sums<'a>(pub(super) &'a mut [Rgb]);

impl Tally for Sums<'_> {
    const COUNTS: bool = true;

    fn add(&mut self, group: Group, light: Rgb) {
        self.0[usize::from(group)] += light;
    }

    fn reflected(&mut self, weight: Rgb, groups: &[[f16; 3]]) {
        // Together: one by one, halves are slow to convert.
        let mut values = [0.0; 3 * MOST_GROUPS];
        let values = &mut values[..3 * groups.len()];
        groups.as_flattened().convert_to_f32_slice(values);
        for (sum, value) in self.0.iter_mut().zip(values.chunks_exact(3)) {
            *sum += weight * Rgb::from_slice(value);
        }
    }

    fn lit(&mut self, weight: Rgb, groups: &[Rgb]) {
        for (sum, &value) in self.0.iter_mut().zip(groups) {
            *sum += weight * value;
        }
    }
}

/// Sums per group, what is reflected apart from what comes straight from sky and emissive surfaces.
pub(super) struct Origins<'a> {
    /// From sky and emissive surfaces.
    pub(super) own: Sums<'a>,
    /// From what reflects.
    pub(super) reflected: Sums<'a>,
}

impl Origins<'_> {
    /// Multiplies all sums.
    pub(super) fn scale(&mut self, factor: f32) {
        self.own.0.iter_mut().chain(self.reflected.0.iter_mut()).for_each(|sum| *sum *= factor);
    }
}

impl Tally for Origins<'_> {
    const COUNTS: bool = true;

    fn add(&mut self, group: Group, light: Rgb) {
        self.own.add(group, light);
    }

    fn reflected(&mut self, weight: Rgb, groups: &[[f16; 3]]) {
        self.reflected.reflected(weight, groups);
    }

    fn lit(&mut self, weight: Rgb, groups: &[Rgb]) {
        self.reflected.lit(weight, groups);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_shared_out_adds_up() {
        let mut groups = [Rgb::new(1.0, 2.0, 0.0), Rgb::new(2.0, -0.5, 0.0)];
        share_out(Rgb::new(3.3, 1.0, 0.0), &mut groups);
        assert!((groups[0] - Rgb::new(1.1, 1.0, 0.0)).length() < 1e-6, "{}", groups[0]);
        assert!((groups[1] - Rgb::new(2.2, 0.0, 0.0)).length() < 1e-6, "{}", groups[1]);
    }

    #[test]
    fn sums_weigh_halves_and_floats_alike() {
        let row = [Rgb::new(0.5, 0.25, 2.0), Rgb::ONE];
        let halves = row.map(|v| v.to_array().map(f16::from_f32));
        let (mut a, mut b) = ([Rgb::ZERO; 2], [Rgb::ZERO; 2]);
        Sums(&mut a).reflected(Rgb::splat(3.0), &halves);
        Sums(&mut b).lit(Rgb::splat(3.0), &row);
        assert_eq!(a, b);
        assert_eq!(a[0], 3.0 * row[0]);
    }
}
