//! Conversion to the SI radiometric units that everything inside uses.

/// Luminous efficacy that glTF, Blender and UsdLux agree on, lm/W.
pub const LUMENS_PER_WATT: f32 = 683.0;
