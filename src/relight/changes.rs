//! Changes of light and reflectance: `NAME=VALUE` as people write it → factors per light group and material.

use super::Known;
use crate::scene::{MAX_REFLECTANCE, Rgb};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// Names that are listed when one is unknown.
const NEAREST: usize = 3;

/// A change as it was written: `Key=2`, `Sun.color=1,0.8,0.6`, `material:Wall.reflectance=0.4`.
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// What stands before the equals sign.
    pub key: String,
    /// What stands behind it: one number for all channels, or one for each.
    pub value: Rgb,
}

impl fmt::Display for Assignment {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [r, g, b] = self.value.to_array();
        if r == g && g == b { write!(f, "{}={r}", self.key) } else { write!(f, "{}={r},{g},{b}", self.key) }
    }
}

impl FromStr for Assignment {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let fault = "write NAME=2, NAME=r,g,b, NAME.color=r,g,b or material:NAME.reflectance=r,g,b";
        let (key, value) = text.rsplit_once('=').ok_or_else(|| format!("`{text}` has no `=`: {fault}"))?;
        let numbers: Option<Vec<f32>> = value.split(',').map(|n| n.trim().parse().ok()).collect();
        let value = match numbers.as_deref() {
            Some(&[all]) => Rgb::splat(all),
            Some(&[r, g, b]) => Rgb::new(r, g, b),
            _ => return Err(format!("`{value}` is neither a number nor three with commas between: {fault}")),
        };
        if !(value.is_finite() && value.min_element() >= 0.0) {
            return Err(format!("`{text}`: numbers must be finite and not negative"));
        }
        match key.trim() {
            "" => Err(format!("`{text}` names nothing: {fault}")),
            key => Ok(Self { key: key.into(), value }),
        }
    }
}

/// Why a change cannot be made.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ChangeError {
    /// There is no such light or material.
    #[error("there is no light or material `{key}` in this bake; {nearest}")]
    Unknown {
        /// The name.
        key: String,
        /// Those that are most like it.
        nearest: String,
    },
    /// The light has no group of its own.
    #[error(
        "`{key}` was baked as part of the group `{group}` with other lights; change that, or bake it in a group of its own"
    )]
    Part {
        /// The light.
        key: String,
        /// The group.
        group: String,
    },
    /// It gave no light when it was baked.
    #[error("`{0}` gave no light when it was baked, and no factor turns that on; bake the scene again with it on")]
    Dark(String),
    /// The channel had no light when it was baked.
    #[error(
        "`{0}` gave no light in one of the channels that the new colour has; bake the scene again with that colour"
    )]
    DarkChannel(String),
    /// There is no colour to replace.
    #[error("`{0}` has lights of several colours or a textured one; tint it with `{0}=r,g,b`, which multiplies")]
    NoColor(String),
    /// A black colour has no hue.
    #[error("the colour of `{0}` must have a channel above zero; switch it off with `{0}=0`")]
    BlackColor(String),
    /// Only materials reflect.
    #[error("`{0}` is no material, and only materials have a reflectance: write material:NAME.reflectance")]
    NoSurface(String),
    /// More than all light would be reflected.
    #[error("the reflectance of `{0}` must lie between 0 and {MAX_REFLECTANCE}")]
    Reflectance(String),
    /// Black surfaces sent nothing that could be scaled.
    #[error("`{0}` reflected nothing when it was baked, and no factor changes that; bake the scene again")]
    Black(String),
    /// The same thing was set twice.
    #[error("`{0}` is set twice")]
    Twice(String),
}

/// By what everything is multiplied.
#[derive(Clone, Debug, PartialEq)]
pub struct Changes {
    /// Per light group.
    pub light: Vec<Rgb>,
    /// Per material: its reflectance.
    pub reflectance: Vec<Rgb>,
}

impl Changes {
    /// What the assignments mean for a bake that knows these names. They are relative to the bake.
    pub fn resolve(assignments: &[Assignment], known: &Known) -> Result<Self, ChangeError> {
        let mut changes =
            Self { light: vec![Rgb::ONE; known.groups.len()], reflectance: vec![Rgb::ONE; known.materials.len()] };
        let mut seen = Vec::new();
        for Assignment { key, value } in assignments {
            if seen.contains(&key) {
                return Err(ChangeError::Twice(key.clone()));
            }
            seen.push(key);
            changes.apply(key, *value, known)?;
        }
        Ok(changes)
    }

    /// True if surfaces reflect as they did.
    pub fn keeps_reflectance(&self) -> bool {
        self.reflectance.iter().all(|&r| r == Rgb::ONE)
    }

    fn apply(&mut self, key: &str, value: Rgb, known: &Known) -> Result<(), ChangeError> {
        // A name may itself end like one of the properties.
        if !known.has_light(key) {
            if let Some(name) = key.strip_suffix(".reflectance") {
                return self.reflect(name, value, known);
            }
            if let Some(name) = key.strip_suffix(".color") {
                let group = known.group(name)?;
                self.light[group] *= recolor(name, value, known.groups[group].color)?;
                return Ok(());
            }
            if let Some(name) = key.strip_suffix(".power") {
                self.light[known.group(name)?] *= value;
                return Ok(());
            }
        }
        self.light[known.group(key)?] *= value;
        Ok(())
    }

    fn reflect(&mut self, name: &str, value: Rgb, known: &Known) -> Result<(), ChangeError> {
        let Some(material) = name.strip_prefix("material:") else {
            return Err(if known.has_light(name) { ChangeError::NoSurface(name.into()) } else { known.unknown(name) });
        };
        if value.max_element() > MAX_REFLECTANCE {
            return Err(ChangeError::Reflectance(name.into()));
        }
        let of_name = || known.materials.iter().enumerate().filter(|(_, m)| m.name == material);
        if of_name().next().is_none() {
            return Err(known.unknown(name));
        }
        for (i, m) in of_name() {
            let before = Rgb::from_array(m.reflectance);
            if (0..3).any(|c| before[c] <= 0.0 && value[c] > 0.0) {
                return Err(ChangeError::Black(name.into()));
            }
            self.reflectance[i] = ratio(value, before);
        }
        Ok(())
    }
}

/// The factor that gives lights of colour `before` the colour `after`, the strongest channel as strong as before.
fn recolor(name: &str, after: Rgb, before: Option<[f32; 3]>) -> Result<Rgb, ChangeError> {
    let Some(before) = before.map(Rgb::from_array) else { return Err(ChangeError::NoColor(name.into())) };
    if after.max_element() <= 0.0 {
        return Err(ChangeError::BlackColor(name.into()));
    }
    if (0..3).any(|c| before[c] <= 0.0 && after[c] > 0.0) {
        return Err(ChangeError::DarkChannel(name.into()));
    }
    Ok(ratio(after / after.max_element(), before))
}

/// Quotient per channel, zero where there was nothing.
fn ratio(after: Rgb, before: Rgb) -> Rgb {
    Rgb::from_array(std::array::from_fn(|c| if before[c] > 0.0 { after[c] / before[c] } else { 0.0 }))
}

impl Known {
    /// True if a group or a light has this name.
    fn has_light(&self, name: &str) -> bool {
        self.groups.iter().any(|g| g.name == name) || self.lights.iter().any(|(light, _)| light == name)
    }

    /// Number of the group that is meant by a name: its own, or that of its only light.
    fn group(&self, name: &str) -> Result<usize, ChangeError> {
        if let Some(group) = self.groups.iter().position(|g| g.name == name) {
            return Ok(group);
        }
        if let Some(&(_, group)) = self.lights.iter().find(|(light, _)| light == name) {
            let alone = self.lights.iter().all(|(light, g)| *g != group || light == name);
            let part = || ChangeError::Part { key: name.into(), group: self.groups[group].name.clone() };
            return if alone { Ok(group) } else { Err(part()) };
        }
        let is_dark = |path: &String| path == name || path.rsplit('/').next() == Some(name);
        let is_material = |material: &str| self.materials.iter().any(|m| m.name == material);
        if self.dark.iter().any(is_dark) || name.strip_prefix("material:").is_some_and(is_material) {
            return Err(ChangeError::Dark(name.into()));
        }
        Err(self.unknown(name))
    }

    /// The error that names what is most like `name`.
    fn unknown(&self, name: &str) -> ChangeError {
        let materials = self.materials.iter().map(|m| format!("material:{}", m.name));
        let groups = self.groups.iter().map(|g| g.name.clone());
        let mut names: Vec<String> =
            groups.chain(self.lights.iter().map(|(light, _)| light.clone())).chain(materials).collect();
        names.sort();
        names.dedup();
        let likeness = |other: &String| strsim::jaro_winkler(&name.to_lowercase(), &other.to_lowercase());
        names.sort_by(|a, b| likeness(b).total_cmp(&likeness(a)));
        names.truncate(NEAREST);
        let nearest = match names.is_empty() {
            true => "it has none".into(),
            false => format!("the nearest names are `{}`", names.join("`, `")),
        };
        ChangeError::Unknown { key: name.into(), nearest }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{KnownGroup, KnownMaterial};
    use super::*;

    fn known() -> Known {
        let group = |name: &str, color| KnownGroup { name: name.into(), color };
        let material = |name: &str, r| KnownMaterial { name: name.into(), reflectance: [r; 3] };
        Known {
            groups: vec![
                group("Key", Some([1.0, 0.5, 0.0])),
                group("Ceiling", Some([1.0; 3])),
                group("material:Screen", None),
            ],
            lights: vec![("Key".into(), 0), ("Left".into(), 1), ("Right".into(), 1), ("material:Screen".into(), 2)],
            materials: vec![material("Wall", 0.8), material("Screen", 0.0)],
            dark: vec!["Hall/Torch".into()],
        }
    }

    fn resolved(texts: &[&str]) -> Result<Changes, ChangeError> {
        let assignments: Vec<Assignment> = texts.iter().map(|t| t.parse().expect("it is well-formed")).collect();
        Changes::resolve(&assignments, &known())
    }

    #[test]
    fn factors_colours_and_reflectances() {
        let c = resolved(&["Key=2", "Key.color=0.5,0.5,0", "Ceiling.power=0.5", "material:Wall.reflectance=0.4"]);
        let c = c.expect("all names are known");
        assert_eq!(c.light, [Rgb::new(2.0, 4.0, 0.0), Rgb::splat(0.5), Rgb::ONE]);
        assert_eq!(c.reflectance, [Rgb::splat(0.5), Rgb::ONE]);
        assert_eq!(resolved(&["material:Screen=0"]).expect("known").light[2], Rgb::ZERO);
        assert!(resolved(&[]).expect("nothing to fail").keeps_reflectance());
    }

    #[test]
    fn what_cannot_be_is_named() {
        let fault = |text| resolved(&[text]).expect_err(text);
        let text = fault("key=2").to_string();
        assert!(text.contains("`key`") && text.contains("nearest names are `Key`"), "{text}");
        assert!(matches!(fault("Left=2"), ChangeError::Part { .. }));
        assert!(matches!(fault("Torch=2"), ChangeError::Dark(_)));
        assert!(matches!(fault("material:Wall=2"), ChangeError::Dark(_)));
        assert!(matches!(fault("Key.color=1,1,1"), ChangeError::DarkChannel(_)));
        assert!(matches!(fault("Ceiling.color=0"), ChangeError::BlackColor(_)));
        assert!(matches!(fault("material:Screen.color=1,0,0"), ChangeError::NoColor(_)));
        assert!(matches!(fault("Key.reflectance=0.5"), ChangeError::NoSurface(_)));
        assert!(matches!(fault("material:Wall.reflectance=1"), ChangeError::Reflectance(_)));
        assert!(matches!(fault("material:Screen.reflectance=0.5"), ChangeError::Black(_)));
        assert!(matches!(fault("material:Wull.reflectance=0.5"), ChangeError::Unknown { .. }));
        assert!(matches!(resolved(&["Key=2", "Key=3"]), Err(ChangeError::Twice(_))));
    }

    #[test]
    fn only_names_with_numbers_are_read() {
        for wrong in ["Key", "=2", "Key=", "Key=1,2", "Key=-1", "Key=NaN", "Key=inf", "Key=two"] {
            assert!(wrong.parse::<Assignment>().is_err(), "{wrong}");
        }
        assert_eq!("a=b=0.5".parse(), Ok(Assignment { key: "a=b".into(), value: Rgb::splat(0.5) }));
    }
}
