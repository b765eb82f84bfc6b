//! The environment of LIGHTKILN_scene: constant, gradient or picture.

use super::{EXTENSION, files, json, sky};
use crate::document::Document;
use crate::scene::{Environment, Panorama, Rgb, Sky};
use crate::warning::Warning;
use glam::Quat;
use serde_json::Value;
use std::sync::Arc;

/// What surrounds the scene; black where the file says nothing.
pub(super) fn load(document: &Document, warnings: &mut Vec<Warning>) -> Environment {
    let Some(source) = document.root_extension(EXTENSION).and_then(|e| e.get("environment")) else {
        return Environment::Black;
    };
    let has_radiance = source.get("radiance").is_some();
    let environment = if let Some(gradient) = source.get("gradient") {
        Environment::Gradient {
            zenith: radiance(gradient, "zenith", warnings),
            horizon: radiance(gradient, "horizon", warnings),
            ground: radiance(gradient, "ground", warnings),
        }
    } else if let Some(environment) = source.get("image").and_then(|image| picture(document, source, image, warnings)) {
        environment
    } else if has_radiance {
        Environment::Constant(radiance(source, "radiance", warnings))
    } else if source.get("image").is_some() {
        Environment::Black
    } else {
        let message = "it has none of `radiance`, `gradient` and `image`; the sky is black, give one of them";
        warnings.push(Warning::new("environment", "environment", message));
        Environment::Black
    };
    let dark = match &environment {
        Environment::Black => true,
        Environment::Constant(l) => *l == Rgb::ZERO,
        Environment::Gradient { zenith, horizon, ground } => zenith.max(*horizon).max(*ground) == Rgb::ZERO,
        Environment::Image(sky) => sky.is_black(),
    };
    if dark { Environment::Black } else { environment }
}

/// The picture that `image` refers to, or none with a warning.
fn picture(document: &Document, source: &Value, image: &Value, warnings: &mut Vec<Warning>) -> Option<Environment> {
    let name = files::name(image);
    let mut warn = |code, message: String| warnings.push(Warning::new(code, name.as_str(), message));
    let picture = match files::bytes(document, image).and_then(|bytes| sky::read(&bytes)) {
        Ok(picture) => picture,
        Err(fault) => {
            let instead = match source.get("radiance") {
                Some(_) => "its `radiance` is used instead",
                None => "the sky is black",
            };
            let message = format!("environment image: {fault}; {instead}, give a latitude-longitude .exr or .hdr");
            warn("environment_image", message);
            return None;
        }
    };
    let panorama = &picture.panorama;
    if panorama.width != 2 * panorama.height {
        let message = format!(
            "environment image: its {} × {} pixels are not twice as wide as high; it is stretched over the whole sphere, \
             save it in latitude-longitude layout",
            panorama.width, panorama.height
        );
        warn("environment_layout", message);
    }
    if picture.negative + picture.infinite > 0 {
        let message = format!(
            "environment image: {} pixels are negative or no numbers and taken as 0, {} are infinite and taken as the \
             brightest other pixel; mend the image",
            picture.negative, picture.infinite
        );
        warn("environment_pixels", message);
    }
    let strength = json::number(source, "strength").unwrap_or(1.0);
    if !(strength.is_finite() && strength >= 0.0) {
        warn("environment", format!("environment image: its strength of {strength} is taken as 0; correct it"));
        return Some(Environment::Black);
    }
    let rotation = json::numbers(source, "rotation").map_or(Quat::IDENTITY, Quat::from_array);
    let rotation = if rotation.is_finite() && rotation.length_squared() > 0.0 {
        rotation.normalize()
    } else {
        warn("environment", "environment image: its rotation is no quaternion and left out; correct it".into());
        Quat::IDENTITY
    };
    Some(Environment::Image(Arc::new(Sky::new(scaled(picture.panorama, strength), rotation))))
}

fn scaled(mut panorama: Panorama, strength: f32) -> Panorama {
    // Products must stay finite.
    panorama.pixels.iter_mut().for_each(|p| *p = (*p * strength).min(Rgb::splat(1e30)));
    panorama
}

fn radiance(object: &Value, key: &str, warnings: &mut Vec<Warning>) -> Rgb {
    let value = json::triple(object, key).unwrap_or([f32::NAN; 3]);
    let sound = value.map(|c| if c.is_finite() { c.max(0.0) } else { 0.0 });
    if sound != value {
        let message = format!("`{key}` is missing, negative or not finite and taken as 0; give three radiances");
        warnings.push(Warning::new("environment", "environment", message));
    }
    Rgb::from_array(sound)
}
