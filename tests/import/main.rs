//! Import of glTF: what real files may contain arrives in the scene, and what is wrong with them is said.

mod bad_input;
mod compressed;
mod containers;
mod fixture;
mod geometry;
mod ies;
mod lights;
mod lit_copies;
mod materials;
mod sky;
mod structure;
