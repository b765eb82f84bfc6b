//! Conversion to the SI radiometric units that everything inside uses, and what a lightmap may hold.

use serde::{Deserialize, Serialize};
use std::f32::consts::PI;

/// Luminous efficacy that glTF, Blender and UsdLux agree on, lm/W.
pub const LUMENS_PER_WATT: f32 = 683.0;

/// What a lightmap texel means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// Irradiance E: all light that arrives.
    #[default]
    Irradiance,
    /// E/π: radiance that a white diffuse surface would send out.
    Radiance,
    /// ρE: light that the surface reflects. Its own emission is not part of it.
    Radiosity,
}

impl Quantity {
    /// Name in attributes and reports.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::Irradiance => "irradiance",
            Quantity::Radiance => "radiance",
            Quantity::Radiosity => "radiosity",
        }
    }

    /// SI unit.
    pub fn unit(self) -> &'static str {
        match self {
            Quantity::Irradiance | Quantity::Radiosity => "W/m^2",
            Quantity::Radiance => "W/(m^2*sr)",
        }
    }

    /// What an irradiance is multiplied by, apart from the reflectance.
    pub fn factor(self) -> f32 {
        match self {
            Quantity::Irradiance | Quantity::Radiosity => 1.0,
            Quantity::Radiance => 1.0 / PI,
        }
    }
}

/// What the strengths of lamps and emissive materials in a file mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LightUnits {
    /// Candela, lux and nits, as core glTF defines them.
    Photometric,
    /// W/sr, W/m² and W/(m²·sr).
    Radiometric,
}

impl LightUnits {
    /// Factor from a value in these units to the radiometric value.
    pub fn to_radiometric(self) -> f32 {
        match self {
            LightUnits::Photometric => 1.0 / LUMENS_PER_WATT,
            LightUnits::Radiometric => 1.0,
        }
    }
}
