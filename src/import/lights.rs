//! Lamps: LIGHTKILN_scene, KHR_lights_punctual, EXT_lights_area and EXT_lights_ies → lamps in world space, in
//! radiometric units.

use super::nodes::PlacedNode;
use super::profiles::Profiles;
use super::{EXTENSION, json};
use crate::document::Document;
use crate::scene::{Falloff, Light, LightShape, Profile, Rgb};
use crate::units::{LUMENS_PER_WATT, LightUnits};
use crate::warning::Warning;
use glam::Vec3;
use serde_json::Value;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::sync::Arc;

/// Lamps of the placed nodes.
pub(super) fn load(
    document: &Document,
    nodes: &[PlacedNode],
    units: LightUnits,
    warnings: &mut Vec<Warning>,
) -> Vec<Light> {
    let mut profiles = Profiles::default();
    nodes.iter().filter_map(|node| load_one(document, node, units, &mut profiles, warnings)).collect()
}

/// Extensions that define lamps, the most exact first: a node that has several is lit by the first only.
const KINDS: [(&str, Parser); 4] =
    [(EXTENSION, own), (AREA, area), (MEASURED, measured), ("KHR_lights_punctual", punctual)];

const AREA: &str = "EXT_lights_area";
const MEASURED: &str = "EXT_lights_ies";

/// Definition → shape with the sizes of the file; `None` for a type it does not know.
type Parser = fn(&mut Reader) -> Option<LightShape>;

fn load_one(
    document: &Document,
    node: &PlacedNode,
    units: LightUnits,
    profiles: &mut Profiles,
    warnings: &mut Vec<Warning>,
) -> Option<Light> {
    let (extension, parse, instance) = KINDS
        .iter()
        .filter_map(|(name, parse)| Some((*name, parse, document.extension("nodes", node.node, name)?)))
        .find(|(.., instance)| instance.get("light").is_some())?;
    let reference = &instance["light"];
    let definitions = document.root_extension(extension).and_then(|e| e.get("lights")).and_then(Value::as_array);
    let definition = reference.as_u64().and_then(|i| definitions?.get(usize::try_from(i).ok()?));
    let Some(definition) = definition else {
        let message = format!("lamp: {extension} has no light {reference}; the lamp is skipped, export the file again");
        warnings.push(Warning::new("missing_light", node.path.as_str(), message));
        return None;
    };

    let factor = units.to_radiometric();
    let mut reader = Reader { definition, instance, factor, faults: Vec::new() };
    // The draft scales areas evenly, the contract along each axis.
    let even = extension == AREA;
    let shape = parse(&mut reader).map(|shape| scaled(shape, node, even));
    let faults = std::mem::take(&mut reader.faults);
    warnings.extend(faults.into_iter().map(|fault| {
        Warning::new("light_value", node.path.as_str(), format!("lamp: {fault}; correct it in the source file"))
    }));
    let Some(mut shape) = shape else {
        let kind = json::string(definition, "type").unwrap_or("none");
        let message = format!("lamp: its type `{kind}` is unknown; the lamp is skipped, use one of the standard types");
        warnings.push(Warning::new("unknown_light", node.path.as_str(), message));
        return None;
    };
    let source = if extension == MEASURED { Some(definition) } else { definition.get("ies") };
    let profile = match source {
        Some(source) => measure(document, source, extension, &mut shape, node, profiles, warnings)?,
        None => None,
    };
    if let Some(reason) = dark(&shape) {
        let message = format!("lamp: its {reason} is zero, so it gives no light and is skipped; raise it or remove it");
        warnings.push(Warning::new("dark_light", node.path.as_str(), message));
        return None;
    }
    if node.world.matrix3.determinant() == 0.0 && !matches!(shape, LightShape::Point { .. }) {
        let message = "lamp: its node is scaled to nothing, so its direction is a guess; give the node a scale";
        warnings.push(Warning::new("zero_scale", node.path.as_str(), message));
    }
    let group = json::string(definition, "group").map(str::to_owned);
    let casts = json::boolean(definition, "castsShadows");
    Some(Light {
        name: json::string(definition, "name").unwrap_or(&node.path).to_owned(),
        path: node.path.clone(),
        // What the node or its ancestors say is nearer to the user than the shared definition.
        group: node.settings.group.clone().or(group),
        casts_shadows: node.settings.casts_shadows.or(casts).unwrap_or(true),
        position: node.world.translation.as_vec3(),
        axes: profile_frame(source, frame(node)),
        shape,
        profile,
        faces_receivers: json::boolean(definition, "softFalloff") == Some(true),
    })
}

/// The frame that a profile is measured in. Blender's zero plane is on −Y and its planes are counted clockwise.
fn profile_frame(source: Option<&Value>, [x, y, z]: [Vec3; 3]) -> [Vec3; 3] {
    match source.and_then(|source| json::string(source, "frame")) {
        Some("blender") => [-y, -x, z],
        _ => [x, y, z],
    }
}

/// The profile that `source` refers to, with `shape` scaled to it. The outer none says that the lamp gives no light
/// without its profile.
fn measure(
    document: &Document,
    source: &Value,
    extension: &str,
    shape: &mut LightShape,
    node: &PlacedNode,
    profiles: &mut Profiles,
    warnings: &mut Vec<Warning>,
) -> Option<Option<Arc<Profile>>> {
    let (LightShape::Point { intensity, .. } | LightShape::Spot { intensity, .. }) = shape else {
        let message = "lamp: only points and spots have IES profiles; it shines without, make it one of them";
        warnings.push(Warning::new("light_without_profile", node.path.as_str(), message));
        return Some(None);
    };
    let absolute = extension == MEASURED || json::boolean(source, "absolute") == Some(true);
    let without =
        if absolute { "the lamp is skipped, for only the profile says how bright it is" } else { "it shines without" };
    let profile = profiles.get(document, source, &node.path, without, warnings);
    if absolute {
        // A profile is in candela whatever the units of the file.
        *intensity *= profile.as_ref()?.peak() / LUMENS_PER_WATT;
    }
    Some(profile)
}

/// Reads numbers of one light, noting those that had to be replaced.
struct Reader<'a> {
    definition: &'a Value,
    /// What the node adds to it.
    instance: &'a Value,
    /// From the file's units to radiometric ones.
    factor: f32,
    faults: Vec<String>,
}

impl Reader<'_> {
    /// A strength per channel.
    fn strength(&mut self, key: &str) -> Rgb {
        let Some(value) = json::triple(self.definition, key) else {
            self.faults.push(format!("{key} is missing or no colour and is taken as 0"));
            return Rgb::ZERO;
        };
        self.sound(Rgb::from_array(value), key)
    }

    /// Colour × intensity in the units of the file.
    fn colored(&mut self, default_intensity: f32) -> Rgb {
        let intensity = json::number(self.definition, "intensity").unwrap_or(default_intensity);
        let color = json::numbers(self.definition, "color").map_or(Rgb::ONE, Rgb::from_array);
        let factor = self.factor;
        self.sound(color * intensity, "intensity") * factor
    }

    fn sound(&mut self, value: Rgb, key: &str) -> Rgb {
        let sound = value.to_array().map(|c| if c.is_finite() { c.max(0.0) } else { 0.0 });
        if sound != value.to_array() {
            self.faults.push(format!("{key} is negative or not finite and is taken as 0"));
        }
        Rgb::from_array(sound)
    }

    /// A number within `low..=high`.
    fn within(&mut self, object: &Value, key: &str, default: f32, low: f32, high: f32) -> f32 {
        let value = json::number(object, key).unwrap_or(default);
        let sound = if value.is_finite() { value.clamp(low, high) } else { default };
        // Angles such as π/2 arrive a rounding error too large.
        if (sound - value).abs() > 1e-4 * high.min(1.0) || !value.is_finite() {
            self.faults.push(format!("{key} of {value} is taken as {sound}"));
        }
        sound
    }

    fn size(&mut self) -> [f32; 2] {
        let size =
            json::numbers(self.definition, "size").or_else(|| json::number(self.definition, "size").map(|s| [s; 2]));
        let Some(size) = size else {
            self.faults.push("size is missing and is taken as 1".into());
            return [1.0; 2];
        };
        let sound = size.map(|s| if s.is_finite() { s.max(0.0) } else { 0.0 });
        if sound != size {
            self.faults.push("size is negative or not finite and is taken as 0".into());
        }
        sound
    }
}

/// LIGHTKILN_scene: always radiometric.
fn own(reader: &mut Reader) -> Option<LightShape> {
    let definition = reader.definition;
    Some(match json::string(definition, "type")? {
        "rect" => LightShape::Rect {
            radiance: reader.strength("radiance"),
            size: reader.size(),
            spread: reader.within(definition, "spread", PI, 0.0, PI),
        },
        "disk" => LightShape::Disk {
            radiance: reader.strength("radiance"),
            size: reader.size(),
            spread: reader.within(definition, "spread", PI, 0.0, PI),
        },
        "point" => LightShape::Point {
            intensity: reader.strength("intensity"),
            radius: reader.within(definition, "radius", 0.0, 0.0, f32::MAX),
        },
        "spot" => LightShape::Spot {
            intensity: reader.strength("intensity"),
            radius: reader.within(definition, "radius", 0.0, 0.0, f32::MAX),
            outer_cone_angle: reader.within(definition, "outerConeAngle", FRAC_PI_4, 0.0, FRAC_PI_2),
            blend: reader.within(definition, "blend", 0.0, 0.0, 1.0),
            falloff: Falloff::Smoothstep,
        },
        "sun" => LightShape::Sun {
            irradiance: reader.strength("irradiance"),
            angle: reader.within(definition, "angle", 0.0, 0.0, PI),
        },
        _ => return None,
    })
}

/// KHR_lights_punctual. `range` is a hint for renderers that cut light off and is not physical: it is not read.
fn punctual(reader: &mut Reader) -> Option<LightShape> {
    let definition = reader.definition;
    Some(match json::string(definition, "type")? {
        "point" => LightShape::Point { intensity: reader.colored(1.0), radius: 0.0 },
        "directional" => LightShape::Sun { irradiance: reader.colored(1.0), angle: 0.0 },
        "spot" => {
            let none = Value::Null;
            let spot = definition.get("spot").unwrap_or(&none);
            let outer = reader.within(spot, "outerConeAngle", FRAC_PI_4, 0.0, FRAC_PI_2);
            let inner = reader.within(spot, "innerConeAngle", 0.0, 0.0, outer);
            // glTF fades over the cosine from outer to inner; `blend` is that span's share of 1 − cos outer.
            let blend = if outer > 0.0 { (inner.cos() - outer.cos()) / (1.0 - outer.cos()) } else { 0.0 };
            LightShape::Spot {
                intensity: reader.colored(1.0),
                radius: 0.0,
                outer_cone_angle: outer,
                blend: blend.clamp(0.0, 1.0),
                falloff: Falloff::Square,
            }
        }
        _ => return None,
    })
}

/// EXT_lights_area, a draft whose keys have changed: `size` is a number or a pair, `aspect` (width / height) may stand
/// in `rect` or beside it.
fn area(reader: &mut Reader) -> Option<LightShape> {
    let definition = reader.definition;
    let kind = json::string(definition, "type")?;
    let radiance = reader.colored(1000.0);
    let [width, height] = if definition.get("size").is_some() { reader.size() } else { [1.0; 2] };
    let shape = definition.get(kind).unwrap_or(definition);
    let aspect = json::number(shape, "aspect").or_else(|| json::number(definition, "aspect")).unwrap_or(1.0);
    Some(match kind {
        "rect" => LightShape::Rect { radiance, size: [width * aspect, height], spread: PI },
        "disk" => LightShape::Disk { radiance, size: [width, height], spread: PI },
        _ => return None,
    })
}

/// EXT_lights_ies: the definition is the profile, and the node says how much of it. Its `multiplier` has no unit.
fn measured(reader: &mut Reader) -> Option<LightShape> {
    let multiplier = json::number(reader.instance, "multiplier").unwrap_or(1.0);
    let color = json::numbers(reader.instance, "color").map_or(Rgb::ONE, Rgb::from_array);
    Some(LightShape::Point { intensity: reader.sound(color * multiplier, "multiplier or color"), radius: 0.0 })
}

/// Sizes in the world: widths with the node's scale along X and Y, or `even`ly, and radii with its largest scale.
fn scaled(shape: LightShape, node: &PlacedNode, even: bool) -> LightShape {
    let matrix = node.world.matrix3;
    let along = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis.length() as f32);
    let largest = along[0].max(along[1]).max(along[2]);
    let scale = if even { [largest; 2] } else { [along[0], along[1]] };
    let spans = |size: [f32; 2]| [size[0] * scale[0], size[1] * scale[1]];
    match shape {
        LightShape::Rect { radiance, size, spread } => LightShape::Rect { radiance, size: spans(size), spread },
        LightShape::Disk { radiance, size, spread } => LightShape::Disk { radiance, size: spans(size), spread },
        LightShape::Point { intensity, radius } => LightShape::Point { intensity, radius: radius * largest },
        LightShape::Spot { intensity, radius, outer_cone_angle, blend, falloff } => {
            LightShape::Spot { intensity, radius: radius * largest, outer_cone_angle, blend, falloff }
        }
        sun @ LightShape::Sun { .. } => sun,
    }
}

/// Which property makes a lamp dark, if one does.
fn dark(shape: &LightShape) -> Option<&'static str> {
    let (strength, size) = match *shape {
        LightShape::Rect { radiance, size, spread } => (radiance, size[0].min(size[1]).min(spread)),
        LightShape::Disk { radiance, size, spread } => (radiance, size[0].min(size[1]).min(spread)),
        LightShape::Point { intensity, .. } => (intensity, 1.0),
        LightShape::Spot { intensity, outer_cone_angle, .. } => (intensity, outer_cone_angle),
        LightShape::Sun { irradiance, .. } => (irradiance, 1.0),
    };
    if strength.max_element() <= 0.0 {
        Some("strength")
    } else if size <= 0.0 {
        Some("size, spread or cone")
    } else {
        None
    }
}

/// Orthonormal axes of a node, with Z exact where shear bends the others away from it.
fn frame(node: &PlacedNode) -> [Vec3; 3] {
    let matrix = node.world.matrix3;
    let z = matrix.z_axis.try_normalize().or_else(|| matrix.x_axis.cross(matrix.y_axis).try_normalize());
    let z = z.unwrap_or(glam::DVec3::Z);
    let x = matrix.x_axis - z * z.dot(matrix.x_axis);
    let x = x.try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
    [x, z.cross(x), z].map(|axis| axis.as_vec3())
}
