//! From light per group to files: a page for every group, and the solution that relighting starts from.

use super::BakeError;
use super::light::TexelPatches;
use super::results::{Subject, lit_scene_name};
use crate::atlas::PageImage;
use crate::gather::Lightmap;
use crate::output::OutputSet;
use crate::output::exr::{PageAttributes, write_page};
use crate::output::report::{GroupFacts, PageFacts, Report};
use crate::post;
use crate::progress::Progress;
use crate::relight::{GroupPage, Header, Known, PageLayout, SolutionWriter};
use crate::scene::{LightGroups, Rgb};
use crate::units::Quantity;
use crate::warning::Warning;
use half::f16;
use serde_json::json;

/// File name of the solution.
pub(super) const SOLUTION: &str = "solution.lk";

/// What groups are made of.
pub(super) struct GroupedLight<'a> {
    pub(super) subject: &'a Subject<'a>,
    pub(super) groups: &'a LightGroups,
    pub(super) lightmap: &'a Lightmap,
    pub(super) patches: &'a TexelPatches,
}

/// The part of a group's file names that tells it from the others: letters, digits, `-` and `_`.
pub(super) fn file_labels(names: &[String]) -> Vec<String> {
    let mut labels: Vec<String> = Vec::new();
    for name in names {
        let plain: String = name.chars().map(|c| if c.is_alphanumeric() || c == '-' { c } else { '_' }).collect();
        // Batches call mip-mapped pages so, and some file systems know no case.
        let is_free = |label: &str, taken: &[String]| {
            label != "mip" && !label.is_empty() && !taken.iter().any(|l| l.to_lowercase() == label.to_lowercase())
        };
        let numbered = (2..).map(|n| format!("{plain}_{n}"));
        let label = std::iter::once(plain.clone()).chain(numbered).find(|label| is_free(label, &labels));
        labels.push(label.expect("numbers do not end"));
    }
    labels
}

impl GroupedLight<'_> {
    /// Writes the pages of every group and the solution, still under temporary names, and tells the report. A solution that
    /// cannot be written, for want of space, is left out with a warning: the lightmap is not lost for it.
    pub(super) fn write(
        &self,
        outputs: &mut OutputSet,
        report: &mut Report,
        progress: &dyn Progress,
    ) -> Result<(), BakeError> {
        let Subject { scene, atlas, texels, settings, hash, .. } = *self.subject;
        let usable = &self.lightmap.usable;
        let names = self.groups.names();
        let header = self.header(report);
        let mut writer = SolutionWriter::new(&header, &self.patches.patches);
        let mut whole = self.lightmap.combined.clone();
        post::fill_unusable(atlas, texels, &mut whole, usable);
        for (g, label) in file_labels(names).iter().enumerate() {
            let mut part = self.lightmap.groups.group(g);
            post::fill_unusable(atlas, texels, &mut part, usable);
            let mut part = post::finish_part(atlas, texels, scene, (&whole, &part), &settings.post, progress)?;
            let layouts: Vec<PageLayout> = (0..part.pages.len()).map(|k| self.layout(k, &part.filled[k])).collect();
            if g == 0 {
                layouts.iter().for_each(|layout| writer.page(layout));
            }
            for (k, layout) in layouts.iter().enumerate() {
                writer.group_page(&self.group_page(g, k, &part.pages[k], layout));
            }
            post::fill_borders(&mut part.pages, &mut part.filled, header.rings, progress)?;
            let pages = post::convert(&part.pages, atlas, texels, header.quantity, &settings.post);
            let mut files = Vec::new();
            for (page, image) in pages.iter().enumerate() {
                let file = OutputSet::group_page_name(page, label);
                let (quantity, group) = (header.quantity, Some(names[g].clone()));
                let (scene_hash, state) = (hash.to_owned(), report.state);
                let attributes = PageAttributes { quantity, uv_set: 1, page, scene_hash, state, group };
                outputs.write(&file, |sink| write_page(sink, image, settings.output.precision, &attributes))?;
                files.push(PageFacts::of(file, image));
            }
            report.groups.push(GroupFacts { name: names[g].clone(), lights: header.known.lights_of(g), pages: files });
        }
        let solution = writer.finish();
        if let Err(error) = outputs.write_if_possible(SOLUTION, |sink| sink.write_all(&solution)) {
            let message = format!("{:#}; the lightmap is whole, but cannot be relit", anyhow::Error::from(error));
            let warning = Warning::new("no_solution", SOLUTION, message);
            progress.warn(&warning);
            report.warnings.push(warning);
        }
        Ok(())
    }

    fn header(&self, report: &Report) -> Header {
        let Subject { scene, atlas, settings, path, .. } = *self.subject;
        Header {
            version: report.version.into(),
            scene_hash: report.scene.hash.clone(),
            report: json!({
                "scene": report.scene, "settings": report.settings, "atlas": report.atlas, "state": report.state
            }),
            settings: json!(settings),
            lit_scene: lit_scene_name(path),
            quantity: settings.output.quantity,
            rings: settings.post.rings(atlas),
            known: Known::of(scene, self.groups, &self.mean_reflectance(), &report.warnings),
        }
    }

    /// Mean reflectance of every material over its texels; where it has none, its plain colour.
    fn mean_reflectance(&self) -> Vec<Rgb> {
        let Subject { scene, atlas, texels, .. } = *self.subject;
        let mut sums = vec![(Rgb::ZERO, 0.0); scene.materials.len()];
        for t in 0..texels.len() {
            let sum = &mut sums[texels.material(scene, atlas, t as u32)];
            sum.0 += texels.reflectance[t] * texels.area[t];
            sum.1 += texels.area[t];
        }
        let plain = scene.materials.iter().map(|m| m.base_color * (1.0 - m.metallic) * (1.0 - m.transmission));
        sums.into_iter().zip(plain).map(|((sum, area), plain)| if area > 0.0 { sum / area } else { plain }).collect()
    }

    fn layout(&self, page: usize, filled: &[bool]) -> PageLayout {
        let Subject { scene, atlas, texels, settings, .. } = *self.subject;
        let patch_of = |t: u32| self.patches.of_texel[t as usize];
        let layout = PageLayout::new(atlas, texels, page, filled, patch_of);
        match settings.output.quantity {
            Quantity::Radiosity => layout.with_reflectance(scene, atlas, texels, page),
            _ => layout,
        }
    }

    /// What the solution holds of a group's page.
    fn group_page(&self, group: usize, page: usize, image: &PageImage, layout: &PageLayout) -> GroupPage {
        let largest = Rgb::splat(f16::MAX.to_f32());
        let map = &self.subject.texels.pages[page].texel;
        let direct = |&place: &u32| {
            let Some(texel) = PageLayout::nearest(map, layout.width, layout.height, place) else { return [0; 3] };
            let (all, direct) =
                (self.lightmap.groups.of(texel as usize), self.lightmap.direct_groups.of(texel as usize));
            let share = direct[group] / all[group].max(Rgb::splat(f32::MIN_POSITIVE));
            share.to_array().map(|s| (255.0 * s.clamp(0.0, 1.0)).round() as u8)
        };
        let value = |&place: &u32| image.rgb[place as usize].min(largest).to_array().map(f16::from_f32);
        GroupPage {
            irradiance: layout.places.iter().map(value).collect(),
            direct: layout.places.iter().map(direct).collect(),
        }
    }
}

/// Says that lights share a group because there were too many.
pub(super) fn too_many(groups: &LightGroups) -> Option<Warning> {
    let merged = groups.merged();
    let message = || {
        let names = merged.iter().take(3).map(String::as_str).collect::<Vec<_>>().join("`, `");
        format!(
            "{} lights beginning with `{names}` share one light group, for there are more than {}: name their groups",
            merged.len(),
            crate::scene::MOST_GROUPS
        )
    };
    (!merged.is_empty()).then(|| Warning::new("groups_merged", "light groups", message()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_safe_and_differ() {
        let names = ["Key", "material:Screen", "key", "../x", "mip", "Süd 1"].map(str::to_owned);
        assert_eq!(file_labels(&names), ["Key", "material_Screen", "key_2", "___x", "mip_2", "Süd_1"]);
    }
}
