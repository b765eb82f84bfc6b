//! Conversion to the SI radiometric units that everything inside uses.

/// Luminous efficacy that glTF, Blender and UsdLux agree on, lm/W.
pub const LUMENS_PER_WATT: f32 = 683.0;

/// What the strengths of lamps and emissive materials in a file mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
