//! Conversion to the SI radiometric units that everything inside uses.

/// Luminous efficacy that glTF, Blender and UsdLux agree on, lm/W.
pub const LUMENS_PER_WATT: f32 = 683.0;

use serde::Serialize;
use std::f32::consts::PI;

/// What a lightmap texel means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
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
