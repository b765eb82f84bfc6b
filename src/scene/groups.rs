//! Light groups: which lamp, emissive surface and sky counts as which, so that their light can be kept apart.

use super::{Environment, Instance, Scene};

/// Most groups that light is kept apart by.
pub const MOST_GROUPS: usize = 32;

/// Group of what is left where there would be more than [`MOST_GROUPS`].
const OTHERS: &str = "others";

/// Number of a light group.
pub type Group = u16;

/// The groups of a scene's lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightGroups {
    /// Names, by number.
    names: Vec<String>,
    /// Names that share the last group because there were too many.
    merged: Vec<String>,
    /// Group of every lamp.
    lights: Vec<Group>,
    /// Group of every primitive's emission, per instance.
    emitters: Vec<Vec<Group>>,
    /// Group of the sky.
    environment: Group,
}

impl LightGroups {
    /// Name of the sky's group.
    pub const ENVIRONMENT: &'static str = "environment";

    /// Number of the lamps' group where they are [kept apart](Self::of_lamps).
    pub const LAMPS: Group = 0;

    /// No groups: all light is one.
    pub fn none(scene: &Scene) -> Self {
        Self::new(scene, |_| 0)
    }

    /// Two groups: that of all lamps, [`Self::LAMPS`], and one of sky and emissive surfaces.
    pub fn of_lamps(scene: &Scene) -> Self {
        let rest = Self::LAMPS + 1;
        let mut groups = Self::none(scene);
        groups.names = vec!["lamps".into(), "rest".into()];
        groups.emitters.iter_mut().flatten().for_each(|group| *group = rest);
        groups.environment = rest;
        groups
    }

    /// Groups as the scene names them. Lamps without a group are called by their own name, emissive surfaces without one
    /// `material:` and the name of their material.
    pub fn named(scene: &Scene) -> Self {
        let (mut names, mut merged) = (Vec::<String>::new(), Vec::<String>::new());
        let keys = Self::keys(scene);
        let too_many = keys.len() > MOST_GROUPS;
        for key in keys {
            if too_many && names.len() + 1 >= MOST_GROUPS { merged.push(key) } else { names.push(key) }
        }
        if too_many {
            names.push(OTHERS.into());
        }
        let last = names.len().saturating_sub(1);
        let number = |key: &str| names.iter().position(|name| name == key).unwrap_or(last) as Group;
        let groups = Self::new(scene, number);
        Self { names, merged, ..groups }
    }

    fn new(scene: &Scene, number: impl Fn(&str) -> Group) -> Self {
        let emitter = |instance: &Instance, material: usize| number(&emitter_key(scene, instance, material));
        let of_instance =
            |i: &Instance| scene.meshes[i.mesh].primitives.iter().map(|p| emitter(i, p.material)).collect::<Vec<_>>();
        Self {
            names: Vec::new(),
            merged: Vec::new(),
            lights: scene.lights.iter().map(|l| number(l.group.as_ref().unwrap_or(&l.name))).collect(),
            emitters: scene.instances.iter().map(of_instance).collect(),
            environment: number(Self::ENVIRONMENT),
        }
    }

    /// Names of all groups of the scene: sky, lamps, emissive surfaces, each as it first occurs.
    fn keys(scene: &Scene) -> Vec<String> {
        let sky = (scene.environment != Environment::Black).then(|| Self::ENVIRONMENT.to_owned());
        let lamps = scene.lights.iter().map(|l| l.group.as_ref().unwrap_or(&l.name).clone());
        let emitters = scene.instances.iter().flat_map(|i| {
            let materials = scene.meshes[i.mesh].primitives.iter().map(|p| p.material);
            materials.filter(|&m| scene.materials[m].emits()).map(|m| emitter_key(scene, i, m))
        });
        let mut keys = Vec::new();
        for key in sky.into_iter().chain(lamps).chain(emitters) {
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        keys
    }

    /// Number of groups, zero if light is not kept apart.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// True if light is not kept apart.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Names, by number.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Names of lights that share the last group because there were too many.
    pub fn merged(&self) -> &[String] {
        &self.merged
    }

    /// Group of lamp `index` of the scene.
    pub fn of_light(&self, index: usize) -> Group {
        self.lights[index]
    }

    /// Group of what a primitive of an instance emits.
    pub fn of_emitter(&self, instance: usize, primitive: usize) -> Group {
        self.emitters[instance][primitive]
    }

    /// Group of the sky.
    pub fn of_environment(&self) -> Group {
        self.environment
    }
}

fn emitter_key(scene: &Scene, instance: &Instance, material: usize) -> String {
    instance.group.clone().unwrap_or_else(|| format!("material:{}", scene.materials[material].name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Light, LightShape, Rgb};
    use glam::Vec3;

    fn lamp(name: String, group: Option<&str>) -> Light {
        Light {
            path: name.clone(),
            name,
            group: group.map(str::to_owned),
            casts_shadows: true,
            position: Vec3::ZERO,
            axes: [Vec3::X, Vec3::Y, Vec3::Z],
            shape: LightShape::Point { intensity: Rgb::ONE, radius: 0.0 },
            profile: None,
            faces_receivers: false,
        }
    }

    #[test]
    fn lamps_go_by_their_group_or_name() {
        let lights = vec![lamp("a".into(), Some("ceiling")), lamp("b".into(), None), lamp("c".into(), Some("ceiling"))];
        let scene = Scene { lights, environment: Environment::Constant(Rgb::ONE), ..Scene::default() };
        let groups = LightGroups::named(&scene);
        assert_eq!(groups.names(), ["environment", "ceiling", "b"]);
        assert_eq!([0, 1, 2].map(|i| groups.of_light(i)), [1, 2, 1]);
        assert!(LightGroups::none(&scene).is_empty());
        let apart = LightGroups::of_lamps(&scene);
        assert_eq!((apart.of_light(2), apart.of_environment()), (LightGroups::LAMPS, 1));
    }

    #[test]
    fn what_is_too_much_shares_the_last_group() {
        let count = MOST_GROUPS + 3;
        let scene = Scene { lights: (0..count).map(|i| lamp(format!("lamp {i}"), None)).collect(), ..Scene::default() };
        let groups = LightGroups::named(&scene);
        assert_eq!((groups.len(), groups.merged().len()), (MOST_GROUPS, 4));
        assert_eq!(groups.of_light(count - 1) as usize, MOST_GROUPS - 1);
        assert_eq!(groups.names().last().map(String::as_str), Some("others"));
    }
}
