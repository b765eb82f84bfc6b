//! Lightkiln bakes lightmaps with clustering hierarchical radiosity.
//!
//! The data's way: [`import`] resolves a glTF file to an immutable [`scene`]; [`atlas`] unwraps and rasterises it to
//! texels; [`accel`] answers ray queries; [`hierarchy`], [`transport`] and [`solve`] find the coarse radiosity
//! solution; [`gather`] turns it into irradiance per texel; [`post`] mends seams and dilates; [`audit`] tells how far the
//! result is from the truth; [`output`] writes. [`relight`] changes the light of what was baked.
//! Only [`bake`] knows that order.

pub mod accel;
pub mod atlas;
pub mod audit;
pub mod bake;
pub mod config;
pub mod document;
pub mod gather;
pub mod hierarchy;
pub mod import;
pub mod math;
pub mod output;
pub mod post;
pub mod progress;
pub mod relight;
pub mod scene;
pub mod solve;
pub mod transport;
pub mod units;
pub mod warning;
